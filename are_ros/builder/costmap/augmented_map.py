"""The augmented map and costmap, updated where the cells of artefacts change (section 3.3).

The gate at the end chooses the artefacts.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder.costmap.inflation import InflatedCostmap
from are_ros.builder.costmap.registration import (
    CellPatch,
    PatchChanges,
    patch_changes,
    rectangles,
)
from are_ros.conventions import NS_PER_S, OCCUPIED
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
    """A real map with artefacts in it: byte-equal to it outside their cells, 100 inside.

    Nothing is inflated, for Nav2 reads 1..99 as free. The real cells (h, w) are copied.
    """

    def __init__(self, real: Cells) -> None:
        self._shape = (real.shape[0], real.shape[1])
        self._real, self._next, self._cells = real.copy(), real.copy(), real.copy()
        self._changed: ChangedRectangle | None = ChangedRectangle(0, 0, *self._shape)
        self._is_first = True

    def update(self, changes: PatchChanges) -> None:
        """Take how the artefacts' cells changed.

        Patches may overlap each other and occupied or unknown cells; they lie within the grid.
        """
        for each in changes.vacated:
            np.copyto(each.part_of(self._next), each.part_of(self._real), where=each.mask)
        for each in changes.to_stamp(0, self._shape):
            np.copyto(each.part_of(self._next), np.int8(OCCUPIED), where=each.mask)
        places = rectangles((*changes.vacated, *changes.arrived), 0, self._shape)
        changed = ChangedRectangle(*_settle(self._next, self._cells, places))
        if changed.height > 0:
            self._changed = changed.united(self._changed)

    @property
    def is_changed(self) -> bool:
        """Whether a byte changed since the last `take`; true before the first."""
        return self._changed is not None

    def take(
        self, now_ns: int, real: OccupancyGrid
    ) -> tuple[OccupancyGrid | None, "GridUpdate | None"]:
        """Return a copy of the map, and the smallest rectangle that changed since the last call.

        None for both if no byte did. The first call gives the map without a rectangle. `real` has
        the geometry.
        """
        where, is_first = self._changed, self._is_first
        self._changed, self._is_first = None, False
        if where is None:
            return None, None
        grid = _like(real, now_ns, self._cells.copy())
        if is_first:
            return grid, None
        return grid, GridUpdate(real.frame_id, now_ns, where, where.of(grid.cells).copy())

    @property
    def cells(self) -> Cells:
        """The augmented map, int8 (h, w): a read-only view that the next update changes."""
        view: Cells = self._cells.view()
        view.flags.writeable = False
        return view


class RateLimit:
    """Lets changes out at most `max_rate_hz` times a second of the ticks' time, and loses none."""

    def __init__(self, max_rate_hz: float) -> None:
        self.set_rate(max_rate_hz)
        self._last_ns: int | None = None
        self._is_pending = False

    def set_rate(self, max_rate_hz: float) -> None:
        """Let another rate hold from now on; a change that waits goes on waiting."""
        self._interval_ns = math.ceil(NS_PER_S / max_rate_hz)

    def allows(self, now_ns: int, changed: bool, at_once: bool = False) -> bool:
        """Return whether to publish at `now_ns`: there is a change, and the interval is over.

        A change that comes too early is remembered, and goes out at the first call that is not, or
        that is `at_once`. A clock that jumped back starts a new interval.
        """
        self._is_pending |= changed
        is_early = self._last_ns is not None and 0 <= now_ns - self._last_ns < self._interval_ns
        if not self._is_pending or (is_early and not at_once):
            return False
        self._last_ns, self._is_pending = now_ns, False
        return True


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

    The rate is limited for artefacts that move. An artefact that appears in the grids, or goes from
    them, does so at that very tick: a navigation stack has to stop for it.
    """

    def __init__(self, costmap: InflatedCostmap, max_rate_hz: float) -> None:
        self._costmap = costmap
        self._map_limit = RateLimit(max_rate_hz)
        self._costmap_limit = RateLimit(max_rate_hz)
        self._real: OccupancyGrid | None = None
        self._patches: Mapping[int, CellPatch] = {}
        self._shown: frozenset[int] = frozenset()

    def limit_rate(self, max_rate_hz: float) -> None:
        """Let the moves of artefacts out at most so often from now on."""
        for limit in (self._map_limit, self._costmap_limit):
            limit.set_rate(max_rate_hz)

    def prepare(self, environment: Environment) -> None:
        """Take the real map and inflate it, if it is another one than before.

        A new cloud makes a new environment of the same map: the grids go on as they are.
        """
        classes, grid = environment.classes, environment.grid
        last, self._real = self._real, grid
        if last is not None and last.is_same_map(grid):
            return
        unknown = ~(classes.occupied | classes.free)
        self._map = AugmentedMap(grid.cells)
        self._artefacts = AugmentedMap(np.zeros_like(grid.cells))
        self._costmap.set_map(classes.occupied, unknown, grid.resolution_m)
        self._patches = {}

    def update(
        self, now_ns: int, environment: Environment, patches: Mapping[int, CellPatch]
    ) -> Grids:
        """Return the grids that go out at `now_ns`, with the admitted artefacts' cells by id.

        Both maps go out by one limit, so that at each tick what was published last of them shows
        the same artefacts.
        """
        ids = frozenset(patches)
        at_once, self._shown = ids != self._shown, ids
        costmap_changed = self._place(environment, patches)
        map_changed = self._map.is_changed or self._artefacts.is_changed
        grid = environment.grid
        augmented_map = update = artefact_map = artefact_update = costmap = None
        if self._map_limit.allows(now_ns, map_changed, at_once):
            augmented_map, update = self._map.take(now_ns, grid)
            artefact_map, artefact_update = self._artefacts.take(now_ns, grid)
        if self._costmap_limit.allows(now_ns, costmap_changed, at_once):
            costmap = _like(grid, now_ns, self._costmap.published().copy())
        return Grids(augmented_map, update, artefact_map, artefact_update, costmap)

    def bare(self, now_ns: int, environment: Environment) -> Grids:
        """Return all grids without artefacts, whatever went out before and when."""
        self._place(environment, {})
        self._shown, grid = frozenset(), environment.grid
        for layer in (self._map, self._artefacts):
            layer.take(now_ns, grid)
        return Grids(
            augmented_map=_like(grid, now_ns, grid.cells.copy()),
            artefact_map=_like(grid, now_ns, np.zeros_like(grid.cells)),
            costmap=_like(grid, now_ns, self._costmap.published().copy()),
        )

    def _place(self, environment: Environment, patches: Mapping[int, CellPatch]) -> bool:
        """Take the artefacts' cells into all layers; return whether the costmap changed."""
        self.prepare(environment)
        changes, self._patches = patch_changes(self._patches, patches), {**patches}
        self._map.update(changes)
        self._artefacts.update(changes)
        return self._costmap.update(changes)


