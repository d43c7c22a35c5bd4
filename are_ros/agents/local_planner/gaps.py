"""Which other agents are near, and the clearance of a path from their trajectories.

Paths (K, 6) are compared sub-step by sub-step. Sub-steps in which the discs about the bodies are
too far apart are skipped. `k` counts sub-steps from now; a path's last pose is held.
"""

from typing import Any

import numpy as np

from are_ros._compiled import borrowing, owning
from are_ros.agents.local_planner.state import (
    COS,
    NEVER,
    SIN,
    AgentArrays,
    Floats,
    Integers,
    SpatialHash,
    X,
    Y,
)
from are_ros.world.boxes import TOUCH_TOLERANCE_M

TOUCH = 0.5 * TOUCH_TOLERANCE_M  # half of what counts as touching is left for rounding
_FARTHEST_LEAP = 1e4
_WINDOW = 4


@borrowing
def leap(room: float, pace: float) -> int:
    """Return after how many sub-steps, at least one, `room` may be used up at `pace` per step."""
    return 1 + int(min(room / max(pace, 1e-9), _FARTHEST_LEAP))


@borrowing
def distance(p: Floats, q: Floats) -> float:
    """Return how far the ground points of two poses are apart."""
    dx, dy = q[X] - p[X], q[Y] - p[Y]
    return float(np.sqrt(dx * dx + dy * dy))  # hypot is much slower


@borrowing
def separation(p: Floats, a: Any, q: Floats, b: Any) -> float:
    """Return the largest gap between boxes a at pose p and b at pose q along their edges' axes.

    Not above the distance where it is positive; negative exactly if the open boxes overlap.
    """
    dx = q[X] - p[X]
    dx += q[COS] * b.centre_x - q[SIN] * b.centre_y - p[COS] * a.centre_x + p[SIN] * a.centre_y
    dy = q[Y] - p[Y]
    dy += q[SIN] * b.centre_x + q[COS] * b.centre_y - p[SIN] * a.centre_x - p[COS] * a.centre_y
    c = abs(p[COS] * q[COS] + p[SIN] * q[SIN])
    s = abs(p[COS] * q[SIN] - p[SIN] * q[COS])
    ahead = abs(dx * p[COS] + dy * p[SIN]) - a.half_x - b.half_x * c - b.half_y * s
    aside = abs(dy * p[COS] - dx * p[SIN]) - a.half_y - b.half_x * s - b.half_y * c
    along = abs(dx * q[COS] + dy * q[SIN]) - b.half_x - a.half_x * c - a.half_y * s
    across = abs(dy * q[COS] - dx * q[SIN]) - b.half_y - a.half_x * s - a.half_y * c
    return float(max(ahead, aside, along, across))


@borrowing
def _room_to_turn(p: Floats, a: Any, q: Floats, b: Any) -> float:
    """Return how far the disc that body a sweeps, turning at pose p, is from box b at pose q."""
    dx = p[X] - q[X] - q[COS] * b.centre_x + q[SIN] * b.centre_y
    dy = p[Y] - q[Y] - q[SIN] * b.centre_x - q[COS] * b.centre_y
    ahead = max(abs(dx * q[COS] + dy * q[SIN]) - b.half_x, 0.0)
    aside = max(abs(dy * q[COS] - dx * q[SIN]) - b.half_y, 0.0)
    return float(np.hypot(ahead, aside) - a.radius)


@borrowing
def _jams(p: Floats, a: Any, q: Floats, b: Any) -> bool:
    """Tell whether one of two standing bodies that turn on the spot cannot turn any more."""
    if a.turn_radius == 0.0 and _room_to_turn(p, a, q, b) < 0.0:
        return True
    return bool(b.turn_radius == 0.0 and b.speed > 0.0 and _room_to_turn(q, b, p, a) < 0.0)


@borrowing
def gap_between(
    plan: Floats,
    last: int,
    body: Any,
    path: Floats,
    start: int,
    end: int,
    other: Any,
    comfort: float,
    pace: float,
    until: int,
    home: Floats,
) -> tuple[float, int]:
    """Return the least gap, at most `comfort`, of a plan from a path, and when they first overlap.

    The path is at index `start` now and ends at `end`; `pace` is the highest closing speed per
    sub-step. Looks at sub-steps 1..until; NEVER: they do not overlap in these. An end so near that
    one of them cannot turn on the spot counts as an overlap, unless it is so at `home`, where the
    plan before this one ends: walkers hardly step back, and could be stuck for ever.
    """
    radii = body.radius + other.radius
    final = max(last, end - start)
    jammed = False
    if final <= until:
        p, q = plan[last], path[end]
        near = distance(p, q) < radii
        jammed = near and _jams(p, body, q, other) and not _jams(home, body, q, other)
    until = min(until, final - 1 if jammed else final)
    least, k = comfort, 1
    far = distance(plan[min(1, last)], path[min(start + 1, end)]) - radii
    if far > least:
        k += leap(far - least, pace)
    while k <= until:
        # windows of a fixed length: the processor looks at several at once, unlike at leaps
        middle = k + _WINDOW // 2
        p, q = plan[min(middle, last)], path[min(start + middle, end)]
        dx, dy, room = q[X] - p[X], q[Y] - p[Y], radii + least + (_WINDOW // 2) * pace
        if dx * dx + dy * dy < room * room:
            for n in range(k, min(k + _WINDOW, until + 1)):
                p, q = plan[min(n, last)], path[min(start + n, end)]
                gap = distance(p, q) - radii
                if gap >= least:
                    continue
                gap = max(gap, separation(p, body, q, other))
                if gap < -TOUCH:
                    return gap, n
                least = min(least, gap)
        k += _WINDOW
    return least, (final if jammed else NEVER)


# Broad phase: which agents may meet a path, by a spatial hash of the squares they may reach.


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
