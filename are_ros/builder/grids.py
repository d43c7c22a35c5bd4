"""The augmented map and the inflated costmap that go out, on change and at most so often."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from are_ros.builder.augmented_map import AugmentedMap, ChangedRectangle, RateLimit
from are_ros.builder.costmap import InflatedCostmap
from are_ros.builder.registration import CellPatch
from are_ros.world.environment import Environment
from are_ros.world.occupancy_grid import OccupancyGrid


@dataclass(frozen=True, eq=False)
class GridUpdate:
    """The part of the augmented map that changed: cells [row0, ...) x [col0, ...), int8 (h, w)."""

    frame_id: str
    stamp_ns: int
    rectangle: ChangedRectangle
    cells: "np.ndarray[tuple[int, ...], np.dtype[np.int8]]"


@dataclass(frozen=True, eq=False)
class Grids:
    """What goes out at a tick; None where nothing does.

    `augmented_map` and `costmap` hold copies, with the geometry of the real map. `update` is the
    smallest rectangle that holds all changes of the map since the last one that went out; there is
    none with the first map of a geometry.
    """

    augmented_map: OccupancyGrid | None = None
    update: GridUpdate | None = None
    costmap: OccupancyGrid | None = None


class GridAugmentation:
    """Keeps both grids in step with the environment and with the artefacts that the gate admits."""

    def __init__(self, costmap: InflatedCostmap, max_rate_hz: float) -> None:
        self._map = AugmentedMap()
        self._costmap = costmap
        self._map_limit = RateLimit(max_rate_hz)
        self._costmap_limit = RateLimit(max_rate_hz)
        self._environment: Environment | None = None
        self._changed: ChangedRectangle | None = None
        self._is_first = True

    def limit_rate(self, max_rate_hz: float) -> None:
        """Let grids out at most so often from now on."""
        for limit in (self._map_limit, self._costmap_limit):
            limit.set_rate(max_rate_hz)

    def update(
        self, now_ns: int, environment: Environment, patches: Mapping[int, CellPatch]
    ) -> Grids:
        """Return the grids that go out at `now_ns`, with the admitted artefacts' cells by id."""
        self.prepare(environment)
        changed = self._map.update(patches)
        self._changed = changed.united(self._changed) if changed else self._changed
        costmap_changed = self._costmap.update(patches)
        augmented_map = update = costmap = None
        if self._map_limit.allows(now_ns, changed=changed is not None) and self._changed:
            augmented_map = _like(environment.grid, now_ns, self._map.cells.copy())
            update = None if self._is_first else self._update(now_ns, environment, self._changed)
            self._changed, self._is_first = None, False
        if self._costmap_limit.allows(now_ns, changed=costmap_changed):
            costmap = _like(environment.grid, now_ns, self._costmap.published().copy())
        return Grids(augmented_map, update, costmap)

    def bare(self, now_ns: int, environment: Environment) -> Grids:
        """Return both grids without artefacts, whatever went out before and when."""
        self.prepare(environment)
        self._map.update({})
        self._costmap.update({})
        self._changed, self._is_first = None, True
        cells, costs = self._map.cells.copy(), self._costmap.published().copy()
        grid = environment.grid
        return Grids(_like(grid, now_ns, cells), None, _like(grid, now_ns, costs))

    def _update(self, now_ns: int, environment: Environment, where: ChangedRectangle) -> GridUpdate:
        cells = where.of(self._map.cells).copy()
        return GridUpdate(environment.grid.frame_id, now_ns, where, cells)

    def prepare(self, environment: Environment) -> None:
        """Inflate the real map, if it is another one than before."""
        if self._environment is environment:
            return
        classes, grid = environment.classes, environment.grid
        unknown = ~(classes.occupied | classes.free)
        self._map.set_map(grid.cells)
        self._costmap.set_map(classes.occupied, unknown, grid.resolution_m)
        self._environment, self._changed, self._is_first = environment, None, True


def _like(grid: OccupancyGrid, stamp_ns: int, cells: np.ndarray) -> OccupancyGrid:
    return OccupancyGrid(cells, grid.resolution_m, grid.origin, grid.frame_id, stamp_ns)
