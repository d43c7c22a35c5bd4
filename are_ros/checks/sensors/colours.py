"""Painted images beside their inputs: which pixels changed, and the truth that was told of them.

Shares no code with what it judges: numpy, and OpenCV and Pillow for compressed images.
"""

import io
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from are_ros.checks.sensors.depth_images import name_parts
from are_ros.checks.sensors.scan_pairs import Kept, Pairs, Released
from are_ros.messages.common import read_time

Bools = NDArray[np.bool_]

_CHANNELS: Final = {
    "rgb8": 3,
    "bgr8": 3,
    "rgba8": 4,
    "bgra8": 4,
    "mono8": 1,
    **{f"bayer_{order}8": 1 for order in ("rggb", "bggr", "gbrg", "grbg")},
}
_LUMA_OF: Final = {"yuv422": 1, "uyvy": 1, "yuv422_yuy2": 0, "yuyv": 0}
"""Which of the two bytes of a pixel is its luma."""
_PAIR_PX: Final = 1
"""Two pixels of YUV share their colour, which changes if one of them is painted."""
_JPEG: Final = b"\xff\xd8\xff"
JPEG_BLOCK_PX: Final = 18
"""What is painted changes the whole block of 16 pixels of a JPEG, and two pixels about it."""
_JPEG_STEPS: Final = 6
"""Where nothing is painted, two compressors of the same image differ by at most this."""
_MOST_IMAGES: Final = 40
_MOST_WAITING: Final = 100


@dataclass(frozen=True, eq=False)
class ColourFrame:
    """The colours of an image: uint8 (H, W, C), and `data`, the bytes of the message.

    `rest` is all else that has to stay: sizes, names, bytes of padding. `spread_px` is how far from
    what is painted pixels may change. `light` is the channel that tells how bright a pixel is, None
    for all.
    """

    stamp_ns: int
    at_ns: int
    frame_id: str
    pixels: NDArray[np.uint8]
    data: bytes
    rest: tuple[Any, ...]
    spread_px: int = 0
    light: int | None = None

    @classmethod
    def of_message(cls, message: Any, at_ns: int) -> "ColourFrame | None":
        """Return the colours of an Image or CompressedImage; None of one that is not painted on.

        ValueError where the message is malformed.
        """
        when = read_time(message.header.stamp), at_ns, str(message.header.frame_id).lstrip("/")
        flat = np.asarray(message.data, np.uint8)
        if hasattr(message, "format"):
            if "compressedDepth" in message.format:
                return None
            pixels, data = _decompressed(flat), flat.tobytes()
            spread_px = JPEG_BLOCK_PX if data.startswith(_JPEG) else 0
            return cls(*when, pixels, data, (pixels.shape, str(message.format)), spread_px)
        luma = _LUMA_OF.get(message.encoding)
        channels = _CHANNELS.get(message.encoding) if luma is None else 2
        if channels is None:
            return None
        rows, used = flat.reshape(message.height, message.step), message.width * channels
        pixels = rows[:, :used].reshape(message.height, message.width, channels)
        sizes = message.height, message.width, message.step, message.encoding
        rest = (*sizes, bool(message.is_bigendian), rows[:, used:].tobytes())
        if luma is None:
            return cls(*when, pixels, flat.tobytes(), rest)
        return cls(*when, pixels, flat.tobytes(), rest, _PAIR_PX, luma)


