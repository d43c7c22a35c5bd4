"""Planning for one agent: the cheapest proposal that meets no committed trajectory, or none."""

from typing import Any

import numpy as np

from are_ros._compiled import borrowing
from are_ros.agents.local_planner.deadlock import (
    can_yield,
    consider_detour,
    consider_swerving,
    keeps_way,
    push,
)
from are_ros.agents.local_planner.gaps import (
    TOUCH,
    find_neighbours,
    gap_between,
    separation,
    turns_among,
)
from are_ros.agents.local_planner.manoeuvres import boxed_in_by
from are_ros.agents.local_planner.primitives import cheapest
from are_ros.agents.local_planner.proposals import keep_to_way, propose
from are_ros.agents.local_planner.robot import robot_cost
from are_ros.agents.local_planner.rollouts import (
    BACKS_OFF_AFTER,
    BRAKE,
    GOING,
    HEADING,
    PUSHED,
    aim_of,
    bounds_of,
    roll_out,
)
from are_ros.agents.local_planner.state import (
    BY_ARTEFACT,
    BY_ROBOT,
    BY_WALL,
    COS,
    EMERGENCIES,
    KEPT,
    NEVER,
    NOBODY,
    PATH_FOLLOWING,
    PLANS,
    SIN,
    SPEED,
    UNOBSTRUCTED,
    AgentArrays,
    ClearanceLayer,
    Floats,
    PlannerTiming,
    RobotPath,
    SpatialHash,
    Workspace,
)
from are_ros.agents.local_planner.walls import (
    point_room,
    turns_freely,
    wall_conflict,
    wall_gap_wanted,
)

# What a path costs besides its primitive: nearness to walls, others and the robot.


INFEASIBLE = np.inf
_NEAR_WALL = 0.25
_NEAR_OTHERS = 0.5


@borrowing
def _assess_others(
    agents: AgentArrays,
    i: int,
    path: Floats,
    last: int,
    pace: float,
    circle: tuple[float, float, float],
    now: int,
    workspace: Workspace,
    count: int,
    met: int,
    most: float,
    has_comfort: bool,
) -> tuple[float, int, int]:
    """Return the cost of a path for its nearness to others, the row that it meets first, and when.

    That row is moved to the front, to be tried first by the next path. After another path met it,
    at sub-step `met`, any row that this path meets will do. The search stops once the cost is
    `most`. Without comfort only a meeting counts, which is found much sooner.
    """
    until, culprit, cost = NEVER, NOBODY, 0.0
    body, comfort, home = (
        agents.body[i],
        agents.command[i].comfort,
        agents.path[i, agents.place[i].last],
    )
    x, y, reach = circle[0], circle[1], circle[2] + body.radius
    reach += comfort if has_comfort else 0.0
    for n in range(count):
        j = workspace.near[n]
        place, wanted = agents.place[j], workspace.wanted[n] if has_comfort else 0.0
        dx, dy, far = place.x - x, place.y - y, place.reach + reach
        if dx * dx + dy * dy >= far * far:
            continue
        gap, k = gap_between(
            path,
            last,
            body,
            agents.path[j],
            min(now - place.begin, place.last),
            place.last,
            agents.body[j],
            wanted,
            pace + place.pace,
            until,
            home,
        )
        if k != NEVER:
            until, culprit = k - 1, j
            workspace.near[0], workspace.near[n] = j, workspace.near[0]
            workspace.wanted[0], workspace.wanted[n] = workspace.wanted[n], workspace.wanted[0]
            if met != NEVER or k == 1:
                break
        elif gap < wanted and comfort > 0.0:
            cost = max(cost, _NEAR_OTHERS * (wanted - gap) / comfort)
            if cost >= most:
                break
    return cost, culprit, until + 1


