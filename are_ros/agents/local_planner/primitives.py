"""The motion primitives of an agent, each with its cost as far as the goal is concerned.

Costs are without dimension: 0 is full speed towards the goal, 1 is no progress. A primitive is a
row (kind, heading [rad] or curvature [1/m], speed [m/s], cost, heading in the second half [rad]);
kinds: see `rollouts`.
"""

import math
from typing import Any

import numpy as np

from are_ros._compiled import borrowing
from are_ros.agents.body import TIGHTEST
from are_ros.agents.local_planner.rollouts import (
    ARC_TO_POINT,
    BRAKE,
    CURVE,
    GOING,
    HEADING,
    PASSED,
    POINT,
    PUSHED,
    PlanningGoal,
)
from are_ros.agents.local_planner.state import (
    COS,
    NEVER,
    SIN,
    SPEED,
    YAW,
    Floats,
    PlannerTiming,
    X,
    Y,
)

# The primitives of a vehicle, which cannot turn on the spot: arcs forward and in reverse.
#
# What an arc gains is the change of the way that is left from its end: the shortest way of arcs and
# straight lines to a point (Dubins), forward or, dearer, in reverse. Where walls are on that way,
# `manoeuvres` finds another one.


REVERSE_SHARE = 0.5
"""The fastest reverse over the fastest forward speed."""

_BENDS = np.array([0.0, -0.3, 0.3, -0.6, 0.6, -1.0, 1.0])
FORWARD = np.array([1.0, 0.6, 0.3, 0.12, 0.04])  # the last: a decimetre, to shunt in a slot
_BACKWARD = np.array([-1.0, -0.5, -0.2, -0.07])
_LOOK_AHEAD = 4.0  # turning radii
REVERSE_PRICE = 2.0
"""The price of a metre in reverse, in metres."""
_REVERSAL = 0.15  # for a change of direction
_REVERSE = 0.1
_BEND = 0.01
_TO_GOAL = 0.02
_BEND_CHANGE = 0.04


@borrowing
def arc_and_tangent(x: float, y: float, radius: float) -> tuple[float, float, float]:
    """Return the way to a point so far ahead and aside [m]: what comes before, arc, and tangent.

    Something comes before only if the point is inside the turning circle: it is first brought onto
    it by going back.
    """
    before, square = 0.0, x * x + (radius - y) ** 2 - radius * radius
    if square < 0.0:
        back = np.sqrt(max(radius * radius - (radius - y) ** 2, 0.0)) - x
        before, x, square = REVERSE_PRICE * back + 0.1 * radius, x + back, 0.0
    tangent = np.sqrt(square)
    angle = math.atan2(x, radius - y) - math.atan2(tangent, radius)
    if angle < -1e-9:
        angle += 2.0 * np.pi
    return float(before), float(radius * max(angle, 0.0)), float(tangent)


