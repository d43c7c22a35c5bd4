"""Goals as records: what compiled code needs to go to many goals in one call.

Each goal has arrays of its own, of other sizes. A record holds their addresses and sizes, so one
array of records stands for all goals. Whoever keeps a record keeps the arrays, too.
"""

from typing import Any, Final, NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled, pointer
from are_ros.agents.mdp.routes import ValueArrays
from are_ros.agents.navigation.ground import Ground

Records = npt.NDArray[np.void]

_ADDRESSES: Final = (
    *("is_main", "clearance", "lattice", "anchors"),
    *("planes", "settled", "lengths", "costs", "nearness", "paces"),
)
_SIZES: Final = (
    *("fine_rows", "fine_cols", "map_rows", "map_cols", "search", "side"),
    *("epochs", "settled_rows", "settled_cols", "rows", "cols", "pace_count"),
    *("corner_row", "corner_col", "goal_row", "goal_col"),
)
_NUMBERS: Final = (
    *("least_m", "time", "wall", "rest", "goes", "fails", "slips", "quarter", "half"),
    *("radius_m", "goal_x_m", "goal_y_m", "end_x_m", "end_y_m", "others_price", "robot_price"),
)

GOAL: Final = np.dtype(
    [(name, "u8") for name in _ADDRESSES]
    + [(name, "i8") for name in _SIZES]
    + [(name, "f8") for name in _NUMBERS]
)
"""The fields of `Ground`, `ValueArrays` and `GoalSpec`."""


class GoalSpec(NamedTuple):
    """An agent's radius, its goal, and where the values end, which may be beside the goal.

    Then the cost per epoch of being near others, and near the robot.
    """

    radius_m: float
    goal_m: tuple[float, float]
    end_m: tuple[float, float]
    others_price: float
    robot_price: float


def goal_record(ground: Ground, values: ValueArrays, spec: GoalSpec) -> bytes:
    """Return the record of a goal, which is valid as long as the arrays are there."""
    is_main, clearance_m, lattice, anchors_m, least_m, search, side = ground
    planes, settled, lengths, costs, nearness, paces, *numbers, corner, goal = values
    arrays = (
        *(is_main, clearance_m, lattice, anchors_m),
        *(planes, settled, lengths, costs, nearness, paces),
    )
    sizes = (
        *(*is_main.shape, *anchors_m.shape[:2], search, side),
        *(len(planes), *settled.shape, *costs.shape, len(paces)),
        *(*corner, *goal),
    )
    prices, chances, turns = numbers
    radius_m, goal_m, end_m, *costs_beside = spec
    return np.array(
        (
            *map(_address_of, arrays),
            *sizes,
            *(least_m, *prices, *chances, *turns),
            *(radius_m, *goal_m, *end_m, *costs_beside),
        ),
        GOAL,
    ).tobytes()


def record_with_plane(record: bytes, plane: npt.NDArray[np.float32]) -> bytes:
    """Return a record with the values (4, h, w) of the epoch that counts in each cell."""
    goal = np.frombuffer(record, GOAL).copy()
    goal["planes"], goal["epochs"], goal["settled_rows"] = _address_of(plane), 1, 0
    changed: bytes = goal.tobytes()
    return changed


def goals_of(records: list[bytes]) -> Records:
    """Return an array (M,) of goals."""
    return np.frombuffer(b"".join(records), GOAL)


def _address_of(array: npt.NDArray[Any]) -> int:
    """Return where the numbers of an array begin; ValueError if they are not all in a row."""
    if not array.flags.c_contiguous:
        raise ValueError(f"an array of shape {array.shape} is not contiguous")
    address: int = array.__array_interface__["data"][0]
    return address


@compiled
def ground_at(goal: Any) -> Ground:
    """Return the coarse map of a record."""
    fine, coarse = (goal.fine_rows, goal.fine_cols), (goal.map_rows, goal.map_cols, 2)
    return Ground(
        numba.carray(pointer(goal.is_main), fine, np.bool_),
        numba.carray(pointer(goal.clearance), fine, np.float32),
        numba.carray(pointer(goal.lattice), (6,), np.float64),
        numba.carray(pointer(goal.anchors), coarse, np.float64),
        goal.least_m,
        goal.search,
        goal.side,
    )


@compiled
def values_at(goal: Any) -> ValueArrays:
    """Return the values of a record."""
    rows, cols = goal.rows, goal.cols
    settled = (goal.settled_rows, goal.settled_cols)
    return ValueArrays(
        numba.carray(pointer(goal.planes), (goal.epochs, 4, rows, cols), np.float32),
        numba.carray(pointer(goal.settled), settled, np.uint8),
        numba.carray(pointer(goal.lengths), (4, rows, cols), np.uint8),
        numba.carray(pointer(goal.costs), (rows, cols), np.float32),
        numba.carray(pointer(goal.nearness), (goal.map_rows, goal.map_cols), np.float32),
        numba.carray(pointer(goal.paces), (goal.pace_count, 2), np.float64),
        (goal.time, goal.wall, goal.rest),
        (goal.goes, goal.fails, goal.slips),
        (goal.quarter, goal.half),
        (goal.corner_row, goal.corner_col),
        (goal.goal_row, goal.goal_col),
    )


@compiled
def spec_at(goal: Any) -> GoalSpec:
    """Return the numbers of the agent and its goal."""
    return GoalSpec(
        goal.radius_m,
        (goal.goal_x_m, goal.goal_y_m),
        (goal.end_x_m, goal.end_y_m),
        goal.others_price,
        goal.robot_price,
    )
