"""Manoeuvres of a vehicle: how it turns round where the way ahead is not open.

The way ahead is the shortest one: an arc, then its tangent. Where walls are on it, or others that
stand on the arc, a search (A*) over legs of the tightest curvature and straight ones, forward and
in reverse, finds the cheapest that lead to a pose from where it is open. The vehicle drives them
one after the other, until the way is open or its goal lies elsewhere. It waits for agents that
move or will soon; if that lasts, it searches again. Where those that stand leave it no manoeuvre,
it waits for them.
"""

import math
from typing import Any

import numpy as np

from are_ros._compiled import borrowing, owning
from are_ros.agents.body import TIGHTEST
from are_ros.agents.local_planner.deadlock import keeps_way
from are_ros.agents.local_planner.gaps import gap_between, separation
from are_ros.agents.local_planner.primitives import (
    FORWARD,
    REVERSE_PRICE,
    REVERSE_SHARE,
    arc_and_tangent,
    point_ahead,
    set_option,
    ways_left,
)
from are_ros.agents.local_planner.rollouts import (
    ARC_TO_POINT,
    BACKS_OFF_AFTER,
    BRAKE,
    GOING,
    PlanningGoal,
    wrapped,
)
from are_ros.agents.local_planner.state import (
    BY_ARTEFACT,
    COS,
    LEG_POSES,
    NEVER,
    NOBODY,
    SIN,
    YAW,
    AgentArrays,
    ClearanceLayer,
    Floats,
    Integers,
    PlannerTiming,
    Workspace,
    X,
    Y,
)
from are_ros.agents.local_planner.walls import wall_conflict, wall_gap_wanted

_Point = tuple[float, float, float]
_Search = tuple[
    Floats, _Point, tuple[float, float], float, int, Any, ClearanceLayer, Floats, AgentArrays
]
"""What `_find_manoeuvre` takes before the rows that stand."""

_STEP = 0.3  # the length of a node's leg in turning radii, and so an angle [rad]
_MOST_NODES = 2400
_CELLS, _CELL = 40, 0.25  # poses in one cell, of so many turning radii, and of one of `_YAWS`
_YAWS = 24  # headings are one to the search
_SHUNT = 0.6  # the price of a change of direction, in turning radii
_STEER = 0.05  # and that of steering elsewhere
_MARGIN_M = 0.05  # of a manoeuvre, and of the way to which it leads; others are open without
_LEAST_LEFT, _MOST_LEFT = 0.03, 1.0  # of the turning radius
_OFF_M, _OFF = 0.3, -1e3  # farther aside than this, a vehicle is off its leg
_TURNED = 0.8  # a goal elsewhere by this angle ends the leg
_AGAIN_S = 2
_PAST_ARC, _LEAST_ARC = 0.3, 0.5  # in turning radii; the dynamic window passes who is ahead
_WORTH, _WORTH_AMONG = 1.0, 3.0  # so many radii nearer must one lead from where it is not open
_AMONG, _AMONG_REACH, _PATIENCE_S = 4.0, 3.0, 2.0  # if it cannot: in radii, after a while
_MOST_STEPS, _DIGITS = 24, 6**24  # of a manoeuvre that is kept, as a number to the base of 6


@borrowing
def _copy(into: Floats, i: int, poses: Floats, k: int) -> None:
    """Write pose k of some poses as pose i; to assign a row would take long to compile."""
    for column in range(poses.shape[1]):
        into[i, column] = poses[k, column]


@borrowing
def _move(path: Floats, k: int, bend: float, way: float) -> None:
    """Write the pose k, a signed length along a curve from pose 0."""
    pose, turn, x, y = path[0], bend * way, way, 0.0
    if turn != 0.0:
        x, y = np.sin(turn) / bend, (1.0 - np.cos(turn)) / bend
    path[k, X] = pose[X] + pose[COS] * x - pose[SIN] * y
    path[k, Y] = pose[Y] + pose[SIN] * x + pose[COS] * y
    path[k, YAW] = pose[YAW] + turn
    path[k, COS], path[k, SIN] = np.cos(path[k, YAW]), np.sin(path[k, YAW])


