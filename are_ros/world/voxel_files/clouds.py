"""Point clouds of files, .pcd and .ply, and meshes of .ply, which become voxels.

The formats are https://pointclouds.org/documentation/tutorials/pcd_file_format.html (ascii, binary
and compressed by LZF) and PLY (ascii, or binary of either byte order). Points are taken as they
are, in the map's frame: the viewpoint of a PCD file only says where the sensor was.
"""

import io
import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.errors import MapError
from are_ros.wording import listed, why_refused

Points = npt.NDArray[np.float32]

MAX_CENTRES: Final = 2**26
"""Bound on the voxels or points of one file: 768 MiB of them."""

_MOST_ROUNDING_M: Final = 1e-3


def read_bytes(path: Path) -> bytes:
    """Return what a file holds; MapError, naming it, if it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as cause:
        message = f"{path}: the file cannot be read ({why_refused(cause)})"
        raise MapError(message) from cause


def check_count(path: Path, count: int) -> None:
    """Raise MapError for a file of more than `MAX_CENTRES` points."""
    if count > MAX_CENTRES:
        raise MapError(f"{path}: {count} points are more than {MAX_CENTRES}; thin out the cloud")


def finite_points(path: Path, points_m: npt.NDArray[np.floating]) -> Points:
    """Return the finite ones of points (N, 3) [m], in single precision, as clouds have them.

    A sensor's cloud has NaN where there was no return. MapError where no point is left, or where
    single precision would move one by more than a millimetre.
    """
    is_finite = np.isfinite(points_m).all(axis=1)
    if not is_finite.any():
        raise MapError(f"{path}: no finite point among {len(points_m)}")
    exact_m = points_m if is_finite.all() else points_m[is_finite]
    with np.errstate(over="ignore"):
        rounded_m = exact_m.astype(np.float32)
        is_near = np.abs(rounded_m - exact_m) <= _MOST_ROUNDING_M
    if not is_near.all():
        farthest_m = float(np.abs(exact_m).max())
        message = (
            f"{path}: a point lies {farthest_m:g} m from the origin, too far for a resolution of a"
            " millimetre; move the cloud into the map's frame"
        )
        raise MapError(message)
    return rounded_m


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


_MAGIC: Final = re.compile(rb"ply\s*\n")
_END: Final = re.compile(rb"^end_header[^\S\n]*\n", re.MULTILINE)
_ASCII: Final = re.compile(rb"^format\s+ascii\s", re.MULTILINE)
_ELEMENT: Final = re.compile(rb"^element\s+(\S+)\s+(\S+)\s*$", re.MULTILINE)
_POINTS_AT_ONCE: Final = 2**20
_ON_A_FACE: Final = 1e-3
"""In voxels: what lies so close below a voxel's face lies on it, and belongs to the next voxel."""


def read_ply_file(path: Path, voxel_size_m: float | None) -> tuple[Points, float | None]:
    """Return points (N, 3) [m], float32, and of which voxels they are the centres, if of any.

    The vertices of a file without faces are a point cloud; those that are not finite are left out,
    and the size is None. The surface of a mesh is made to voxels of `voxel_size_m`, whose corners
    are at multiples of it. Raises MapError for a file that is missing, no PLY, truncated,
    inconsistent, without a finite vertex, of more than `MAX_CENTRES` points, and for a mesh if no
    size is given or its voxels are too many.
    """
    body = _loaded(path, read_bytes(path))
    vertices_m = np.asarray(body.vertices, dtype=np.float64).reshape(-1, 3)
    faces = np.asarray(getattr(body, "faces", ()), dtype=np.int64).reshape(-1, 3)
    if not len(faces):
        return finite_points(path, vertices_m), None
    _check_mesh(path, vertices_m, faces)
    if voxel_size_m is None:
        message = (
            f"{path}: this is a mesh of {len(faces)} triangles; set world.voxel_size to the width"
            " of the voxels that are to be made of it"
        )
        raise MapError(message)
    return _surface_voxels(path, vertices_m[faces], voxel_size_m), voxel_size_m


