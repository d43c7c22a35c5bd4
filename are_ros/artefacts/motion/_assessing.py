"""What a path costs besides its option: nearness to walls, others and the robot."""

from typing import Any

import numpy as np

from are_ros._compiled import compiled
from are_ros.artefacts.motion._gaps import gap_between, separation
from are_ros.artefacts.motion._robot_gaps import robot_conflict
from are_ros.artefacts.motion._rollouts import pace_of
from are_ros.artefacts.motion._state import (
    BY_ARTEFACT,
    BY_ROBOT,
    BY_WALL,
    NEVER,
    NOBODY,
    UNHINDERED,
    Desk,
    Fleet,
    Floats,
    Floor,
    RobotPath,
    Tempo,
    X,
    Y,
)
from are_ros.artefacts.motion._walls import wall_conflict

INFEASIBLE = np.inf
_NEAR_WALL = 0.25
_NEAR_OTHERS = 0.5
_NEAR_ROBOT = 0.6
_INTO_ROBOT = 6.0  # for entering where the robot is predicted to be, the less the later
_LATER = 0.05


@compiled
def _assess_robot(
    path: Floats, last: int, body: Any, order: Any, robot: RobotPath, pace: float, desk: Desk
) -> tuple[float, bool]:
    """Return what a path costs for its nearness to the robot; whether it runs into it."""
    comfort = order.robot_comfort
    far = np.hypot(path[0, X] - robot.x, path[0, Y] - robot.y)
    if robot.outlines.shape[0] == 0 or far > robot.reach + last * pace + body.radius + comfort:
        return 0.0, False
    least, predicted, present = robot_conflict(
        path, np.int64(0), last, body, robot, comfort, pace + robot.pace, desk.box
    )
    if present != NEVER:
        return INFEASIBLE, True
    cost = _NEAR_ROBOT * (1.0 - least / comfort) if least < comfort else 0.0
    if predicted != NEVER:
        return cost + _INTO_ROBOT - _LATER * min(predicted, 60), True
    return cost, False


@compiled
def _wanted_gap(fleet: Fleet, i: int, j: int, pose: Floats, other: Floats) -> float:
    """Return the gap that i wants from j: its comfort, or what there is if that is less."""
    body, comfort = fleet.body[i], fleet.order[i].comfort
    far = np.hypot(pose[X] - other[X], pose[Y] - other[Y])
    if far >= comfort + body.radius + fleet.body[j].radius:
        return float(comfort)
    return float(min(max(separation(pose, body, other, fleet.body[j]), 0.0), comfort))


@compiled
def _assess_others(
    fleet: Fleet,
    i: int,
    path: Floats,
    last: int,
    pace: float,
    now: int,
    desk: Desk,
    count: int,
    is_any: bool,
) -> tuple[float, int]:
    """Return what a path costs for its nearness to others; the slot of whom it meets first.

    With `is_any` whom it meets at all. That one is put before the others, to be tried first.
    """
    until, culprit, cost = NEVER, NOBODY, 0.0
    start, end, home = path[0], path[last], fleet.path[i, fleet.place[i].last]
    x, y = 0.5 * (start[X] + end[X]), 0.5 * (start[Y] + end[Y])
    reach = 0.5 * last * pace + fleet.body[i].radius + fleet.order[i].comfort
    for n in range(count):
        j = desk.near[n]
        place = fleet.place[j]
        if np.hypot(place.x - x, place.y - y) >= place.reach + reach:
            continue
        other = fleet.path[j]
        first = min(now - place.begin, place.last)
        wanted = _wanted_gap(fleet, i, j, start, other[first])
        gap, k = gap_between(
            path,
            last,
            fleet.body[i],
            other,
            first,
            place.last,
            fleet.body[j],
            wanted,
            pace + place.pace,
            until,
            home,
        )
        if k != NEVER:
            until, culprit = k - 1, j
            desk.near[0], desk.near[n] = j, desk.near[0]
            if is_any or k == 1:
                break
        elif gap < wanted:
            cost = max(cost, (wanted - gap) / fleet.order[i].comfort)
    return _NEAR_OTHERS * cost, culprit


@compiled
def assess(
    fleet: Fleet,
    i: int,
    path: Floats,
    last: int,
    now: int,
    tempo: Tempo,
    floor: Floor,
    robot: RobotPath,
    desk: Desk,
    count: int,
    is_any: bool,
) -> tuple[float, int, int]:
    """Return what a path costs besides its option, what is in its way, and the slot of whom."""
    body, order = fleet.body[i], fleet.order[i]
    pace = pace_of(path, last, body, tempo.step_s)
    home = fleet.path[i, fleet.place[i].last]
    kept, k = wall_conflict(path, last, body, order.wall_comfort, pace, floor, desk.box, home)
    if k != NEVER:
        return INFEASIBLE, BY_WALL, NOBODY
    nearness, culprit = _assess_others(fleet, i, path, last, pace, now, desk, count, is_any)
    if culprit != NOBODY:
        return INFEASIBLE, BY_ARTEFACT, culprit
    cost, meets = _assess_robot(path, last, body, order, robot, pace, desk)
    cost += nearness + (0.0 if kept else _NEAR_WALL)
    return cost, BY_ROBOT if meets else UNHINDERED, NOBODY
