"""What an artefact is after just now: its sub-goal, out of somebody's way, around, or nothing."""

import math
from typing import Any, NamedTuple

import numpy as np

from are_ros.artefacts.motion._borrowing import borrowing
from are_ros.artefacts.motion._rollouts import wrapped
from are_ros.artefacts.motion._state import (
    COS,
    NEVER,
    SIN,
    SPEED,
    YAW,
    Fleet,
    Floats,
    X,
    Y,
)

STANDING, FACING, GOING, PUSHED, DETOURING, COASTING = range(6)

_ARRIVED = 0.1
_ABEAM = 0.4  # a vehicle whose goal is beside it, no farther than this, has arrived
_FACED = 0.02
_PASSED = 0.35
_STANDS = 1e-6
_IMPATIENCE = 0.25
_MOST_IMPATIENT = 1.5


class Aim(NamedTuple):
    """What it is after: a kind, a heading in the map, how far that goes, how fast.

    `stop_cost` is what standing costs; going straight costs 0. Who is pushed wants to get `aside`
    of the heading by so much, to the left if positive, or else to go ahead of who pushes. `ends`:
    the way ends where the distance does.
    """

    kind: int
    heading: float
    distance: float
    speed: float
    stop_cost: float
    aside: float
    ends: bool


@borrowing
def way_to(pose: Floats, order: Any) -> float:
    """Return the distance of a pose from the sub-goal."""
    dx, dy = order.x - pose[X], order.y - pose[Y]
    return float(np.sqrt(dx * dx + dy * dy))


@borrowing
def has_arrived(pose: Floats, order: Any, body: Any) -> bool:
    """Tell whether one that stands at a pose is where its way ends."""
    if way_to(pose, order) <= _ARRIVED:
        return True
    dx, dy = order.x - pose[X], order.y - pose[Y]
    ahead = dx * pose[COS] + dy * pose[SIN]
    aside = dy * pose[COS] - dx * pose[SIN]
    return bool(body.turn_radius > 0.0 and abs(ahead) <= _ARRIVED and abs(aside) <= _ABEAM)


@borrowing
def _passes(pose: Floats, order: Any, body: Any) -> bool:
    """Tell whether a sub-goal on the way is as good as passed; nobody passes one standing."""
    if pose[SPEED] == 0.0 and body.turn_radius == 0.0:
        return False
    way = way_to(pose, order)
    if way >= 2.0 * _PASSED + 0.3 * body.turn_radius:
        return False
    ahead = (order.x - pose[X]) * pose[COS] + (order.y - pose[Y]) * pose[SIN]
    return bool(way < _PASSED or ahead < 0.0)


@borrowing
def kind_of(fleet: Fleet, i: int, pose: Floats, now: int, second: int) -> int:
    """Return what kind of aim artefact i has at sub-step `now`, standing or moving at `pose`.

    One that has passed its sub-goal goes on for a second; then it comes back to stand there.
    """
    order, mind, body = fleet.order[i], fleet.mind[i], fleet.body[i]
    if now < mind.pushed_until and _missing_room(pose, mind) != 0.0:
        return PUSHED
    if order.has_goal == 0 or min(order.speed, body.speed) <= 0.0:
        return STANDING
    if order.stops == 0 and now - second < mind.passed_at:
        if mind.passed_at == NEVER and _passes(pose, order, body):
            mind.passed_at = now
        if mind.passed_at != NEVER:
            return COASTING
    elif abs(pose[SPEED]) < _STANDS and has_arrived(pose, order, body):
        if np.isnan(order.face) or body.turn_radius > 0.0:  # no heading wanted, or no turn there
            return STANDING
        return FACING if abs(wrapped(order.face - pose[YAW])) >= _FACED else STANDING
    return DETOURING if now < mind.detour_until else GOING


@borrowing
def aim_of(fleet: Fleet, i: int, pose: Floats, now: int, second: int) -> Aim:
    """Return what artefact i is after at sub-step `now`; see `kind_of`."""
    order, mind, body = fleet.order[i], fleet.mind[i], fleet.body[i]
    speed = min(order.speed, body.speed)
    kind = kind_of(fleet, i, pose, now, second)
    if kind == PUSHED:
        line, aside = math.atan2(mind.push_sin, mind.push_cos), _missing_room(pose, mind)
        return Aim(PUSHED, line, np.inf, max(speed, 0.5 * body.speed), 1.2, aside, False)
    if kind == STANDING:
        return Aim(STANDING, np.nan, 0.0, 0.0, 0.0, 0.0, False)
    if kind == FACING:
        return Aim(FACING, order.face, 0.0, 0.0, 0.0, 0.0, False)
    stop_cost = 1.0 + min(_IMPATIENCE * mind.blocked, _MOST_IMPATIENT)
    if kind == COASTING:
        return Aim(COASTING, pose[YAW], np.inf, speed, stop_cost, 0.0, False)
    heading = math.atan2(order.y - pose[Y], order.x - pose[X])
    if kind == DETOURING:
        return Aim(DETOURING, heading + mind.detour, np.inf, speed, stop_cost, 0.0, False)
    ends = order.stops == 1 or mind.passed_at != NEVER
    return Aim(GOING, heading, way_to(pose, order), speed, stop_cost, 0.0, ends)


@borrowing
def _missing_room(pose: Floats, mind: Any) -> float:
    """Return how far one must still go to the left of the line on which another pushes; 0: not.

    Negative: to the right. To the side where it already is; to the right if it is on the line.
    """
    dx, dy = pose[X] - mind.push_x, pose[Y] - mind.push_y
    if mind.push_cos * dx + mind.push_sin * dy < -0.5 * mind.push_room:
        return 0.0  # it is behind by now
    aside = mind.push_cos * dy - mind.push_sin * dx
    missing = max(mind.push_room - abs(aside), 0.0)
    return float(missing if aside > 0.05 else -missing)