@borrowing
def _is_free(
    path: Floats,
    last: int,
    body: Any,
    pace: float,
    margin: float,
    floor: ClearanceLayer,
    box: Floats,
) -> bool:
    """Tell whether a body keeps free on a path, with a margin [m] if it begins with one."""
    gap = wall_gap_wanted(path[0], body, margin, floor, box)
    kept, k = wall_conflict(path, last, body, gap, pace, floor, box, path[last], True)
    return kept and k == NEVER


@borrowing
def _find_standing(
    agents: AgentArrays, i: int, now: int, pose: Floats, reach: float, standing: Integers
) -> int:
    """Write the other rows that stand without a goal within `reach`; return how many they are.

    None for a vehicle that keeps its way, and goes round nobody.
    """
    count = 0
    if keeps_way(agents, i, now):
        return count
    for j in range(agents.place.shape[0]):
        place = agents.place[j]
        if j == i or now - place.begin < place.last or agents.command[j].has_goal == 1:
            continue
        dx, dy, far = place.x - pose[X], place.y - pose[Y], place.reach + reach
        if dx * dx + dy * dy < far * far:
            standing[count] = j
            count += 1
    return count


@borrowing
def boxed_in_by(agents: AgentArrays, i: int, now: int, pose: Floats, standing: Integers) -> int:
    """Return the nearest row of those that leave vehicle i no manoeuvre, NOBODY if none do."""
    nearest, least = NOBODY, np.inf
    if agents.memory[i].is_boxed_in == 0:
        return nearest
    reach = _AMONG * TIGHTEST * agents.body[i].turn_radius
    for n in range(_find_standing(agents, i, now, pose, reach, standing)):
        place = agents.place[standing[n]]
        dx, dy = place.x - pose[X], place.y - pose[Y]
        if dx * dx + dy * dy < least:
            nearest, least = standing[n], dx * dx + dy * dy
    return nearest


@borrowing
def _is_clear(
    path: Floats,
    last: int,
    body: Any,
    pace: float,
    margin: float,
    agents: AgentArrays,
    standing: Integers,
) -> bool:
    """Tell whether a path meets none of those rows that stand, with a margin as for walls."""
    for j in standing:
        other, end = agents.body[j], agents.place[j].last
        gap = max(separation(path[0], body, agents.path[j, end], other), 0.0)
        wanted = min(gap, margin)
        gap, k = gap_between(
            path, last, body, agents.path[j], end, end, other, wanted, pace, NEVER, path[last]
        )
        if k != NEVER or gap < wanted:
            return False
    return True


