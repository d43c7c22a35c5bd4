"""sensor_msgs/Image and CompressedImage, and the CameraInfo beside them."""

import struct
from typing import Any, Final

import cv2
import numpy as np

from are_ros.builder.sensors.image import CompressedImage, Image
from are_ros.errors import InputError
from are_ros.messages.cdr import CdrWriter
from are_ros.messages.common import read_array, read_header, read_time
from are_ros.world.cameras import CameraInfo

TRANSPORTS: Final = ("compressed", "compressedDepth", "theora", "zstd", "ffmpeg")
"""Transports of image_transport: a topic's last part is one of these if it is not raw."""

DEPTH_HEADER: Final = struct.Struct("<iff")
"""ConfigHeader of compressed_depth_image_transport: format, and two parameters of the depth."""


def transport_of(topic: str) -> str:
    """Return the transport of an image's topic, empty if it is raw."""
    last = topic.rpartition("/")[2]
    return last if last in TRANSPORTS else ""


def raw_topic(topic: str) -> str:
    """Return the topic of an image without its transport."""
    return topic.removesuffix(f"/{transport_of(topic)}") if transport_of(topic) else topic


def camera_info_topic(topic: str) -> str:
    """Return the topic of an image's CameraInfo: `camera_info` in its namespace."""
    namespace, slash, _ = raw_topic(topic).rpartition("/")
    return f"{namespace}{slash}camera_info"


def is_rectified(topic: str) -> bool:
    """Return whether an image is rectified, by the convention of image_proc: image_rect."""
    return "rect" in raw_topic(topic).rpartition("/")[2]


def size_of(message: Any) -> tuple[int, int] | None:
    """Return the width and height of an Image or a CompressedImage, None where that is damaged."""
    if hasattr(message, "width"):
        return int(message.width), int(message.height)
    data = read_array(message.data, np.uint8)
    start = DEPTH_HEADER.size if "compressedDepth" in str(message.format) else 0
    try:
        pixels = cv2.imdecode(data[start:], cv2.IMREAD_UNCHANGED) if data.size > start else None
    except cv2.error:  # of a size that cannot be
        pixels = None
    return None if pixels is None else (pixels.shape[1], pixels.shape[0])


def read_image(message: Any, source: str = "image") -> Image:
    """Return the image of a sensor_msgs/Image, its data viewed; InputError as `Image.checked`."""
    return Image.checked(
        read_array(message.data, np.uint8),
        frame_id=str(message.header.frame_id).lstrip("/"),
        stamp_ns=read_time(message.header.stamp),
        encoding=str(message.encoding),
        is_bigendian=int(message.is_bigendian),
        shape=(int(message.height), int(message.width)),
        step=int(message.step),
        source=source,
    )


def encode_image(image: Image | CompressedImage) -> bytes:
    """Return a sensor_msgs/Image or CompressedImage."""
    writer = CdrWriter()
    writer.header(image.frame_id, image.stamp_ns)
    if isinstance(image, CompressedImage):
        writer.text(image.format)
        writer.numbers(image.data, "u1")
        return writer.message()
    height, step = image.data.shape
    writer.count(height)
    writer.count(image.width)
    writer.text(image.encoding)
    writer.byte(image.is_bigendian)
    writer.count(step)
    writer.numbers(image.data.reshape(-1), "u1")
    return writer.message()


def read_compressed_image(message: Any, source: str = "image") -> CompressedImage:
    """Return the image of a CompressedImage, its data viewed; InputError without frame or data."""
    frame_id, stamp_ns = read_header(message, source)
    data = read_array(message.data, np.uint8)
    if not data.size:
        raise InputError(f"{source}: data is empty")
    return CompressedImage(frame_id, stamp_ns, str(message.format), data)


# The CameraInfo: the numbers that a view model is made of.


def read_camera_info(message: Any, source: str = "camera_info") -> CameraInfo:
    """Return the numbers of a CameraInfo of ROS 2 (d, k, r, p) or of ROS 1 (D, K, R, P).

    Nothing is checked here: `CameraInfo.view` does that, with `source` in its sentences.
    """
    roi = message.roi
    return CameraInfo(
        width=int(message.width),
        height=int(message.height),
        distortion_model=str(message.distortion_model),
        d=_numbers(message, "d"),
        k=_numbers(message, "k"),
        r=_numbers(message, "r"),
        p=_numbers(message, "p"),
        binning_x=int(message.binning_x),
        binning_y=int(message.binning_y),
        roi=(int(roi.x_offset), int(roi.y_offset), int(roi.width), int(roi.height)),
        source=source,
        do_rectify=bool(roi.do_rectify),
    )


def encode_camera_info(info: CameraInfo, frame_id: str, stamp_ns: int) -> bytes:
    """Return a sensor_msgs/CameraInfo; k and r have nine numbers, p twelve."""
    writer = CdrWriter()
    writer.header(frame_id, stamp_ns)
    writer.count(info.height)
    writer.count(info.width)
    writer.text(info.distortion_model)
    writer.numbers(np.array(info.d), "<f8")
    writer.doubles(*info.k, *info.r, *info.p)
    writer.count(info.binning_x)
    writer.count(info.binning_y)
    writer.region(info.roi, do_rectify=info.do_rectify)
    return writer.message()


def _numbers(message: Any, name: str) -> tuple[float, ...]:
    values = getattr(message, name if hasattr(message, name) else name.upper())
    return tuple(read_array(values, np.float64).tolist())
