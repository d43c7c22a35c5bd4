"""What the actions of an agent are worth among the others, and the way of one, compiled."""

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, compiled
from are_ros.agents.mdp.coarse_kernels import COL_STEPS, ROW_STEPS
from are_ros.agents.mdp.routes import (
    AHEAD,
    ValueArrays,
    ValueTuple,
    action_values,
    best_action,
    follow,
    is_settled,
    leave_out,
)
from are_ros.agents.navigation.ground import Ground, cell_of, fine_cell, heading_of
from are_ros.agents.navigation.local_way import way_round
from are_ros.agents.navigation.terrain import cell_centre, farthest, rolls
from are_ros.agents.neighbours import CellArrays, find_near

Floats = npt.NDArray[np.float64]

FADE_M: Final = 1.0
"""Over this length the cost of another agent falls from its whole weight to 0."""

MINDED_M: Final = 5.0
"""An agent farther away than this costs nothing."""

THERE_M: Final = 0.15
"""Within this distance a waypoint counts as reached."""

STRAIGHT_M: Final = 3.0
"""A visible goal no farther away than this is approached straight, without the values."""

NO_WAY, STRAIGHT, CHOOSES, UNKNOWN = range(4)

_NOWHERE_M: Final = (math.nan, math.nan)


class GoalSpec(NamedTuple):
    """An agent's radius, its goal, and where the values end, which may be beside the goal.

    Then the cost per epoch of being near others, and near the robot, and whether it has a turning
    circle.
    """

    radius_m: float
    goal_m: tuple[float, float]
    end_m: tuple[float, float]
    others_price: float
    robot_price: float
    drives: bool


class Crowd(NamedTuple):
    """Everybody: points by cell; poses (N, 4), x, y, z, yaw; radii (N,).

    `ahead_m` (N, AHEAD, 2) is where each will be at the end of the next epochs.
    """

    cells: CellArrays
    poses: Floats
    ahead_m: Floats
    radii_m: Floats


# Plain tuples go into compiled code in a third of the time that named ones take, so they are named
# inside.
GroundArrays = tuple[Any, ...]
CrowdArrays = tuple[Any, ...]
GoalSpecArrays = tuple[float, tuple[float, float], tuple[float, float], float, float, bool]
GoalArrays = tuple[GroundArrays, ValueTuple, GoalSpecArrays]
"""The fields of `Ground`, `ValueArrays` and `GoalSpec`."""


Robot = tuple[Floats, float]
"""Where the robot will be at the end of the next epochs (AHEAD, 2) [m], and its radius [m].

The radius is negative without one.
"""


@compiled
def prospect_of(
    crowd: CrowdArrays,
    robot: Robot,
    agent: tuple[int, bool, int],
    is_moving_goal: bool,
    brings: Floats,
    ground: GroundArrays,
    value_arrays: ValueTuple,
    ends: GoalSpecArrays,
) -> tuple[int, int, float, float]:
    """Fill in what the actions of an agent with a goal are worth, (P, 5): pace, move.

    What resting saves does not count for staying; -inf is a move that is not made (`leave_out`).
    `ground`, `value_arrays` and `ends` are the fields of `Ground`, `ValueArrays` and `GoalSpec`,
    `crowd` those of `neighbours.Cells` and the rest of `Crowd`. `agent` is the index in the crowd,
    whether others cost it anything, and the epochs left. A moving goal is approached straight from
    any distance. Returns what there is (no way, straight to the goal, a choice, or that the planes
    of all epochs are needed), the heading, and the values of the state now and with an epoch less,
    both without the others.
    """
    floor, values, going = Ground(*ground), ValueArrays(*value_arrays), GoalSpec(*ends)
    everybody = Crowd(crowd[:8], crowd[8], crowd[9], crowd[10])
    index, is_patient, epochs_left = agent
    x_m, y_m = everybody.poses[index, 0], everybody.poses[index, 1]
    away_m = np.hypot(going.goal_m[0] - x_m, going.goal_m[1] - y_m)
    if (is_moving_goal or away_m <= STRAIGHT_M) and rolls(
        floor.clearance_m, floor.lattice, (x_m, y_m), going.goal_m, going.radius_m
    ):
        return STRAIGHT, 0, 0.0, 0.0
    state = _state_of(floor, values, (x_m, y_m, everybody.poses[index, 3]))
    if state[0] < 0:
        return NO_WAY, 0, 0.0, 0.0
    if state[0] == values.goal[0] and state[1] == values.goal[1]:
        return STRAIGHT, 0, 0.0, 0.0
    others = find_others(everybody, robot, index, is_patient, going)
    others = others[: min(AHEAD, epochs_left)]
    if not is_settled(values, state[0], state[1], epochs_left, others.shape[0]):
        return UNKNOWN, 0, 0.0, 0.0
    nobody = others[:, :0].copy()
    later = action_values(values, epochs_left, floor.anchors_m, nobody, state, brings)
    value = brings.max()
    if others.shape[1] > 0:
        best = best_action(brings, state[2])
        action_values(values, epochs_left, floor.anchors_m, others, state, brings)
        if not going.drives:
            leave_out(values, floor.anchors_m, others[0], state, best[1], brings)
    for pace in range(brings.shape[0]):  # an agent that stays here gives way, and does not rest
        brings[pace, 0] -= values.prices[2]
    return CHOOSES, state[2], value, later


