"""One sub-step of everybody: who is due plans, one after the other, and all go on."""

from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.motion._borrowing import borrowing, owning
from are_ros.artefacts.motion._buckets import fill
from are_ros.artefacts.motion._gaps import gap_between, separation
from are_ros.artefacts.motion._patience import note_progress
from are_ros.artefacts.motion._planning import copy_pose, plan, reach_of
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
from are_ros.artefacts.motion._walls import wall_conflict, wall_gap_wanted

_Mask = npt.NDArray[np.bool_]
_RANKS_LAST_SECONDS = 8


@borrowing
def _is_moving(place: Any, now: int) -> bool:
    return bool(now - place.begin < place.last)


@borrowing
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


@borrowing
def _is_due(fleet: Fleet, i: int, now: int, robot: RobotPath, box: Floats) -> bool:
    """Tell whether an artefact plans in this sub-step."""
    if now < fleet.due[i] and robot.outlines.shape[0] == 0:
        return False
    place = fleet.place[i]
    if place.is_scripted:
        return False
    moves = _is_moving(place, now)
    if now < fleet.due[i]:
        return moves and _meets_robot(fleet, i, now, robot, box)
    return bool(moves or fleet.order[i].has_goal == 1 or now < fleet.mind[i].pushed_until)


@borrowing
def _widen(
    squares: Floats, fleet: Fleet, slots: Integers, due: _Mask, now: int, tempo: Tempo
) -> None:
    """Make the squares (N, 3), x, y, half side, hold what those who are due may commit to."""
    for n in range(slots.shape[0]):
        if due[n]:
            place = fleet.place[slots[n]]
            pose = fleet.path[slots[n], min(now - place.begin, place.last)]
            away = max(abs(pose[X] - place.x), abs(pose[Y] - place.y))
            reach = reach_of(fleet.body[slots[n]], tempo)
            squares[n, 0], squares[n, 1] = pose[X], pose[Y]
            squares[n, 2] = max(reach, away + place.reach)


@borrowing
def _mark_due(
    due: _Mask, fleet: Fleet, slots: Integers, now: int, robot: RobotPath, box: Floats
) -> int:
    """Write who plans in this sub-step to `due` (N,); return how many they are."""
    count = 0
    for n in range(slots.shape[0]):
        due[n] = _is_due(fleet, slots[n], now, robot, box)
        count += due[n]
    return count


@owning
def run(
    fleet: Fleet,
    slots: Integers,
    circles: Floats,
    now: int,
    index: int,
    tempo: Tempo,
    floor: Floor,
    robot: RobotPath,
    desk: Desk,
) -> tuple[_Mask, Floats, Floats]:
    """Let those who are due plan at sub-step `now`, in the order given, then all go on to the next.

    Circles as of `survey`. Returns bool (N,): whose pose has changed; and then what `survey` does
    of the next sub-step.
    """
    due = np.empty(slots.shape[0], np.bool_)
    if _mark_due(due, fleet, slots, now, robot, desk.box) > 0:
        squares = circles.copy()
        _widen(squares, fleet, slots, due, now, tempo)
        buckets = fill(squares, slots)
        epoch = index // (_RANKS_LAST_SECONDS * tempo.second)
        for n in range(slots.shape[0]):
            if due[n]:
                plan(fleet, slots[n], now, epoch, tempo, floor, robot, buckets, desk)
    moved = np.empty(slots.shape[0], np.bool_)
    _go_on(moved, fleet, slots, now, tempo)
    poses, circles = survey(fleet, slots, now + 1)
    return moved, poses, circles


@borrowing
def _go_on(moved: _Mask, fleet: Fleet, slots: Integers, now: int, tempo: Tempo) -> None:
    """Note for all what progress they make to the next sub-step, and write who moves, bool (N,)."""
    for n in range(slots.shape[0]):
        i = slots[n]
        place, path = fleet.place[i], fleet.path[i]
        before = path[min(now - place.begin, place.last)]
        after = path[min(now + 1 - place.begin, place.last)]
        moved[n] = before[X] != after[X] or before[Y] != after[Y] or before[YAW] != after[YAW]
        if fleet.order[i].has_goal:
            note_progress(fleet, i, before, after, now + 1, tempo)


