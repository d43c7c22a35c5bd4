"""Value tables of the decision process by type and goal, kept up to a bound of memory."""

import math
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.mdp.coarse_map import Cell, CoarseMap
from are_ros.agents.mdp.model import (
    TravelModel,
    Ways,
    Window,
    price_in,
    problem_of,
    solve,
    ways_to,
)
from are_ros.agents.mdp.routes import ValueArrays

KEPT_BYTES_PER_TABLE: Final = 2**17
"""Planes of the last epochs are kept up to this size, at least that of the longest horizon."""

SWEPT_EPOCHS: Final = 8
"""So many planes are computed again at once: the decisions of an agent ask for one by one."""

NEVER_SETTLED: Final = 255

SHARED_CELLS: Final = 128 * 128
"""A window up to this size serves all trips to a goal; in a larger one, a trip uses a part.

The table of a part is not kept: hardly two trips share one."""

TRIP_MARGINS_M: Final = (2.0, 4.0, 12.0)
"""Margins of such parts about start and goal: the first one that loses no better way is used."""

TableKey = tuple[tuple[int, float, float, float], TravelModel, Cell, Window, int]
"""The coarse map's key, the model, the goal's cell, the window, and the longest horizon."""


@dataclass(frozen=True, eq=False)
class ValueTable:
    """The values of going to a goal, within a window of h x w coarse cells.

    `goal_m` is the end point in the map frame. `planes` float32 (K, 4, h, w) are the values of the
    last K epochs as in `model.Solution`: all, if that does not need too much memory. `epochs` are
    the last epoch computed and the longest horizon for which that holds. The last plane also holds
    for earlier epochs, from `settled` uint8 (h, w) on in each cell (255: for no other). `lengths`
    and `costs` as in `model.Ways`, `nearness` float32 (H, W) is the whole map's.
    """

    planes: npt.NDArray[np.float32]
    epochs: tuple[int, int]
    settled: npt.NDArray[np.uint8]
    lengths: npt.NDArray[np.uint8]
    costs: npt.NDArray[np.float32]
    nearness: npt.NDArray[np.float32]
    key: TableKey
    goal_m: tuple[float, float]

    @property
    def goal(self) -> Cell:
        """The goal's cell in the coarse map."""
        return self.key[2]

    @property
    def corner(self) -> Cell:
        """The window's first cell in the coarse map."""
        return self.key[3][0]

    @property
    def model(self) -> TravelModel:
        """The model of the type."""
        return self.key[1]

    @property
    def ways(self) -> Ways:
        """The ways to the goal."""
        _, model, goal, window, _ = self.key
        price = price_in(self.nearness, model, window)
        goal = goal[0] - self.corner[0], goal[1] - self.corner[1]
        return Ways(self.lengths, price, self.costs, goal, model)

    @property
    def value_arrays(self) -> ValueArrays:
        """The arrays that kernels take."""
        model = self.model
        return ValueArrays(
            self.planes,
            self.epochs,
            self.settled,
            self.lengths,
            self.costs,
            self.nearness,
            np.column_stack((model.reaches, model.effort)),
            (model.time, model.clearance, model.rest),
            model.chances,
            (0.0, model.quarter_turn, model.half_turn, model.quarter_turn),
            self.corner,
            (self.goal[0] - self.corner[0], self.goal[1] - self.corner[1]),
        )

    @property
    def nbytes(self) -> int:
        """Memory of the arrays."""
        arrays = (self.planes, self.settled, self.lengths, self.costs)
        return sum(array.nbytes for array in arrays)

    def cost(self, cell: Cell) -> float:
        """Return the cost of the cheapest way from a coarse cell; inf if the window has none."""
        row, col = cell[0] - self.corner[0], cell[1] - self.corner[1]
        inside = 0 <= row < self.costs.shape[0] and 0 <= col < self.costs.shape[1]
        return float(self.costs[row, col]) if inside else math.inf

    def reaches(self, cell: Cell) -> bool:
        """Return whether the goal can be reached from a coarse cell, within the window."""
        return self.cost(cell) < math.inf


