"""Where an artefact that turns on the spot can set out: the disc that it sweeps meets no wall.

And it is not shut in: from a pocket between table, chairs and wall no way would lead anywhere.
"""

from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.artefacts._coarse_kernels import exact_room
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.motion.body import Body
from are_ros.artefacts.terrain import Terrain, Terrains, rolls
from are_ros.world.environment import Environment

ROOMY_SHARE: Final = 0.25
"""Of the largest part that such discs can roam; what is smaller is a pocket."""

_Mask = npt.NDArray[np.bool_]


class Turning:
    """The disc about F_A's point on the ground that holds a row's box, on the terrain it is on.

    `region` bool (H, W) are the cells that count when parts are compared.
    """

    def __init__(self, terrain: Terrain, radius_m: float, region: _Mask) -> None:
        self.radius_m = radius_m
        self._terrain = terrain
        self._region = region

    @property
    def key(self) -> tuple[float, ...]:
        """What tells two of them apart in one environment, beside the shape of the box."""
        return (self.radius_m, self._terrain.height_m)

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
        count, labels = cv2.connectedComponents(open_cells, connectivity=4, ltype=cv2.CV_32S)
        sizes = np.bincount(labels[self._region], minlength=count)
        sizes[0] = 0
        is_large = sizes >= max(1.0, ROOMY_SHARE * sizes.max())
        large = is_large[labels].view(np.uint8)
        roomy: _Mask = cv2.dilate(large, np.ones((3, 3), np.uint8)).view(np.bool_)
        return roomy


def turning_of(
    row: CatalogueRow, environment: Environment, terrains: Terrains, region: _Mask
) -> Turning | None:
    """Return how a row's artefacts turn, None if they do not move or do not turn on the spot."""
    if row.motion.speed_mps <= 0.0 or row.motion.turn_radius_m > 0.0:
        return None
    body = Body.of(row)
    return Turning(terrains.of(environment, body.height_m), body.radius_m, region)


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
