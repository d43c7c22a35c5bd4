"""Images of depths <-> messages: raw, and the compressedDepth of image_transport."""

import struct
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.sensors.depth_image import (
    DepthCode,
    DepthImage,
    InverseDepth,
    Metres,
    RawDepth,
    code_of,
)
from are_ros.builder.sensors.image import CompressedImage
from are_ros.errors import InputError
from are_ros.messages.images.image import (
    DEPTH_HEADER,
    encode_image,
    read_compressed_image,
    read_image,
)

_PNG: Final = struct.Struct(">8sI4sIIBB")
"""The beginning of a PNG: signature, length and name of IHDR, width, height, bits, colour type."""
_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_GREY_16: Final = (16, 0)
_PNG_LEVEL: Final = 3
"""Level of compression: 9, the usual one here, takes 20 times as long for a fifth less."""


@dataclass(frozen=True, eq=False)
class CompressedDepth:
    """The pixels of a compressedDepth: a header of twelve bytes, and a PNG of 16 bits.

    16UC1 holds millimetres, 32FC1 the inverse depth in steps that the header tells. The PNG is
    decompressed when the numbers are asked for.
    """

    image: CompressedImage
    shape: tuple[int, int]
    code: DepthCode

    @classmethod
    def checked(cls, image: CompressedImage, source: str = "depth") -> "CompressedDepth":
        """Return the pixels of an image; InputError, which begins with `source`, if it has none."""
        encoding, _, transport = (part.strip() for part in image.format.partition(";"))
        if not transport.startswith("compressedDepth"):
            raise InputError(f"{source}: format {image.format!r} is no compressedDepth")
        if "rvl" in transport.lower():
            raise InputError(
                f"{source}: format {image.format!r}: RVL is not decoded; let the camera's publisher"
                " compress to png"
            )
        try:
            code = code_of(encoding)
            if isinstance(code, Metres):
                code = _inverse_depth(image.data)
            return cls(image, _size_of_png(image.data[DEPTH_HEADER.size :]), code)
        except InputError as cause:
            raise InputError(f"{source}: {cause}") from cause

    def stored(self) -> npt.NDArray[Any]:
        """Return the numbers uint16 (H, W); InputError if the PNG is damaged."""
        import cv2

        try:
            numbers = cv2.imdecode(self.image.data[DEPTH_HEADER.size :], cv2.IMREAD_UNCHANGED)
        except cv2.error:  # of a size that cannot be
            numbers = None
        if numbers is None or numbers.shape != self.shape or numbers.dtype != np.uint16:
            raise InputError("its PNG is damaged")
        pixels: npt.NDArray[Any] = numbers
        return pixels

    def with_stored(self, stored: npt.NDArray[Any]) -> "CompressedDepth":
        """Return the pixels with other numbers; header and format stay."""
        import cv2

        _, png = cv2.imencode(".png", stored, [cv2.IMWRITE_PNG_COMPRESSION, _PNG_LEVEL])
        data = np.concatenate((self.image.data[: DEPTH_HEADER.size], png.reshape(-1)))
        return replace(self, image=replace(self.image, data=data))


def _inverse_depth(data: npt.NDArray[np.uint8]) -> InverseDepth:
    if data.size < DEPTH_HEADER.size:
        raise InputError(f"data has {data.size} bytes, and its header alone {DEPTH_HEADER.size}")
    _, a, b = DEPTH_HEADER.unpack(data[: DEPTH_HEADER.size].tobytes())
    return InverseDepth(a, b)


def _size_of_png(data: npt.NDArray[np.uint8]) -> tuple[int, int]:
    """Return height and width of a grey PNG of 16 bits; InputError if it is none."""
    if data.size < _PNG.size:
        raise InputError("data hold no PNG after the header of 12 bytes")
    signature, _, name, width, height, *kind = _PNG.unpack(data[: _PNG.size].tobytes())
    if signature != _SIGNATURE or name != b"IHDR":
        raise InputError("data hold no PNG after the header of 12 bytes")
    if tuple(kind) != _GREY_16:
        raise InputError(f"its PNG has {kind[0]} bits and colour type {kind[1]}, not 16 and grey")
    if width < 1 or height < 1:
        raise InputError(f"its PNG of width {width} x height {height} has no pixel")
    return height, width


def read_depth(message: Any, source: str = "depth") -> DepthImage:
    """Return the depths of an Image or a CompressedImage, still without a lens; InputError."""
    if hasattr(message, "format"):
        image = read_compressed_image(message, source)
        return DepthImage(CompressedDepth.checked(image, source))
    try:
        code_of(str(message.encoding))
    except InputError as cause:
        raise InputError(f"{source}: {cause}") from cause
    return DepthImage(RawDepth(read_image(message, source)))


def encode_depth(depth: DepthImage) -> bytes:
    """Return a sensor_msgs/Image or CompressedImage, as it was read."""
    return encode_image(depth.pixels.image)
