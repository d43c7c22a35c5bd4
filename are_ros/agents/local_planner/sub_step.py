"""One sub-step of everybody: who is due plans, one after the other, and all go on."""

from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, owning
from are_ros.agents.local_planner.gaps import gap_between, separation
from are_ros.agents.local_planner.patience import note_progress
from are_ros.agents.local_planner.planning import copy_pose, plan, reach_of
from are_ros.agents.local_planner.robot import robot_conflict
from are_ros.agents.local_planner.spatial_hash import fill
from are_ros.agents.local_planner.state import (
    NEVER,
    YAW,
    Desk,
    Fleet,
    Floats,
    Floor,
    Records,
    RobotPath,
    Tempo,
    X,
    Y,
)
from are_ros.agents.local_planner.walls import wall_conflict, wall_gap_wanted

_Mask = npt.NDArray[np.bool_]
_RANKS_LAST_SECONDS = 8


@borrowing
def _is_moving(place: Any, now: int) -> bool:
    return bool(now - place.begin < place.last)


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
        # only where what is left of its path leads into the robot, where it is or will be
        reach = place.reach + robot.reach
        is_far = abs(place.x - robot.x) > reach or abs(place.y - robot.y) > reach
        if is_far or not moves:
            return False
        start, pace = now - place.begin, place.pace + robot.pace
        _, predicted, present = robot_conflict(
            fleet.path[i], start, place.last, fleet.body[i], robot, 0.0, pace, box
        )
        return bool(predicted != NEVER or present != NEVER)
    return bool(moves or fleet.order[i].has_goal == 1 or now < fleet.mind[i].pushed_until)


@borrowing
def _mark_due(
    due: _Mask, squares: Floats, fleet: Fleet, now: int, robot: RobotPath, desk: Desk, tempo: Tempo
) -> int:
    """Write who plans in this sub-step to `due` (N,); return how many they are.

    And to `squares` (N, 3), x, y, half side, what holds all that each is or may commit to.
    """
    count = 0
    for i in range(due.shape[0]):
        place = fleet.place[i]
        squares[i, 0], squares[i, 1], squares[i, 2] = place.x, place.y, place.reach
        due[i] = _is_due(fleet, i, now, robot, desk.box)
        if due[i]:
            count += 1
            pose = fleet.path[i, min(now - place.begin, place.last)]
            away = max(abs(pose[X] - place.x), abs(pose[Y] - place.y))
            squares[i, 0], squares[i, 1] = pose[X], pose[Y]
            squares[i, 2] = max(reach_of(fleet.body[i], tempo), away + place.reach)
    return count


@owning
def run(
    fleet: Fleet, now: int, index: int, tempo: Tempo, floor: Floor, robot: RobotPath, desk: Desk
) -> tuple[_Mask, Floats]:
    """Let those who are due plan at sub-step `now`, in the order of ids, then all go on.

    Returns bool (N,): whose pose has changed; and the poses (N, 6) at the next sub-step.
    """
    size = fleet.place.shape[0]
    due, squares = np.empty(size, np.bool_), np.empty((size, 3))
    if _mark_due(due, squares, fleet, now, robot, desk, tempo) > 0:
        buckets = fill(squares)
        epoch = index // (_RANKS_LAST_SECONDS * tempo.second)
        for i in range(size):
            if due[i]:
                plan(fleet, i, now, epoch, tempo, floor, robot, buckets, desk)
    moved, poses = np.empty(size, np.bool_), np.empty((size, 6))
    _go_on(moved, poses, fleet, now, tempo)
    return moved, poses


@borrowing
def _go_on(moved: _Mask, poses: Floats, fleet: Fleet, now: int, tempo: Tempo) -> None:
    """Note what progress all make to the next sub-step; write who moves (N,), and to where."""
    for i in range(moved.shape[0]):
        place, path = fleet.place[i], fleet.path[i]
        before = path[min(now - place.begin, place.last)]
        after = path[min(now + 1 - place.begin, place.last)]
        copy_pose(after, poses[i])
        moved[i] = before[X] != after[X] or before[Y] != after[Y] or before[YAW] != after[YAW]
        if fleet.order[i].has_goal:
            note_progress(fleet, i, before, after, now + 1, tempo)


@borrowing
def poses_at(fleet: Fleet, now: int, poses: Floats) -> None:
    """Write everybody's pose (N, 6) at sub-step `now`."""
    for i in range(poses.shape[0]):
        place = fleet.place[i]
        copy_pose(fleet.path[i, min(now - place.begin, place.last)], poses[i])


@borrowing
def _is_near(place: Any, x: float, y: float, reach: float) -> bool:
    """Tell whether the circle that holds a body on all of its path meets another."""
    dx, dy, far = place.x - x, place.y - y, place.reach + reach
    return bool(dx * dx + dy * dy < far * far)


@borrowing
def mark_closed(fleet: Fleet, now: int, floor: Floor, box: Floats) -> None:
    """Let those plan at once whose path a new floor has closed."""
    for i in range(fleet.place.shape[0]):
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
def mark_broken(fleet: Fleet, now: int) -> None:
    """Let those plan at once whose path one that `is_news` has broken; it is so no more."""
    for j in range(fleet.place.shape[0]):
        other = fleet.place[j]
        if not other.is_news:
            continue
        other.is_news = 0
        for i in range(fleet.place.shape[0]):
            place = fleet.place[i]
            if i == j or not _is_near(place, other.x, other.y, other.reach):
                continue
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
def mark_clear(clear: _Mask, fleet: Fleet, now: int, poses: Floats, bodies: Records) -> None:
    """Strike out of `clear` (M,) the bodies (M,) that somebody's path meets.

    They stand at poses (M, 6) from now on.
    """
    for m in range(poses.shape[0]):
        for i in range(fleet.place.shape[0]):
            near = _is_near(fleet.place[i], poses[m, X], poses[m, Y], bodies[m].radius)
            if near and _meets(fleet, i, now, poses[m : m + 1], bodies[m]):
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
