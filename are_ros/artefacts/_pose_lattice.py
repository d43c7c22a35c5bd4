"""The lattice of poses that decides whether a map has room: centres of cells, 16 headings."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.world.occupancy_grid import OccupancyGrid

HEADINGS: Final = 16
"""Headings of the lattice that is searched where drawing at random found nothing."""
LATTICE_CELLS: Final = 1 << 18
_PITCH_M: Final = 0.05

_Cells = npt.NDArray[np.int32]
_Poses = npt.NDArray[np.int64]
_Floats = npt.NDArray[np.float64]


class PoseLattice:
    """Poses of one grid as numbers: (row * width + col) * `HEADINGS` + heading."""

    def __init__(self, grid: OccupancyGrid) -> None:
        self._grid = grid
        self._grid_yaw_rad = grid.origin.yaw_rad()

    def thinned(self, flat: _Cells) -> _Cells:
        """Return the cells (N,) on the lattice: all, or of very many every n-th row and column."""
        if 2 * flat.size <= LATTICE_CELLS:
            return flat
        at_pitch = int(_PITCH_M / self._grid.resolution_m + 1e-6)
        stride = max(1, at_pitch, math.ceil(math.sqrt(flat.size / LATTICE_CELLS)))
        rows, cols = flat // self._grid.width, flat % self._grid.width
        is_on = (rows % stride == stride // 2) & (cols % stride == stride // 2)
        return np.compress(is_on, flat)

    def poses(self, numbers: _Poses) -> _Floats:
        """Return poses (N, 4), x, y, 0, yaw in the map frame, by their numbers (N,)."""
        flat, heading = numbers // HEADINGS, numbers % HEADINGS
        poses = np.zeros((flat.size, 4))
        poses[:, :2] = self.centres_m(flat)
        poses[:, 3] = self._grid_yaw_rad + heading * (math.tau / HEADINGS)
        return poses

    def centres_m(self, flat: _Cells | _Poses) -> _Floats:
        """Return the centres (N, 2) of cells (N,), row * width + col, in the map frame."""
        cells = np.column_stack((flat // self._grid.width, flat % self._grid.width))
        return self._grid.cells_to_points(cells)
