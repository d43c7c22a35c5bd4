"""Queries for near points: a hash grid over points that do not move."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, compiled

_Floats = npt.NDArray[np.float64]
_Indices = npt.NDArray[np.int64]


class Cells(NamedTuple):
    """N points (N, 2) [m] by cell: `order` are their indices, `starts` where each cell begins.

    `x0_m`, `y0_m` is the low corner; beyond `rows` x `columns` the cells wrap around.
    """

    points_m: _Floats
    order: _Indices
    starts: _Indices
    x0_m: float
    y0_m: float
    cell_m: float
    rows: int
    columns: int


CellArrays = tuple[_Floats, _Indices, _Indices, float, float, float, int, int]
"""The fields of `Cells`."""


class Neighbourhood:
    """N points of the plane, to find those within a radius of a position."""

    def __init__(self, points_m: npt.NDArray[np.float64], cell_m: float = 4.0) -> None:
        """Sort points (N, 2) [m], float64, into cells; `cell_m` should be near the usual radii."""
        self.cells = _sorted_into_cells(np.ascontiguousarray(points_m), cell_m)
        """The fields of `Cells`; compiled code takes plain tuples much faster."""

    def within(self, x_m: float, y_m: float, radius_m: float) -> npt.NDArray[np.int64]:
        """Return the indices of the points within the closed disc, the nearest first.

        Of two at the same distance, the one with the lower index comes first.
        """
        return _near(self.cells, x_m, y_m, radius_m)

    def points_within(
        self, x_m: float, y_m: float, radius_m: float, ids: _Indices, but_id: int
    ) -> _Floats:
        """Return the points (M, 2) that `within` finds, except that of one id; `ids` is (N,)."""
        return _points_near(self.cells, x_m, y_m, radius_m, ids, but_id)


@compiled
def nearest_of(points_m: _Floats, places_m: _Floats) -> _Indices:
    """Return the index of the nearest of places (K, 2), K > 0, for each point (M, 2): (M,).

    Of several at the same distance, it is the first.
    """
    found = np.zeros(points_m.shape[0], np.int64)
    for i in range(points_m.shape[0]):
        least = np.inf
        for k in range(places_m.shape[0]):
            dx_m, dy_m = points_m[i, 0] - places_m[k, 0], points_m[i, 1] - places_m[k, 1]
            square = dx_m * dx_m + dy_m * dy_m
            if square < least:
                least, found[i] = square, k
    return found


@compiled
def _near(cells: CellArrays, x_m: float, y_m: float, radius_m: float) -> _Indices:
    count = cells[0].shape[0]
    found = np.empty(count, np.int64)
    return found[: find_near(Cells(*cells), x_m, y_m, radius_m, found, np.empty(count))]


@compiled
def _points_near(
    cells: CellArrays, x_m: float, y_m: float, radius_m: float, ids: _Indices, but_id: int
) -> _Floats:
    found = _near(cells, x_m, y_m, radius_m)
    points_m, count = np.empty((found.shape[0], 2)), 0
    for i in found:
        if ids[i] != but_id:
            points_m[count, 0], points_m[count, 1] = cells[0][i, 0], cells[0][i, 1]
            count += 1
    return points_m[:count]


@compiled
def _sorted_into_cells(points_m: _Floats, cell_m: float) -> CellArrays:
    """Return the fields of `Cells`.

    Far outliers would need a huge table, so beyond 4 N + 1024 cells they wrap around.
    """
    count = points_m.shape[0]
    corner, shape = np.zeros(2), np.ones(2, np.int64)
    for axis in range(2):
        if count:
            corner[axis] = points_m[:, axis].min()
            extent = (points_m[:, axis].max() - corner[axis]) / cell_m
            shape[1 - axis] = min(np.int64(extent) + 1, 2 * count + 32)
    while shape[0] * shape[1] > 4 * count + 1024:
        shape[0], shape[1] = max(shape[0] // 2, 1), max(shape[1] // 2, 1)
    cells = np.empty(count, np.int64)
    starts = np.zeros(shape[0] * shape[1] + 1, np.int64)
    for i in range(count):
        column = np.int64((points_m[i, 0] - corner[0]) / cell_m) % shape[1]
        row = np.int64((points_m[i, 1] - corner[1]) / cell_m) % shape[0]
        cells[i] = row * shape[1] + column
        starts[cells[i] + 1] += 1
    starts = np.cumsum(starts)
    order, filled = np.empty(count, np.int64), starts.copy()
    for i in range(count):
        order[filled[cells[i]]] = i
        filled[cells[i]] += 1
    return points_m, order, starts, corner[0], corner[1], cell_m, shape[0], shape[1]


@borrowing
def find_near(
    cells: Cells, x_m: float, y_m: float, radius_m: float, found: _Indices, squares: _Floats
) -> int:
    """Write what `Neighbourhood.within` returns into `found`; return how many there are.

    Their squared distances are written into `squares`. Both have room for all points.
    """
    rows, columns = cells.rows, cells.columns
    low_column = np.int64(np.floor((x_m - radius_m - cells.x0_m) / cells.cell_m))
    low_row = np.int64(np.floor((y_m - radius_m - cells.y0_m) / cells.cell_m))
    high_column = np.int64(np.floor((x_m + radius_m - cells.x0_m) / cells.cell_m))
    high_row = np.int64(np.floor((y_m + radius_m - cells.y0_m) / cells.cell_m))
    high_column = min(high_column, low_column + columns - 1)  # all columns once, where they wrap
    high_row = min(high_row, low_row + rows - 1)
    count = 0
    for row in range(low_row, high_row + 1):
        for column in range(low_column, high_column + 1):
            cell = (row % rows) * columns + column % columns
            for k in range(cells.starts[cell], cells.starts[cell + 1]):
                i = cells.order[k]
                dx, dy = cells.points_m[i, 0] - x_m, cells.points_m[i, 1] - y_m
                square = dx * dx + dy * dy
                if square <= radius_m * radius_m:
                    at = count
                    while at > 0 and (
                        squares[at - 1] > square
                        or (squares[at - 1] == square and found[at - 1] > i)
                    ):
                        squares[at], found[at] = squares[at - 1], found[at - 1]
                        at -= 1
                    squares[at], found[at] = square, i
                    count += 1
    return count
