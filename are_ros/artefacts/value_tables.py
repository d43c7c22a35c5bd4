"""Values of going to a place, by type and goal, kept as long as memory allows."""

import math
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.coarse_map import WALL_COMFORT_M, Cell, CoarseMap
from are_ros.artefacts.mdp import TravelModel, solve, travel_problem

KEPT_BYTES_PER_TABLE: Final = 2**20
"""Planes of all epochs need so much at most; a crowd with a hundred goals has to fit the budget."""

SHARED_CELLS: Final = 128 * 128
"""Windows up to this large serve all trips to a goal; of larger ones a trip takes its part."""

TRIP_MARGIN_M: Final = 8.0
_TRIP_STEP: Final = 8

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
        cells between it and the goal and 8 m about them, if a way leads through these.
        """
        goal = coarse.cell_of(*goal_m)
        if goal is None:
            return None
        window = self._window(coarse, goal)
        table = None
        if start is not None and _cells_in(window) > SHARED_CELLS:
            table = self._of(coarse, model, goal, _part(window, goal, start, coarse.cell_size_m))
        if table is None or start is None or not table.reaches(start):
            table = self._of(coarse, model, goal, window)
        if not coarse.holds(*goal_m):
            goal_m = coarse.anchor_of(goal)
        return table if table.goal_m == goal_m else replace(table, goal_m=goal_m)

    def _of(self, coarse: CoarseMap, model: TravelModel, goal: Cell, window: Window) -> ValueTable:
        low = (window[0].start, window[1].start)
        key = (coarse.key, model, goal, low, (window[0].stop, window[1].stop))
        if key not in self._tables:
            self._insert(key, self._made(coarse, model, goal, window))
        self._tables.move_to_end(key)
        return self._tables[key]

    def _window(self, coarse: CoarseMap, goal: Cell) -> Window:
        reach = math.ceil(self._max_trip_m / coarse.cell_size_m)
        rows, cols = (
            slice(max(0, at - reach), min(size, at + reach + 1))
            for at, size in zip(goal, coarse.shape, strict=True)
        )
        return rows, cols

    def _made(
        self, coarse: CoarseMap, model: TravelModel, goal: Cell, window: Window
    ) -> ValueTable:
        corner = (window[0].start, window[1].start)
        inner = (goal[0] - corner[0], goal[1] - corner[1])
        edges, nearness = windowed_edges(coarse, window), nearness_to_walls(coarse.room_m[window])
        problem = travel_problem(edges, nearness, inner, model)
        solution = solve(problem, self._horizon, self._kept_bytes)
        return ValueTable(
            planes=solution.planes,
            lengths=problem.lengths,
            gains=problem.gains,
            costs=problem.costs,
            corner=corner,
            goal=goal,
            goal_m=coarse.anchor_of(goal),
            model=model,
            weights=_weights(model, corner, inner),
        )

    def _insert(self, key: Key, table: ValueTable) -> None:
        self._tables[key] = table
        self.nbytes += table.nbytes
        while self.nbytes > self._budget_bytes and len(self._tables) > 1:
            _, oldest = self._tables.popitem(last=False)
            self.nbytes -= oldest.nbytes


def _cells_in(window: Window) -> int:
    """Return how many cells a window has."""
    rows, cols = window
    return int((rows.stop - rows.start) * (cols.stop - cols.start))


def _part(window: Window, goal: Cell, start: Cell, cell_size_m: float) -> Window:
    """Return the part of a window about a goal and a start, in steps of 8 cells: some share it."""
    margin = math.ceil(TRIP_MARGIN_M / cell_size_m)
    rows, cols = (
        slice(
            max(whole.start, (min(ends) - margin) // _TRIP_STEP * _TRIP_STEP),
            min(whole.stop, -(-(max(ends) + margin + 1) // _TRIP_STEP) * _TRIP_STEP),
        )
        for whole, *ends in zip(window, goal, start, strict=True)
    )
    return rows, cols


def _weights(model: TravelModel, corner: Cell, goal: Cell) -> npt.NDArray[np.float64]:
    chances = (1.0 - 2.0 * model.slip, model.slip)
    turns = (model.quarter_turn, model.half_turn)
    return np.array([*chances, *turns, model.reach, *corner, *goal], np.float64)


def windowed_edges(coarse: CoarseMap, window: Window) -> npt.NDArray[np.bool_]:
    """Return the edges bool (4, h, w) of a window, closed where they would lead out of it."""
    edges: npt.NDArray[np.bool_] = coarse.edges[:, window[0], window[1]].copy()
    edges[0, :, -1] = edges[1, -1, :] = edges[2, :, 0] = edges[3, 0, :] = False
    return edges


def nearness_to_walls(room_m: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return how near walls are, in [0, 1], for the room a disc has: the square of what lacks."""
    lacks = np.clip(1.0 - room_m / np.float32(WALL_COMFORT_M), 0.0, 1.0)
    return np.asarray(lacks * lacks, np.float32)
