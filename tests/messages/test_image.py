"""Images of any encoding that is read."""

from typing import Any

import numpy as np
import pytest

from are_ros.errors import InputError
from are_ros.messages.image import ENCODINGS, read_image, replace_pixels
from are_ros.replay.message_types import RosbagsFactory

HEIGHT, WIDTH = 3, 5


def image(
    factory: RosbagsFactory, encoding: str, *, is_bigendian: bool = False, padding: int = 0
) -> tuple[Any, Any]:
    """Return an image message and its pixels, each with a number of its own."""
    kind, channels = ENCODINGS[encoding]
    pixels = np.arange(HEIGHT * WIDTH * channels).reshape(HEIGHT, WIDTH, channels)
    rows = pixels.astype((">" if is_bigendian else "<") + kind)
    data = b"".join(row.tobytes() + b"\xee" * padding for row in rows)
    message = factory.make(
        "sensor_msgs/msg/Image",
        height=HEIGHT,
        width=WIDTH,
        encoding=encoding,
        is_bigendian=int(is_bigendian),
        step=len(data) // HEIGHT,
        data=np.frombuffer(data, np.uint8),
    )
    return message, pixels[:, :, 0] if channels == 1 else pixels


@pytest.mark.parametrize("encoding", sorted(ENCODINGS))
@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize("padding", [0, 3])
def test_pixels_are_read(
    factory: RosbagsFactory, encoding: str, is_bigendian: bool, padding: int
) -> None:
    """Byte order and padding do not matter."""
    message, pixels = image(factory, encoding, is_bigendian=is_bigendian, padding=padding)
    read = read_image(message)
    np.testing.assert_array_equal(read, pixels)
    assert read.dtype == ENCODINGS[encoding][0]


@pytest.mark.parametrize("encoding", ["rgb8", "16UC1", "32FC1"])
def test_replaced_pixels_leave_the_rest_alone(factory: RosbagsFactory, encoding: str) -> None:
    """Padding keeps its bytes, and the first message stays as it was."""
    message, pixels = image(factory, encoding, is_bigendian=True, padding=2)
    before = message.data.tobytes()
    other = replace_pixels(factory, message, pixels + 1)
    np.testing.assert_array_equal(read_image(other), pixels + 1)
    assert message.data.tobytes() == before
    assert replace_pixels(factory, other, pixels).data.tobytes() == before


@pytest.mark.parametrize(
    ("field", "value", "sentence"),
    [
        ("encoding", "bayer_rggb8", "encoding 'bayer_rggb8' is none of"),
        ("step", 14, "step 14 is less than width 5 x 3 bytes"),
        ("data", np.zeros(7, np.uint8), "data has 7 bytes, but height 3 x step 15 = 45"),
    ],
)
def test_a_malformed_image_is_refused(
    factory: RosbagsFactory, field: str, value: object, sentence: str
) -> None:
    """The sentence names topic and field."""
    message, _ = image(factory, "rgb8")
    setattr(message, field, value)
    with pytest.raises(InputError) as caught:
        read_image(message, "/image")
    assert str(caught.value).startswith(f"/image: {sentence}")
