"""Exact inflation of a mask of cells: squared distances in integers, then a table of costs."""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled

Costs = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]
Distances = npt.NDArray[np.unsignedinteger]

NARROW_RADIUS_CELLS: Final = 180
"""The widest reach r whose squared distances, at most (r + 1)^2 + r^2, fit in 16 bits."""

BLOCK_CELLS: Final = 4096
"""How much of a narrow patch is swept at a time: what a first-level cache holds with ease."""


def table_size(radius_cells: int) -> int:
    """Return how many squared distances [cells^2] `inflated` can ask a table of costs for."""
    return (radius_cells + 1) ** 2 + radius_cells**2 + 1


def inflated(mask: Mask, cost_of_d2: Costs, radius_cells: int, margin_cells: int) -> Costs:
    """Return the inflated costs of a mask (h, w), uint8 (h + 2 margin, w + 2 margin).

    `cost_of_d2[d2]` is the cost of a cell whose centre lies the square root of d2 cells from the
    nearest centre in the mask; it has `table_size(radius_cells)` entries, and those from
    (radius + 1)^2 on are 0. Exact: integers throughout, no approximation of the distance.
    """
    narrow = radius_cells <= NARROW_RADIUS_CELLS
    like: Distances = np.empty(0, np.uint16 if narrow else np.uint32)
    writable = np.array(mask, np.bool_, order="C")  # one type of array, so one compilation
    return _inflate(writable, cost_of_d2, radius_cells, margin_cells, like)


@compiled
def _inflate(mask: Mask, cost_of_d2: Costs, radius: int, margin: int, like: Distances) -> Costs:
    """Return the costs: distances along columns, down and up, then along rows, block by block.

    A distance above the radius counts as radius + 1, so that squares fit in `like`'s integers. The
    rows of a block lie in one line, with `radius` cells of padding before, between and after them.
    """
    vertical = np.full((mask.shape[0] + 2 * margin, mask.shape[1]), radius + 1, like.dtype)
    costs = np.zeros((vertical.shape[0], mask.shape[1] + 2 * margin), np.uint8)
    stride = costs.shape[1] + radius
    rows = min(max(BLOCK_CELLS // max(stride, 1), 1), costs.shape[0])
    line = np.full(rows * stride + radius, (radius + 1) * (radius + 1), like.dtype)
    nearest = np.empty(rows * stride, like.dtype)
    _mark(mask, vertical[margin:])
    for r in range(1, vertical.shape[0]):
        _step_along_columns(vertical[r], vertical[r - 1])
    for r in range(vertical.shape[0] - 1, -1, -1):
        if r + 1 < vertical.shape[0]:
            _step_along_columns(vertical[r], vertical[r + 1])
        if r % rows == 0:
            block = vertical[r : r + rows]
            if _square(block, radius, line[radius + margin :], stride):
                _least_in_window(line, radius, nearest)
                _look_up(nearest, cost_of_d2, costs[r : r + rows], stride)
    return costs


@compiled
def _mark(mask: Mask, vertical: Distances) -> None:
    for r in range(mask.shape[0]):
        for c in range(mask.shape[1]):
            if mask[r, c]:
                vertical[r, c] = 0


@compiled
def _step_along_columns(here: Distances, beside: Distances) -> None:
    """Lower each distance of a row to at most one more than that of the row beside it."""
    for c in range(here.shape[0]):
        here[c] = min(here[c], here.dtype.type(beside[c] + 1))


@compiled
def _square(distances: Distances, radius: int, line: Distances, stride: int) -> bool:
    """Write the squares of a block of rows; return whether any distance is within the radius."""
    least = radius + 1
    for r in range(distances.shape[0]):
        here = distances[r]
        squares = line[r * stride : r * stride + here.shape[0]]
        for c in range(here.shape[0]):
            squares[c] = here[c] * here[c]
            least = min(least, here[c])
    return least <= radius


@compiled
def _least_in_window(line: Distances, radius: int, nearest: Distances) -> None:
    """Fill with the least line[c + k] + k^2 over |k| <= radius; `line` is padded by the radius.

    One offset at a time: each pass is a long minimum in narrow integers, 16 or 32 to a vector
    instruction, which beats the lower envelope of parabolas (fewer steps, none of them in vectors).
    """
    width = nearest.shape[0]
    nearest[:] = line[radius : radius + width]
    for k in range(1, radius + 1):
        left = line[radius - k : radius - k + width]
        right = line[radius + k : radius + k + width]
        k2 = line.dtype.type(k * k)
        for c in range(width):
            nearest[c] = min(nearest[c], line.dtype.type(min(left[c], right[c]) + k2))


@compiled
def _look_up(d2: Distances, cost_of_d2: Costs, costs: Costs, stride: int) -> None:
    for r in range(costs.shape[0]):
        for c in range(costs.shape[1]):
            costs[r, c] = cost_of_d2[d2[r * stride + c]]
