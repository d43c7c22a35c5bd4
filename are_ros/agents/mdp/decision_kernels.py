"""Compiled loops of one epoch of backward induction: what the best action of each cell brings.

Directions are 0 east (columns grow), 1 north (rows grow), 2 west, 3 south; so are headings.
"""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.agents.mdp.coarse_kernels import COL_STEPS, ROW_STEPS

Floats = npt.NDArray[np.float32]
Lengths = npt.NDArray[np.int32]

CHUNK: Final = 1280
"""Cells at a time, whose intermediate results wait in a scratch of eight rows."""

_ROW: Final = np.uint64(CHUNK)
_ENDS: Final = np.uint64(4 * CHUNK)
"""The first four rows are the best move in each direction, the last what it leads to."""

_EAST, _WEST = np.uint64(1), np.uint64(2**64 - 1)
NEAR: Final = 3
FAR: Final = 6
"""Moves of up to so many cells are looked at all at once, at near paces and at others."""

_ONE, _TWO, _THREE = np.int32(1), np.int32(2), np.int32(3)

Four = tuple[np.float32, np.float32, np.float32, np.float32]
"""A number for each heading, or for each direction."""

Part = tuple[np.uint64, np.uint64, np.uint64]
"""Where the old values begin, the first cell of some in a row, and how many they are."""


class Process(NamedTuple):
    """What epochs are made of, for n = h * w cells; `flat` is where the values are (`induct`).

    `lengths` (4 n), `gains` ((1 + 4 P) n), `width` in cells. `reaches` (P,) are those of the paces,
    `lost` (P,) is what a failed move brings less than staying. `chances` are those of going as
    intended, of failing and of each side, `turns` what a quarter and a half turn cost. `settled`
    (n,) becomes the last epoch that changed anything in a cell.
    """

    flat: Floats
    lengths: Lengths
    gains: Floats
    width: int
    reaches: npt.NDArray[np.int64]
    lost: Floats
    chances: tuple[np.float32, np.float32, np.float32]
    turns: tuple[np.float32, np.float32]
    settled: npt.NDArray[np.int32]


# In the loops below all indices are unsigned (else negative ones would count from the end), and
# what is chosen from is read before: only then does the compiler make vector instructions of them.
# Of reading in the branches it would make gathers, which take longer.


@compiled
def move_near(process: Process, part: Part, pace: int, scratch: Floats) -> None:
    """Put what moves of a pace of up to three cells bring into the scratch, if it is better."""
    flat, lengths, (old, first, count) = process.flat, process.lengths, part
    north, south = np.uint64(process.width), np.uint64(-process.width)
    reach = np.int32(process.reaches[pace])
    for i in range(count):
        e, n, w, s = _in_planes(process, first + i)
        ends = (
            _three_on(flat, old + e, _EAST, min(lengths[e], reach)),
            _three_on(flat, old + n, north, min(lengths[n], reach)),
            _three_on(flat, old + w, _WEST, min(lengths[w], reach)),
            _three_on(flat, old + s, south, min(lengths[s], reach)),
        )
        _move(process, old, first + i, pace, ends, scratch, i)


@compiled
def move_far(process: Process, part: Part, pace: int, scratch: Floats) -> None:
    """Put what moves of a pace bring into the scratch, if it is better: first where they lead."""
    flat, lengths, (old, first, count) = process.flat, process.lengths, part
    reach, at, out = process.reaches[pace], first, _ENDS
    for direction in range(4):
        # to the west and south it wraps around, and back when it is added
        step = np.uint64(ROW_STEPS[direction] * process.width + COL_STEPS[direction])
        here = old + at
        for i in range(count):
            length = min(lengths[at + i], np.int32(reach))
            best = _three_on(flat, here + i, step, length)
            four = here + i + np.uint64(4) * step
            five = four + step
            best = _either(best, flat[four], length >= np.int32(4))
            best = _either(best, flat[five], length >= np.int32(5))
            scratch[out + i] = _either(best, flat[five + step], length >= np.int32(6))
        for k in range(FAR + 1, reach + 1):
            this, length_k = here + np.uint64(k) * step, np.int32(k)
            for i in range(count):
                is_longer = lengths[at + i] >= length_k
                scratch[out + i] = _either(scratch[out + i], flat[this + i], is_longer)
        at, out = at + np.uint64(process.settled.shape[0]), out + _ROW
    for i in range(count):
        e, w = _ENDS + i, _ENDS + _ROW + _ROW + i
        ends = (scratch[e], scratch[e + _ROW], scratch[w], scratch[w + _ROW])
        _move(process, old, first + i, pace, ends, scratch, i)


