"""Compiled loops of one epoch of backward induction: what the best action of each cell brings.

Directions are 0 east (columns grow), 1 north (rows grow), 2 west, 3 south; so are headings.
"""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.agents.mdp.coarse_kernels import COL_STEPS, ROW_STEPS

Floats = npt.NDArray[np.float32]
Lengths = npt.NDArray[np.uint8]

CHUNK: Final = 1280
"""Cells at a time, where new values wait in a scratch before they take the place of old ones."""

ROW: Final = np.uint64(CHUNK)
"""So far apart are the headings, or the directions, in a scratch of twelve rows."""

_FOUND: Final = np.uint64(8 * CHUNK)
"""From here on are the last four rows: what each direction leads to."""

_EAST, _WEST = np.uint64(1), np.uint64(2**64 - 1)
NEAR: Final = 3
"""Moves of up to so many cells are looked at all at once."""

_NONE, _TWO, _THREE = np.uint8(0), np.uint8(2), np.uint8(3)

Four = tuple[np.float32, np.float32, np.float32, np.float32]
"""A number for each heading, or for each direction."""

Part = tuple[np.uint64, np.uint64, np.uint64]
"""Where the old values begin, the first cell of some in a row, and how many they are."""

Place = tuple[Floats, np.uint64, np.uint64]
"""Where new values of a part go: from where on in an array, and how far apart the headings are."""


class Process(NamedTuple):
    """What epochs are made of, for n = h * w cells; `flat` is where the values are (`induct`).

    `lengths` (4 n), `gains` (5 n), `width` and `reach` in cells, `chances` of going straight and of
    each side, `turns` what a quarter and a half turn cost.
    """

    flat: Floats
    lengths: Lengths
    gains: Floats
    width: int
    reach: int
    chances: tuple[np.float32, np.float32]
    turns: tuple[np.float32, np.float32]


# In the loops below all indices are unsigned (else negative ones would count from the end), and
# what is chosen from is read before: only then does the compiler make vector instructions of them.
# Of reading in the branches it would make gathers, which take longer.


@compiled
def decide_by_one(process: Process, part: Part, to: Place) -> None:
    """Decide where moves are of one cell."""
    flat, lengths, (old, first, count) = process.flat, process.lengths, part
    north, south = np.uint64(process.width), np.uint64(-process.width)
    for i in range(count):
        e, n, w, s = _in_planes(lengths, first + i)
        ends = (
            _either(flat[old + e], flat[old + e + _EAST], lengths[e] != _NONE),
            _either(flat[old + n], flat[old + n + north], lengths[n] != _NONE),
            _either(flat[old + w], flat[old + w + _WEST], lengths[w] != _NONE),
            _either(flat[old + s], flat[old + s + south], lengths[s] != _NONE),
        )
        _choose(process, old, first + i, ends, to, i)


@compiled
def decide_by_three(process: Process, part: Part, to: Place) -> None:
    """Decide where moves are of up to three cells."""
    flat, lengths, (old, first, count) = process.flat, process.lengths, part
    north, south = np.uint64(process.width), np.uint64(-process.width)
    for i in range(count):
        e, n, w, s = _in_planes(lengths, first + i)
        ends = (
            _three_on(flat, old + e, _EAST, lengths[e]),
            _three_on(flat, old + n, north, lengths[n]),
            _three_on(flat, old + w, _WEST, lengths[w]),
            _three_on(flat, old + s, south, lengths[s]),
        )
        _choose(process, old, first + i, ends, to, i)


@compiled
def decide_by_ends(process: Process, part: Part, to: Place, scratch: Floats) -> None:
    """Decide by what each direction leads to, as `find_ends` left it in the scratch."""
    old, first, count = part
    for i in range(count):
        e, w = _FOUND + i, _FOUND + ROW + ROW + i
        ends = (scratch[e], scratch[e + ROW], scratch[w], scratch[w + ROW])
        _choose(process, old, first + i, ends, to, i)


@compiled
def _choose(
    process: Process, old: np.uint64, cell: np.uint64, ends: Four, to: Place, i: int
) -> None:
    """Put what the best of five actions brings, by heading, given where each direction ends."""
    flat, gains, (straight, aside) = process.flat, process.gains, process.chances
    (quarter, half), (new, out, apart) = process.turns, to
    e, n, w, s = _in_planes(process.lengths, cell)
    stay = gains[s + (n - e)]
    east, north = ends[0] + gains[e], ends[1] + gains[n]
    west, south = ends[2] + gains[w], ends[3] + gains[s]
    sides_of_x, sides_of_y = aside * (north + south), aside * (east + west)
    east, west = straight * east + sides_of_x, straight * west + sides_of_x
    north, south = straight * north + sides_of_y, straight * south + sides_of_y
    along_x, along_y = max(east, west) - quarter, max(north, south) - quarter
    out += i
    new[out] = max(flat[old + e] + stay, east, along_y, west - half)
    out += apart
    new[out] = max(flat[old + n] + stay, north, along_x, south - half)
    out += apart
    new[out] = max(flat[old + w] + stay, west, along_y, east - half)
    out += apart
    new[out] = max(flat[old + s] + stay, south, along_x, north - half)


@compiled
def find_ends(process: Process, part: Part, scratch: Floats) -> None:
    """Put into the scratch the value of where each direction leads to from each cell."""
    flat, lengths, (old, at, count), out = process.flat, process.lengths, part, _FOUND
    for direction in range(4):
        # to the west and south it wraps around, and back when it is added
        step = np.uint64(ROW_STEPS[direction] * process.width + COL_STEPS[direction])
        here = old + at
        for i in range(count):
            scratch[out + i] = _three_on(flat, here + i, step, lengths[at + i])
        for k in range(NEAR + 1, process.reach + 1, 2):
            this = here + np.uint64(k) * step
            further = this + step if k < process.reach else this
            length_k, longer = np.uint8(k), np.uint8(k + 1)
            for i in range(count):
                length = lengths[at + i]
                best = _either(scratch[out + i], flat[this + i], length == length_k)
                scratch[out + i] = _either(best, flat[further + i], length == longer)
        at, out = at + np.uint64(lengths.shape[0] // 4), out + ROW


@compiled
def _in_planes(lengths: Lengths, cell: np.uint64) -> tuple[np.uint64, ...]:
    """Return where a cell is in each of four planes, by direction or heading."""
    plane = np.uint64(lengths.shape[0] // 4)
    north = cell + plane
    west = north + plane
    return cell, north, west, west + plane


@compiled
def _three_on(values: Floats, here: np.uint64, step: np.uint64, length: np.uint8) -> np.float32:
    """Choose among moves of up to three cells; where none is so long that value is not taken."""
    one = here + step
    two = one + step
    best = _either(values[here], values[one], length != _NONE)
    best = _either(best, values[two], length == _TWO)
    return _either(best, values[two + step], length == _THREE)


@compiled
def _either(this: np.float32, other: np.float32, takes_other: bool) -> np.float32:
    return other if takes_other else this
