"""Deadlocks dissolve: who makes no progress pushes others out of its way, or tries a detour.

Of two in each other's way the one of the higher rank pushes; who is pushed takes the other's rank,
and so pushes on who is behind it (priority inheritance). Ranks are drawn anew every eight seconds
by a hash of the id and that time, so that nobody is the last for long.
"""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, compiled
from are_ros.agents.local_planner.primitives import way_left
from are_ros.agents.local_planner.rollouts import (
    COASTING,
    FACING,
    STANDING,
    PlanningGoal,
    kind_of,
    way_to,
)
from are_ros.agents.local_planner.state import (
    NEVER,
    NOBODY,
    UNOBSTRUCTED,
    YAW,
    AgentArrays,
    Floats,
    Integers,
    PlannerTiming,
    Records,
    X,
    Y,
)

_SLOWEST = 0.1  # progress below this speed counts as none
_MOST_CREDIT = 0.3
_RELEASE = 0.15  # the most that one that was blocked must gain before it is so no more
_MOST_DEBT = 2.0  # a way back counts: it must be made again before one is not blocked any more
_PUSHES_AFTER = 0.75
_PUSH_SECONDS = 2
_FIRST_DETOUR = 3.0
_ROOM = 0.05
_PUSHING_TAKES = 10.0
_ANGLES = np.array([1.05, 1.6, 2.1, 2.7])
_GOLDEN = 0x9E3779B97F4A7C15
_MIX_A = 0xBF58476D1CE4E5B9
_MIX_B = 0x94D049BB133111EB


@borrowing
def hashed(a: int, b: int) -> float:
    """Return a number in [0, 1) that two integers fix (splitmix64)."""
    z = np.uint64(a) * np.uint64(_GOLDEN) + np.uint64(b) * np.uint64(_MIX_B)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(_MIX_A)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(_MIX_B)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) / float(1 << 53)


@borrowing
def _rank(agents: AgentArrays, i: int, now: int, epoch: int) -> float:
    own = hashed(agents.place[i].id, epoch)
    mind = agents.mind[i]
    return max(own, mind.push_rank) if now < mind.pushed_until else own


@borrowing
def can_yield(agents: AgentArrays, j: int) -> bool:
    """Tell whether an artefact may be pushed: not those that shall stand, or are prescribed."""
    is_free = agents.command[j].has_goal == 1 and agents.place[j].is_scripted == 0
    return bool(is_free and agents.body[j].speed > 0.0)


@borrowing
def push(
    agents: AgentArrays,
    i: int,
    j: int,
    aim: PlanningGoal,
    pose: Floats,
    now: int,
    epoch: int,
    second: int,
) -> None:
    """Let i, hindered by j, push j out of its way if it has waited, or already did, and may."""
    mine, other = agents.mind[i], agents.mind[j]
    is_pushing = other.push_by == agents.place[i].id and now < other.pushed_until
    is_pushed = now < mine.pushed_until
    if not (is_pushing or is_pushed or mine.blocked > _PUSHES_AFTER):
        return
    if not can_yield(agents, j):
        return
    rank = _rank(agents, i, now, epoch)
    if not is_pushing and rank <= _rank(agents, j, now, epoch):
        return
    if now >= other.pushed_until:  # it gets out of the way at once
        agents.due[j] = now
    other.pushed_until = now + _PUSH_SECONDS * second
    other.push_by, other.push_rank = agents.place[i].id, rank
    other.push_x, other.push_y = pose[X], pose[Y]
    other.push_cos, other.push_sin = np.cos(aim.heading), np.sin(aim.heading)
    other.push_room = agents.body[i].radius + agents.body[j].radius + _ROOM


@borrowing
def consider_detour(mind: Any, artefact_id: int, now: int, second: int) -> None:
    """Let one that is blocked for long go another way for some seconds, farther each time."""
    patience = mind.patience + (_PUSHING_TAKES if mind.can_yield else 0.0)
    if mind.blocked < patience or now < mind.detour_until:
        return
    attempt = int(mind.patience)
    draw = hashed(artefact_id, 1000 + attempt + now // (8 * second) * 64)
    angle = _ANGLES[int(draw * 997.0) % 4]
    mind.detour = angle if draw < 0.5 else -angle
    seconds = 1.0 + 0.15 * min(mind.patience, 20.0)
    mind.detour_until = now + int(seconds * second)
    mind.patience += seconds + 2.5


@borrowing
def note_progress(
    agents: AgentArrays, i: int, before: Floats, after: Floats, now: int, timing: PlannerTiming
) -> None:
    """Count for how long one that wants to move has made no progress."""
    mind, command, body = agents.mind[i], agents.command[i], agents.body[i]
    kind = kind_of(agents, i, after, now, timing.second)
    if command.has_goal == 0 or kind in (STANDING, FACING, COASTING):
        forget_blockade(mind)
        return
    if body.turn_radius > 0.0:
        gain = way_left(before[X], before[Y], before[YAW], command.x, command.y, body.turn_radius)
        gain -= way_left(after[X], after[Y], after[YAW], command.x, command.y, body.turn_radius)
    else:
        gain = way_to(before, command) - way_to(after, command)
    drain = _SLOWEST * timing.step_s if mind.credit > 0.0 else 0.0
    credit = max(mind.credit + gain - drain, -_MOST_DEBT)
    mind.credit = min(credit, _MOST_CREDIT)
    if credit > min(_SLOWEST * mind.blocked, _RELEASE):
        mind.blocked, mind.patience = 0.0, _FIRST_DETOUR
    else:
        mind.blocked += timing.step_s


@borrowing
def forget_blockade(mind: Any) -> None:
    """Let one that does not want to move, or has got going, be patient again."""
    mind.blocked, mind.credit, mind.patience = 0.0, 0.0, _FIRST_DETOUR
    mind.obstruction, mind.obstructed_by = UNOBSTRUCTED, NOBODY


# Compiled giving of orders: what a new one changes, beside itself, for who had another before.


_ELSEWHERE_M: Final = 1.0
_NEWS_M: Final = 0.1


@compiled
def give(
    commands: Records,
    minds: Records,
    due: Integers,
    rows: Integers,
    given: npt.NDArray[np.float64],
    now: int,
) -> None:
    """Write orders into the records of some rows (M,); `given` (M, 9) as `command_record`.

    Whose sub-goal or speed is news plans at once; what was in the way to another is forgotten.
    """
    for k in range(rows.shape[0]):
        i = rows[k]
        before, mind = commands[i], minds[i]
        had_goal, has_goal = before.has_goal != 0, given[k, 0] != 0.0
        shift_m = 0.0 if had_goal == has_goal else np.inf
        if had_goal and has_goal:
            shift_m = np.hypot(given[k, 1] - before.x, given[k, 2] - before.y)
        if shift_m > _NEWS_M or given[k, 3] != before.speed:
            due[i] = now
        if shift_m > 0.0:
            mind.passed_at = NEVER
        if shift_m > _ELSEWHERE_M and mind.credit < 0.0:
            mind.credit = 0.0  # what it went back from the old one is no loss
        if given[k, 0] == 0.0 and shift_m > 0.0:
            forget_blockade(mind)
        before.has_goal, before.x, before.y = (
            np.int64(given[k, 0]),
            given[k, 1],
            given[k, 2],
        )
        before.speed, before.stops = given[k, 3], np.int64(given[k, 4])
        before.face, before.comfort = given[k, 5], given[k, 6]
        before.robot_comfort, before.wall_comfort = given[k, 7], given[k, 8]
