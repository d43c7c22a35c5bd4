"""Where artefacts may arrive: region and placer in step with map and robot."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from are_ros.agents.robots import RobotPose
from are_ros.builder.spawning.spawner import Spawning
from are_ros.errors import ParameterError
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import GroundPose, boxes_of
from are_ros.population.catalogue import MotionLimits
from are_ros.population.departures import Cause
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.footprint import Footprint
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform

Scene = Any
"""The `Scene` of conftest, which tests cannot import."""
DISC = Footprint.disc(0.2)
NOBODY = OrientedBoxes.empty()
SPLIT = (0, 40, 19, 21)
"""A wall that splits the room in two."""


def surroundings(grid: OccupancyGrid) -> Environment:
    """Return the environment of a map without a cloud."""
    return Environment(grid, classify(grid, 65, 25), None, PlaneGround(0.0), 0.01)


def robot_at(x: float, y: float) -> RobotPose:
    """Return the robot at a place."""
    return RobotPose(0, RigidTransform.planar(x, y, 0.0), DISC.at(x, y, 0.0))


def spawning(**values: Any) -> Spawning:
    """Return a spawning with some values of `population.` set."""
    paths = {f"population.{name}": value for name, value in values.items()}
    return Spawning(with_values(Parameters(), paths), DISC)


def test_nobody_can_be_placed_before_the_region_is_known(make_scene: Callable[..., Scene]) -> None:
    """Area 0 and no pose; a reachable region needs the robot."""
    scene, spawn = make_scene(), spawning()
    generator = np.random.default_rng(1)
    assert spawn.place(scene.row(0), generator, NOBODY, None, None) is Cause.NO_PLACE
    spawn.refresh(surroundings(scene.room()), None)
    assert spawn.area_m2 == 0.0
    assert spawn.place(scene.row(0), generator, NOBODY, None, None) is Cause.NO_PLACE


def test_the_reachable_region_follows_the_robot(make_scene: Callable[..., Scene]) -> None:
    """Only a change of component changes it, and only then is it said to be another."""
    spawn, environment = spawning(), surroundings(make_scene().room(SPLIT))
    assert spawn.refresh(environment, robot_at(1.0, 2.0))
    area_m2 = spawn.area_m2
    assert area_m2 == pytest.approx(18 * 38 * 0.01)
    assert not spawn.refresh(environment, robot_at(1.2, 2.5))
    assert not spawn.refresh(environment, None)
    assert spawn.refresh(environment, robot_at(3.0, 2.0))
    assert spawn.area_m2 == pytest.approx(area_m2)


def test_a_new_map_makes_a_new_region(make_scene: Callable[..., Scene]) -> None:
    """Also while the robot's pose is not known: then its last place counts."""
    scene, spawn = make_scene(), spawning()
    assert spawn.refresh(surroundings(scene.room(SPLIT)), robot_at(1.0, 2.0))
    half_m2 = spawn.area_m2
    assert spawn.refresh(surroundings(scene.room()), None)
    assert spawn.area_m2 > 2.0 * half_m2


@pytest.mark.parametrize(("region", "crosses"), [("reachable", False), ("free", True)])
def test_poses_lie_in_the_region(
    make_scene: Callable[..., Scene], region: str, crosses: bool
) -> None:
    """All on the robot's side of the wall, or on both; clear of walls, others and robot."""
    scene, spawn = make_scene(), spawning(region=region)
    environment, robot = surroundings(scene.room(SPLIT)), robot_at(1.0, 2.0)
    spawn.refresh(environment, robot)
    others = boxes_of([scene.row(0)], [GroundPose(1.0, 3.2, 0.0, 0.3)])
    generator, sides = np.random.default_rng(5), set()
    for _ in range(40):
        pose = spawn.place(scene.row(1), generator, others, robot, None)
        assert isinstance(pose, GroundPose)
        box = boxes_of([scene.row(1)], [pose])
        assert spawn.why_not(box, environment, others, robot) == ""
        sides.add(pose.x_m > 2.0)
    assert sides == ({True, False} if crosses else {False})


@pytest.mark.parametrize("near", [None, (0.6, 0.6)])
def test_walkers_arrive_where_they_can_turn(
    make_scene: Callable[..., Scene], near: tuple[float, float] | None
) -> None:
    """Alone or beside another in a corner of the room; in an aisle they arrive all the same."""
    scene, spawn, generator = make_scene(), spawning(region="free"), np.random.default_rng(3)
    walks = {"motion": MotionLimits(speed_mps=1.0), "behaviours": {"walking": 1.0}}
    walker = replace(scene.row(1), size_m=(0.3, 0.8, 1.7), **walks)
    environment, radius_m = surroundings(scene.room()), math.hypot(0.15, 0.4)
    spawn.refresh(environment, None)
    for _ in range(100):
        pose = spawn.place(walker, generator, NOBODY, None, near)
        assert isinstance(pose, GroundPose)
        assert min(pose.x_m, pose.y_m, 4.0 - pose.x_m, 4.0 - pose.y_m) >= 0.1 + radius_m - 1e-6
    spawn.refresh(surroundings(scene.room((0, 40, 0, 16), (0, 40, 22, 40))), None)
    poses = [spawn.place(walker, generator, NOBODY, None, None) for _ in range(5)]
    assert all(isinstance(pose, GroundPose) for pose in poses)


