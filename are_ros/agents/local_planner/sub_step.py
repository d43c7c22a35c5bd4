"""One sub-step of all agents: those that are due plan, one after the other, and all move on."""

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, owning
from are_ros.agents.local_planner.deadlock import note_progress
from are_ros.agents.local_planner.gaps import gap_between, separation
from are_ros.agents.local_planner.planning import copy_pose, plan, reach_of
from are_ros.agents.local_planner.robot import robot_conflict
from are_ros.agents.local_planner.spatial_hash import fill
from are_ros.agents.local_planner.state import (
    NEVER,
    YAW,
    AgentArrays,
    ClearanceLayer,
    Floats,
    PlannerTiming,
    Records,
    RobotPath,
    Workspace,
    X,
    Y,
)
from are_ros.agents.local_planner.walls import wall_conflict, wall_gap_wanted

_Mask = npt.NDArray[np.bool_]
_RANKS_LAST_SECONDS = 8


@borrowing
def _is_due(agents: AgentArrays, i: int, now: int, robot: RobotPath, box: Floats) -> bool:
    """Tell whether an agent plans in this sub-step."""
    if now < agents.due[i] and robot.outlines.shape[0] == 0:
        return False
    place = agents.place[i]
    if place.is_scripted:
        return False
    moves = now - place.begin < place.last
    if now < agents.due[i]:
        # only where what is left of its path leads into the robot, where it is or will be
        reach = place.reach + robot.reach
        is_far = abs(place.x - robot.x) > reach or abs(place.y - robot.y) > reach
        if is_far or not moves:
            return False
        start, pace = now - place.begin, place.pace + robot.pace
        _, predicted, present = robot_conflict(
            agents.path[i], start, place.last, agents.body[i], robot, 0.0, pace, box
        )
        return bool(predicted != NEVER or present != NEVER)
    return bool(moves or agents.command[i].has_goal == 1 or now < agents.memory[i].pushed_until)


@borrowing
def _mark_due(
    due: _Mask,
    squares: Floats,
    agents: AgentArrays,
    now: int,
    robot: RobotPath,
    workspace: Workspace,
    timing: PlannerTiming,
) -> int:
    """Write to `due` (N,) which agents plan in this sub-step; return how many they are.

    And to `squares` (N, 3), x, y, half side, a square that holds the agent on its trajectory and on
    each that it may commit to.
    """
    count = 0
    for i in range(due.shape[0]):
        place = agents.place[i]
        squares[i, 0], squares[i, 1], squares[i, 2] = place.x, place.y, place.reach
        due[i] = _is_due(agents, i, now, robot, workspace.box)
        if due[i]:
            count += 1
            pose = agents.path[i, min(now - place.begin, place.last)]
            away = max(abs(pose[X] - place.x), abs(pose[Y] - place.y))
            squares[i, 0], squares[i, 1] = pose[X], pose[Y]
            squares[i, 2] = max(reach_of(agents.body[i], timing), away + place.reach)
    return count


@owning
def run(
    agents: AgentArrays,
    now: int,
    index: int,
    timing: PlannerTiming,
    floor: ClearanceLayer,
    robot: RobotPath,
    workspace: Workspace,
) -> tuple[_Mask, Floats]:
    """Plan for the agents that are due at sub-step `now`, in the order of ids; then all move on.

    Returns bool (N,): which poses have changed; and the poses (N, 6) at the next sub-step.
    """
    size = agents.place.shape[0]
    due, squares = np.empty(size, np.bool_), np.empty((size, 3))
    if _mark_due(due, squares, agents, now, robot, workspace, timing) > 0:
        buckets = fill(squares)
        epoch = index // (_RANKS_LAST_SECONDS * timing.second)
        for i in range(size):
            if due[i]:
                plan(agents, i, now, epoch, timing, floor, robot, buckets, workspace)
    moved, poses = np.empty(size, np.bool_), np.empty((size, 6))
    for i in range(size):
        place, path = agents.place[i], agents.path[i]
        before = path[min(now - place.begin, place.last)]
        after = path[min(now + 1 - place.begin, place.last)]
        copy_pose(after, poses[i])
        moved[i] = before[X] != after[X] or before[Y] != after[Y] or before[YAW] != after[YAW]
        if agents.command[i].has_goal:
            note_progress(agents, i, before, after, now + 1, timing)
    return moved, poses


@borrowing
def mark_closed(agents: AgentArrays, now: int, floor: ClearanceLayer, box: Floats) -> None:
    """Make those agents plan at once whose trajectory meets closed ground of a new map."""
    for i in range(agents.place.shape[0]):
        place, body = agents.place[i], agents.body[i]
        if place.is_scripted or now - place.begin >= place.last:
            continue
        rest = agents.path[i][now - place.begin : place.last + 1]
        last = rest.shape[0] - 1
        wanted = wall_gap_wanted(rest[0], body, 0.0, floor, box)
        if (
            wall_conflict(rest, last, body, wanted, place.pace, floor, box, rest[last], False)[1]
            != NEVER
        ):
            place.must_plan, agents.due[i] = 1, now


@borrowing
def mark_broken(agents: AgentArrays, now: int) -> None:
    """Make those agents plan at once that meet a trajectory which was changed from outside."""
    for j in range(agents.place.shape[0]):
        other = agents.place[j]
        if not other.is_news:
            continue
        other.is_news = 0
        for i in range(agents.place.shape[0]):
            place = agents.place[i]
            dx, dy, far = place.x - other.x, place.y - other.y, place.reach + other.reach
            if i == j or dx * dx + dy * dy >= far * far:
                continue
            if place.is_scripted or now - place.begin >= place.last:
                continue
            rest = agents.path[i][now - place.begin : place.last + 1]
            last = rest.shape[0] - 1
            _, k = gap_between(
                rest,
                last,
                agents.body[i],
                agents.path[j],
                min(now - other.begin, other.last),
                other.last,
                agents.body[j],
                0.0,
                place.pace + other.pace,
                NEVER,
                rest[last],
            )
            if k != NEVER:
                place.must_plan, agents.due[i] = 1, now


@borrowing
def mark_clear(clear: _Mask, agents: AgentArrays, now: int, poses: Floats, bodies: Records) -> None:
    """Set `clear` (M,) to False for each body (M,) that a trajectory meets.

    The bodies stand at poses (M, 6) from now on.
    """
    for m in range(poses.shape[0]):
        pose = poses[m : m + 1]
        for i in range(agents.place.shape[0]):
            place, path = agents.place[i], agents.path[i]
            dx, dy = place.x - poses[m, X], place.y - poses[m, Y]
            far = place.reach + bodies[m].radius
            if dx * dx + dy * dy >= far * far:
                continue
            body, other = bodies[m], agents.body[i]
            start = min(now - place.begin, place.last)
            if separation(pose[0], body, path[start], other) >= 0.0:
                _, k = gap_between(
                    pose, 0, body, path, start, place.last, other, 0.0, place.pace, NEVER, pose[0]
                )
                if k == NEVER:
                    continue
            clear[m] = False
            break
