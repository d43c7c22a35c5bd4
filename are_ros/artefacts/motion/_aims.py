"""What an artefact is after just now: its sub-goal, out of somebody's way, around, or nothing."""

import math
from typing import Any, NamedTuple

import numpy as np

from are_ros._compiled import compiled
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


@compiled
def has_arrived(pose: Floats, order: Any, body: Any) -> bool:
    """Tell whether one that stands at a pose is where its way ends."""
    dx, dy = order.x - pose[X], order.y - pose[Y]
    if np.hypot(dx, dy) <= _ARRIVED:
        return True
    ahead = dx * pose[COS] + dy * pose[SIN]
    aside = dy * pose[COS] - dx * pose[SIN]
    return bool(body.turn_radius > 0.0 and abs(ahead) <= _ARRIVED and abs(aside) <= _ABEAM)


@compiled
def _passes(pose: Floats, order: Any, body: Any) -> bool:
    """Tell whether a sub-goal on the way is as good as passed."""
    dx, dy = order.x - pose[X], order.y - pose[Y]
    distance = np.hypot(dx, dy)
    if distance < _PASSED:
        return True
    ahead = dx * pose[COS] + dy * pose[SIN]
    return bool(ahead < 0.0 and distance < 2.0 * _PASSED + 0.3 * body.turn_radius)


@compiled
def aim_of(fleet: Fleet, i: int, pose: Floats, now: int, second: int) -> Aim:
    """Return what artefact i is after at sub-step `now`, standing or moving at `pose`.

    One that has passed its sub-goal goes on for a second; then it comes back to stand there.
    """
    order, mind, body = fleet.order[i], fleet.mind[i], fleet.body[i]
    speed = min(order.speed, body.speed)
    if now < mind.pushed_until:
        aside = _missing_room(pose, mind)
        if aside != 0.0:
            line = math.atan2(mind.push_sin, mind.push_cos)
            return Aim(PUSHED, line, np.inf, max(speed, 0.5 * body.speed), 1.2, aside, False)
    if order.has_goal == 0 or speed <= 0.0:
        return Aim(STANDING, np.nan, 0.0, 0.0, 0.0, 0.0, False)
    dx, dy = order.x - pose[X], order.y - pose[Y]
    heading, distance = math.atan2(dy, dx), np.hypot(dx, dy)
    stop_cost = 1.0 + min(_IMPATIENCE * mind.blocked, _MOST_IMPATIENT)
    ends = order.stops == 1 or now - second >= mind.passed_at
    if not ends:
        if mind.passed_at == NEVER and _passes(pose, order, body):
            mind.passed_at = now
        if mind.passed_at != NEVER:
            return Aim(COASTING, pose[YAW], np.inf, speed, stop_cost, 0.0, False)
    elif abs(pose[SPEED]) < _STANDS and has_arrived(pose, order, body):
        return _face(pose, order, body)
    if now < mind.detour_until:
        return Aim(DETOURING, heading + mind.detour, np.inf, speed, stop_cost, 0.0, False)
    return Aim(GOING, heading, distance, speed, stop_cost, 0.0, ends)


@compiled
def _face(pose: Floats, order: Any, body: Any) -> Aim:
    """Return the turn on the spot that is left to one that has arrived."""
    is_done = np.isnan(order.face) or abs(wrapped(order.face - pose[YAW])) < _FACED
    if is_done or body.turn_radius > 0.0:
        return Aim(STANDING, np.nan, 0.0, 0.0, 0.0, 0.0, False)
    return Aim(FACING, order.face, 0.0, 0.0, 0.0, 0.0, False)


@compiled
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