def _decompressed(data: NDArray[np.uint8]) -> NDArray[np.uint8]:
    import cv2

    try:
        pixels = cv2.imdecode(data, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:  # of a size that cannot be
        pixels = None
    if pixels is None:
        raise ValueError("its data cannot be decompressed")
    found: NDArray[np.uint8] = np.asarray(pixels, np.uint8)
    return found


class Change(NamedTuple):
    """What differs between an image and its input: a fault, or which pixels (H, W).

    `is_brighter` are those of them that are brighter in a channel, as far as that can be told.
    """

    fault: str
    is_changed: Bools
    is_brighter: Bools


def change_of(real: ColourFrame, output: ColourFrame) -> Change:
    """Compare an output with its input."""
    none = np.zeros(real.pixels.shape[:2], np.bool_)
    if output.rest != real.rest:
        return Change("has another size, encoding or padding than its input", none, none)
    if output.data == real.data:
        return Change("", none, none)
    if output.spread_px == JPEG_BLOCK_PX:
        apart = np.abs(output.pixels.astype(np.int16) - _compressed_as(output, real))
        return Change("", np.any(apart > _JPEG_STEPS, axis=2), none)
    is_changed = np.any(output.pixels != real.pixels, axis=2)
    fault = "" if is_changed.any() else "has other bytes than its input, though nothing is painted"
    is_brighter = output.pixels > real.pixels
    light = slice(None) if real.light is None else slice(real.light, real.light + 1)
    return Change(fault, is_changed, np.any(is_brighter[:, :, light], axis=2))


def _compressed_as(output: ColourFrame, real: ColourFrame) -> NDArray[np.int16]:
    """Return what the input looks like if it is compressed by the tables of an output's JPEG."""
    from PIL import Image
    from PIL.JpegImagePlugin import get_sampling

    with Image.open(io.BytesIO(output.data)) as jpeg:
        tables, sampling, is_grey = jpeg.quantization, get_sampling(jpeg), jpeg.mode == "L"
    image = Image.fromarray(real.pixels[:, :, ::-1])
    buffer = io.BytesIO()
    if is_grey:
        image.convert("L").save(buffer, "JPEG", qtables=tables)
    else:
        image.save(buffer, "JPEG", qtables=tables, subsampling=sampling)
    return _decompressed(np.frombuffer(buffer.getvalue(), np.uint8)).astype(np.int16)


@dataclass(frozen=True, eq=False)
class Painted(Released):
    """A changed image, with the CameraInfo that was known then, None if there was none."""

    change: Change
    spread_px: int
    info: Any
    is_rectified: bool


class Region(NamedTuple):
    """The smallest rectangle around the pixels of an artefact in a mask, and their number."""

    x: int
    y: int
    width: int
    height: int
    pixels: int


@dataclass(frozen=True, eq=False)
class Mask:
    """The ids (H, W) of a mask, packed."""

    shape: tuple[int, int]
    packed: bytes
    regions: Mapping[int, Region]

    @classmethod
    def of_message(cls, message: Any) -> "Mask":
        """Return the mask of an Image (32SC1); ValueError where it is none."""
        if message.encoding != "32SC1":
            raise ValueError(f"a mask is 32SC1, not {message.encoding}")
        rows = np.asarray(message.data, np.uint8).reshape(message.height, message.step)
        kind = ">i4" if message.is_bigendian else "<i4"
        ids = np.ascontiguousarray(rows[:, : 4 * message.width]).view(kind).astype(np.int32)
        return cls(ids.shape, zlib.compress(ids.tobytes(), 1), _regions(ids))

    @property
    def ids(self) -> NDArray[np.int32]:
        """The ids (H, W), 0 where there is no artefact."""
        return np.frombuffer(zlib.decompress(self.packed), np.int32).reshape(self.shape)


def _regions(ids: NDArray[np.int32]) -> dict[int, Region]:
    found = {}
    rows, columns = np.nonzero(ids)
    numbers = ids[rows, columns]
    for number in np.unique(numbers).tolist():
        y, x = rows[numbers == number], columns[numbers == number]
        size = int(np.ptp(x)) + 1, int(np.ptp(y)) + 1
        found[number] = Region(int(x.min()), int(y.min()), *size, len(x))
    return found


class ImagePairs(Pairs):
    """The painted images beside their inputs.

    `masks`, `truths` and `boxes` are what was told of images, by the image's topic and stamp.
    `faults` are those of images that need no geometry, `changed` some of the changed ones.
    """

    def __init__(self) -> None:
        super().__init__()
        self.unchanged = 0
        self.faults: list[tuple[str, int, str]] = []
        self.changed = Kept[Painted](_MOST_IMAGES)
        self.unpainted: set[tuple[str, int]] = set()
        self.masks: dict[tuple[str, int], Mask] = {}
        self.truths: dict[tuple[str, int], Any] = {}
        self.boxes: dict[tuple[str, int], Any] = {}

    def add(self, topic: str, frame: ColourFrame, info_of: Callable[[str], Any]) -> None:
        """Take an image of any topic; `info_of` returns the last CameraInfo of a topic's images."""
        for pair in self.matched(topic, frame, _MOST_WAITING):
            self._compare(*pair, info_of)

    def add_told(self, topic: str, message: Any) -> None:
        """Take what was told of an image beside it: a mask, ImageTruth or Detection2DArray."""
        image, _, kind = topic.rpartition("/")
        key = image, read_time(message.header.stamp)
        if kind == "mask":
            self.masks[key] = Mask.of_message(message)
        elif kind == "truth":
            self.truths[key] = message
        else:
            self.boxes[key] = message

    def _compare(
        self,
        source: str,
        real: ColourFrame,
        topic: str,
        output: ColourFrame,
        info_of: Callable[[str], Any],
    ) -> None:
        change = change_of(real, output)
        if change.fault:
            self.faults.append((topic, output.stamp_ns, change.fault))
            return
        if output.data == real.data:
            self.unchanged += 1
            self.unpainted.add((topic, output.stamp_ns))
            return
        is_rectified = "rect" in name_parts(source)[1]
        info = info_of(source)
        when = output.stamp_ns, output.at_ns, output.frame_id
        self.changed.add(Painted(topic, *when, change, output.spread_px, info, is_rectified))
