"""What is real goes on, whatever state the node is in: maps and scans beside its own."""

from array import array
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from tests.ros import NOT_SET_UP

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from are_ros.conventions import NS_PER_S
from tests.node.live_bench import BEST_EFFORT, DELETE_ALL, Bench
from tests.node.live_scene import FACTORY, laser_mount, ns, pose_at, robot_at, room, scan

MakeBench = Callable[..., Bench]
SCAN = "sensor_msgs/msg/LaserScan"
BLOCK = (5, 9, 5, 9)


def lead(bench: Bench, phase: str) -> None:
    """Bring a configured node to a phase of its life in which nothing virtual goes out."""
    if phase in {"inactive", "active without clock"}:
        bench.change_state("activate") if phase.startswith("active") else None
        return
    bench.clock(1000.0)
    if phase == "inactive with clock":
        return
    bench.change_state("activate")
    bench.send("map", room())
    bench.send("tf", robot_at(1000.0))
    bench.tick(1000.1)
    assert bench.spawn(pose_at(2.05, 2.05), label="post").success
    if phase == "shut down at the tick":
        bench.change_state("shutdown")
        return
    bench.tick(1000.2)
    assert bench.pause(is_paused=True).success if phase == "paused" else bench.change_state(phase)


PHASES = (
    "inactive",
    "active without clock",
    "inactive with clock",
    "paused",
    "deactivate",
    "shutdown",
    "shut down at the tick",
)


@pytest.mark.parametrize("phase", PHASES)
def test_the_real_map_and_the_real_scans_go_on(make_bench: MakeBench, phase: str) -> None:
    """Each as it came, to the byte; on the artefact map of the same geometry there is nobody."""
    bench = make_bench({"costmap.gate": "all"}, "configure")
    lead(bench, phase)
    maps, scans = bench.listen("augmented_map"), bench.listen("scan", SCAN)
    artefacts = bench.listen("artefact_map")
    for blocks in ((), (BLOCK,)):
        real = room(*blocks, stamp_s=998.0)
        bench.send("map", real)
        bench.until(partial(is_last, maps, real))
        real.data = array("b", bytes(len(real.data)))
        bench.until(partial(is_last, artefacts, real))
    for t_s in (999.0, 999.1):
        real = scan(t_s)
        bench.send("scan", real)
        bench.until(partial(is_last, scans, real))
    assert len(scans) == 2


GRIDS = ("augmented_map", "artefact_map", "augmented_costmap")
UPDATES = ("augmented_map_updates", "artefact_map_updates")


def test_first_sight_goes_out_in_its_own_tick(make_bench: MakeBench) -> None:
    """And so does what goes; the artefact map is what the augmented map has beside the real one."""
    values = {"augmented_map.max_rate": 0.1, "costmap.gate": "perceived"}
    bench = make_bench(values, "configure", "activate")
    perceived = bench.listen("perceived")
    heard = {name: bench.listen(name) for name in (*GRIDS, *UPDATES)}
    bench.clock(1000.0)
    bench.send("map", room(BLOCK))
    bench.send("tf", robot_at(1000.0))
    bench.tick(1000.1)
    for turn, t_s in enumerate((1000.2, 1000.4), start=1):
        placed = bench.spawn(pose_at(3.0, 2.0), label="post")
        assert placed.success
        for at_s, is_seen in ((t_s, True), (t_s + 0.1, False)):
            if not is_seen:
                assert bench.call("remove", id=placed.id).success
            bench.send("tf", robot_at(at_s))
            bench.tick(at_s)
            bench.until(partial(is_of, perceived, at_s))
            assert [one.id for one in perceived[-1].artefacts] == ([placed.id] if is_seen else [])
            for messages in heard.values():
                bench.until(partial(is_of, messages, at_s))
            assert heard["artefact_map"][-1].data.tolist().count(100) == (25 if is_seen else 0)
            assert heard["augmented_costmap"][-1].data[20 * 40 + 30] == (100 if is_seen else 0)
            assert_difference(heard, room(BLOCK))
        assert [len(messages) for messages in heard.values()] == [
            *(3 * [1 + 2 * turn]),
            *(2 * [2 * turn]),
        ]


def is_of(messages: list[Any], t_s: float) -> bool:
    """Tell whether the last message is stamped with a time."""
    return bool(messages) and ns_of(messages[-1].header.stamp) == ns(t_s)


def ns_of(stamp: Any) -> int:
    """Return a stamp in nanoseconds."""
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)


def assert_difference(heard: dict[str, list[Any]], real: Any) -> None:
    """Check artefact map and augmented map against the real one, and so what updates make."""
    maps = {name: np.array(heard[name][-1].data).reshape(40, 40) for name in GRIDS[:2]}
    followed = {name: np.array(heard[name][0].data).reshape(40, 40) for name in GRIDS[:2]}
    for name, cells in followed.items():
        for update in heard[f"{name}_updates"]:
            rows = slice(update.y, update.y + update.height)
            part = np.array(update.data).reshape(update.height, update.width)
            cells[rows, update.x : update.x + update.width] = part
    walls = np.array(real.data).reshape(40, 40)
    for shown in (maps, followed):
        is_changed = shown["augmented_map"] != walls
        assert np.array_equal(100 * is_changed, shown["artefact_map"])


def is_last(messages: list[Any], real: Any) -> bool:
    """Tell whether the last message is the real one, as it is after it went over the wire."""
    wired = deserialize_message(serialize_message(real), type(real))
    return bool(messages) and messages[-1] == wired


