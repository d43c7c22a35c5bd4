"""The ground of the newest environment for the kernels, one layer for each height of bodies."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.motion._state import Floor
from are_ros.artefacts.terrain import HEIGHT_STEP_M, Terrains, has_own_voxels
from are_ros.world.environment import Environment
from are_ros.world.lattice_cover import lattice_row


class Floors:
    """Lays the floor of an environment for the heights that there are."""

    def __init__(self, terrains: Terrains) -> None:
        self._terrains = terrains
        self._environment: Environment | None = None
        self._levels: list[int] = []
        self._floor: Floor | None = None

    def of(self, environment: Environment, levels: Sequence[int]) -> tuple[bool, Floor]:
        """Return whether the environment is new, and its floor, a layer for each level of height.

        Levels are heights in steps of `HEIGHT_STEP_M`.
        """
        is_new = environment is not self._environment
        if is_new or self._floor is None or self._levels != levels:
            self._environment, self._levels = environment, list(levels)
            self._floor = self._lay(environment, levels or [1])
        return is_new, self._floor

    def _lay(self, environment: Environment, levels: Sequence[int]) -> Floor:
        grid = environment.grid
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
