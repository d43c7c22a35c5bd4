"""Playing recordings to live topics, over real DDS."""

import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from are_ros.bag.types import jazzy_typestore
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError, NodeError
from bags.simulation.making import RosbagsFactory
from tests.record.player_runs import (
    LISTENER,
    START_NS,
    STRING,
    at_ns,
    clock_values,
    collect_clock,
    listen,
    played,
    playing,
    profile,
    texts,
    wait_for_text,
    write_messages,
    write_strings,
)
from tests.ros import WAIT_S, RosWorld, nap, running_s, undisturbed, wait_until

FAST = {"rate": 20.0, "wait_for": (LISTENER,)}
GRID_NS = 20_000_000
NEVER_S = 1000.0
"""What is recorded so late keeps a player from coming to its end before the test."""


@pytest.fixture
def words(tmp_path: Path) -> Path:
    """Return a recording of two topics, a second long."""
    records = [(topic, at / 20, f"{topic}{at}") for at in range(21) for topic in ("/a", "/b")]
    return write_strings(tmp_path / "words.mcap", records)


def test_messages_come_as_they_were_recorded(ros: RosWorld, words: Path) -> None:
    """All of them, in their order; the outcome counts them, and the progress goes to the end."""
    heard = listen(ros, ("/a", "/b"))
    with ros.spinning():
        run = played(words, **FAST)
        ros.spin_until(lambda: len(heard) == 42)
    for topic in ("/a", "/b"):
        assert texts(heard, topic) == [f"{topic}{at}" for at in range(21)]
    assert run.outcome.counts == {"/a": 21, "/b": 21}
    assert (run.outcome.skipped, run.outcome.passes, run.outcome.is_complete) == ({}, 1, True)
    assert run.windows_ns == [(START_NS, at_ns(1.0) + 1)]
    assert run.reached_ns == sorted(run.reached_ns)
    assert run.reached_ns[-1] == at_ns(1.0) + 1


def test_bytes_are_handed_on(ros: RosWorld, tmp_path: Path) -> None:
    """What a subscriber deserialises is what was recorded, of a message with nested parts."""
    from nav_msgs.msg import OccupancyGrid

    factory = RosbagsFactory()
    info = factory.make("nav_msgs/msg/MapMetaData", width=3, height=1, resolution=0.5)
    header = factory.make("std_msgs/msg/Header", frame_id="map")
    grid = factory.make(
        "nav_msgs/msg/OccupancyGrid",
        header=header,
        info=info,
        data=np.array([-1, 0, 100], np.int8),
    )
    bag = write_messages(tmp_path / "map.mcap", [("/map", 0.0, grid)], latched=["/map"])
    maps = ros.collect(ros.make_node("listener"), OccupancyGrid, "/map", profile(is_latched=True))
    with ros.spinning():
        played(bag, **FAST)
        ros.spin_until(lambda: maps)
    (received,) = maps
    assert list(received.data) == [-1, 0, 100]
    assert (received.header.frame_id, received.info.width) == ("map", 3)
    assert received.info.resolution == 0.5


def test_quality_of_service_is_as_recorded(ros: RosWorld, tmp_path: Path) -> None:
    """Best effort stays best effort, latched stays latched; the rest is reliable and volatile."""
    topics = ("/fast", "/kept", "/plain")
    records = [(topic, at_s, "x") for at_s in (0.0, NEVER_S) for topic in topics]
    bag = write_strings(tmp_path / "qos.mcap", records, latched=["/kept"], best_effort=["/fast"])
    node = ros.make_node("listener")
    with playing(bag), ros.spinning():
        ros.spin_until(lambda: all(offers(node, topic) for topic in topics))
        found = {topic: offers(node, topic) for topic in topics}
    assert found == {
        "/fast": [("BEST_EFFORT", "VOLATILE")],
        "/kept": [("RELIABLE", "TRANSIENT_LOCAL")],
        "/plain": [("RELIABLE", "VOLATILE")],
    }


