"""Augmented images of depths beside their inputs: which pixels changed, and whether they may.

Shares no code with what it judges: numpy, and OpenCV for PNG.
"""

import struct
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from are_ros.bag.decoded import time_ns

Floats = NDArray[np.float64]

_KINDS: Final = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
_HEADER: Final = struct.Struct("<iff")
_MILLIMETRES, _METRES, _INVERSE = range(3)


@dataclass(frozen=True, eq=False)
class DepthFrame:
    """The depths of an image: numbers (H, W) as they are stored, and what they mean.

    `rest` is all else that has to stay: sizes, names, bytes of padding.
    """

    stamp_ns: int
    at_ns: int
    frame_id: str
    numbers: NDArray[Any]
    rest: tuple[Any, ...]
    code: int
    ab: tuple[float, float] = (0.0, 0.0)

    @property
    def depths_m(self) -> Floats:
        """The depths (H, W): NaN where there is none, -inf where the pixel says too close."""
        stored = self.numbers.astype(np.float64)
        if self.code == _METRES:
            is_some = np.isfinite(stored) & (np.nan_to_num(stored) > 0.0)
            return np.where(is_some | np.isneginf(stored), stored, np.nan)
        none = stored == 0.0
        stored[none] = np.nan
        if self.code == _MILLIMETRES:
            return stored / 1000.0
        return self.ab[0] / (stored - self.ab[1])

    def half_steps_m(self, depths_m: Floats) -> Floats:
        """Return half of what neighbouring numbers are apart at depths [m]."""
        if self.code == _MILLIMETRES:
            return np.full_like(depths_m, 5e-4)
        if self.code == _METRES:
            return 1e-7 * np.abs(depths_m)
        return 0.5 * depths_m * depths_m / self.ab[0]

    @property
    def farthest_m(self) -> float:
        """The largest depth that there is a number for."""
        last = self.ab[0] / (1.0 - self.ab[1]) if self.code == _INVERSE else np.inf
        return 65.535 if self.code == _MILLIMETRES else last

    def numbers_of(self, depths_m: Floats) -> Floats:
        """Return the numbers, unrounded, of depths [m], finite or 0."""
        if self.code == _METRES:
            return depths_m
        if self.code == _MILLIMETRES:
            return 1000.0 * depths_m
        return self.ab[0] / np.maximum(depths_m, 1e-9) + self.ab[1]

    @classmethod
    def of_message(cls, message: Any, at_ns: int) -> "DepthFrame | None":
        """Return the depths of an Image or CompressedImage; None of one that holds none.

        ValueError where the message is malformed.
        """
        when = time_ns(message.header.stamp), at_ns, str(message.header.frame_id).lstrip("/")
        if hasattr(message, "format"):
            return cls._of_compressed(message, *when)
        if message.encoding not in _KINDS:
            return None
        kind = np.dtype((">" if message.is_bigendian else "<") + _KINDS[message.encoding])
        rows = np.asarray(message.data, np.uint8).reshape(message.height, message.step)
        used = message.width * kind.itemsize
        numbers = np.ascontiguousarray(rows[:, :used]).view(kind)
        sizes = message.height, message.width, message.step
        rest = (*sizes, message.encoding, bool(message.is_bigendian), rows[:, used:].tobytes())
        code = _METRES if message.encoding == "32FC1" else _MILLIMETRES
        return cls(*when, numbers, rest, code)

    @classmethod
    def _of_compressed(
        cls, message: Any, stamp_ns: int, at_ns: int, frame_id: str
    ) -> "DepthFrame | None":
        import cv2

        encoding, _, transport = str(message.format).partition(";")
        if "compressedDepth" not in transport or encoding.strip() not in _KINDS:
            return None
        data = np.asarray(message.data, np.uint8)
        numbers = cv2.imdecode(data[_HEADER.size :], cv2.IMREAD_UNCHANGED)
        if numbers is None or numbers.ndim != 2:
            raise ValueError("its PNG cannot be decoded")
        _, a, b = _HEADER.unpack(data[: _HEADER.size].tobytes())
        is_inverse = encoding.strip() == "32FC1"
        rest = (numbers.shape, message.format, data[: _HEADER.size].tobytes())
        code = _INVERSE if is_inverse else _MILLIMETRES
        return cls(stamp_ns, at_ns, frame_id, numbers, rest, code, (a, b))


def changed_pixels(
    real: DepthFrame, output: DepthFrame
) -> tuple[str, NDArray[np.int64], NDArray[np.bool_]]:
    """Return a fault or "", which pixels (M,) changed, in one row, and which had no return.

    Pixels may only come nearer, or get a depth where they had none.
    """
    none = np.empty(0, np.int64), np.empty(0, np.bool_)
    if output.rest != real.rest:
        return ("has another size, encoding or padding than its input", *none)
    one = np.ascontiguousarray(real.numbers).view(f"V{real.numbers.itemsize}").ravel()
    other = np.ascontiguousarray(output.numbers).view(f"V{output.numbers.itemsize}").ravel()
    which = np.flatnonzero(one != other)
    before, after = real.depths_m.ravel()[which], output.depths_m.ravel()[which]
    had = np.isfinite(before)
    is_inside = (~np.isfinite(after)) & had
    wrong = np.isneginf(before) | (had & ~is_inside & ~(after < before)) | (~had & np.isnan(after))
    if wrong.any():
        first = int(np.argmax(wrong))
        row, column = divmod(int(which[first]), real.numbers.shape[1])
        numbers = f"{after[first]:g} m in row {row}, column {column}"
        return (f"has {numbers}, where its input has {before[first]:g} m", *none)
    return "", which, ~had


@dataclass(frozen=True, eq=False)
class DepthPair:
    """An image of depths and what came out, with the CameraInfo that was known then."""

    topic: str
    real: DepthFrame
    output: DepthFrame
    info: Any
    is_rectified: bool
