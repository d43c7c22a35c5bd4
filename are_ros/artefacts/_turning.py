"""Where an artefact that turns on the spot can set out: the disc that it sweeps meets no wall."""

from functools import cached_property

import numpy as np
import numpy.typing as npt

from are_ros.artefacts._coarse_kernels import exact_room
from are_ros.artefacts._roaming import discs_are_free
from are_ros.artefacts.terrain import Terrain

_Mask = npt.NDArray[np.bool_]


class Turning:
    """The disc about F_A's point on the ground that holds a row's box, on the terrain it is on.

    `region` bool (H, W) are the cells that it may be in.
    """

    is_searched_for = True

    def __init__(self, terrain: Terrain, radius_m: float, region: _Mask) -> None:
        self.radius_m = radius_m
        self._terrain = terrain
        self._region = region

    @property
    def key(self) -> tuple[float, ...]:
        """What tells two of them apart in one environment, beside the shape of the box."""
        return (self.radius_m, self._terrain.height_m)

    @cached_property
    def is_anywhere(self) -> bool:
        """Whether it is free about the centre of any cell of the region."""
        field, unit_m = self._terrain.clearance_m, self._terrain.grid.resolution_m
        return bool((exact_room(field, self.radius_m, unit_m)[self._region] > 0.0).any())

    def is_free_at(self, points_m: npt.NDArray[np.float64]) -> _Mask:
        """Tell at which points (N, >= 2) of the map it is free: bool (N,)."""
        terrain = self._terrain
        return discs_are_free(terrain.clearance_m, terrain.lattice, points_m, self.radius_m)

    def leads_out(self, poses: npt.NDArray[np.float64]) -> _Mask:
        """Tell at which poses (N, 4) it can leave the free disc: bool (N,), all."""
        return np.ones(len(poses), np.bool_)
