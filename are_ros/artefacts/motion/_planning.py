"""Planning one artefact: the cheapest option that meets nobody's committed path, or the old one."""

from typing import Any

import numpy as np

from are_ros.artefacts.motion._aims import GOING, PUSHED, aim_of
from are_ros.artefacts.motion._assessing import INFEASIBLE, assess, look_round
from are_ros.artefacts.motion._borrowing import borrowing
from are_ros.artefacts.motion._buckets import gather
from are_ros.artefacts.motion._options import (
    cheapest,
    direction_of,
    fill_options,
    rule_out_twin,
)
from are_ros.artefacts.motion._patience import can_yield, consider_detour, push
from are_ros.artefacts.motion._rollouts import BRAKE, circle_of, pace_of, roll_out
from are_ros.artefacts.motion._state import (
    BY_ARTEFACT,
    BY_WALL,
    EMERGENCIES,
    KEPT,
    NEVER,
    NOBODY,
    PLANS,
    SPEED,
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
from are_ros.artefacts.motion._walls import turns_freely, wall_gap_wanted

REPLAN = 10
"""So many sub-steps after a plan the next is made, unless there is news."""
_WORTH_IT = 0.02
_BACKS_OFF_AFTER = 3.0


@borrowing
def copy_pose(source: Floats, target: Floats) -> None:
    """Copy a row of a path."""
    for column in range(target.shape[0]):
        target[column] = source[column]


@borrowing
def reach_of(body: Any, tempo: Tempo) -> float:
    """Return how far from where it is any point of a body can get on its next path."""
    steps = tempo.drive if body.turn_radius > 0.0 else tempo.walk
    way = body.speed * (steps * tempo.step_s + 0.5 * body.speed / body.acceleration)
    return float(way + body.radius)


@borrowing
def commit(fleet: Fleet, i: int, path: Floats, last: int, now: int, tempo: Tempo) -> None:
    """Make a path, whose pose 0 is that of `now`, the one that artefact i will follow."""
    place = fleet.place[i]
    for k in range(last + 1):  # slices would take ten seconds more to compile
        copy_pose(path[k], fleet.path[i, k])
    place.begin, place.last, place.must_plan = now, last, 0
    place.pace = pace_of(path, last, fleet.body[i], tempo.step_s)
    place.x, place.y, radius = circle_of(path, last)
    place.reach = radius + fleet.body[i].radius


@borrowing
def _search(
    fleet: Fleet,
    i: int,
    now: int,
    tempo: Tempo,
    floor: Floor,
    robot: RobotPath,
    desk: Desk,
    options: int,
    near: int,
    wall_gap: float,
) -> tuple[int, int, int, int, int]:
    """Try options, cheapest first, until none can be cheaper than the best found by `_WORTH_IT`.

    Returns the option chosen (-1: none is feasible), which of the two scratch paths it fills and
    its last index, what was in the way of the first, and the row of the first that was in the way.
    """
    best, chosen, side, last = INFEASIBLE, -1, 0, 0
    hindrance, culprit, is_first, met = UNHINDERED, NOBODY, True, NEVER
    while True:
        n = cheapest(desk.options, options)
        if n < 0 or desk.options[n, 3] >= best - _WORTH_IT:
            break
        cost = desk.options[n, 3]
        path = desk.paths[1 - side]
        end = roll_out(path, desk.options[n], desk.goal, fleet.body[i], tempo)
        extra, kind, who, k = assess(
            fleet,
            i,
            path,
            end,
            now,
            tempo,
            floor,
            robot,
            desk,
            near,
            wall_gap,
            met,
            best - cost,
        )
        cost += extra
        if is_first:
            hindrance = kind
        if who != NOBODY:
            met = k
            culprit = who if culprit == NOBODY else culprit
        is_first = False
        if cost < best:
            best, chosen, side, last = cost, n, 1 - side, end
        desk.options[n, 3] = np.inf
        if k != NEVER:
            rule_out_twin(desk.options, options, n, k, end, tempo.walk)
    return chosen, side, last, hindrance, culprit


@borrowing
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
    place, mind, order, body = fleet.place[i], fleet.mind[i], fleet.order[i], fleet.body[i]
    fleet.due[i] = now + REPLAN
    start = min(now - place.begin, place.last)
    pose = desk.paths[0, 0]
    copy_pose(fleet.path[i, start], pose)
    copy_pose(pose, desk.paths[1, 0])
    consider_detour(mind, place.id, now, tempo.second)
    aim = aim_of(fleet, i, pose, now, tempo.second)
    is_at_rest = aim.speed <= 0.0 and np.isnan(aim.heading) and pose[SPEED] == 0.0
    if is_at_rest and start == place.last:
        place.must_plan = 0
        return
    # one that walks has been kept, or is backing off, where walls let it not turn
    backs_off = body.turn_radius == 0.0 and pose[SPEED] <= 0.0
    backs_off = backs_off and (mind.blocked > _BACKS_OFF_AFTER or mind.gear < 0)
    backs_off = backs_off and not turns_freely(pose, body, floor)
    options = fill_options(desk.options, aim, pose, body, order, mind, tempo, backs_off)
    desk.counters[STAMP] += 1
    reach = reach_of(body, tempo)
    near = gather(
        buckets, (pose[X], pose[Y], reach), i, fleet, desk.seen, desk.counters[STAMP], desk.near
    )
    near = look_round(fleet, i, pose, reach, now, desk, near)
    wall_gap = wall_gap_wanted(pose, body, order.wall_comfort, floor, desk.box)
    desk.goal[0], desk.goal[1] = order.x, order.y
    chosen, side, last, hindrance, culprit = _search(
        fleet, i, now, tempo, floor, robot, desk, options, near, wall_gap
    )
    stays = chosen < 0 or desk.options[chosen, 0] == BRAKE
    if hindrance == BY_WALL and culprit != NOBODY and stays:
        hindrance = BY_ARTEFACT  # the walls would have left it a way
    who = fleet.place[culprit].id if culprit != NOBODY else NOBODY
    if aim.kind == GOING:
        mind.hindrance, mind.hindered_by = hindrance, who if hindrance == BY_ARTEFACT else NOBODY
        mind.can_yield = (
            hindrance == BY_ARTEFACT and culprit != NOBODY and can_yield(fleet, culprit)
        )
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
