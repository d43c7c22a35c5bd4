"""Compiled loops of exact backward induction by a stencil, without a transition matrix.

Directions are 0 east (columns grow), 1 north (rows grow), 2 west, 3 south; so are headings.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.artefacts._coarse_kernels import COL_STEPS, ROW_STEPS

Floats = npt.NDArray[np.float32]
Lengths = npt.NDArray[np.uint8]

CHUNK: Final = 2048
"""Cells at a time: four rows of so many float32 are the scratch, which stays in the cache."""

_SECOND: Final = CHUNK
_THIRD: Final = 2 * CHUNK
_FOURTH: Final = 3 * CHUNK


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
    """
    cells = lengths.shape[1]
    scratch = np.zeros(4 * CHUNK, np.float32)
    for epoch in range(1, horizon + 1):
        old = reach * width + ((epoch - 1) % kept) * 4 * cells
        new = reach * width + (epoch % kept) * 4 * cells
        changed = False
        for start in range(0, cells, CHUNK):
            end = min(start + CHUNK, cells)
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
            changed |= _put(flat, old + start, new + start, end - start, cells, scratch, changed)
        if not changed:
            return epoch
    return horizon


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
