"""Point clouds of the Point Cloud Library (.pcd): ascii, binary and compressed (LZF).

The format is https://pointclouds.org/documentation/tutorials/pcd_file_format.html. Points are taken
as they are, in the map's frame: the viewpoint only says where the sensor was.
"""

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.errors import MapError
from are_ros.world.voxel_files.contents import Points, check_count, finite_points, read_bytes

Floats = npt.NDArray[np.float64]

_AXES: Final = ("x", "y", "z")
_ENTRIES: Final = frozenset(
    ("VERSION", "FIELDS", "COLUMNS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT")
) | {"POINTS", "DATA"}
_NUMBERS: Final = {("F", 4), ("F", 8), *((kind, size) for kind in "IU" for size in (1, 2, 4, 8))}
_SIZES_BYTES: Final = 8
_MOST_DIGITS: Final = 12
_MOST_EXPANSION: Final = 100
"""Three bytes of LZF stand for at most 264."""


class _Field(NamedTuple):
    """A field of each point: its type in numpy, and how many bytes and columns are before it."""

    number: np.dtype[np.generic]
    offset: int
    column: int


class _Header(NamedTuple):
    axes: Sequence[_Field]
    point_bytes: int
    point_count: int
    encoding: str
    data_start: int


def read_pcd_file(path: Path) -> Points:
    """Return the points (N, 3) [m], float32, of a .pcd file, in the file's order.

    Points that are not finite, as those of an organised cloud without a return, are left out.
    Raises MapError for a file that is missing, no PCD, truncated, inconsistent, without fields x,
    y and z, of more than `MAX_CENTRES` points, or without a finite one.
    """
    data = read_bytes(path)
    header = _parsed_header(path, data)
    if not header.point_count:
        raise MapError(f"{path}: the PCD holds no points")
    check_count(path, header.point_count)
    points_m = _READERS[header.encoding](path, data[header.data_start :], header)
    return finite_points(path, points_m)


def _parsed_header(path: Path, data: bytes) -> _Header:
    entries, data_start = _entries(path, data)
    names = entries.get("FIELDS") or entries.get("COLUMNS", [])
    sizes = _numbers(path, entries, "SIZE")
    counts = _numbers(path, entries, "COUNT") if "COUNT" in entries else [1] * len(names)
    types = entries.get("TYPE", [])
    if not len(names) == len(sizes) == len(counts) == len(types):
        raise MapError(f"{path}: the PCD's FIELDS, SIZE, TYPE and COUNT are not equally many")
    for name, kind, size in zip(names, types, sizes, strict=True):
        if (kind, size) not in _NUMBERS:
            raise MapError(f"{path}: the PCD's field {name} is {kind}{size}, which there is not")
    encoding = " ".join(entries["DATA"])
    if encoding not in _READERS:
        raise MapError(f"{path}: the PCD's DATA is '{encoding}', not one of {tuple(_READERS)}")
    fields = _fields(names, types, sizes, counts)
    for axis in _AXES:
        if axis not in fields:
            raise MapError(f"{path}: the PCD has no field {axis} of one number")
    point_bytes = sum(size * count for size, count in zip(sizes, counts, strict=True))
    axes = [fields[axis] for axis in _AXES]
    return _Header(axes, point_bytes, _count(path, entries), encoding, data_start)


def _entries(path: Path, data: bytes) -> tuple[dict[str, list[str]], int]:
    """Return the words behind each entry of the header, and where the data begin."""
    entries: dict[str, list[str]] = {}
    position = 0
    while "DATA" not in entries:
        end = data.find(b"\n", position)
        words = data[position : max(end, position)].decode("latin-1").split("#")[0].split()
        if words and words[0] not in _ENTRIES:
            raise MapError(f"{path}: this is no PCD, its header has a line {words[0][:20]!r}")
        if end < 0:
            raise MapError(f"{path}: the PCD's header is truncated, it has no line DATA")
        if words:
            entries[words[0]] = words[1:]
        position = end + 1
    return entries, position


def _numbers(path: Path, entries: Mapping[str, list[str]], name: str) -> list[int]:
    """Return the whole numbers of an entry, none where it is not there."""
    words = entries.get(name, [])
    for word in words:
        if not (word.isascii() and word.isdigit() and len(word) <= _MOST_DIGITS):
            raise MapError(f"{path}: the PCD's {name} has {word[:20]!r}, not a whole number")
    return [int(word) for word in words]


def _count(path: Path, entries: Mapping[str, list[str]]) -> int:
    """Return the number of points, which an old file gives by width and height alone."""
    (points, width, height) = (
        (_numbers(path, entries, name) or [-1])[0] for name in ("POINTS", "WIDTH", "HEIGHT")
    )
    area = width * height if min(width, height) >= 0 else points
    if points < 0 and area < 0:
        raise MapError(f"{path}: the PCD does not say how many POINTS it has")
    if points >= 0 and points != area:
        message = f"{path}: the PCD says {points} POINTS, but its WIDTH and HEIGHT {area}"
        raise MapError(message)
    return area


