"""sensor_msgs/Image <-> arrays of pixels."""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import InputError
from are_ros.messages.arrays import read_array
from are_ros.messages.factory import MessageFactory

ENCODINGS: Final[dict[str, tuple[str, int]]] = {
    "mono8": ("u1", 1),
    "8UC1": ("u1", 1),
    "mono16": ("u2", 1),
    "16UC1": ("u2", 1),
    "32FC1": ("f4", 1),
    "rgb8": ("u1", 3),
    "bgr8": ("u1", 3),
    "8UC3": ("u1", 3),
    "rgba8": ("u1", 4),
    "bgra8": ("u1", 4),
    "8UC4": ("u1", 4),
}
"""Encodings that are read, with the numpy kind of a value and the number of channels."""


def read_image(message: Any, source: str = "image") -> npt.NDArray[Any]:
    """Return the pixels (height, width), or (height, width, channels), as the message has them.

    uint8, uint16 or float32 in this machine's byte order; a view where that allows it. InputError
    for an encoding that is not in `ENCODINGS`, or a step or data that do not fit the size.
    """
    pixels = _pixels(message, read_array(message.data, np.uint8), source)
    return pixels.astype(pixels.dtype.newbyteorder("="), copy=False)


def replace_pixels(
    factory: MessageFactory, message: Any, pixels: npt.NDArray[Any], source: str = "image"
) -> Any:
    """Return a copy of an Image with other pixels, of the shape that `read_image` gives.

    Everything else stays to the byte, padding too. InputError as `read_image`.
    """
    data = read_array(message.data, np.uint8).copy()
    _pixels(message, data, source)[...] = pixels
    return factory.make(
        "sensor_msgs/msg/Image",
        header=message.header,
        height=message.height,
        width=message.width,
        encoding=message.encoding,
        is_bigendian=message.is_bigendian,
        step=message.step,
        data=data,
    )


def _pixels(message: Any, data: npt.NDArray[np.uint8], source: str) -> npt.NDArray[Any]:
    """Return a view of `data` as pixels."""
    if message.encoding not in ENCODINGS:
        known = ", ".join(ENCODINGS)
        raise InputError(f"{source}: encoding {message.encoding!r} is none of {known}")
    kind, channels = ENCODINGS[message.encoding]
    dtype = np.dtype((">" if message.is_bigendian else "<") + kind)
    pixel_bytes = dtype.itemsize * channels
    if message.step < message.width * pixel_bytes:
        raise InputError(
            f"{source}: step {message.step} is less than width {message.width}"
            f" x {pixel_bytes} bytes"
        )
    if data.size != message.height * message.step:
        raise InputError(
            f"{source}: data has {data.size} bytes, but height {message.height} x step"
            f" {message.step} = {message.height * message.step}"
        )
    shape = (message.height, message.width, channels)
    strides = (message.step, pixel_bytes, dtype.itemsize)
    pixels: npt.NDArray[Any] = np.ndarray(shape, dtype=dtype, buffer=data, strides=strides)
    return pixels[:, :, 0] if channels == 1 else pixels
