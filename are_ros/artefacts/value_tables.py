"""Values of going to a place, by type and goal, kept as long as memory allows."""

import math
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts._step_kernels import Worth
from are_ros.artefacts.coarse_map import Cell, CoarseMap
from are_ros.artefacts.mdp import Problem, TravelModel, solve, travel_problem

KEPT_BYTES_PER_TABLE: Final = 2**20
"""Planes of all epochs need so much at most; a crowd with a hundred goals has to fit the budget."""

SHARED_CELLS: Final = 128 * 128
"""Windows up to this large serve all trips to a goal; of larger ones a trip takes its part."""

TRIP_MARGINS_M: Final = (4.0, 12.0)
"""How much wider than start and goal the parts are: the first in which no way is missed."""

_TRIP_STEP: Final = 4

Window = tuple[slice, slice]
Key = tuple[tuple[int, float, float, float], TravelModel, Cell, Cell, Cell]


@dataclass(frozen=True, eq=False)
class ValueTable:
    """What going to a goal is worth, within a window of h x w coarse cells.

    `corner` is the window's first cell (row, col) in the coarse map, `goal` the goal's. `goal_m`
    is the point in the map frame to end at. `planes` float32 (K, 4, h, w) by epochs left and
    heading; K = 1 if all planes up to the horizon would have needed more than a bound: then the
    values of the longest horizon serve for all. `lengths`, `gains`, `costs` as in
    `mdp.Problem`. `weights` float64 (9,) is what kernels take of the rest: the chances of going
    straight and to either side, prices of a quarter and a half turn, reach, corner, and the goal
    in the window.
    """

    planes: npt.NDArray[np.float32]
    lengths: npt.NDArray[np.uint8]
    gains: npt.NDArray[np.float32]
    costs: npt.NDArray[np.float32]
    corner: Cell
    goal: Cell
    goal_m: tuple[float, float]
    model: TravelModel
    weights: npt.NDArray[np.float64]

    @property
    def worth(self) -> Worth:
        """What kernels take of the table."""
        return Worth(self.planes, self.lengths, self.gains, self.costs, self.weights)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays."""
        arrays = (self.planes, self.lengths, self.gains, self.costs)
        return sum(array.nbytes for array in arrays)

    def cost(self, cell: Cell) -> float:
        """Return the price of the cheapest way from a coarse cell, inf if none is in the window."""
        row, col = cell[0] - self.corner[0], cell[1] - self.corner[1]
        inside = 0 <= row < self.costs.shape[0] and 0 <= col < self.costs.shape[1]
        return float(self.costs[row, col]) if inside else math.inf

    def reaches(self, cell: Cell) -> bool:
        """Tell whether the goal can be reached from a coarse cell, within the window."""
        return self.cost(cell) < math.inf

    def place(self, epochs_left: int) -> int:
        """Return which of the planes holds, or stands for, so many epochs left."""
        return max(0, min(epochs_left, len(self.planes) - 1))


class ValueTables:
    """Value tables by (map, type, goal cell, window); the least recently used go first."""

    def __init__(
        self,
        horizon: int = 60,
        max_trip_m: float = 60.0,
        budget_bytes: int = 256 * 2**20,
        kept_bytes: int = KEPT_BYTES_PER_TABLE,
    ) -> None:
        """Take the longest horizon [epochs]; on larger maps a window of two longest trips a side.

        A horizon whose epochs cost less than the turns of a type makes it rather stand than turn.
        `budget_bytes` bounds all tables together (the newest stays whatever it needs),
        `kept_bytes` the planes of one.
        """
        self._horizon = horizon
        self._max_trip_m = max_trip_m
        self._budget_bytes = budget_bytes
        self._kept_bytes = kept_bytes
        self._tables: OrderedDict[Key, ValueTable] = OrderedDict()
        self.nbytes = 0

    def __len__(self) -> int:
        return len(self._tables)

    def clear(self) -> None:
        """Forget all tables, as of a map that is no longer."""
        self._tables.clear()
        self.nbytes = 0

    def value(
        self,
        coarse: CoarseMap,
        model: TravelModel,
        goal_m: tuple[float, float],
        start: Cell | None = None,
    ) -> ValueTable | None:
        """Return the table of going to a point of the map frame; None if nobody can be near it.

        The table's `goal_m` is the point itself where the disc fits there, else the anchor of the
        cell that stands for it. On a large map one who starts at cell `start` gets a table of the
        cells between it and the goal and some metres about them, if it is sure that no way which
        leaves them is better.
        """
        goal = coarse.cell_of(*goal_m)
        if goal is None:
            return None
        window, table = self._window(coarse, goal), None
        if start is not None and _cells_in(window) > SHARED_CELLS:
            table = self._of_part(coarse, model, goal, window, start)
        if table is None:
            table = self._of(coarse, model, goal, window)
        if not coarse.holds(*goal_m):
            goal_m = coarse.anchor_of(goal)
        return table if table.goal_m == goal_m else replace(table, goal_m=goal_m)

    def _of_part(
        self, coarse: CoarseMap, model: TravelModel, goal: Cell, whole: Window, start: Cell
    ) -> ValueTable | None:
        """Return the table of the smallest part that holds the best way; None if none surely does.

        That depends on nothing but start and goal: not on which tables there are already.
        """
        for margin_m in TRIP_MARGINS_M:
            margin = math.ceil(margin_m / coarse.cell_size_m)
            window = _part(whole, goal, start, margin)
            if not _holds(window, start):
                return None
            known = self._tables.get(_key(coarse, model, goal, window))
            found = known or _problem(coarse, model, goal, window)
            cost = found.costs[start[0] - window[0].start, start[1] - window[1].start]
            if cost <= _least_outside(model, goal, start, margin):
                problem = found if isinstance(found, Problem) else None
                return self._of(coarse, model, goal, window, problem)
        return None

    def _of(
        self,
        coarse: CoarseMap,
        model: TravelModel,
        goal: Cell,
        window: Window,
        problem: Problem | None = None,
    ) -> ValueTable:
        """Return the table of a window, whose problem may be known."""
        key = _key(coarse, model, goal, window)
        if key not in self._tables:
            problem = problem or _problem(coarse, model, goal, window)
            self._insert(key, self._made(coarse, problem, key[3], goal))
        self._tables.move_to_end(key)
        return self._tables[key]

    def _window(self, coarse: CoarseMap, goal: Cell) -> Window:
        reach = math.ceil(self._max_trip_m / coarse.cell_size_m)
        rows, cols = (
            slice(max(0, at - reach), min(size, at + reach + 1))
            for at, size in zip(goal, coarse.shape, strict=True)
        )
        return rows, cols

    def _made(self, coarse: CoarseMap, problem: Problem, corner: Cell, goal: Cell) -> ValueTable:
        solution = solve(problem, self._horizon, self._kept_bytes)
        return ValueTable(
            planes=solution.planes,
            lengths=problem.lengths,
            gains=problem.gains,
            costs=problem.costs,
            corner=corner,
            goal=goal,
            goal_m=coarse.anchor_of(goal),
            model=problem.model,
            weights=_weights(problem.model, corner, problem.goal),
        )

    def _insert(self, key: Key, table: ValueTable) -> None:
        self._tables[key] = table
        self.nbytes += table.nbytes
        while self.nbytes > self._budget_bytes and len(self._tables) > 1:
            _, oldest = self._tables.popitem(last=False)
            self.nbytes -= oldest.nbytes


def _key(coarse: CoarseMap, model: TravelModel, goal: Cell, window: Window) -> Key:
    rows, cols = window
    return coarse.key, model, goal, (rows.start, cols.start), (rows.stop, cols.stop)


def _problem(coarse: CoarseMap, model: TravelModel, goal: Cell, window: Window) -> Problem:
    inner = (goal[0] - window[0].start, goal[1] - window[1].start)
    return travel_problem(windowed_edges(coarse, window), coarse.nearness[window], inner, model)


def _cells_in(window: Window) -> int:
    """Return how many cells a window has."""
    rows, cols = window
    return int((rows.stop - rows.start) * (cols.stop - cols.start))


def _holds(window: Window, cell: Cell) -> bool:
    return all(part.start <= at < part.stop for part, at in zip(window, cell, strict=True))


def _part(whole: Window, goal: Cell, start: Cell, margin: int) -> Window:
    """Return the part of a window about a goal and a start, in steps of 4 cells: some share it."""
    rows, cols = (
        slice(
            max(size.start, (min(ends) - margin) // _TRIP_STEP * _TRIP_STEP),
            min(size.stop, -(-(max(ends) + margin + 1) // _TRIP_STEP) * _TRIP_STEP),
        )
        for size, *ends in zip(whole, goal, start, strict=True)
    )
    return rows, cols


def _least_outside(model: TravelModel, goal: Cell, start: Cell, margin: int) -> float:
    """Return what any way costs at least that leaves the part about a start and a goal.

    It goes as far aside as the part is wide, and back, and no step is cheaper than its time.
    """
    steps = abs(goal[0] - start[0]) + abs(goal[1] - start[1]) + 2 * (margin + 1)
    return steps * model.time / model.reach


def _weights(model: TravelModel, corner: Cell, goal: Cell) -> npt.NDArray[np.float64]:
    chances = (1.0 - 2.0 * model.slip, model.slip)
    turns = (model.quarter_turn, model.half_turn)
    return np.array([*chances, *turns, model.reach, *corner, *goal], np.float64)


def windowed_edges(coarse: CoarseMap, window: Window) -> npt.NDArray[np.bool_]:
    """Return the edges bool (4, h, w) of a window, closed where they would lead out of it."""
    edges: npt.NDArray[np.bool_] = coarse.edges[:, window[0], window[1]].copy()
    edges[0, :, -1] = edges[1, -1, :] = edges[2, :, 0] = edges[3, 0, :] = False
    return edges
