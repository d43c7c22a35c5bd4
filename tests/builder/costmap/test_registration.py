"""Footprints in M2D, and the clutter they make."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.builder.costmap.registration import CoveredCells, clutter_ratio, covered_cells
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.occupancy_grid import CellClasses, OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform


def test_a_patch_lies_where_the_box_is() -> None:
    """0.2 m along x on a grid of 0.1 m whose origin is (1, 2): row 3, columns 4 and 5."""
    origin = RigidTransform.planar(1.0, 2.0, 0.0)
    grid = OccupancyGrid(np.zeros((8, 9), dtype=np.int8), 0.1, origin, "map")
    boxes = OrientedBoxes(
        np.array([[1.5, 2.35, 1.0], [1.0, 2.05, 1.0], [-5.0, 0.0, 1.0]]),
        np.zeros(3),
        np.array([[0.1, 0.05, 1.0]] * 3),
    )
    cells = covered_cells(boxes, grid)
    inside, clipped, outside = (cells.patch(k) for k in range(3))
    assert (inside.row0, inside.col0, inside.mask.tolist()) == (3, 4, [[True, True]])
    assert (clipped.row0, clipped.col0, clipped.mask.tolist()) == (0, 0, [[True]])
    assert outside.mask.size == 0
    assert cells.total == 3
    with pytest.raises(ValueError, match="read-only"):
        inside.mask[0, 0] = False


def test_a_turned_grid_sees_the_box_turned_back() -> None:
    """On a grid at 90 degrees, a box along the map's y lies along the grid's row."""
    origin = RigidTransform.planar(0.0, 0.0, np.pi / 2)
    grid = OccupancyGrid(np.zeros((5, 5), dtype=np.int8), 0.1, origin, "map")
    box = OrientedBoxes(
        np.array([[-0.15, 0.2, 0]]), np.array([np.pi / 2]), np.array([[0.1, 0.05, 1]])
    )
    patch = covered_cells(box, grid).patch(0)
    assert (patch.row0, patch.col0, patch.mask.tolist()) == (1, 1, [[True, True]])


def test_clutter_counts_shared_cells_once() -> None:
    """Two boxes of 2 x 2 cells that share one cover 7 of 14 free cells: nu = 0.5 (Eq. 4)."""
    free = np.ones((4, 4), dtype=np.bool_)
    free[3, 2:] = False
    classes = CellClasses(occupied=~free, free=free)
    grid = OccupancyGrid(np.zeros((4, 4), np.int8), 1.0, RigidTransform.identity(), "map")
    boxes = OrientedBoxes(
        np.array([[1.0, 1.0, 0.5], [2.0, 2.0, 0.5], [9.0, 9.0, 0.5]]), np.zeros(3), np.ones((3, 3))
    )
    cells = covered_cells(boxes, grid)
    assert cells.total == 7
    assert clutter_ratio(cells, classes) == 0.5
    assert clutter_ratio(covered_cells(boxes.take(np.arange(0)), grid), classes) == 0.0


def test_clutter_of_a_map_without_free_cells_is_unknown() -> None:
    """There is no ratio over nothing."""
    blocked = np.ones((2, 2), dtype=np.bool_)
    none = CoveredCells(np.zeros((0, 5), np.int64), np.zeros(0, np.bool_), 0)
    assert math.isnan(clutter_ratio(none, CellClasses(occupied=blocked, free=~blocked)))


@given(seed=st.integers(0, 10**6), count=st.integers(0, 8))
def test_all_at_once_is_one_by_one(seed: int, count: int) -> None:
    """The cells of each box are those of the box alone, and the total is that of their union."""
    random = np.random.default_rng(seed)
    grid = OccupancyGrid(np.zeros((30, 40), np.int8), 0.1, RigidTransform.planar(0, 0, 0.3), "map")
    boxes = OrientedBoxes(
        random.uniform(-1.0, 4.0, (count, 3)),
        random.uniform(-4.0, 4.0, count),
        random.uniform(0.0, 0.6, (count, 3)),
    )
    cells, union = covered_cells(boxes, grid), np.zeros((30, 40), np.bool_)
    for k in range(count):
        alone = covered_cells(boxes.take(np.array([k])), grid)
        assert cells.patch(k) == alone.patch(0)
        assert alone.total == alone.patch(0).mask.sum()
        union_part = cells.patch(k).part_of(union)
        union_part |= cells.patch(k).mask
    assert cells.total == union.sum()
