"""The maps and the inflated costmap that go out: on change, and moves at most so often."""

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
    """The part of a map that changed: cells [row0, ...) x [col0, ...), int8 (h, w)."""

    frame_id: str
    stamp_ns: int
    rectangle: ChangedRectangle
    cells: "np.ndarray[tuple[int, ...], np.dtype[np.int8]]"


@dataclass(frozen=True, eq=False)
class Grids:
    """What goes out at a tick; None where nothing does.

    `augmented_map`, `artefact_map` and `costmap` hold copies, with the geometry of the real map.
    `update` and `artefact_update` are the smallest rectangles that hold all changes of the two maps
    since the last one that went out; there is none with the first map of a geometry.
    """

    augmented_map: OccupancyGrid | None = None
    update: GridUpdate | None = None
    artefact_map: OccupancyGrid | None = None
    artefact_update: GridUpdate | None = None
    costmap: OccupancyGrid | None = None


class GridAugmentation:
    """Keeps the grids in step with the environment and with the artefacts that the gate admits.

    The rate is limited for artefacts that move. Who appears in the grids, or goes from them, does
    so at the very tick: a navigation stack has to stop for it.
    """

    def __init__(self, costmap: InflatedCostmap, max_rate_hz: float) -> None:
        self._map, self._artefacts = _LimitedMap(), _LimitedMap()
        self._costmap = costmap
        self._map_limit = RateLimit(max_rate_hz)
        self._costmap_limit = RateLimit(max_rate_hz)
        self._environment: Environment | None = None
        self._shown: frozenset[int] = frozenset()

    def limit_rate(self, max_rate_hz: float) -> None:
        """Let the moves of artefacts out at most so often from now on."""
        for limit in (self._map_limit, self._costmap_limit):
            limit.set_rate(max_rate_hz)

    def update(
        self, now_ns: int, environment: Environment, patches: Mapping[int, CellPatch]
    ) -> Grids:
        """Return the grids that go out at `now_ns`, with the admitted artefacts' cells by id.

        Both maps go out by one limit, so that at each tick what was published last of them shows
        the same artefacts.
        """
        self.prepare(environment)
        ids = frozenset(patches)
        at_once, self._shown = ids != self._shown, ids
        grid, changed = environment.grid, False
        for layer in (self._map, self._artefacts):
            changed |= layer.update(patches)
        costmap_changed = self._costmap.update(patches)
        augmented_map = update = artefact_map = artefact_update = costmap = None
        if self._map_limit.allows(now_ns, changed, at_once):
            augmented_map, update = self._map.take(now_ns, grid)
            artefact_map, artefact_update = self._artefacts.take(now_ns, grid)
        if self._costmap_limit.allows(now_ns, costmap_changed, at_once):
            costmap = _like(grid, now_ns, self._costmap.published().copy())
        return Grids(augmented_map, update, artefact_map, artefact_update, costmap)

    def bare(self, now_ns: int, environment: Environment) -> Grids:
        """Return all grids without artefacts, whatever went out before and when."""
        self.prepare(environment)
        self._costmap.update({})
        self._shown = frozenset()
        grid, costs = environment.grid, self._costmap.published().copy()
        return Grids(
            augmented_map=self._map.bare(now_ns, grid),
            artefact_map=self._artefacts.bare(now_ns, grid),
            costmap=_like(grid, now_ns, costs),
        )

    def prepare(self, environment: Environment) -> None:
        """Inflate the real map, if it is another one than before."""
        if self._environment is environment:
            return
        classes, grid = environment.classes, environment.grid
        unknown = ~(classes.occupied | classes.free)
        self._map.set_map(grid.cells)
        self._artefacts.set_map(without_artefacts(grid).cells)
        self._costmap.set_map(classes.occupied, unknown, grid.resolution_m)
        self._environment = environment


def without_artefacts(real: OccupancyGrid) -> OccupancyGrid:
    """Return the artefact map that shows none: 0 everywhere, also where the real map is unknown."""
    return _like(real, real.stamp_ns, np.zeros_like(real.cells))


class _LimitedMap:
    """A map with artefacts in it, and what of it changed since it last went out."""

    def __init__(self) -> None:
        self._map = AugmentedMap()
        self._changed: ChangedRectangle | None = None
        self._is_first = True

    def set_map(self, cells: "np.ndarray[tuple[int, ...], np.dtype[np.int8]]") -> None:
        """Take other cells without artefacts."""
        self._map.set_map(cells)
        self._changed, self._is_first = None, True

    def update(self, patches: Mapping[int, CellPatch]) -> bool:
        """Take the artefacts' cells of now, by id; return whether some cell changed."""
        changed = self._map.update(patches)
        self._changed = changed.united(self._changed) if changed else self._changed
        return changed is not None

    def take(
        self, now_ns: int, real: OccupancyGrid
    ) -> tuple[OccupancyGrid | None, GridUpdate | None]:
        """Return the map that goes out, and the part of it that changed, if there is one."""
        where, is_first = self._changed, self._is_first
        if where is None:
            return None, None
        self._changed, self._is_first = None, False
        cells = self._map.cells
        update = GridUpdate(real.frame_id, now_ns, where, where.of(cells).copy())
        return _like(real, now_ns, cells.copy()), None if is_first else update

    def bare(self, now_ns: int, real: OccupancyGrid) -> OccupancyGrid:
        """Return the map without artefacts."""
        self._map.update({})
        self._changed, self._is_first = None, True
        return _like(real, now_ns, self._map.cells.copy())


def _like(grid: OccupancyGrid, stamp_ns: int, cells: np.ndarray) -> OccupancyGrid:
    return OccupancyGrid(cells, grid.resolution_m, grid.origin, grid.frame_id, stamp_ns)
