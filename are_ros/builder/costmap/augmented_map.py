"""The augmented map and costmap, updated where the cells of artefacts change (section 3.3)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder.costmap.inflation import InflatedCostmap
from are_ros.builder.costmap.patches import PatchLedger, rectangles
from are_ros.builder.costmap.registration import CellPatch
from are_ros.conventions import NS_PER_S, OCCUPIED
from are_ros.errors import InputError, ParameterError
from are_ros.world.environment import Environment
from are_ros.world.occupancy_grid import OccupancyGrid

Cells = npt.NDArray[np.int8]


@dataclass(frozen=True)
class ChangedRectangle:
    """Cells of rows row0 <= r < row0 + height and columns col0 <= c < col0 + width.

    As map_msgs/OccupancyGridUpdate says it: x = col0, y = row0.
    """

    row0: int
    col0: int
    height: int
    width: int

    def united(self, other: "ChangedRectangle | None") -> "ChangedRectangle":
        """Return the smallest rectangle that holds both: changes that await their publication."""
        if other is None:
            return self
        row0, col0 = min(self.row0, other.row0), min(self.col0, other.col0)
        row1 = max(self.row0 + self.height, other.row0 + other.height)
        col1 = max(self.col0 + self.width, other.col0 + other.width)
        return ChangedRectangle(row0, col0, row1 - row0, col1 - col0)

    def of(self, cells: Cells) -> Cells:
        """Return a view of this part of a grid (h, w): an update's data, row by row."""
        rows = slice(self.row0, self.row0 + self.height)
        part: Cells = cells[rows, self.col0 : self.col0 + self.width]
        return part


class AugmentedMap:
    """The real map with artefacts in it: byte-equal to it outside their cells, 100 inside.

    Nothing is inflated, for Nav2 reads 1..99 as free. Before the first map it has no cells.
    """

    def __init__(self) -> None:
        self.set_map(np.zeros((0, 0), np.int8))

    def set_map(self, cells: Cells) -> None:
        """Take a new real map, int8 (h, w), copied; the artefacts are gone until the next update.

        InputError if it is not a grid of int8; the old map stays then.
        """
        if cells.ndim != 2 or cells.dtype != np.int8:
            raise InputError(
                f"map: cells of shape {cells.shape} and type {cells.dtype}, not a grid"
            )
        self._real = cells.copy()
        self._next, self._cells = cells.copy(), cells.copy()
        self._ledger = PatchLedger()
        self._is_new = True

    def update(self, patches: Mapping[int, CellPatch]) -> ChangedRectangle | None:
        """Take the artefacts' cells of now, by id; return the smallest rectangle that changed.

        None if no byte did; the whole grid at the first update after a map. Patches may overlap
        each other and occupied or unknown cells; they lie within the grid.
        """
        changes = self._ledger.exchange(patches)
        shape = (self._cells.shape[0], self._cells.shape[1])
        for each in changes.vacated:
            np.copyto(each.of(self._next), each.of(self._real), where=each.mask)
        for each in changes.to_stamp(0, shape):
            np.copyto(each.of(self._next), np.int8(OCCUPIED), where=each.mask)
        places = rectangles((*changes.vacated, *changes.arrived), 0, shape)
        changed = ChangedRectangle(*_settle(self._next, self._cells, places))
        was_new, self._is_new = self._is_new, False
        if was_new:
            return ChangedRectangle(0, 0, *shape)
        return changed if changed.height > 0 else None

    @property
    def cells(self) -> Cells:
        """The augmented map, int8 (h, w): a read-only view that the next update changes."""
        view: Cells = self._cells.view()
        view.flags.writeable = False
        return view


class RateLimit:
    """Lets changes out at most `max_rate_hz` times a second of the ticks' time, and loses none.

    ParameterError if the rate is not positive and finite.
    """

    def __init__(self, max_rate_hz: float) -> None:
        self.set_rate(max_rate_hz)
        self._last_ns: int | None = None
        self._is_pending = False

    def set_rate(self, max_rate_hz: float) -> None:
        """Let another rate hold from now on; a change that waits goes on waiting."""
        if not 0.0 < max_rate_hz < math.inf:
            raise ParameterError(f"max_rate {max_rate_hz} Hz is not positive and finite")
        self._interval_ns = math.ceil(NS_PER_S / max_rate_hz)

    def allows(self, now_ns: int, changed: bool, at_once: bool = False) -> bool:
        """Return whether to publish at `now_ns`: there is a change, and the interval is over.

        A change that comes too early is remembered, and goes out at the first call that is not, or
        that is `at_once`. A clock that jumped back starts a new interval.
        """
        self._is_pending |= changed
        if not self._is_pending or (self._is_early(now_ns) and not at_once):
            return False
        self._last_ns, self._is_pending = now_ns, False
        return True

    def _is_early(self, now_ns: int) -> bool:
        return self._last_ns is not None and 0 <= now_ns - self._last_ns < self._interval_ns


@compiled
def _settle(after: Cells, cells: Cells, places: npt.NDArray[np.int64]) -> tuple[int, int, int, int]:
    """Copy rectangles (N, 4) of `after` to `cells`; return row0, col0, height, width changed."""
    row0, col0, row1, col1 = cells.shape[0], cells.shape[1], 0, 0
    for i in range(places.shape[0]):
        for r in range(places[i, 0], places[i, 2]):
            for c in range(places[i, 1], places[i, 3]):
                if after[r, c] != cells[r, c]:
                    cells[r, c] = after[r, c]
                    row0, row1 = min(row0, r), max(row1, r + 1)
                    col0, col1 = min(col0, c), max(col1, c + 1)
    return row0, col0, max(row1 - row0, 0), max(col1 - col0, 0)


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
