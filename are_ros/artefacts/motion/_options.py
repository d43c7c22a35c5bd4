"""What an artefact could do next, each with what it costs as far as its goal is concerned.

Costs are without dimension: 0 is full speed towards the goal, 1 is no progress. An option is a row
(kind, heading or curvature, speed, cost, heading in the second half); kinds: see `_rollouts`.
"""

import math
from typing import Any

import numpy as np

from are_ros.artefacts.motion._aims import GOING, PUSHED, Aim
from are_ros.artefacts.motion._borrowing import borrowing
from are_ros.artefacts.motion._rollouts import BRAKE, HEADING, POINT, RETREAT, wrapped
from are_ros.artefacts.motion._state import COS, SIN, Floats, Tempo
from are_ros.artefacts.motion._vehicles import vehicle_options

_DELTAS = np.radians(
    np.array([0, -12, 12, -25, 25, -40, 40, -60, 60, -85, 85, -115, 115, -145, 145, 180.0])
)
_COSINES = np.cos(_DELTAS)
_SPEEDS = np.array([1.0, 0.75, 0.5, 0.25])
_DEVIATION = 0.12  # of the square of the angle over a right angle
_LEFT = 0.03  # people keep to the right
_CHANGE = 0.08  # for turning away from what was chosen last
_PLAIN_STOP = 0.02
_NEAR = 0.15
_STOPS_WITHIN = 1.5
_STOP_SHORT = 0.05  # for a stop at a point that is not the end
_SHIFTS = 8
_SHIFT = 0.04
_BACK_MPS = 0.4
_BACK = 0.1  # for walking back


@borrowing
def set_option(
    options: Floats, n: int, kind: int, direction: float, speed: float, cost: float, then: float
) -> int:
    """Write one option; return the next index. `then` is the heading in its second half."""
    options[n, 0], options[n, 1], options[n, 2], options[n, 3] = kind, direction, speed, cost
    options[n, 4] = then
    return n + 1


@borrowing
def fill_options(
    options: Floats,
    aim: Aim,
    pose: Floats,
    body: Any,
    order: Any,
    mind: Any,
    tempo: Tempo,
    backs_off: bool,
) -> int:
    """Write the options of an artefact at a pose; return how many there are.

    One that walks does so forward, but for one that `backs_off` where it cannot turn.
    """
    if aim.speed <= 0.0:
        count = set_option(options, 0, BRAKE, aim.heading, 0.0, 0.0, np.nan)
        return set_option(options, count, BRAKE, np.nan, 0.0, _PLAIN_STOP, np.nan)
    if body.turn_radius > 0.0:
        return vehicle_options(options, aim, pose, body, order, mind, tempo)
    count = _walker_options(options, aim, mind)
    return _add_retreat(options, count, aim, pose) if backs_off else count


@borrowing
def _gain(aim: Aim, delta: float, cosine: float, speed: float) -> float:
    """Return what a second at a speed gains, 1 for full speed straight on."""
    if aim.kind != PUSHED:
        return speed / aim.speed * cosine
    aside = speed * np.sin(delta) * (1.0 if aim.aside > 0.0 else -1.0)
    return float((1.5 * min(aside, abs(aim.aside)) + 0.4 * speed * cosine) / aim.speed)


@borrowing
def _walker_options(options: Floats, aim: Aim, mind: Any) -> int:
    ends = aim.ends
    is_near = aim.kind == GOING and not ends and aim.distance < _STOPS_WITHIN
    count = 0
    for n in range(_DELTAS.shape[0]):
        delta = _DELTAS[n]
        heading = aim.heading + delta
        share = delta * (2.0 / np.pi)
        cost = 1.0 + (_LEFT if delta > 0.0 else 0.0)
        if aim.kind != PUSHED:
            cost += _DEVIATION * share * share
        if not np.isnan(mind.chosen):
            cost += _CHANGE * (1.0 - np.cos(heading - mind.chosen))
        kind = POINT if n == 0 and ends else HEADING
        before = np.inf
        for factor in _SPEEDS:
            speed = factor * aim.speed
            if ends and n > 0:
                speed = min(speed, max(aim.distance, _NEAR))
                if speed == before:  # the same again
                    continue
                before = speed
            gain = _gain(aim, delta, _COSINES[n], speed)
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
    count = set_option(options, count, BRAKE, aim.heading, 0.0, aim.stop_cost, np.nan)
    return set_option(options, count, BRAKE, np.nan, 0.0, aim.stop_cost + _PLAIN_STOP, np.nan)


@borrowing
def _add_retreat(options: Floats, count: int, aim: Aim, pose: Floats) -> int:
    """Add steps straight back, as somebody makes who has met another in a gap."""
    heading = math.atan2(-pose[SIN], -pose[COS])
    delta, speed = wrapped(heading - aim.heading), min(aim.speed, _BACK_MPS)
    cost = 1.0 + _BACK - _gain(aim, delta, np.cos(delta), speed)
    return set_option(options, count, RETREAT, heading, -speed, cost, heading)


@borrowing
def cheapest(options: Floats, count: int) -> int:
    """Return the option of the least cost, the first of several; -1 if all are spent (inf)."""
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


@borrowing
def rule_out_twin(options: Floats, count: int, n: int, k: int, last: int, steps: int) -> None:
    """Spend the option that is the same as n until its second half, where n fails before that.

    `k` is the sub-step at which it does, `last` that at which it would stand.
    """
    if options[n, 0] != HEADING or k >= last or 2 * k > steps:
        return
    for other in (n - 1, n + 1):
        if (
            0 <= other < count
            and options[other, 0] == HEADING
            and options[other, 1] == options[n, 1]
            and options[other, 2] == options[n, 2]
        ):
            options[other, 3] = np.inf


@borrowing
def direction_of(option: Floats, pose: Floats) -> float:
    """Return what of an option is remembered: its heading or curvature."""
    if np.isnan(option[1]):
        return float(np.arctan2(pose[SIN], pose[COS]))
    return float(option[1])
