"""What the running node says of itself on /diagnostics, and inputs that stop and come back."""

import time
from collections.abc import Callable
from contextlib import closing
from functools import partial
from typing import Any, Final

import pytest

from tests.ros import NOT_SET_UP, RosWorld, running_ns, undisturbed

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from nav_msgs.msg import OccupancyGrid
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import String

from are_ros.conventions import NS_PER_S
from are_ros.node.diagnostics import WITHOUT_CLOCK
from tests.node.live_bench import BEST_EFFORT, Bench, stamp_ns
from tests.node.live_scene import (
    cloud,
    laser_mount,
    ns,
    odometry,
    pose_at,
    robot_at,
    room,
    scan,
    transforms,
    wall_voxels,
)

MakeBench = Callable[..., Bench]
Later = Callable[[float], None]
OK, WARN, ERROR, STALE = b"\0", b"\1", b"\2", b"\3"
CLOUD: Final = "octomap_point_cloud_centers"
LATCHED_ONLY: Final = {"qos_overrides./map.subscription.durability": "transient_local"}


@pytest.fixture
def later(running_clock: None, monkeypatch: pytest.MonkeyPatch) -> Later:  # noqa: ARG001 - after it
    """Return what puts the clock that never jumps forward by some seconds."""
    ahead_ns = 0

    def now_ns() -> int:
        return running_ns() + ahead_ns

    def put_forward(seconds: float) -> None:
        nonlocal ahead_ns
        ahead_ns += ns(seconds)

    for module in ("ar_builder_node", "topics", "live_builder"):
        monkeypatch.setattr(f"are_ros.node.{module}.monotonic_ns", now_ns)
    return put_forward


def said(bench: Bench, name: str) -> tuple[bytes, str]:
    """Return level and message of a line of the diagnostics."""
    status = bench.report()[name]
    return status.level, status.message


def step(bench: Bench, t_s: float, x: float = 1.0) -> None:
    """Let the robot say where it is, and the time go on to a tick."""
    bench.send("tf", robot_at(t_s - 0.05, x=x))
    bench.tick(t_s)


@pytest.fixture
def bench(make_bench: MakeBench, later: Later) -> Bench:  # noqa: ARG001 - it comes first
    """Return an active node at 1000.1 s: the room, and the robot in it."""
    made = make_bench({}, "configure", "activate")
    made.clock(1000.0)
    made.send("tf_static", laser_mount())
    made.send("map", room())
    step(made, 1000.1)
    return made


def test_odometry_beside_tf_is_told_without_a_warning(bench: Bench) -> None:
    """Nearly every robot sends both."""
    bench.send("tf", transforms(("odom", "base_link", 1000.1, (1.0, 2.0, 0.0), 0.0)))
    bench.send("odom", odometry(1000.2, 1.0, 2.0))
    bench.tick(1000.2)
    bench.report()
    warnings = bench.warnings()
    assert "the transform odom -> base_link from odometry is overruled by tf" in bench.log
    assert not [one for one in warnings if "odometry" in one]


def test_each_state_has_its_lines(make_bench: MakeBench) -> None:
    """Unconfigured there is no input, inactive nothing to tick."""
    bench = make_bench()
    assert said(bench, "state") == (OK, "unconfigured: nothing is received and nothing published")
    assert [*bench.report()] == ["state", "clock"]
    bench.change_state("configure")
    assert said(bench, "state") == (OK, "inactive: the real map is relayed")
    inactive = {*bench.report()} - {"state", "clock"}
    assert inactive == {name for name in inactive if name.startswith("inputs/")}
    assert len(inactive) == 13
    bench.change_state("activate")
    bench.clock(1000.0)
    assert said(bench, "state") == (OK, "active")
    lines = {"frames/robot", "frames/camera", "cloud", "ticks", "population", "behaviours"}
    lines |= {"answers", "robot contact"}
    assert {*bench.report()} == {"state", "clock"} | inactive | lines


