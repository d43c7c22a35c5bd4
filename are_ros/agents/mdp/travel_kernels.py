"""Compiled loops that make a decision process: prices of ways, moves, and what they bring.

Directions are 0 east (columns grow), 1 north (rows grow), 2 west, 3 south; so are headings.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.agents.mdp.coarse_kernels import COL_STEPS, ROW_STEPS

Floats = npt.NDArray[np.float32]
Lengths = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]

MOST_BUCKETS: Final = 65536


def cut_out(edges: Mask, window: tuple[tuple[int, int], tuple[int, int]]) -> Mask:
    """Return the edges bool (4, h, w) of a window of the map; those that lead out are closed.

    It goes from its first cell up to its second, without that.
    """
    (row, col), (end_row, end_col) = window
    inner: Mask = edges[:, row:end_row, col:end_col].copy()
    inner[0, :, -1], inner[1, -1, :], inner[2, :, 0], inner[3, 0, :] = False, False, False, False
    return inner


def way_prices(edges: Mask, price: Floats, reach: int, goal: tuple[int, int]) -> Floats:
    """Return what the cheapest way to a cell costs, cell by cell: float32 (h, w), inf if none.

    A step into a cell costs its price over the reach. Dijkstra's algorithm from the goal with
    Dial's buckets: as wide as the cheapest step is dear, so that hardly any cell is looked at
    twice, and as many, in a ring, as the dearest step needs. Entries form a list in each.
    """
    height, width = price.shape
    count = height * width
    steps = price.reshape(count) / np.float32(reach)
    dearest = steps.max()
    bucket = max(steps.min(), dearest / np.float32(MOST_BUCKETS))
    ring = 1
    while ring < int(dearest / bucket) + 3:
        ring *= 2
    costs, heads = np.empty(count, np.float32), np.empty(ring, np.int32)
    start = goal[0] * width + goal[1]
    room = 2 * count + 4
    per_price = np.float32(1.0) / bucket
    while not _spread(edges.reshape(4, count), steps, width, start, per_price, heads, room, costs):
        room *= 2  # many cells were looked at several times: rounding, wild prices
    return costs.reshape(height, width)


@compiled
def _spread(
    edges: Mask,
    steps: Floats,
    width: int,
    start: int,
    buckets_per_price: np.float32,
    heads: npt.NDArray[np.int32],
    room: int,
    costs: Floats,
) -> bool:
    """Fill in the costs (h * w); False if there was no room for so many entries."""
    costs[:], heads[:] = np.inf, -1
    after, cells = np.empty(room, np.int32), np.empty(room, np.int32)
    keys = np.empty(room, np.float32)
    waiting = made = 1
    place, ring = 0, heads.shape[0]
    costs[start] = keys[0] = 0.0
    cells[0], after[0], heads[0] = start, -1, 0
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
        if made + 4 > room:
            return False
        for direction in range(4):
            other = cell + ROW_STEPS[direction] * width + COL_STEPS[direction]
            if edges[direction, cell] and cost < costs[other]:
                costs[other] = keys[made] = cost
                target = int(cost * buckets_per_price) & (ring - 1)
                cells[made], after[made], heads[target] = other, heads[target], made
                waiting += 1
                made += 1
    return True


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
    lengths: Lengths,
    costs: Floats,
    price: Floats,
    reaches: npt.NDArray[np.int64],
    effort: npt.NDArray[np.float64],
    time: float,
    rest: float,
    goal: tuple[int, int],
) -> Floats:
    """Return what an epoch brings: float32 (1 + 4 P, h, w), staying and the moves of each pace.

    A move pays the price of each cell that it enters, more by the share that its pace's effort is
    of `time`, over its reach; one that is blocked pays for the cell and the effort. Staying pays
    the price less `rest`. Staying at the goal, and where there is no way to it, is free, and
    anything else costs 1 there: those states are absorbing.
    """
    height, width = price.shape
    gains = np.empty((1 + 4 * reaches.shape[0], height, width), np.float32)
    # sums of the prices up to each cell, itself included, along its row and along its column
    along, across = np.zeros((height, width)), np.zeros((height, width))
    for row in range(height):
        for col in range(width):
            here = price[row, col]
            along[row, col] = here + (along[row, col - 1] if col > 0 else 0.0)
            across[row, col] = here + (across[row - 1, col] if row > 0 else 0.0)
            is_absorbing = costs[row, col] == np.inf or (row == goal[0] and col == goal[1])
            gains[0, row, col] = np.float32(0.0 if is_absorbing else rest - here)
    for move in range(4 * reaches.shape[0]):
        pace, direction = move // 4, move % 4
        dearer = (1.0 + effort[pace] / time) / reaches[pace]
        sums = across if direction % 2 else along
        row_step, col_step = ROW_STEPS[direction], COL_STEPS[direction]
        for row in range(height):
            for col in range(width):
                length = min(np.int64(lengths[direction, row, col]), reaches[pace])
                last_row, last_col = row + length * row_step, col + length * col_step
                swept = sums[last_row, last_col] - sums[row, col]
                if direction >= 2:  # the sums count the cell itself, and not the last one
                    swept = price[last_row, last_col] - price[row, col] - swept
                cost = swept * dearer if length > 0 else price[row, col] + effort[pace]
                if costs[row, col] == np.inf or (row == goal[0] and col == goal[1]):
                    cost = 1.0
                gains[1 + move, row, col] = np.float32(-cost)
    return gains


@compiled
def turns_left(lengths: Lengths, costs: Floats, quarter: float, half: float) -> Floats:
    """Return a bound of what turning costs on the cheapest ways: float32 (4, h, w), by heading.

    To turn to the first step costs the least of the directions in which the way gets shorter; where
    these lie along both axes, a quarter turn follows later. Turns round walls are not counted. 0 at
    the goal, and where there is no way to it.
    """
    _, height, width = lengths.shape
    turns = np.zeros(lengths.shape, np.float32)
    for row in range(height):
        for col in range(width):
            nearer = 0  # a bit for each direction
            for direction in range(4):
                if lengths[direction, row, col] > 0:
                    next_row, next_col = row + ROW_STEPS[direction], col + COL_STEPS[direction]
                    nearer |= (costs[next_row, next_col] < costs[row, col]) << direction
            later = quarter if nearer & 5 and nearer & 10 else 0.0
            for heading in range(4):
                ahead = (nearer >> heading | nearer << (4 - heading)) & 15  # bit 0 is ahead
                first = 0.0 if ahead & 1 else quarter if ahead & 10 else half
                turns[heading, row, col] = np.float32(first + later if nearer else 0.0)
    return turns
