"""Compiled loops that make a decision process: prices of ways, moves, and what they bring.

Directions are 0 east (columns grow), 1 north (rows grow), 2 west, 3 south; so are headings.
"""

from typing import Final, TypeVar

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.artefacts._coarse_kernels import COL_STEPS, ROW_STEPS

Floats = npt.NDArray[np.float32]
Lengths = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]

_Array = TypeVar("_Array", npt.NDArray[np.float32], npt.NDArray[np.int32])

MOST_BUCKETS: Final = 65536


@compiled
def way_prices(edges: Mask, price: Floats, reach: int, goal: tuple[int, int]) -> Floats:
    """Return what the cheapest way to the goal costs, cell by cell: float32 (h, w), inf if none.

    A step into a cell costs its price over the reach. Dijkstra's algorithm from the goal with
    Dial's buckets: as wide as the cheapest step is dear, so that hardly any cell is looked at
    twice, and as many, in a ring, as the dearest step needs. Entries form a list in each.
    """
    height, width = price.shape
    costs = np.full((height, width), np.inf, np.float32)
    steps = price / np.float32(reach)
    bucket = max(steps.min(), steps.max() / np.float32(MOST_BUCKETS))
    heads = np.full(int(steps.max() / bucket) + 3, -1, np.int32)
    after, cells = np.empty(4 * price.size + 4, np.int32), np.empty(4 * price.size + 4, np.int32)
    keys = np.empty(4 * price.size + 4, np.float32)
    costs[goal] = keys[0] = 0.0
    heads[0], after[0], cells[0] = 0, -1, goal[0] * width + goal[1]
    waiting, made, place = 1, 1, 0
    while waiting > 0:
        entry = heads[place]
        if entry < 0:
            place = (place + 1) % heads.size
            continue
        heads[place] = after[entry]
        waiting -= 1
        row, col = cells[entry] // width, cells[entry] % width
        if keys[entry] > costs[row, col]:
            continue
        cost = keys[entry] + steps[row, col]
        if made + 4 > keys.size:  # many cells were looked at several times: rounding, wild prices
            keys, after, cells = _grown(keys), _grown(after), _grown(cells)
        for direction in range(4):
            r, c = row + ROW_STEPS[direction], col + COL_STEPS[direction]
            if edges[direction, row, col] and cost < costs[r, c]:
                costs[r, c] = keys[made] = cost
                target = int(cost / bucket) % heads.size
                cells[made], after[made], heads[target] = r * width + c, heads[target], made
                waiting += 1
                made += 1
    return costs


@compiled
def _grown(array: _Array) -> _Array:
    return np.concatenate((array, np.empty_like(array)))


@compiled
def find_moves(edges: Mask, costs: Floats, reach: int, goal: tuple[int, int]) -> Lengths:
    """Return how many cells one goes from each cell in each direction: uint8 (4, h, w).

    At most `reach`, up to a closed edge, to the goal, and to where going on would lead away from
    the goal again (after the first cell): otherwise doors and corners between the multiples of the
    reach could not be used. 0 at the goal and where there is no way to it.
    """
    lengths = np.zeros(edges.shape, np.uint8)
    for direction in range(4):
        for row in range(edges.shape[1]):
            for col in range(edges.shape[2]):
                if (row, col) != goal and costs[row, col] < np.inf:
                    lengths[direction, row, col] = _length(
                        edges[direction], costs, reach, direction, row, col
                    )
    return lengths


@compiled
def _length(edges: Mask, costs: Floats, reach: int, direction: int, row: int, col: int) -> int:
    """Return how far one goes from one cell; the goal is where the costs are least."""
    length = 0
    while length < reach and edges[row, col]:
        r, c = row + ROW_STEPS[direction], col + COL_STEPS[direction]
        if length > 0 and costs[r, c] > costs[row, col]:
            break
        row, col = r, c
        length += 1
    return length


@compiled
def find_gains(
    lengths: Lengths, costs: Floats, price: Floats, reach: int, goal: tuple[int, int]
) -> Floats:
    """Return what an epoch brings: float32 (5, h, w), the four directions and then staying.

    A move pays the price of each cell that it enters, over the reach; one that is blocked pays
    for staying. Staying at the goal, and where there is no way to it, is free, and anything else
    costs 1 there: those states are absorbing.
    """
    gains = np.empty((5, *price.shape), np.float32)
    for row in range(price.shape[0]):
        for col in range(price.shape[1]):
            ends = (row, col) == goal or costs[row, col] == np.inf
            gains[4, row, col] = np.float32(0.0) if ends else -price[row, col]
            for direction in range(4):
                gain = np.float32(-1.0) if ends else -price[row, col]
                if lengths[direction, row, col] > 0:
                    length = lengths[direction, row, col]
                    gain = np.float32(-_swept(price, direction, row, col, length) / reach)
                gains[direction, row, col] = gain
    return gains


@compiled
def _swept(price: Floats, direction: int, row: int, col: int, length: int) -> float:
    """Return the sum of the prices of the cells that a move enters."""
    total = 0.0
    for k in range(1, length + 1):
        total += price[row + k * ROW_STEPS[direction], col + k * COL_STEPS[direction]]
    return total
