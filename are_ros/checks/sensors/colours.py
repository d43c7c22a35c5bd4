"""Painted images beside their inputs: which pixels changed, and the truth that was told of them.

Shares no code with what it judges: numpy, and OpenCV and Pillow for compressed images.
"""

import io
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from are_ros.bag.decoded import time_ns
from are_ros.bag.recording import PREFIX
from are_ros.checks.sensors.depth_images import info_topic, name_parts
from are_ros.checks.sensors.scan_pairs import Kept

Bools = NDArray[np.bool_]

_CHANNELS: Final = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1}
_JPEG: Final = b"\xff\xd8\xff"
_JPEG_BLOCK_PX: Final = 18
"""What is painted changes the whole block of 16 pixels of a JPEG, and two pixels about it."""
_JPEG_STEPS: Final = 6
"""Where nothing is painted, two compressors of the same image differ by at most this."""
_MOST_IMAGES: Final = 40
_MOST_WAITING: Final = 100


@dataclass(frozen=True, eq=False)
class ColourFrame:
    """The colours of an image: uint8 (H, W, C), and `data`, the bytes of the message.

    `rest` is all else that has to stay: sizes, names, bytes of padding. `spread_px` is how far from
    what is painted pixels may change.
    """

    stamp_ns: int
    at_ns: int
    frame_id: str
    pixels: NDArray[np.uint8]
    data: bytes
    rest: tuple[Any, ...]
    spread_px: int = 0

    @classmethod
    def of_message(cls, message: Any, at_ns: int) -> "ColourFrame | None":
        """Return the colours of an Image or CompressedImage; None of one that is not painted on.

        ValueError where the message is malformed.
        """
        when = time_ns(message.header.stamp), at_ns, str(message.header.frame_id).lstrip("/")
        flat = np.asarray(message.data, np.uint8)
        if hasattr(message, "format"):
            if "compressedDepth" in message.format:
                return None
            pixels, data = _decompressed(flat), flat.tobytes()
            spread_px = _JPEG_BLOCK_PX if data.startswith(_JPEG) else 0
            return cls(*when, pixels, data, (pixels.shape, str(message.format)), spread_px)
        channels = _CHANNELS.get(message.encoding)
        if channels is None:
            return None
        rows, used = flat.reshape(message.height, message.step), message.width * channels
        pixels = rows[:, :used].reshape(message.height, message.width, channels)
        sizes = message.height, message.width, message.step, message.encoding
        rest = (*sizes, bool(message.is_bigendian), rows[:, used:].tobytes())
        return cls(*when, pixels, flat.tobytes(), rest)


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
    if output.spread_px:
        apart = np.abs(output.pixels.astype(np.int16) - _compressed_as(output, real))
        return Change("", _in_any_channel(apart > _JPEG_STEPS), none)
    is_changed = _in_any_channel(output.pixels != real.pixels)
    fault = "" if is_changed.any() else "has other bytes than its input, though nothing is painted"
    return Change(fault, is_changed, _in_any_channel(output.pixels > real.pixels))


def _in_any_channel(condition: Bools) -> Bools:
    return np.asarray(condition.any(axis=2))


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
class Painted:
    """A changed image, with the CameraInfo that was known then, None if there was none."""

    topic: str
    stamp_ns: int
    released_ns: int
    frame_id: str
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


_Waiting = dict[tuple[int, str], list[tuple[str, ColourFrame]]]


@dataclass(eq=False)
class ImagePairs:
    """Finds the input of each painted image by stamp and frame, whichever comes first.

    `masks`, `truths` and `boxes` are what was told of images, by the image's topic and stamp.
    `faults` are those of images that need no geometry, `changed` some of the changed ones.
    """

    pairs: int = 0
    unchanged: int = 0
    faults: list[tuple[str, int, str]] = field(default_factory=list)
    changed: Kept[Painted] = field(default_factory=lambda: Kept[Painted](_MOST_IMAGES))
    unpainted: set[tuple[str, int]] = field(default_factory=set)
    masks: dict[tuple[str, int], Mask] = field(default_factory=dict)
    truths: dict[tuple[str, int], Any] = field(default_factory=dict)
    boxes: dict[tuple[str, int], Any] = field(default_factory=dict)
    inputs: set[str] = field(default_factory=set)
    _inputs: _Waiting = field(default_factory=dict)
    _outputs: _Waiting = field(default_factory=dict)

    def add(self, topic: str, frame: ColourFrame, infos: Mapping[str, Any]) -> None:
        """Take an image of any topic; `infos` are the last CameraInfos by topic."""
        key = frame.stamp_ns, frame.frame_id
        waiting = self._outputs if topic.startswith(PREFIX) else self._inputs
        if not topic.startswith(PREFIX):
            self.inputs.add(topic)
        waiting.setdefault(key, []).append((topic, frame))
        while len(self._inputs) > _MOST_WAITING:  # the node does not paint on this camera's
            del self._inputs[next(iter(self._inputs))]
        self._match(key, infos)

    def add_told(self, topic: str, message: Any) -> None:
        """Take what was told of an image beside it: a mask, ImageTruth or Detection2DArray."""
        image, _, kind = topic.rpartition("/")
        key = image, time_ns(message.header.stamp)
        if kind == "mask":
            self.masks[key] = Mask.of_message(message)
        elif kind == "truth":
            self.truths[key] = message
        else:
            self.boxes[key] = message

    def unmatched(self) -> list[tuple[str, int]]:
        """Return topic and stamp of the painted images that have no input."""
        return [(topic, key[0]) for key, all_ in self._outputs.items() for topic, _ in all_]

    def _match(self, key: tuple[int, str], infos: Mapping[str, Any]) -> None:
        inputs, outputs = self._inputs.get(key, []), self._outputs.get(key, [])
        for output in list(outputs):
            name = output[0].removeprefix(PREFIX)
            own = [one for one in inputs if one[0].lstrip("/") == name]
            source = next(iter(own or (inputs if len(self.inputs) == 1 else ())), None)
            if source is not None:
                inputs.remove(source)
                outputs.remove(output)
                self._compare(*source, *output, infos)
        for waiting in (self._inputs, self._outputs):
            if key in waiting and not waiting[key]:
                del waiting[key]

    def _compare(
        self,
        source: str,
        real: ColourFrame,
        topic: str,
        output: ColourFrame,
        infos: Mapping[str, Any],
    ) -> None:
        self.pairs += 1
        change = change_of(real, output)
        if change.fault:
            self.faults.append((topic, output.stamp_ns, change.fault))
            return
        if output.data == real.data:
            self.unchanged += 1
            self.unpainted.add((topic, output.stamp_ns))
            return
        is_rectified = "rect" in name_parts(source)[1]
        info = infos.get(info_topic(source))
        when = output.stamp_ns, output.at_ns, output.frame_id
        self.changed.add(Painted(topic, *when, change, output.spread_px, info, is_rectified))
