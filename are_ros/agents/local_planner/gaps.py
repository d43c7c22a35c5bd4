"""Which other agents are near, and the clearance of a path from their trajectories.

Paths (K, 6) are compared sub-step by sub-step. Sub-steps in which the discs about the bodies are
too far apart are skipped. `k` counts sub-steps from now; a path's last pose is held.
"""

from typing import Any

import numpy as np

from are_ros._compiled import borrowing, owning
from are_ros.agents.local_planner.rollouts import distance
from are_ros.agents.local_planner.state import (
    COS,
    NEVER,
    SIN,
    STAMP,
    AgentArrays,
    Floats,
    SpatialHash,
    Workspace,
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
def _jams(p: Floats, a: Any, q: Floats, b: Any) -> bool:
    """Tell whether one of two standing bodies that turn on the spot cannot turn any more.

    It cannot if the disc that it sweeps overlaps the box of the other. If b never moves, only a
    has to turn.
    """
    for is_second in (False, True):
        if is_second:
            p, a, q, b = q, b, p, a
        if a.turn_radius > 0.0 or (is_second and a.speed <= 0.0):
            continue
        dx = p[X] - q[X] - q[COS] * b.centre_x + q[SIN] * b.centre_y
        dy = p[Y] - q[Y] - q[SIN] * b.centre_x - q[COS] * b.centre_y
        ahead = max(abs(dx * q[COS] + dy * q[SIN]) - b.half_x, 0.0)
        aside = max(abs(dy * q[COS] - dx * q[SIN]) - b.half_y, 0.0)
        if np.hypot(ahead, aside) < a.radius:
            return True
    return False


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
        near = distance(p, q[X], q[Y]) < radii
        jammed = near and _jams(p, body, q, other) and not _jams(home, body, q, other)
    until = min(until, final - 1 if jammed else final)
    least, k = comfort, 1
    q = path[min(start + 1, end)]
    far = distance(plan[min(1, last)], q[X], q[Y]) - radii
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
                gap = distance(p, q[X], q[Y]) - radii
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


@owning
def fill(squares: Floats) -> SpatialHash:
    """Return the hash of the squares (N, 3) of all rows; a bucket keeps their order."""
    total = 0
    spans = np.empty((squares.shape[0], 4), np.int64)  # first and last column and row of cells
    for n in range(squares.shape[0]):
        x, y, half = squares[n, 0], squares[n, 1], squares[n, 2]
        spans[n, 0], spans[n, 1] = np.floor((x - half) / _CELL), np.floor((x + half) / _CELL)
        spans[n, 2], spans[n, 3] = np.floor((y - half) / _CELL), np.floor((y + half) / _CELL)
        total += (spans[n, 1] - spans[n, 0] + 1) * (spans[n, 3] - spans[n, 2] + 1)
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
def find_neighbours(
    buckets: SpatialHash,
    agents: AgentArrays,
    i: int,
    pose: Floats,
    reach: float,
    now: int,
    workspace: Workspace,
) -> int:
    """Write to `workspace.near` the other rows that may come within `reach` of a pose of agent i.

    And to `workspace.wanted` the gap wanted from each of them: the agent's comfort distance, or the
    gap that there is if that is less. Returns how many they are.
    """
    workspace.counters[STAMP] += 1
    stamp, seen, count = workspace.counters[STAMP], workspace.seen, 0
    body, comfort = agents.body[i], agents.command[i].comfort
    left, right = np.floor((pose[X] - reach) / _CELL), np.floor((pose[X] + reach) / _CELL)
    low, high = np.floor((pose[Y] - reach) / _CELL), np.floor((pose[Y] + reach) / _CELL)
    mask = (1 << buckets.bits) - 1
    seen[i] = stamp
    for row in range(int(low), int(high) + 1):
        for col in range(int(left), int(right) + 1):
            bucket = (row & mask) << buckets.bits | (col & mask)
            for entry in range(buckets.starts[bucket], buckets.starts[bucket + 1]):
                j = buckets.rows[entry]
                if seen[j] == stamp:
                    continue
                seen[j] = stamp
                place = agents.place[j]
                dx, dy, far = place.x - pose[X], place.y - pose[Y], place.reach + reach
                if dx * dx + dy * dy >= far * far:
                    continue
                other = agents.path[j, min(now - place.begin, place.last)]
                workspace.near[count], workspace.wanted[count] = j, comfort
                radii = body.radius + agents.body[j].radius
                if distance(pose, other[X], other[Y]) < comfort + radii:
                    gap = max(separation(pose, body, other, agents.body[j]), 0.0)
                    workspace.wanted[count] = min(gap, comfort)
                count += 1
    return count


@borrowing
def turns_among(
    agents: AgentArrays, i: int, pose: Floats, now: int, workspace: Workspace, near: int
) -> bool:
    """Tell whether agent i certainly has room to turn on the spot at a pose among its neighbours.

    These are the first `near` rows of `workspace.near`. It has if the circle about none of them
    meets its own; `_jams` is exact, but asks whether both can turn.
    """
    for n in range(near):
        j = workspace.near[n]
        place = agents.place[j]
        other = agents.path[j, min(now - place.begin, place.last)]
        if distance(pose, other[X], other[Y]) < agents.body[i].radius + agents.body[j].radius:
            return False
    return True
