"""TFMessages from bytes, against the general deserialiser."""

from hypothesis import given
from hypothesis import strategies as st

from are_ros.bag.types import jazzy_typestore
from are_ros.messages.transforms import StampedTransform, decode_transforms_cdr
from bags.simulation.making import RosbagsFactory, make_transforms

TYPE = "tf2_msgs/msg/TFMessage"
FACTORY = RosbagsFactory()
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
