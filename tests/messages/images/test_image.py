"""Images of any encoding, byte order and padding, and their CameraInfo's topic."""

import zlib
from array import array
from collections.abc import Callable
from functools import partial
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.errors import InputError
from are_ros.messages.images.image import (
    camera_info_topic,
    encode_image,
    is_rectified,
    read_compressed_image,
    read_image,
    size_of,
)
from bags.simulation.making import RosbagsFactory

FACTORY = RosbagsFactory()
LAYOUTS = {
    "mono8": ("u1", 1),
    "mono16": ("u2", 1),
    "16UC1": ("u2", 1),
    "32FC1": ("f4", 1),
    "64FC2": ("f8", 2),
    "rgb8": ("u1", 3),
    "bgra8": ("u1", 4),
    "rgb16": ("u2", 3),
    "bayer_grbg16": ("u2", 1),
    "yuyv": ("u1", 2),
    "8UC": ("u1", 1),
    "16SC12": ("i2", 12),
}


def message(
    encoding: str = "16UC1",
    shape: tuple[int, int] = (3, 4),
    *,
    padding: int = 0,
    is_bigendian: int = 0,
    frame_id: str = "camera",
) -> Any:
    """Return an image of random bytes, padding included."""
    number, channels = LAYOUTS[encoding]
    height, width = shape
    step = width * channels * np.dtype(number).itemsize + padding
    data = np.random.default_rng(3).integers(0, 256, height * step).astype(np.uint8)
    header = FACTORY.make("std_msgs/msg/Header", frame_id=frame_id)
    return FACTORY.make(
        "sensor_msgs/msg/Image",
        header=header,
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=is_bigendian,
        step=step,
        data=data,
    )


@given(
    encoding=st.sampled_from(sorted(LAYOUTS)),
    shape=st.tuples(st.integers(1, 4), st.integers(1, 5)),
    padding=st.integers(0, 7),
    is_bigendian=st.sampled_from([0, 1, 255]),
)
def test_what_comes_in_goes_out_byte_for_byte(
    on_the_wire: Callable[[Any], bytes],
    encoding: str,
    shape: tuple[int, int],
    padding: int,
    is_bigendian: int,
) -> None:
    """Padding included; written pixels are read again, and padding stays then, too."""
    sent = message(encoding, shape, padding=padding, is_bigendian=is_bigendian)
    image = read_image(sent)
    assert encode_image(image) == on_the_wire(sent)
    other = image.with_pixels(np.zeros_like(image.pixels()))
    assert not other.pixels().any()
    used = image.data.shape[1] - padding
    np.testing.assert_array_equal(other.data[:, used:], image.data[:, used:])
    again = other.with_pixels(image.pixels())
    assert encode_image(again) == on_the_wire(sent)


@pytest.mark.parametrize("is_bigendian", [0, 1])
def test_pixels_have_their_values(is_bigendian: int) -> None:
    """Each number is what its bytes say, whatever the machine's order is."""
    sent = message("16UC1", (2, 3), padding=1, is_bigendian=is_bigendian)
    rows = sent.data.reshape(2, 7)
    first, second = (256, 1) if is_bigendian else (1, 256)
    expected = [
        [first * int(row[2 * c]) + second * int(row[2 * c + 1]) for c in range(3)] for row in rows
    ]
    assert read_image(sent).pixels().tolist() == expected


def test_channels_are_the_last_axis() -> None:
    """The first pixel of a colour image has the first bytes."""
    sent = message("rgb8", (2, 2), padding=2)
    pixels = read_image(sent).pixels()
    assert pixels.shape == (2, 2, 3)
    assert pixels[1, 0].tolist() == sent.data[8:11].tolist()


def test_images_of_rclpy_are_read(both_readings: Callable[[bytes, str], tuple[Any, Any]]) -> None:
    """Its arrays and a slash before the frame are taken; rclpy reads what is written."""
    sent = message("rgb8", (2, 2), frame_id="/camera")
    sent.data = array("B", sent.data.tolist())
    image = read_image(sent)
    assert image.frame_id == "camera"
    by_rclpy, by_rosbags = both_readings(encode_image(image), "sensor_msgs/msg/Image")
    assert by_rclpy == by_rosbags
    assert (by_rclpy["width"], by_rclpy["encoding"]) == ("2.0", "rgb8")


