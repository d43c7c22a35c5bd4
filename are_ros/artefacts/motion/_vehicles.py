"""The options of what cannot turn on the spot: arcs forward and in reverse.

What an arc gains is the change of the way that is left from its end: the shortest way of arcs and
straight lines to a point (Dubins), forward or, dearer, in reverse.
"""

import math
from typing import Any

import numpy as np

from are_ros.artefacts.motion._aims import GOING, PUSHED, Aim
from are_ros.artefacts.motion._borrowing import borrowing
from are_ros.artefacts.motion._rollouts import ARC_TO_POINT, BRAKE, CURVE
from are_ros.artefacts.motion._state import COS, SIN, SPEED, YAW, Floats, Tempo, X, Y
from are_ros.artefacts.motion.body import TIGHTEST

REVERSE_SHARE = 0.5
"""The fastest reverse over the fastest forward speed."""

_BENDS = np.array([0.0, -0.3, 0.3, -0.6, 0.6, -1.0, 1.0])
_FORWARD = np.array([1.0, 0.6, 0.3, 0.12, 0.04])  # the last: a decimetre, to shunt in a slot
_BACKWARD = np.array([-1.0, -0.5, -0.2, -0.07])
_REVERSE_PRICE = 2.0  # of a metre in reverse, in metres
_SHIFT = 0.15  # for a change of direction
_REVERSE = 0.1
_BEND = 0.01
_TO_GOAL = 0.02
_CHANGE = 0.04


@borrowing
def _way_forward(x: float, y: float, radius: float) -> float:
    """Return the length of arc and tangent to the point (x, y), the body at 0 heading for +x.

    A point inside the turning circle is first brought onto it by going back.
    """
    y = abs(y)
    square = x * x + (radius - y) ** 2 - radius * radius
    before = 0.0
    if square < 0.0:
        back = np.sqrt(max(radius * radius - (radius - y) ** 2, 0.0)) - x
        before, x, square = _REVERSE_PRICE * back + 0.1 * radius, x + back, 0.0
    tangent = np.sqrt(square)
    angle = math.atan2(x, radius - y) - math.atan2(tangent, radius)
    if angle < -1e-9:
        angle += 2.0 * np.pi
    return float(before + radius * max(angle, 0.0) + tangent)


@borrowing
def way_left(x: float, y: float, yaw: float, goal_x: float, goal_y: float, radius: float) -> float:
    """Return the way [m] from a pose to a goal, a metre in reverse counted more than one ahead."""
    c, s = np.cos(yaw), np.sin(yaw)
    dx, dy = goal_x - x, goal_y - y
    ahead, aside = dx * c + dy * s, dy * c - dx * s
    forward = _way_forward(ahead, aside, radius)
    backward = _REVERSE_PRICE * _way_forward(-ahead, aside, radius) + 0.1 * radius
    return min(forward, backward)


@borrowing
def _travelled(speed: float, wanted: float, acceleration: float, duration: float) -> float:
    """Return the signed way made in a time in which the speed changes to the one wanted."""
    change = abs(wanted - speed) / acceleration
    if change >= duration:
        pull = acceleration if wanted > speed else -acceleration
        return float((speed + 0.5 * pull * duration) * duration)
    return float(0.5 * (speed + wanted) * change + wanted * (duration - change))


@borrowing
def _arc_cost(
    bend: float, way: float, aim: Aim, pose: Floats, order: Any, radius: float, full: float
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
    now = way_left(pose[X], pose[Y], pose[YAW], order.x, order.y, radius)
    yaw = pose[YAW] + turn
    then = way_left(pose[X] + dx, pose[Y] + dy, yaw, order.x, order.y, radius)
    return float(1.0 + (then - now) / full)


@borrowing
def _add_arcs(
    options: Floats,
    count: int,
    factors: Floats,
    aim: Aim,
    pose: Floats,
    body: Any,
    order: Any,
    mind: Any,
    duration: float,
) -> int:
    """Add curves at each of the shares of the speed; negative ones are in reverse."""
    radius = TIGHTEST * body.turn_radius
    full = aim.speed * duration
    for bend in _BENDS:
        for factor in factors:
            top = aim.speed if factor > 0.0 else REVERSE_SHARE * aim.speed
            speed = factor * top
            way = _travelled(pose[SPEED], speed, body.acceleration, duration)
            cost = _arc_cost(bend, way, aim, pose, order, radius, full) + _BEND * abs(bend)
            cost += (
                _CHANGE * abs(bend - mind.chosen * radius) if mind.chosen == mind.chosen else 0.0
            )
            cost += _REVERSE if factor < 0.0 else 0.0
            cost += _SHIFT if factor * mind.gear < 0.0 else 0.0
            options[count, 0], options[count, 1] = CURVE, bend / radius
            options[count, 2], options[count, 3] = speed, cost
            count += 1
    return count


@borrowing
def _arc_length(ahead: float, aside: float) -> float:
    """Return the length of the arc from the origin, along +x at first, to a point."""
    angle = math.atan2(aside, ahead)
    share = angle / np.sin(angle) if angle > 1e-6 else 1.0
    return float(np.hypot(ahead, aside) * share)


@borrowing
def _add_arcs_to_goal(
    options: Floats,
    count: int,
    aim: Aim,
    pose: Floats,
    body: Any,
    order: Any,
    mind: Any,
    duration: float,
) -> int:
    """Add the one arc that ends in the goal, where it is not too tight."""
    dx, dy = order.x - pose[X], order.y - pose[Y]
    ahead, aside = dx * pose[COS] + dy * pose[SIN], dy * pose[COS] - dx * pose[SIN]
    curvature = 2.0 * aside / max(dx * dx + dy * dy, 1e-6)
    if abs(curvature) * TIGHTEST * body.turn_radius > 1.0 or abs(ahead) < 0.02:
        return count
    direction = 1.0 if ahead > 0.0 else -1.0
    price = 1.0 if ahead > 0.0 else _REVERSE_PRICE
    radius, full = TIGHTEST * body.turn_radius, aim.speed * duration
    saved = way_left(pose[X], pose[Y], pose[YAW], order.x, order.y, radius)
    saved -= price * _arc_length(abs(ahead), abs(aside))
    for factor in _FORWARD:
        speed = direction * factor * aim.speed * (1.0 if ahead > 0.0 else REVERSE_SHARE)
        gain = saved + price * abs(speed) * duration
        cost = 1.0 - gain / full - _TO_GOAL + (0.0 if ahead > 0.0 else _REVERSE)
        cost += _SHIFT if direction * mind.gear < 0.0 else 0.0
        options[count, 0], options[count, 1] = ARC_TO_POINT, curvature
        options[count, 2], options[count, 3] = speed, cost
        count += 1
    return count


@borrowing
def vehicle_options(
    options: Floats, aim: Aim, pose: Floats, body: Any, order: Any, mind: Any, tempo: Tempo
) -> int:
    """Write the options of a vehicle at a pose; return how many there are."""
    duration = tempo.drive * tempo.step_s
    count = _add_arcs(options, np.int64(0), _FORWARD, aim, pose, body, order, mind, duration)
    count = _add_arcs(options, count, _BACKWARD, aim, pose, body, order, mind, duration)
    if aim.ends:
        count = _add_arcs_to_goal(options, count, aim, pose, body, order, mind, duration)
    options[count, 0], options[count, 1], options[count, 2] = BRAKE, 0.0, 0.0
    options[count, 3] = aim.stop_cost
    if not np.isnan(mind.chosen):
        options[count, 1] = mind.chosen
    return count + 1
