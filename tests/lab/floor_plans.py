"""Made-up maps for soaks: an office whose doors are 0.9 m wide, and a hall with pillars."""

import numpy as np

from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

CELL_M = 0.05


def _grid(walls: "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]") -> OccupancyGrid:
    walls[[0, 1, -2, -1]] = walls[:, [0, 1, -2, -1]] = True
    cells = np.where(walls, 100, 0).astype(np.int8)
    return OccupancyGrid(cells, CELL_M, RigidTransform.planar(-1.0, -2.0, 0.1), "map")


def office() -> OccupancyGrid:
    """Return a corridor of 2 x 20 m with four rooms of 5 x 4.5 m on each side, a door to each."""
    walls = np.zeros((220, 400), np.bool_)
    for rows in (slice(88, 90), slice(130, 132)):
        walls[rows] = True
        for room in range(4):
            middle = 100 * room + 50
            walls[rows, middle - 9 : middle + 9] = False
    for column in (100, 200, 300):
        walls[:90, column : column + 2] = walls[130:, column : column + 2] = True
    return _grid(walls)


def pillars() -> OccupancyGrid:
    """Return a hall of 20 x 14 m with fifteen pillars of half a metre."""
    walls = np.zeros((280, 400), np.bool_)
    for row in (70, 140, 210):
        for column in range(67, 400, 66):
            walls[row - 5 : row + 5, column - 5 : column + 5] = True
    return _grid(walls)
