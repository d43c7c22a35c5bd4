"""Values as little-endian XCDR1, the bytes of ROS 2 messages."""

from collections.abc import Sequence
from struct import Struct, pack
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.errors import InputError
from are_ros.world.rigid_transform import RigidTransform

_ENCAPSULATION: Final = b"\x00\x01\x00\x00"
_STAMP: Final = Struct("<iI")
_COUNT: Final = Struct("<I")
_REGION: Final = Struct("<4I?")


def pack_time(time_ns: int) -> bytes:
    """Return the eight bytes of a Time or a Duration; struct.error beyond 68 years from 0."""
    return _STAMP.pack(*divmod(time_ns, NS_PER_S))


def encapsulated(body: bytes | bytearray) -> bytes:
    """Return a message of its body."""
    return _ENCAPSULATION + body


class CdrWriter:
    """Appends values to the body of a message, or to a part of it, padding with zeros.

    Numbers are aligned to their size from the beginning of the body. A part begins `phase` bytes
    (0 to 7) after a multiple of eight bytes.
    """

    def __init__(self, phase: int = 0) -> None:
        self._phase = phase
        self._body = bytearray(phase)

    def align(self, alignment: int) -> None:
        """Pad to a multiple of `alignment` bytes."""
        self._body += bytes(-len(self._body) % alignment)

    def pack(self, form: Struct, alignment: int, *values: float) -> None:
        """Append numbers; struct.error where one does not fit the form."""
        self.align(alignment)
        self._body += form.pack(*values)

    def doubles(self, *values: float) -> None:
        """Append numbers of float64, without their count."""
        self.align(8)
        self._body += pack(f"<{len(values)}d", *values)

    def pose(self, pose: RigidTransform) -> None:
        """Append a geometry_msgs/Pose."""
        self.doubles(*pose.translation_m.tolist(), *pose.rotation_xyzw.tolist())

    def region(self, roi_px: tuple[int, int, int, int], *, do_rectify: bool = False) -> None:
        """Append a sensor_msgs/RegionOfInterest of x, y, width and height."""
        x, y, width, height = roi_px
        self.pack(_REGION, 4, x, y, height, width, do_rectify)

    def byte(self, value: int) -> None:
        """Append a number from 0 to 255, or a bool."""
        self._body.append(value)

    def count(self, length: int) -> None:
        """Append the length of a sequence."""
        self.pack(_COUNT, 4, length)

    def text(self, text: str) -> None:
        """Append a string; InputError if it holds the character NUL, which would end it."""
        if "\0" in text:
            raise InputError(f"a message's text cannot hold the character NUL: {text!r}")
        data = text.encode()
        self.count(len(data) + 1)
        self._body += data + b"\0"

    def texts(self, texts: Sequence[str]) -> None:
        """Append a sequence of strings; InputError as `text`."""
        self.count(len(texts))
        for text in texts:
            self.text(text)

    def numbers(self, values: npt.NDArray[Any], dtype: str) -> None:
        """Append a sequence of numbers (N,), or of structures of equal numbers (N, k)."""
        self.count(len(values))
        if len(values):
            self.align(np.dtype(dtype).itemsize)
            self._body += values.astype(dtype, copy=False).tobytes()

    def time(self, time_ns: int) -> None:
        """Append a Time or a Duration."""
        self.align(4)
        self._body += pack_time(time_ns)

    def header(self, frame_id: str, stamp_ns: int) -> None:
        """Append a std_msgs/Header."""
        self.time(stamp_ns)
        self.text(frame_id)

    def part(self) -> bytes:
        """Return the bytes of the part."""
        return bytes(self._body[self._phase :])

    def message(self) -> bytes:
        """Return the message, or its beginning, with the encapsulation header."""
        return encapsulated(self._body)
