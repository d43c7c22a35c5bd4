"""Deadlock resolution: an agent without progress pushes others out of its way, or tries a detour.

Of two agents in each other's way the one of the higher priority pushes. The pushed agent inherits
that priority, and so pushes the agents behind it (priority inheritance). Priorities are a hash of
the id and the time; they are turned round after eight seconds, and drawn anew after sixteen, so of
two agents each is the first for a while, and may try what the other cannot. An agent that has to
stand, as a follower behind its leader, steps aside only for one that has waited longer.
The robot pushes the agents that stand where it is about to drive. Two agents that follow their
paths towards each other swerve.

The commands are written here, too: a new sub-goal forgets the deadlock on the way to the old one.
"""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, compiled
from are_ros.agents.local_planner.primitives import point_ahead, way_left
from are_ros.agents.local_planner.rollouts import (
    COASTING,
    FACING,
    STANDING,
    PlanningGoal,
    distance,
    kind_of,
)
from are_ros.agents.local_planner.state import (
    COS,
    NEVER,
    NOBODY,
    PATH_FOLLOWING,
    SIN,
    SPEED,
    UNOBSTRUCTED,
    YAW,
    AgentArrays,
    Floats,
    Integers,
    PlannerTiming,
    Records,
    RobotPath,
    X,
    Y,
)