def test_it_comes_once_a_second_by_itself(make_bench: MakeBench) -> None:
    """With the node's name, and a stamp of its clock."""
    bench = make_bench({}, "configure")
    bench.clock(1000.0)
    bench.report()
    assert bench._reports is not None
    reports = bench._reports

    def three_periods_s() -> float:
        reports.clear()
        bench.until(lambda: reports)
        began_s = time.monotonic()
        bench.until(lambda: len(reports) > 3)
        return time.monotonic() - began_s

    assert undisturbed(three_periods_s) == pytest.approx(3.0, abs=0.6)
    message = reports[-1]
    assert message.header.stamp.sec == 1000
    assert all(status.name.startswith("ar_builder: ") for status in message.status)


def test_a_backlog_of_messages_does_not_keep_the_report(bench: Bench, later: Later) -> None:
    """Its timer waits behind them: a message reports when none has gone out for two seconds."""
    bench.report()
    reports = bench._reports
    assert reports is not None
    bench.node._report_timer.cancel()
    reports.clear()
    bench.send("tf", robot_at(1000.2))
    bench.turn_for(0.3)
    assert not reports
    later(2.5)
    bench.send("tf", robot_at(1000.25))
    bench.until(lambda: reports)


def test_what_is_missing_is_an_error_after_a_while(make_bench: MakeBench, later: Later) -> None:
    """Not before five seconds; each line says what to look at."""
    bench = make_bench({}, "configure", "activate")
    bench.tick(1000.0)
    bench.tick(1000.1)
    for name in ("inputs/map", "frames/robot", "frames/camera"):
        assert said(bench, name)[0] == OK, name
    assert said(bench, "clock") == (OK, "the time of /clock")
    later(5.5)
    level, message = said(bench, "inputs/map")
    assert level == ERROR
    assert message.endswith("nobody publishes /map")
    assert said(bench, "frames/robot")[0] == ERROR
    assert said(bench, "frames/camera")[0] == WARN
    assert said(bench, "inputs/scan") == (OK, "no message yet; the node works without")
    bench.send("map", room())
    step(bench, 1000.2)
    bench.listen("perceived")
    step(bench, 1000.3)
    for name in ("inputs/map", "frames/robot", "frames/camera"):
        assert said(bench, name)[0] == OK, name


@pytest.mark.parametrize(
    ("overrides", "asked"),
    [
        ({}, "best effort, volatile"),
        ({"qos_overrides./map.subscription.reliability": "reliable"}, "reliable, volatile"),
        (LATCHED_ONLY, "reliable, transient local"),
        (
            {**LATCHED_ONLY, "qos_overrides./map.subscription.reliability": "best_effort"},
            "best effort, transient local",
        ),
    ],
)
def test_of_a_map_that_is_offered_otherwise_is_told_what_is_asked_for(
    make_bench: MakeBench, later: Later, overrides: dict[str, str], asked: str
) -> None:
    """By best effort, and not latched; overrides included."""
    bench = make_bench(overrides, "configure", "activate")
    bench.user.create_publisher(OccupancyGrid, "/map", BEST_EFFORT)
    bench.until(lambda: bench.node.count_publishers("/map"))
    bench.report()
    later(5.5)
    level, message = said(bench, "inputs/map")
    assert level == ERROR
    assert message.endswith(f"QoS compatible (the node asks for {asked})?")


