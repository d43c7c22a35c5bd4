"""The surface of occupied voxels: the environment's part of S_E (section 3.3), and boxes of them.

Faces in one plane are merged into rectangles. A rectangle has a vertex wherever a corner of another
one lies on its sides, so that neighbours share their edges and the surface is closed.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

_TOP: Final = 5
_CORNERS: Final = ((0, 0), (1, 0), (1, 1), (0, 1))
"""Whether a corner of a rectangle is at the high end of its first side, and of its second."""


class Surface(NamedTuple):
    """Triangles: `vertices_m` float64 (V, 3) [m], `faces` int64 (F, 3), anticlockwise outside."""

    vertices_m: Floats
    faces: Indices


def exposed_surface(voxels: VoxelMap) -> Surface:
    """Return the surface of occupied voxels in the map frame, normals outward.

    A voxel's face belongs to it where the neighbour is not occupied, or outside the lattice. It is
    closed: each edge has two triangles, but four where two voxels touch in that edge alone. No
    vertex is twice, and none is unused; without occupied voxels there is none.
    """
    corners, faces = lattice_surface(voxels.occupied)
    return Surface(voxels.map_from_lattice.apply(corners * np.array(voxels.voxel_size_m)), faces)


def level_surface(grid: OccupancyGrid, mask: npt.NDArray[np.bool_], height_m: float) -> Surface:
    """Return the cells of a mask (height, width) as a level sheet at a height, normals upward."""
    layer = np.ascontiguousarray(mask.T[:, :, np.newaxis]).astype(np.uint8)
    corners, faces = lattice_surface(layer, (_TOP,))
    x, y, _ = grid.origin.translation_m
    origin = RigidTransform(np.array((x, y, height_m)), grid.origin.rotation_xyzw)
    return Surface(origin.apply(corners * (grid.resolution_m, grid.resolution_m, 0.0)), faces)


def lattice_surface(
    occupied: npt.NDArray[np.uint8], sides: Sequence[int] = tuple(range(6))
) -> tuple[Floats, Indices]:
    """Return vertices (V, 3), in voxels, and faces (F, 3) of the exposed surface.

    `occupied` is uint8 (nx, ny, nz) of 0 and 1; the sides are -x, +x, -y, +y, -z, +z.
    """
    parts = [_rectangles(occupied, side) for side in sides]
    corners = np.concatenate(parts).reshape(-1, 4, 3)
    counts = np.array(occupied.shape) + 1
    strides = np.array((counts[1] * counts[2], counts[2], 1))
    is_vertex = np.zeros(int(np.prod(counts)), dtype=np.bool_)
    is_vertex[(corners @ strides).ravel()] = True
    rings, lengths = _rings(corners, strides, is_vertex)
    keys = np.flatnonzero(is_vertex)
    vertices = np.stack((keys // strides[0], keys % strides[0] // strides[1], keys % strides[1]), 1)
    faces, centred = _triangles(np.searchsorted(keys, rings), lengths, len(keys))
    middles = 0.5 * (corners[centred, 0] + corners[centred, 2])
    return np.concatenate((vertices, middles)), faces


def boxes_of(occupied: npt.NDArray[np.uint8]) -> tuple[Indices, Indices]:
    """Return the low and high corners, int64 (N, 3), of boxes that fill the occupied voxels.

    Voxels side by side are merged into rows, equal rows into plates, equal plates into boxes.
    """
    low = np.argwhere(occupied)
    high = low + 1
    for axis in (1, 0, 2):
        low, high = _merged(low, high, axis)
    return low, high


def _rectangles(occupied: npt.NDArray[np.uint8], side: int) -> Indices:
    """Return the corners (R, 4, 3) of rectangles of exposed faces, anticlockwise from outside."""
    axis, is_high = divmod(side, 2)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    beside = np.roll(occupied, -1 if is_high else 1, axis=axis)
    edge = [slice(None)] * 3
    edge[axis] = slice(-1, None) if is_high else slice(0, 1)
    beside[tuple(edge)] = 0
    low = np.argwhere(occupied > beside)
    low[:, axis] += is_high
    high = low.copy()
    high[:, (first, second)] += 1
    for along in (first, second):
        low, high = _merged(low, high, along)
    corners = np.repeat(low[:, np.newaxis], 4, axis=1)
    order = _CORNERS if is_high else _CORNERS[::-1]
    for number, at_high in enumerate(order):
        for along, is_there in zip((first, second), at_high, strict=True):
            if is_there:
                corners[:, number, along] = high[:, along]
    return corners


def _merged(low: Indices, high: Indices, axis: int) -> tuple[Indices, Indices]:
    """Merge boxes that differ along one axis only, and touch there."""
    if not len(low):
        return low, high
    sides = np.delete(np.hstack((low, high)), (axis, axis + 3), axis=1)
    order = np.lexsort((low[:, axis], *sides.T))
    low, high, sides = low[order], high[order], sides[order]
    is_joined = (np.diff(sides, axis=0) == 0).all(axis=1) & (low[1:, axis] == high[:-1, axis])
    first = np.flatnonzero(np.append(True, ~is_joined))
    last = np.append(first[1:], len(low)) - 1
    tops = high[first]
    tops[:, axis] = high[last, axis]
    return low[first], tops


def _rings(
    corners: Indices, strides: Indices, is_vertex: npt.NDArray[np.bool_]
) -> tuple[Indices, Indices]:
    """Return the vertices on the outlines of rectangles (R, 4, 3), and how many each has, (R,).

    Each outline begins at its first corner; a vertex is its number on the lattice.
    """
    sides = (np.roll(corners, -1, axis=1) - corners).reshape(-1, 3)
    spans = np.abs(sides).sum(axis=1)
    side = np.repeat(np.arange(len(sides)), spans)
    step = np.arange(len(side)) - np.repeat(np.cumsum(spans) - spans, spans)
    numbers = (corners @ strides).ravel()[side] + step * (np.sign(sides) @ strides)[side]
    is_used = is_vertex[numbers]
    return numbers[is_used], np.bincount(side[is_used] // 4, minlength=len(corners))


def _triangles(rings: Indices, lengths: Indices, vertex_count: int) -> tuple[Indices, Indices]:
    """Return faces (F, 3) of outlines, and which have a vertex in their middle, (M,).

    An outline of four corners makes two triangles. One of more makes a fan from its middle; the
    middles are numbered from the count of the other vertices on.
    """
    starts = np.cumsum(lengths) - lengths
    plain, centred = np.flatnonzero(lengths == 4), np.flatnonzero(lengths > 4)
    halves = rings[starts[plain, np.newaxis] + (0, 1, 2, 0, 2, 3)].reshape(-1, 3)
    last = starts + lengths - 1
    after = np.arange(1, len(rings) + 1)
    after[last] = starts
    middle = np.full(len(lengths), -1)
    middle[centred] = vertex_count + np.arange(len(centred))
    middles = np.repeat(middle, lengths)
    fans = np.stack((rings, rings[after], middles), axis=1)[middles >= 0]
    return np.concatenate((halves, fans)), centred
