"""The ground of the newest environment for the kernels, one layer for each height of bodies."""

from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.motion._state import Floor
from are_ros.artefacts.terrain import HEIGHT_STEP_M, Terrains, has_own_voxels
from are_ros.world.environment import Environment
from are_ros.world.lattice_cover import lattice_row


class Floors:
    """Remembers which heights there are, and lays the floor for them."""

    def __init__(self, terrains: Terrains) -> None:
        self._terrains = terrains
        self._levels: list[int] = []
        self._environment: Environment | None = None
        self._floor: Floor | None = None

    def level_of(self, height_m: float) -> int:
        """Return which layer is that of a body's height, rounded up to 0.25 m."""
        steps = int(np.ceil(height_m / HEIGHT_STEP_M))
        if steps not in self._levels:
            self._levels.append(steps)
            self._floor = None
        return self._levels.index(steps)

    def of(self, environment: Environment) -> tuple[bool, Floor]:
        """Return whether the environment is new, and its floor."""
        is_new = environment is not self._environment
        if is_new or self._floor is None:
            self._environment = environment
            self._floor = self._lay(environment)
        return is_new, self._floor

    def _lay(self, environment: Environment) -> Floor:
        grid, levels = environment.grid, self._levels or [1]
        terrains = [self._terrains.of(environment, HEIGHT_STEP_M * level) for level in levels]
        if not has_own_voxels(environment):  # all layers are one
            del terrains[1:]
        clearance, solid = terrains[0].clearance_m[None], terrains[0].solid[None]
        if len(terrains) > 1:
            clearance = _frozen(np.stack([terrain.clearance_m for terrain in terrains]))
            solid = _frozen(np.stack([terrain.solid for terrain in terrains]))
        unit = grid.resolution_m
        return Floor(clearance, solid, lattice_row(grid.origin, unit, unit), unit)


def _frozen(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    array.flags.writeable = False
    return array