def test_what_is_published_as_another_type_is_told(make_bench: MakeBench, later: Later) -> None:
    """Of an image its name tells whether it is compressed. With the right type it is as ever."""
    images = {"sensors.images": ["/colour"]}
    bench = make_bench(images, "configure", "activate")
    made = [
        bench.user.create_publisher(CompressedImage, "/colour", 1),
        bench.user.create_publisher(String, "/map", 1),
    ]
    for one in made:
        bench.until(partial(bench.node.count_publishers, one.topic_name))
    bench.report()
    later(5.5)
    image, grid = "sensor_msgs/msg/Image", "nav_msgs/msg/OccupancyGrid"
    compressed = f": /colour is published as sensor_msgs/msg/CompressedImage, not {image}"
    assert said(bench, "inputs/image") == (WARN, f"no message yet{compressed}")
    level, message = said(bench, "inputs/map")
    assert level == ERROR
    assert message.endswith(f": /map is published as std_msgs/msg/String, not {grid}")
    logged = bench.warnings()
    assert f"no message of /colour yet{compressed}" in logged
    assert f"no message of /map yet: /map is published as std_msgs/msg/String, not {grid}" in logged
    with closing(RosWorld()) as others:
        others.make_node().create_publisher(Image, "/colour", 1)
        bench.until(lambda: bench.node.count_publishers("/colour") > 1)
        level, message = said(bench, "inputs/image")
    assert level == OK
    assert "QoS compatible" in message


def test_a_map_of_which_none_is_of_use_is_an_error(make_bench: MakeBench) -> None:
    """The reason of the last refusal is given."""
    bench = make_bench({}, "configure", "activate")
    bench.clock(1000.0)
    bench.send("map", room(frame_id="odom"))
    level, message = said(bench, "inputs/map")
    assert level == ERROR
    assert message == (
        "1 message, none of use; the last: /map: its frame is 'odom', but frames.map is 'map': "
        "set that to the map's frame (--set frames.map:=odom); but a map that moves with "
        "the robot (a local, rolling one) cannot be the real map"
    )


