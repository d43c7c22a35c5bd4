"""Who is near: points in the cells of a hash grid, asked one place at a time."""

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled

_Floats = npt.NDArray[np.float64]
_Indices = npt.NDArray[np.int64]


class Neighbourhood:
    """N points of the plane that do not move, to be asked who is within a radius of a place."""

    def __init__(self, points_m: npt.NDArray[np.float64], cell_m: float = 4.0) -> None:
        """Sort points (N, 2), float64, metres, into cells; `cell_m` near the radii asked for."""
        self._points_m = np.ascontiguousarray(points_m)
        self._cell_m = cell_m
        self._order, self._starts, self._corner, self._shape = _sorted_into_cells(
            self._points_m, cell_m
        )

    def within(self, x_m: float, y_m: float, radius_m: float) -> npt.NDArray[np.int64]:
        """Return the indices of the points within the closed disc, the nearest first.

        Of two at the same distance the one of the lower index comes first.
        """
        return _within(
            x_m,
            y_m,
            radius_m,
            self._points_m,
            self._order,
            self._starts,
            self._corner,
            self._shape,
            self._cell_m,
        )


@compiled
def _sorted_into_cells(
    points_m: _Floats, cell_m: float
) -> tuple[_Indices, _Indices, _Floats, _Indices]:
    """Return indices by cell, where each cell starts (+ the end), the low corner, (rows, columns).

    Far outliers would make a huge table: then the cells beyond 4 N + 1024 wrap around.
    """
    count = points_m.shape[0]
    corner, shape = np.zeros(2), np.ones(2, np.int64)
    for axis in range(2):
        if count:
            corner[axis] = points_m[:, axis].min()
            extent = (points_m[:, axis].max() - corner[axis]) / cell_m
            shape[1 - axis] = min(np.int64(extent) + 1, 2 * count + 32)
    while shape[0] * shape[1] > 4 * count + 1024:
        shape[:] = np.maximum(shape // 2, 1)
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
    return order, starts, corner, shape


@compiled
def _within(
    x_m: float,
    y_m: float,
    radius_m: float,
    points_m: _Floats,
    order: _Indices,
    starts: _Indices,
    corner: _Floats,
    shape: _Indices,
    cell_m: float,
) -> _Indices:
    rows, columns = shape[0], shape[1]
    low_column = np.int64(np.floor((x_m - radius_m - corner[0]) / cell_m))
    low_row = np.int64(np.floor((y_m - radius_m - corner[1]) / cell_m))
    high_column = np.int64(np.floor((x_m + radius_m - corner[0]) / cell_m))
    high_row = np.int64(np.floor((y_m + radius_m - corner[1]) / cell_m))
    high_column = min(high_column, low_column + columns - 1)  # all columns once, where they wrap
    high_row = min(high_row, low_row + rows - 1)
    found = np.empty(points_m.shape[0], np.int64)
    squares = np.empty(points_m.shape[0])
    count = 0
    for row in range(low_row, high_row + 1):
        for column in range(low_column, high_column + 1):
            cell = (row % rows) * columns + column % columns
            for k in range(starts[cell], starts[cell + 1]):
                i = order[k]
                dx, dy = points_m[i, 0] - x_m, points_m[i, 1] - y_m
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
    return found[:count]