@borrowing
def ways_left(
    x: float, y: float, yaw: float, goal_x: float, goal_y: float, radius: float
) -> tuple[float, float]:
    """Return the ways [m] from a pose to a goal, forward and in reverse: an arc, then its tangent.

    A metre in reverse counts more than one ahead.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    dx, dy = goal_x - x, goal_y - y
    ahead, aside = dx * c + dy * s, abs(dy * c - dx * s)
    before, arc, tangent = arc_and_tangent(-ahead, aside, radius)
    back = REVERSE_PRICE * (before + arc + tangent) + 0.1 * radius
    before, arc, tangent = arc_and_tangent(ahead, aside, radius)
    return float(before + arc + tangent), float(back)


@borrowing
def way_left(x: float, y: float, yaw: float, goal_x: float, goal_y: float, radius: float) -> float:
    """Return the shorter of `ways_left`."""
    ahead, back = ways_left(x, y, yaw, goal_x, goal_y, radius)
    return float(min(ahead, back))


@borrowing
def point_ahead(
    pose: Floats, command: Any, memory: Any, radius: float
) -> tuple[float, float, float]:
    """Return the point that a vehicle makes for, and how much [m] of the way there may be closed.

    It is the sub-goal, or where the way goes on there, one beyond: so far that it is shorter to
    turn round than to reverse, and near the sub-goal half in the direction that the way then has.
    """
    if command.stops == 1 or memory.passed_at != NEVER:
        return command.x, command.y, 0.0
    dx, dy = command.x - pose[X], command.y - pose[Y]
    away = max(np.sqrt(dx * dx + dy * dy), 1e-3)
    cos, sin, near = dx / away, dy / away, min(max(2.0 - away / radius, 0.0), 1.0)
    if near > 0.0 and not np.isnan(command.beyond_x):
        dx, dy = command.beyond_x - command.x, command.beyond_y - command.y
        beyond = max(np.sqrt(dx * dx + dy * dy), 1e-3)
        cos, sin = cos + near * dx / beyond, sin + near * dy / beyond
        size = max(np.sqrt(cos * cos + sin * sin), 1e-3)
        cos, sin = cos / size, sin / size
    more = max(_LOOK_AHEAD * radius - away, 0.0)
    return command.x + more * cos, command.y + more * sin, more + PASSED


@borrowing
def _arc_cost(
    bend: float,
    way: float,
    aim: PlanningGoal,
    pose: Floats,
    point: tuple[float, float, float],
    radius: float,
    full: float,
) -> float:
    """Return what an arc of signed length `way` costs: 0 for a gain of `full` metres."""
    turn = bend * way / radius
    x, y = way, 0.0
    if turn != 0.0:
        x, y = way * np.sin(turn) / turn, way * (1.0 - np.cos(turn)) / turn
    dx, dy = pose[COS] * x - pose[SIN] * y, pose[SIN] * x + pose[COS] * y
    if aim.kind == PUSHED:
        aside = (dy * np.cos(aim.heading) - dx * np.sin(aim.heading)) * np.sign(aim.aside)
        ahead = dx * np.cos(aim.heading) + dy * np.sin(aim.heading)
        return float(1.0 - (1.5 * min(aside, abs(aim.aside)) + 0.6 * ahead) / full)
    if aim.kind != GOING:
        return float(1.0 - (dx * np.cos(aim.heading) + dy * np.sin(aim.heading)) / full)
    now = way_left(pose[X], pose[Y], pose[YAW], point[0], point[1], radius)
    yaw = pose[YAW] + turn
    then = way_left(pose[X] + dx, pose[Y] + dy, yaw, point[0], point[1], radius)
    return float(1.0 + (then - now) / full)


@borrowing
def vehicle_options(
    options: Floats,
    aim: PlanningGoal,
    pose: Floats,
    body: Any,
    command: Any,
    memory: Any,
    timing: PlannerTiming,
    may_back: bool,
) -> int:
    """Write the primitives of a vehicle at a pose, ahead or also back; return how many."""
    duration, count = timing.drive * timing.step_s, 0
    radius = TIGHTEST * body.turn_radius
    full, point = aim.speed * duration, point_ahead(pose, command, memory, radius)
    for factors in (FORWARD, _BACKWARD):
        if factors[0] < 0.0 and not may_back:
            break
        for bend in _BENDS:
            for factor in factors:
                speed = factor * (aim.speed if factor > 0.0 else REVERSE_SHARE * aim.speed)
                change = abs(speed - pose[SPEED]) / body.acceleration
                if change >= duration:  # the signed way made while the speed changes
                    pull = body.acceleration if speed > pose[SPEED] else -body.acceleration
                    way = (pose[SPEED] + 0.5 * pull * duration) * duration
                else:
                    way = 0.5 * (pose[SPEED] + speed) * change + speed * (duration - change)
                cost = _arc_cost(bend, way, aim, pose, point, radius, full) + _BEND * abs(bend)
                if memory.chosen == memory.chosen:
                    cost += _BEND_CHANGE * abs(bend - memory.chosen * radius)
                cost += _REVERSE if factor < 0.0 else 0.0
                cost += _REVERSAL if factor * memory.gear < 0.0 else 0.0
                count = set_option(options, count, CURVE, bend / radius, speed, cost, np.nan)

    # the one arc that ends in the goal, where it is not too tight
    dx, dy = command.x - pose[X], command.y - pose[Y]
    ahead, aside = dx * pose[COS] + dy * pose[SIN], dy * pose[COS] - dx * pose[SIN]
    curvature = 2.0 * aside / max(dx * dx + dy * dy, 1e-6)
    is_wide = abs(curvature) * TIGHTEST * body.turn_radius <= 1.0
    if aim.ends and is_wide and abs(ahead) >= 0.02:
        direction, price = (1.0, 1.0) if ahead > 0.0 else (-1.0, REVERSE_PRICE)
        saved = way_left(pose[X], pose[Y], pose[YAW], command.x, command.y, radius)
        angle = math.atan2(abs(aside), abs(ahead))  # the arc's length is the chord's by this share
        share = angle / np.sin(angle) if angle > 1e-6 else 1.0
        saved -= price * (np.hypot(abs(ahead), abs(aside)) * share)
        for factor in FORWARD:
            speed = direction * factor * aim.speed * (1.0 if ahead > 0.0 else REVERSE_SHARE)
            gain = saved + price * abs(speed) * duration
            cost = 1.0 - gain / full - _TO_GOAL + (0.0 if ahead > 0.0 else _REVERSE)
            cost += _REVERSAL if direction * memory.gear < 0.0 else 0.0
            count = set_option(options, count, ARC_TO_POINT, curvature, speed, cost, np.nan)

    curvature = 0.0 if np.isnan(memory.chosen) else memory.chosen
    return set_option(options, count, BRAKE, curvature, 0.0, aim.stop_cost, np.nan)


_DELTAS = np.radians(
    np.array([0, -12, 12, -25, 25, -40, 40, -60, 60, -85, 85, -115, 115, -145, 145, 180.0])
)
_COSINES = np.cos(_DELTAS)
_SPEEDS = np.array([1.0, 0.75, 0.5, 0.25])
_DEVIATION = 0.12  # of the square of the angle over a right angle
_LEFT = 0.03  # people keep to the right
_CHANGE = 0.08  # for turning away from what was chosen last
_TURN = 0.24  # for turning where it cannot go on
PLAIN_STOP = 0.02
_NEAR = 0.15
STOPS_WITHIN = 1.5
_STOP_SHORT = 0.05  # for a stop at a point that is not the end
_SHIFTS = 8
_SHIFT = 0.04


@borrowing
def set_option(
    options: Floats, n: int, kind: int, direction: float, speed: float, cost: float, then: float
) -> int:
    """Write one primitive; return the next index. `then` is the heading in its second half."""
    options[n, 0], options[n, 1], options[n, 2], options[n, 3] = kind, direction, speed, cost
    options[n, 4] = then
    return n + 1


@borrowing
def add_braking(options: Floats, count: int, aim: PlanningGoal, cost: float, turn: float) -> int:
    """Write braking, with and without a turn towards what is wanted; return the next index.

    `turn` is the angle of that turn, if it costs one that goes to its sub-goal anything.
    """
    cost_of_turn = _TURN * (1.0 - np.cos(turn)) if aim.kind == GOING else 0.0
    count = set_option(options, count, BRAKE, aim.heading, 0.0, cost + cost_of_turn, np.nan)
    return set_option(options, count, BRAKE, np.nan, 0.0, cost + PLAIN_STOP, np.nan)


@borrowing
def gain_of(aim: PlanningGoal, delta: float, cosine: float, speed: float) -> float:
    """Return what a second at a speed gains, 1 for full speed straight on."""
    if aim.kind != PUSHED:
        return speed / aim.speed * cosine
    aside = speed * np.sin(delta) * (1.0 if aim.aside > 0.0 else -1.0)
    ahead = 0.4 * cosine
    if not np.isnan(aim.own):  # rather past the pushing one, on its own way
        ahead = 0.1 * cosine + 0.3 * np.cos(aim.heading + delta - aim.own)
    return float((1.5 * min(aside, abs(aim.aside)) + speed * ahead) / aim.speed)


@borrowing
def walker_options(options: Floats, aim: PlanningGoal, memory: Any, yaw: float) -> int:
    """Write the primitives of an agent at a yaw that turns on the spot; return how many."""
    ends = aim.ends
    is_near = aim.kind == GOING and not ends and aim.distance < STOPS_WITHIN
    count = 0
    for n in range(_DELTAS.shape[0]):
        delta = _DELTAS[n]
        heading = aim.heading + delta
        share = delta * (2.0 / np.pi)
        cost = 1.0 + (_LEFT if delta > 0.0 else 0.0)
        if aim.kind != PUSHED:
            cost += _DEVIATION * share * share
        if not np.isnan(memory.chosen):
            cost += _CHANGE * (1.0 - np.cos(heading - memory.chosen))
        kind = POINT if n == 0 and ends else HEADING
        before = np.inf
        for factor in _SPEEDS:
            speed = factor * aim.speed
            if ends and n > 0:
                speed = min(speed, max(aim.distance, _NEAR))
                if speed == before:  # the same again
                    continue
                before = speed
            gain = gain_of(aim, delta, _COSINES[n], speed)
            if gain < 0.0 and factor < 0.5:
                continue
            count = set_option(options, count, kind, heading, speed, cost - gain, heading)
            if n == 0 and is_near:  # to stop there, should there be no room to go on
                then = cost - gain + _STOP_SHORT
                count = set_option(options, count, POINT, heading, speed, then, heading)
            if 0 < n <= _SHIFTS and aim.kind != PUSHED:  # a step aside, then on
                gain = 0.5 * (gain + speed / aim.speed) - _SHIFT
                count = set_option(
                    options, count, HEADING, heading, speed, cost - gain, aim.heading
                )
    # without a price one that cannot go on would turn to and fro: it sees a way past only after a
    # turn, and none any more when it has turned
    return add_braking(options, count, aim, aim.stop_cost, aim.heading - yaw)


@borrowing
def cheapest(options: Floats, count: int) -> int:
    """Return the primitive of the least cost, the first of several; -1 if all are used (inf)."""
    a, b, c, d = np.inf, np.inf, np.inf, np.inf
    n = 0
    while n + 3 < count:  # four at a time: each comparison has to wait for the one before it
        a, b = min(a, options[n, 3]), min(b, options[n + 1, 3])
        c, d = min(c, options[n + 2, 3]), min(d, options[n + 3, 3])
        n += 4
    while n < count:
        a = min(a, options[n, 3])
        n += 1
    least = min(a, b, c, d)
    if least == np.inf:
        return -1
    n = 0
    while options[n, 3] != least:
        n += 1
    return n