def test_without_a_clock_that_is_said(make_bench: MakeBench) -> None:
    """And the scans go on as they came; a simulator that is paused at 0 counts as none."""
    bench = make_bench({}, "configure", "activate")
    metrics = bench.listen("metrics")
    assert said(bench, "clock") == (ERROR, WITHOUT_CLOCK)
    bench.clock(0.0)
    assert said(bench, "clock") == (ERROR, WITHOUT_CLOCK)
    for service in ("clear", "reseed", "pause"):
        answer = bench.call(service)
        assert (answer.success, answer.message) == (False, WITHOUT_CLOCK)
    bench.tick(0.001)  # as Gazebo begins
    bench.tick(0.1)
    assert [stamp_ns(message) for message in metrics] == [NS_PER_S // 10]
    assert said(bench, "clock") == (OK, "the time of /clock")


def test_a_forgotten_simulated_time_is_the_cause(make_bench: MakeBench) -> None:
    """Stamps of 1970 beside the time of the wall: the option is named, here and in the log."""
    bench = make_bench({"use_sim_time": False}, "configure", "activate")
    assert said(bench, "clock") == (OK, "the time of this machine")
    bench.send("tf", robot_at(1000.0))
    bench.until(lambda: said(bench, "clock")[0] == ERROR)
    message = said(bench, "clock")[1]
    assert "years earlier than the time of this machine" in message
    assert "--use-sim-time" in message
    assert message in bench.warnings()


def test_a_second_node_of_the_same_name_is_said(
    ros: RosWorld, make_bench: MakeBench, later: Later
) -> None:
    """Half a minute later, as DDS knows a killed node for a while; it is in the log, once."""
    bench = make_bench({}, "configure", "activate")
    alone = said(bench, "state")
    other = ros.make_node("ar_builder")
    names = bench.node.get_node_names_and_namespaces
    ros.spin_until(lambda: names().count(("ar_builder", "/")) == 2)
    assert said(bench, "state") == alone
    later(31.0)
    bench.until(lambda: said(bench, "state")[0] == WARN)
    level, message = said(bench, "state")
    sentence = message.removeprefix(f"{alone[1]}; ")
    assert (level, sentence.split(",")[0]) == (WARN, "another node is called /ar_builder")
    assert bench.warnings().count(sentence) == 1
    other.destroy_node()
    bench.until(lambda: said(bench, "state") == alone)


def test_two_clocks_are_said(ros: RosWorld, bench: Bench, later: Later) -> None:
    """Half a minute later, too: time jumps to and fro where two players give it."""
    alone = said(bench, "clock")
    assert alone[0] == OK
    other = ros.make_node("player")
    other.create_publisher(Clock, "/clock", 10)
    ros.spin_until(lambda: bench.node.count_publishers("/clock") == 2)
    assert said(bench, "clock") == alone
    later(31.0)
    bench.until(lambda: said(bench, "clock")[0] == ERROR)
    sentence = said(bench, "clock")[1]
    assert sentence.startswith("2 publishers give /clock (two players, ")
    assert bench.warnings().count(sentence) == 1
    other.destroy_node()
    bench.until(lambda: said(bench, "clock") == alone)


def test_transforms_that_stop_and_come_back(bench: Bench, later: Later) -> None:
    """Nothing is perceived meanwhile, and it is said; then it is as before."""
    perceived = bench.listen("perceived")
    spawned = bench.spawn(pose_at(2.5, 2.0), label="post")
    step(bench, 1000.2)
    step(bench, 1000.3)
    assert [one.id for one in perceived[-1].artefacts] == [spawned.id]
    assert said(bench, "inputs/tf")[0] == OK
    bench.tick(1001.1)
    assert perceived[-1].artefacts == []
    later(6.0)
    bench.tick(1001.2)
    level, message = said(bench, "frames/robot")
    assert level == ERROR
    assert "from 'base_link' to 'map' is 0.950 s old" in message
    assert said(bench, "frames/camera")[0] == WARN
    level, message = said(bench, "inputs/tf")
    assert level == STALE
    assert message.startswith("it has stopped: it came at ")
    step(bench, 1001.3)
    assert [one.id for one in perceived[-1].artefacts] == [spawned.id]
    for name in ("frames/robot", "frames/camera", "inputs/tf"):
        assert said(bench, name)[0] == OK, name


def test_a_robot_beyond_the_map_is_told_until_it_is_back(bench: Bench, later: Later) -> None:
    """The log says it after a while: a localization that jumps is not worth a word."""
    step(bench, 1000.2, x=50.0)
    sentence = "the robot is beyond the map, at x 50.0 m, y 2.0 m: is it localised on this map?"
    assert said(bench, "frames/robot") == (WARN, sentence)
    assert not [one for one in bench.warnings() if "beyond the map" in one]
    for t_s in (1000.3, 1000.4):  # it is told once it has lasted
        later(6.0)
        step(bench, t_s, x=50.0)
        bench.report()
    assert bench.warnings().count(sentence) == 1
    step(bench, 1000.5)
    assert said(bench, "frames/robot")[0] == OK


def test_a_pose_that_came_back_is_not_missed_again(bench: Bench, later: Later) -> None:
    """The log forgets what it said when the node is configured anew; what was mended stays so."""
    step(bench, 1000.2)
    for t_s in (1001.1, 1001.2):  # a loss is told once it has lasted
        bench.tick(t_s)
        later(6.0)
        bench.report()
    lost = "no pose of the robot"
    assert sum(each.startswith(lost) for each in bench.warnings()) == 1
    step(bench, 1001.3)
    bench.report()
    assert bench.change_state("deactivate", "cleanup", "configure", "activate")
    bench.report()
    assert sum(each.startswith(lost) for each in bench.warnings()) == 1


def test_scans_that_stop_and_come_back(bench: Bench, later: Later) -> None:
    """It is said while they are away; then they are augmented as before."""
    scans = bench.listen("scan", "sensor_msgs/msg/LaserScan")
    assert bench.spawn(pose_at(2.5, 2.0), label="post").success
    for index in range(3):
        bench.send("tf", robot_at(1000.2 + 0.1 * index))
        bench.send("scan", scan(1000.2 + 0.1 * index))
        bench.tick(1000.2 + 0.1 * index)
    assert len(scans) == 3
    later(4.0)
    assert said(bench, "inputs/scan")[0] == STALE
    bench.send("tf", robot_at(1004.0))
    bench.send("scan", scan(1004.0))
    bench.tick(1004.1)
    assert said(bench, "inputs/scan")[0] == OK
    assert min(scans[-1].ranges) == pytest.approx(1.3, abs=0.01)


def test_scans_without_a_transform_are_said(bench: Bench) -> None:
    """They go on as they came, and the reason is given."""
    scans = bench.listen("scan", "sensor_msgs/msg/LaserScan")
    bench.send("scan", scan(1000.15, frame_id="roof_laser"))
    step(bench, 1000.3)
    assert [message.header.frame_id for message in scans] == ["roof_laser"]
    level, message = said(bench, "scans/scan")
    assert level == WARN
    assert message.startswith("1 scan without artefacts in the last 10 s: ")
    assert "'roof_laser'" in message


def test_a_cloud_that_waits_for_its_frame_is_said(bench: Bench) -> None:
    """Until the frame is known."""
    bench.send(CLOUD, cloud(wall_voxels(), frame_id="base_link"))
    bench.send(CLOUD, cloud(wall_voxels(), frame_id="tower"))
    step(bench, 1000.2)
    level, message = said(bench, "cloud")
    assert level == WARN
    assert message.endswith("nothing joins its frame 'tower' to the map")
    bench.send(CLOUD, cloud(wall_voxels()))
    step(bench, 1000.3)
    assert said(bench, "cloud") == (OK, "no cloud waits")


def test_ticks_that_stop_are_stale(bench: Bench, later: Later) -> None:
    """As when a recording is paused; but not while the node itself is."""
    assert said(bench, "ticks")[0] == OK
    later(2.0)
    level, message = said(bench, "ticks")
    assert level == STALE
    assert message.startswith("the last tick was 2.")
    bench.pause(is_paused=True)
    assert said(bench, "ticks")[0] == OK
    assert said(bench, "state") == (OK, "paused: the real map is relayed")
    bench.pause(is_paused=False)
    step(bench, 1000.2)
    assert said(bench, "ticks")[0] == OK


def test_a_crowd_that_finds_no_place_is_said(bench: Bench) -> None:
    """With what would help."""
    assert bench.set_together(population__max_alive=1, population__arrival_rate=2.0) == ""
    step(bench, 1000.9)
    assert bench.set(population__arrival_rate=0.0) == ""
    level, message = said(bench, "population")
    assert level == WARN
    assert "found no place: fewer (population.arrival_rate)" in message
    values = {pair.key: pair.value for pair in bench.report()["population"].values}
    assert values["alive"] == "1"
    assert int(values["blocked"]) > 3


def test_a_contact_with_the_robot_is_said_for_a_while(bench: Bench, later: Later) -> None:
    """With who it was and how deep; the artefact holds its place live."""
    lists = bench.listen("artefacts")
    spawned = bench.spawn(pose_at(1.6, 2.0), label="post")
    step(bench, 1000.2)
    step(bench, 1000.3, x=1.3)
    level, message = said(bench, "robot contact")
    assert level == WARN
    assert message.startswith(f"the robot has touched post {spawned.id}, 0.10 m deep, 0.")
    assert lists[-1].artefacts[0].ground_pose.position.x == pytest.approx(1.6)
    later(6.0)
    assert said(bench, "robot contact") == (OK, "1 contact")


def test_nothing_to_complain_of(bench: Bench) -> None:
    """With all inputs there every line is OK."""
    bench.listen("perceived")
    step(bench, 1000.2)
    levels: dict[str, Any] = {name: status.level for name, status in bench.report().items()}
    assert {name for name, level in levels.items() if level != OK} == set()