@borrowing
def _is_open(
    path: Floats,
    point: _Point,
    reaches: tuple[float, float],
    radius: float,
    margin: float,
    body: Any,
    floor: ClearanceLayer,
    box: Floats,
    agents: AgentArrays,
    standing: Integers,
) -> tuple[bool, bool, bool]:
    """Tell whether walls, and if so others, leave open the shortest way from pose 0 to a point.

    And whether it leads forward, as one does that goes on. Looked at are its arc, and its tangent
    up to the sub-goal, or to `reaches`: for walls, for others. If walls close it, the one arc that
    ends in the point will do, where that is ahead. The path is written into.
    """
    pose = path[0]
    dx, dy = point[0] - pose[X], point[1] - pose[Y]
    forward, back = ways_left(pose[X], pose[Y], pose[YAW], point[0], point[1], radius)
    sense = 1.0 if forward <= back or point[2] > 0.0 else -1.0
    ahead, aside = sense * (dx * pose[COS] + dy * pose[SIN]), dy * pose[COS] - dx * pose[SIN]
    side, aside = (1.0 if aside > 0.0 else -1.0), abs(aside)
    last, is_open, is_clear = path.shape[0] - 1, False, False
    # the shortest, and the widest arc: at full lock the tail swings out farther
    widest = 0.999 * (ahead * ahead + aside * aside) / max(2.0 * aside, 1e-3)
    for curve in (radius, max(widest, radius)):
        before, arc, tangent = arc_and_tangent(ahead, aside, curve)
        if is_open or before > 0.0 or (curve > radius and ahead < aside):
            break
        bend, tangent = side / curve, max(tangent - point[2], 0.0)
        spacing = max(arc + min(tangent, max(reaches[0], reaches[1])), 1e-6) / last
        for k in range(1, last + 1):
            way = spacing * k
            _move(path, k, bend, sense * min(way, arc))
            if way > arc:
                path[k, X] += sense * (way - arc) * path[k, COS]
                path[k, Y] += sense * (way - arc) * path[k, SIN]
        pace = spacing * (1.0 + body.radius / curve)
        end = min(int(np.ceil((arc + min(tangent, reaches[0])) / spacing)), last)
        is_open, is_clear = _is_free(path, end, body, pace, margin, floor, box), True
        if is_open and (arc > _LEAST_ARC * radius or reaches[1] > radius):
            end = min(int(np.ceil((arc + min(tangent, reaches[1])) / spacing)), last)
            is_clear = _is_clear(path, end, body, pace, margin, agents, standing)
    return is_open, is_clear, sense > 0.0


@borrowing
def _left_without_walls(pose: Floats, point: _Point, radius: float) -> float:
    """Return the way [m] from a pose to a point, forward if it goes on there, else the shorter."""
    forward, back = ways_left(pose[X], pose[Y], pose[YAW], point[0], point[1], radius)
    return float(forward if point[2] > 0.0 else min(forward, back))


