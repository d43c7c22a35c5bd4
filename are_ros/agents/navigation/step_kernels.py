"""The next step along a route, among the other agents: one compiled call for each decision."""

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, compiled
from are_ros.agents.mdp.routes import action_values, best_action, follow
from are_ros.agents.navigation.ground import Ground, cell_of, heading_of
from are_ros.agents.navigation.local_way import way_round
from are_ros.agents.navigation.terrain import farthest, rolls
from are_ros.agents.neighbours import Cells, find_near

Floats = npt.NDArray[np.float64]

FADE_M: Final = 1.0
"""Over this length the cost of another agent falls from its whole weight to 0."""

MINDED_M: Final = 3.0
"""An agent farther away than this costs nothing."""

THERE_M: Final = 0.15
"""Within this distance a waypoint counts as reached."""

STRAIGHT_M: Final = 3.0
"""A visible goal no farther away than this is approached straight, without the values."""

NO_WAY, WAITS, GOES, STRAIGHT = range(4)


class ValueArrays(NamedTuple):
    """The arrays of a value table."""

    planes: npt.NDArray[np.float32]
    lengths: npt.NDArray[np.uint8]
    gains: npt.NDArray[np.float32]
    costs: npt.NDArray[np.float32]
    weights: Floats


class GoalSpec(NamedTuple):
    """An agent's radius, its goal, and where the values end, which may be beside the goal.

    Then the cost per epoch of being near others, and near the robot.
    """

    radius_m: float
    goal_m: tuple[float, float]
    end_m: tuple[float, float]
    others_price: float
    robot_price: float


class Crowd(NamedTuple):
    """Everybody: points by cell; poses (N, 4), x, y, z, yaw; speeds (N,) along it; radii (N,)."""

    cells: Cells
    poses: Floats
    speeds_mps: Floats
    radii_m: Floats


# Plain tuples go into compiled code in a third of the time that named ones take, so they are named
# inside.
GroundArrays = tuple[Any, ...]
ValueTuple = tuple[Any, ...]
CrowdArrays = tuple[Any, ...]
GoalSpecArrays = tuple[float, tuple[float, float], tuple[float, float], float, float]
GoalArrays = tuple[GroundArrays, ValueTuple, GoalSpecArrays]
"""The fields of `Ground`, `ValueArrays` and `GoalSpec`."""


class NeighbourQuery(NamedTuple):
    """The neighbours in the lookahead; `me` is the own index, -1 for none.

    They are where their velocity takes them in `ahead_s`. Being near one of them costs `price` per
    epoch; being near the robot, within a distance of a point, `robot_price` (0: no robot).
    """

    me: int
    ahead_s: float
    price: float
    robot_x_m: float
    robot_y_m: float
    robot_within_m: float
    robot_price: float


class Scratch(NamedTuple):
    """Scratch for the neighbours in a crowd of N: indices (N,), squared distances (N,), (N + 1, 5).

    And for the values of actions, (9,).
    """

    found: npt.NDArray[np.int64]
    squares: Floats
    moving: Floats
    brings: Floats


@borrowing
def find_others(
    crowd: Crowd, query: NeighbourQuery, x_m: float, y_m: float, radius_m: float, scratch: Scratch
) -> int:
    """Write the neighbours of a point to the scratch, `moving`; return how many they are."""
    near, moving, count = 0, scratch.moving, 0
    if query.me >= 0:
        near = find_near(crowd.cells, x_m, y_m, MINDED_M, scratch.found, scratch.squares)
    for n in range(near):
        i = scratch.found[n]
        if i == query.me:
            continue
        way_m = query.ahead_s * crowd.speeds_mps[i]
        moving[count, 0] = crowd.poses[i, 0] + way_m * np.cos(crowd.poses[i, 3])
        moving[count, 1] = crowd.poses[i, 1] + way_m * np.sin(crowd.poses[i, 3])
        moving[count, 2] = crowd.radii_m[i] + radius_m
        moving[count, 3], moving[count, 4] = FADE_M, query.price
        count += 1
    if query.robot_price > 0.0:
        moving[count, 0], moving[count, 1] = query.robot_x_m, query.robot_y_m
        moving[count, 2] = query.robot_within_m
        moving[count, 3], moving[count, 4] = FADE_M, query.robot_price
        count += 1
    return count