@borrowing
def assess(
    agents: AgentArrays,
    i: int,
    path: Floats,
    last: int,
    now: int,
    timing: PlannerTiming,
    floor: ClearanceLayer,
    robot: RobotPath,
    workspace: Workspace,
    count: int,
    wall_gap: float,
    met: int,
    most: float,
) -> tuple[float, int, int, int]:
    """Return what a path costs besides its primitive, what obstructs it, its row, and when.

    What costs `most` or more is INFEASIBLE. `met`: see `_assess_others`; the others are tested
    before the walls if one of them obstructed a path before.
    """
    body, command = agents.body[i], agents.command[i]
    if met != NEVER:  # the one that another path met, at the same sub-step
        j, place = workspace.near[0], agents.place[workspace.near[0]]
        other = agents.path[j, min(now - place.begin + met, place.last)]
        if separation(path[min(met, last)], body, other, agents.body[j]) < -TOUCH:
            return INFEASIBLE, BY_ARTEFACT, j, met
    pace, circle = bounds_of(path, last, body, timing.step_s)
    home = agents.path[i, agents.place[i].last]
    cost = 0.0
    for turn in range(3):  # a loop, for two calls of one kernel take twice as long to compile
        if turn == 0 and met == NEVER:
            continue
        if turn != 1:
            nearness, culprit, k = _assess_others(
                agents,
                i,
                path,
                last,
                pace,
                circle,
                now,
                workspace,
                count,
                met,
                most - cost,
                turn == 2,
            )
            cost += nearness
            if culprit != NOBODY:
                return INFEASIBLE, BY_ARTEFACT, culprit, k
        elif point_room(circle[0], circle[1], body, floor) < circle[2] + body.radius + max(
            wall_gap, 0.0
        ):
            must_keep = cost + _NEAR_WALL >= most
            kept, k = wall_conflict(
                path, last, body, wall_gap, pace, floor, workspace.box, home, must_keep
            )
            if k != NEVER:
                return INFEASIBLE, BY_WALL, NOBODY, k
            cost += 0.0 if kept else _NEAR_WALL
        if cost >= most:
            return INFEASIBLE, UNOBSTRUCTED, NOBODY, NEVER
    nearness, meets = robot_cost(
        path, 0, last, body, command.robot_comfort, robot, pace, workspace.box
    )
    return cost + nearness, BY_ROBOT if meets else UNOBSTRUCTED, NOBODY, NEVER


REPLAN = 10
"""Sub-steps from one plan to the next, unless something changes before."""
_WORTH_IT = 0.02
_AHEAD = 0.5  # cosine


@borrowing
def reach_of(body: Any, timing: PlannerTiming) -> float:
    """Return how far from its present pose any point of a body can get on its next path."""
    steps = timing.drive if body.turn_radius > 0.0 else timing.walk
    way = body.speed * (steps * timing.step_s + 0.5 * body.speed / body.acceleration)
    return float(way + body.radius)


@borrowing
def commit(
    agents: AgentArrays, i: int, path: Floats, last: int, now: int, timing: PlannerTiming
) -> None:
    """Commit agent i to a path, whose pose 0 is that of `now`."""
    place = agents.place[i]
    for k in range(last + 1):  # slices would take ten seconds more to compile
        for column in range(path.shape[1]):
            agents.path[i, k, column] = path[k, column]
    place.begin, place.last, place.must_plan = now, last, 0
    place.pace, circle = bounds_of(path, last, agents.body[i], timing.step_s)
    place.x, place.y, place.reach = circle[0], circle[1], circle[2] + agents.body[i].radius


@borrowing
def _search(
    agents: AgentArrays,
    i: int,
    now: int,
    timing: PlannerTiming,
    floor: ClearanceLayer,
    robot: RobotPath,
    workspace: Workspace,
    options: int,
    near: int,
    wall_gap: float,
    follows: bool,
    may_reverse: bool,
) -> tuple[int, int, int, int, int]:
    """Try primitives, cheapest first, until none can be cheaper than the best by `_WORTH_IT`.

    A vehicle that `follows` its path tries no arc but the first that the walls allow, and those in
    reverse if it `may_reverse`. Returns the primitive chosen (-1: none is feasible), which of the
    two scratch paths it fills and its last index, what obstructs the first one, and the first row
    that obstructs any.
    """
    best, chosen, side, last = INFEASIBLE, -1, 0, 0
    obstruction, culprit, is_first, met = UNOBSTRUCTED, NOBODY, True, NEVER
    has_way = not follows
    while True:
        n = cheapest(workspace.options, options)
        if n < 0 or workspace.options[n, 3] >= best - _WORTH_IT:
            break
        cost = workspace.options[n, 3]
        path = workspace.paths[1 - side]
        end = roll_out(path, workspace.options[n], workspace.goal, agents.body[i], timing)
        extra, kind, who, k = assess(
            agents,
            i,
            path,
            end,
            now,
            timing,
            floor,
            robot,
            workspace,
            near,
            wall_gap,
            met,
            best - cost,
        )
        cost += extra
        if is_first:
            obstruction = kind
        if who != NOBODY:
            met = k
            culprit = who if culprit == NOBODY else culprit
        is_first = False
        if not has_way and kind != BY_WALL:  # the first arc that the walls allow
            keep_to_way(workspace.options, options, n, may_reverse)
            has_way = True
        if cost < best:
            best, chosen, side, last = cost, n, 1 - side, end
        workspace.options[n, 3] = np.inf
        if k < end and 2 * k <= timing.walk and workspace.options[n, 0] == HEADING:
            # a primitive that is the same in its first half fails, too: it stands beside this one
            for twin in range(max(n - 1, 0), min(n + 2, options)):
                row, other = workspace.options[n], workspace.options[twin]
                if other[0] == HEADING and other[1] == row[1] and other[2] == row[2]:
                    other[3] = np.inf
    return chosen, side, last, obstruction, culprit


