"""Search of a way over fine cells, where no point of the coarse way can be reached straight.

A coarse way names the blocks of cells to pass, not the way round the corner between two of them.
This is the shortest way of a disc through those blocks, cell by cell. The agent then moves to the
farthest point of it that the disc can roll straight to.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled, owning
from are_ros.agents.mdp.coarse_kernels import COL_STEPS, ROW_STEPS
from are_ros.agents.navigation.ground import Ground, cell_of, fine_cell
from are_ros.agents.navigation.terrain import cell_centre, disc_fits, rolls

LEAST_M: Final = 0.25
"""A point nearer than this counts as reached: the next point is taken, visible or not."""

AHEAD: Final = 2
"""How many points of the coarse way are searched for: those of the next two blocks."""

MARGINS: Final = (0, 1, 3)
"""The search is widened by so many blocks, one after the other, while it finds nothing."""

_UNSEEN: Final = -1

Point = tuple[float, float]


@owning
def way_round(
    ground: Ground, from_m: Point, way_m: npt.NDArray[np.float64], radius_m: float
) -> tuple[float, float, bool]:
    """Return the first point on the way to the first points of a coarse way (K, 2), K > 0.

    `from_m` and the result are points of the map frame; the last value tells whether there is a
    way at all: if not, it is the first point of the coarse way.
    """
    way_m, side = way_m[:AHEAD], ground.side
    goal_m = (way_m[-1, 0], way_m[-1, 1])
    start = fine_cell(ground.lattice, from_m)
    goal = fine_cell(ground.lattice, goal_m)
    # the blocks that the way leads through, that of the coarse cell that stands for the start too
    first_row, first_col = start[0] // side, start[1] // side
    row, col = cell_of(ground, from_m[0], from_m[1])
    row, col = (row, col) if row >= 0 else (first_row, first_col)
    south, north = min(first_row, row), max(first_row, row)
    west, east = min(first_col, col), max(first_col, col)
    for k in range(way_m.shape[0]):
        row, col = fine_cell(ground.lattice, (way_m[k, 0], way_m[k, 1]))
        south, north = min(south, row // side), max(north, row // side)
        west, east = min(west, col // side), max(east, col // side)
    height, width = ground.clearance_m.shape
    for margin in MARGINS:
        low_row, low_col = max(0, (south - margin) * side), max(0, (west - margin) * side)
        rows = min(height, (north + margin + 1) * side) - low_row
        cols = min(width, (east + margin + 1) * side) - low_col
        parents = np.full((rows, cols), _UNSEEN, np.int32)
        if _flood(ground, start, goal, (low_row, low_col), radius_m, parents):
            here = (goal[0] - low_row) * cols + goal[1] - low_col
            cells, count, before = np.empty((parents.size, 2), np.int64), 0, -1
            while before != here:  # from the goal back to the start, which is its own parent
                here = before if before >= 0 else here
                cells[count, 0], cells[count, 1] = here // cols + low_row, here % cols + low_col
                count += 1
                before = np.int64(parents[here // cols, here % cols])
            cells = cells[:count]
            x_m, y_m = _first_leg(ground, from_m, cells, goal_m, radius_m)
            return x_m, y_m, True
    return way_m[0, 0], way_m[0, 1], False


@compiled
def _flood(
    ground: Ground,
    start: tuple[int, int],
    goal: tuple[int, int],
    corner: tuple[int, int],
    radius_m: float,
    parents: npt.NDArray[np.int32],
) -> bool:
    """Go from cell to cell, nearest first, until the goal is reached; tell whether it is.

    Writes to `parents` from which cell of the window each was reached, itself for the first. Where
    a disc does not fit at the start, it first goes over open cells to the nearest where it does.
    """
    height, width = parents.shape
    unit_m, field = ground.lattice[4], ground.clearance_m
    row, col = start[0] - corner[0], start[1] - corner[1]
    if not (0 <= row < height and 0 <= col < width):
        return False
    queue = np.empty(height * width, np.int32)
    is_pressed = not disc_fits(field, start[0], start[1], radius_m, unit_m)
    queue[0] = parents[row, col] = row * width + col
    done, size = 0, 1
    while done < size:
        row, col = queue[done] // width, queue[done] % width
        if row + corner[0] == goal[0] and col + corner[1] == goal[1]:
            return True
        done += 1
        for direction in range(4):
            r, c = row + ROW_STEPS[direction], col + COL_STEPS[direction]
            if not (0 <= r < height and 0 <= c < width) or parents[r, c] != _UNSEEN:
                continue
            does_fit = disc_fits(field, r + corner[0], c + corner[1], radius_m, unit_m)
            if does_fit or (is_pressed and field[r + corner[0], c + corner[1]] > 0.0):
                parents[r, c] = row * width + col
                queue[size] = r * width + c
                size += 1
            if does_fit and is_pressed:  # from here on only where it fits
                is_pressed, done = False, size - 1
                break
    return False


@compiled
def _first_leg(
    ground: Ground,
    from_m: Point,
    cells: npt.NDArray[np.int64],
    goal_m: Point,
    radius_m: float,
) -> Point:
    """Return the farthest point of a way that is rolled to straight, or one a little way off.

    The disc fits at either. `cells` (N, 2) is the way from its end on. What is seen is found by
    halving: beyond what is not seen a bit of the way may be seen again.
    """
    nearest, unseen = cells.shape[0] - 1, -1
    at = 0
    while nearest - unseen > 1:
        point_m = goal_m if at == 0 else cell_centre(ground.lattice, cells[at, 0], cells[at, 1])
        if rolls(ground.clearance_m, ground.lattice, from_m, point_m, radius_m):
            nearest = at
        else:
            unseen = at
        at = (nearest + unseen) // 2
    for k in range(nearest, 0, -1):
        row, col = cells[k, 0], cells[k, 1]
        x_m, y_m = cell_centre(ground.lattice, row, col)
        is_far = np.hypot(x_m - from_m[0], y_m - from_m[1]) >= LEAST_M
        if is_far and disc_fits(ground.clearance_m, row, col, radius_m, ground.lattice[4]):
            return x_m, y_m
    return goal_m
