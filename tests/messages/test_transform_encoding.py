"""TFMessages written without message objects: the bytes are those that the objects give."""

from struct import error as StructError  # noqa: N812

import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.bag.types import jazzy_typestore
from are_ros.conventions import NS_PER_S
from are_ros.messages.transforms import (
    StampedTransform,
    decode_transforms_cdr,
    encode_transforms_cdr,
)
from bags.simulation.making import RosbagsFactory, make_transforms

NAME = "tf2_msgs/msg/TFMessage"
NUMBERS = st.floats(allow_nan=False)
TRANSFORMS = st.builds(
    StampedTransform,
    st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=9),
    st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=9),
    st.integers(0, 2**31 * NS_PER_S - 1),
    st.tuples(NUMBERS, NUMBERS, NUMBERS),
    st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS),
)


@given(st.lists(TRANSFORMS, max_size=4))
def test_the_bytes_are_those_of_the_message(transforms: list[StampedTransform]) -> None:
    """Whatever the lengths of the names, and back again."""
    message = make_transforms(RosbagsFactory(), transforms)
    data = encode_transforms_cdr(transforms)
    assert data == bytes(jazzy_typestore().serialize_cdr(message, NAME))
    assert decode_transforms_cdr(data) == transforms


def test_a_stamp_that_ros2_has_not_is_an_error() -> None:
    """Its seconds are 31 bits."""
    late = StampedTransform("a", "b", 2**31 * NS_PER_S, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    with pytest.raises(StructError):
        encode_transforms_cdr([late])
