"""Broad phase: who may meet a path, by a hash grid of the squares that each may reach."""

import numpy as np

from are_ros._compiled import compiled
from are_ros.artefacts.motion._state import Buckets, Fleet, Floats, Integers

_CELL = 3.0


@compiled
def _span(square: Floats) -> tuple[int, int, int, int]:
    """Return the first and last column and row of cells of a square (x, y, half side)."""
    return (
        int(np.floor((square[0] - square[2]) / _CELL)),
        int(np.floor((square[0] + square[2]) / _CELL)),
        int(np.floor((square[1] - square[2]) / _CELL)),
        int(np.floor((square[1] + square[2]) / _CELL)),
    )


@compiled
def fill(squares: Floats, slots: Integers) -> Buckets:
    """Return the grid of squares (N, 3) of the slots (N,); a bucket keeps their order."""
    total = 0
    for n in range(slots.shape[0]):
        left, right, low, high = _span(squares[n])
        total += (right - left + 1) * (high - low + 1)
    bits = 3
    while 1 << (2 * bits) < total:
        bits += 1
    mask = (1 << bits) - 1
    starts = np.zeros((1 << (2 * bits)) + 1, np.int64)
    for n in range(slots.shape[0]):
        left, right, low, high = _span(squares[n])
        for row in range(low, high + 1):
            for col in range(left, right + 1):
                starts[((row & mask) << bits | (col & mask)) + 1] += 1
    starts = np.cumsum(starts)
    ends = starts[:-1].copy()
    entries = np.empty(total, np.int64)
    for n in range(slots.shape[0]):
        left, right, low, high = _span(squares[n])
        for row in range(low, high + 1):
            for col in range(left, right + 1):
                bucket = (row & mask) << bits | (col & mask)
                entries[ends[bucket]] = slots[n]
                ends[bucket] += 1
    return Buckets(starts, entries, bits)


@compiled
def gather(
    buckets: Buckets,
    square: Floats,
    me: int,
    fleet: Fleet,
    seen: Integers,
    stamp: int,
    near: Integers,
) -> int:
    """Write to `near` the slots, without `me`, whose circle may meet a square; return how many.

    `stamp` is larger than all that were given before with the same `seen`.
    """
    count = 0
    mask = (1 << buckets.bits) - 1
    left, right, low, high = _span(square)
    seen[me] = stamp
    for row in range(low, high + 1):
        for col in range(left, right + 1):
            bucket = (row & mask) << buckets.bits | (col & mask)
            for entry in range(buckets.starts[bucket], buckets.starts[bucket + 1]):
                slot = buckets.slots[entry]
                if seen[slot] == stamp:
                    continue
                seen[slot] = stamp
                place = fleet.place[slot]
                reach = place.reach + square[2]
                if abs(place.x - square[0]) < reach and abs(place.y - square[1]) < reach:
                    near[count] = slot
                    count += 1
    return count
