"""Footprints in M2D, and the clutter they make."""

import math

import numpy as np
import pytest

from are_ros.builder.costmap.registration import (
    CellPatch,
    clutter_ratio,
    covered_cells,
    covered_count,
)
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.occupancy_grid import CellClasses, OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform


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