@pytest.mark.parametrize(
    ("field", "value", "sentence"),
    [
        ("data", np.zeros(23, np.uint8), "data has 23 bytes, but height 3 x step 8 = 24"),
        ("data", np.zeros(0, np.uint8), "data has 0 bytes, but height 3 x step 8 = 24"),
        ("step", 7, "step 7 is less than the 8 bytes of 4 pixels 16UC1"),
        ("encoding", "17UC1", "encoding '17UC1' is not known"),
        ("encoding", "", "encoding '' is not known"),
        ("width", 0, "width 0 x height 3 has no pixel"),
        ("height", 0, "width 4 x height 0 has no pixel"),
    ],
)
def test_a_malformed_image_is_refused(field: str, value: object, sentence: str) -> None:
    """Topic, field and reason are named."""
    sent = message()
    setattr(sent, field, value)
    with pytest.raises(InputError) as caught:
        read_image(sent, "/depth")
    assert str(caught.value) == f"/depth: {sentence}"


def test_an_image_without_a_frame_is_refused() -> None:
    """Nothing can be seen from nowhere."""
    with pytest.raises(InputError, match=r"^/depth: header.frame_id is empty"):
        read_image(message(frame_id=""), "/depth")


def test_compressed_images_go_out_as_they_came(
    on_the_wire: Callable[[Any], bytes], both_readings: Callable[[bytes, str], tuple[Any, Any]]
) -> None:
    """Byte for byte; without data they are refused."""
    sent = FACTORY.make(
        "sensor_msgs/msg/CompressedImage",
        header=FACTORY.make("std_msgs/msg/Header", frame_id="camera"),
        format="rgb8; jpeg compressed bgr8",
        data=np.arange(5, dtype=np.uint8),
    )
    data = encode_image(read_compressed_image(sent))
    assert data == on_the_wire(sent)
    by_rclpy, by_rosbags = both_readings(data, "sensor_msgs/msg/CompressedImage")
    assert by_rclpy == by_rosbags
    sent.data = np.zeros(0, np.uint8)
    with pytest.raises(InputError, match=r"^/image: data is empty"):
        read_compressed_image(sent, "/image")


@pytest.mark.parametrize("format_", ["rgb8; jpeg compressed bgr8", "16UC1; compressedDepth png"])
def test_the_size_of_an_image(format_: str) -> None:
    """Raw or compressed; a damaged one has none."""
    assert size_of(FACTORY.make("sensor_msgs/msg/Image", height=2, width=3)) == (3, 2)
    pixels = np.zeros((20, 31), np.uint16 if "Depth" in format_ else np.uint8)
    ending, head = (".png", 12) if "Depth" in format_ else (".jpg", 0)
    data = np.concatenate((np.zeros(head, np.uint8), cv2.imencode(ending, pixels)[1].reshape(-1)))
    header = FACTORY.make("std_msgs/msg/Header", frame_id="camera")
    make = partial(FACTORY.make, "sensor_msgs/msg/CompressedImage", header=header, format=format_)
    assert size_of(make(data=data)) == (31, 20)
    for count in (0, head, head + 20):
        assert size_of(make(data=data[:count])) is None


def test_a_picture_that_claims_to_be_huge_has_no_size() -> None:
    """OpenCV raises an error of its own for a PNG of 10^10 pixels."""
    png = cv2.imencode(".png", np.zeros((4, 4), np.uint8))[1].reshape(-1).copy()
    png[16:24] = np.frombuffer((100_000).to_bytes(4, "big") * 2, np.uint8)
    png[29:33] = np.frombuffer(zlib.crc32(png[12:29].tobytes()).to_bytes(4, "big"), np.uint8)
    header = FACTORY.make("std_msgs/msg/Header", frame_id="camera")
    make = partial(FACTORY.make, "sensor_msgs/msg/CompressedImage", header=header)
    assert size_of(make(data=png, format="mono8; png compressed ")) is None


@pytest.mark.parametrize(
    ("image", "info"),
    [
        ("/camera/depth/image_raw", "/camera/depth/camera_info"),
        ("/camera/depth/image_raw/compressedDepth", "/camera/depth/camera_info"),
        ("/camera/image/compressed", "/camera/camera_info"),
        ("/camera/depth", "/camera/camera_info"),
        ("/depth", "/camera_info"),
        ("depth", "camera_info"),
        ("/depth/compressedDepth", "/camera_info"),
        ("depth/compressedDepth", "camera_info"),
    ],
)
def test_the_camera_info_is_beside_the_image(image: str, info: str) -> None:
    """As image_transport publishes them, the transport aside."""
    assert camera_info_topic(image) == info


def test_rectified_images_are_known_by_their_names() -> None:
    """As image_proc names them."""
    assert is_rectified("/camera/depth/image_rect_raw")
    assert is_rectified("/camera/image_rect_color/compressed")
    assert not is_rectified("/rect/image_raw")
    assert not is_rectified("/camera/depth/image_raw/compressedDepth")
