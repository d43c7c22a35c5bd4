"""Rolling out a primitive: the poses of a unicycle that steers for a while, then brakes to a stand.

One sub-step: speed and yaw change evenly, the ground point goes along the mean heading.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from are_ros._compiled import borrowing
from are_ros.agents.local_planner.state import (
    COS,
    NEVER,
    SIN,
    SPEED,
    YAW,
    AgentArrays,
    Floats,
    PlannerTiming,
    X,
    Y,
)

HEADING, POINT, CURVE, ARC_TO_POINT, BRAKE, RETREAT = range(6)
"""Kinds of primitives: walk towards a heading; to a point and stop there; drive along a curve;
drive to a point and stop there; brake and turn towards a heading; walk straight back, looking
ahead."""

_STILL = 1e-9
_AIMED = 0.05  # nearer to its point than this, a body no longer turns towards it


@borrowing
def wrapped(angle: float) -> float:
    """Return an angle in [-pi, pi]."""
    return float(angle - 2.0 * np.pi * np.rint(angle / (2.0 * np.pi)))


@borrowing
def distance(pose: Floats, x: float, y: float) -> float:
    """Return how far the ground point of a pose is from a point."""
    dx, dy = x - pose[X], y - pose[Y]
    return float(np.sqrt(dx * dx + dy * dy))  # hypot is much slower


@borrowing
def turn_to(heading: float, yaw: float) -> float:
    """Return the angle from a yaw to a heading, in [-pi, pi]; 0 if it is only for rounding."""
    error = heading - yaw
    if abs(error) > 3.0:  # else it is the same, and a division less to wait for
        error = wrapped(error)
    return error if abs(error) > _STILL else 0.0


@borrowing
def stopping_speed(left: float, speed: float, acceleration: float, dt: float) -> float:
    """Return the highest speed after the next sub-step that still lets it stop within `left`."""
    rest = 2.0 * (left - 0.5 * speed * dt) / acceleration
    if rest <= 0.0:
        return 0.0
    return float(acceleration * (np.sqrt(0.25 * dt * dt + rest) - 0.5 * dt))


@borrowing
def advance(path: Floats, k: int, turn: float, speed: float, dt: float) -> None:
    """Write pose k + 1: yaw changes by `turn`, the speed to `speed`."""
    pose, after = path[k], path[k + 1]
    way = 0.5 * (pose[SPEED] + speed) * dt
    c, s = pose[COS], pose[SIN]
    if turn == 0.0:
        after[YAW], after[COS], after[SIN] = pose[YAW], c, s
    else:
        c, s = np.cos(pose[YAW] + 0.5 * turn), np.sin(pose[YAW] + 0.5 * turn)
        after[YAW] = pose[YAW] + turn
        after[COS], after[SIN] = np.cos(after[YAW]), np.sin(after[YAW])
    after[X], after[Y] = pose[X] + way * c, pose[Y] + way * s
    after[SPEED] = speed


@borrowing
def _turn_on(
    path: Floats, k: int, turn: float, half: tuple[float, float, float], speed: float, dt: float
) -> None:
    """Do as `advance`, for walkers, without trigonometry where they turn as fast as they can.

    `half` is half of the most that they turn in a sub-step, with its cosine and sine. The last turn
    is by `advance`, so that rounding does not add up.
    """
    if abs(turn) != 2.0 * half[0]:
        advance(path, k, turn, speed, dt)
        return
    pose, after = path[k], path[k + 1]
    way, cos, sin = 0.5 * (pose[SPEED] + speed) * dt, half[1], math.copysign(half[2], turn)
    c, s = pose[COS] * cos - pose[SIN] * sin, pose[SIN] * cos + pose[COS] * sin
    after[X], after[Y], after[YAW] = pose[X] + way * c, pose[Y] + way * s, pose[YAW] + turn
    after[COS], after[SIN], after[SPEED] = c * cos - s * sin, s * cos + c * sin, speed


@borrowing
def _walk(
    path: Floats,
    option: Floats,
    goal: Floats,
    body: Any,
    half: tuple[float, float, float],
    steps: int,
    dt: float,
) -> int:
    """Turn towards a heading or the goal and walk, slower while it looks elsewhere.

    `half`: see `_turn_on`.
    """
    step = body.acceleration * dt
    limit = 2.0 * half[0]
    heading, to_point = option[1], option[0] == POINT
    c, s = np.cos(heading), np.sin(heading)
    k = 0
    while k < steps:
        speed, want = path[k, SPEED], option[2]
        if k == steps // 2 and option[4] != heading:
            heading = option[4]
            c, s = np.cos(heading), np.sin(heading)
        if to_point:
            dx, dy = goal[0] - path[k, X], goal[1] - path[k, Y]
            left = np.sqrt(dx * dx + dy * dy)
            if left > _AIMED:
                heading, c, s = math.atan2(dy, dx), dx / left, dy / left
            else:
                left = max(dx * path[k, COS] + dy * path[k, SIN], 0.0)
            want = min(want, stopping_speed(left, speed, body.acceleration, dt))
        error = turn_to(heading, path[k, YAW])
        turn = min(max(error, -limit), limit)
        if error != 0.0:
            want *= max(c * path[k, COS] + s * path[k, SIN], 0.0)  # the cosine of the error
        slower = min(max(speed - step, 0.0), speed + step)  # a walker that steps back stops first
        faster = min(max(want, slower), speed + step)
        if turn == 0.0 and speed == 0.0 and faster < _STILL:
            return k
        if turn == 0.0 and speed == faster and not to_point:  # nothing changes for a while
            turns_on = option[4] != heading and k < steps // 2
            pose, until = path[k], steps // 2 if turns_on else steps
            way = 0.5 * (pose[SPEED] + pose[SPEED]) * dt
            dx, dy = way * pose[COS], way * pose[SIN]
            for n in range(k, until):
                before, after = path[n], path[n + 1]
                after[X], after[Y], after[YAW] = before[X] + dx, before[Y] + dy, pose[YAW]
                after[COS], after[SIN], after[SPEED] = pose[COS], pose[SIN], pose[SPEED]
            k = until
        else:
            _turn_on(path, k, turn, half, faster, dt)
            k += 1
    return steps


@borrowing
def _drive(path: Floats, option: Floats, goal: Floats, body: Any, steps: int, dt: float) -> int:
    """Drive along a curve, or the arc to the goal; a negative speed is reverse."""
    limit, step = body.turn_rate * dt, body.acceleration * dt
    tightest = 1.0 / body.turn_radius
    curvature, to_point = option[1], option[0] == ARC_TO_POINT
    direction = 1.0 if option[2] >= 0.0 else -1.0
    for k in range(steps):
        speed, want = path[k, SPEED], option[2]
        if to_point:
            dx, dy = goal[0] - path[k, X], goal[1] - path[k, Y]
            ahead = direction * (dx * path[k, COS] + dy * path[k, SIN])
            aside = dy * path[k, COS] - dx * path[k, SIN]
            square = max(dx * dx + dy * dy, 1e-6)
            if ahead > _AIMED:
                curvature = min(max(2.0 * aside / square, -tightest), tightest)
            slow = stopping_speed(max(ahead, 0.0), abs(speed), body.acceleration, dt)
            want = direction * min(abs(want), slow)
        if curvature != 0.0:
            fastest = body.turn_rate / abs(curvature)
            want = min(max(want, -fastest), fastest)
        faster = min(max(want, speed - step), speed + step)
        if speed == 0.0 and abs(faster) < _STILL:
            return k
        turn = min(max(curvature * 0.5 * (speed + faster) * dt, -limit), limit)
        advance(path, k, turn, faster, dt)
    return steps


@borrowing
def roll_out(path: Floats, option: Floats, goal: Floats, body: Any, timing: PlannerTiming) -> int:
    """Fill a path, whose pose 0 is given, by a primitive (see `primitives`).

    Returns the index of the last pose, where the body stands.
    """
    kind, k, curvature, dt = option[0], np.int64(0), 0.0, timing.step_s
    step, limit = body.acceleration * dt, body.turn_rate * dt
    half_turn = 0.5 * body.turn_rate * dt
    half = half_turn, np.cos(half_turn), np.sin(half_turn)
    if kind == BRAKE and body.turn_radius > 0.0:
        curvature = 0.0 if np.isnan(option[1]) else option[1]  # straight if none was chosen
    elif kind == BRAKE:  # turn on the spot towards a heading on the way (nan: none)
        while k < timing.walk:
            speed = path[k, SPEED]
            error = 0.0 if np.isnan(option[1]) else turn_to(option[1], path[k, YAW])
            if speed == 0.0 and error == 0.0:
                break
            slower = max(speed - step, 0.0) if speed > 0.0 else min(speed + step, 0.0)
            _turn_on(path, k, min(max(error, -limit), limit), half, slower, dt)
            k += 1
    elif kind == RETREAT:  # walk straight back, at a speed below 0
        for k in range(timing.walk):
            speed = path[k, SPEED]
            advance(path, k, 0.0, min(max(option[2], speed - step), speed + step), dt)
        k = np.int64(timing.walk)
    elif kind <= POINT:
        k = _walk(path, option, goal, body, half, timing.walk, dt)
    else:
        k = _drive(path, option, goal, body, timing.drive, dt)
        curvature = option[1] if kind == CURVE else 0.0
    while path[k, SPEED] != 0.0 and k + 1 < path.shape[0]:  # then brake to a stand
        speed = path[k, SPEED]
        slower = max(speed - step, 0.0) if speed > 0.0 else min(speed + step, 0.0)
        turn = min(max(curvature * 0.5 * (speed + slower) * dt, -limit), limit)
        advance(path, k, turn, slower, dt)
        k += 1
    return int(k)


@borrowing
def bounds_of(
    path: Floats, last: int, body: Any, dt: float
) -> tuple[float, tuple[float, float, float]]:
    """Return how far any point of the box moves in one sub-step of a path at most, and a circle.

    The circle, its centre (x, y) and radius, holds the ground points of the path.
    """
    fastest, turn = abs(path[0, SPEED]) if last > 0 else 0.0, 0.0
    low_x, low_y, high_x, high_y = path[0, X], path[0, Y], path[0, X], path[0, Y]
    for k in range(1, last + 1):
        fastest = max(fastest, abs(path[k, SPEED]))
        turn = max(turn, abs(path[k, YAW] - path[k - 1, YAW]))
        low_x, high_x = min(low_x, path[k, X]), max(high_x, path[k, X])
        low_y, high_y = min(low_y, path[k, Y]), max(high_y, path[k, Y])
    width, depth = high_x - low_x, high_y - low_y
    radius = 0.5 * np.sqrt(width * width + depth * depth)
    circle = 0.5 * (low_x + high_x), 0.5 * (low_y + high_y), float(radius)
    return float(fastest * dt + turn * body.radius), circle


# What an agent wants just now: its sub-goal, to get out of the way, a detour, or nothing.


STANDING, FACING, GOING, PUSHED, DETOURING, COASTING = range(6)

_ARRIVED = 0.1
_ABEAM = 0.4  # a vehicle whose goal is beside it, no farther than this, has arrived
_FACED = 0.02
PASSED = 0.35
"""Nearer [m] to a sub-goal than this, an agent has passed it."""
_PASSES_S = 0.7
"""A slower agent passes a sub-goal only nearer than what it goes in this time [s]."""
_STANDS = 1e-6
_IMPATIENCE = 0.25
_MOST_IMPATIENT, _MOST_OF_WALKERS = 1.5, 0.08
BACKS_OFF_AFTER = 3.0
"""An agent that has been blocked for so long [s] may go back, and, if it is pushed, turn its back
on its sub-goal."""


class PlanningGoal(NamedTuple):
    """What an agent wants: a kind, a heading in the map [rad], a distance [m], a speed [m/s].

    `stop_cost` is the cost of standing; going straight costs 0. A pushed agent wants to get `aside`
    of the heading by so much, to the left if positive, or else to move ahead of the pushing one.
    `own` is the heading of the sub-goal that it does not turn its back on, nan without one, and for
    those that are not pushed. `ends`: the way ends after the distance.
    """

    kind: int
    heading: float
    distance: float
    speed: float
    stop_cost: float
    aside: float
    ends: bool
    own: float


@borrowing
def _kind_at_rest(command: Any, body: Any, pose: Floats) -> int:
    """Return FACING for an agent that stands and has to turn on the spot, else STANDING."""
    if np.isnan(command.face) or body.turn_radius > 0.0 or abs(pose[SPEED]) >= _STANDS:
        return STANDING
    return FACING if abs(wrapped(command.face - pose[YAW])) >= _FACED else STANDING


@borrowing
def kind_of(agents: AgentArrays, i: int, pose: Floats, now: int, second: int) -> int:
    """Return the kind of goal that agent i has at sub-step `now`, standing or moving at `pose`.

    An agent that has passed its sub-goal goes on to the point beyond it. Without one it goes on for
    a second; then it comes back to stand there.
    """
    command, memory, body = agents.command[i], agents.memory[i], agents.body[i]
    if now < memory.pushed_until and _missing_room(pose, memory) != 0.0:
        return PUSHED
    if command.has_goal == 0 or min(command.speed, body.speed) <= 0.0:
        return _kind_at_rest(command, body, pose)
    dx, dy, way = command.x - pose[X], command.y - pose[Y], distance(pose, command.x, command.y)
    ahead, aside = dx * pose[COS] + dy * pose[SIN], dy * pose[COS] - dx * pose[SIN]
    is_vehicle = body.turn_radius > 0.0
    # beside a sub-goal on its way it has not arrived: it would wait there for another one for ever
    is_abeam = is_vehicle and command.stops != 0
    is_abeam = is_abeam and abs(ahead) <= _ARRIVED and abs(aside) <= _ABEAM
    if command.stops == 0 and now - second < memory.passed_at:
        is_near = way < 2.0 * PASSED + 0.3 * body.turn_radius
        # an artefact that turns on the spot passes no sub-goal while it stands, or sets out there
        reach = PASSED if is_vehicle else min(PASSED, _PASSES_S * abs(pose[SPEED]))
        is_passed = is_near and (way < reach or ahead < 0.0)
        if memory.passed_at == NEVER and is_passed and (is_vehicle or pose[SPEED] != 0.0):
            if np.isnan(command.beyond_x):
                memory.passed_at = now
            else:
                command.x, command.y, command.stops = command.beyond_x, command.beyond_y, 2
                command.beyond_x, agents.due[i] = np.nan, now
        if memory.passed_at != NEVER:
            return COASTING
    elif abs(pose[SPEED]) < _STANDS and (way <= _ARRIVED or is_abeam):
        return _kind_at_rest(command, body, pose)
    return DETOURING if now < memory.detour_until else GOING


@borrowing
def aim_of(agents: AgentArrays, i: int, pose: Floats, now: int, second: int) -> PlanningGoal:
    """Return what agent i wants at sub-step `now`; see `kind_of`."""
    command, memory, body = agents.command[i], agents.memory[i], agents.body[i]
    speed = min(command.speed, body.speed)
    kind = kind_of(agents, i, pose, now, second)
    if kind == PUSHED:
        line, aside = math.atan2(memory.push_sin, memory.push_cos), _missing_room(pose, memory)
        own, speed = np.nan, max(speed, 0.5 * body.speed)
        if command.has_goal == 1 and memory.blocked <= BACKS_OFF_AFTER:
            own = math.atan2(command.y - pose[Y], command.x - pose[X])
        return PlanningGoal(PUSHED, line, np.inf, speed, 1.2, aside, False, own)
    if kind == STANDING:
        return PlanningGoal(STANDING, np.nan, 0.0, 0.0, 0.0, 0.0, False, np.nan)
    if kind == FACING:
        return PlanningGoal(FACING, command.face, 0.0, 0.0, 0.0, 0.0, False, np.nan)
    # a walker would pace to and fro in front of what is in its way; it makes detours instead
    most = _MOST_IMPATIENT if body.turn_radius > 0.0 else _MOST_OF_WALKERS
    stop_cost = 1.0 + min(_IMPATIENCE * memory.blocked, most)
    if kind == COASTING:
        return PlanningGoal(COASTING, pose[YAW], np.inf, speed, stop_cost, 0.0, False, np.nan)
    heading = math.atan2(command.y - pose[Y], command.x - pose[X])
    if kind == DETOURING:
        heading += memory.detour
        return PlanningGoal(DETOURING, heading, np.inf, speed, stop_cost, 0.0, False, np.nan)
    ends = command.stops != 0 or memory.passed_at != NEVER
    way = distance(pose, command.x, command.y)
    return PlanningGoal(GOING, heading, way, speed, stop_cost, 0.0, ends, np.nan)


@borrowing
def _missing_room(pose: Floats, memory: Any) -> float:
    """Return how far a pushed agent must still go to the left of the pushing one's line [m].

    Negative: to the right; 0: it is out of the way. The side is that where it already is; the right
    if it is on the line.
    """
    dx, dy = pose[X] - memory.push_x, pose[Y] - memory.push_y
    if memory.push_cos * dx + memory.push_sin * dy < -0.5 * memory.push_room:
        return 0.0  # it is behind by now
    aside = memory.push_cos * dy - memory.push_sin * dx
    missing = max(memory.push_room - abs(aside), 0.0)
    return float(missing if aside > 0.05 else -missing)