def test_members_of_a_group_are_near_the_first(make_scene: Callable[..., Scene]) -> None:
    """Within population.group_radius of it."""
    scene, spawn = make_scene(), spawning(group_radius=0.8)
    robot = robot_at(3.0, 3.0)
    spawn.refresh(surroundings(scene.room()), robot)
    generator = np.random.default_rng(2)
    for _ in range(20):
        pose = spawn.place(scene.row(1), generator, NOBODY, robot, (1.0, 1.0))
        assert isinstance(pose, GroundPose)
        assert np.hypot(pose.x_m - 1.0, pose.y_m - 1.0) <= 0.8


def test_zones_come_from_their_file(make_scene: Callable[..., Scene], tmp_path: Path) -> None:
    """The area is the zone's free cells; without a file the region cannot be zones."""
    environment = surroundings(make_scene().room())
    with pytest.raises(ParameterError, match=r"region is zones, but population\.zones lists none"):
        spawning(region="zones").refresh(environment, None)
    path = tmp_path / "zones.yaml"
    path.write_text("zones:\n- polygon: [[1, 1], [2, 1], [2, 3], [1, 3]]\n", encoding="utf-8")
    spawn = spawning(region="zones", zones=str(path))
    assert spawn.refresh(environment, None)
    assert spawn.area_m2 == pytest.approx(2.0, abs=0.01)


IN_THE_ROOM = "zones: [{polygon: [[1, 1], [2, 1], [2, 3]]}]"
BESIDE_IT = "zones: [{polygon: [[91, 1], [92, 1], [92, 3]]}]"
ONE_OF_THREE = """zones:
- {polygon: [[1, 1], [2, 1], [2, 3]]}
- {name: attic, polygon: [[91, 1], [92, 1], [92, 3]]}
- {polygon: [[0, 91], [1, 91], [1, 93]]}
"""
NOWHERE = "no_spawn: [[[-9, -9], [99, -9], [99, 99], [-9, 99]]]"


@pytest.mark.parametrize(
    ("zones", "region", "robot_x_m", "why"),
    [
        (IN_THE_ROOM, "zones", 1.0, ""),
        (IN_THE_ROOM, "reachable", 1.0, ""),
        (IN_THE_ROOM, "reachable", -9.0, "nobody can arrive: the robot stands on no free cell"),
        (
            ONE_OF_THREE,
            "zones",
            1.0,
            "nobody can arrive in attic and zone 2 of population.zones: no",
        ),
        (ONE_OF_THREE, "free", 1.0, ""),
        (BESIDE_IT, "zones", 1.0, "nobody can arrive: population.zones leaves no free cell"),
        (NOWHERE, "free", 1.0, "nobody can arrive: population.zones leaves no free cell"),
        (NOWHERE, "reachable", 1.0, "nobody can arrive: population.zones leaves no free cell"),
    ],
)
def test_it_says_where_nobody_can_arrive(
    make_scene: Callable[..., Scene],
    tmp_path: Path,
    zones: str,
    region: str,
    robot_x_m: float,
    why: str,
) -> None:
    """Zones beside the map are no fault of the robot's pose."""
    path = tmp_path / "zones.yaml"
    path.write_text(zones, encoding="utf-8")
    spawn = spawning(region=region, zones=str(path))
    assert not spawn.doubt_about_region
    spawn.refresh(surroundings(make_scene().room()), robot_at(robot_x_m, 2.0))
    assert spawn.doubt_about_region.startswith(why)
    assert bool(spawn.doubt_about_region) == bool(why)


def test_a_polygon_for_a_robot_counts_by_its_inscribed_radius(
    make_scene: Callable[..., Scene],
) -> None:
    """A long robot passes where its half width does."""
    wide = Spawning(Parameters(), Footprint.parse("[[1, 0.4], [1, -0.4], [-1, -0.4], [-1, 0.4]]"))
    doorway = [(0, 17, 19, 21), (22, 40, 19, 21)]
    environment = surroundings(make_scene().room(*doorway))
    wide.refresh(environment, robot_at(1.0, 2.0))
    narrow = spawning()
    narrow.refresh(environment, robot_at(1.0, 2.0))
    assert narrow.area_m2 > 1.8 * wide.area_m2