def _fields(
    names: Sequence[str], types: Sequence[str], sizes: Sequence[int], counts: Sequence[int]
) -> dict[str, _Field]:
    """Return the fields of one number by name; of several with a name the first."""
    fields: dict[str, _Field] = {}
    offset, column = 0, 0
    for name, kind, size, count in zip(names, types, sizes, counts, strict=True):
        if count == 1:
            fields.setdefault(name, _Field(np.dtype(f"<{kind.lower()}{size}"), offset, column))
        offset, column = offset + size * count, column + count
    return fields


def _ascii_points(path: Path, data: bytes, header: _Header) -> Floats:
    columns = [field.column for field in header.axes]
    if not data.strip():
        raise _truncated(path, 0, header)
    try:
        points_m: Floats = np.loadtxt(
            io.BytesIO(data), comments=None, usecols=columns, ndmin=2, encoding="latin-1"
        )
    except ValueError as cause:
        message = f"{path}: the PCD's points are malformed ({' '.join(str(cause).split())})"
        raise MapError(message) from cause
    if len(points_m) < header.point_count:
        raise _truncated(path, len(points_m), header)
    return points_m[: header.point_count]


def _binary_points(path: Path, data: bytes, header: _Header) -> Floats:
    there = len(data) // header.point_bytes
    if there < header.point_count:
        raise _truncated(path, there, header)
    point = np.dtype(
        {
            "names": list(_AXES),
            "formats": [field.number for field in header.axes],
            "offsets": [field.offset for field in header.axes],
            "itemsize": header.point_bytes,
        }
    )
    points = np.frombuffer(data, point, header.point_count)
    return np.column_stack([points[axis].astype(np.float64) for axis in _AXES])


def _compressed_points(path: Path, data: bytes, header: _Header) -> Floats:
    """Return the points of a compressed file, in which each field is a block of its own."""
    if len(data) < _SIZES_BYTES:
        raise MapError(f"{path}: the PCD is truncated, its compressed data have no size")
    packed_bytes, size = np.frombuffer(data, "<u4", 2).tolist()
    packed = np.frombuffer(data, np.uint8)[_SIZES_BYTES : _SIZES_BYTES + packed_bytes]
    if len(packed) < packed_bytes:
        raise MapError(f"{path}: the PCD is truncated, {len(packed)} bytes of {packed_bytes}")
    if size != header.point_count * header.point_bytes or size > _MOST_EXPANSION * packed_bytes:
        message = (
            f"{path}: the PCD's {packed_bytes} bytes cannot be {header.point_count} points of"
            f" {header.point_bytes} bytes"
        )
        raise MapError(message)
    unpacked = np.empty(size, dtype=np.uint8)
    if not _unpack(packed, unpacked):
        raise MapError(f"{path}: the PCD's compressed data are corrupt")
    blocks = [
        np.frombuffer(unpacked, field.number, header.point_count, header.point_count * field.offset)
        for field in header.axes
    ]
    return np.column_stack([block.astype(np.float64) for block in blocks])


_READERS: Final[Mapping[str, Callable[[Path, bytes, _Header], Floats]]] = {
    "ascii": _ascii_points,
    "binary": _binary_points,
    "binary_compressed": _compressed_points,
}


def _truncated(path: Path, there: int, header: _Header) -> MapError:
    return MapError(
        f"{path}: the PCD is truncated, it holds {there} points of {header.point_count}"
    )


@compiled
def _unpack(packed: npt.NDArray[np.uint8], unpacked: npt.NDArray[np.uint8]) -> bool:
    """Unpack LZF into an array; return whether it is filled exactly, by sound data.

    A token below 32 is followed by so many bytes and one, as they are. Another one repeats bytes
    that were unpacked before: its high three bits, or the next byte and 7 where all three are set,
    are their number less 2; its low five bits and one more byte say how far back they begin.
    """
    at, end, filled = 0, packed.shape[0], 0
    while at < end:
        token = np.int64(packed[at])
        at += 1
        back = np.int64(0)
        count = token + 1
        if token >= 32:
            count = (token >> 5) + 2
            if token >> 5 == 7 and at < end:
                count += packed[at]
                at += 1
            if at >= end:
                return False
            back = ((token & 31) << 8) + np.int64(packed[at]) + 1
            at += 1
        elif at + count > end:
            return False
        if filled + count > unpacked.shape[0] or back > filled:
            return False
        for _ in range(count):
            if back:
                unpacked[filled] = unpacked[filled - back]
            else:
                unpacked[filled] = packed[at]
                at += 1
            filled += 1
    is_full: bool = filled == unpacked.shape[0]
    return is_full