@compiled
def _move(
    process: Process,
    old: np.uint64,
    cell: np.uint64,
    pace: int,
    ends: Four,
    scratch: Floats,
    i: int,
) -> None:
    """Put the better of what is there and what moves bring, by direction, given their ends."""
    flat, gains, (straight, fails, aside) = process.flat, process.gains, process.chances
    e, n, w, s = _in_planes(process, cell)
    stay = gains[cell] - process.lost[pace]
    moves = (n - e) * np.uint64(1 + 4 * pace)
    east, north = ends[0] + gains[moves + e], ends[1] + gains[moves + n]
    west, south = ends[2] + gains[moves + w], ends[3] + gains[moves + s]
    of_x, of_y = aside * (north + south), aside * (east + west)
    is_first, to = pace == 0, np.uint64(i)
    east = (straight * east + of_x) + fails * (flat[old + e] + stay)
    scratch[to] = east if is_first else max(east, scratch[to])
    north = (straight * north + of_y) + fails * (flat[old + n] + stay)
    to += _ROW
    scratch[to] = north if is_first else max(north, scratch[to])
    west = (straight * west + of_x) + fails * (flat[old + w] + stay)
    to += _ROW
    scratch[to] = west if is_first else max(west, scratch[to])
    south = (straight * south + of_y) + fails * (flat[old + s] + stay)
    to += _ROW
    scratch[to] = south if is_first else max(south, scratch[to])


@compiled
def choose(
    process: Process, part: Part, new: np.uint64, epoch: np.int32, scratch: Floats
) -> np.int32:
    """Put the best of staying and the moves in the scratch, by heading, where `new` is.

    Returns the last epoch that changed any of the cells.
    """
    flat, gains, (old, first, count) = process.flat, process.gains, part
    quarter, half = process.turns
    for i in range(count):
        e, n, w, s = _in_planes(process, first + i)
        to, stay = np.uint64(i), gains[first + i]
        east, north = scratch[to], scratch[to + _ROW]
        west, south = scratch[to + _ROW + _ROW], scratch[to + _ROW + _ROW + _ROW]
        along_x, along_y = max(east, west) - quarter, max(north, south) - quarter
        scratch[to] = max(flat[old + e] + stay, east, along_y, west - half)
        to += _ROW
        scratch[to] = max(flat[old + n] + stay, north, along_x, south - half)
        to += _ROW
        scratch[to] = max(flat[old + w] + stay, west, along_y, east - half)
        to += _ROW
        scratch[to] = max(flat[old + s] + stay, south, along_x, north - half)

    settled = process.settled
    plane, at = np.uint64(settled.shape[0]), np.uint64(0)
    last: np.int32 = np.int32(0)
    old, new = old + first, new + first
    for _ in range(4):
        for i in range(count):
            value, before = scratch[at + i], settled[first + i]
            now = epoch if flat[old + i] != value else before
            flat[new + i], settled[first + i] = value, now
            last = max(last, now)
        old, new, at = old + plane, new + plane, at + _ROW
    return last


@compiled
def _in_planes(process: Process, cell: np.uint64) -> tuple[np.uint64, ...]:
    """Return where a cell is in each of four planes, by direction or heading."""
    plane = np.uint64(process.settled.shape[0])
    north = cell + plane
    west = north + plane
    return cell, north, west, west + plane


@compiled
def _three_on(values: Floats, here: np.uint64, step: np.uint64, length: np.int32) -> np.float32:
    """Choose among moves of up to three cells; where none is so long that value is not taken."""
    one = here + step
    two = one + step
    best = _either(values[here], values[one], length >= _ONE)
    best = _either(best, values[two], length >= _TWO)
    return _either(best, values[two + step], length >= _THREE)


@compiled
def _either(this: np.float32, other: np.float32, takes_other: bool) -> np.float32:
    return other if takes_other else this
