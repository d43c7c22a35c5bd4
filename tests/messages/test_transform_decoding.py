"""TFMessages from bytes, against the general deserialiser."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from are_ros.bag.types import jazzy_typestore
from are_ros.messages.transforms import (
    ROS1_DIGEST,
    StampedTransform,
    decode_transforms_cdr,
    decode_transforms_ros1,
)
from bags.simulation.making import RosbagsFactory, make_transforms

TYPE = "tf2_msgs/msg/TFMessage"
FACTORY = RosbagsFactory()
ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TYPE))
FRAME = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9)
NUMBER = st.floats(allow_nan=False)
TRANSFORM = st.builds(
    StampedTransform,
    FRAME,
    FRAME,
    st.integers(0, 2**31 * 10**9 - 1),
    st.tuples(NUMBER, NUMBER, NUMBER),
    st.tuples(NUMBER, NUMBER, NUMBER, NUMBER),
)


@given(st.lists(TRANSFORM, max_size=4))
def test_the_bytes_of_ros_2_are_read(transforms: list[StampedTransform]) -> None:
    """Names of any length, whatever padding they need."""
    message = make_transforms(FACTORY, transforms)
    assert (
        decode_transforms_cdr(bytes(jazzy_typestore().serialize_cdr(message, TYPE))) == transforms
    )


@given(st.lists(TRANSFORM, max_size=4))
def test_the_bytes_of_ros_1_are_read(transforms: list[StampedTransform]) -> None:
    """ROS 1 has no padding, and a number in each header."""
    assert decode_transforms_ros1(_ros1_bytes(transforms)) == transforms


def test_bytes_of_ros_1_that_end_too_early_or_too_late_are_refused() -> None:
    """The general deserialiser then says what is wrong."""
    transform = StampedTransform("map", "base", 1, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0))
    data = _ros1_bytes([transform])
    for wrong in (*(data[:length] for length in range(len(data))), data + b"\0"):
        with pytest.raises(struct.error):
            decode_transforms_ros1(wrong)


def test_the_digest_of_ros_1_is_that_of_the_definition() -> None:
    """A recording with another definition of that name is read by its own."""
    _, digest = ROS1.generate_msgdef(TYPE, ros_version=1)
    assert digest == ROS1_DIGEST


def _ros1_bytes(transforms: list[StampedTransform]) -> bytes:
    """Return a TFMessage of ROS 1, by the general serialiser."""
    types, make = ROS1.types, []
    for parent, child, stamp_ns, place, turn in transforms:
        stamp = types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
        header = types["std_msgs/msg/Header"](7, stamp, parent)
        moved = types["geometry_msgs/msg/Transform"](
            types["geometry_msgs/msg/Vector3"](*place),
            types["geometry_msgs/msg/Quaternion"](*turn),
        )
        make.append(types["geometry_msgs/msg/TransformStamped"](header, child, moved))
    return bytes(ROS1.serialize_ros1(types[TYPE](make), TYPE))
