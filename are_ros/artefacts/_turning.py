"""Where an artefact that turns on the spot can do so: the disc that it sweeps meets no wall."""

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.motion.body import Body
from are_ros.artefacts.terrain import Terrain, Terrains, rolls
from are_ros.world.environment import Environment


class Turning:
    """The disc about F_A's point on the ground that holds a row's box, on the terrain it is on."""

    def __init__(self, terrain: Terrain, radius_m: float) -> None:
        self.radius_m = radius_m
        self._terrain = terrain

    @property
    def key(self) -> tuple[float, ...]:
        """What tells two of them apart in one environment, beside the shape of the box."""
        return (self.radius_m, self._terrain.height_m)

    def is_free_at(self, points_m: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        """Tell at which points (N, >= 2) of the map frame it meets no closed cell: bool (N,).

        Exact, and the law by which the traffic lets somebody end a move: `Terrain.sees` from a
        point to itself.
        """
        terrain = self._terrain
        return discs_are_free(terrain.clearance_m, terrain.lattice, points_m, self.radius_m)


def turning_of(row: CatalogueRow, environment: Environment, terrains: Terrains) -> Turning | None:
    """Return how a row's artefacts turn, None if they do not move or do not turn on the spot."""
    if row.motion.speed_mps <= 0.0 or row.motion.turn_radius_m > 0.0:
        return None
    body = Body.of(row)
    return Turning(terrains.of(environment, body.height_m), body.radius_m)


@compiled
def discs_are_free(
    field: npt.NDArray[np.float32],
    lattice: npt.NDArray[np.float64],
    points_m: npt.NDArray[np.float64],
    radius_m: float,
) -> npt.NDArray[np.bool_]:
    """Tell for each point (N, >= 2) whether the disc about it covers open cells only: bool (N,)."""
    free = np.empty(len(points_m), np.bool_)
    for k in range(len(points_m)):
        point_m = (points_m[k, 0], points_m[k, 1])
        free[k] = rolls(field, lattice, point_m, point_m, radius_m)
    return free
