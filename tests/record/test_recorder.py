"""Recording live topics, over real DDS."""

import time
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader as Ros2Reader

from are_ros.bag.reader import BagReader
from are_ros.bag.types import jazzy_typestore
from are_ros.bag.writer import BagWriter
from are_ros.errors import BagError, NodeError
from bags.simulation.making import RosbagsFactory
from tests.record.recorder_runs import recorded, recorded_data, recording
from tests.ros import RosWorld, nap, running_s, wait_until

TYPES = (
    "are_msgs/msg/ArtefactArray",
    "are_msgs/msg/ArtefactEvent",
    "are_msgs/msg/PerceivedArtefactArray",
    "are_msgs/msg/SceneMetrics",
    "diagnostic_msgs/msg/DiagnosticArray",
    "geometry_msgs/msg/PointStamped",
    "map_msgs/msg/OccupancyGridUpdate",
    "nav_msgs/msg/OccupancyGrid",
    "nav_msgs/msg/Odometry",
    "nav_msgs/msg/Path",
    "rosgraph_msgs/msg/Clock",
    "sensor_msgs/msg/CameraInfo",
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/Imu",
    "sensor_msgs/msg/LaserScan",
    "sensor_msgs/msg/PointCloud2",
    "tf2_msgs/msg/TFMessage",
    "visualization_msgs/msg/MarkerArray",
)