@pytest.mark.parametrize("is_best_effort", [False, True])
def test_maps_and_static_transforms_are_latched_however_they_were_recorded(
    ros: RosWorld, tmp_path: Path, *, is_best_effort: bool
) -> None:
    """As in a recording without quality of service, or a ROS 1 one that was filtered."""
    factory = RosbagsFactory()
    grid = factory.make("nav_msgs/msg/OccupancyGrid", data=np.array([0], np.int8))
    statics = ("/tf_static", "/robot/tf_static")
    records = [("/map", 0.0, grid), ("/a", NEVER_S, factory.make(STRING, data="x"))]
    records += [(topic, 0.0, transforms(factory, "lidar")) for topic in statics]
    topics = ("/map", *statics)
    best_effort = topics if is_best_effort else ()
    bag = write_messages(tmp_path / "bag.mcap", records, best_effort=best_effort)
    node = ros.make_node("listener")
    with playing(bag), ros.spinning():
        ros.spin_until(lambda: all(offers(node, topic) for topic in topics))
        found = [offers(node, topic) for topic in topics]
    assert found == [[("RELIABLE", "TRANSIENT_LOCAL")]] * len(topics)


def offers(node: Any, topic: str) -> list[tuple[str, str]]:
    """Return reliability and durability of those who publish a topic."""
    infos = node.get_publishers_info_by_topic(topic)
    return [(one.qos_profile.reliability.name, one.qos_profile.durability.name) for one in infos]


def test_who_comes_late_gets_what_was_latched(ros: RosWorld, tmp_path: Path) -> None:
    """The last map, though it was sent before; of a topic that is not latched, nothing."""
    records = [
        ("/map", 0.0, "old"),
        ("/map", 0.05, "new"),
        ("/a", 0.1, "gone"),
        ("/a", NEVER_S, "x"),
    ]
    bag = write_strings(tmp_path / "late.mcap", records, latched=["/map"])
    early = listen(ros, ("/a",))
    with playing(bag, wait_for=(LISTENER,)), ros.spinning():
        wait_for_text(early, "gone")
        late = listen(ros, ("/map", "/a"), qos=profile(is_latched=True), name="late")
        wait_for_text(late, "new")
        ros.spin_for(0.1)
    assert texts(late, "/map") == ["new"]
    assert texts(late, "/a") == []


def test_who_comes_late_gets_all_static_transforms(ros: RosWorld, tmp_path: Path) -> None:
    """Each message adds frames to those before it."""
    from tf2_msgs.msg import TFMessage

    factory = RosbagsFactory()
    records = [(0.0, "lidar"), (0.05, "camera"), (NEVER_S, "never")]
    messages = [("/tf_static", at_s, transforms(factory, child)) for at_s, child in records]
    bag = write_messages(tmp_path / "static.mcap", messages, latched=["/tf_static"])
    qos = profile(is_latched=True, depth=100)
    early = ros.collect(ros.make_node("listener"), TFMessage, "/tf_static", qos)
    with playing(bag, wait_for=(LISTENER,)), ros.spinning():
        ros.spin_until(lambda: len(early) == 2)
        late = ros.collect(ros.make_node("late"), TFMessage, "/tf_static", qos)
        ros.spin_until(lambda: len(late) == 2)
    assert [one.transforms[0].child_frame_id for one in late] == ["lidar", "camera"]


def test_a_recording_is_played_at_its_rate(ros: RosWorld, tmp_path: Path) -> None:
    """A second takes half of one at twice the rate, by the wall clock."""
    bag = write_strings(tmp_path / "rate.mcap", [("/a", 0.0, "first"), ("/a", 1.0, "last")])
    heard = listen(ros, ("/a",))

    def taken_s() -> float:
        heard.clear()
        with ros.spinning(), playing(bag, rate=2.0, wait_for=(LISTENER,)):
            wait_for_text(heard, "first")
            begun_s = time.monotonic()
            wait_for_text(heard, "last")
            return time.monotonic() - begun_s

    assert 0.4 < undisturbed(taken_s) < 1.0


def test_the_clock_goes_by_its_grid(ros: RosWorld, words: Path) -> None:
    """First the start, then multiples of the period since the epoch, last the end."""
    values = collect_clock(ros)
    listen(ros, ("/a",))
    with ros.spinning():
        played(words, clock_hz=50.0, **FAST)
        ros.spin_until(lambda: values and values[-1] > at_ns(1.0))
    assert values == clock_values(START_NS, at_ns(1.0) + 1, GRID_NS)


