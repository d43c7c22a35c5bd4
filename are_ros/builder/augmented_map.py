"""The augmented map (§3.3): the real map's bytes, with 100 in the cells of artefacts."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder._patches import PatchLedger, rectangles
from are_ros.builder.registration import CellPatch
from are_ros.conventions import NS_PER_S, OCCUPIED
from are_ros.errors import InputError, ParameterError

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
