"""Compiled giving of orders: what a new one changes, beside itself, for who had another before."""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.artefacts.motion._patience import forget_blockade
from are_ros.artefacts.motion._state import NEVER, Floats, Integers, Records

_ELSEWHERE_M: Final = 1.0
_NEWS_M: Final = 0.1


@compiled
def give(
    orders: Records,
    minds: Records,
    due: Integers,
    rows: Integers,
    commands: npt.NDArray[np.float64],
    now: int,
) -> None:
    """Write orders into the records of some rows (M,); `commands` (M, 9) as `order_record`.

    Whose sub-goal or speed is news plans at once; what was in the way to another is forgotten.
    """
    for k in range(rows.shape[0]):
        i = rows[k]
        before, mind = orders[i], minds[i]
        shift_m = _shift_m(before.has_goal != 0, before.x, before.y, commands[k])
        if shift_m > _NEWS_M or commands[k, 3] != before.speed:
            due[i] = now
        if shift_m > 0.0:
            mind.passed_at = NEVER
        if shift_m > _ELSEWHERE_M and mind.credit < 0.0:
            mind.credit = 0.0  # what it went back from the old one is no loss
        if commands[k, 0] == 0.0 and shift_m > 0.0:
            forget_blockade(mind)
        before.has_goal, before.x, before.y = (
            np.int64(commands[k, 0]),
            commands[k, 1],
            commands[k, 2],
        )
        before.speed, before.stops = commands[k, 3], np.int64(commands[k, 4])
        before.face, before.comfort = commands[k, 5], commands[k, 6]
        before.robot_comfort, before.wall_comfort = commands[k, 7], commands[k, 8]


@compiled
def _shift_m(had_goal: bool, x_m: float, y_m: float, row: Floats) -> float:
    """Return how far a sub-goal has moved; infinitely far if there was none, or is none now."""
    has_goal = row[0] != 0.0
    if not had_goal or not has_goal:
        return 0.0 if had_goal == has_goal else np.inf
    return float(np.hypot(row[1] - x_m, row[2] - y_m))
