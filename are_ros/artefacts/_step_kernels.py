"""Compiled step of a route: from where one is to what to do next, among the others."""

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.artefacts._ground_kernels import Ground, cell_of, heading_of
from are_ros.artefacts._local_way import way_round
from are_ros.artefacts._route_kernels import greedy_way, look_ahead
from are_ros.artefacts.neighbourhood import Cells, near
from are_ros.artefacts.terrain import farthest, rolls

Floats = npt.NDArray[np.float64]

FADE_M: Final = 1.0
"""Over this length what somebody else costs falls from its whole weight to nothing."""

MINDED_M: Final = 3.0
"""Who is farther away than this is not minded."""

THERE_M: Final = 0.15
"""Who is so near to the first point of its way goes on to the next, round a corner if need be."""

NO_WAY, WAITS, GOES = range(3)


class Worth(NamedTuple):
    """The arrays of a value table."""

    planes: npt.NDArray[np.float32]
    lengths: npt.NDArray[np.uint8]
    gains: npt.NDArray[np.float32]
    costs: npt.NDArray[np.float32]
    weights: Floats


class Crowd(NamedTuple):
    """Everybody: points by cell; poses (N, 4), x, y, z, yaw; speeds (N,) along it; radii (N,)."""

    cells: Cells
    poses: Floats
    speeds_mps: Floats
    radii_m: Floats


# Plain tuples go into compiled code in a third of the time that named ones take, so they are named
# inside.
GroundArrays = tuple[Any, ...]
WorthArrays = tuple[Any, ...]
CrowdArrays = tuple[Any, ...]


class Minded(NamedTuple):
    """Whom one minds: the others, if `me` is not -1, which is one's own index among them.

    They are where their velocity takes them in `ahead_s`. Being near one of them costs `price` an
    epoch; being near the robot, at a point within a distance, what it costs (0: there is none).
    """

    me: int
    ahead_s: float
    price: float
    robot_x_m: float
    robot_y_m: float
    robot_within_m: float
    robot_price: float


@compiled
def others_about(crowd: Crowd, minded: Minded, x_m: float, y_m: float, radius_m: float) -> Floats:
    """Return who is minded about a point, (M, 5) as `action_values` takes them; nearest first."""
    found = np.empty(0, np.int64)
    if minded.me >= 0:
        found = near(crowd.cells, x_m, y_m, MINDED_M)
    moving, count = np.empty((found.shape[0] + 1, 5)), 0
    for i in found:
        if i == minded.me:
            continue
        way_m = minded.ahead_s * crowd.speeds_mps[i]
        moving[count, 0] = crowd.poses[i, 0] + way_m * np.cos(crowd.poses[i, 3])
        moving[count, 1] = crowd.poses[i, 1] + way_m * np.sin(crowd.poses[i, 3])
        moving[count, 2] = crowd.radii_m[i] + radius_m
        moving[count, 3], moving[count, 4] = FADE_M, minded.price
        count += 1
    if minded.robot_price > 0.0:
        moving[count, 0], moving[count, 1] = minded.robot_x_m, minded.robot_y_m
        moving[count, 2] = minded.robot_within_m
        moving[count, 3], moving[count, 4] = FADE_M, minded.robot_price
        count += 1
    return moving[:count]