def qos(*, is_reliable: bool = True, is_latched: bool = False, depth: int = 10) -> Any:
    """Return a publisher's profile."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    reliability, durability = ReliabilityPolicy, DurabilityPolicy
    return QoSProfile(
        depth=depth,
        reliability=reliability.RELIABLE if is_reliable else reliability.BEST_EFFORT,
        durability=durability.TRANSIENT_LOCAL if is_latched else durability.VOLATILE,
    )


def string(text: str) -> Any:
    """Return a std_msgs/String."""
    from std_msgs.msg import String

    return String(data=text)


def cdr(text: str) -> bytes:
    """Return the bytes of a std_msgs/String."""
    from rclpy.serialization import serialize_message

    return bytes(serialize_message(string(text)))


def string_publisher(node: Any, topic: str, profile: Any) -> Any:
    """Return a publisher of strings."""
    from std_msgs.msg import String

    return node.create_publisher(String, topic, profile)


def clock_publisher(node: Any) -> Any:
    """Return a publisher of /clock, and a function that publishes seconds on it."""
    from rosgraph_msgs.msg import Clock

    publisher = node.create_publisher(Clock, "/clock", qos())

    def publish(time_s: float) -> None:
        message = Clock()
        message.clock.sec = int(time_s)
        message.clock.nanosec = round((time_s - int(time_s)) * 1e9)
        publisher.publish(message)

    return publisher, publish


def silent(_: str) -> None:
    """Take a sentence that the test does not look at."""


def wait_for(is_done: Any) -> None:
    """Wait until something is so; the test fails when it is not in time."""
    wait_until(is_done, nap)


def deliver(publisher: Any) -> None:
    """Wait until the recorder has all that a reliable publisher sent or latched."""
    wait_for(lambda: publisher.get_subscription_count() > 0)
    publisher.wait_for_all_acked()


def test_every_type_comes_back_byte_for_byte(ros: RosWorld, tmp_path: Path) -> None:
    """The types of a robot and of ARE, in one recording that our reader deserialises."""
    from are_ros.node.message_classes import message_class

    factory, store, node = RosbagsFactory(), jazzy_typestore(), ros.make_node()
    sent, publishers = {}, []
    for type_name in TYPES:
        topic = f"/{type_name.rpartition('/')[2]}"
        sent[topic] = bytes(store.serialize_cdr(factory.make(type_name), type_name))
        publishers.append((node.create_publisher(message_class(type_name), topic, 10), sent[topic]))
    with recording(tmp_path / "all.mcap", *sent):
        for publisher, data in publishers:
            wait_for(lambda publisher=publisher: publisher.get_subscription_count() == 1)
            publisher.publish(data)
            deliver(publisher)
    with BagReader([tmp_path / "all.mcap"]) as reader:
        messages = {message.topic: message for message in reader.messages()}
        types = {topic.name: topic.type_name for topic in reader.topics}
        for topic, data in sent.items():
            assert bytes(messages[topic].data) == data
            assert types[topic] in TYPES
            reader.deserialize(messages[topic])


def test_a_map_from_before_is_recorded(ros: RosWorld, tmp_path: Path) -> None:
    """A latched message that was published before the recorder started is in the file."""
    publisher = string_publisher(ros.make_node(), "/map", qos(is_latched=True, depth=1))
    publisher.publish(string("long ago"))
    with recording(tmp_path / "map.mcap", "/map"):
        deliver(publisher)
    assert recorded_data(tmp_path / "map.mcap", "/map") == [cdr("long ago")]


def test_what_publishers_offer_is_followed_and_told(ros: RosWorld, tmp_path: Path) -> None:
    """Best effort, reliable and latched topics are all recorded, each with its own profile."""
    node = ros.make_node()
    profiles = {
        "/best_effort": qos(is_reliable=False),
        "/reliable": qos(),
        "/latched": qos(is_latched=True),
    }
    publishers = [string_publisher(node, topic, profile) for topic, profile in profiles.items()]
    with recording(tmp_path / "qos.mcap", *profiles):
        for publisher in publishers:
            wait_for(lambda publisher=publisher: publisher.get_subscription_count() == 1)
            publisher.publish(string("x"))
        time.sleep(0.2)
    with Ros2Reader(tmp_path / "qos.mcap") as reader:
        told = {
            connection.topic: (
                connection.ext.offered_qos_profiles[0].reliability.name,
                connection.ext.offered_qos_profiles[0].durability.name,
            )
            for connection in reader.connections
            if connection.topic in profiles and connection.msgcount == 1
        }
    assert told == {
        "/best_effort": ("BEST_EFFORT", "VOLATILE"),
        "/reliable": ("RELIABLE", "VOLATILE"),
        "/latched": ("RELIABLE", "TRANSIENT_LOCAL"),
    }


def test_a_weaker_publisher_that_joins_is_heard(ros: RosWorld, tmp_path: Path) -> None:
    """The subscription follows it, and its end, and no message is lost or recorded twice."""
    node = ros.make_node()
    latched = string_publisher(node, "/both", qos(is_latched=True, depth=50))
    latched.publish(string("first 0"))
    with recording(tmp_path / "both.mcap", "/both"):
        weak = string_publisher(node, "/both", qos(is_reliable=False))
        k = 0
        while weak.get_subscription_count() == 0 or k < 30:
            k += 1
            latched.publish(string(f"first {k}"))
            time.sleep(0.02)
        time.sleep(0.1)
        weak.publish(string("second"))
        time.sleep(0.2)
        wait_for(lambda: latched.get_subscription_count() == 1)  # the one before is gone
        node.destroy_publisher(weak)
        wait_for(lambda: latched.get_subscription_count() > 1)
        deliver(latched)
        latched.publish(string("last"))
        deliver(latched)
    expected = [cdr(f"first {number}") for number in range(k + 1)]
    expected += [cdr("second"), cdr("last")]
    assert recorded_data(tmp_path / "both.mcap", "/both") == expected


def test_a_topic_that_appears_later_is_recorded(ros: RosWorld, tmp_path: Path) -> None:
    """It is found while the recorder runs; one that was excluded is not."""
    node = ros.make_node()
    with recording(tmp_path / "late.mcap", exclude=("/priv*",)) as run:
        late, private = (
            string_publisher(node, topic, qos(is_latched=True)) for topic in ("/late", "/private")
        )
        late.publish(string("here"))
        private.publish(string("not for you"))
        deliver(late)
    assert recorded_data(tmp_path / "late.mcap", "/late") == [cdr("here")]
    assert run.outcome.counts["/late"] == 1
    assert "/private" not in run.outcome.counts


def test_hidden_topics_and_other_names_are_left_out(ros: RosWorld, tmp_path: Path) -> None:
    """Without names all but hidden topics; with names these only, and hidden ones too."""
    node = ros.make_node()
    publishers = [
        string_publisher(node, topic, qos(is_latched=True))
        for topic in ("/act/_feedback", "/plain")
    ]
    for publisher in publishers:
        publisher.publish(string("x"))
    with recording(tmp_path / "all.mcap", "/plain") as everything:
        pass
    with recording(
        tmp_path / "one.mcap", "act/_feedback", topics=("act/_feedback", "/nowhere")
    ) as one:
        pass
    assert "/act/_feedback" not in everything.outcome.counts
    assert set(one.outcome.counts) == {"/act/_feedback"}
    assert one.outcome.skipped == {"/nowhere": "nobody published it"}
    assert one.sentences == ["/nowhere is not recorded: nobody published it"]


def test_simulated_time_is_the_log_time(ros: RosWorld, tmp_path: Path) -> None:
    """What came before the first /clock counts as then; a jump back is said and stays readable."""
    node = ros.make_node()
    strings, (clock, publish_clock) = string_publisher(node, "/text", qos()), clock_publisher(node)
    path = tmp_path / "sim.mcap"

    def both(text: str, clock_s: float) -> None:
        strings.publish(string(text))
        deliver(strings)
        publish_clock(clock_s)
        deliver(clock)

    with recording(path, "/text", "/clock", use_sim_time=True) as run:
        wait_for(lambda: strings.get_subscription_count() and clock.get_subscription_count())
        both("before", 100.0)
        both("at 100", 100.5)
        both("at 100.5", 42.0)
        both("after the jump", 101.25)
        strings.publish(string("at 101.25"))
        deliver(strings)
    texts = [(m.log_time_ns / 1e9, bytes(m.data)) for m in recorded(path) if m.topic == "/text"]
    assert texts == [
        (100.0, cdr("before")),
        (100.0, cdr("at 100")),
        (100.5, cdr("at 100.5")),
        (100.5, cdr("after the jump")),
        (101.25, cdr("at 101.25")),
    ]
    assert run.sentences == [
        "/clock went back by 58.500 s: log times stay at 100.500 s until it has caught up"
    ]


def test_without_simulated_time_messages_have_the_time_of_arrival(
    ros: RosWorld, tmp_path: Path
) -> None:
    """Log time is when a message arrived, publish time when it was sent, both on the wall."""
    publisher = string_publisher(ros.make_node(), "/text", qos())
    path = tmp_path / "wall.mcap"
    with recording(path, "/text"):
        wait_for(lambda: publisher.get_subscription_count() == 1)
        before_ns = time.time_ns()
        publisher.publish(string("x"))
        deliver(publisher)
        after_ns = time.time_ns()
    with path.open("rb") as file:
        times = [
            (message.publish_time, message.log_time)
            for _, channel, message in make_reader(file).iter_messages()
            if channel.topic == "/text"
        ]
    assert len(times) == 1
    assert before_ns <= times[0][0] <= times[0][1] <= after_ns + 1_000_000


def test_a_clock_of_another_type_ends_it(ros: RosWorld, tmp_path: Path) -> None:
    """No message would have a time: the sentence says what /clock is."""
    string_publisher(ros.make_node(), "/clock", qos())
    with (
        pytest.raises(NodeError, match="/clock is published as std_msgs/msg/String"),
        recording(tmp_path / "sim.mcap", "/clock", use_sim_time=True),
    ):
        pass


def test_a_clock_that_is_not_wanted_still_tells_the_time(ros: RosWorld, tmp_path: Path) -> None:
    """An excluded /clock is not in the file."""
    node = ros.make_node()
    strings, (clock, publish_clock) = string_publisher(node, "/text", qos()), clock_publisher(node)
    with recording(tmp_path / "sim.mcap", "/text", topics=("/text",), use_sim_time=True):
        wait_for(lambda: strings.get_subscription_count() and clock.get_subscription_count())
        strings.publish(string("x"))
        deliver(strings)
        publish_clock(7.0)
        deliver(clock)
    messages = recorded(tmp_path / "sim.mcap")
    assert [(message.topic, message.log_time_ns) for message in messages] == [("/text", 7 * 10**9)]


def test_types_that_cannot_be_recorded_are_said(
    ros: RosWorld, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No definition, or no Python class: one sentence each, and the rest is recorded."""
    from std_msgs.msg import Bool
    from std_srvs.srv import Trigger

    from are_ros.node.message_classes import message_class
    from are_ros.record import topics as _topic_types

    def all_but_bool(type_name: str) -> Any:
        if type_name == "std_msgs/msg/Bool":
            raise NodeError("std_msgs/msg/Bool: std_msgs is not installed")
        return message_class(type_name)

    monkeypatch.setattr(_topic_types, "message_class", all_but_bool)
    node = ros.make_node()
    node.create_publisher(Trigger.Event, "/service_event", 10)
    node.create_publisher(Bool, "/flag", 10)
    text = string_publisher(node, "/text", qos(is_latched=True))
    text.publish(string("fine"))
    topics = ("/service_event", "/flag", "/text")
    with recording(tmp_path / "odd.mcap", *topics, topics=topics) as run:
        deliver(text)
    reasons = {
        "/service_event": "no definition of std_srvs/srv/Trigger_Event is installed",
        "/flag": "std_msgs/msg/Bool: std_msgs is not installed",
    }
    assert run.outcome.skipped == reasons
    expected = [f"{topic} is not recorded: {reason}" for topic, reason in reasons.items()]
    assert sorted(run.sentences) == sorted(expected)
    assert run.outcome.counts == {"/text": 1}


