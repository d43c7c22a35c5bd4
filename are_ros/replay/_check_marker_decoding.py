"""A MarkerArray from its bytes, and what the rules of visualization_msgs say of each marker.

Recordings hold millions of corners of meshes: they are looked at as arrays, not as objects.
"""

from struct import Struct
from struct import error as StructError  # noqa: N812
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from are_ros.conventions import NS_PER_S

ADD, DELETE, DELETE_ALL = 0, 2, 3
ARROW, CUBE, LINE_STRIP, LINE_LIST, POINTS, TEXT, MESH, TRIANGLES = 0, 1, 4, 5, 8, 9, 10, 11
_LAST_TYPE: Final = 12
_LISTS: Final = (LINE_STRIP, LINE_LIST, 6, 7, POINTS, TRIANGLES, _LAST_TYPE)
_GROUP_SIZES: Final = {LINE_LIST: 2, TRIANGLES: 3}

_STAMP, _INTEGERS, _COUNT = Struct("<iI"), Struct("<3i"), Struct("<I")
_POSE_AND_SCALE, _COLOUR, _LIFETIME = Struct("<10d"), Struct("<4f"), Struct("<iIB")


class MarkerChange(NamedTuple):
    """What one marker does to a viewer, and what is wrong with it ("" if nothing is)."""

    action: int
    key: tuple[str, int]
    lifetime_ns: int
    fault: str


class _Bytes:
    """A cursor over little-endian XCDR1."""

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


def decode_markers(data: bytes, frame_id: str) -> list[MarkerChange]:
    """Return what the markers of an array do; ValueError with the reason for malformed bytes."""
    try:
        cursor = _Bytes(data)
        changes = [_read_marker(cursor, frame_id) for _ in range(cursor.count())]
    except (StructError, UnicodeDecodeError) as cause:
        message = f"is malformed: {cause}"
        raise ValueError(message) from cause
    if cursor.left() > 3:
        message = f"has {cursor.left()} bytes too many"
        raise ValueError(message)
    return changes


def _read_marker(cursor: _Bytes, wanted_frame: str) -> MarkerChange:
    cursor.unpack(_STAMP)
    frame_id, namespace = cursor.text(), cursor.text()
    number, kind, action = (int(value) for value in cursor.unpack(_INTEGERS))
    numbers = np.array(cursor.unpack(_POSE_AND_SCALE, 8))
    colour = np.array(cursor.unpack(_COLOUR))
    seconds, nanoseconds, _ = cursor.unpack(_LIFETIME)
    points, colours = cursor.rows("<f8", 3), cursor.rows("<f4", 4)
    _skip_texture(cursor)
    text, mesh = cursor.text(), cursor.text()
    cursor.text()
    cursor.skip(cursor.count())
    cursor.skip(1)
    lifetime_ns = int(seconds) * NS_PER_S + int(nanoseconds)
    faults = [_place_fault(frame_id, wanted_frame, kind, action)]
    if action == ADD:
        faults += [
            _looks_fault(numbers, colour, kind, lifetime_ns),
            _points_fault(kind, points, colours),
            "has no text" if kind == TEXT and not text.strip() else "",
            "has no mesh" if kind == MESH and not mesh else "",
        ]
    fault = next((fault for fault in faults if fault), "")
    return MarkerChange(action, (namespace, number), lifetime_ns, fault)


def _skip_texture(cursor: _Bytes) -> None:
    """Pass over resource, image and coordinates of a texture."""
    cursor.text()
    cursor.unpack(_STAMP)
    cursor.text()
    cursor.text()
    cursor.skip(cursor.count())
    cursor.rows("<f4", 2)


def _place_fault(frame_id: str, wanted: str, kind: int, action: int) -> str:
    if frame_id != wanted:
        return f"is in frame '{frame_id}', not '{wanted}'"
    if action not in {ADD, DELETE, DELETE_ALL}:
        return f"has the action {action}, which there is not"
    return "" if 0 <= kind <= _LAST_TYPE else f"is of type {kind}, which there is not"


def _looks_fault(
    numbers: NDArray[np.float64], colour: NDArray[np.float64], kind: int, lifetime_ns: int
) -> str:
    """Check pose, scale, colour and lifetime."""
    if not (np.isfinite(numbers).all() and np.isfinite(colour).all()):
        return "has numbers that are not finite"
    if abs(np.linalg.norm(numbers[3:7]) - 1.0) > 1e-4:
        return "has a rotation that is no unit quaternion"
    if (_used_scale(numbers[7:], kind) <= 0.0).any():
        return f"has the scale {numbers[7:].tolist()}"
    if colour.min() < 0.0 or colour.max() > 1.0 or (colour[3] == 0.0 and kind != MESH):
        return f"has the colour {colour.tolist()}"
    return "has a negative lifetime" if lifetime_ns < 0 else ""


def _used_scale(scale: NDArray[np.float64], kind: int) -> NDArray[np.float64]:
    """Return the components of the scale that a type uses."""
    if kind == TEXT:
        return scale[2:]
    if kind in {LINE_STRIP, LINE_LIST}:
        return scale[:1]
    return scale[:2] if kind == POINTS else scale


def _points_fault(kind: int, points: NDArray[np.floating], colours: NDArray[np.floating]) -> str:
    """Check the points of lists, and their colours."""
    if kind not in _LISTS:
        return ""
    if not len(points) or len(points) % _GROUP_SIZES.get(kind, 1):
        return f"has {len(points)} points"
    if len(colours) not in {0, len(points)}:
        return f"has {len(colours)} colours for {len(points)} points"
    if not np.isfinite(points).all() or not ((colours >= 0.0) & (colours <= 1.0)).all():
        return "has points that are not finite, or colours outside of 0 to 1"
    return ""