@borrowing
def plan(
    agents: AgentArrays,
    i: int,
    now: int,
    epoch: int,
    timing: PlannerTiming,
    floor: ClearanceLayer,
    robot: RobotPath,
    buckets: SpatialHash,
    workspace: Workspace,
) -> None:
    """Plan for agent i from its pose at sub-step `now`."""
    place, memory, command, body = (
        agents.place[i],
        agents.memory[i],
        agents.command[i],
        agents.body[i],
    )
    agents.due[i] = now + REPLAN
    start = min(now - place.begin, place.last)
    pose = workspace.paths[0, 0]
    for column in range(pose.shape[0]):
        pose[column] = workspace.paths[1, 0, column] = agents.path[i, start, column]
    follows = keeps_way(agents, i, now)
    if command.planner <= PATH_FOLLOWING and not (follows or memory.is_boxed_in):
        consider_detour(memory, place.id, now, timing.second)
    aim = aim_of(agents, i, pose, now, timing.second)
    is_at_rest = aim.speed <= 0.0 and np.isnan(aim.heading) and pose[SPEED] == 0.0
    if is_at_rest and start == place.last:
        place.must_plan = 0
        return
    near = find_neighbours(buckets, agents, i, pose, reach_of(body, timing), now, workspace)
    # a walker steps back if it is blocked where walls or others keep it from turning
    backs_off = body.turn_radius == 0.0 and pose[SPEED] <= 0.0
    backs_off = backs_off and (memory.blocked > BACKS_OFF_AFTER or memory.gear < 0)
    backs_off = backs_off and not (
        turns_freely(pose, body, floor) and turns_among(agents, i, pose, now, workspace, near)
    )
    workspace.goal[0], workspace.goal[1] = command.x, command.y
    options = propose(agents, i, aim, pose, now, timing, floor, robot, workspace, near, backs_off)
    wall_gap = wall_gap_wanted(pose, body, command.wall_comfort, floor, workspace.box)
    is_aside = np.cos(aim.heading) * pose[COS] + np.sin(aim.heading) * pose[SIN] < _AHEAD
    is_stuck = memory.blocked > BACKS_OFF_AFTER
    follows = follows and body.turn_radius > 0.0 and aim.kind != PUSHED
    follows = follows and not (is_stuck and memory.obstruction <= BY_WALL)  # by nobody
    chosen, side, last, obstruction, culprit = _search(
        agents,
        i,
        now,
        timing,
        floor,
        robot,
        workspace,
        options,
        near,
        wall_gap,
        follows,
        is_stuck and is_aside,
    )
    stays = chosen < 0 or workspace.options[chosen, 0] == BRAKE
    is_alone = stays and culprit == NOBODY
    culprit = boxed_in_by(agents, i, now, pose, workspace.standing) if is_alone else culprit
    if obstruction == BY_WALL and culprit != NOBODY and stays:
        obstruction = BY_ARTEFACT  # between the walls there is a way
    who = agents.place[culprit].id if culprit != NOBODY else NOBODY
    if aim.kind == GOING:
        memory.obstruction, memory.obstructed_by = (
            obstruction,
            who if obstruction == BY_ARTEFACT else NOBODY,
        )
        memory.can_yield = (
            obstruction == BY_ARTEFACT and culprit != NOBODY and can_yield(agents, i, culprit, now)
        )
    if culprit != NOBODY and (aim.kind == PUSHED or obstruction == BY_ARTEFACT):
        consider_swerving(agents, i, culprit, pose, now, timing.second)
        push(agents, i, culprit, aim, pose, now, epoch, timing.second)
    if chosen < 0:
        workspace.counters[KEPT] += 1
        workspace.counters[EMERGENCIES] += place.must_plan
        place.must_plan = 0
        return
    option = workspace.options[chosen]
    if option[0] != BRAKE:
        # its heading or curvature
        memory.chosen = np.arctan2(pose[SIN], pose[COS]) if np.isnan(option[1]) else option[1]
        memory.gear = 1 if option[2] > 0.0 else -1
    elif aim.kind != GOING and aim.speed <= 0.0:
        memory.chosen = np.nan
    commit(agents, i, workspace.paths[side], last, now, timing)
    workspace.counters[PLANS] += 1
