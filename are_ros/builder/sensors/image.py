"""Images as they were received (sensor_msgs/Image, CompressedImage), pixels and bytes."""

import re
import struct
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.errors import InputError

_Bytes = npt.NDArray[np.uint8]

_NAMED: Final = {
    **dict.fromkeys(("rgb8", "bgr8"), ("u1", 3)),
    **dict.fromkeys(("rgba8", "bgra8"), ("u1", 4)),
    **dict.fromkeys(("rgb16", "bgr16"), ("u2", 3)),
    **dict.fromkeys(("rgba16", "bgra16"), ("u2", 4)),
    "mono8": ("u1", 1),
    "mono16": ("u2", 1),
    **{f"bayer_{order}8": ("u1", 1) for order in ("rggb", "bggr", "gbrg", "grbg")},
    **{f"bayer_{order}16": ("u2", 1) for order in ("rggb", "bggr", "gbrg", "grbg")},
    **dict.fromkeys(("yuv422", "yuv422_yuy2", "uyvy", "yuyv"), ("u1", 2)),
}
"""The encodings of sensor_msgs/image_encodings that have a name: numpy format, channels."""

_GENERIC: Final = re.compile(r"(8U|8S|16U|16S|32S|32F|64F)C([1-9]\d?)?")
_FORMATS: Final = {
    "8U": "u1",
    "8S": "i1",
    "16U": "u2",
    "16S": "i2",
    "32S": "i4",
    "32F": "f4",
    "64F": "f8",
}


MINIATURE_PX: Final = (32, 24)
"""Width and height of the images, and of their lens, with which `warm_up` compiles kernels."""


def pixel_layout(encoding: str) -> tuple[str, int] | None:
    """Return the numpy format of a number and the channels of a pixel, None if it is not known.

    The format has no byte order. `encoding` is a name of sensor_msgs/image_encodings.
    """
    if encoding in _NAMED:
        return _NAMED[encoding]
    found = _GENERIC.fullmatch(encoding)
    return (_FORMATS[found[1]], int(found[2] or 1)) if found else None


@dataclass(frozen=True, eq=False)
class Image:
    """H x W pixels as they were received, in the optical frame of their camera.

    `data` is uint8 (H, step) and becomes read-only; each row begins with W pixels, and may have
    padding after them. `is_bigendian` is the message's number: 0 is little-endian. Numbers from
    outside must come through `checked`.
    """

    frame_id: str
    stamp_ns: int
    encoding: str
    is_bigendian: int
    width: int
    data: _Bytes

    def __post_init__(self) -> None:
        data = self.data.view()
        data.flags.writeable = False
        object.__setattr__(self, "data", data)

    @classmethod
    def checked(
        cls,
        data: _Bytes,
        *,
        frame_id: str,
        stamp_ns: int,
        encoding: str,
        is_bigendian: int,
        shape: tuple[int, int],
        step: int,
        source: str = "image",
    ) -> "Image":
        """Return an image of `data` uint8 (N,); `shape` is height and width, `step` bytes per row.

        InputError, whose sentence begins with `source`, if the frame is empty, the encoding is not
        known, there is no pixel, or size, step and data do not fit together.
        """
        height, width = shape
        if not frame_id:
            raise InputError(f"{source}: header.frame_id is empty")
        layout = pixel_layout(encoding)
        if layout is None:
            raise InputError(f"{source}: encoding {encoding!r} is not known")
        if height < 1 or width < 1:
            raise InputError(f"{source}: width {width} x height {height} has no pixel")
        row_bytes = width * layout[1] * np.dtype(layout[0]).itemsize
        if step < row_bytes:
            raise InputError(
                f"{source}: step {step} is less than the {row_bytes} bytes of {width} pixels"
                f" {encoding}"
            )
        if data.size != height * step:
            raise InputError(
                f"{source}: data has {data.size} bytes, but height {height} x step {step}"
                f" = {height * step}"
            )
        return cls(frame_id, stamp_ns, encoding, is_bigendian, width, data.reshape(height, step))

    @classmethod
    def miniature(cls, frame_id: str, stamp_ns: int, encoding: str, pixel: bytes) -> "Image":
        """Return a small image of an encoding, all its pixels alike, for `warm_up`."""
        width, height = MINIATURE_PX
        data = np.tile(np.frombuffer(pixel, np.uint8), (height, width))
        return cls(frame_id, stamp_ns, encoding, 0, width, data)

    @property
    def height(self) -> int:
        """The number of rows."""
        return len(self.data)

    def pixels(self) -> npt.NDArray[Any]:
        """Return a read-only view (H, W), or (H, W, C) of C > 1 channels, without the padding.

        Its dtype has the byte order of the message.
        """
        return self._viewed(self.data)

    def with_pixels(self, pixels: npt.NDArray[Any]) -> "Image":
        """Return the image with other pixels, shaped as `pixels()`; its padding stays."""
        data = self.data.copy()
        self._viewed(data)[...] = pixels
        return replace(self, data=data)

    def _viewed(self, data: _Bytes) -> npt.NDArray[Any]:
        number, channels = _known_layout(self.encoding)
        dtype = np.dtype((">" if self.is_bigendian else "<") + number)
        rows = data[:, : self.width * channels * dtype.itemsize].view(dtype)
        if channels == 1:
            return rows
        return rows.reshape(self.height, self.width, channels)


