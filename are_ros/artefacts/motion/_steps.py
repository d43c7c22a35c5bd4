"""One sub-step of everybody: who is due plans, one after the other, and all go on."""

from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.artefacts.motion._buckets import fill
from are_ros.artefacts.motion._gaps import gap_between, separation
from are_ros.artefacts.motion._patience import note_progress
from are_ros.artefacts.motion._planning import plan, reach_of
from are_ros.artefacts.motion._robot_gaps import robot_conflict
from are_ros.artefacts.motion._state import (
    NEVER,
    YAW,
    Desk,
    Fleet,
    Floats,
    Floor,
    Integers,
    Records,
    RobotPath,
    Tempo,
    X,
    Y,
)
from are_ros.artefacts.motion._walls import wall_conflict

_Mask = npt.NDArray[np.bool_]
REPLAN = 5
_RANKS_LAST_SECONDS = 8


@compiled
def _is_moving(place: Any, now: int) -> bool:
    return bool(now - place.begin < place.last)


@compiled
def _meets_robot(fleet: Fleet, i: int, now: int, robot: RobotPath, box: Floats) -> bool:
    """Tell whether what is left of a path leads into the robot, where it is or will be."""
    place = fleet.place[i]
    reach = place.reach + robot.reach
    if abs(place.x - robot.x) > reach or abs(place.y - robot.y) > reach:
        return False
    start, pace = now - place.begin, place.pace + robot.pace
    _, predicted, present = robot_conflict(
        fleet.path[i], start, place.last, fleet.body[i], robot, 0.0, pace, box
    )
    return bool(predicted != NEVER or present != NEVER)


@compiled
def _is_due(fleet: Fleet, i: int, now: int, index: int, robot: RobotPath, box: Floats) -> bool:
    """Tell whether an artefact plans in this sub-step."""
    place, mind = fleet.place[i], fleet.mind[i]
    if place.is_scripted:
        return False
    moves = _is_moving(place, now)
    if not moves and fleet.order[i].has_goal == 0 and now >= mind.pushed_until:
        return False
    if place.must_plan or (index + place.id) % REPLAN == 0:
        return True
    return moves and robot.outlines.shape[0] > 0 and _meets_robot(fleet, i, now, robot, box)


@compiled
def _squares(fleet: Fleet, slots: Integers, due: _Mask, now: int, tempo: Tempo) -> Floats:
    """Return squares (N, 3), x, y, half side, that hold what each may commit itself to."""
    squares = np.empty((slots.shape[0], 3))
    for n in range(slots.shape[0]):
        place = fleet.place[slots[n]]
        squares[n, 0], squares[n, 1], squares[n, 2] = place.x, place.y, place.reach
        if due[n]:
            pose = fleet.path[slots[n], min(now - place.begin, place.last)]
            away = max(abs(pose[X] - place.x), abs(pose[Y] - place.y))
            reach = reach_of(fleet.body[slots[n]], tempo)
            squares[n, 0], squares[n, 1] = pose[X], pose[Y]
            squares[n, 2] = max(reach, away + place.reach)
    return squares


@compiled
def run(
    fleet: Fleet,
    slots: Integers,
    now: int,
    index: int,
    tempo: Tempo,
    floor: Floor,
    robot: RobotPath,
    desk: Desk,
) -> _Mask:
    """Let those who are due plan at sub-step `now`, in the order given, then all go on to the next.

    Returns bool (N,): whose pose has changed.
    """
    count = slots.shape[0]
    due = np.zeros(count, np.bool_)
    for n in range(count):
        due[n] = _is_due(fleet, slots[n], now, index, robot, desk.box)
    if due.any():
        buckets = fill(_squares(fleet, slots, due, now, tempo), slots)
        epoch = index // (_RANKS_LAST_SECONDS * tempo.second)
        for n in range(count):
            if due[n]:
                plan(fleet, slots[n], now, epoch, tempo, floor, robot, buckets, desk)
    return _go_on(fleet, slots, now, tempo)


@compiled
def _go_on(fleet: Fleet, slots: Integers, now: int, tempo: Tempo) -> _Mask:
    moved = np.zeros(slots.shape[0], np.bool_)
    for n in range(slots.shape[0]):
        i = slots[n]
        place, path = fleet.place[i], fleet.path[i]
        before = path[min(now - place.begin, place.last)]
        after = path[min(now + 1 - place.begin, place.last)]
        moved[n] = before[X] != after[X] or before[Y] != after[Y] or before[YAW] != after[YAW]
        if fleet.order[i].has_goal:
            note_progress(fleet, i, before, after, now + 1, tempo)
    return moved


@compiled
def mark_broken(
    fleet: Fleet,
    slots: Integers,
    intruders: Integers,
    is_new_floor: bool,
    now: int,
    floor: Floor,
    box: Floats,
) -> None:
    """Let those plan at once whose path an intruder (a slot) or a new floor has broken."""
    for i in slots:
        place, body = fleet.place[i], fleet.body[i]
        if place.is_scripted or not _is_moving(place, now):
            continue
        rest = fleet.path[i][now - place.begin : place.last + 1]
        last = rest.shape[0] - 1
        broken = False
        if is_new_floor:
            home = rest[last]
            broken = wall_conflict(rest, last, body, 0.0, place.pace, floor, box, home)[1] != NEVER
        for j in intruders:
            other = fleet.place[j]
            start = min(now - other.begin, other.last)
            pace = place.pace + other.pace
            _, k = gap_between(
                rest,
                last,
                body,
                fleet.path[j],
                start,
                other.last,
                fleet.body[j],
                0.0,
                pace,
                np.int64(NEVER),
                rest[last],
            )
            broken = broken or (i != j and k != NEVER)
        if broken:
            place.must_plan = 1


@compiled
def are_clear(fleet: Fleet, slots: Integers, now: int, poses: Floats, bodies: Records) -> _Mask:
    """Tell which bodies (M,) standing at poses (M, 6) from now on are met by nobody's path."""
    clear = np.ones(poses.shape[0], np.bool_)
    for n in range(poses.shape[0]):
        for i in slots:
            place = fleet.place[i]
            reach = place.reach + bodies[n].radius
            far = np.hypot(place.x - poses[n, X], place.y - poses[n, Y])
            if far >= reach:
                continue
            start = min(now - place.begin, place.last)
            if separation(poses[n], bodies[n], fleet.path[i, start], fleet.body[i]) < 0.0:
                clear[n] = False
                break
            _, k = gap_between(
                poses[n : n + 1],
                np.int64(0),
                bodies[n],
                fleet.path[i],
                start,
                place.last,
                fleet.body[i],
                0.0,
                place.pace,
                np.int64(NEVER),
                poses[n],
            )
            if k != NEVER:
                clear[n] = False
                break
    return clear
