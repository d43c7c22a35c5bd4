"""Broad phase: which agents may meet a path, by a spatial hash of the squares they may reach."""

import numpy as np

from are_ros._compiled import borrowing, owning
from are_ros.agents.local_planner.state import AgentArrays, Floats, Integers, SpatialHash

_CELL = 3.0


@borrowing
def _span(x: float, y: float, half: float) -> tuple[int, int, int, int]:
    """Return the first and last column and row of cells of a square."""
    return (
        int(np.floor((x - half) / _CELL)),
        int(np.floor((x + half) / _CELL)),
        int(np.floor((y - half) / _CELL)),
        int(np.floor((y + half) / _CELL)),
    )


@owning
def fill(squares: Floats) -> SpatialHash:
    """Return the hash of the squares (N, 3) of all rows; a bucket keeps their order."""
    total = 0
    spans = np.empty((squares.shape[0], 4), np.int64)
    for n in range(squares.shape[0]):
        left, right, low, high = _span(squares[n, 0], squares[n, 1], squares[n, 2])
        spans[n, 0], spans[n, 1], spans[n, 2], spans[n, 3] = left, right, low, high
        total += (right - left + 1) * (high - low + 1)
    bits = 3
    while 2 << (2 * bits) < total:
        bits += 1
    mask = (1 << bits) - 1
    starts = np.zeros((1 << (2 * bits)) + 1, np.int64)
    for n in range(squares.shape[0]):
        left, right, low, high = spans[n, 0], spans[n, 1], spans[n, 2], spans[n, 3]
        for row in range(low, high + 1):
            for col in range(left, right + 1):
                starts[((row & mask) << bits | (col & mask)) + 1] += 1
    for bucket in range(1, starts.shape[0]):  # less to compile than cumsum
        starts[bucket] += starts[bucket - 1]
    ends = starts.copy()
    entries = np.empty(total, np.int64)
    for n in range(squares.shape[0]):
        left, right, low, high = spans[n, 0], spans[n, 1], spans[n, 2], spans[n, 3]
        for row in range(low, high + 1):
            for col in range(left, right + 1):
                bucket = (row & mask) << bits | (col & mask)
                entries[ends[bucket]] = n
                ends[bucket] += 1
    return SpatialHash(starts, entries, bits)


@borrowing
def gather(
    buckets: SpatialHash,
    square: tuple[float, float, float],
    me: int,
    agents: AgentArrays,
    seen: Integers,
    stamp: int,
    near: Integers,
) -> int:
    """Write to `near` the rows, without `me`, whose circle may meet a square (x, y, half side).

    Returns how many. `stamp` is larger than in all calls before with the same `seen`.
    """
    count = 0
    mask = (1 << buckets.bits) - 1
    left, right, low, high = _span(square[0], square[1], square[2])
    seen[me] = stamp
    for row in range(low, high + 1):
        for col in range(left, right + 1):
            bucket = (row & mask) << buckets.bits | (col & mask)
            for entry in range(buckets.starts[bucket], buckets.starts[bucket + 1]):
                other = buckets.rows[entry]
                if seen[other] == stamp:
                    continue
                seen[other] = stamp
                place = agents.place[other]
                reach = place.reach + square[2]
                if abs(place.x - square[0]) < reach and abs(place.y - square[1]) < reach:
                    near[count] = other
                    count += 1
    return count