@compiled
def route_step(
    ground: GroundArrays,
    worth: WorthArrays,
    crowd: CrowdArrays,
    minded: tuple[int, float, float, float, float, float, float],
    me: tuple[float, float, float, float],
    epochs_left: int,
    goal_m: tuple[float, float],
    way_m: Floats,
) -> tuple[int, int, float, float, bool]:
    """Take the best action at a pose, and fill in the way (K, 2) that follows it.

    `ground`, `worth` and `minded` are the fields of `Ground`, `Worth` and `Minded`, `crowd` those
    of `Cells` and the rest of `Crowd`; `me` is x, y, yaw and radius. Returns what that is (no way,
    waiting for others, going), how many points the way has, the farthest of them that a disc can
    roll straight to, and whether that is `goal_m`, the end.
    """
    floor, values, others = Ground(*ground), Worth(*worth), Minded(*minded)
    everybody = Crowd(Cells(*crowd[:8]), crowd[8], crowd[9], crowd[10])
    state = _state(floor, values, me)
    if state[0] < 0:
        return NO_WAY, 0, 0.0, 0.0, False
    weights = values.weights
    if state[0] == weights[7] and state[1] == weights[8]:
        way_m[0, 0], way_m[0, 1] = goal_m
        return GOES, 1, goal_m[0], goal_m[1], True
    moving = others_about(everybody, others, me[0], me[1], me[3])
    action = _action(floor, values, moving, epochs_left, state)
    count = _way(floor, values, state, action, goal_m, way_m)
    if count == 0:
        return NO_WAY, 0, 0.0, 0.0, False
    if action == 0:
        return WAITS, count, 0.0, 0.0, False
    aim = farthest(floor.clearance_m, floor.lattice, (me[0], me[1]), way_m[:count], me[3])
    if aim == 0 and not _is_seen(floor, me, way_m[:count]):
        x_m, y_m, _ = way_round(floor, (me[0], me[1]), way_m[:count], me[3])
        return GOES, count, x_m, y_m, x_m == goal_m[0] and y_m == goal_m[1]
    is_end = way_m[aim, 0] == goal_m[0] and way_m[aim, 1] == goal_m[1]
    return GOES, count, way_m[aim, 0], way_m[aim, 1], is_end


@compiled
def _is_seen(ground: Ground, me: tuple[float, float, float, float], way_m: Floats) -> bool:
    """Tell whether the first point of a way is rolled to straight, and still to be gone to."""
    is_there = np.hypot(way_m[0, 0] - me[0], way_m[0, 1] - me[1]) < THERE_M
    if is_there and way_m.shape[0] > 1:
        return False
    point_m = (way_m[0, 0], way_m[0, 1])
    return rolls(ground.clearance_m, ground.lattice, (me[0], me[1]), point_m, me[3])


@compiled
def _state(
    ground: Ground, worth: Worth, me: tuple[float, float, float, float]
) -> tuple[int, int, int]:
    """Return row and column in the table's window, and heading; -1s without a way from there."""
    row, col = cell_of(ground, me[0], me[1])
    row, col = row - int(worth.weights[5]), col - int(worth.weights[6])
    height, width = worth.costs.shape
    if not (0 <= row < height and 0 <= col < width) or worth.costs[row, col] == np.inf:
        return -1, -1, -1
    return row, col, heading_of(ground.lattice, me[2])


@compiled
def _action(
    ground: Ground, worth: Worth, moving: Floats, epochs_left: int, state: tuple[int, int, int]
) -> int:
    """Return the best action, with so many epochs left, among those who move."""
    place = max(0, min(epochs_left, worth.planes.shape[0]) - 1)
    arrays = (worth.planes, worth.lengths, worth.gains, worth.weights, ground.anchors_m)
    return look_ahead(*arrays, moving, place, state)


@compiled
def _way(
    ground: Ground,
    worth: Worth,
    state: tuple[int, int, int],
    action: int,
    goal_m: tuple[float, float],
    way_m: Floats,
) -> int:
    """Fill in the way that follows an action, with the goal at its end; return its length."""
    arrays = (worth.lengths, worth.gains, worth.weights, ground.anchors_m)
    count, _ = greedy_way(worth.planes, *arrays, state, action, way_m)
    row, col = worth.weights[5] + worth.weights[7], worth.weights[6] + worth.weights[8]
    end_m = ground.anchors_m[int(row), int(col)]
    if count > 0 and way_m[count - 1, 0] == end_m[0] and way_m[count - 1, 1] == end_m[1]:
        way_m[count - 1, 0], way_m[count - 1, 1] = goal_m
    return count