def test_a_slice_is_played(ros: RosWorld, words: Path) -> None:
    """From --start for --duration, and the clock with it."""
    values = collect_clock(ros)
    heard = listen(ros, ("/a",))
    with ros.spinning():
        played(words, start_s=0.2, duration_s=0.15, clock_hz=50.0, **FAST)
        ros.spin_until(lambda: values[-1:] == [at_ns(0.35)] and len(heard) == 3)
    assert texts(heard, "/a") == ["/a4", "/a5", "/a6"]
    assert values == clock_values(at_ns(0.2), at_ns(0.35), GRID_NS)


def test_the_start_counts_from_where_a_replay_begins(ros: RosWorld, tmp_path: Path) -> None:
    """A map from an hour before is sent first, and the seconds count from what moves."""
    factory = RosbagsFactory()
    records = [("/map", 0.0, factory.make(STRING, data="map"))]
    records += [("/tf", 3600.0 + at / 10, transforms(factory, f"at{at}")) for at in range(11)]
    bag = write_messages(tmp_path / "start.mcap", records, latched=["/map"])
    values = collect_clock(ros)
    heard = listen(ros, ("/map",))
    with ros.spinning():
        run = played(bag, start_s=0.5, clock_hz=50.0, **FAST)
        ros.spin_until(lambda: bool(heard) and len(values) > 1)
    assert texts(heard, "/map") == ["map"]
    assert values[0] == at_ns(3600.5)
    assert "nothing moves in the first 60.0 min: the player begins after them" in run.sentences


def test_without_a_clock_messages_come_all_the_same(ros: RosWorld, words: Path) -> None:
    """`clock_hz` of 0 leaves /clock to somebody else."""
    values = collect_clock(ros)
    heard = listen(ros, ("/a",))
    with ros.spinning():
        played(words, clock_hz=0.0, **FAST)
        ros.spin_until(lambda: len(heard) == 21)
    assert values == []


def test_a_loop_jumps_back(ros: RosWorld, tmp_path: Path) -> None:
    """Again from the start: the clock jumps back, and what was latched is sent again."""
    records = [("/map", 0.0, "map"), ("/a", 0.1, "one"), ("/a", 0.3, "two")]
    bag = write_strings(tmp_path / "loop.mcap", records, latched=["/map"])
    values = collect_clock(ros)
    heard = listen(ros, ("/map", "/a"))
    with ros.spinning(), playing(bag, loop=True, **FAST) as run:
        ros.spin_until(lambda: min(len(texts(heard, "/map")), values.count(START_NS)) >= 3)
    assert texts(heard, "/a")[:4] == ["one", "two", "one", "two"]
    passes = values.count(START_NS)
    assert passes >= 3
    once = clock_values(START_NS, at_ns(0.3) + 1, 10_000_000)
    assert values[: 2 * len(once)] == [*once, *once]
    assert not run.outcome.is_complete
    assert run.outcome.passes >= 2


def test_what_was_there_before_the_start_is_sent_first(ros: RosWorld, tmp_path: Path) -> None:
    """Static transforms and maps from any time, transforms of ten seconds, other things not."""
    from tf2_msgs.msg import TFMessage

    factory = RosbagsFactory()
    records = [
        ("/tf_static", 0.0, transforms(factory, "lidar")),
        ("/map", 1.0, factory.make(STRING, data="map")),
        ("/tf", 2.0, transforms(factory, "long_ago")),
        ("/tf", 28.0, transforms(factory, "recent")),
        ("/a", 29.0, factory.make(STRING, data="earlier")),
        ("/a", 30.1, factory.make(STRING, data="later")),
        ("/tf", 30.2, transforms(factory, "now")),
    ]
    latched = ["/tf_static", "/map"]
    bag = write_messages(tmp_path / "start.mcap", records, latched=latched)
    heard = listen(ros, ("/map", "/a"))
    node = ros.make_node("tf_listener")
    moving = ros.collect(node, TFMessage, "/tf", 100)
    static = ros.collect(node, TFMessage, "/tf_static", profile(is_latched=True, depth=100))
    with ros.spinning():
        played(bag, start_s=30.0, **FAST)
        ros.spin_until(lambda: len(moving) == 2 and static and len(heard) == 2)
    assert [one.transforms[0].child_frame_id for one in moving] == ["recent", "now"]
    assert [one.transforms[0].child_frame_id for one in static] == ["lidar"]
    assert texts(heard, "/map") == ["map"]
    assert texts(heard, "/a") == ["later"]