def test_the_stop_loses_nothing(ros: RosWorld, tmp_path: Path) -> None:
    """Two hundred messages in one breath, then the stop: all are there, in their order."""
    publisher = string_publisher(ros.make_node(), "/burst", qos(depth=200))
    with recording(tmp_path / "burst.mcap", "/burst") as run:
        wait_for(lambda: publisher.get_subscription_count() == 1)
        for k in range(200):
            publisher.publish(string(str(k)))
        deliver(publisher)
    expected = [cdr(str(k)) for k in range(200)]
    assert recorded_data(tmp_path / "burst.mcap", "/burst") == expected
    assert run.outcome.counts["/burst"] == 200
    assert (run.outcome.missed, run.outcome.dropped) == ({}, {})
    assert list(run.outcome.sentences()) == []


def test_what_never_arrived_is_counted(ros: RosWorld, tmp_path: Path) -> None:
    """A publisher that keeps one message overwrites others: the gaps in its numbers tell."""
    publisher = string_publisher(ros.make_node(), "/burst", qos(depth=1, is_reliable=False))
    with recording(tmp_path / "burst.mcap", "/burst", topics=("/burst",)) as run:
        wait_for(lambda: publisher.get_subscription_count() == 1)
        time.sleep(0.3)
        publisher.publish(string("first"))
        time.sleep(0.1)
        for k in range(3000):
            publisher.publish(string(str(k)))
        time.sleep(0.1)
        publisher.publish(string("last"))
        time.sleep(0.3)
    count = run.outcome.counts["/burst"]
    missed = run.outcome.missed.get("/burst", 0)
    assert count + missed == 3002
    assert len(list(run.outcome.sentences())) == (missed > 0)