def _known_layout(encoding: str) -> tuple[str, int]:
    layout = pixel_layout(encoding)
    if layout is None:
        raise InputError(f"image: encoding {encoding!r} is not known")
    return layout


@dataclass(frozen=True, eq=False)
class CompressedImage:
    """An image as it was received: `data` uint8 (N,) is a file (PNG, JPEG) as `format` says.

    `data` becomes read-only. Of depths, a header of twelve bytes goes before the file.
    """

    frame_id: str
    stamp_ns: int
    format: str
    data: _Bytes

    def __post_init__(self) -> None:
        data = self.data.view()
        data.flags.writeable = False
        object.__setattr__(self, "data", data)


class PictureHeader(NamedTuple):
    """What a JPEG or PNG says of itself: its size, the numbers of a pixel, and their bits."""

    suffix: str
    width: int
    height: int
    channels: int
    bits: int


_JPEG, _PNG = b"\xff\xd8\xff", b"\x89PNG"
_PNG_HEADER: Final = struct.Struct(">16xIIBB")
_PNG_CHANNELS: Final = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
_JPEG_FRAME: Final = struct.Struct(">BHHB")
_FRAMES: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""JPEG's markers of a frame's header."""
_WITHOUT_LENGTH: Final = frozenset((0x01, *range(0xD0, 0xD9)))


def picture_header(data: _Bytes) -> PictureHeader:
    """Return the header of a JPEG or PNG, uint8 (N,); InputError if it is none, or damaged."""
    head = data[: _PNG_HEADER.size].tobytes()
    try:
        if head.startswith(_PNG):
            width, height, bits, colour = _PNG_HEADER.unpack(head)
            return PictureHeader(".png", width, height, _PNG_CHANNELS[colour], bits)
        if head.startswith(_JPEG):
            return _jpeg_header(data.tobytes())
    except (struct.error, IndexError, KeyError) as cause:
        raise InputError("its data are damaged") from cause
    raise InputError("its data are neither JPEG nor PNG")


def _jpeg_header(data: bytes) -> PictureHeader:
    """Return the header of a JPEG; struct.error or IndexError if it has none."""
    at = 2
    while True:
        while data[at + 1] == 0xFF:  # bytes that fill up
            at += 1
        marker = data[at + 1]
        if marker in _FRAMES:
            bits, height, width, channels = _JPEG_FRAME.unpack_from(data, at + 4)
            return PictureHeader(".jpg", width, height, channels, bits)
        at += 2
        if marker not in _WITHOUT_LENGTH:
            at += max(2, int.from_bytes(data[at : at + 2], "big"))