def transforms(factory: RosbagsFactory, child: str) -> Any:
    """Return a TFMessage with one transform to a frame."""
    one = factory.make("geometry_msgs/msg/TransformStamped", child_frame_id=child)
    return factory.make("tf2_msgs/msg/TFMessage", transforms=[one])


def test_topics_are_chosen_left_out_and_renamed(ros: RosWorld, tmp_path: Path) -> None:
    """Names are as recorded, with or without the first slash."""
    records = [(topic, 0.1, topic) for topic in ("/a", "/b", "/c")]
    bag = write_strings(tmp_path / "three.mcap", records)
    heard = listen(ros, ("/a", "/b", "/c", "/elsewhere"))
    with ros.spinning():
        run = played(bag, topics=("/a", "b"), exclude=("/b",), remaps={"a": "/elsewhere"}, **FAST)
        ros.spin_until(lambda: heard)
        ros.spin_for(0.05)
    assert [(one.topic, one.text) for one in heard] == [("/elsewhere", "/a")]
    assert run.outcome.counts == {"/a": 1}


def test_types_that_are_not_installed_are_skipped(ros: RosWorld, tmp_path: Path) -> None:
    """A sentence names package and topic; the rest is played."""
    records = [("/odd", 0.0, "x"), ("/a", 0.1, "known")]
    bag = write_strings(tmp_path / "unknown.mcap", records, unknown=["/odd"])
    heard = listen(ros, ("/a",))
    with ros.spinning():
        run = played(bag, **FAST)
        ros.spin_until(lambda: heard)
    (sentence,) = run.sentences
    assert "/odd" in sentence
    assert "nowhere_msgs" in sentence
    assert run.outcome.skipped.keys() == {"/odd"}
    assert run.outcome.counts == {"/a": 1}


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_messages_that_are_not_cdr_are_skipped(
    ros: RosWorld, tmp_path: Path, plugin: StoragePlugin
) -> None:
    """DDS would take the bytes as they are. A /clock that is not sent so is missed, too."""
    store = jazzy_typestore()
    kinds = {"/a": (STRING, "cdr"), "/clock": ("rosgraph_msgs/msg/Clock", "json")}
    word = bytes(store.serialize_cdr(RosbagsFactory().make(STRING, data="word"), STRING))
    with Ros2Writer(tmp_path / "bag", version=9, storage_plugin=plugin) as writer:
        for topic, (kind, encoding) in kinds.items():
            connection = writer.add_connection(
                topic, kind, typestore=store, serialization_format=encoding
            )
            writer.write(connection, START_NS, word if encoding == "cdr" else b"{}")
    (file,) = (path for path in (tmp_path / "bag").iterdir() if path.suffix != ".yaml")
    heard = listen(ros, ("/a",))
    with ros.spinning():
        run = played(file, clock_hz=0.0, **FAST)
        ros.spin_until(lambda: heard)
    assert run.sentences == ["/clock is not played: its messages are encoded as json, not as CDR"]
    assert run.outcome.counts == {"/a": 1}
    assert not run.outcome.is_whole


def test_names_that_ros2_does_not_allow_are_skipped(ros: RosWorld, tmp_path: Path) -> None:
    """ROS 1 and other tools allow more; --remap, which the sentence names, helps."""
    bag = write_strings(tmp_path / "names.mcap", [("/camera-1", 0.0, "x"), ("/a", 0.1, "y")])
    heard = listen(ros, ("/a", "/camera_1"))
    with ros.spinning():
        run = played(bag, **FAST)
        again = played(bag, remaps={"/camera-1": "/camera_1"}, **FAST)
        ros.spin_until(lambda: len(heard) == 3)
    (sentence,) = run.sentences
    assert "/camera-1" in sentence
    assert "--remap" in sentence
    assert run.outcome.counts == {"/a": 1}
    assert again.outcome.counts == {"/a": 1, "/camera-1": 1}


