"""The octomap in the overview picture: what stands on the floor, and what hides at eye level."""

from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.replay._picture_map import KnownPart
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.voxel_map import VoxelMap

LOWEST_M: Final = 0.1
HIGHEST_M: Final = 1.8
"""What stands between these heights above the lowest voxel is drawn: no floor and no ceiling."""

_FURNITURE: Final = 45
"""Drawn like a cell of this value: darker than free, paler than a wall of the map."""
_OCCUPIED: Final = 100


def with_furniture(grid: OccupancyGrid, part: KnownPart, voxels: VoxelMap) -> KnownPart:
    """Return the known part with what the octomap has on its free cells, in a middle grey."""
    base_m = float(voxels.map_from_lattice.translation_m[2])
    stands = _covered(grid, part, voxels, base_m + LOWEST_M, base_m + HIGHEST_M)
    cells = np.where(stands & (part.cells >= 0), np.maximum(part.cells, _FURNITURE), part.cells)
    return replace(part, cells=cells.astype(np.int8))


def hiding_part(
    grid: OccupancyGrid, part: KnownPart, voxels: VoxelMap, height_m: float
) -> KnownPart:
    """Return the known part, occupied where the octomap is at a height in the map's frame."""
    half_m = 0.5 * voxels.voxel_size_m[2]
    hides = _covered(grid, part, voxels, height_m - half_m, height_m + half_m)
    return replace(part, cells=np.where(hides, _OCCUPIED, 0).astype(np.int8))


def _covered(
    grid: OccupancyGrid, part: KnownPart, voxels: VoxelMap, low_m: float, high_m: float
) -> npt.NDArray[np.bool_]:
    """Return the cells (h, w) of a part that voxels with their middle in (low_m, high_m] cover.

    A cell counts that holds a voxel's middle, or whose middle a voxel holds: so neither fine voxels
    get lost nor coarse ones have holes.
    """
    base_m, size_m = float(voxels.map_from_lattice.translation_m[2]), voxels.voxel_size_m
    middles_m = base_m + (np.arange(voxels.occupied.shape[2]) + 0.5) * size_m[2]
    layers = (middles_m > low_m) & (middles_m <= high_m)
    columns = np.asarray(voxels.occupied[:, :, layers].any(axis=2))
    covered = np.zeros(part.cells.shape, dtype=np.bool_)
    held = np.argwhere(columns) + 0.5
    points = np.column_stack((held * np.array(size_m[:2]), np.zeros(len(held))))
    cells = grid.points_to_cells(voxels.map_from_lattice.apply(points)[:, :2])
    cells = cells - np.array((part.row0, part.col0))
    inside = ((cells >= 0) & (cells < covered.shape)).all(axis=1)
    covered[cells[inside, 0], cells[inside, 1]] = True
    rows, cols = np.indices(covered.shape).reshape(2, -1)
    own = grid.cells_to_points(np.column_stack((rows + part.row0, cols + part.col0)))
    found = voxels.points_to_voxels(np.column_stack((own, np.zeros(len(own)))))[:, :2]
    inside = ((found >= 0) & (found < columns.shape)).all(axis=1)
    covered[rows[inside], cols[inside]] |= columns[found[inside, 0], found[inside, 1]]
    return covered