@pytest.mark.parametrize("phase", ["paused", "deactivate", "shutdown", "shut down at the tick"])
def test_artefacts_vanish_when_the_node_rests(make_bench: MakeBench, phase: str) -> None:
    """From the maps, the lists and the markers; what is latched stays so for who comes later."""
    bench = make_bench({"costmap.gate": "all"}, "configure")
    outputs = ("augmented_map", "artefact_map", "artefacts", "markers")
    early = {name: bench.listen(name) for name in outputs}
    lead(bench, phase)
    bench.settle()
    late = bench.listen("augmented_map"), bench.listen("augmented_costmap")
    bench.until(lambda: all(late))
    if phase != "shut down at the tick":
        assert max(message.data.tolist().count(100) for message in early["augmented_map"]) == 181
        assert max(message.data.tolist().count(100) for message in early["artefact_map"]) == 25
    assert early["augmented_map"][-1].data == room().data
    assert not any(early["artefact_map"][-1].data)
    assert late[0][-1].data == room().data
    assert late[1][-1].data.tolist().count(100) == 4 * 39
    assert early["artefacts"][-1].artefacts == []
    assert [marker.action for marker in early["markers"][-1].markers] == [DELETE_ALL]


@pytest.mark.parametrize("transition", ["deactivate", "shutdown"])
def test_a_map_that_came_a_moment_before_is_the_last_one(
    make_bench: MakeBench, transition: str
) -> None:
    """Though no sub-step has seen it yet."""
    bench = make_bench({}, "configure", "activate")
    maps = bench.listen("augmented_map")
    bench.clock(1000.0)
    bench.send("map", room())
    bench.tick(1000.2)
    newest = room(BLOCK)
    bench.send("map", newest)
    assert bench.change_state(transition)
    bench.settle()
    assert maps[-1].data == newest.data


def test_a_map_while_paused_is_there_when_it_goes_on(make_bench: MakeBench) -> None:
    """The artefacts come back into the new map."""
    bench = make_bench({"costmap.gate": "all"}, "configure")
    maps = bench.listen("augmented_map")
    lead(bench, "paused")
    newest = room(BLOCK)
    bench.send("map", newest)
    assert bench.pause(is_paused=False).success
    bench.tick(1000.4)
    assert maps[-1].data.tolist().count(100) == 4 * 39 + 4 * 4 + 5 * 5


@pytest.mark.parametrize(
    ("phase", "fault"),
    [
        ("inactive", "size"),
        ("inactive", "frame"),
        ("active without clock", "foreign frame"),
        ("active without clock", "resolution"),
        ("paused", "bytes"),
    ],
)
def test_a_malformed_map_is_not_relayed(make_bench: MakeBench, phase: str, fault: str) -> None:
    """The last good one stays in force, and the next good one comes."""
    bench = make_bench({}, "configure")
    lead(bench, phase)
    maps = bench.listen("augmented_map")
    bench.send("map", room())
    bench.send("map", malformed(fault))
    bench.settle()
    assert {message.data.tobytes() for message in maps} == {room().data.tobytes()}
    bench.send("map", room(BLOCK))
    bench.until(lambda: maps[-1].data == room(BLOCK).data)


def malformed(fault: str) -> Any:
    """Return a map with a fault."""
    message = room(BLOCK, frame_id={"frame": "", "foreign frame": "odom"}.get(fault, "map"))
    if fault == "size":
        message.info.width += 1
    if fault == "resolution":
        message.info.resolution = float("nan")
    return serialize_message(message)[:-100] if fault == "bytes" else message


def test_scans_that_waited_leave_before_the_node_rests(make_bench: MakeBench) -> None:
    """None comes after a later one, and none with artefacts after the pause."""
    bench = make_bench({"sensors.tf_wait": 2.0}, "configure", "activate")
    scans, maps = bench.listen("scan", SCAN), bench.listen("augmented_map")
    bench.send("map", room())
    bench.send("tf_static", laser_mount())
    bench.clock(1000.0)
    bench.send("tf", robot_at(1000.0))
    bench.send("scan", scan(1000.2))
    bench.tick(1000.1)
    bench.settle()
    assert scans == [], "its transform is not there yet"
    assert bench.pause(is_paused=True).success
    bench.send("scan", scan(1000.3))
    bench.send("tf", robot_at(1000.4))
    bench.clock(1002.0)
    bench.node._report()
    bench.settle()
    stamps = [message.header.stamp.nanosec for message in scans]
    assert stamps == [ns(0.2), ns(0.3)]
    assert maps


def test_the_robots_own_topics_are_left_alone(make_bench: MakeBench) -> None:
    """The node publishes under its own name, and the standard topics of every node."""
    bench = make_bench({"costmap.gate": "all"}, "configure")
    kinds = {"map": "nav_msgs/msg/OccupancyGrid", "scan": SCAN, "tf": "tf2_msgs/msg/TFMessage"}
    heard: dict[str, list[Any]] = {name: [] for name in kinds}
    for name, kind in kinds.items():
        message = type(FACTORY.make(kind))
        bench.user.create_subscription(message, f"/{name}", heard[name].append, BEST_EFFORT)
    lead(bench, "paused")
    assert bench.pause(is_paused=False).success
    bench.send("scan", scan(1000.2))
    bench.tick(1000.5)
    bench.until(lambda: "/diagnostics" in offered_by(bench.node))
    others = {name for name in offered_by(bench.node) if not name.startswith("/ar_builder/")}
    assert others == {"/diagnostics", "/rosout", "/parameter_events"}
    assert [len(messages) for messages in heard.values()] == [1, 1, 1], "what the user sent"


def offered_by(node: Any) -> set[str]:
    """Return the topics that DDS knows the node to publish."""
    return {
        topic
        for topic, _ in node.get_topic_names_and_types()
        for info in node.get_publishers_info_by_topic(topic)
        if info.node_name == "ar_builder"
    }
