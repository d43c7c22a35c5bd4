"""Small floors for tests of decisions: terrains made of booleans, and doors in walls."""

import math
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from are_ros.agents.navigation.terrain import Terrain
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.occupancy_grid import OccupancyGrid, classify

Walls = npt.NDArray[np.bool_]
Cell = tuple[int, int]


def terrain_of(
    walls: Walls,
    resolution_m: float = 0.05,
    origin_m: tuple[float, float] = (0.0, 0.0),
    yaw_rad: float = 0.0,
    version: int = 0,
) -> Terrain:
    """Return the terrain of a floor with walls bool (H, W); all the rest of it is free."""
    rotation = (0.0, 0.0, math.sin(0.5 * yaw_rad), math.cos(0.5 * yaw_rad))
    grid = OccupancyGrid.checked(
        np.where(walls, 100, 0),
        width=walls.shape[1],
        height=walls.shape[0],
        resolution_m=resolution_m,
        origin_xyz_m=(*origin_m, 0.0),
        origin_rotation_xyzw=rotation,
        frame_id="map",
    )
    environment = Environment(grid, classify(grid, 65, 25), None, PlaneGround(), 0.06, version)
    return Terrain(environment, 1.75)


def two_rooms(height: int, width: int, wall: slice, door: slice | None) -> Walls:
    """Return two rooms side by side, a wall of such columns between them, a door of such rows."""
    walls = np.zeros((height, width), np.bool_)
    walls[:, wall] = True
    if door is not None:
        walls[door, wall] = False
    return walls


def local_components(fits: Walls, side: int) -> dict[Cell, Walls]:
    """Return the largest component of each block that has any, as a mask of the whole floor."""
    rows, cols = (-(-size // side) for size in fits.shape)
    found = {}
    for i, j in product(range(rows), range(cols)):
        block = np.zeros_like(fits)
        part = (slice(i * side, (i + 1) * side), slice(j * side, (j + 1) * side))
        block[part] = fits[part]
        labels, count = ndimage.label(block)
        if count:
            sizes = np.bincount(labels.ravel())[1:]
            found[i, j] = np.asarray(labels == 1 + int(np.argmax(sizes)))
    return found


def joins_within(
    fits: Walls, side: int, largest: dict[Cell, Walls], one: Cell, other: Cell
) -> bool:
    """Tell whether the largest components of two blocks join within the two."""
    if one not in largest or other not in largest:
        return False
    both = np.zeros_like(fits)
    for i, j in (one, other):
        part = (slice(i * side, (i + 1) * side), slice(j * side, (j + 1) * side))
        both[part] = fits[part]
    labels, _ = ndimage.label(both)
    return bool(labels[largest[one]][0] == labels[largest[other]][0])
