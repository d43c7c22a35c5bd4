"""Where a disc has room, and in which parts of the map that are long enough to go somewhere."""

from functools import cached_property

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.artefacts._coarse_kernels import exact_room
from are_ros.artefacts.terrain import Terrain, rolls

_Mask = npt.NDArray[np.bool_]


class Roaming:
    """A disc about F_A's point on the ground, and the terrain that it can roam.

    It can roam the parts of it that are at least `extent_m` long, along the grid's axes, and have
    a cell of `region`, bool (H, W).
    """

    def __init__(self, terrain: Terrain, radius_m: float, region: _Mask, extent_m: float) -> None:
        self.radius_m = radius_m
        self._terrain = terrain
        self._region = region
        self._extent_m = extent_m

    @property
    def key(self) -> tuple[float, ...]:
        """What tells two of them apart in one environment, beside the shape of the box."""
        return (self.radius_m, self._terrain.height_m)

    @property
    def is_anywhere(self) -> bool:
        """Whether there is a part of the map at all that it can roam."""
        return bool(self._roomy.any())

    def is_free_at(self, points_m: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        """Tell at which points (N, >= 2) of the map it is free, and can roam a part: bool (N,).

        It can in those cells from whose centres it can, and in those beside them.
        """
        terrain = self._terrain
        free = discs_are_free(terrain.clearance_m, terrain.lattice, points_m, self.radius_m)
        rows, cols = terrain.grid.points_to_cells(points_m[free, :2]).T
        free[free] = self._roomy[rows, cols]
        return free

    @cached_property
    def _roomy(self) -> _Mask:
        """The cells (H, W) of such parts, and those beside them, whose centres may be too near."""
        import cv2

        field, unit_m = self._terrain.clearance_m, self._terrain.grid.resolution_m
        open_cells = (exact_room(field, self.radius_m, unit_m) > 0.0).view(np.uint8)
        count, labels, boxes, _ = cv2.connectedComponentsWithStats(open_cells, connectivity=4)
        sides = boxes[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1)
        is_roomy = np.bincount(labels[self._region], minlength=count) > 0
        is_roomy &= sides * unit_m >= self._extent_m
        is_roomy[0] = False
        mask = is_roomy[labels].view(np.uint8)
        roomy: _Mask = cv2.dilate(mask, np.ones((3, 3), np.uint8)).view(np.bool_)
        return roomy


@compiled
def discs_are_free(
    field: npt.NDArray[np.float32],
    lattice: npt.NDArray[np.float64],
    points_m: npt.NDArray[np.float64],
    radius_m: float,
) -> _Mask:
    """Tell for each point (N, >= 2) whether the disc about it covers open cells only: bool (N,).

    As the traffic has it, which lets nobody end a move elsewhere: `Terrain.sees` from a point to
    itself, exactly.
    """
    free = np.empty(len(points_m), np.bool_)
    for k in range(len(points_m)):
        point_m = (points_m[k, 0], points_m[k, 1])
        free[k] = rolls(field, lattice, point_m, point_m, radius_m)
    return free