def test_a_topic_of_two_types_is_played_with_the_first(ros: RosWorld, tmp_path: Path) -> None:
    """DDS allows one; the other is said, and its messages are left out."""
    from std_msgs.msg import Int32

    store = jazzy_typestore()
    factory = RosbagsFactory()
    words = factory.make(STRING, data="word")
    number = factory.make("std_msgs/msg/Int32", data=7)
    with Ros2Writer(tmp_path / "two", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for at_s, message in ((0.0, number), (0.1, words)):
            name = message.__msgtype__
            connection = writer.add_connection("/a", name, typestore=store)
            writer.write(connection, at_ns(at_s), store.serialize_cdr(message, name))
    numbers = ros.collect(ros.make_node("listener"), Int32, "/a")
    with ros.spinning():
        run = played(tmp_path / "two", **FAST)
        ros.spin_until(lambda: numbers)
    assert any("std_msgs/msg/String" in sentence for sentence in run.sentences)
    assert [one.data for one in numbers] == [7]
    assert run.outcome.counts == {"/a": 1}


def test_a_recorded_clock_gives_way(ros: RosWorld, tmp_path: Path) -> None:
    """Two clocks would contradict each other: the player's own is the one, and that is said."""
    bag = bag_with_clock(tmp_path)
    values = collect_clock(ros)
    listen(ros, ("/a",))
    with ros.spinning():
        run = played(bag, clock_hz=50.0, **FAST)
        ros.spin_until(lambda: values and values[-1] > at_ns(0.2))
    assert values == clock_values(START_NS, at_ns(0.2) + 1, GRID_NS)
    assert any("/clock" in sentence for sentence in run.sentences)
    assert run.outcome.skipped.keys() == {"/clock"}
    assert run.outcome.is_whole


def test_outputs_of_a_node_are_played_and_named(ros: RosWorld, tmp_path: Path) -> None:
    """They are a topic like any other, but come twice where a node sends its own."""
    records = [("/a", 0.0, "x"), ("/one/ar_builder/events", 0.1, "y")]
    bag = write_strings(tmp_path / "bag.mcap", records)
    heard = listen(ros, ("/a", "/one/ar_builder/events"))
    with ros.spinning():
        run = played(bag, **FAST)
        alone = played(bag, exclude=("/one/ar_builder/events",), **FAST)
        ros.spin_until(lambda: bool(heard))
    (sentence,) = [one for one in run.sentences if "ar_builder" in one]
    assert sentence.startswith("the recording holds 1 output topic of ar_builder, played too: ")
    assert not [one for one in alone.sentences if "ar_builder" in one]


def test_a_recorded_clock_is_played_where_there_is_no_other(ros: RosWorld, tmp_path: Path) -> None:
    """With `clock_hz` of 0 it is a topic like any other."""
    bag = bag_with_clock(tmp_path)
    values = collect_clock(ros)
    listen(ros, ("/a",))
    with ros.spinning():
        run = played(bag, clock_hz=0.0, **FAST)
        ros.spin_until(lambda: len(values) == 3)
    assert values == [at_ns(0.0), at_ns(0.1), at_ns(0.2)]
    assert run.outcome.skipped == {}


def bag_with_clock(folder: Path) -> Path:
    """Write a recording that holds /clock, equal to its log times."""
    factory = RosbagsFactory()
    records: list[tuple[str, float, Any]] = [("/a", 0.0, factory.make(STRING, data="a"))]
    for at_s in (0.0, 0.1, 0.2):
        seconds, nanoseconds = divmod(at_ns(at_s), NS_PER_S)
        time_ = factory.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        records.append(("/clock", at_s, factory.make("rosgraph_msgs/msg/Clock", clock=time_)))
    return write_messages(folder / "clock.mcap", records)


def test_a_recording_of_ros1_plays_as_ros2(ros: RosWorld, tmp_path: Path) -> None:
    """Messages are converted, and what was latched there is transient local here."""
    from geometry_msgs.msg import PointStamped

    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=7, nanosec=8)
    header = types["std_msgs/msg/Header"](seq=3, stamp=stamp, frame_id="map")
    point = types["geometry_msgs/msg/PointStamped"](
        header=header, point=types["geometry_msgs/msg/Point"](x=1.0, y=2.0, z=3.0)
    )
    bag = tmp_path / "old.bag"
    with Ros1Writer(bag) as writer:
        name = "geometry_msgs/msg/PointStamped"
        connection = writer.add_connection("/goal", name, typestore=store, latching=1)
        for stamp_ns in (START_NS, at_ns(NEVER_S)):
            writer.write(connection, stamp_ns, bytes(store.serialize_ros1(point, name)))
    node = ros.make_node("listener")
    points = ros.collect(node, PointStamped, "/goal", profile(is_latched=True))
    with ros.spinning(), playing(bag, wait_for=(LISTENER,)):
        ros.spin_until(lambda: points)
        assert offers(node, "/goal") == [("RELIABLE", "TRANSIENT_LOCAL")]
    assert (points[0].header.frame_id, points[0].header.stamp.sec) == ("map", 7)
    assert (points[0].point.x, points[0].point.y, points[0].point.z) == (1.0, 2.0, 3.0)


