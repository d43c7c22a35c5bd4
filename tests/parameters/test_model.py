"""The parameters of ARE: the names that DESIGN fixes, and defaults that obey their own bounds."""

import pytest

from are_ros.parameters.declaration import Description, describe, flatten, with_values
from are_ros.parameters.model import Parameters

FIXED = (
    "seed",
    "builder.tick_rate",
    "population.arrival_rate",
    "population.mean_life",
    "population.departures",
    "population.max_alive",
    "population.group_size",
    "population.region",
    "mixture.weights",
    "mixture.rates",
    "catalogue",
    "world.occupied_threshold",
    "world.free_threshold",
    "world.wall_height",
    "world.voxel_size",
    "world.ground",
    "world.ground_clearance",
    "frames.map",
    "frames.odom",
    "frames.base",
    "frames.max_age",
    "frames.odometry",
    "robot.footprint",
    "robot.radius",
    "robot.clearance",
    "camera.model",
    "camera.frame",
    "camera.mount",
    "camera.width",
    "camera.height",
    "camera.hfov",
    "camera.rate",
    "camera.rectified",
    "occlusion.tau",
    "occlusion.max_range",
    "occlusion.shape",
    "occlusion.mutual",
    "costmap.gate",
    "costmap.memory",
    "costmap.inflation_radius",
    "costmap.cost_scaling_factor",
    "motion.step",
    "collisions.search_radius",
    "collisions.on_robot_contact",
    "sensors.gate",
    "sensors.shape",
    "sensors.tf_wait",
    "sensors.scans",
    "augmented_map.max_rate",
    "poses.history",
)
LIVE = ("population.arrival_rate", "population.mean_life", "mixture.weights", "mixture.rates")
ITEMS = {item.path: item for item in describe(Parameters())}


@pytest.mark.parametrize("path", FIXED)
def test_the_fixed_names_are_there(path: str) -> None:
    """Checks and users write them."""
    assert path in ITEMS


@pytest.mark.parametrize("item", ITEMS.values(), ids=ITEMS)
def test_a_default_obeys_its_own_declaration(item: Description) -> None:
    """It passes its own check, and its bounds are in order."""
    assert flatten(with_values(Parameters(), {item.path: item.default})) == flatten(Parameters())
    if item.low is not None and item.high is not None:
        assert item.low < item.high


@pytest.mark.parametrize("item", ITEMS.values(), ids=ITEMS)
def test_a_meaning_is_a_sentence(item: Description) -> None:
    """It begins with a capital or a choice, and ends with a full stop."""
    assert item.text.endswith(".")
    assert item.text[0].isupper() or item.text.split(":")[0].split(",")[0] in item.choices


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("builder.tick_rate", 10.0),
        ("frames.max_age", 0.5),
        ("motion.step", 0.05),
        ("poses.history", 2.0),
        ("sensors.tf_wait", 0.2),
        ("world.occupied_threshold", 65),
        ("world.free_threshold", 25),
        ("population.max_alive", 200),
        ("population.group_size", 1.0),
        ("population.region", "reachable"),
        ("robot.radius", 0.22),
        ("occlusion.tau", 50),
        ("costmap.gate", "perceived"),
        ("costmap.memory", 0.0),
        ("costmap.inflation_radius", 0.70),
        ("costmap.cost_scaling_factor", 3.0),
        ("sensors.gate", "geometry"),
        ("collisions.search_radius", 2.0),
        ("augmented_map.max_rate", 5.0),
        ("camera.hfov", pytest.approx(1.5707963)),
        ("camera.mount", (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)),
    ],
)
def test_the_defaults_that_were_decided(path: str, value: object) -> None:
    """As DESIGN says them."""
    assert flatten(Parameters())[path] == value


def test_the_stochastic_ones_change_while_it_runs() -> None:
    """Rates and laws are live; what the start-up computes from is not."""
    assert all(ITEMS[path].live for path in LIVE)
    assert not ITEMS["seed"].live
    assert not ITEMS["builder.tick_rate"].live


def test_sections_are_not_shared() -> None:
    """A changed copy leaves the defaults alone."""
    changed = with_values(Parameters(), {"robot.radius": 0.5})
    assert changed.robot.radius == 0.5
    assert Parameters().robot.radius == 0.22
    assert changed.population is not None