@borrowing
def _state_of(
    ground: Ground, values: ValueArrays, pose: tuple[float, float, float]
) -> tuple[int, int, int]:
    """Return row, column and heading of a pose in a table's window; -1 where it has no values."""
    row, col = cell_of(ground, pose[0], pose[1])
    row, col = row - values.corner[0], col - values.corner[1]
    height, width = values.costs.shape
    if not (0 <= row < height and 0 <= col < width) or values.costs[row, col] == np.inf:
        return -1, -1, -1
    return row, col, heading_of(ground.lattice, pose[2])


@compiled
def find_others(crowd: Crowd, robot: Robot, me: int, is_patient: bool, going: GoalSpec) -> Floats:
    """Return where others are in each epoch ahead, (AHEAD, M, 5), as `action_values` takes them.

    The robot comes last. An agent that is not patient minds nobody.
    """
    size, near, count = crowd.poses.shape[0], 0, 0
    found, squares = np.empty(size, np.int64), np.empty(size)
    if is_patient:
        here = crowd.poses[me]
        near = find_near(crowd.cells, here[0], here[1], MINDED_M, found, squares)
    others = np.empty((AHEAD, near + 1, 5))
    minds_robot = is_patient and robot[1] >= 0.0 and going.robot_price > 0.0
    for n in range(near + 1):
        if n < near:
            i = found[n]
            if i == me:
                continue
            ahead_m, radius_m, price = crowd.ahead_m[i], crowd.radii_m[i], going.others_price
        elif minds_robot:
            ahead_m, radius_m, price = robot[0], robot[1], going.robot_price
        else:
            break
        for k in range(AHEAD):
            others[k, count, 0], others[k, count, 1] = ahead_m[k, 0], ahead_m[k, 1]
            others[k, count, 2], others[k, count, 3] = radius_m + going.radius_m, FADE_M
            others[k, count, 4] = price
        count += 1
    found_others: Floats = others[:, :count].copy()
    return found_others


@compiled
def way_along(
    ground: GroundArrays,
    value_arrays: ValueTuple,
    ends: GoalSpecArrays,
    pose: tuple[float, float, float],
    action: tuple[int, int],
    way_m: Floats,
) -> tuple[int, tuple[float, float], bool, tuple[float, float]]:
    """Fill in the way (K, 2) that an action leads along, and then the cheapest way.

    `pose` is x, y and yaw; `action` a pace and a move, not staying in the goal's cell. Returns how
    many points the way has, the farthest of them that a disc can roll straight to, and whether one
    stops there: at the end, and where the way turns back from the move. What comes after that does
    not count. The last point is the farthest that the disc can roll to from there; nan if one stops
    there, or does not get there before the next decision. A vehicle, whose turns take more room
    than a cell, is told the way on from the move wherever it leads, and always what comes next.
    """
    floor, values, going = Ground(*ground), ValueArrays(*value_arrays), GoalSpec(*ends)
    state, here_m = _state_of(floor, values, pose), (pose[0], pose[1])
    radius_m, lattice = going.radius_m, floor.lattice
    if (
        action[1] > 0
        and (going.drives or _is_ahead(floor, state, values, action[1], going.end_m))
        and rolls(floor.clearance_m, lattice, here_m, going.end_m, radius_m)
    ):
        way_m[0, 0], way_m[0, 1] = going.end_m
        return 1, going.end_m, True, _NOWHERE_M
    anchors_m = floor.anchors_m
    count = follow(values, anchors_m, state, action, way_m)
    if count == 0:
        return 0, here_m, False, _NOWHERE_M
    end_m = anchors_m[values.corner[0] + values.goal[0], values.corner[1] + values.goal[1]]
    if way_m[count - 1, 0] == end_m[0] and way_m[count - 1, 1] == end_m[1]:
        way_m[count - 1, 0], way_m[count - 1, 1] = going.end_m
    ahead = count
    if action[1] > 0 and not going.drives:
        ahead = 1
        while ahead < count and _is_ahead(
            floor, state, values, action[1], (way_m[ahead, 0], way_m[ahead, 1])
        ):
            ahead += 1
    first_m, rest_m = (way_m[0, 0], way_m[0, 1]), way_m[:ahead]
    is_reached = np.hypot(first_m[0] - pose[0], first_m[1] - pose[1]) < THERE_M and ahead > 1
    point_m, seen = _first_corner(floor, here_m, rest_m, is_reached, radius_m)
    is_end = point_m[0] == going.end_m[0] and point_m[1] == going.end_m[1]
    stops = is_end or (ahead < count and seen == ahead)
    beyond_m, reach = _NOWHERE_M, (values.paces[action[0], 0] + 1.0) * floor.side * lattice[4]
    is_near = np.hypot(point_m[0] - pose[0], point_m[1] - pose[1]) < reach
    if (is_near or going.drives) and not stops and seen < ahead:
        beyond_m, _ = _first_corner(floor, point_m, rest_m[seen:], False, radius_m)
    return count, point_m, stops, beyond_m


