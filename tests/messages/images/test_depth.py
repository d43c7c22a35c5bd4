"""Images of depths as messages: raw, and the compressedDepth of image_transport."""

import struct
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

from are_ros.builder.sensors.depth_image import InverseDepth, Millimetres
from are_ros.errors import InputError
from are_ros.messages.images.depth import encode_depth, read_depth
from bags.simulation.making import RosbagsFactory

FACTORY = RosbagsFactory()
A, B = 10100.0, -1009.0
"""What image_transport writes for a depth_max of 10 m and a quantisation of 100."""
NUMBERS = np.array([[0, 1, 1500], [65535, 20000, 4095]], np.uint16)


def compressed(
    numbers: np.ndarray[Any, Any] = NUMBERS,
    kind: str = "16UC1; compressedDepth png",
    ab: tuple[float, float] = (A, B),
) -> Any:
    """Return a compressedDepth of some numbers, as image_transport makes it."""
    png = cv2.imencode(".png", numbers)[1].reshape(-1)
    header = np.frombuffer(struct.pack("<iff", 0, *ab), np.uint8)
    return FACTORY.make(
        "sensor_msgs/msg/CompressedImage",
        header=FACTORY.make("std_msgs/msg/Header", frame_id="camera"),
        format=kind,
        data=np.concatenate((header, png)),
    )


@pytest.mark.parametrize("kind", ["16UC1; compressedDepth", "mono16; compressedDepth png"])
def test_millimetres_in_a_png(on_the_wire: Callable[[Any], bytes], kind: str) -> None:
    """The numbers are read; the message goes out byte for byte."""
    sent = compressed(kind=kind)
    depth = read_depth(sent)
    assert encode_depth(depth) == on_the_wire(sent)
    np.testing.assert_array_equal(depth.pixels.stored(), NUMBERS)
    assert isinstance(depth.pixels.code, Millimetres)
    assert (depth.pixels.shape, depth.frame_id) == ((2, 3), "camera")


def test_metres_are_steps_of_their_inverse(
    over_the_wire: Callable[[Any], Any], on_the_wire: Callable[[Any], bytes]
) -> None:
    """As compressed_depth_image_transport decodes them; what is written is read again."""
    sent = compressed(kind="32FC1; compressedDepth png")
    depth = read_depth(over_the_wire(sent))
    assert encode_depth(depth) == on_the_wire(sent)
    assert depth.pixels.code == InverseDepth(A, B)
    found = depth.pixels.code.depths_m(depth.pixels.stored())
    with np.errstate(divide="ignore"):
        wanted = np.where(NUMBERS > 0, A / (NUMBERS.astype(float) - B), np.nan)
    np.testing.assert_allclose(found, wanted)
    other = depth.pixels.with_stored(np.flip(NUMBERS, axis=1).copy())
    np.testing.assert_array_equal(other.stored(), np.flip(NUMBERS, axis=1))
    assert other.code == depth.pixels.code


def test_rclpy_reads_it(both_readings: Callable[[bytes, str], tuple[Any, Any]]) -> None:
    """Field by field what rosbags reads."""
    pixels = read_depth(compressed()).pixels.with_stored(NUMBERS)
    data = encode_depth(read_depth(compressed()).__class__(pixels))
    by_rclpy, by_rosbags = both_readings(data, "sensor_msgs/msg/CompressedImage")
    assert by_rclpy == by_rosbags


def damaged() -> Any:
    """Return a compressedDepth that ends in the midst of its PNG."""
    message = compressed()
    message.data = message.data[:-30]
    return message


def test_a_damaged_png_is_refused_when_it_is_looked_at() -> None:
    """Before that it goes out as it came."""
    depth = read_depth(damaged())
    with pytest.raises(InputError, match="its PNG is damaged"):
        depth.pixels.stored()


REFUSED: dict[str, tuple[Any, str]] = {
    "rvl": (compressed(kind="16UC1; compressedDepth rvl"), "format '16UC1; compressedDepth rvl'"),
    "jpeg": (compressed(kind="rgb8; jpeg compressed bgr8"), "is no compressedDepth"),
    "colours": (compressed(kind="rgb8; compressedDepth png"), "encoding 'rgb8' holds no depth"),
    "bits": (compressed(NUMBERS.astype(np.uint8)), "its PNG has 8 bits and colour type 0"),
    "zeros": (
        compressed(kind="32FC1; compressedDepth", ab=(0.0, 0.0)),
        "its depthParam are 0 and 0, which code no depth",
    ),
    "nan": (
        compressed(kind="32FC1; compressedDepth", ab=(np.nan, 0.0)),
        "its depthParam are nan and 0, which code no depth",
    ),
}


@pytest.mark.parametrize("name", list(REFUSED))
def test_what_cannot_be_decompressed_is_refused(name: str) -> None:
    """In one sentence that begins with the topic."""
    message, sentence = REFUSED[name]
    with pytest.raises(InputError) as caught:
        read_depth(message, "/d/compressedDepth")
    assert str(caught.value).startswith("/d/compressedDepth: ")
    assert sentence in str(caught.value)


@pytest.mark.parametrize("length", [1, 11, 12, 30])
@pytest.mark.parametrize("kind", ["16UC1; compressedDepth", "32FC1; compressedDepth"])
def test_short_data_are_refused(kind: str, length: int) -> None:
    """Without all of its header, or of the PNG's."""
    message = compressed(kind=kind)
    message.data = message.data[:length]
    with pytest.raises(InputError, match=r"^/d: data (has|hold) "):
        read_depth(message, "/d")


def test_raw_images_without_depth_are_refused() -> None:
    """The topic is named once."""
    message = FACTORY.make(
        "sensor_msgs/msg/Image",
        header=FACTORY.make("std_msgs/msg/Header", frame_id="camera"),
        height=1,
        width=1,
        encoding="mono8",
        step=1,
        data=np.zeros(1, np.uint8),
    )
    with pytest.raises(InputError, match=r"^/d: encoding 'mono8' holds no depth"):
        read_depth(message, "/d")
    message.encoding, message.width = "16UC1", 0
    with pytest.raises(InputError, match=r"^/d: width 0 x height 1 has no pixel"):
        read_depth(message, "/d")
