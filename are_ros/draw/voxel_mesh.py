"""The surface of a voxel map as one mesh of few triangles."""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float32]
Faces = npt.NDArray[np.uint32]

_CORNERS: Final = np.array(((0, 0), (1, 0), (1, 1), (0, 1)))
"""Which end (0 low, 1 high) of its rows and columns each corner of a rectangle has."""


def coarsened(voxels: VoxelMap, factor: int) -> VoxelMap:
    """Return the map with `factor` times wider voxels, occupied where any of theirs is.

    An extruded map stays as high as it is.
    """
    factors = (factor, factor, 1 if voxels.is_extruded else factor)
    occupied = voxels.occupied
    for axis, times in enumerate(factors):
        starts = np.arange(0, occupied.shape[axis], times)
        occupied = np.maximum.reduceat(occupied, starts, axis=axis)
    x_m, y_m, z_m = (size * times for size, times in zip(voxels.voxel_size_m, factors, strict=True))
    return VoxelMap(voxels.map_from_lattice, (x_m, y_m, z_m), occupied, voxels.is_extruded)


def between(voxels: VoxelMap, low_m: float, high_m: float) -> VoxelMap | None:
    """Return what of a map lies between two heights of the map's frame, None if nothing does.

    Layers whose middle is between them are kept; tall voxels of an extruded map are cut.
    """
    pose, (x_m, y_m, z_m) = voxels.map_from_lattice, voxels.voxel_size_m
    base_m = float(pose.translation_m[2])
    if voxels.is_extruded:
        if base_m >= high_m or not voxels.occupied.any():
            return None
        return VoxelMap(pose, (x_m, y_m, min(z_m, high_m - base_m)), voxels.occupied, True)
    middles_m = base_m + (np.arange(voxels.occupied.shape[2]) + 0.5) * z_m
    layers = np.flatnonzero((middles_m > low_m) & (middles_m < high_m))
    if not len(layers):
        return None
    part = voxels.occupied[:, :, layers[0] : layers[-1] + 1]
    if not part.any():
        return None
    lift = np.array((0.0, 0.0, layers[0] * z_m))
    lifted = RigidTransform(pose.translation_m + lift, pose.rotation_xyzw)
    return VoxelMap(lifted, voxels.voxel_size_m, part)


def surface(voxels: VoxelMap) -> tuple[Floats, Faces]:
    """Return vertices (V, 3) [m] in the map's frame and triangles (F, 3) of a map's surface.

    Neighbouring faces in one plane are merged into rectangles, greedily. Faces that look down are
    left out: nobody looks from below.
    """
    corners = [_side(voxels.occupied, axis, is_high) for axis, is_high in _SIDES]
    lattice = np.concatenate(corners) if corners else np.empty((0, 4, 3))
    points_m = (lattice * np.array(voxels.voxel_size_m)).reshape(-1, 3)
    vertices = voxels.map_from_lattice.apply(points_m).astype(np.float32)
    first = np.arange(len(lattice), dtype=np.uint32)[:, np.newaxis] * 4
    triangles = first[:, np.newaxis] + np.array(((0, 1, 2), (0, 2, 3)), dtype=np.uint32)
    return vertices, triangles.reshape(-1, 3)


_SIDES: Final = ((0, False), (0, True), (1, False), (1, True), (2, True))
"""Axis across the faces, and whether they are those at the high end."""


def _side(occupied: npt.NDArray[np.uint8], axis: int, is_high: bool) -> npt.NDArray[np.float64]:
    """Return rectangles (N, 4, 3), in voxels, that cover the faces which look one way.

    Their corners go round counter-clockwise, seen from outside.
    """
    solid = np.moveaxis(occupied.astype(np.bool_), axis, 0)
    beyond = np.zeros_like(solid)
    if is_high:
        beyond[:-1] = solid[1:]
    else:
        beyond[1:] = solid[:-1]
    planes, rows, columns = _rectangles(solid & ~beyond)
    rectangles = np.empty((len(planes), 4, 3))
    rectangles[:, :, 0] = (planes + is_high)[:, np.newaxis]
    rectangles[:, :, 1] = rows[:, _CORNERS[:, 0]]
    rectangles[:, :, 2] = columns[:, _CORNERS[:, 1]]
    # Moved to the front, the y axis leaves (y, x, z), which is a left-handed order.
    is_left_handed = axis == 1
    if is_high == is_left_handed:
        rectangles = rectangles[:, ::-1]
    order = {0: [0, 1, 2], 1: [1, 0, 2], 2: [1, 2, 0]}[axis]
    return rectangles[:, :, order]


def _rectangles(
    faces: npt.NDArray[np.bool_],
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return rectangles that cover cells (planes, rows, columns), each in one plane.

    These are the plane (N,), and the [start, stop) of rows (N, 2) and of columns (N, 2). Runs along
    the columns are merged with equal ones of the rows before.
    """
    edges = np.diff(faces.astype(np.int8), axis=2, prepend=0, append=0)
    planes, rows, starts = np.nonzero(edges == 1)
    stops = np.nonzero(edges == -1)[2]
    order = np.lexsort((rows, stops, starts, planes))
    planes, rows, starts, stops = planes[order], rows[order], starts[order], stops[order]
    same = (np.diff(planes) == 0) & (np.diff(starts) == 0) & (np.diff(stops) == 0)
    is_first = np.concatenate(([True], ~(same & (np.diff(rows) == 1))))[: len(planes)]
    first = np.flatnonzero(is_first)
    last = np.append(first[1:], len(planes))[: len(first)] - 1
    row_ranges = np.stack((rows[first], rows[last] + 1), axis=1)
    return planes[first], row_ranges, np.stack((starts[first], stops[first]), axis=1)
