"""A MarkerArray decoded from its bytes, as plain values.

Recordings hold millions of mesh corners: they are decoded as arrays, not as objects.
"""

from struct import Struct
from struct import error as StructError  # noqa: N812
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from are_ros.conventions import NS_PER_S
from are_ros.wording import counted

ADD, DELETE, DELETE_ALL = 0, 2, 3
ARROW, CUBE, TEXT, TRIANGLES = 0, 1, 9, 11

_STAMP, _INTEGERS, _COUNT = Struct("<iI"), Struct("<3i"), Struct("<I")
_POSE_AND_SCALE, _COLOUR, _LIFETIME = Struct("<10d"), Struct("<4f"), Struct("<iIB")
_FLAG: Final = Struct("<B")


class MarkerFields(NamedTuple):
    """One visualization_msgs/Marker; lengths in metres, in `frame_id` and relative to the pose.

    `position` (3,), `rotation_xyzw` (4,), `scale` (3,), `points` (N, 3) float64; `colour` (4,) and
    `colours` (M, 4) red, green, blue, alpha as they came; `texture_points` counts the coordinates
    of a texture.
    """

    stamp_ns: int
    frame_id: str
    namespace: str
    number: int
    kind: int
    action: int
    position: NDArray[np.float64]
    rotation_xyzw: NDArray[np.float64]
    scale: NDArray[np.float64]
    colour: NDArray[np.float64]
    lifetime_ns: int
    is_frame_locked: bool
    points: NDArray[np.floating]
    colours: NDArray[np.floating]
    texture_points: int
    text: str
    mesh: str
    keeps_materials: bool


class CdrCursor:
    """A cursor over little-endian XCDR1; ValueError for other bytes."""

    def __init__(self, data: bytes) -> None:
        if data[:2] != b"\x00\x01":
            raise ValueError("is no little-endian CDR")
        self._data = data
        self._at = 4

    def unpack(self, form: Struct, alignment: int = 4) -> tuple[float, ...]:
        """Return the numbers of a form."""
        self._align(alignment)
        values = form.unpack_from(self._data, self._at)
        self._at += form.size
        return values

    def count(self) -> int:
        """Return the length of a sequence."""
        return int(self.unpack(_COUNT)[0])

    def time_ns(self) -> int:
        """Return a Time in nanoseconds."""
        seconds, nanoseconds = self.unpack(_STAMP)
        return int(seconds) * NS_PER_S + int(nanoseconds)

    def text(self) -> str:
        """Return a string."""
        length = self.count()
        data = self._take(length)
        if length == 0 or data[-1] != 0:
            raise ValueError("holds a string without an end")
        return data[:-1].decode()

    def rows(self, dtype: str, width: int) -> NDArray[np.floating]:
        """Return a sequence of structures of `width` equal numbers, (N, width)."""
        length = self.count()
        size = np.dtype(dtype).itemsize
        if length:
            self._align(size)
        data = self._take(length * width * size)
        return np.frombuffer(data, dtype).reshape(length, width)

    def skip(self, size: int) -> None:
        """Leave out bytes."""
        self._take(size)

    def left(self) -> int:
        """Return how many bytes are left."""
        return len(self._data) - self._at

    def _take(self, size: int) -> bytes:
        if size > self.left():
            raise ValueError("ends too early")
        self._at += size
        return self._data[self._at - size : self._at]

    def _align(self, alignment: int) -> None:
        self._at += -(self._at - 4) % alignment


def decode_markers(data: bytes) -> list[MarkerFields]:
    """Return the markers of an array; ValueError with the reason for malformed bytes."""
    try:
        cursor = CdrCursor(data)
        markers = [_read_marker(cursor) for _ in range(cursor.count())]
    except (StructError, UnicodeDecodeError) as cause:
        message = f"is malformed: {cause}"
        raise ValueError(message) from cause
    if cursor.left() > 3:
        message = f"has {counted(cursor.left(), 'byte')} too many"
        raise ValueError(message)
    return markers


def _read_marker(cursor: CdrCursor) -> MarkerFields:
    stamp_ns, frame_id, namespace = cursor.time_ns(), cursor.text(), cursor.text()
    number, kind, action = (int(value) for value in cursor.unpack(_INTEGERS))
    numbers = np.array(cursor.unpack(_POSE_AND_SCALE, 8))
    colour = np.array(cursor.unpack(_COLOUR))
    seconds, nanoseconds, locked = cursor.unpack(_LIFETIME)
    points, colours = cursor.rows("<f8", 3), cursor.rows("<f4", 4)
    texture_points = _read_texture(cursor)
    text, mesh = cursor.text(), cursor.text()
    cursor.text()
    cursor.skip(cursor.count())
    (keeps_materials,) = cursor.unpack(_FLAG, 1)
    return MarkerFields(
        stamp_ns,
        frame_id,
        namespace,
        number,
        kind,
        action,
        numbers[:3],
        numbers[3:7],
        numbers[7:],
        colour,
        int(seconds) * NS_PER_S + int(nanoseconds),
        bool(locked),
        points,
        colours,
        texture_points,
        text,
        mesh,
        bool(keeps_materials),
    )


def _read_texture(cursor: CdrCursor) -> int:
    """Pass over resource, image and coordinates of a texture; return the number of these."""
    cursor.text()
    cursor.time_ns()
    cursor.text()
    cursor.text()
    cursor.skip(cursor.count())
    return len(cursor.rows("<f4", 2))
