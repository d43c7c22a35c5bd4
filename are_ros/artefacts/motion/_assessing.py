"""What a path costs besides its option: nearness to walls, others and the robot."""

from typing import Any

import numpy as np

from are_ros.artefacts.motion._borrowing import borrowing
from are_ros.artefacts.motion._gaps import TOUCH, distance, gap_between, separation
from are_ros.artefacts.motion._robot_gaps import robot_conflict
from are_ros.artefacts.motion._rollouts import circle_of, pace_of
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
from are_ros.artefacts.motion._walls import point_room, wall_conflict

INFEASIBLE = np.inf
_NEAR_WALL = 0.25
_NEAR_OTHERS = 0.5
_NEAR_ROBOT = 0.6
_INTO_ROBOT = 6.0  # for entering where the robot is predicted to be, the less the later
_LATER = 0.05


@borrowing
def _assess_robot(
    path: Floats, last: int, body: Any, order: Any, robot: RobotPath, pace: float, desk: Desk
) -> tuple[float, bool]:
    """Return what a path costs for its nearness to the robot; whether it runs into it."""
    comfort = order.robot_comfort
    if robot.outlines.shape[0] == 0:
        return 0.0, False
    far = np.hypot(path[0, X] - robot.x, path[0, Y] - robot.y)
    if far > robot.reach + last * pace + body.radius + comfort:
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


@borrowing
def look_round(
    fleet: Fleet, i: int, pose: Floats, reach: float, now: int, desk: Desk, found: int
) -> int:
    """Strike those out of the first of `desk.near` whom nothing within `reach` of a pose can meet.

    Writes the gap wanted from each of the others: its comfort, or what there is if that is less.
    Returns how many they are.
    """
    count, body, comfort = 0, fleet.body[i], fleet.order[i].comfort
    for n in range(found):
        j = desk.near[n]
        place = fleet.place[j]
        dx, dy, far = place.x - pose[X], place.y - pose[Y], place.reach + reach
        if dx * dx + dy * dy < far * far:
            other = fleet.path[j, min(now - place.begin, place.last)]
            desk.near[count], desk.wanted[count] = j, comfort
            if distance(pose, other) < comfort + body.radius + fleet.body[j].radius:
                gap = max(separation(pose, body, other, fleet.body[j]), 0.0)
                desk.wanted[count] = min(gap, comfort)
            count += 1
    return count


@borrowing
def _assess_others(
    fleet: Fleet,
    i: int,
    path: Floats,
    last: int,
    pace: float,
    circle: tuple[float, float, float],
    now: int,
    desk: Desk,
    count: int,
    met: int,
    most: float,
    has_comfort: bool,
) -> tuple[float, int, int]:
    """Return what a path costs for its nearness to others; the row of whom it meets first; when.

    That one is put before the others, to be tried first. If such a one was met before, at sub-step
    `met`, then whom it meets at all. Looks no further once the cost is `most`. Without comfort only
    a meeting counts, which is seen much sooner.
    """
    until, culprit, cost = NEVER, NOBODY, 0.0
    body, comfort, home = fleet.body[i], fleet.order[i].comfort, fleet.path[i, fleet.place[i].last]
    x, y, reach = circle[0], circle[1], circle[2] + body.radius
    reach += comfort if has_comfort else 0.0
    for n in range(count):
        j = desk.near[n]
        place, wanted = fleet.place[j], desk.wanted[n] if has_comfort else 0.0
        dx, dy, far = place.x - x, place.y - y, place.reach + reach
        if dx * dx + dy * dy >= far * far:
            continue
        gap, k = gap_between(
            path,
            last,
            body,
            fleet.path[j],
            min(now - place.begin, place.last),
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
            desk.wanted[0], desk.wanted[n] = desk.wanted[n], desk.wanted[0]
            if met != NEVER or k == 1:
                break
        elif gap < wanted:
            cost = max(cost, _NEAR_OTHERS * (wanted - gap) / comfort)
            if cost >= most:
                break
    return cost, culprit, until + 1


@borrowing
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
    wall_gap: float,
    met: int,
    most: float,
) -> tuple[float, int, int, int]:
    """Return what a path costs besides its option, what is in its way, the row of whom, and when.

    What costs `most` or more is INFEASIBLE. `met`: see `_assess_others`; the others are looked at
    before the walls if one was in the way before.
    """
    body, order = fleet.body[i], fleet.order[i]
    if met != NEVER:  # the one that another path met, at the same sub-step
        j, place = desk.near[0], fleet.place[desk.near[0]]
        other = fleet.path[j, min(now - place.begin + met, place.last)]
        if separation(path[min(met, last)], body, other, fleet.body[j]) < -TOUCH:
            return INFEASIBLE, BY_ARTEFACT, j, met
    pace = pace_of(path, last, body, tempo.step_s)
    circle = circle_of(path, last)
    home = fleet.path[i, fleet.place[i].last]
    cost = 0.0
    for turn in range(3):  # a loop, for two calls of one kernel take twice as long to compile
        if turn == 0 and met == NEVER:
            continue
        if turn != 1:
            nearness, culprit, k = _assess_others(
                fleet, i, path, last, pace, circle, now, desk, count, met, most - cost, turn == 2
            )
            cost += nearness
            if culprit != NOBODY:
                return INFEASIBLE, BY_ARTEFACT, culprit, k
        elif point_room(circle[0], circle[1], body, floor) < circle[2] + body.radius + max(
            wall_gap, 0.0
        ):
            must_keep = cost + _NEAR_WALL >= most
            kept, k = wall_conflict(
                path, last, body, wall_gap, pace, floor, desk.box, home, must_keep
            )
            if k != NEVER:
                return INFEASIBLE, BY_WALL, NOBODY, k
            cost += 0.0 if kept else _NEAR_WALL
        if cost >= most:
            return INFEASIBLE, UNHINDERED, NOBODY, NEVER
    nearness, meets = _assess_robot(path, last, body, order, robot, pace, desk)
    return cost + nearness, BY_ROBOT if meets else UNHINDERED, NOBODY, NEVER
