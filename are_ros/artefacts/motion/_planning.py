"""Planning one artefact: the cheapest option that meets nobody's committed path, or the old one."""

from typing import Any

import numpy as np

from are_ros._compiled import compiled
from are_ros.artefacts.motion._aims import GOING, PUSHED, aim_of
from are_ros.artefacts.motion._buckets import gather
from are_ros.artefacts.motion._gaps import gap_between, robot_conflict, separation, wall_conflict
from are_ros.artefacts.motion._options import cheapest, direction_of, fill_options, is_at_rest
from are_ros.artefacts.motion._patience import consider_detour, note_hindrance, push
from are_ros.artefacts.motion._rollouts import BRAKE, pace_of, roll_out
from are_ros.artefacts.motion._state import (
    BY_ARTEFACT,
    BY_ROBOT,
    BY_WALL,
    EMERGENCIES,
    KEPT,
    NEVER,
    NOBODY,
    PLANS,
    STAMP,
    UNHINDERED,
    Buckets,
    Desk,
    Fleet,
    Floats,
    Floor,
    RobotPath,
    Tempo,
    X,
    Y,
)

_INFEASIBLE = np.inf
_NEAR_WALL = 0.25
_NEAR_OTHERS = 0.5
_NEAR_ROBOT = 0.6
_INTO_ROBOT = 6.0  # for entering where the robot is predicted to be, the less the later
_LATER = 0.05


@compiled
def copy_pose(source: Floats, target: Floats) -> None:
    """Copy a row of a path."""
    for column in range(target.shape[0]):
        target[column] = source[column]


@compiled
def reach_of(body: Any, tempo: Tempo) -> float:
    """Return how far from where it is any point of a body can get on its next path."""
    steps = tempo.drive if body.turn_radius > 0.0 else tempo.walk
    way = body.speed * (steps * tempo.step_s + 0.5 * body.speed / body.acceleration)
    return float(way + body.radius)


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
        return _INFEASIBLE, True
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
    return min(max(separation(pose, body, other, fleet.body[j]), 0.0), comfort)


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
    start, end = path[0], path[last]
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
def _assess(
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
    kept, k = wall_conflict(path, last, body, order.wall_comfort, pace, floor, desk.box)
    if k != NEVER:
        return _INFEASIBLE, BY_WALL, NOBODY
    nearness, culprit = _assess_others(fleet, i, path, last, pace, now, desk, count, is_any)
    if culprit != NOBODY:
        return _INFEASIBLE, BY_ARTEFACT, culprit
    cost, meets = _assess_robot(path, last, body, order, robot, pace, desk)
    cost += nearness + (0.0 if kept else _NEAR_WALL)
    return cost, BY_ROBOT if meets else UNHINDERED, NOBODY


@compiled
def commit(fleet: Fleet, i: int, path: Floats, last: int, now: int, tempo: Tempo) -> None:
    """Make a path, whose pose 0 is that of `now`, the one that artefact i will follow."""
    place = fleet.place[i]
    for k in range(last + 1):  # slices would take ten seconds more to compile
        copy_pose(path[k], fleet.path[i, k])
    place.begin, place.last, place.must_plan = now, last, 0
    place.pace = pace_of(path, last, fleet.body[i], tempo.step_s)
    low_x, low_y, high_x, high_y = path[0, X], path[0, Y], path[0, X], path[0, Y]
    for k in range(1, last + 1):
        low_x, high_x = min(low_x, path[k, X]), max(high_x, path[k, X])
        low_y, high_y = min(low_y, path[k, Y]), max(high_y, path[k, Y])
    place.x, place.y = 0.5 * (low_x + high_x), 0.5 * (low_y + high_y)
    half_diagonal = 0.5 * np.hypot(high_x - low_x, high_y - low_y)
    place.reach = half_diagonal + fleet.body[i].radius


@compiled
def _search(
    fleet: Fleet,
    i: int,
    goal: Floats,
    now: int,
    tempo: Tempo,
    floor: Floor,
    robot: RobotPath,
    desk: Desk,
    options: int,
    near: int,
) -> tuple[int, int, int, int, int]:
    """Try options, cheapest first, until none can be cheaper than the best found.

    Returns the option chosen (-1: none is feasible), which of the two scratch paths it fills and
    its last index, what was in the way of the first, and the slot of the first that was in the way.
    """
    best, chosen, side, last = _INFEASIBLE, -1, 0, 0
    hindrance, culprit, is_first = UNHINDERED, NOBODY, True
    while True:
        n = cheapest(desk.options, options)
        if n < 0 or desk.options[n, 3] >= best:
            break
        path = desk.paths[1 - side]
        end = roll_out(path, desk.options[n], goal, fleet.body[i], tempo)
        extra, kind, who = _assess(
            fleet, i, path, end, now, tempo, floor, robot, desk, near, culprit != NOBODY
        )
        cost = desk.options[n, 3] + extra
        if is_first:
            hindrance = kind
        if culprit == NOBODY:
            culprit = who
        is_first = False
        if cost < best:
            best, chosen, side, last = cost, n, 1 - side, end
        desk.options[n, 3] = np.inf
    return chosen, side, last, hindrance, culprit


@compiled
def plan(
    fleet: Fleet,
    i: int,
    now: int,
    epoch: int,
    tempo: Tempo,
    floor: Floor,
    robot: RobotPath,
    buckets: Buckets,
    desk: Desk,
) -> None:
    """Plan artefact i from where it is at sub-step `now`."""
    place, mind, order = fleet.place[i], fleet.mind[i], fleet.order[i]
    start = min(now - place.begin, place.last)
    pose = desk.paths[0, 0]
    copy_pose(fleet.path[i, start], pose)
    copy_pose(pose, desk.paths[1, 0])
    consider_detour(mind, place.id, now, tempo.second)
    aim = aim_of(fleet, i, pose, now, tempo.second)
    if is_at_rest(aim, pose) and start == place.last:
        place.must_plan = 0
        return
    options = fill_options(desk.options, aim, pose, fleet.body[i], order, mind, tempo)
    desk.counters[STAMP] += 1
    square = np.array([pose[X], pose[Y], reach_of(fleet.body[i], tempo)])
    near = gather(buckets, square, i, fleet, desk.seen, desk.counters[STAMP], desk.near)
    goal = np.array([order.x, order.y])
    chosen, side, last, hindrance, culprit = _search(
        fleet, i, goal, now, tempo, floor, robot, desk, options, near
    )
    who = fleet.place[culprit].id if culprit != NOBODY else NOBODY
    if aim.kind == GOING:
        note_hindrance(mind, hindrance, who)
    if culprit != NOBODY and (aim.kind == PUSHED or hindrance == BY_ARTEFACT):
        push(fleet, i, culprit, aim, pose, now, epoch, tempo.second)
    if chosen < 0:
        desk.counters[KEPT] += 1
        desk.counters[EMERGENCIES] += place.must_plan
        place.must_plan = 0
        return
    option = desk.options[chosen]
    if option[0] != BRAKE:
        mind.chosen = direction_of(option, pose)
        mind.gear = 1 if option[2] > 0.0 else -1
    elif aim.kind != GOING and aim.speed <= 0.0:
        mind.chosen = np.nan
    commit(fleet, i, desk.paths[side], last, now, tempo)
    desk.counters[PLANS] += 1
