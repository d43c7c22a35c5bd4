"""Where a disc has room, and is not shut in.

From a pocket between table, chairs and wall no way would lead anywhere.
"""

from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.artefacts._coarse_kernels import exact_room
from are_ros.artefacts.terrain import Terrain, rolls

ROOMY_SHARE: Final = 0.25
"""Of the largest part that such discs can roam; what is smaller is a pocket."""

_Mask = npt.NDArray[np.bool_]


class Roaming:
    """A disc about F_A's point on the ground, and the terrain that it can roam.

    `region` bool (H, W) are the cells that count when parts of the map are compared; parts that
    are less than `extent_m` long, along the grid's axes, count as pockets however large they are.
    """

    def __init__(
        self, terrain: Terrain, radius_m: float, region: _Mask, extent_m: float = 0.0
    ) -> None:
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
        """Tell at which points (N, >= 2) of the map it is free, and not shut in: bool (N,).

        Free as the traffic has it, which lets nobody end a move elsewhere: `Terrain.sees` from a
        point to itself, exactly. Not shut in are points in those cells from whose centres the disc
        reaches, from cell to cell, a part of the region that is not much smaller than the largest.
        """
        terrain = self._terrain
        return discs_are_free(
            terrain.clearance_m, self._roomy, terrain.lattice, points_m, self.radius_m
        )

    @cached_property
    def _roomy(self) -> _Mask:
        """The cells (H, W) of large parts, and those beside them, whose centres may be too near."""
        import cv2

        field, unit_m = self._terrain.clearance_m, self._terrain.grid.resolution_m
        open_cells = (exact_room(field, self.radius_m, unit_m) > 0.0).view(np.uint8)
        count, labels, boxes, _ = cv2.connectedComponentsWithStats(open_cells, connectivity=4)
        sizes = np.bincount(labels[self._region], minlength=count)
        sides = boxes[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1)
        sizes[sides * unit_m < self._extent_m] = 0
        sizes[0] = 0
        is_large = sizes >= max(1.0, ROOMY_SHARE * sizes.max())
        large = is_large[labels].view(np.uint8)
        roomy: _Mask = cv2.dilate(large, np.ones((3, 3), np.uint8)).view(np.bool_)
        return roomy


@compiled
def discs_are_free(
    field: npt.NDArray[np.float32],
    roomy: _Mask,
    lattice: npt.NDArray[np.float64],
    points_m: npt.NDArray[np.float64],
    radius_m: float,
) -> _Mask:
    """Tell for each point (N, >= 2) whether the disc about it covers open cells only: bool (N,).

    And whether the cell (H, W) that it is in is a roomy one.
    """
    free = np.empty(len(points_m), np.bool_)
    for k in range(len(points_m)):
        point_m = (points_m[k, 0], points_m[k, 1])
        free[k] = rolls(field, lattice, point_m, point_m, radius_m)
        if free[k]:  # so it is on the grid
            dx_m, dy_m = point_m[0] - lattice[0], point_m[1] - lattice[1]
            row = int((dy_m * lattice[2] - dx_m * lattice[3]) / lattice[5])
            col = int((dx_m * lattice[2] + dy_m * lattice[3]) / lattice[4])
            free[k] = roomy[row, col]
    return free