@owning
def survey(fleet: Fleet, slots: Integers, now: int) -> tuple[Floats, Floats]:
    """Return everybody's pose (N, 6) at sub-step `now`, and the circles (N, 3) of their paths.

    A circle (x, y, reach) holds a body on all of its path.
    """
    poses, circles = np.empty((slots.shape[0], 6)), np.empty((slots.shape[0], 3))
    _survey(poses, circles, fleet, slots, now)
    return poses, circles


@borrowing
def _survey(poses: Floats, circles: Floats, fleet: Fleet, slots: Integers, now: int) -> None:
    for n in range(slots.shape[0]):
        place = fleet.place[slots[n]]
        copy_pose(fleet.path[slots[n], min(now - place.begin, place.last)], poses[n])
        circles[n, 0], circles[n, 1], circles[n, 2] = place.x, place.y, place.reach


@borrowing
def _are_near(circles: Floats, n: int, x: float, y: float, reach: float) -> bool:
    """Tell whether circle n meets another."""
    dx, dy, far = circles[n, 0] - x, circles[n, 1] - y, circles[n, 2] + reach
    return bool(dx * dx + dy * dy < far * far)


@borrowing
def mark_closed(fleet: Fleet, slots: Integers, now: int, floor: Floor, box: Floats) -> None:
    """Let those plan at once whose path a new floor has closed."""
    for i in slots:
        place, body = fleet.place[i], fleet.body[i]
        if place.is_scripted or not _is_moving(place, now):
            continue
        rest = fleet.path[i][now - place.begin : place.last + 1]
        last = rest.shape[0] - 1
        wanted = wall_gap_wanted(rest[0], body, 0.0, floor, box)
        if (
            wall_conflict(rest, last, body, wanted, place.pace, floor, box, rest[last], False)[1]
            != NEVER
        ):
            place.must_plan, fleet.due[i] = 1, now


@borrowing
def mark_broken(
    fleet: Fleet, slots: Integers, circles: Floats, intruders: Integers, now: int
) -> None:
    """Let those plan at once whose path an intruder (a slot) has broken; circles as of `survey`."""
    for j in intruders:
        other = fleet.place[j]
        for n in range(slots.shape[0]):
            i = slots[n]
            if i == j or not _are_near(circles, n, other.x, other.y, other.reach):
                continue
            place = fleet.place[i]
            if place.is_scripted or not _is_moving(place, now):
                continue
            rest = fleet.path[i][now - place.begin : place.last + 1]
            last = rest.shape[0] - 1
            _, k = gap_between(
                rest,
                last,
                fleet.body[i],
                fleet.path[j],
                min(now - other.begin, other.last),
                other.last,
                fleet.body[j],
                0.0,
                place.pace + other.pace,
                NEVER,
                rest[last],
            )
            if k != NEVER:
                place.must_plan, fleet.due[i] = 1, now


@borrowing
def mark_clear(
    clear: _Mask,
    fleet: Fleet,
    slots: Integers,
    circles: Floats,
    now: int,
    poses: Floats,
    bodies: Records,
) -> None:
    """Strike out of `clear` (M,) the bodies (M,) that somebody's path meets.

    They stand at poses (M, 6) from now on. Circles as of `survey`.
    """
    for m in range(poses.shape[0]):
        for n in range(slots.shape[0]):
            near = _are_near(circles, n, poses[m, X], poses[m, Y], bodies[m].radius)
            if near and _meets(fleet, slots[n], now, poses[m : m + 1], bodies[m]):
                clear[m] = False
                break


@borrowing
def _meets(fleet: Fleet, i: int, now: int, pose: Floats, body: Any) -> bool:
    """Tell whether a path meets a body that stands at a pose (1, 6) from now on."""
    place = fleet.place[i]
    start = min(now - place.begin, place.last)
    if separation(pose[0], body, fleet.path[i, start], fleet.body[i]) < 0.0:
        return True
    _, k = gap_between(
        pose,
        0,
        body,
        fleet.path[i],
        start,
        place.last,
        fleet.body[i],
        0.0,
        place.pace,
        NEVER,
        pose[0],
    )
    return bool(k != NEVER)
