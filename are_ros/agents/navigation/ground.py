"""The coarse map as the kernels take it: which of its cells and headings a pose belongs to."""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, owning
from are_ros.agents.mdp.coarse_kernels import COL_STEPS, ROW_STEPS
from are_ros.agents.navigation.terrain import rolls

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
def fine_cell(lattice: npt.NDArray[np.float64], point_m: tuple[float, float]) -> tuple[int, int]:
    """Return row and column of the fine cell that a point of the map frame is in."""
    dx_m, dy_m = point_m[0] - lattice[0], point_m[1] - lattice[1]
    row = (dy_m * lattice[2] - dx_m * lattice[3]) / lattice[5]
    col = (dx_m * lattice[2] + dy_m * lattice[3]) / lattice[4]
    return int(np.floor(row)), int(np.floor(col))


@owning
def cell_of(ground: Ground, x_m: float, y_m: float) -> tuple[int, int]:
    """Return the coarse cell that stands for a point, (-1, -1) if there is none.

    It is that of the nearest fine cell of a block's largest component. The way there leads over
    cells that keep the least clearance once it has come upon one, over free cells before (never
    through a wall, but where it starts in one), at most `search` cells away in rows and in columns.
    """
    is_main, clearance_m, reach = ground.is_main, ground.clearance_m, ground.search
    start_row, start_col = fine_cell(ground.lattice, (x_m, y_m))
    if not (0 <= start_row < is_main.shape[0] and 0 <= start_col < is_main.shape[1]):
        return -1, -1
    if is_main[start_row, start_col]:
        return start_row // ground.side, start_col // ground.side
    side = 2 * reach + 1
    seen = np.zeros((side, side), np.bool_)
    queue = np.empty((side * side, 2), np.int64)
    queue[0, 0], queue[0, 1] = start_row, start_col
    seen[reach, reach] = True
    done, size = 0, 1
    while done < size:
        row, col = queue[done, 0], queue[done, 1]
        if is_main[row, col]:
            return row // ground.side, col // ground.side
        done += 1
        for direction in range(4):
            r, c = row + ROW_STEPS[direction], col + COL_STEPS[direction]
            i, j = r - start_row + reach, c - start_col + reach
            if not (0 <= i < side and 0 <= j < side) or seen[i, j]:
                continue
            if not (0 <= r < clearance_m.shape[0] and 0 <= c < clearance_m.shape[1]):
                continue
            # never to less room: from enough to too little, or from a free cell into a closed one
            here_m, there_m, least_m = clearance_m[row, col], clearance_m[r, c], ground.least_m
            if there_m >= least_m or (here_m < least_m and (there_m > 0.0 or here_m == 0.0)):
                seen[i, j] = True
                queue[size, 0], queue[size, 1] = r, c
                size += 1
    return -1, -1


def holds(ground: Ground, x_m: float, y_m: float, radius_m: float) -> bool:
    """Tell whether a disc fits at a point, and the component of the point's cell contains that."""
    is_main, here_m = ground.is_main, (x_m, y_m)
    row, col = fine_cell(ground.lattice, here_m)
    is_inside = 0 <= row < is_main.shape[0] and 0 <= col < is_main.shape[1]
    if not (is_inside and is_main[row, col]):
        return False
    return rolls(ground.clearance_m, ground.lattice, here_m, here_m, radius_m)


@borrowing
def heading_of(lattice: npt.NDArray[np.float64], yaw_rad: float) -> int:
    """Return the nearest of the four headings along a lattice to a yaw in the map."""
    turn_rad = yaw_rad - np.arctan2(lattice[3], lattice[2])
    return int(np.floor(turn_rad / _QUARTER + 0.5)) % 4
