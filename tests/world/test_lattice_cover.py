"""Covered cells against a slow twin: each cell's square and the footprint, side by side."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from are_ros.world.boxes import TOUCH_TOLERANCE_M, OrientedBoxes
from are_ros.world.lattice_cover import covered, lattice_row
from are_ros.world.rigid_transform import RigidTransform

_ROWS, _COLUMNS = 9, 11


def _box(x: float, y: float, yaw: float, ahead: float, aside: float) -> OrientedBoxes:
    return OrientedBoxes(np.array([[x, y, 1.0]]), np.array([yaw]), np.array([[ahead, aside, 1.0]]))


def _mask(
    box: OrientedBoxes, origin: RigidTransform, size_m: tuple[float, float]
) -> NDArray[np.bool_]:
    lattice = lattice_row(origin, *size_m)
    row, column, patch = covered(box.packed, 0, lattice, (_ROWS, _COLUMNS), TOUCH_TOLERANCE_M)
    mask = np.zeros((_ROWS, _COLUMNS), dtype=np.bool_)
    mask[row : row + patch.shape[0], column : column + patch.shape[1]] = patch
    return mask


def _slow_mask(
    box: OrientedBoxes, origin: RigidTransform, size_m: tuple[float, float]
) -> NDArray[np.bool_]:
    """Part each cell from the footprint along the four edge directions, by corner projections."""
    mask = np.zeros((_ROWS, _COLUMNS), dtype=np.bool_)
    corners = box.footprints()[0]
    for row in range(_ROWS):
        for column in range(_COLUMNS):
            cell = np.array([[column, row], [column + 1, row], [column + 1, row + 1]])
            cell = np.vstack((cell, [[column, row + 1]])) * size_m
            square = origin.apply(np.column_stack((cell, np.zeros(4))))[:, :2]
            mask[row, column] = all(
                _depth(polygon[k] - polygon[k - 1], square, corners) > TOUCH_TOLERANCE_M
                for polygon in (square, corners)
                for k in (0, 1)
            )
    return mask


def _depth(
    axis: NDArray[np.float64], first: NDArray[np.float64], second: NDArray[np.float64]
) -> float:
    """Return by how much two polygons' shadows on an axis overlap."""
    a, b = (polygon @ (axis / np.hypot(*axis)) for polygon in (first, second))
    return float(min(a.max(), b.max()) - max(a.min(), b.min()))


_AXES = pytest.mark.parametrize("turn", [0, 1, 2, 3, 4, 7])


@_AXES
def test_a_footprint_that_ends_on_cell_edges_does_not_cover_the_next_cells(turn: int) -> None:
    """0.2 m x 0.1 m on cells of 0.1 m covers two cells, at 0, 90, 180 degrees and so on."""
    origin = RigidTransform.planar(-0.3, 0.1, 0.0)
    x, y = (0.0, 0.35) if turn % 2 == 0 else (0.05, 0.3)
    mask = _mask(_box(x, y, turn * np.pi / 2, 0.1, 0.05), origin, (0.1, 0.1))
    assert np.count_nonzero(mask) == 2


@pytest.mark.parametrize("resolution_m", [0.01, 0.05, 0.1, 0.3])
def test_rounding_of_decimal_edges_covers_no_extra_cell(resolution_m: float) -> None:
    """Edges at whole multiples of the resolution, which are no binary numbers, stay exact."""
    origin = RigidTransform.planar(0.0, 0.0, 0.0)
    for first in range(8):
        x = (first + 1.5) * resolution_m
        box = _box(x, 2.5 * resolution_m, 0.0, 1.5 * resolution_m, 0.5 * resolution_m)
        rows, columns = np.nonzero(_mask(box, origin, (resolution_m, resolution_m)))
        assert rows.tolist() == [2, 2, 2]
        assert columns.tolist() == [first, first + 1, first + 2]


def test_a_corner_that_meets_only_a_cell_corner_covers_nothing_there() -> None:
    """A square on its tip between four cells, half a cell's diagonal wide, covers just these."""
    origin = RigidTransform.planar(0.0, 0.0, 0.0)
    box = _box(3.0, 3.0, np.pi / 4, np.sqrt(0.5), np.sqrt(0.5))
    rows, columns = np.nonzero(_mask(box, origin, (1.0, 1.0)))
    assert list(zip(rows.tolist(), columns.tolist(), strict=True)) == [
        (2, 2),
        (2, 3),
        (3, 2),
        (3, 3),
    ]


def test_a_point_covers_the_cell_that_holds_it() -> None:
    """A footprint without area covers one cell, and outside the grid none."""
    origin = RigidTransform.planar(0.0, 0.0, 0.0)
    assert np.argwhere(_mask(_box(2.5, 4.5, 0.3, 0, 0), origin, (1.0, 1.0))).tolist() == [[4, 2]]
    assert not _mask(_box(-0.5, 4.5, 0.3, 0, 0), origin, (1.0, 1.0)).any()


@given(
    st.tuples(st.integers(-40, 160), st.integers(-40, 140)),
    st.integers(-24, 24),
    st.tuples(st.integers(1, 90), st.integers(1, 90)),
    st.integers(-12, 12),
    st.sampled_from([(0.1, 0.1), (0.1, 0.25), (0.2, 0.05)]),
)
def test_covered_cells_are_those_of_the_slow_twin(
    centre: tuple[int, int],
    turn: int,
    half: tuple[int, int],
    origin_turn: int,
    size_m: tuple[float, float],
) -> None:
    """On rotated lattices, also of unequal cells, inside and outside, at round angles."""
    origin = RigidTransform.planar(-0.2, 0.1, origin_turn * np.pi / 12)
    box = _box(centre[0] / 100, centre[1] / 100, turn * np.pi / 24, half[0] / 100, half[1] / 100)
    assert np.array_equal(_mask(box, origin, size_m), _slow_mask(box, origin, size_m))
