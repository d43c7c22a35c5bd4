"""Inputs written beside the outputs, from recordings of every kind."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from are_ros.bag.reader import BagReader, stamp_in
from are_ros.bag.types import jazzy_typestore
from are_ros.bag.writer import BagWriter
from are_ros.conventions import NS_PER_S
from are_ros.errors import InputError
from are_ros.messages.transforms import StampedTransform
from are_ros.replay.listeners import InputCopy
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.making import RosbagsFactory

Records = Sequence[tuple[str, int, Any]]
WriteBag = Callable[[Path, Records], Path]
ROLES = {
    "/map": "map",
    "/octomap_point_cloud_centers": "octomap_point_cloud_centers",
    "/odom": "odom",
    "/scan": "scan",
    "/camera/camera_info": "camera/camera_info",
    "/tf": "tf",
    "/tf_static": "tf_static",
}


def copied(source: Path, target: Path) -> list[tuple[str, int, bytes]]:
    """Copy a recording, each message as received 3 ns after it was recorded."""
    with BagReader([source]) as reader, BagWriter(target) as writer:
        copy = InputCopy(reader, writer, ROLES)
        for message in reader.messages():
            copy.take_input(message, message.log_time_ns + 3)
    with BagReader([target]) as reader:
        return [(m.topic, m.log_time_ns, bytes(m.data)) for m in reader.messages()]


@pytest.mark.parametrize("suffix", [".mcap", ".db3", ".bag"])
def test_messages_come_out_as_they_went_in(
    tmp_path: Path,
    write_bag: WriteBag,
    sample_records: Records,
    as_ros1: Callable[[Any], Any],
    suffix: str,
) -> None:
    """Topics and bytes are those of the ROS 2 messages, from ROS 1 too."""
    records = [next(r for r in sample_records if r[0] == topic) for topic in ROLES]
    records.sort(key=lambda record: record[1])
    sent = [(t, at, as_ros1(m) if suffix == ".bag" else m) for t, at, m in records]
    store = jazzy_typestore()
    expected = [
        (topic, at + 3, bytes(store.serialize_cdr(message, message.__msgtype__)))
        for topic, at, message in records
    ]
    source = write_bag(tmp_path / f"in{suffix}", sent)
    assert sorted(copied(source, tmp_path / "copy.mcap")) == sorted(expected)


def test_latched_topics_stay_latched(
    tmp_path: Path, write_bag: WriteBag, sample_records: Records
) -> None:
    """Map, cloud and tf_static are for late subscribers, too; others are not."""
    copied(write_bag(tmp_path / "in.mcap", sample_records), tmp_path / "copy.mcap")
    with BagReader([tmp_path / "copy.mcap"]) as reader:
        latched = {topic.name for topic in reader.topics if topic.is_latched}
    assert latched == {"/map", "/octomap_point_cloud_centers", "/tf_static"}


def test_topics_without_a_role_are_left_out(
    tmp_path: Path, write_bag: WriteBag, factory: RosbagsFactory
) -> None:
    """What the replay does not read is not copied."""
    text = factory.make("std_msgs/msg/String", data="x")
    transforms = factory.make("tf2_msgs/msg/TFMessage")
    source = write_bag(tmp_path / "in.mcap", [("/chatter", 1, text), ("/tf", 2, transforms)])
    assert [topic for topic, _, _ in copied(source, tmp_path / "copy.mcap")] == ["/tf"]


def test_messages_of_another_type_are_left_out(
    tmp_path: Path, write_bag: WriteBag, factory: RosbagsFactory
) -> None:
    """A topic has one type in the copy, that of its role: also if the other one comes first."""
    texts = [
        (topic, 1, factory.make("std_msgs/msg/String", data="x")) for topic in ("/tf", "/odom")
    ]
    transforms = factory.make("tf2_msgs/msg/TFMessage")
    first = write_bag(tmp_path / "a.mcap", texts)
    second = write_bag(tmp_path / "b.mcap", [("/tf", 2, transforms)])
    with BagReader([first, second]) as reader, BagWriter(tmp_path / "copy.mcap") as writer:
        copy = InputCopy(reader, writer, ROLES)
        for message in reader.messages():
            copy.take_input(message, message.log_time_ns)
    with BagReader([tmp_path / "copy.mcap"]) as reader:
        (topic,) = reader.topics
        assert (topic.name, topic.type_name, topic.count) == ("/tf", "tf2_msgs/msg/TFMessage", 1)


def test_what_came_by_option_is_written_once(
    tmp_path: Path, write_bag: WriteBag, factory: RosbagsFactory
) -> None:
    """A map from a file and static transforms stand under the topics that they replace."""
    source = write_bag(tmp_path / "in.mcap", [("/odom", 1, factory.make("nav_msgs/msg/Odometry"))])
    grid = OccupancyGrid(np.array([[0, 100]], np.int8), 0.5, RigidTransform.identity(), "earth")
    edge = StampedTransform("earth", "odom", 9, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    with BagReader([source]) as reader, BagWriter(tmp_path / "copy.mcap") as writer:
        copy = InputCopy(reader, writer, {"/odom": "odom"})
        copy.write_map("/map", grid, 9)
        copy.write_static([edge], 9)
    with BagReader([tmp_path / "copy.mcap"]) as reader:
        found = {m.topic: reader.deserialize(m) for m in reader.messages()}
        latched = {topic.name for topic in reader.topics if topic.is_latched}
    assert latched == {"/map", "/tf_static"}
    assert found["/map"].data.tolist() == [0, 100]
    assert found["/map"].header.frame_id == "earth"
    (written,) = found["/tf_static"].transforms
    assert (written.header.frame_id, written.child_frame_id) == ("earth", "odom")


def test_ros1_fields_find_their_ros2_names(
    tmp_path: Path, write_bag: WriteBag, ros1_factory: RosbagsFactory
) -> None:
    """CameraInfo's upper-case fields are folded, seq is dropped, what is new is zero."""
    k, p = np.arange(9, dtype=np.float64), np.arange(12, dtype=np.float64)
    header = ros1_factory.make("std_msgs/msg/Header", seq=7, frame_id="eye")
    info = ros1_factory.make(
        "sensor_msgs/msg/CameraInfo", header=header, width=4, D=k[:5], K=k, R=k + 1.0, P=p
    )
    beam = ros1_factory.make("sensor_msgs/msg/Range", header=header, range=0.5)
    source = write_bag(tmp_path / "in.bag", [("/info", 1, info), ("/range", 2, beam)])
    store = jazzy_typestore()
    with BagReader([source]) as reader:
        made, ranged = (
            store.deserialize_cdr(reader.as_ros2(message), message.connection.msgtype)
            for message in reader.messages()
        )
    assert (made.header.frame_id, made.width) == ("eye", 4)
    for field, values in (("d", k[:5]), ("k", k), ("r", k + 1.0), ("p", p)):
        assert getattr(made, field).tolist() == values.tolist()
    assert (ranged.range, ranged.variance) == (0.5, 0.0)