def _loaded(path: Path, data: bytes) -> Any:
    """Return the file's one body, a trimesh.Trimesh or trimesh.PointCloud."""
    import trimesh

    counts = _checked_counts(path, data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # numpy warns only of a text that is no number
            options = {"process": False, "fix_texture": False, "skip_materials": True}
            body = trimesh.load(io.BytesIO(data), file_type="ply", **options)
    except Exception as cause:  # a broken file fails anywhere in trimesh's reader
        reason = " ".join(str(cause).split())
        message = f"{path}: the PLY cannot be read: it is truncated or malformed ({reason})"
        raise MapError(message) from cause
    has_faces = isinstance(body, trimesh.Trimesh) and len(body.faces) > 0
    has_vertices = isinstance(body, trimesh.Trimesh | trimesh.PointCloud)
    if not has_vertices or (counts.get("face") and not has_faces):
        raise _truncated_ply(path, counts)
    return body


def _checked_counts(path: Path, data: bytes) -> dict[str, int]:
    """Return how many of each element the header announces.

    A file that cannot hold so many is refused: trimesh takes what there is.
    """
    end = _END.search(data)
    if not _MAGIC.match(data):
        raise MapError(f"{path}: this is no PLY, its first line is not 'ply'")
    if end is None:
        raise MapError(f"{path}: the PLY's header is truncated, it has no line 'end_header'")
    counts: dict[str, int] = {}
    for name, text in _ELEMENT.findall(data[: end.start()]):
        if not (text.isdigit() and len(text) < 16):
            said = text[:20].decode("latin-1")
            raise MapError(f"{path}: the PLY has '{said}' of an element, not a number of them")
        counts[name.decode("latin-1")] = int(text)
    if not counts.get("vertex"):
        raise MapError(f"{path}: the PLY holds no vertices")
    check_count(path, counts["vertex"])
    body = data[end.end() :]
    there = len(body.splitlines()) if _ASCII.search(data[: end.start()]) else len(body)
    if sum(counts.values()) > there:
        raise _truncated_ply(path, counts)
    return counts


def _truncated_ply(path: Path, counts: Mapping[str, int]) -> MapError:
    announced = listed([f"{count} of '{name}'" for name, count in counts.items()])
    return MapError(f"{path}: the PLY is truncated, its header announces {announced}")


def _check_mesh(path: Path, vertices_m: Floats, faces: npt.NDArray[np.int64]) -> None:
    if faces.min() < 0 or faces.max() >= len(vertices_m):
        message = f"{path}: a face of the mesh has a corner that is none of {len(vertices_m)}"
        raise MapError(message)
    if not np.isfinite(vertices_m[faces]).all():
        raise MapError(f"{path}: the mesh has a vertex that is not finite")


def _surface_voxels(path: Path, triangles_m: Floats, size_m: float) -> Points:
    """Return the centres (N, 3) of the voxels in which points of triangles (T, 3, 3) lie.

    The points of a triangle are a grid of its own, at most half a voxel apart.
    """
    spans_m = np.linalg.norm(triangles_m - np.roll(triangles_m, 1, axis=1), axis=2).max(axis=1)
    steps = np.maximum(np.ceil(2.0 * spans_m / size_m), 1.0)
    low, high = (
        np.floor(ends / size_m) - np.array((1.0, 1.0, 1.0))
        for ends in (triangles_m.min(axis=(0, 1)), triangles_m.max(axis=(0, 1)))
    )
    extent = high - low + 3.0
    if (0.5 * (steps + 1) * (steps + 2)).sum() > MAX_CENTRES or math.prod(extent) > 2**62:
        width_m = np.ptp(triangles_m, axis=(0, 1))
        message = (
            f"{path}: {len(triangles_m)} triangles over {' x '.join(f'{w:.4g}' for w in width_m)} m"
            f" are too many for voxels of {size_m:g} m; set a larger world.voxel_size"
        )
        raise MapError(message)
    scale = np.array((extent[1] * extent[2], extent[2], 1.0)).astype(np.int64)
    found = [
        np.unique((np.floor(points_m / size_m + _ON_A_FACE) - low).astype(np.int64) @ scale)
        for points_m in _grids(triangles_m, steps.astype(np.int64))
    ]
    keys = np.unique(np.concatenate(found))
    indices = np.stack((keys // scale[0], keys % scale[0] // scale[1], keys % scale[1]), axis=1)
    return finite_points(path, (indices + low + 0.5) * size_m)


def _grids(triangles_m: Floats, steps: npt.NDArray[np.int64]) -> Iterator[Floats]:
    """Yield points (P, 3) on triangles (T, 3, 3), whose sides have so many steps (T,)."""
    for count in np.unique(steps).tolist():
        first, second = np.indices((count + 1, count + 1)).reshape(2, -1)
        is_inside = first + second <= count
        along = np.stack((first, second, count - first - second), axis=1)[is_inside] / count
        chosen = triangles_m[steps == count]
        at_once = max(1, _POINTS_AT_ONCE // len(along))
        for begin in range(0, len(chosen), at_once):
            yield (along @ chosen[begin : begin + at_once]).reshape(-1, 3)
