"""Compiled loops of exact backward induction by a stencil, without a transition matrix.

Directions are 0 east (columns grow), 1 north (rows grow), 2 west, 3 south; so are headings.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.artefacts._coarse_kernels import COL_STEPS, ROW_STEPS

Floats = npt.NDArray[np.float32]
Bits = npt.NDArray[np.int32]
Lengths = npt.NDArray[np.uint8]

CHUNK: Final = 640
"""Cells at a time: two times four rows of so many float32 are the scratch, which stays in L1."""

_SECOND: Final = np.uint64(CHUNK)
_THIRD: Final = np.uint64(2 * CHUNK)
_FOURTH: Final = np.uint64(3 * CHUNK)
_HALF: Final = np.uint64(4 * CHUNK)
_NONE, _TWO, _THREE = np.uint8(0), np.uint8(2), np.uint8(3)


@compiled
def solved(
    kept: int,
    terminal: Floats,
    lengths: Lengths,
    gains: Floats,
    reach: int,
    chances: tuple[np.float32, np.float32],
    turns: tuple[np.float32, np.float32],
    horizon: int,
) -> tuple[Floats, int]:
    """Return the values (kept, 4, h, w), as `induct` leaves them, and the last epoch computed.

    V_0 is `terminal` (h, w), whatever the heading.
    """
    height, width = terminal.shape
    padding, size = max(reach, 3) * width, kept * 4 * height * width
    flat = np.empty(size + 2 * padding, np.float32)
    # not looked at for what it is, but numbers that are none could slow it down
    flat[:padding], flat[padding + size :] = 0.0, 0.0
    planes = flat[padding : padding + size].reshape(kept, 4, height, width)
    for heading in range(4):
        planes[0, heading] = terminal
    lengths, gains = lengths.reshape(lengths.size), gains.reshape(gains.size)
    epochs = induct(flat, kept, width, lengths, gains, reach, chances, turns, horizon)
    return planes, epochs


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

    `flat` holds max(reach, 3) * width numbers that do not matter (so that looking that far is
    allowed everywhere), `kept` times four planes of n = h * w cells, one per heading, and as much
    again; epoch h is in place h % kept, V_0 is given. With `kept` = 1 each epoch takes the place of
    the last one, which works as long as no move goes farther than CHUNK. `lengths` (4 n), `gains`
    (5 n), `chances` of going straight and of each side, `turns` what a quarter and a half turn
    cost. Ends early when nothing has changed: so it would go on.
    """
    cells = lengths.shape[0] // 4
    plane = np.uint64(cells)
    padding = max(reach, 3) * width
    scratch = np.empty(8 * CHUNK, np.float32)
    for epoch in range(1, horizon + 1):
        old = np.uint64(padding + (epoch - 1) % kept * 4 * cells)
        new = np.uint64(padding + epoch % kept * 4 * cells)
        at, changed = np.uint64(0), False
        for start in range(0, cells, CHUNK):
            count = np.uint64(min(CHUNK, cells - start))
            _arrive(flat, old, start, count, width, lengths, reach, scratch, at)
            _decide(scratch, at, flat, old, gains, start, count, chances, turns)
            # a chunk later: the moves of this one were still to look at the old values of the last
            at = _HALF - at
            if start > 0:
                last = np.uint64(start - CHUNK)
                changed |= _put(flat, old, new, last, _SECOND, plane, scratch, at, changed)
        last, at = np.uint64((cells - 1) // CHUNK * CHUNK), _HALF - at
        changed |= _put(flat, old, new, last, plane - last, plane, scratch, at, changed)
        if not changed:
            return epoch
    return horizon


# In the loops below all indices are unsigned (else negative ones would count from the end), and
# what is chosen from is combined as bits, by masks: only then does the compiler make vector
# instructions of them. Of branches between values it would make gathers, which take longer.


@compiled
def _arrive(
    flat: Floats,
    old: np.uint64,
    start: int,
    count: np.uint64,
    width: int,
    lengths: Lengths,
    reach: int,
    scratch: Floats,
    at: np.uint64,
) -> None:
    """Put into the scratch the value of where each direction leads to from each cell."""
    cells = lengths.shape[0] // 4
    values, found = flat.view(np.int32), scratch.view(np.int32)
    for direction in range(4):
        # to the west and south it wraps around, and back when it is added
        step = np.uint64(ROW_STEPS[direction] * width + COL_STEPS[direction])
        first = np.uint64(direction * cells + start)
        out, here = at + np.uint64(direction * CHUNK), old + first
        if reach == 1:
            _by_one(found, out, values, here, step, lengths, first, count)
        else:
            _by_three(found, out, values, here, step, lengths, first, count)
        for k in range(4, reach + 1, 2):
            this = here + np.uint64(k) * step
            further = this + step if k < reach else this
            shorter = np.uint8(k)
            _by_more(found, out, values, this, further, lengths, first, count, shorter)


@compiled
def _by_one(
    found: Bits,
    out: np.uint64,
    values: Bits,
    here: np.uint64,
    step: np.uint64,
    lengths: Lengths,
    first: np.uint64,
    count: np.uint64,
) -> None:
    one = here + step
    for i in range(count):
        goes = -np.int32(lengths[first + i] != _NONE)
        found[out + i] = (values[here + i] & ~goes) | (values[one + i] & goes)


@compiled
def _by_three(
    found: Bits,
    out: np.uint64,
    values: Bits,
    here: np.uint64,
    step: np.uint64,
    lengths: Lengths,
    first: np.uint64,
    count: np.uint64,
) -> None:
    """Choose among moves of up to three cells; where none is so long that value is not taken."""
    one = here + step
    two, three = one + step, one + step + step
    for i in range(count):
        length = lengths[first + i]
        goes = -np.int32(length != _NONE)
        goes_on, goes_far = -np.int32(length == _TWO), -np.int32(length == _THREE)
        best = (values[here + i] & ~goes) | (values[one + i] & goes)
        best = (best & ~goes_on) | (values[two + i] & goes_on)
        found[out + i] = (best & ~goes_far) | (values[three + i] & goes_far)


@compiled
def _by_more(
    found: Bits,
    out: np.uint64,
    values: Bits,
    this: np.uint64,
    further: np.uint64,
    lengths: Lengths,
    first: np.uint64,
    count: np.uint64,
    shorter: np.uint8,
) -> None:
    """Replace what moves of length `shorter` lead to by `this`, those of one more by `further`."""
    longer = np.uint8(shorter + 1)
    for i in range(count):
        length = lengths[first + i]
        goes, goes_on = -np.int32(length == shorter), -np.int32(length == longer)
        best = (found[out + i] & ~goes) | (values[this + i] & goes)
        found[out + i] = (best & ~goes_on) | (values[further + i] & goes_on)


@compiled
def _decide(
    scratch: Floats,
    at: np.uint64,
    flat: Floats,
    old: np.uint64,
    gains: Floats,
    start: int,
    count: np.uint64,
    chances: tuple[np.float32, np.float32],
    turns: tuple[np.float32, np.float32],
) -> None:
    """Replace what each direction leads to by what the best of five actions brings, by heading."""
    straight, aside = chances
    quarter, half = turns
    cells, first = np.uint64(gains.shape[0] // 5), np.uint64(start)
    to_north, to_west = first + cells, first + cells + cells
    to_south, stays = to_west + cells, to_west + cells + cells
    old = old + first
    for i in range(count):
        k = at + i
        east, north = scratch[k] + gains[first + i], scratch[_SECOND + k] + gains[to_north + i]
        west = scratch[_THIRD + k] + gains[to_west + i]
        south = scratch[_FOURTH + k] + gains[to_south + i]
        stay = gains[stays + i]
        sides_of_x, sides_of_y = aside * (north + south), aside * (east + west)
        east, west = straight * east + sides_of_x, straight * west + sides_of_x
        north, south = straight * north + sides_of_y, straight * south + sides_of_y
        along_x, along_y = max(east, west) - quarter, max(north, south) - quarter
        facing = old + i
        scratch[k] = max(flat[facing] + stay, east, along_y, west - half)
        facing += cells
        scratch[_SECOND + k] = max(flat[facing] + stay, north, along_x, south - half)
        facing += cells
        scratch[_THIRD + k] = max(flat[facing] + stay, west, along_y, east - half)
        facing += cells
        scratch[_FOURTH + k] = max(flat[facing] + stay, south, along_x, north - half)


@compiled
def _put(
    flat: Floats,
    old: np.uint64,
    new: np.uint64,
    first: np.uint64,
    count: np.uint64,
    cells: np.uint64,
    scratch: Floats,
    at: np.uint64,
    changed: bool,
) -> bool:
    """Copy the new values to their place; tell whether any differs from the old, or it is known."""
    old, new = old + first, new + first
    for _ in range(4):
        if not changed:
            changed = _differ(flat, old, scratch, at, count)
        _copy(flat, new, scratch, at, count)
        old, new, at = old + cells, new + cells, at + _SECOND
    return changed


@compiled
def _copy(flat: Floats, new: np.uint64, scratch: Floats, at: np.uint64, count: np.uint64) -> None:
    for i in range(count):
        flat[new + i] = scratch[at + i]


@compiled
def _differ(flat: Floats, old: np.uint64, scratch: Floats, at: np.uint64, count: np.uint64) -> bool:
    differing = 0
    for i in range(count):
        differing += flat[old + i] != scratch[at + i]
    return differing > 0