@compiled
def _first_corner(
    ground: Ground, from_m: tuple[float, float], way_m: Floats, is_reached: bool, radius_m: float
) -> tuple[tuple[float, float], int]:
    """Return the farthest point of a way that a disc can roll straight to, or one on the way there.

    Then how many points of the way lie up to it. The first one does not count if it `is_reached`.
    """
    seen = farthest(ground.clearance_m, ground.lattice, from_m, way_m, radius_m)
    if seen == 0 and (
        is_reached
        or not rolls(
            ground.clearance_m, ground.lattice, from_m, (way_m[0, 0], way_m[0, 1]), radius_m
        )
    ):
        x_m, y_m, _ = way_round(ground, from_m, way_m, radius_m)
        return (x_m, y_m), 0
    return (way_m[seen, 0], way_m[seen, 1]), seen + 1


@compiled
def slipped_along(
    ground: GroundArrays,
    value_arrays: ValueTuple,
    ends: GoalSpecArrays,
    pose: tuple[float, float, float],
    action: tuple[int, int],
) -> tuple[bool, float, float]:
    """Return whether a move that has slipped aside has room, and the point that it leads to.

    `pose` and `action` as in `way_along`, but not to stay. It leads on in its direction as far as
    its pace reaches, or to where the move ends if walls are in between. The way on from there does
    not count: a person would cut the corner, and hardly leave the way from which it slips.
    """
    floor, values, going = Ground(*ground), ValueArrays(*value_arrays), GoalSpec(*ends)
    (row, col, _), here_m, direction = _state_of(floor, values, pose), pose[:2], action[1] - 1
    reach = int(values.paces[action[0], 0])
    length = min(reach, int(values.lengths[direction, row, col]))
    if length == 0:
        return False, here_m[0], here_m[1]
    rows, cols, lattice = ROW_STEPS[direction], COL_STEPS[direction], floor.lattice
    start, cells = fine_cell(lattice, here_m), reach * floor.side
    point_m = cell_centre(lattice, start[0] + cells * rows, start[1] + cells * cols)
    if rolls(floor.clearance_m, lattice, here_m, point_m, going.radius_m):
        return True, point_m[0], point_m[1]
    row, col = row + values.corner[0] + length * rows, col + values.corner[1] + length * cols
    return True, floor.anchors_m[row, col, 0], floor.anchors_m[row, col, 1]


@borrowing
def _is_ahead(
    ground: Ground,
    state: tuple[int, int, int],
    values: ValueArrays,
    move: int,
    point_m: tuple[float, float],
) -> bool:
    """Tell whether the cell of a point is one or more ahead, in the direction of a move."""
    row, col = fine_cell(ground.lattice, point_m)
    rows = row // ground.side - state[0] - values.corner[0]
    cols = col // ground.side - state[1] - values.corner[1]
    return rows * ROW_STEPS[move - 1] + cols * COL_STEPS[move - 1] > 0
