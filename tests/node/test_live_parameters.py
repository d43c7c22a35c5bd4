"""Parameters of the running node, over its services: what acts at once, and what is refused."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.ros import NOT_SET_UP

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from are_msgs.msg import ArtefactEvent
from std_msgs.msg import String

from are_ros.node.qos import profile_of
from are_ros.parameters.choices import OnRobotContact
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import EFFECTIVE_TOPIC, with_text
from tests.node.live_bench import DELETE_ALL, Bench
from tests.node.live_scene import cloud, pose_at, robot_at, room, wall_voxels

MakeBench = Callable[..., Bench]
CUBE, TRIANGLE_LIST = 1, 11
MANY = {"population.arrival_rate": 1.0, "population.mean_life": 2.0}


@pytest.fixture
def bench(make_bench: MakeBench) -> Bench:
    """Return an active node with a robot in a room at 1000.1 s, which nobody has entered."""
    made = make_bench({}, "configure", "activate")
    made.clock(1000.0)
    made.send("map", room())
    step(made, 1000.1)
    return made


def step(bench: Bench, t_s: float) -> None:
    """Let the robot say where it is, and the time go on to a tick."""
    bench.send("tf", robot_at(t_s - 0.05))
    bench.tick(t_s)


def test_the_rate_of_arrivals_acts_at_once(bench: Bench) -> None:
    """From none to many, and back to none."""
    lists = bench.listen("artefacts")
    step(bench, 1000.5)
    assert lists[-1].artefacts == []
    assert bench.set(population__arrival_rate=10.0) == ""
    step(bench, 1000.8)
    arrived = len(lists[-1].artefacts)
    assert arrived > 3
    assert bench.set(population__arrival_rate=0.0) == ""
    step(bench, 1001.2)
    assert 0 < len(lists[-1].artefacts) <= arrived


def test_tau_acts_at_once(bench: Bench) -> None:
    """Who shows in fewer pixels is perceived no more; each change is an event."""
    perceived, events = bench.listen("perceived"), bench.listen("events")
    spawned = bench.spawn(pose_at(2.5, 2.0), label="post")
    for tau, ids in ((0, [spawned.id]), (64 * 48, []), (20, [spawned.id])):
        assert bench.set(occlusion__tau=tau) == ""
        step(bench, (bench.node.now_ns() + 10**8) / 1e9)
        assert [one.id for one in perceived[-1].artefacts] == ids
    kinds = [event.kind for event in events if event.kind != ArtefactEvent.ARRIVED]
    assert kinds == [ArtefactEvent.PERCEIVED, ArtefactEvent.LOST, ArtefactEvent.PERCEIVED]


def test_the_gate_of_the_grids_acts_at_once(bench: Bench) -> None:
    """Whom the robot does not see is in the augmented map only while all are admitted."""
    maps, costmaps = bench.listen("augmented_map"), bench.listen("augmented_costmap")
    assert bench.spawn(pose_at(0.45, 2.05), label="post").success, "behind the robot"
    counts = []
    for gate in ("perceived", "all", "perceived"):
        assert bench.set(costmap__gate=gate) == ""
        step(bench, (bench.node.now_ns() + 2 * 10**8) / 1e9)
        counts.append([grid[-1].data.tolist().count(100) - 4 * 39 for grid in (maps, costmaps)])
    assert counts == [[0, 0], [25, 25], [0, 0]]


def test_zones_that_are_lacking_are_refused(make_bench: MakeBench, tmp_path: Path) -> None:
    """A file of exits alone has nowhere to appear; the node says so, and goes on."""
    zones = tmp_path / "zones.yaml"
    zones.write_text("exits: [{polygon: [[1, 1], [2, 1], [2, 2]]}]", encoding="utf-8")
    bench = make_bench({"population.zones": str(zones)}, "configure", "activate")
    bench.clock(1000.0)
    bench.send("map", room())
    refused = bench.set(population__appear="zones")
    assert refused.startswith("population.appear is zones, but population.zones names no file that")
    lists = bench.listen("artefacts")
    assert bench.set(population__appear="out_of_view") == ""
    step(bench, 1000.5)
    assert lists[-1].artefacts == []


def test_the_surface_of_the_environment_comes_with_the_markers_by_choice(bench: Bench) -> None:
    """It is sent once, of the walls of the room, and anew when there is an octomap."""
    markers = bench.listen("markers")

    def surfaces(t_s: float) -> list[int]:
        """Return the numbers of points of the surfaces that came in a tick."""
        markers.clear()
        step(bench, t_s)
        found = [m for batch in markers for m in batch.markers if m.ns == "environment"]
        assert all((m.type, m.action, m.lifetime.sec) == (TRIANGLE_LIST, 0, 0) for m in found)
        return [len(m.points) for m in found]

    assert surfaces(1000.2) == []
    assert bench.set(markers__environment=True) == ""
    (of_walls,) = surfaces(1000.3)
    assert of_walls > 3 * 12
    assert surfaces(1000.4) == []
    bench.send("octomap_point_cloud_centers", cloud(wall_voxels()))
    (of_octomap,) = surfaces(1000.5)
    assert of_octomap == 3 * 12
    assert surfaces(1000.6) == []
    assert bench.set(markers__environment=False) == ""
    assert surfaces(1000.7) == []


def test_the_shape_of_the_markers_acts_at_once(bench: Bench) -> None:
    """Boxes become meshes; nothing of the boxes stays behind."""
    markers = bench.listen("markers")
    assert bench.spawn(pose_at(2.5, 2.0), label="post").success
    step(bench, 1000.2)
    assert CUBE in {marker.type for marker in markers[-1].markers if marker.action == 0}
    assert bench.set(markers__shape="mesh") == ""
    step(bench, 1000.3)
    first, *rest = markers[-1].markers
    assert first.action == DELETE_ALL
    assert TRIANGLE_LIST in {marker.type for marker in rest}
    assert CUBE not in {marker.type for marker in rest}


def test_weights_and_rates_change_together(bench: Bench) -> None:
    """One after the other they contradict each other, and are refused without a trace."""
    weights, rates = [0.5, 0.5], [0.1, 1.0]
    assert "weights" in bench.set(mixture__weights=weights)
    assert "rates" in bench.set(mixture__rates=rates)
    assert values(bench)["mixture.weights"] == [1.0]
    assert bench.set_together(mixture__weights=weights, mixture__rates=rates) == ""
    assert values(bench)["mixture.weights"] == weights
    assert bench.node.live is not None
    assert bench.node.live.builder.parameters.mixture.rates == tuple(rates)


def test_a_mixture_that_the_catalogue_cannot_take_is_refused(bench: Bench) -> None:
    """With the sentence, by both services; what was set beside it is not set either."""
    said = bench.set_together(mixture__rates=[15.0], occlusion__tau=7)
    assert "mixture.rates[0] is 15" in said
    assert "the 3 rows of the catalogue" in said
    assert "mixture.rates[0] is 15" in bench.set(mixture__rates=[15.0])
    assert values(bench)["occlusion.tau"] == 0
    assert bench.node.live is not None
    assert bench.node.live.builder.parameters.occlusion.tau == 0
    step(bench, 1000.2)


def test_a_label_for_clicks_that_the_catalogue_lacks_is_refused(bench: Bench) -> None:
    """When it is set, not when somebody clicks; a class, a label or nothing is taken."""
    said = bench.set(clicks__label="pots")
    assert said.startswith("parameter 'clicks.label': the catalogue has no row and no class named")
    assert "did you mean 'post'" in said
    assert bench.node.bridge.values.clicks.label == ""
    assert bench.set(clicks__label="post") == bench.set(clicks__label="") == ""


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("population__arrival_rate", -1.0, "below 0"),
        ("population__arrival_rate", float("nan"), "finite"),
        ("population__mean_life", 0.0, "below 0.001"),
        ("population__max_alive", "many", "'many'"),
        ("costmap__gate", "some", "perceived"),
        ("occlusion__tau", 0.5, "0.5"),
        ("no__such", 1, "no such parameter"),
        ("autostart", False, "read"),
    ],
)
def test_bad_values_are_refused_with_the_reason(
    bench: Bench, name: str, value: object, reason: str
) -> None:
    """And nothing changes."""
    before = values(bench)
    said = bench.set(**{name: value})
    assert reason in said
    assert values(bench) == before


def test_what_takes_effect_at_configure_waits_for_a_cleanup(bench: Bench) -> None:
    """While the node is configured it is refused, also beside a good value; the sentence helps."""
    said = bench.set_together(camera__width=32, occlusion__tau=5)
    assert said == (
        "parameter 'camera.width': it takes effect at configure; clean up the node first (if"
        " it is active: ros2 lifecycle set /ar_builder deactivate; then the same with cleanup)"
    )
    assert bench.set(seed=3).startswith("parameter 'seed': it takes effect at configure")
    assert values(bench)["occlusion.tau"] == 0
    assert bench.change_state("deactivate")
    assert bench.set(seed=3) != ""
    assert bench.change_state("cleanup")
    assert bench.set_together(camera__width=32, seed=3) == ""
    assert bench.change_state("configure")
    assert bench.node.live is not None
    assert bench.node.live.builder.parameters.camera.width == 32
    assert bench.node.live.builder.parameters.seed == 3


def test_changes_in_a_running_stream_do_not_disturb_the_lives(make_bench: MakeBench) -> None:
    """Who comes, when, where and for how long is the same with and without them."""
    changed, unchanged = (
        make_bench(MANY, arguments=("-r", f"__ns:=/{space}")) for space in ("one", "two")
    )
    assert lives_of(changed, with_changes=True) == lives_of(unchanged)


def lives_of(bench: Bench, *, with_changes: bool = False) -> list[Any]:
    """Return the lives of two seconds, beside which parameters of other things may change."""
    assert bench.change_state("configure", "activate")
    lists = bench.listen("artefacts")
    bench.clock(1000.0)
    bench.send("map", room())
    changes: list[dict[str, Any]] = [
        {"occlusion__tau": 30},
        {"costmap__gate": "all", "augmented_map__max_rate": 1.0},
        {"markers__shape": "mesh", "sensors__shape": "mesh"},
        {"costmap__memory": 3.0, "population__mean_life": 2.0},
        {"population__arrival_rate": 1.0, "sensors__gate": "perceived"},
    ]
    for index in range(20):
        step(bench, 1000.1 + 0.1 * index)
        if with_changes:
            assert bench.set(**changes[index % len(changes)]) == ""
    seen = {one.id: one for message in lists for one in message.artefacts}
    assert len(seen) > 10
    lived = [(one.id, one.row, one.pose, one.arrival, one.departure) for one in seen.values()]
    return sorted(lived, key=lambda life: int(life[0]))


def test_parameters_can_be_changed_before_the_node_is_configured(make_bench: MakeBench) -> None:
    """Of either kind; they are in force afterwards."""
    bench = make_bench()
    assert bench.set(seed=5, occlusion__tau=9) == ""
    assert bench.change_state("configure", "activate")
    assert bench.node.live is not None
    assert bench.node.live.builder.parameters.seed == 5
    assert bench.node.live.builder.parameters.occlusion.tau == 9


def test_the_parameters_in_force_are_a_topic(make_bench: MakeBench) -> None:
    """Latched, for recordings: from configure on, and again after each change."""
    bench = make_bench({"population.max_alive": 7}, "configure")
    latched = profile_of(True, True, 1)
    heard: list[String] = []
    topic = f"{bench.name}/{EFFECTIVE_TOPIC}"
    bench.user.create_subscription(String, topic, heard.append, latched)
    bench.until(lambda: heard)
    first = with_text(Parameters(), heard[0].data, topic)
    assert first.population.max_alive == 7
    assert first.collisions.on_robot_contact is OnRobotContact.HOLD
    assert bench.set(occlusion__tau=9) == ""
    bench.until(lambda: len(heard) == 2)
    second = with_text(Parameters(), heard[1].data, topic)
    assert second == with_values(first, {"occlusion.tau": 9})


def values(bench: Bench) -> dict[str, Any]:
    """Return what ROS says that the parameters are."""
    names = ["mixture.weights", "mixture.rates", "occlusion.tau", "costmap.gate", "seed"]
    names += ["population.arrival_rate", "population.mean_life", "population.max_alive"]
    found = {name: bench.node.get_parameter(name).value for name in names}
    return {k: v if isinstance(v, (int, float, str)) else list(v) for k, v in found.items()}
