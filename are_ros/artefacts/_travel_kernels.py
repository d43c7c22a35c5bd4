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
    count = height * width
    costs = np.full(count, np.inf, np.float32)
    steps = (price / np.float32(reach)).ravel()
    bucket = max(steps.min(), steps.max() / np.float32(MOST_BUCKETS))
    ring = 1
    while ring < int(steps.max() / bucket) + 3:
        ring *= 2
    heads = np.full(ring, -1, np.int32)
    after, cells = np.empty(2 * count + 4, np.int32), np.empty(2 * count + 4, np.int32)
    keys = np.empty(2 * count + 4, np.float32)
    start = goal[0] * width + goal[1]
    costs[start] = keys[0] = 0.0
    heads[0], after[0], cells[0] = 0, -1, start
    waiting, made, place = 1, 1, 0
    open_edges = edges.reshape(4, count)
    while waiting > 0:
        entry = heads[place]
        if entry < 0:
            place = (place + 1) & (ring - 1)
            continue
        heads[place] = after[entry]
        waiting -= 1
        cell = cells[entry]
        if keys[entry] > costs[cell]:
            continue
        cost = keys[entry] + steps[cell]
        if made + 4 > keys.size:  # many cells were looked at several times: rounding, wild prices
            keys, after, cells = _grown(keys), _grown(after), _grown(cells)
        for direction in range(4):
            other = cell + ROW_STEPS[direction] * width + COL_STEPS[direction]
            if open_edges[direction, cell] and cost < costs[other]:
                costs[other] = keys[made] = cost
                target = int(cost / bucket) & (ring - 1)
                cells[made], after[made], heads[target] = other, heads[target], made
                waiting += 1
                made += 1
    return costs.reshape(height, width)


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
    _, height, width = edges.shape
    lengths = np.zeros(edges.shape, np.uint8)
    # how many cells one would go on from the row or column before: lines are gone through backwards
    along, across = np.zeros(height, np.int64), np.zeros(width, np.int64)
    for direction in range(4):
        along[:], across[:] = 0, 0
        row_step, col_step = ROW_STEPS[direction], COL_STEPS[direction]
        for i in range(height):
            row = i if row_step < 0 else height - 1 - i
            for j in range(width):
                col = j if col_step < 0 else width - 1 - j
                further = along[row] if row_step == 0 else across[col]
                if edges[direction, row, col]:
                    here, there = costs[row, col], costs[row + row_step, col + col_step]
                    if here < np.inf:
                        lengths[direction, row, col] = min(reach, 1 + further)
                    further = further + 1 if there <= here else 0
                else:
                    further = 0
                if row_step == 0:
                    along[row] = further
                else:
                    across[col] = further
    lengths[:, goal[0], goal[1]] = 0
    return lengths


@compiled
def find_gains(
    lengths: Lengths, costs: Floats, price: Floats, reach: int, goal: tuple[int, int]
) -> Floats:
    """Return what an epoch brings: float32 (5, h, w), the four directions and then staying.

    A move pays the price of each cell that it enters, over the reach; one that is blocked pays
    for staying. Staying at the goal, and where there is no way to it, is free, and anything else
    costs 1 there: those states are absorbing.
    """
    height, width = price.shape
    gains = np.empty((5, height, width), np.float32)
    # sums of the prices up to each cell, itself included, along its row and along its column
    along, across = np.zeros(width), np.zeros((height, width))
    for row in range(height):
        for col in range(width):
            along[col] = price[row, col] + (along[col - 1] if col > 0 else 0.0)
            across[row, col] = price[row, col] + (across[row - 1, col] if row > 0 else 0.0)
        for col in range(width):
            blocked = -price[row, col]
            east, west = lengths[0, row, col], lengths[2, row, col]
            gain = np.float32((along[col] - along[col + east]) / reach)
            gains[0, row, col] = gain if east > 0 else blocked
            swept = along[max(col - 1, 0)] - (along[col - west - 1] if col > west else 0.0)
            gains[2, row, col] = np.float32(-swept / reach) if west > 0 else blocked
            gains[4, row, col] = blocked
    for row in range(height):
        for col in range(width):
            blocked = -price[row, col]
            north, south = lengths[1, row, col], lengths[3, row, col]
            gain = np.float32((across[row, col] - across[row + north, col]) / reach)
            gains[1, row, col] = gain if north > 0 else blocked
            swept = across[max(row - 1, 0), col]
            swept -= across[row - south - 1, col] if row > south else 0.0
            gains[3, row, col] = np.float32(-swept / reach) if south > 0 else blocked
            if costs[row, col] == np.inf or (row == goal[0] and col == goal[1]):
                gains[:4, row, col] = np.float32(-1.0)
                gains[4, row, col] = np.float32(0.0)
    return gains