@compiled
def route_step(
    ground: GroundArrays,
    value_arrays: ValueTuple,
    ends: GoalSpecArrays,
    crowd: CrowdArrays,
    robot: tuple[float, float, float, float],
    agent: tuple[int, bool, int],
    is_moving_goal: bool,
    way_m: Floats,
) -> tuple[int, int, float, float, bool]:
    """Find the next step of an agent with a goal, and fill in the way (K, 2) that it follows.

    `ground`, `value_arrays` and `ends` are the fields of `Ground`, `ValueArrays` and `GoalSpec`,
    `crowd` those of `Cells` and the rest of `Crowd`. `robot` is the lookahead [s], the robot's
    place then, and its radius, which is negative without a robot. `agent` is the index in the
    crowd, whether others cost it anything, and the epochs left. A moving goal is approached
    straight from any distance. Returns what to do (no way, waiting for others, going, straight to
    the goal), how many points the way has, the farthest of them that a disc can roll straight to,
    and whether that is the end.
    """
    floor, values, going = Ground(*ground), ValueArrays(*value_arrays), GoalSpec(*ends)
    everybody = Crowd(Cells(*crowd[:8]), crowd[8], crowd[9], crowd[10])
    size = everybody.poses.shape[0]
    index, is_patient, epochs_left = agent
    x_m, y_m = everybody.poses[index, 0], everybody.poses[index, 1]
    away_m = np.hypot(going.goal_m[0] - x_m, going.goal_m[1] - y_m)
    if (is_moving_goal or away_m <= STRAIGHT_M) and rolls(
        floor.clearance_m, floor.lattice, (x_m, y_m), going.goal_m, going.radius_m
    ):
        return STRAIGHT, 0, going.goal_m[0], going.goal_m[1], True
    query = NeighbourQuery(
        index if is_patient else -1,
        robot[0],
        going.others_price,
        robot[1],
        robot[2],
        robot[3] + going.radius_m,
        going.robot_price if is_patient and robot[3] >= 0.0 else 0.0,
    )
    pose = (x_m, y_m, everybody.poses[index, 3], going.radius_m)
    found, squares, moving = np.empty(size, np.int64), np.empty(size), np.empty((size + 1, 5))
    scratch = Scratch(found, squares, moving, np.empty(9))
    return _find_step(
        floor, values, everybody, query, pose, epochs_left, going.end_m, way_m, scratch
    )


@borrowing
def _find_step(
    ground: Ground,
    value_arrays: ValueArrays,
    crowd: Crowd,
    query: NeighbourQuery,
    me: tuple[float, float, float, float],
    epochs_left: int,
    goal_m: tuple[float, float],
    way_m: Floats,
    scratch: Scratch,
) -> tuple[int, int, float, float, bool]:
    """Take the best action at a pose, and fill in the way (K, 2) that follows it."""
    row, col = cell_of(ground, me[0], me[1])
    row, col = row - int(value_arrays.weights[5]), col - int(value_arrays.weights[6])
    height, width = value_arrays.costs.shape
    if not (0 <= row < height and 0 <= col < width) or value_arrays.costs[row, col] == np.inf:
        return NO_WAY, 0, 0.0, 0.0, False
    state = row, col, heading_of(ground.lattice, me[2])
    others = find_others(crowd, query, me[0], me[1], me[3], scratch)
    values = value_arrays.planes[max(0, min(epochs_left, value_arrays.planes.shape[0]) - 1)]
    arrays = (value_arrays.lengths, value_arrays.gains, value_arrays.weights, ground.anchors_m)
    action_values(values, *arrays, scratch.moving[:others], state, scratch.brings)
    action = best_action(scratch.brings, state[2])
    here_m, weights = (me[0], me[1]), value_arrays.weights
    is_there = state[0] == weights[7] and state[1] == weights[8]
    if is_there or (
        action > 0 and rolls(ground.clearance_m, ground.lattice, here_m, goal_m, me[3])
    ):
        way_m[0, 0], way_m[0, 1] = goal_m
        return GOES, 1, goal_m[0], goal_m[1], True
    no_others = scratch.moving[:0]
    count, _ = follow(value_arrays.planes, *arrays, state, action, way_m, scratch.brings, no_others)
    if count == 0:
        return NO_WAY, 0, 0.0, 0.0, False
    end_m = ground.anchors_m[int(weights[5] + weights[7]), int(weights[6] + weights[8])]
    if way_m[count - 1, 0] == end_m[0] and way_m[count - 1, 1] == end_m[1]:
        way_m[count - 1, 0], way_m[count - 1, 1] = goal_m
    if action == 0:
        return WAITS, count, 0.0, 0.0, False
    aim = farthest(ground.clearance_m, ground.lattice, here_m, way_m[:count], me[3])
    first_m = (way_m[0, 0], way_m[0, 1])
    is_reached = np.hypot(first_m[0] - me[0], first_m[1] - me[1]) < THERE_M and count > 1
    if aim == 0 and (
        is_reached or not rolls(ground.clearance_m, ground.lattice, here_m, first_m, me[3])
    ):
        x_m, y_m, _ = way_round(ground, here_m, way_m[:count], me[3])
        return GOES, count, x_m, y_m, x_m == goal_m[0] and y_m == goal_m[1]
    is_end = way_m[aim, 0] == goal_m[0] and way_m[aim, 1] == goal_m[1]
    return GOES, count, way_m[aim, 0], way_m[aim, 1], is_end