def without_artefacts(real: OccupancyGrid) -> OccupancyGrid:
    """Return the artefact map that shows none: 0 everywhere, also where the real map is unknown."""
    return _like(real, real.stamp_ns, np.zeros_like(real.cells))


def _like(grid: OccupancyGrid, stamp_ns: int, cells: np.ndarray) -> OccupancyGrid:
    return OccupancyGrid(cells, grid.resolution_m, grid.origin, grid.frame_id, stamp_ns)


# Which artefacts the grids show unless costmap.gate says all (section 3.3).


class GateMemory:
    """Admits the perceived, and for a while those that were: the paper's A_f at memory 0.

    An artefact last perceived at t is admitted while now - t <= `memory_ns`; the end is included,
    so that a memory of 0 means only now. It may change at any time.
    """

    def __init__(self, memory_ns: int) -> None:
        self.memory_ns = memory_ns
        self._last_seen_ns: dict[int, int] = {}
        self._now_ns: int | None = None

    def admitted(
        self, now_ns: int, perceived_ns: Mapping[int, int], alive_ids: Iterable[int]
    ) -> tuple[int, ...]:
        """Return the ids of the living seen recently enough, ascending.

        `perceived_ns` is when those perceived now were seen, by id. The departed are forgotten at
        once; a clock that jumped back forgets everything seen before.
        """
        if self._now_ns is not None and now_ns < self._now_ns:
            self._last_seen_ns.clear()
        self._now_ns = now_ns
        last_ns = self._last_seen_ns
        last_ns.update(perceived_ns)
        self._last_seen_ns = {i: last_ns[i] for i in sorted(alive_ids) if i in last_ns}
        return tuple(
            i
            for i, ns in self._last_seen_ns.items()
            if i in perceived_ns or now_ns - ns <= self.memory_ns
        )
