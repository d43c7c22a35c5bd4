"""Ways by hand: the lookahead and the way of one who goes somewhere, without the agents."""

from enum import IntEnum

import numpy as np
import numpy.typing as npt

from are_ros.agents.mdp import routes as _routes
from are_ros.agents.mdp.coarse_map import CoarseMap
from are_ros.agents.mdp.value_tables import ValueTable
from are_ros.agents.navigation.ground import heading_of
from are_ros.agents.navigation.step_kernels import FADE_M


class Action(IntEnum):
    """The five actions; the direction of a move is its number less one (0 east, 1 north, ...)."""

    STAY = 0
    EAST = 1
    NORTH = 2
    WEST = 3
    SOUTH = 4


_ACTIONS = tuple(Action)


def choose(
    table: ValueTable,
    coarse: CoarseMap,
    x_m: float,
    y_m: float,
    yaw_rad: float,
    epochs_left: int,
    moving_m: npt.NDArray[np.float64],
    radii_m: npt.NDArray[np.float64],
    weights: npt.NDArray[np.float64],
) -> Action:
    """Return the best action at a pose in the map frame, among others who move.

    `moving_m` float64 (M, 2) is where they will be, `radii_m` (M,) how near one minds them wholly,
    `weights` (M,) how much, per epoch (personal space, robot); it fades to nothing over another
    `FADE_M`. They count for this epoch only, on each cell that a move enters and where one stays.
    `Action.STAY` where the table knows no way.
    """
    state = _state(table, coarse, x_m, y_m, heading_of(coarse.ground.lattice, yaw_rad))
    if state is None:
        return Action.STAY
    others = packed(moving_m, radii_m, weights)[None]
    brings = brings_at(table.value_arrays, coarse, epochs_left, others, state)
    return _ACTIONS[_routes.best_action(brings, state[2])[1]]


def brings_at(
    values: _routes.ValueArrays,
    coarse: CoarseMap,
    epochs_left: int,
    others: npt.NDArray[np.float64],
    state: tuple[int, int, int],
) -> npt.NDArray[np.float64]:
    """Return what each pace and move brings, (P, 5), in a state of the window, among others."""
    brings = np.empty((len(values.paces), 5))
    _routes.action_values(values, epochs_left, coarse.anchors_m, others, state, brings)
    return brings


def way(
    table: ValueTable,
    coarse: CoarseMap,
    x_m: float,
    y_m: float,
    heading: int,
    action: Action,
    max_points: int = 16,
) -> npt.NDArray[np.float64]:
    """Return the anchors float64 (K, 2) along an action and then a cheapest way.

    In the map frame, K at most `max_points`; the last is the table's `goal_m` if the way gets
    there. No points where the table knows no way, and in the goal's own cell.
    """
    state = _state(table, coarse, x_m, y_m, heading)
    if state is None:
        return np.empty((0, 2))
    points_m, values = np.empty((max_points, 2)), table.value_arrays
    count = _routes.follow(values, coarse.anchors_m, state, (0, int(action)), points_m)
    points_m = points_m[:count]
    if count > 0 and (points_m[-1] == coarse.anchors_m[table.goal]).all():
        points_m[-1] = table.goal_m
    return points_m


def packed(
    moving_m: npt.NDArray[np.float64],
    radii_m: npt.NDArray[np.float64],
    weights: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """Return those who move in one array (M, 5) of always the same type, compiled for once."""
    others = np.empty((len(radii_m), 5))
    others[:, :2] = moving_m
    others[:, 2], others[:, 3], others[:, 4] = radii_m, FADE_M, weights
    return others


def _state(
    table: ValueTable, coarse: CoarseMap, x_m: float, y_m: float, heading: int
) -> tuple[int, int, int] | None:
    """Return row and column in the table's window, and heading; None without a way from there."""
    cell = coarse.cell_of(x_m, y_m)
    if cell is None or not table.reaches(cell):
        return None
    return cell[0] - table.corner[0], cell[1] - table.corner[1], heading
