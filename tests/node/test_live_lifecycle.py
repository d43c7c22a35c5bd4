"""The node's lifecycle, through the services that a lifecycle manager uses."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.ros import NOT_SET_UP

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from bags.simulation.making import RosbagsFactory
from tests.node.live_bench import Bench, stamp_ns
from tests.node.live_scene import ns, odometry, pose_at, room

MakeBench = Callable[..., Bench]


@pytest.mark.parametrize("use_events_executor", [False, True])
def test_it_goes_through_its_states_and_back(
    make_bench: MakeBench, *, use_events_executor: bool
) -> None:
    """Twice round; when it is active it ticks, when it is unconfigured it offers nothing."""
    bench = make_bench(use_events_executor=use_events_executor)
    assert bench.state() == "unconfigured"
    for t_s in (1000.0, 1010.0):
        assert bench.change_state("configure")
        assert bench.state() == "inactive"
        metrics = bench.listen("metrics")
        bench.clock(t_s)
        assert bench.change_state("activate")
        assert bench.state() == "active"
        bench.tick(t_s + 0.1)
        assert [stamp_ns(message) for message in metrics] == [ns(t_s), ns(t_s + 0.1)]
        assert bench.change_state("deactivate")
        bench.clock(t_s + 1.0)
        bench.settle()
        assert len(metrics) == 3, "the last one says that nobody is there"
        assert bench.change_state("cleanup")
        assert bench.state() == "unconfigured"
        bench.until(lambda: bench.user.count_publishers("/ar_builder/augmented_map") == 0)
        assert bench.user.count_subscribers("/map") == 0
    assert bench.change_state("shutdown")
    assert bench.state() == "finalized"


@pytest.mark.parametrize("transitions", [(), ("configure",), ("configure", "activate")])
def test_it_can_be_shut_down_from_every_state(
    make_bench: MakeBench, transitions: tuple[str, ...]
) -> None:
    """And it says that it is."""
    bench = make_bench({}, *transitions)
    assert bench.change_state("shutdown")
    assert bench.state() == "finalized"
    assert bench.report()["state"].message == "finalized: the node has shut down"
    assert not bench.spawn(pose_at(2.0, 2.0)).success


@pytest.mark.parametrize("transition_id", [1, 3, 99])
def test_a_transition_that_the_state_has_not_is_refused(
    make_bench: MakeBench, transition_id: int
) -> None:
    """By its number, as managers ask: rclpy alone would end the node, without an answer."""
    bench = make_bench({}, "configure", "activate")
    transition = RosbagsFactory().make("lifecycle_msgs/msg/Transition", id=transition_id)
    assert not bench.call("change_state", transition=transition).success
    assert bench.state() == "active"


def test_a_wrong_transition_is_refused(make_bench: MakeBench) -> None:
    """The state stays."""
    bench = make_bench()
    assert not bench.change_state("activate")
    assert bench.state() == "unconfigured"


def test_a_failing_configure_can_be_repaired(
    make_bench: MakeBench, catalogue_file: Path, tmp_path: Path
) -> None:
    """One sentence says what is wrong, and nothing is left open; then it works."""
    missing = str(tmp_path / "nowhere.yaml")
    bench = make_bench({"catalogue": missing})
    assert not bench.change_state("configure")
    assert bench.state() == "unconfigured"
    (said,) = bench.warnings()
    assert said == f"the catalogue {missing} cannot be read (No such file or directory)"
    assert bench.user.count_subscribers("/map") == 0
    assert bench.set(catalogue=str(catalogue_file)) == ""
    assert bench.change_state("configure", "activate")
    assert bench.state() == "active"


@pytest.mark.parametrize(
    ("topics", "sentence"),
    [
        (["front-laser/scan"], "'front-laser/scan' cannot be a topic: topic name must not contain"),
        (["9lives"], "'9lives' cannot be a topic: topic name token must not start with a number"),
        (["/scan"], "topic '/scan' is given twice, for scan and for range"),
    ],
)
def test_a_topic_that_cannot_be_fails_at_configure(
    make_bench: MakeBench, topics: list[str], sentence: str
) -> None:
    """In one sentence; nothing is left open, and each scan goes out once when it is put right."""
    bench = make_bench({"sensors.ranges": topics})
    assert not bench.change_state("configure")
    (said,) = bench.warnings()
    assert said.startswith(sentence)
    bench.until(lambda: bench.user.count_subscribers("/scan") == 0)
    assert bench.set(sensors__ranges=["sonar"]) == ""
    assert bench.change_state("configure")
    bench.until(lambda: bench.user.count_subscribers("/scan") == 1)


@pytest.mark.parametrize(
    ("infos", "sentence"),
    [
        (["image:=map"], "topic '/map' is given twice, for map and for camera_info"),
        (["image:=image"], "topic '/image' is given twice, for image and for camera_info"),
        (["image:=a", "/image:=b"], "parameter 'sensors.camera_infos': /image is given twice"),
        (["other:=lens"], "parameter 'sensors.camera_infos': /other is no topic of images"),
    ],
)
def test_a_camera_info_that_cannot_be_fails_at_configure(
    make_bench: MakeBench, infos: list[str], sentence: str
) -> None:
    """Names without a slash are full ones from there on, as those of sensors are."""
    bench = make_bench({"sensors.camera_infos": infos})
    assert not bench.change_state("configure")
    (said,) = bench.warnings()
    assert said.startswith(sentence)


def test_a_mixture_that_the_catalogue_cannot_take_fails_at_configure(make_bench: MakeBench) -> None:
    """It is only known then how many rows there are."""
    bench = make_bench({"mixture.rates": [15.0]})
    assert not bench.change_state("configure")
    (said,) = bench.warnings()
    assert "mixture.rates[0] is 15" in said
    assert "the 3 rows of the catalogue" in said


@pytest.mark.parametrize(
    ("override", "topic"),
    [("/scan.subscription", "scan"), ("/ar_builder/metrics.publisher", "~/metrics")],
)
def test_an_override_that_dds_cannot_take_fails_at_configure(
    make_bench: MakeBench, override: str, topic: str
) -> None:
    """Nothing is left open."""
    bench = make_bench({f"qos_overrides.{override}.depth": -1})
    assert not bench.change_state("configure")
    assert bench.state() == "unconfigured"
    (said,) = bench.warnings()
    assert said.startswith(f"topic '{topic}' with its qos_overrides: ")
    bench.until(lambda: bench.user.count_subscribers("/map") == 0)
    assert bench.user.count_publishers("/ar_builder/events") == 0


def test_without_tf2_msgs_it_lives_on_odometry(
    make_bench: MakeBench, without_packages: Callable[..., None]
) -> None:
    """It says what it does without; with a static map->odom it knows where the robot is."""
    without_packages("tf2_msgs")
    static = {"frames.static": ["0 0 0 0 0 0 map odom"]}
    bench = make_bench(static, "configure", "activate")
    said = "\n".join(bench.warnings())
    assert "/tf is not received: tf2_msgs/msg/TFMessage: tf2_msgs is not installed" in said
    assert "/tf_static is not received: tf2_msgs/msg/TFMessage: tf2_msgs is not installed" in said
    perceived = bench.listen("perceived")
    bench.send("map", room())
    bench.clock(1000.0)
    bench.send("odom", odometry(1000.0, 1.0, 2.0))
    bench.tick(1000.1)
    spawned = bench.spawn(pose_at(2.5, 2.0), label="post")
    bench.tick(1000.2)
    assert [one.id for one in perceived[-1].artefacts] == [spawned.id]
    assert not {"inputs/tf", "inputs/tf_static"} & bench.report().keys()


def test_without_map_msgs_there_are_no_updates(
    make_bench: MakeBench, without_packages: Callable[..., None]
) -> None:
    """It says so; whole maps come as ever."""
    without_packages("map_msgs")
    bench = make_bench({"costmap.gate": "all"}, "configure", "activate")
    (said,) = [s for s in bench.warnings() if "augmented_map_updates" in s]
    assert said.startswith("~/augmented_map_updates is not published: map_msgs/msg/OccupancyGridUp")
    maps: list[Any] = bench.listen("augmented_map")
    bench.send("map", room())
    bench.tick(1000.0)
    assert bench.spawn(pose_at(2.05, 2.05), label="post").success
    bench.tick(1000.1)
    assert maps[-1].data.tolist().count(100) == 4 * 39 + 5 * 5
    assert bench.user.count_publishers("/ar_builder/augmented_map_updates") == 0
