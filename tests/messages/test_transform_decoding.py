"""TFMessages from bytes, against the general deserialiser."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from are_ros.bag.reader import BagReader
from are_ros.bag.types import RosbagsFactory, jazzy_typestore
from are_ros.messages.transforms import (
    StampedTransform,
    decode_transforms_cdr,
    decode_transforms_ros1,
    make_transforms,
    read_transforms,
)

TYPE = "tf2_msgs/msg/TFMessage"
FACTORY = RosbagsFactory()
ROS1_STORE = get_typestore(Stores.ROS1_NOETIC)
ROS1_STORE.register(
    get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
)
ROS1_FACTORY = RosbagsFactory(ROS1_STORE)
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
    """Headers of ROS 1 have a sequence number before the stamp."""
    data = ROS1_STORE.serialize_ros1(make_transforms(ROS1_FACTORY, transforms), TYPE)
    assert decode_transforms_ros1(bytes(data)) == transforms


@pytest.mark.parametrize(
    "name",
    [
        "drl-jarvis-hall/jarvis_complex_path_fast",
        "drl-ship-interior-gazebo/ship_interior_with_tilting_laser",
    ],
)
def test_real_recordings_agree_with_the_general_reader(real_data: Path, name: str) -> None:
    """On every transform of real drives both ways give the same values."""
    with BagReader([real_data / f"{name}.bag"]) as reader:
        messages = list(reader.messages(("/tf",)))
        quick = [reader.transforms(message) for message in messages]
        general = [read_transforms(reader.deserialize(message)) for message in messages]
    assert len(messages) > 10_000
    assert quick == general
