"""Footprints in M2D, clutter, and surfaces in M3D against clipped triangles."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from are_ros.builder.registration import (
    CellPatch,
    clutter_ratio,
    covered_cells,
    covered_count,
    surface_voxels,
)
from are_ros.world.occupancy_grid import CellClasses, OccupancyGrid
from are_ros.world.oriented_boxes import OrientedBoxes
from are_ros.world.rigid_transform import RigidTransform

_HERE = RigidTransform.identity()
_CUBE_FACES = [
    *[[0, 3, 1], [0, 2, 3], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]],
    *[[2, 7, 3], [2, 6, 7], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]],
]


def _cuboid(
    low: tuple[float, float, float], high: tuple[float, float, float]
) -> NDArray[np.float64]:
    """Return the corners (8, 3) of a cuboid in the order of `_CUBE_FACES`: x fastest."""
    x, y, z = zip(low, high, strict=True)
    return np.array([[x[i & 1], y[i >> 1 & 1], z[i >> 2]] for i in range(8)])


def _patch(row0: int, col0: int, rows: int, columns: int) -> CellPatch:
    return CellPatch(row0, col0, np.ones((rows, columns), dtype=np.bool_))


def test_a_patch_lies_where_the_box_is() -> None:
    """0.2 m along x on a grid of 0.1 m whose origin is (1, 2): row 3, columns 4 and 5."""
    origin = RigidTransform.planar(1.0, 2.0, 0.0)
    grid = OccupancyGrid(np.zeros((8, 9), dtype=np.int8), 0.1, origin, "map")
    boxes = OrientedBoxes(
        np.array([[1.5, 2.35, 1.0], [1.0, 2.05, 1.0], [-5.0, 0.0, 1.0]]),
        np.zeros(3),
        np.array([[0.1, 0.05, 1.0]] * 3),
    )
    inside, clipped, outside = covered_cells(boxes, grid)
    assert (inside.row0, inside.col0, inside.mask.tolist()) == (3, 4, [[True, True]])
    assert (clipped.row0, clipped.col0, clipped.mask.tolist()) == (0, 0, [[True]])
    assert outside.mask.size == 0
    with pytest.raises(ValueError, match="read-only"):
        inside.mask[0, 0] = False


def test_a_turned_grid_sees_the_box_turned_back() -> None:
    """On a grid at 90 degrees, a box along the map's y lies along the grid's row."""
    origin = RigidTransform.planar(0.0, 0.0, np.pi / 2)
    grid = OccupancyGrid(np.zeros((5, 5), dtype=np.int8), 0.1, origin, "map")
    box = OrientedBoxes(
        np.array([[-0.15, 0.2, 0]]), np.array([np.pi / 2]), np.array([[0.1, 0.05, 1]])
    )
    (patch,) = covered_cells(box, grid)
    assert (patch.row0, patch.col0, patch.mask.tolist()) == (1, 1, [[True, True]])


def test_clutter_counts_shared_cells_once() -> None:
    """Two patches of 2 x 2 that share a cell cover 7 of 14 free cells: nu = 0.5 (Eq. 4)."""
    free = np.ones((4, 4), dtype=np.bool_)
    free[3, 2:] = False
    classes = CellClasses(occupied=~free, free=free)
    patches = [_patch(0, 0, 2, 2), _patch(1, 1, 2, 2), _patch(0, 0, 0, 0)]
    assert covered_count(patches) == 7
    assert clutter_ratio(patches, classes) == 0.5
    assert clutter_ratio([], classes) == 0.0


def test_clutter_of_a_map_without_free_cells_is_unknown() -> None:
    """There is no ratio over nothing."""
    blocked = np.ones((2, 2), dtype=np.bool_)
    assert math.isnan(clutter_ratio([], CellClasses(occupied=blocked, free=~blocked)))


def test_a_cuboid_on_voxel_boundaries_fills_its_own_outer_voxels() -> None:
    """A cuboid of 5 x 4 x 3 voxels, faces on boundaries, marks its shell and nothing outside."""
    vertices = _cuboid((0.3, -0.2, 0.0), (0.8, 0.2, 0.3))
    voxels = surface_voxels(vertices, np.array(_CUBE_FACES), _HERE, (0.1, 0.1, 0.1))
    assert voxels.min(axis=0).tolist() == [3, -2, 0]
    assert voxels.max(axis=0).tolist() == [7, 1, 2]
    assert len(voxels) == 5 * 4 * 3 - 3 * 2 * 1


def test_a_turned_lattice_of_unequal_voxels() -> None:
    """The same cuboid seen from a lattice at 90 degrees with voxels of 0.1 x 0.25 x 0.3 m."""
    vertices = _cuboid((0.0, 0.0, 0.0), (0.5, 0.4, 0.3))
    lattice = RigidTransform.planar(0.5, 0.0, np.pi / 2)
    voxels = surface_voxels(vertices, np.array(_CUBE_FACES), lattice, (0.1, 0.25, 0.3))
    expected = [[i, j, 0] for i in range(4) for j in range(2)]
    assert voxels.tolist() == expected


def test_no_faces_mark_no_voxels() -> None:
    """An empty mesh is registered nowhere."""
    nothing = surface_voxels(np.zeros((0, 3)), np.zeros((0, 3), dtype=int), _HERE, (1.0, 1.0, 1.0))
    assert nothing.shape == (0, 3)


def _slow_voxels(triangle: NDArray[np.float64], size: float) -> set[tuple[int, ...]]:
    """Clip a triangle by the six faces of each voxel around; keep where something is left."""
    low = np.floor(triangle.min(axis=0) / size).astype(int)
    high = np.floor(triangle.max(axis=0) / size).astype(int)
    found = set()
    for index in np.ndindex(*(high - low + 1)):
        voxel = low + index
        polygon = [np.array(corner) for corner in triangle]
        for axis in range(3):
            polygon = _clipped(polygon, axis, voxel[axis] * size, 1.0)
            polygon = _clipped(polygon, axis, (voxel[axis] + 1) * size, -1.0)
        if polygon:
            found.add(tuple(int(i) for i in voxel))
    return found


def _clipped(
    polygon: list[NDArray[np.float64]], axis: int, bound: float, sign: float
) -> list[NDArray[np.float64]]:
    kept = []
    for k, point in enumerate(polygon):
        before = polygon[k - 1]
        here, there = sign * (point[axis] - bound), sign * (before[axis] - bound)
        if (here > 0.0) != (there > 0.0):
            kept.append(before + there / (there - here) * (point - before))
        if here > 0.0:
            kept.append(point)
    return kept


@given(st.integers(0, 100_000), st.sampled_from([0.3, 1.0, 4.0]))
def test_triangles_mark_the_voxels_in_which_something_is_left_of_them(
    seed: int, extent: float
) -> None:
    """Small, middle and large triangles, of any slope: exact but for slivers of micrometres."""
    generator = np.random.default_rng(seed)
    triangle = generator.uniform(-extent, extent, (3, 3)) * generator.choice([0.05, 1.0], 3)
    voxels = surface_voxels(triangle, np.array([[0, 1, 2]]), _HERE, (0.25, 0.25, 0.25))
    marked = {tuple(voxel) for voxel in voxels.tolist()}
    normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    inset = triangle - 2e-6 * normal / np.linalg.norm(normal)
    expected = _slow_voxels(inset, 0.25)
    assert marked <= expected
    assert len(expected - marked) <= 1  # a corner that reaches in by less than the tolerance
