"""Compiled loops of the decision process: prices of ways, moves, and backward induction.

Directions are 0 east (columns grow), 1 north (rows grow), 2 west, 3 south; so are headings.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled

Floats = npt.NDArray[np.float32]
Lengths = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]

CHUNK: Final = 2048
"""Cells at a time: four rows of so many float32 are the scratch, which stays in the cache."""

EPOCHS_AT_ONCE: Final = 8

ROW_STEPS: Final = (0, 1, 0, -1)
COL_STEPS: Final = (1, 0, -1, 0)

_SECOND: Final = CHUNK
_THIRD: Final = 2 * CHUNK
_FOURTH: Final = 3 * CHUNK


@compiled
def way_prices(edges: Mask, price: Floats, reach: int, goal: tuple[int, int]) -> Floats:
    """Return what the cheapest way to the goal costs, cell by cell: float32 (h, w), inf if none.

    A step into a cell costs its price over the reach. Dijkstra's algorithm from the goal, with a
    binary heap; a cell may stand in the heap several times.
    """
    height, width = price.shape
    costs = np.full((height, width), np.inf, np.float32)
    keys = np.empty(4 * price.size + 4, np.float32)
    cells = np.empty(4 * price.size + 4, np.int32)
    costs[goal] = 0.0
    size = _push(keys, cells, 0, np.float32(0.0), goal[0] * width + goal[1])
    while size > 0:
        key, cell = keys[0], cells[0]
        size = _pop(keys, cells, size)
        row, col = cell // width, cell % width
        if key > costs[row, col]:
            continue
        cost = key + price[row, col] / np.float32(reach)
        for direction in range(4):
            if edges[direction, row, col]:
                r, c = row + ROW_STEPS[direction], col + COL_STEPS[direction]
                if cost < costs[r, c]:
                    costs[r, c] = cost
                    size = _push(keys, cells, size, cost, r * width + c)
    return costs


@compiled
def _push(keys: Floats, cells: npt.NDArray[np.int32], size: int, key: np.float32, cell: int) -> int:
    """Put one entry into the heap, and return its new size."""
    place = size
    while place > 0:
        parent = (place - 1) // 2
        if keys[parent] <= key:
            break
        keys[place], cells[place] = keys[parent], cells[parent]
        place = parent
    keys[place], cells[place] = key, cell
    return size + 1


@compiled
def _pop(keys: Floats, cells: npt.NDArray[np.int32], size: int) -> int:
    """Take the first entry out of the heap, and return its new size."""
    size -= 1
    key, cell = keys[size], cells[size]
    place = 0
    while 2 * place + 1 < size:
        child = 2 * place + 1
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if key <= keys[child]:
            break
        keys[place], cells[place] = keys[child], cells[child]
        place = child
    keys[place], cells[place] = key, cell
    return size


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


@compiled
def induct(
    flat: Floats,
    kept: int,
    width: int,
    lengths: Lengths,
    gains: Floats,
    reach: int,
    chances: tuple[np.float32, np.float32],
    turns: tuple[np.float32, np.float32],
    horizon: int,
) -> int:
    """Fill V_1 .. V_horizon by backward induction, and return the last epoch computed.

    `flat` holds reach * width numbers that do not matter (so that looking that far is allowed
    everywhere), `kept` times four planes of n = h * w cells, one per heading, and as much again;
    epoch h is in place h % kept, V_0 is given. `lengths` (4, n), `gains` (5, n), `chances` of going
    straight and of each side, `turns` what a quarter and a half turn cost. Ends early when
    nothing has changed: so it would go on.

    Several epochs go over the map at once, each as far behind the one before as a move reaches,
    so that what one has read is still in the cache for the next.
    """
    scratch = np.zeros(4 * CHUNK, np.float32)
    chunks = (lengths.shape[1] + CHUNK - 1) // CHUNK
    lag = (reach * width + CHUNK - 1) // CHUNK + 1
    for first in range(1, horizon + 1, EPOCHS_AT_ONCE):
        count = min(EPOCHS_AT_ONCE, horizon + 1 - first)
        changed = np.zeros(count, np.bool_)
        for step in range(chunks + (count - 1) * lag):
            for k in range(count):
                start = (step - k * lag) * CHUNK
                if 0 <= start < lengths.shape[1]:
                    changed[k] |= _improve(
                        flat,
                        first + k,
                        kept,
                        start,
                        width,
                        lengths,
                        gains,
                        reach,
                        chances,
                        turns,
                        scratch,
                        changed[k],
                    )
        for k in range(count):
            if not changed[k]:
                return first + k
    return horizon


@compiled
def _improve(
    flat: Floats,
    epoch: int,
    kept: int,
    start: int,
    width: int,
    lengths: Lengths,
    gains: Floats,
    reach: int,
    chances: tuple[np.float32, np.float32],
    turns: tuple[np.float32, np.float32],
    scratch: Floats,
    changed: bool,
) -> bool:
    """Compute one chunk of V of an epoch; tell whether it differs from that of the one before."""
    cells = lengths.shape[1]
    end = min(start + CHUNK, cells)
    old = reach * width + ((epoch - 1) % kept) * 4 * cells
    new = reach * width + (epoch % kept) * 4 * cells
    _arrive(flat, old, start, end, width, lengths, gains, reach, scratch)
    _decide(
        scratch,
        flat[old + start : old + end],
        flat[old + cells + start : old + cells + end],
        flat[old + 2 * cells + start : old + 2 * cells + end],
        flat[old + 3 * cells + start : old + 3 * cells + end],
        gains[4, start:end],
        chances,
        turns,
    )
    return _put(flat, old + start, new + start, end - start, cells, scratch, changed)


@compiled
def _arrive(
    flat: Floats,
    old: int,
    start: int,
    end: int,
    width: int,
    lengths: Lengths,
    gains: Floats,
    reach: int,
    scratch: Floats,
) -> None:
    """Put into the scratch what each direction brings from each cell."""
    cells = lengths.shape[1]
    for direction in range(4):
        first, last = old + direction * cells + start, old + direction * cells + end
        step = ROW_STEPS[direction] * width + COL_STEPS[direction]
        length, gain = lengths[direction, start:end], gains[direction, start:end]
        out = scratch[direction * CHUNK :][: end - start]
        here, one = flat[first:last], flat[first + step : last + step]
        _by_one(out, here, one, length, gain)
        for k in range(2, reach + 1, 2):
            this = flat[first + k * step : last + k * step]
            further = flat[first + (k + 1) * step : last + (k + 1) * step] if k < reach else this
            _by_more(out, this, further, length, np.uint8(k), gain)


# The loops below run over slices that begin at 0, load whatever they may need before they choose,
# write to one array each and read from few others: only then does the compiler make vector
# instructions of them (it tests at run time that what is written overlaps nothing that is read,
# for up to eight arrays).


@compiled
def _by_one(out: Floats, here: Floats, one: Floats, length: Lengths, gain: Floats) -> None:
    for i in range(out.shape[0]):
        stays, goes = here[i], one[i]
        out[i] = (goes if length[i] != np.uint8(0) else stays) + gain[i]


@compiled
def _by_more(
    out: Floats, this: Floats, further: Floats, length: Lengths, shorter: np.uint8, gain: Floats
) -> None:
    """Replace what moves of length `shorter` bring by `this`, those of one more by `further`."""
    longer = np.uint8(shorter + 1)
    for i in range(out.shape[0]):
        nearer, goes, goes_on = out[i], this[i] + gain[i], further[i] + gain[i]
        best = goes if length[i] == shorter else nearer
        out[i] = goes_on if length[i] == longer else best


@compiled
def _decide(
    scratch: Floats,
    facing_east: Floats,
    facing_north: Floats,
    facing_west: Floats,
    facing_south: Floats,
    stay: Floats,
    chances: tuple[np.float32, np.float32],
    turns: tuple[np.float32, np.float32],
) -> None:
    """Replace what each direction brings by what the best of five actions brings, by heading."""
    straight, aside = chances
    quarter, half = turns
    for i in range(stay.shape[0]):
        east, north = scratch[i], scratch[_SECOND + i]
        west, south = scratch[_THIRD + i], scratch[_FOURTH + i]
        sides_of_x, sides_of_y = aside * (north + south), aside * (east + west)
        east, west = straight * east + sides_of_x, straight * west + sides_of_x
        north, south = straight * north + sides_of_y, straight * south + sides_of_y
        along_x, along_y = max(east, west) - quarter, max(north, south) - quarter
        scratch[i] = max(facing_east[i] + stay[i], east, along_y, west - half)
        scratch[_SECOND + i] = max(facing_north[i] + stay[i], north, along_x, south - half)
        scratch[_THIRD + i] = max(facing_west[i] + stay[i], west, along_y, east - half)
        scratch[_FOURTH + i] = max(facing_south[i] + stay[i], south, along_x, north - half)


@compiled
def _put(
    flat: Floats, old: int, new: int, count: int, cells: int, scratch: Floats, changed: bool
) -> bool:
    """Copy the new values to their place; tell whether any differs from the old, or it is known."""
    for heading in range(4):
        values = scratch[heading * CHUNK :][:count]
        _copy(flat[new + heading * cells : new + heading * cells + count], values)
        if not changed:
            changed = _differ(flat[old + heading * cells : old + heading * cells + count], values)
    return changed


@compiled
def _copy(out: Floats, values: Floats) -> None:
    for i in range(out.shape[0]):
        out[i] = values[i]


@compiled
def _differ(one: Floats, other: Floats) -> bool:
    count = 0
    for i in range(one.shape[0]):
        count += one[i] != other[i]
    return count > 0
