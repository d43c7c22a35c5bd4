"""Neighbours: points in the cells of a spatial hash, queried one place at a time."""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, compiled

_EVERYWHERE_M: Final = 1e12
"""Within this radius is all that there is; cells so far away still have whole numbers."""

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
    """N fixed points of the plane; a query returns those within a radius of a place."""

    def __init__(self, points_m: npt.NDArray[np.float64], cell_m: float = 4.0) -> None:
        """Sort points (N, 2) [m], float64, into cells; `cell_m` should be near the usual radii."""
        self.cells = _sorted_into_cells(np.array(points_m, np.float64, order="C"), cell_m)
        """The fields of `Cells`; compiled code takes plain tuples much faster."""

    def within(self, x_m: float, y_m: float, radius_m: float) -> npt.NDArray[np.int64]:
        """Return the indices of the points within the closed disc, the nearest first.

        Of two at the same distance, the one with the lower index comes first. The radius may be
        infinite.
        """
        count = len(self.cells[0])
        found, radius_m = np.empty(count, np.int64), min(float(radius_m), _EVERYWHERE_M)
        return found[: find_near(self.cells, x_m, y_m, radius_m, found, np.empty(count))]

    def nearest_to(self, places_m: _Floats) -> _Indices:
        """Return the index of the point nearest to each place (M, 2), int64 (M,).

        Of several at the same distance, it is the first. There has to be a point.
        """
        return _nearest(self.cells, places_m)


@compiled
def _nearest(cells: CellArrays, places_m: _Floats) -> _Indices:
    count = cells[0].shape[0]
    found, squares = np.empty(count, np.int64), np.empty(count)
    nearest = np.empty(places_m.shape[0], np.int64)
    for k in range(places_m.shape[0]):
        x_m, y_m, radius_m = places_m[k, 0], places_m[k, 1], cells[5]
        while find_near(cells, x_m, y_m, radius_m, found, squares) == 0:
            radius_m *= 2.0
        nearest[k] = found[0]
    return nearest


def _sorted_into_cells(points_m: _Floats, cell_m: float) -> CellArrays:
    """Return the fields of `Cells`.

    Far outliers would need a huge table, so beyond 4 N + 1024 cells they wrap around.
    """
    count = len(points_m)
    if not count:
        return points_m, np.empty(0, np.int64), np.zeros(2, np.int64), 0.0, 0.0, cell_m, 1, 1
    corner_m = points_m.min(axis=0)
    steps = ((points_m - corner_m) / cell_m).astype(np.int64)
    columns, rows = np.minimum(steps.max(axis=0) + 1, 2 * count + 32).tolist()
    while rows * columns > 4 * count + 1024:
        rows, columns = max(rows // 2, 1), max(columns // 2, 1)
    cells = steps[:, 1] % rows * columns + steps[:, 0] % columns
    starts = np.zeros(rows * columns + 1, np.int64)
    np.cumsum(np.bincount(cells, minlength=rows * columns), out=starts[1:])
    order = np.argsort(cells, kind="stable")
    x0_m, y0_m = corner_m.tolist()
    return points_m, order, starts, x0_m, y0_m, cell_m, rows, columns


@borrowing
def find_near(
    arrays: CellArrays, x_m: float, y_m: float, radius_m: float, found: _Indices, squares: _Floats
) -> int:
    """Write what `Neighbourhood.within` returns into `found`; return how many there are.

    Their squared distances are written into `squares`. Both have room for all points. `arrays` are
    the fields of `Cells`.
    """
    cells = Cells(*arrays)
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