@borrowing
def _meaning(option: int, radius: float) -> tuple[int, float]:
    """Return the gear and the curvature [1/m] of a step."""
    return 1 - 2 * (option // 3), (option % 3 - 1) / radius


@owning
def _find_manoeuvre(
    path: Floats,
    point: _Point,
    reaches: tuple[float, float],
    radius: float,
    gear: int,
    body: Any,
    floor: ClearanceLayer,
    box: Floats,
    agents: AgentArrays,
    standing: Integers,
) -> tuple[int, int]:
    """Return the cheapest manoeuvre from pose 0: how many steps, and their digits, the first last.

    If none is found, one that leads as near as any can, where that is a turning radius or more
    (three, among those that stand: they may leave); or no steps. A node is a pose that a step leads
    to; its total is the cost so far, and the way that would be left without walls.
    """
    start_x, start_y, step = path[0, X], path[0, Y], _STEP * radius
    poses, bends = np.empty((_MOST_NODES, 6)), np.zeros(_MOST_NODES)
    costs, totals = np.zeros(_MOST_NODES), np.zeros(_MOST_NODES)
    parents, gears = np.zeros(_MOST_NODES, np.int64), np.zeros(_MOST_NODES, np.int64)
    options = np.zeros(_MOST_NODES, np.int64)
    least = np.full((2, _YAWS, _CELLS, _CELLS), np.inf)
    _copy(poses, 0, path, 0)
    gears[0], n, count, manoeuvre = gear, 0, 1, 0
    lefts = np.full(_MOST_NODES, np.inf)
    worth = _WORTH if standing.shape[0] == 0 else _WORTH_AMONG
    lefts[0] = _left_without_walls(path[0], point, radius) - worth * radius
    while True:
        is_open, is_clear, _ = _is_open(
            path, point, reaches, radius, _MARGIN_M, body, floor, box, agents, standing
        )
        if n > 0 and is_open and is_clear:
            break
        for option in range(6):
            sense, bend = _meaning(option, radius)
            for k in range(1, LEG_POSES + 1):
                _move(path, k, bend, sense * step * k / LEG_POSES)
            end = path[LEG_POSES]
            col = int(np.floor((end[X] - start_x) / (_CELL * radius))) + _CELLS // 2
            row = int(np.floor((end[Y] - start_y) / (_CELL * radius))) + _CELLS // 2
            turn = int(np.floor(end[YAW] * (_YAWS / (2.0 * np.pi)))) % _YAWS
            if not (0 <= col < _CELLS and 0 <= row < _CELLS):
                continue
            cost = costs[n] + step * (1.0 if sense > 0 else REVERSE_PRICE)
            cost += _SHUNT * radius if sense * gears[n] < 0 else 0.0
            cost += _STEER * radius if bend != bends[n] else 0.0
            pace = step / LEG_POSES * (1.0 + body.radius / radius)
            if (
                cost >= least[option // 3, turn, row, col] - 1e-9
                or not _is_free(path, LEG_POSES, body, pace, _MARGIN_M, floor, box)
                or not _is_clear(path, LEG_POSES, body, pace, _MARGIN_M, agents, standing)
            ):
                continue
            least[option // 3, turn, row, col] = cost
            lefts[count] = _left_without_walls(end, point, radius)
            costs[count], totals[count], parents[count] = cost, cost + lefts[count], n
            _copy(poses, count, path, LEG_POSES)
            gears[count], bends[count], options[count] = sense, bend, option
            count += 1
        totals[n] = np.inf
        n = int(np.argmin(totals[:count]))
        if totals[n] == np.inf or count + 6 > _MOST_NODES:
            n = int(np.argmin(lefts[:count]))
            break
        _copy(path, 0, poses, n)
    _copy(path, 0, poses, 0)
    steps = 0
    while n > 0:  # from the last to the first, which is the last digit
        manoeuvre = manoeuvre % (_DIGITS // 6) * 6 + options[n]
        steps, n = steps + 1, parents[n]
    return min(steps, _MOST_STEPS), manoeuvre


@borrowing
def _left_of(pose: Floats, memory: Any, leg: int) -> float:
    """Return how much of its leg a vehicle has before it [m]; `_OFF` if it is off it."""
    dx, dy = memory.leg_x - pose[X], memory.leg_y - pose[Y]
    ahead, aside = dx * pose[COS] + dy * pose[SIN], dy * pose[COS] - dx * pose[SIN]
    if memory.leg_bend == 0.0:
        return float(leg * ahead) if abs(aside) < _OFF_M else _OFF
    turn = wrapped(memory.leg_yaw - pose[YAW])
    x, y = np.sin(turn) / memory.leg_bend, (1.0 - np.cos(turn)) / memory.leg_bend
    if abs(x - ahead) > _OFF_M or abs(y - aside) > _OFF_M:
        return _OFF
    return float(leg * turn / memory.leg_bend)


@borrowing
def begin_leg(
    agents: AgentArrays,
    i: int,
    aim: PlanningGoal,
    pose: Floats,
    now: int,
    timing: PlannerTiming,
    floor: ClearanceLayer,
    workspace: Workspace,
) -> tuple[float, bool]:
    """Return how much [m] is left of the leg that vehicle i has to drive, 0 if it has none.

    Then whether it may go back without one: not where its way is open and leads forward, unless
    others have blocked it for long, and not while those that stand leave it no manoeuvre. Pose 0 of
    both scratch paths is that of the vehicle.
    """
    memory, command, body = agents.memory[i], agents.command[i], agents.body[i]
    box, radius, path = workspace.box, TIGHTEST * body.turn_radius, workspace.paths[1]
    leg, memory.leg = memory.leg, 0
    if aim.kind != GOING:
        return 0.0, True
    point = point_ahead(pose, command, memory, radius)
    dx, dy = point[0] - pose[X], point[1] - pose[Y]
    heading, away = math.atan2(dy, dx), np.sqrt(dx * dx + dy * dy)
    # a way that ends here is looked at to its end, another one goes on
    is_end = command.stops == 1 or memory.passed_at != NEVER
    reach = away if is_end and away < _CELLS * _CELL * radius else radius
    standing, again = workspace.standing, _AGAIN_S * timing.second
    standing = standing[: _find_standing(agents, i, now, pose, _AMONG * radius, standing)]
    waits = memory.obstruction == BY_ARTEFACT and memory.blocked > _PATIENCE_S
    reaches = reach, _AMONG_REACH * radius if waits or leg != 0 else _PAST_ARC * radius
    is_open, is_clear, leads_ahead = _is_open(
        path, point, reaches, radius, 0.0, body, floor, box, agents, standing
    )
    left, is_elsewhere = 0.0, abs(wrapped(heading - memory.leg_heading)) > _TURNED
    is_held = memory.obstruction == BY_ARTEFACT and memory.blocked > BACKS_OFF_AFTER
    is_over = is_elsewhere or (is_held and now >= memory.leg_search + again)
    if leg != 0 and not (leg > 0 and is_open and is_clear):
        left = _left_of(pose, memory, leg)
        if left > _LEAST_LEFT * radius and not is_over:
            memory.leg = leg
            return left, False
    if is_open and is_clear:
        memory.is_boxed_in = 0
        return 0.0, not leads_ahead or memory.blocked >= BACKS_OFF_AFTER
    if leg == 0 or memory.steps == 0 or left == _OFF or is_over:
        if now < memory.leg_search:
            return 0.0, memory.is_boxed_in == 0
        memory.leg_search, memory.leg_heading = now, heading
        search = path, point, reaches, radius, memory.gear, body, floor, box, agents
        _plan_manoeuvre(memory, search, standing, is_open)
        if memory.steps == 0:
            memory.leg_search = now + again
            return 0.0, memory.is_boxed_in == 0
    return _next_leg(path, memory, radius), False


@borrowing
def _plan_manoeuvre(memory: Any, search: _Search, standing: Integers, is_open: bool) -> None:
    """Write the cheapest manoeuvre among rows that stand, and whether it is these that leave none.

    Walls are not the reason if they leave the way open.
    """
    memory.steps, memory.manoeuvre = _find_manoeuvre(*search, standing)
    memory.is_boxed_in = memory.steps == 0 and standing.shape[0] > 0
    if memory.is_boxed_in and not is_open:
        memory.is_boxed_in = _find_manoeuvre(*search, standing[:0])[0] > 0


@borrowing
def _next_leg(path: Floats, memory: Any, radius: float) -> float:
    """Begin the next leg of a manoeuvre at pose 0 of a path; return its length [m]."""
    option, count = memory.manoeuvre % 6, 0
    while memory.steps > 0 and memory.manoeuvre % 6 == option:
        memory.manoeuvre, memory.steps, count = memory.manoeuvre // 6, memory.steps - 1, count + 1
    gear, bend = _meaning(option, radius)
    left = count * _STEP * radius
    _move(path, 1, bend, gear * left)
    memory.leg, memory.leg_bend, memory.credit = gear, bend, max(memory.credit, 0.0)
    memory.leg_x, memory.leg_y, memory.leg_yaw = path[1, X], path[1, Y], path[1, YAW]
    return float(left)


@borrowing
def leg_options(
    options: Floats, memory: Any, aim: PlanningGoal, left: float, body: Any, workspace: Workspace
) -> int:
    """Write the primitives that drive what is left of a leg; return how many there are."""
    radius, path, count = TIGHTEST * body.turn_radius, workspace.paths[1], 0
    _move(path, 1, memory.leg_bend, memory.leg * min(left, _MOST_LEFT * radius))
    workspace.goal[0], workspace.goal[1] = path[1, X], path[1, Y]
    share = memory.leg if memory.leg > 0 else memory.leg * REVERSE_SHARE
    for factor in FORWARD:
        speed = factor * share * aim.speed
        count = set_option(
            options, count, ARC_TO_POINT, memory.leg_bend, speed, 1.0 - factor, np.nan
        )
    return set_option(options, count, BRAKE, memory.leg_bend, 0.0, aim.stop_cost, np.nan)