class ValueTables:
    """Value tables by (map, model, goal cell, window), least recently used dropped first.

    `nbytes` is the memory of those that are kept: all but tables of single trips.
    """

    def __init__(
        self,
        horizon: int = 60,
        max_trip_m: float = 60.0,
        budget_bytes: int = 256 * 2**20,
        kept_bytes: int = KEPT_BYTES_PER_TABLE,
    ) -> None:
        """Take the longest trip and horizon [epochs], beyond those that a decision looks ahead.

        A window is two longest trips wide; that of a trip that is longer is the whole map.

        If the epochs of a horizon cost less than the turns of a type, it stands rather than turns.
        `budget_bytes` bounds the tables that are kept, but for the newest one; `kept_bytes` bounds
        the planes of one table.
        """
        self._horizon = horizon
        self._max_trip_m = max_trip_m
        self._budget_bytes = budget_bytes
        self._kept_bytes = kept_bytes
        self._tables: OrderedDict[TableKey, ValueTable] = OrderedDict()
        self.nbytes = 0

    def __len__(self) -> int:
        return len(self._tables)

    def clear(self) -> None:
        """Drop all tables: the map has changed."""
        self._tables.clear()
        self.nbytes = 0

    def value(
        self,
        coarse: CoarseMap,
        model: TravelModel,
        goal_m: tuple[float, float],
        start: Cell | None = None,
        epochs_left: int | None = None,
    ) -> ValueTable | None:
        """Return the table for a goal in the map frame; None if no open cell is near it.

        The table's `goal_m` is the goal itself if the disc fits there, else the anchor of its cell.
        On a large map, a trip from cell `start` gets a table of the cells about start and goal
        only, if no way that leaves them can be better, and up to `epochs_left` only.
        """
        goal = coarse.cell_of(*goal_m)
        if goal is None:
            return None
        if not coarse.holds(*goal_m):
            goal_m = coarse.anchor_of(goal)
        window, table = self._window(coarse, goal, start), None
        if start is not None and _cells_in(window) > SHARED_CELLS:
            left = self._horizon if epochs_left is None else min(epochs_left, self._horizon)
            table = self._of_part(coarse, model, goal, window, start, goal_m, left)
        if table is None:
            key = (coarse.key, model, goal, window, self._horizon)
            table = self._kept(coarse, key, goal_m)
        return table if table.goal_m == goal_m else replace(table, goal_m=goal_m)

    def _of_part(
        self,
        coarse: CoarseMap,
        model: TravelModel,
        goal: Cell,
        whole: Window,
        start: Cell,
        goal_m: tuple[float, float],
        horizon: int,
    ) -> ValueTable | None:
        """Return the table of the smallest part that certainly has the best way, None without."""
        for margin_m in TRIP_MARGINS_M:
            margin = math.ceil(margin_m / coarse.cell_size_m)
            window = _part(whole, goal, start, margin)
            if not _holds(window, start):
                return None
            ways = ways_to(coarse.edges, coarse.nearness, goal, model, window)
            row, col = window[0]
            cost = ways.costs[start[0] - row, start[1] - col]
            if cost <= _least_outside(model, goal, start, margin):
                key = (coarse.key, model, goal, window, horizon)
                return self._solved(coarse, key, ways, goal_m)
        return None

    def _kept(self, coarse: CoarseMap, key: TableKey, goal_m: tuple[float, float]) -> ValueTable:
        """Return the table of a key; a new one has `goal_m` as its end point, and is kept."""
        table = self._tables.get(key)
        if table is not None:
            self._tables.move_to_end(key)
            return table
        _, model, goal, window, _ = key
        ways = ways_to(coarse.edges, coarse.nearness, goal, model, window)
        table = self._tables[key] = self._solved(coarse, key, ways, goal_m)
        self.nbytes += table.nbytes
        while self.nbytes > self._budget_bytes and len(self._tables) > 1:
            _, oldest = self._tables.popitem(last=False)
            self.nbytes -= oldest.nbytes
        return table

    def _solved(
        self, coarse: CoarseMap, key: TableKey, ways: Ways, goal_m: tuple[float, float]
    ) -> ValueTable:
        """Return the table that follows from the ways to a goal."""
        solution = solve(problem_of(ways), key[-1], self._kept_bytes)
        return ValueTable(
            planes=solution.planes,
            epochs=(solution.epochs, key[-1]),
            settled=_settled(solution.settled),
            lengths=ways.lengths,
            costs=ways.costs,
            nearness=coarse.nearness,
            key=key,
            goal_m=goal_m,
        )

    def _window(self, coarse: CoarseMap, goal: Cell, start: Cell | None) -> Window:
        """Return the cells about a goal; all cells for a start that is not among them."""
        whole: Window = (0, 0), coarse.shape
        window = _part(whole, goal, goal, math.ceil(self._max_trip_m / coarse.cell_size_m))
        return window if start is None or _holds(window, start) else whole


def swept(table: ValueTable, epochs_left: int) -> ValueTable:
    """Return a table with the planes of `SWEPT_EPOCHS` epochs computed again, that one too."""
    last = epochs_left - epochs_left % SWEPT_EPOCHS + SWEPT_EPOCHS - 1
    found = solve(problem_of(table.ways), last, 16 * SWEPT_EPOCHS * table.costs.size)
    # the last one holds since it is settled with these epochs, which may be more than before
    return replace(
        table, planes=found.planes, epochs=(found.epochs, last), settled=_settled(found.settled)
    )


def _settled(epochs: npt.NDArray[np.int32]) -> npt.NDArray[np.uint8]:
    """Return since which epoch each cell is settled, as `ValueTable` has it."""
    return np.minimum(epochs, NEVER_SETTLED).astype(np.uint8)


def _cells_in(window: Window) -> int:
    """Return how many cells a window has."""
    (row, col), (end_row, end_col) = window
    return (end_row - row) * (end_col - col)


def _holds(window: Window, cell: Cell) -> bool:
    (row, col), (end_row, end_col) = window
    return row <= cell[0] < end_row and col <= cell[1] < end_col


def _part(whole: Window, goal: Cell, start: Cell, margin: int) -> Window:
    """Return the part of a window about a goal and a start, with a margin [cells]."""
    (row, col), (end_row, end_col) = whole
    rows, cols = (goal[0], start[0]), (goal[1], start[1])
    corner = (max(row, min(rows) - margin), max(col, min(cols) - margin))
    return corner, (min(end_row, max(rows) + margin + 1), min(end_col, max(cols) + margin + 1))


def _least_outside(model: TravelModel, goal: Cell, start: Cell, margin: int) -> float:
    """Return the least cost of a way that leaves the part about a start and a goal.

    It crosses the margin twice, and no step is cheaper than its time.
    """
    steps = abs(goal[0] - start[0]) + abs(goal[1] - start[1]) + 2 * (margin + 1)
    return steps * model.time / model.reaches[0]