_SLOWEST = 0.1  # progress below this speed counts as none
_MOST_CREDIT = 0.3
_RELEASE = 0.15  # the most that one that was blocked must gain before it is so no more
_MOST_DEBT = 2.0  # a way back counts: it must be made again before one is not blocked any more
_PUSHES_AFTER = 0.75
_ASKS_AFTER = 1.5  # one that is to stand is asked to step aside
_HEAD_ON, _SWERVES_SECONDS = -0.7, 8  # cosine of the angle between headings
_ASKS_FOLLOWERS_AFTER = 5.0  # so is one that follows its path, or two that block each other
_PUSH_SECONDS = 2
_MAKES_WAY_SECONDS = 2.0
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
def _priority(artefact_id: int, epoch: int) -> float:
    """Return the priority of an artefact; the order of two is turned round in every odd epoch."""
    rank = hashed(artefact_id, epoch // 2)
    return rank if epoch % 2 == 0 else 1.0 - rank


@borrowing
def keeps_way(agents: AgentArrays, i: int, now: int) -> bool:
    """Tell whether agent i follows its path, and does not swerve at present."""
    is_swerving = now < agents.memory[i].swerves_until
    return bool(agents.command[i].planner == PATH_FOLLOWING and not is_swerving)


@borrowing
def can_yield(agents: AgentArrays, i: int, j: int, now: int) -> bool:
    """Tell whether agent i may push agent j, should it have the higher priority.

    It may not push an agent that follows a track. It may push an agent that has to stand only after
    a longer wait, or while it has to stand and is pushed itself. An agent whose planner is
    path_following does not swerve: it may push such an agent only after the longest wait, and if
    that agent has to stand, or has waited for as long.
    """
    if agents.place[j].is_scripted == 1 or agents.body[j].speed <= 0.0:
        return False
    stands, waited = agents.command[j].has_goal == 0, agents.memory[i].blocked
    if keeps_way(agents, j, now):
        stands = stands or agents.memory[j].blocked > _ASKS_FOLLOWERS_AFTER
        return bool(stands and waited > _ASKS_FOLLOWERS_AFTER)
    is_asked = now < agents.memory[i].pushed_until and agents.command[i].has_goal == 0
    return bool(not stands or is_asked or waited > _ASKS_AFTER)


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
    """Push agent j, which obstructs agent i, if i has waited and has the higher priority.

    Those that are to stand have none.
    """
    mine, other = agents.memory[i], agents.memory[j]
    is_pushing = other.push_by == agents.place[i].id and now < other.pushed_until
    is_pushed = now < mine.pushed_until
    if not (is_pushing or is_pushed or mine.blocked > _PUSHES_AFTER):
        return
    if not can_yield(agents, i, j, now):
        return
    was_pushed, is_going = now < other.pushed_until, agents.command[j].has_goal == 1
    rank, its_rank = _priority(agents.place[i].id, epoch), _priority(agents.place[j].id, epoch)
    rank = max(rank, mine.push_rank) if is_pushed else rank
    if was_pushed and not is_pushing:
        its_rank = max(its_rank, other.push_rank)
    if is_going and rank <= its_rank:
        return
    if not was_pushed:  # it gets out of the way at once
        agents.due[j] = now
    other.pushed_until = now + _PUSH_SECONDS * second
    other.push_by, other.push_rank = agents.place[i].id, rank
    other.push_x, other.push_y = pose[X], pose[Y]
    other.push_cos, other.push_sin = np.cos(aim.heading), np.sin(aim.heading)
    other.push_room = agents.body[i].radius + agents.body[j].radius + _ROOM


@borrowing
def consider_swerving(
    agents: AgentArrays, i: int, j: int, pose: Floats, now: int, second: int
) -> None:
    """Let agent i swerve for a while if agent j comes towards it, and both keep their ways.

    Else these would meet nose to nose. Nobody else makes path_following swerve.
    """
    for k in (i, j):
        if agents.command[k].planner != PATH_FOLLOWING or agents.command[k].has_goal == 0:
            return
    place = agents.place[j]
    other = agents.path[j, min(now - place.begin, place.last)]
    if pose[COS] * other[COS] + pose[SIN] * other[SIN] < _HEAD_ON:
        agents.memory[i].swerves_until = now + _SWERVES_SECONDS * second


@borrowing
def make_way(
    agents: AgentArrays, i: int, pose: Floats, now: int, robot: RobotPath, second: int
) -> None:
    """Let the robot push agent i, if that stands where the robot drives in the next two seconds.

    An agent that follows its path stays there, as does one that cannot move.
    """
    body, memory = agents.body[i], agents.memory[i]
    if pose[SPEED] != 0.0 or body.speed <= 0.0 or keeps_way(agents, i, now):
        return
    x, y, vx, vy, radius = robot.disc
    speed = np.sqrt(vx * vx + vy * vy)
    if speed < _SLOWEST:
        return
    cos, sin = vx / speed, vy / speed
    ahead = (pose[X] - x) * cos + (pose[Y] - y) * sin
    aside = (pose[Y] - y) * cos - (pose[X] - x) * sin
    room = radius + body.radius
    if not 0.0 < ahead < room + _MAKES_WAY_SECONDS * speed or abs(aside) > room:
        return
    if now >= memory.pushed_until:
        agents.due[i] = now
    memory.pushed_until = now + _PUSH_SECONDS * second
    memory.push_by, memory.push_rank = NOBODY, 1.0
    memory.push_x, memory.push_y, memory.push_cos, memory.push_sin = x, y, cos, sin
    memory.push_room = room + _ROOM


@borrowing
def consider_detour(memory: Any, artefact_id: int, now: int, second: int) -> None:
    """Start a detour of some seconds for an agent that is blocked for long; each one is longer."""
    detour_after = memory.detour_after + (_PUSHING_TAKES if memory.can_yield else 0.0)
    if memory.blocked < detour_after or now < memory.detour_until:
        return
    attempt = int(memory.detour_after)
    draw = hashed(artefact_id, 1000 + attempt + now // (8 * second) * 64)
    angle = _ANGLES[int(draw * 997.0) % 4]
    memory.detour = angle if draw < 0.5 else -angle
    seconds = 1.0 + 0.15 * min(memory.detour_after, 20.0)
    memory.detour_until = now + int(seconds * second)
    memory.detour_after += seconds + 2.5


@borrowing
def note_progress(
    agents: AgentArrays, i: int, before: Floats, after: Floats, now: int, timing: PlannerTiming
) -> None:
    """Count for how long an agent that wants to move has made no progress."""
    memory, command, body = agents.memory[i], agents.command[i], agents.body[i]
    kind = kind_of(agents, i, after, now, timing.second)
    if command.has_goal == 0 or kind in (STANDING, FACING, COASTING):
        forget_blockade(memory)
        return
    if memory.leg != 0:
        gain = memory.leg * after[SPEED] * timing.step_s
    elif body.turn_radius > 0.0:
        x, y, _ = point_ahead(before, command, memory, body.turn_radius)
        gain = way_left(before[X], before[Y], before[YAW], x, y, body.turn_radius)
        gain -= way_left(after[X], after[Y], after[YAW], x, y, body.turn_radius)
    else:
        gain = distance(before, command.x, command.y) - distance(after, command.x, command.y)
    drain = _SLOWEST * timing.step_s if memory.credit > 0.0 else 0.0
    credit = max(memory.credit + gain - drain, -_MOST_DEBT)
    memory.credit = min(credit, _MOST_CREDIT)
    if credit > min(_SLOWEST * memory.blocked, _RELEASE):
        memory.blocked, memory.detour_after = 0.0, _FIRST_DETOUR
    else:
        memory.blocked += timing.step_s


@borrowing
def forget_blockade(memory: Any) -> None:
    """Forget the blockade of an agent that does not want to move, or moves again."""
    memory.blocked, memory.credit, memory.detour_after = 0.0, 0.0, _FIRST_DETOUR
    memory.obstruction, memory.obstructed_by = UNOBSTRUCTED, NOBODY


# The commands: what a new one changes, beside itself, for an agent that had another before.


_ELSEWHERE_M: Final = 1.0
_NEWS_M: Final = 0.1


@compiled
def write_commands(
    commands: Records,
    memories: Records,
    due: Integers,
    rows: Integers,
    given: npt.NDArray[np.float64],
    now: int,
) -> None:
    """Write commands into the records of some rows (M,); `given` (M, 12) as `command_record`.

    An agent with a new sub-goal or speed plans at once, and forgets what obstructed the old way;
    so does one with another planner, which is pushed no more, ends its detour, and does not swerve.
    """
    for k in range(rows.shape[0]):
        i = rows[k]
        before, memory = commands[i], memories[i]
        had_goal, has_goal = before.has_goal != 0, given[k, 0] != 0.0
        shift_m = 0.0 if had_goal == has_goal else np.inf
        if had_goal and has_goal:
            shift_m = np.hypot(given[k, 1] - before.x, given[k, 2] - before.y)
        if shift_m > _NEWS_M or given[k, 3] != before.speed:
            due[i] = now
        if shift_m > 0.0:
            memory.passed_at = NEVER
        if shift_m > _ELSEWHERE_M and memory.credit < 0.0:
            memory.credit = 0.0  # what it went back from the old one is no loss
        if given[k, 0] == 0.0 and shift_m > 0.0:
            forget_blockade(memory)
        before.has_goal, before.x, before.y = (
            np.int64(given[k, 0]),
            given[k, 1],
            given[k, 2],
        )
        before.speed, before.stops = given[k, 3], np.int64(given[k, 4])
        before.face, before.comfort = given[k, 5], given[k, 6]
        before.robot_comfort, before.wall_comfort = given[k, 7], given[k, 8]
        before.beyond_x, before.beyond_y = given[k, 10], given[k, 11]
        planner = np.int64(given[k, 9])
        if planner != before.planner:
            before.planner, due[i] = planner, now
            memory.pushed_until = memory.detour_until = memory.swerves_until = now
