"""PLY files, ascii or binary of either byte order: a point cloud, or a mesh that becomes voxels."""

import io
import math
import re
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import MapError
from are_ros.wording import listed
from are_ros.world.voxel_files.contents import (
    MAX_CENTRES,
    Points,
    check_count,
    finite_points,
    read_bytes,
)

Floats = npt.NDArray[np.float64]

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
        raise _truncated(path, counts)
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
        raise _truncated(path, counts)
    return counts


def _truncated(path: Path, counts: Mapping[str, int]) -> MapError:
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