def test_messages_of_ros1_that_cannot_be_converted_are_told(ros: RosWorld, tmp_path: Path) -> None:
    """How many, and why the first; the others are played."""
    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    with Ros1Writer(tmp_path / "old.bag") as writer:
        connection = writer.add_connection("/a", STRING, typestore=store)
        good = bytes(store.serialize_ros1(types[STRING](data="x"), STRING))
        for k, data in enumerate((b"\xff\xff\xff\x7f", good, b"\x05")):
            writer.write(connection, at_ns(0.1 * k), data)
    heard = listen(ros, ("/a",))
    with ros.spinning():
        run = played(tmp_path / "old.bag", **FAST)
        ros.spin_until(lambda: bool(heard))
    assert run.outcome.counts == {"/a": 1}
    assert not run.outcome.is_whole
    (sentence,) = run.sentences
    assert sentence.startswith(f"/a: 2 messages left out, the first: the message at {START_NS} ns")


def test_it_stops_in_the_middle(ros: RosWorld, tmp_path: Path) -> None:
    """Soon, in good order, and the outcome says that it did not come to the end."""
    records = [("/a", 0.0, "first"), ("/a", 100.0, "last")]
    bag = write_strings(tmp_path / "long.mcap", records)
    heard = listen(ros, ("/a",))
    with ros.spinning(), playing(bag, wait_for=(LISTENER,)) as run:
        wait_for_text(heard, "first")
        run.stop.set()
        begun_s = running_s()
        assert run.ended.wait(WAIT_S)
        taken_s = running_s() - begun_s
    assert taken_s < 1.0
    assert run.outcome.counts == {"/a": 1}
    assert not run.outcome.is_complete


def test_it_stops_while_it_waits_for_a_node(ros_available: None, words: Path) -> None:
    """Nobody is there, and somebody pressed Ctrl-C: nothing is played."""
    del ros_available
    with playing(words, wait_for=("/nobody",)) as run:
        time.sleep(0.3)
    assert not run.outcome.is_complete
    assert run.outcome.counts == {"/a": 0, "/b": 0}


def test_it_waits_for_a_node(ros: RosWorld, words: Path) -> None:
    """A node that comes late gets the very first message."""
    with ros.spinning(), playing(words, rate=20.0, wait_for=(LISTENER,)):
        time.sleep(0.5)
        heard = listen(ros, ("/a",))
        wait_for_text(heard, "/a20")
    assert texts(heard, "/a") == [f"/a{at}" for at in range(21)]


def test_a_node_that_does_not_come_is_named(ros_available: None, words: Path) -> None:
    """After the time it was given, in a sentence."""
    del ros_available
    with pytest.raises(NodeError, match="/nobody") as caught:
        played(words, wait_for=("/nobody",), wait_s=0.2)
    assert "\n" not in str(caught.value)


