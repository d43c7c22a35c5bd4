"""The coarse map as the kernels take it: which of its cells and headings a pose belongs to."""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, compiled, owning
from are_ros.agents.mdp.coarse_kernels import COL_STEPS, ROW_STEPS
from are_ros.agents.navigation.terrain import disc_is_free
from are_ros.world.boxes import TOUCH_TOLERANCE_M

_QUARTER: Final = 0.5 * np.pi


class Ground(NamedTuple):
    """A coarse map's arrays.

    `is_main` bool and `clearance_m` float32 (H, W) of fine cells; `lattice` float64 (6,) places
    them in the map frame; `anchors_m` float64 (h, w, 2). `least_m` is the clearance needed; a
    point's cell is looked for `search` fine cells about it; `side` of them make a coarse cell.
    """

    is_main: npt.NDArray[np.bool_]
    clearance_m: npt.NDArray[np.float32]
    lattice: npt.NDArray[np.float64]
    anchors_m: npt.NDArray[np.float64]
    least_m: float
    search: int
    side: int


@borrowing
def _in_cells(lattice: npt.NDArray[np.float64], x_m: float, y_m: float) -> tuple[float, float]:
    """Return row and column, with fractions, of a point of the map frame."""
    dx_m, dy_m = x_m - lattice[0], y_m - lattice[1]
    row = (dy_m * lattice[2] - dx_m * lattice[3]) / lattice[5]
    return row, (dx_m * lattice[2] + dy_m * lattice[3]) / lattice[4]


@borrowing
def fine_cell(lattice: npt.NDArray[np.float64], point_m: tuple[float, float]) -> tuple[int, int]:
    """Return row and column of the fine cell that a point of the map frame is in."""
    row, col = _in_cells(lattice, point_m[0], point_m[1])
    return int(np.floor(row)), int(np.floor(col))


@owning
def cell_of(ground: Ground, x_m: float, y_m: float) -> tuple[int, int]:
    """Return the coarse cell that stands for a point, (-1, -1) if there is none."""
    is_main = ground.is_main
    row, col = _in_cells(ground.lattice, x_m, y_m)
    if not (0.0 <= row < is_main.shape[0] and 0.0 <= col < is_main.shape[1]):
        return -1, -1
    start = (int(row), int(col))
    if not is_main[start]:
        start = _nearest_main(is_main, ground.clearance_m, ground.least_m, start, ground.search)
        if start[0] < 0:
            return -1, -1
    return start[0] // ground.side, start[1] // ground.side


def holds(ground: Ground, x_m: float, y_m: float, radius_m: float) -> bool:
    """Tell whether a disc fits at a point, and the component of the point's cell contains that."""
    is_main, unit = ground.is_main, ground.lattice[4]
    row, col = _in_cells(ground.lattice, x_m, y_m)
    if not (0.0 <= row < is_main.shape[0] and 0.0 <= col < is_main.shape[1]):
        return False
    radius = radius_m / unit - TOUCH_TOLERANCE_M
    return bool(is_main[int(row), int(col)]) and disc_is_free(ground.clearance_m, col, row, radius)


@borrowing
def heading_of(lattice: npt.NDArray[np.float64], yaw_rad: float) -> int:
    """Return the nearest of the four headings along a lattice to a yaw in the map."""
    turn_rad = yaw_rad - np.arctan2(lattice[3], lattice[2])
    return int(np.floor(turn_rad / _QUARTER + 0.5)) % 4


@compiled
def _nearest_main(
    is_main: npt.NDArray[np.bool_],
    clearance_m: npt.NDArray[np.float32],
    least_m: float,
    start: tuple[int, int],
    reach: int,
) -> tuple[int, int]:
    """Return the nearest cell of a block's largest component, (-1, -1) if there is none in reach.

    The way there leads over cells that keep the least clearance once it has come upon one, over
    free cells before (never through a wall, but where it starts in one), at most `reach` cells
    away in rows and in columns.
    """
    side = 2 * reach + 1
    seen = np.zeros((side, side), np.bool_)
    queue = np.empty((side * side, 2), np.int32)
    queue[0, 0], queue[0, 1] = start
    seen[reach, reach] = True
    done, size = 0, 1
    while done < size:
        row, col = queue[done, 0], queue[done, 1]
        if is_main[row, col]:
            return int(row), int(col)
        done += 1
        for direction in range(4):
            r, c = row + ROW_STEPS[direction], col + COL_STEPS[direction]
            i, j = r - start[0] + reach, c - start[1] + reach
            if not (0 <= i < side and 0 <= j < side) or seen[i, j]:
                continue
            if not (0 <= r < clearance_m.shape[0] and 0 <= c < clearance_m.shape[1]):
                continue
            # never to less room: from enough to too little, or from a free cell into a closed one
            here_m, there_m = clearance_m[row, col], clearance_m[r, c]
            if there_m >= least_m or (here_m < least_m and (there_m > 0.0 or here_m == 0.0)):
                seen[i, j] = True
                queue[size, 0], queue[size, 1] = r, c
                size += 1
    return -1, -1
