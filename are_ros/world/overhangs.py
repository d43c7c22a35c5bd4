"""How low voxels hang over the cells of a grid: who is shorter may pass below them."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.world.ground import Ground, PlaneGround
from are_ros.world.lattice_cover import covered
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.oriented_boxes import TOUCH_TOLERANCE_M
from are_ros.world.voxel_map import VoxelMap

_HALF_CELL: Final = 0.5


class Overhangs:
    """The bottom of the lowest voxel in the way over each cell, found once for all heights.

    A voxel is in the way if its top is more than `clearance_m` above the ground of the cell, and
    the cell's square meets it.
    """

    def __init__(
        self, grid: OccupancyGrid, voxels: VoxelMap, ground: Ground, clearance_m: float
    ) -> None:
        self._floors_m = _floors_m(grid, ground)
        self._bottoms_m = np.full(grid.cells.shape, np.inf)
        base_m, layer_m = float(voxels.map_from_lattice.translation_m[2]), voxels.voxel_size_m[2]
        columns = np.ascontiguousarray(np.argwhere(voxels.occupied.any(axis=2)))
        _lower(
            self._bottoms_m,
            _packed_columns(grid, voxels, columns),
            columns,
            voxels.occupied,
            np.broadcast_to(self._floors_m, grid.cells.shape).copy(),
            (base_m, layer_m, clearance_m),
            grid.resolution_m,
        )

    def below(self, height_m: float) -> npt.NDArray[np.bool_]:
        """Return the cells (height, width) over which a voxel is in the way of such a body."""
        tops_m = self._floors_m + height_m - TOUCH_TOLERANCE_M
        found: npt.NDArray[np.bool_] = self._bottoms_m < tops_m
        return found


def _floors_m(grid: OccupancyGrid, ground: Ground) -> npt.NDArray[np.float64]:
    """Return the ground's height over each cell (height, width), one for all () of a plane."""
    if isinstance(ground, PlaneGround):
        return np.array(float(ground.height_m))
    rows, cols = np.indices(grid.cells.shape)
    points_m = grid.cells_to_points(np.column_stack((rows.ravel(), cols.ravel())))
    heights_m = ground.heights(points_m).reshape(grid.cells.shape)
    floors_m: npt.NDArray[np.float64] = np.maximum(heights_m, ground.lowest_m())
    return floors_m


def _packed_columns(
    grid: OccupancyGrid, voxels: VoxelMap, columns: npt.NDArray[np.int64]
) -> npt.NDArray[np.float64]:
    """Return the footprints of columns (M, 2) of voxels in the grid's frame, as packed boxes."""
    local = grid.origin.inverse() @ voxels.map_from_lattice
    width_m, depth_m, _ = voxels.voxel_size_m
    cosine, sine = math.cos(local.yaw_rad()), math.sin(local.yaw_rad())
    x0_m, y0_m, _ = local.translation_m
    packed = np.zeros((len(columns), 8))
    along_m, across_m = (columns + _HALF_CELL).T * np.array([[width_m], [depth_m]])
    packed[:, 0] = x0_m + cosine * along_m - sine * across_m
    packed[:, 1] = y0_m + sine * along_m + cosine * across_m
    packed[:, 3], packed[:, 4] = cosine, sine
    packed[:, 5], packed[:, 6] = _HALF_CELL * width_m, _HALF_CELL * depth_m
    return packed


@compiled
def _lower(
    bottoms_m: npt.NDArray[np.float64],
    packed: npt.NDArray[np.float64],
    columns: npt.NDArray[np.int64],
    occupied: npt.NDArray[np.uint8],
    floors_m: npt.NDArray[np.float64],
    levels_m: tuple[float, float, float],
    resolution_m: float,
) -> None:
    """Lower the bottoms over the cells that each column of voxels (M,), a box, meets."""
    base, layer, clearance = levels_m
    lattice = np.array([0.0, 0.0, 1.0, 0.0, resolution_m, resolution_m])
    for i in range(columns.shape[0]):
        row0, col0, mask = covered(packed, i, lattice, bottoms_m.shape, TOUCH_TOLERANCE_M)
        voxels = occupied[columns[i, 0], columns[i, 1]]
        for row in range(mask.shape[0]):
            for col in range(mask.shape[1]):
                if not mask[row, col]:
                    continue
                least = floors_m[row0 + row, col0 + col] + clearance + TOUCH_TOLERANCE_M
                known = bottoms_m[row0 + row, col0 + col]
                for k in range(voxels.shape[0]):
                    bottom = base + k * layer
                    if bottom >= known:
                        break
                    if voxels[k] and base + (k + 1) * layer > least:
                        bottoms_m[row0 + row, col0 + col] = bottom
                        break
