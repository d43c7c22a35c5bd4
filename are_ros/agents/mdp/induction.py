"""Compiled loops of exact backward induction by a stencil, without a transition matrix.

Directions are 0 east (columns grow), 1 north (rows grow), 2 west, 3 south; so are headings.
"""

from typing import Final

import numpy as np

from are_ros._compiled import compiled
from are_ros.agents.mdp.decision_kernels import (
    CHUNK,
    NEAR,
    ROW,
    Floats,
    Lengths,
    Process,
    decide_by_ends,
    decide_by_one,
    decide_by_three,
    find_ends,
)

_HALF: Final = np.uint64(4 * CHUNK)
"""The new values of two chunks wait in the first eight rows of the scratch, in turns."""


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
    padding, size = max(reach, NEAR) * width, kept * 4 * height * width
    flat = np.zeros(size + 2 * padding, np.float32)
    planes = flat[padding : padding + size].reshape(kept, 4, height, width)
    planes[0] = terminal
    lengths, gains = lengths.reshape(-1), gains.reshape(-1)
    process = Process(flat, lengths, gains, width, reach, chances, turns)
    return planes, induct(process, kept, horizon)


@compiled
def induct(process: Process, kept: int, horizon: int) -> int:
    """Fill V_1 .. V_horizon by backward induction, and return the last epoch computed.

    `flat` holds max(reach, 3) * width numbers that do not matter (so that looking that far is
    allowed everywhere), `kept` times four planes of n = h * w cells, one per heading, and as much
    again; epoch h is in place h % kept, V_0 is given. With `kept` = 1 each epoch takes the place of
    the last one, which works as long as no move goes farther than CHUNK. Ends early when nothing
    has changed: so it would go on.
    """
    size = process.lengths.shape[0]
    padding = max(process.reach, NEAR) * process.width
    scratch = np.empty(12 * CHUNK, np.float32)
    for epoch in range(1, horizon + 1):
        old = np.uint64(padding + (epoch - 1) % kept * size)
        new = np.uint64(padding + epoch % kept * size)
        if not _epoch(process, old, new, scratch):
            return epoch
    return horizon


@compiled
def _epoch(process: Process, old: np.uint64, new: np.uint64, scratch: Floats) -> bool:
    """Put the values of an epoch where `new` is; tell whether any differs from the last one's."""
    flat, cells = process.flat, process.lengths.shape[0] // 4
    plane, at, changed, in_place = np.uint64(cells), np.uint64(0), False, old == new
    at_once = CHUNK if in_place or process.reach > NEAR else cells
    for start in range(0, cells, at_once):
        first, count = np.uint64(start), np.uint64(min(at_once, cells - start))
        to = (scratch, at, ROW) if in_place else (flat, new + first, plane)
        part = old, first, count
        if process.reach == 1:
            decide_by_one(process, part, to)
        elif process.reach <= NEAR:
            decide_by_three(process, part, to)
        else:
            find_ends(process, part, scratch)
            decide_by_ends(process, part, to, scratch)
        # a chunk later: the moves of this one were still to look at the old values of the last
        at = _HALF - at
        if in_place and start > 0:
            changed |= _put(flat, old + first - ROW, ROW, plane, scratch, at, changed)
    if not in_place:
        for start in range(0, 4 * cells, CHUNK):
            first, count = np.uint64(start), np.uint64(min(CHUNK, 4 * cells - start))
            if _differ(flat, old + first, flat, new + first, count):
                return True
        return False
    last, at = np.uint64((cells - 1) // CHUNK * CHUNK), _HALF - at
    return changed | _put(flat, old + last, plane - last, plane, scratch, at, changed)


@compiled
def _put(
    flat: Floats,
    place: np.uint64,
    count: np.uint64,
    cells: np.uint64,
    scratch: Floats,
    at: np.uint64,
    changed: bool,
) -> bool:
    """Replace old values by new ones; tell whether any differs, or it is known."""
    for _ in range(4):
        changed = changed or _differ(flat, place, scratch, at, count)
        for i in range(count):
            flat[place + i] = scratch[at + i]
        place, at = place + cells, at + ROW
    return changed


@compiled
def _differ(one: Floats, at: np.uint64, other: Floats, there: np.uint64, count: np.uint64) -> bool:
    differing = 0
    for i in range(count):
        differing += one[at + i] != other[there + i]
    return differing > 0
