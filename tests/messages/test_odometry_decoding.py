"""Odometry from its bytes, against rosbags' own deserialiser."""

from pathlib import Path
from struct import error as StructError  # noqa: N812

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.messages.odometry import OdometryNumbers, read_odometry_numbers
from are_ros.messages.odometry_decoding import decode_odometry_cdr, decode_odometry_ros1
from are_ros.replay.bag_reader import BagReader
from are_ros.replay.message_types import RosbagsFactory, jazzy_typestore

TYPE = "nav_msgs/msg/Odometry"
NAMES = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9)
NUMBERS = st.lists(st.floats(allow_nan=False), min_size=13, max_size=13)


def message_of(numbers: OdometryNumbers) -> object:
    """Return an Odometry message with these numbers, and covariances that are not zero."""
    make = RosbagsFactory().make
    stamp = make(
        "builtin_interfaces/msg/Time",
        sec=numbers.stamp_ns // 10**9,
        nanosec=numbers.stamp_ns % 10**9,
    )
    x, y, z, i, j, k, w = numbers.pose
    pose = make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=x, y=y, z=z),
        orientation=make("geometry_msgs/msg/Quaternion", x=i, y=j, z=k, w=w),
    )
    vectors = [
        make("geometry_msgs/msg/Vector3", x=a, y=b, z=c)
        for a, b, c in (numbers.twist[:3], numbers.twist[3:])
    ]
    twist = make("geometry_msgs/msg/Twist", linear=vectors[0], angular=vectors[1])
    covariance = np.arange(36.0)
    return make(
        TYPE,
        header=make("std_msgs/msg/Header", stamp=stamp, frame_id=numbers.frame_id),
        child_frame_id=numbers.child_frame_id,
        pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance),
        twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=covariance),
    )


@given(frame=NAMES, child=NAMES, stamp_ns=st.integers(0, 2**31 * 10**9 - 1), numbers=NUMBERS)
def test_cdr_is_read_as_rosbags_reads_it(
    frame: str, child: str, stamp_ns: int, numbers: list[float]
) -> None:
    """Names of any length and any alignment of the doubles after them."""
    wanted = OdometryNumbers(frame, child, stamp_ns, tuple(numbers[:7]), tuple(numbers[7:]))
    data = bytes(jazzy_typestore().serialize_cdr(message_of(wanted), TYPE))
    assert decode_odometry_cdr(data) == wanted
    assert read_odometry_numbers(jazzy_typestore().deserialize_cdr(data, TYPE)) == wanted


@pytest.mark.parametrize("cut", [3, 20, 60, 200, 500])
def test_bytes_that_end_too_early_are_refused(cut: int) -> None:
    """Wherever they end, in the header, a name, the pose or a covariance."""
    numbers = OdometryNumbers("odom", "base", 5, (0.0,) * 7, (0.0,) * 6)
    data = bytes(jazzy_typestore().serialize_cdr(message_of(numbers), TYPE))
    with pytest.raises((StructError, UnicodeDecodeError)):
        decode_odometry_cdr(data[:cut])


def test_real_ros1_recordings_are_read_as_rosbags_reads_them(real_data: Path) -> None:
    """Both real recordings with odometry, the first 300 messages of each topic."""
    folders = {
        "fuse-tb3-gazebo/turtlebot3.bag": "/odom",
        "drl-ship-interior-gazebo/ship_interior_with_tilting_laser.bag": "/guardian/odom",
    }
    for name, topic in folders.items():
        with BagReader([real_data / name]) as reader:
            for _, message in zip(range(300), reader.messages((topic,)), strict=False):
                wanted = read_odometry_numbers(reader.deserialize(message))
                assert decode_odometry_ros1(message.data) == wanted
                assert reader.odometry(message) == wanted