def test_ros1_types_with_the_same_fields_become_the_bytes_that_ros2_writes(
    tmp_path: Path, write_bag: WriteBag, factory: RosbagsFactory, ros1_factory: RosbagsFactory
) -> None:
    """Names of any length, sequences and nested headers, without seq."""
    messages: list[Any] = []
    expected: list[Any] = []
    for length in range(9):
        values = np.arange(length, dtype=np.float64)
        for made, make in ((messages, ros1_factory.make), (expected, factory.make)):
            number = {"seq": 7} if made is messages else {}
            header = make("std_msgs/msg/Header", frame_id="e" * length, **number)
            pose = make("geometry_msgs/msg/PoseStamped", header=header)
            names = ["n" * k for k in range(length)]
            scan = make(
                "sensor_msgs/msg/LaserScan", header=header, ranges=values.astype(np.float32)
            )
            made += [
                make("nav_msgs/msg/Path", header=header, poses=[pose] * length),
                make("sensor_msgs/msg/JointState", header=header, name=names, position=values),
                scan,
                make("nav_msgs/msg/Odometry", header=header, child_frame_id="c" * length),
            ]
    topics = [f"/t{k % 4}" for k in range(len(messages))]
    entries = [
        (topic, k + 1, one) for k, (topic, one) in enumerate(zip(topics, messages, strict=True))
    ]
    store = jazzy_typestore()
    with BagReader([write_bag(tmp_path / "in.bag", entries)]) as reader:
        copied = [reader.as_ros2(message) for message in reader.messages()]
    assert copied == [bytes(store.serialize_cdr(one, one.__msgtype__)) for one in expected]


@pytest.mark.parametrize("kind", ["nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"])
def test_a_stamp_of_ros1_after_2038_is_refused(
    tmp_path: Path, write_bag: WriteBag, ros1_factory: RosbagsFactory, kind: str
) -> None:
    """Its seconds are unsigned: in ROS 2 they would be of 1901. The second before is the last."""

    def stamped(seconds: int) -> Any:
        stamp = ros1_factory.make("builtin_interfaces/msg/Time", sec=seconds)
        header = ros1_factory.make("std_msgs/msg/Header", stamp=stamp, frame_id="map")
        if kind == "nav_msgs/msg/Odometry":
            return ros1_factory.make(kind, header=header)
        edge = ros1_factory.make("geometry_msgs/msg/TransformStamped", header=header)
        return ros1_factory.make(kind, transforms=[edge])

    # rosbags writes -2^31 in the four bytes that ROS 1 reads as 2^31
    records = [("/t", 1, stamped(2**31 - 1)), ("/t", 2, stamped(-(2**31)))]
    read = BagReader.odometry if kind == "nav_msgs/msg/Odometry" else BagReader.transforms
    with BagReader([write_bag(tmp_path / "in.bag", records)]) as reader:
        last, over = reader.messages()
        read(reader, last)
        place = 4 if kind == "nav_msgs/msg/Odometry" else 8
        assert stamp_in(reader.as_ros2(last), place) == (2**31 - 1) * NS_PER_S
        for refused in (read, BagReader.as_ros2):
            with pytest.raises(InputError, match=r"^/t: the message at 2 ns has a stamp aft"):
                refused(reader, over)


def test_a_name_of_ros1_that_is_not_utf8_is_copied_as_it_stands(
    tmp_path: Path, write_bag: WriteBag, ros1_factory: RosbagsFactory
) -> None:
    """The replay refuses the message, and says so; its bytes are not lost, as those of ROS 2."""
    header = ros1_factory.make("std_msgs/msg/Header", frame_id="frame")
    odometry = ros1_factory.make("nav_msgs/msg/Odometry", header=header, child_frame_id="base")
    with BagReader([write_bag(tmp_path / "in.bag", [("/odom", 1, odometry)])]) as reader:
        (message,) = reader.messages()
        data = bytes(message.data)
        odd = message._replace(data=data.replace(b"frame", b"fr\xe4me"))
        with pytest.raises(InputError, match=r"^/odom: the message at 1 ns is no nav_msgs"):
            reader.odometry(odd)
        plain = reader.as_ros2(message)
        assert reader.as_ros2(odd) == plain.replace(b"frame", b"fr\xe4me") != plain
