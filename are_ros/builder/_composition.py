"""Kernels that compose a costmap in place, rectangle by rectangle."""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled

Costs = npt.NDArray[np.uint8]
Published = npt.NDArray[np.int8]
Rectangles = npt.NDArray[np.int64]

INSCRIBED: Final = 253
NO_INFORMATION: Final = 255


@compiled
def restore(costs: Costs, static: Costs, places: Rectangles) -> None:
    """Copy the static layer into rectangles (N, 4) of row0, col0, row1, col1 (half-open)."""
    for i in range(places.shape[0]):
        row0, col0, row1, col1 = places[i, 0], places[i, 1], places[i, 2], places[i, 3]
        costs[row0:row1, col0:col1] = static[row0:row1, col0:col1]


@compiled
def stamp(costs: Costs, patch: Costs, row0: int, col0: int) -> None:
    """Raise the costs to an inflated patch whose first cell is (row0, col0), perhaps outside.

    An unknown cell, 255, already is the maximum; only an inscribed or lethal cost replaces it.
    """
    first_row, first_col = max(row0, 0), max(col0, 0)
    last_col = min(col0 + patch.shape[1], costs.shape[1])
    for r in range(first_row, min(row0 + patch.shape[0], costs.shape[0])):
        here = costs[r, first_col:last_col]
        there = patch[r - row0, first_col - col0 :]
        for c in range(here.shape[0]):
            highest = max(here[c], there[c])
            overrides = here[c] == NO_INFORMATION and there[c] >= INSCRIBED
            here[c] = there[c] if overrides else highest


@compiled
def publish(costs: Costs, scaled: Published, published: Published, places: Rectangles) -> bool:
    """Write `scaled[cost]` (256,) into rectangles (N, 4); return whether a byte changed."""
    difference = np.int8(0)
    for i in range(places.shape[0]):
        for r in range(places[i, 0], places[i, 2]):
            before = published[r, places[i, 1] : places[i, 3]]
            now = costs[r, places[i, 1] : places[i, 3]]
            for c in range(now.shape[0]):
                value = scaled[now[c]]
                difference |= value ^ before[c]
                before[c] = value
    return bool(difference != 0)