def test_the_readers_of_others_open_it(ros: RosWorld, tmp_path: Path) -> None:
    """The file is read by rosbags, and by mcap."""
    publisher = string_publisher(ros.make_node(), "/text", qos(is_latched=True))
    publisher.publish(string("x"))
    with recording(tmp_path / "run.mcap", "/text", topics=("/text",)) as run:
        deliver(publisher)
    assert run.outcome.file == tmp_path / "run.mcap"
    assert run.outcome.file_bytes == run.outcome.file.stat().st_size
    with Ros2Reader(tmp_path / "run.mcap") as reader:
        assert [(c.topic, c.msgtype) for c in reader.connections] == [
            ("/text", "std_msgs/msg/String")
        ]
        assert [bytes(data) for _, _, data in reader.messages()] == [cdr("x")]
    with run.outcome.file.open("rb") as file:
        messages = list(make_reader(file, validate_crcs=True).iter_messages())
    assert [message.data for _, _, message in messages] == [cdr("x")]


def test_the_duration_ends_it(ros_available: None, tmp_path: Path) -> None:  # noqa: ARG001
    """It counts from when the recorder is ready; nobody has to tell it to stop."""
    from are_ros.record.recorder import record
    from are_ros.record.topics import RecordOptions

    options = RecordOptions(tmp_path / "short.mcap", duration_s=0.3)
    ready_s: list[tuple[float, float]] = []

    def note_the_time() -> None:
        ready_s.append((time.monotonic(), running_s()))

    record(options, silent, note_the_time, lambda: False)
    assert time.monotonic() - ready_s[0][0] >= 0.3
    assert running_s() - ready_s[0][1] < 2.0
    assert options.path.is_file()


def test_existing_recordings_are_refused(ros_available: None, tmp_path: Path) -> None:  # noqa: ARG001
    """Neither a recording nor what a killed recorder left is overwritten, unless asked for."""
    from are_ros.record.recorder import record
    from are_ros.record.topics import RecordOptions

    path = tmp_path / "out.mcap"
    path.write_bytes(b"older")
    with pytest.raises(BagError, match=r"out\.mcap exists already; choose another name"):
        record(RecordOptions(path), silent, lambda: None, lambda: True)
    assert path.read_bytes() == b"older"
    record(RecordOptions(path, overwrite=True), silent, lambda: None, lambda: True)
    assert path.read_bytes() != b"older"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["out.mcap"]


def test_an_error_keeps_what_was_recorded(
    ros: RosWorld, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that fails is said, and `<name>.part` stays."""
    publisher = string_publisher(ros.make_node(), "/text", qos())

    def fail(*_: object) -> None:
        raise BagError("the disk is full")

    monkeypatch.setattr(BagWriter, "write_raw", fail)
    with (  # noqa: PT012 - what raises is the end of the block
        pytest.raises(BagError, match="the disk is full"),
        recording(tmp_path / "full.mcap", "/text"),
    ):
        wait_for(lambda: publisher.get_subscription_count() == 1)
        publisher.publish(string("x"))
        deliver(publisher)
    assert [file.name for file in tmp_path.iterdir()] == ["full.mcap.part"]