def test_who_waits_for_long_is_told_what_for(
    ros_available: None, words: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Again and again, and for how long."""
    del ros_available
    from are_ros.record import publishers as subscribers

    monkeypatch.setattr(subscribers, "_SILENT_S", 0.3)
    monkeypatch.setattr(subscribers, "_SAY_EVERY_S", 0.3)
    with playing(words, wait_for=("/nobody",)) as run:
        wait_until(lambda: len(run.sentences) > 1, nap)
    first, second = run.sentences[:2]
    assert first.startswith("waiting for /nobody to listen: no node has this name yet; there is ")
    assert second.startswith("still waiting for /nobody after ")
    assert "; it is given 600 s: no node has this name yet" in second


def test_a_misspelt_node_is_told_from_one_that_is_slow(
    ros: RosWorld, words: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The nodes that there are tell: the name that was meant, or that it only has to begin."""
    from are_ros.record import publishers as subscribers

    monkeypatch.setattr(subscribers, "_SILENT_S", 0.3)
    monkeypatch.setattr(subscribers, "_SAY_EVERY_S", 0.3)
    listen(ros, ("/nothing_that_is_played",))
    for name, ends in (("/listner", "did you mean /listener?"), (LISTENER, "a minute or two)")):
        with ros.spinning(), playing(words, wait_for=(name,)) as run:
            wait_until(partial(ends_with, run.sentences, ends), nap)


def ends_with(sentences: list[str], text: str) -> bool:
    """Tell whether the last sentence ends with a text."""
    return bool(sentences) and sentences[-1].endswith(text)


def test_falling_behind_is_said(ros: RosWorld, words: Path) -> None:
    """By how much; and nothing is left out."""
    heard = listen(ros, ("/a",))
    with ros.spinning(), playing(words, rate=2.0, wait_for=(LISTENER,)) as run:
        run.reached_ns = SlowList()
        assert run.ended.wait(WAIT_S)
        ros.spin_until(lambda: len(heard) == 21)
    assert any("behind" in sentence for sentence in run.sentences)


class SlowList(list[int]):
    """A list into which things go slowly, as a terminal that hangs."""

    def append(self, value: int) -> None:
        """Append a value, the first after half a second."""
        if not self:
            time.sleep(0.5)
        super().append(value)


def test_nothing_left_to_play_is_an_error(ros_available: None, words: Path) -> None:
    """A start after the end, and a choice that leaves no topic."""
    del ros_available
    with pytest.raises(BagError, match=r"1\.0 s long"):
        played(words, start_s=5.0)
    with pytest.raises(BagError, match="nothing"):
        played(words, exclude=("/a", "/b"))


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"topics": ("/a", "/scann")}, "--topics /scann"),
        ({"exclude": ("/scann",)}, "--exclude /scann"),
        ({"remaps": {"/scann": "/scan"}}, "--remap /scann"),
    ],
)
def test_topics_that_were_not_recorded_are_refused(
    ros_available: None, words: Path, options: dict[str, Any], named: str
) -> None:
    """A slip of the pen is found, and the sentence lists what there is."""
    del ros_available
    with pytest.raises(BagError, match=f"{named}.*/a, /b"):
        played(words, **options)


def test_a_short_queue_gets_what_was_before_the_start(ros: RosWorld, tmp_path: Path) -> None:
    """Ten seconds of transforms do not come all at once."""
    from tf2_msgs.msg import TFMessage

    factory = RosbagsFactory()
    records = [("/tf", at / 50, transforms(factory, f"frame{at}")) for at in range(401)]
    bag = write_messages(tmp_path / "many.mcap", records)
    moving = ros.collect(ros.make_node("listener"), TFMessage, "/tf", 100)
    with ros.spinning():
        played(bag, start_s=8.0, **FAST)
        ros.spin_until(lambda: len(moving) == 401)
    assert [one.transforms[0].child_frame_id for one in moving] == [
        f"frame{at}" for at in range(401)
    ]


@pytest.mark.parametrize(
    ("options", "words_of_it"),
    [
        ({"rate": 0.0}, "--rate"),
        ({"rate": float("nan")}, "--rate"),
        ({"rate": float("inf")}, "--rate"),
        ({"clock_hz": -1.0}, "--clock"),
        ({"clock_hz": float("nan")}, "--clock"),
        ({"clock_hz": 0.0, "lockstep": ("/node",)}, "--lockstep"),
    ],
)
def test_options_that_make_no_sense_are_refused(options: dict[str, Any], words_of_it: str) -> None:
    """One sentence each, which names the option."""
    from are_ros.record.publishers import PlayOptions

    with pytest.raises(BagError, match=words_of_it) as caught:
        PlayOptions((Path("bag"),), **options)
    assert "\n" not in str(caught.value)
