"""The Markov decision process of going to a goal (section 3.2), solved by backward induction.

A state is a coarse cell and one of four headings. The actions are to stay (0), and to go east (1),
north (2), west (3) or south (4).
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.mdp import induction as _induction
from are_ros.agents.mdp import travel_kernels as _travel_kernels
from are_ros.errors import ParameterError
from are_ros.population.catalogue import CatalogueRow

Cell = tuple[int, int]
Window = tuple[Cell, Cell]
"""The first cell, and the cell after the last row and column."""

Floats = npt.NDArray[np.float32]

UNREACHABLE: Final = np.float32(-1e6)
"""Value of a cell that has no way to the goal, whatever the horizon."""

MAX_REACH: Final = 255
KEPT_BYTES: Final = 4 * 2**20

LEAST_TIME: Final = 0.01
"""Least price of an epoch: if ways were free, no agent would ever start."""

_VEHICLE_HALF_TURN_S: Final = 20.0


@dataclass(frozen=True, slots=True)
class TravelModel:
    """The parameters of a type's decision process; value tables are kept by them.

    `reaches` is the number of cells that it moves in an epoch, at each of its P paces. With
    probability 1 - `slip` a move goes as intended; with `slip` / 2 it fails (one has turned, and
    stays), with `slip` / 4 it goes to each side, a quarter turn off. `time` is the price of an
    epoch, `clearance` the additional price next to a wall, `effort` (P) that of a pace in the open
    (beside walls it grows as the price does); an epoch of staying costs `rest` less. `goal` is the
    value of the goal; an agent that is not there when the epochs are over loses `late` times what
    the rest of the way costs, and turning on it. `quarter_turn` and `half_turn` are the prices of
    turning before a move.
    """

    reaches: tuple[int, ...] = (1,)
    slip: float = 0.0
    time: float = 0.1
    clearance: float = 0.5
    effort: tuple[float, ...] = (0.0,)
    rest: float = 0.0
    goal: float = 1.0
    late: float = 1.0
    quarter_turn: float = 0.1
    half_turn: float = 0.2

    def __post_init__(self) -> None:
        """Raise ParameterError for numbers outside their domain."""
        if not self.reaches or not all(1 <= reach <= MAX_REACH for reach in self.reaches):
            raise ParameterError(f"reaches of {self.reaches} cells are not 1 to {MAX_REACH}")
        if len(self.effort) != len(self.reaches):
            raise ParameterError(f"{self}: there is not one effort for each pace")
        if not 0.0 <= self.slip <= 1.0:
            raise ParameterError(f"a slip of {self.slip} is not 0 to 1")
        if not 0.0 <= self.rest <= self.time:
            raise ParameterError(f"a rest of {self.rest} is not 0 to {self.time}, the time's price")
        if not 1.0 <= self.late < math.inf:
            raise ParameterError(f"being late by a factor of {self.late} is not 1 or more")
        prices = (self.time - LEAST_TIME, self.clearance, self.quarter_turn, self.half_turn)
        if not all(0.0 <= price < math.inf for price in (*prices, *self.effort)):
            raise ParameterError(
                f"{self}: a price is negative or not finite, or time costs nothing"
            )

    @classmethod
    def of(
        cls,
        row: CatalogueRow,
        speeds_mps: tuple[float, ...],
        cell_size_m: float,
        period_s: float,
        slip: float,
    ) -> "TravelModel":
        """Return the model of a type that goes at some speeds, with decisions every period.

        Turning on the spot costs its time. A type with a turning circle pays the time of a quarter
        of it at the first speed for a quarter turn, and 20 s more for turning around. The effort of
        another speed is `rewards.effort` times the time that it saves, a rest is `rewards.rest`
        times the time that it takes: at 1 both would just pay.
        """
        motion, rewards = row.motion, row.rewards
        cells = [speed_mps * period_s / cell_size_m for speed_mps in speeds_mps]
        # limited before it is rounded: a speed of 1e308 m/s reaches inf cells
        reaches = tuple(max(1, round(min(MAX_REACH, reach))) for reach in cells)
        quarter_s = 0.5 * math.pi / max(motion.turn_rate_radps, 1e-3)
        half_s = 2.0 * quarter_s
        if motion.turn_radius_m > 0.0:
            # by the rounded speed, so that speeds of one reach share their values
            arc_m = 0.5 * math.pi * motion.turn_radius_m
            quarter_s = max(quarter_s, arc_m * period_s / (reaches[0] * cell_size_m))
            half_s = 2.0 * quarter_s + _VEHICLE_HALF_TURN_S
        time = max(rewards.time, LEAST_TIME)
        saved = [max(0.0, reach / reaches[0] - 1.0) for reach in reaches]
        return cls(
            reaches=reaches,
            slip=slip,
            time=time,
            clearance=rewards.clearance,
            effort=tuple(rewards.effort * time * share for share in saved),
            rest=min(rewards.rest, 1.0) * time,
            goal=rewards.goal,
            late=max(rewards.late, 1.0),
            quarter_turn=time * quarter_s / period_s,
            half_turn=time * half_s / period_s,
        )

    @property
    def chances(self) -> tuple[float, float, float]:
        """The probabilities of going as intended, of failing, and of going to one of the sides."""
        return 1.0 - self.slip, 0.5 * self.slip, 0.25 * self.slip


@dataclass(frozen=True, eq=False)
class Ways:
    """The cheapest ways to a goal on h x w cells, without turning and slipping.

    `lengths` uint8 (4, h, w): the cells of a move along them in each direction, at the longest
    reach; at another pace it is at most that pace's. `price` float32 (h, w) is the cost of an epoch
    in each cell, `costs` float32 (h, w) that of the cheapest way, inf if there is none. `goal` is
    its cell in the window.
    """

    lengths: npt.NDArray[np.uint8]
    price: Floats
    costs: Floats
    goal: Cell
    model: TravelModel


@dataclass(frozen=True, eq=False)
class Problem:
    """A decision process with a goal, on h x w cells, as backward induction takes it.

    `lengths` uint8 (4, h, w) as in `Ways`. `gains` float32 (1 + 4 P, h, w): the reward of an epoch
    of staying, and of moving in each direction at each pace (intended or by slipping); turning
    costs extra. `terminal` float32 (4, h, w): V_0 by heading.
    """

    lengths: npt.NDArray[np.uint8]
    gains: Floats
    terminal: Floats
    model: TravelModel


@dataclass(frozen=True, eq=False)
class Solution:
    """Values float32 (K, 4, h, w) of the last K epochs by heading; epoch t is in place t % K.

    Beyond the last epoch, the last is valid. `settled` int32 (h, w) is the last epoch that changed
    any value of a cell, and `epochs` were computed: fewer than the horizon if the values did not
    change any more.
    """

    planes: Floats
    settled: npt.NDArray[np.int32]
    epochs: int

    def plane(self, epochs_left: int) -> Floats:
        """Return V (4, h, w) for a number of epochs left, from the planes kept."""
        last: Floats = self.planes[min(epochs_left, self.epochs) % len(self.planes)]
        return last


def ways_to(
    edges: npt.NDArray[np.bool_],
    nearness: Floats,
    goal: Cell,
    model: TravelModel,
    window: Window | None = None,
) -> Ways:
    """Return the cheapest ways to a cell of a map, within a window of it.

    `edges` bool (4, H, W) tells which steps are possible, symmetrically; `nearness` float32 (H, W)
    in [0, 1] how near the walls are. A step into a cell costs the cell's price (of an epoch: time,
    clearance) over the first reach, so that a move that ends early costs as much less.
    """
    window = window or ((0, 0), (nearness.shape[0], nearness.shape[1]))
    (row, col), _ = window
    goal = (int(goal[0]) - row, int(goal[1]) - col)
    inner, price = _travel_kernels.cut_out(edges, window), price_in(nearness, model, window)
    costs = _travel_kernels.way_prices(inner, price, model.reaches[0], goal)
    lengths = _travel_kernels.find_moves(inner, costs, max(model.reaches), goal)
    return Ways(lengths, price, costs, goal, model)


def price_in(nearness: Floats, model: TravelModel, window: Window) -> Floats:
    """Return the price float32 (h, w) of an epoch in each cell of a window."""
    (row, col), (end_row, end_col) = window
    inner = nearness[row:end_row, col:end_col]
    price: Floats = np.float32(model.time) + np.float32(model.clearance) * inner
    return price


def problem_of(ways: Ways) -> Problem:
    """Return the decision process of going to the goal of some ways.

    The goal has the value `model.goal` and ends the process. The terminal value elsewhere is that
    less `model.late` times the cost of the cheapest way there and of turning on it, as far as no
    wall makes it turn: so an agent starts even with a short horizon, and its goal behind it.
    """
    model = ways.model
    reaches, effort = np.array(model.reaches), np.array(model.effort)
    gains = _travel_kernels.find_gains(
        ways.lengths, ways.costs, ways.price, reaches, effort, model.time, model.rest, ways.goal
    )
    turns = _travel_kernels.turns_left(
        ways.lengths, ways.costs, model.quarter_turn, model.half_turn
    )
    cost = np.float32(model.late) * (ways.costs + turns)
    terminal = np.maximum(np.float32(model.goal) - cost, UNREACHABLE)
    return Problem(ways.lengths, gains, terminal, model)


def solve(problem: Problem, horizon: int, kept_bytes: int = KEPT_BYTES) -> Solution:
    """Return V_0 .. V_horizon by exact backward induction in float32, without a transition matrix.

    What a direction leads to does not depend on the heading or the intended action: each epoch
    takes four shifted planes for each pace, then the best of the sums (eq. of section 3.2). It runs
    in one thread, with the same bits on all machines. If all planes would need more than
    `kept_bytes`, the last ones are kept, at least one.
    """
    _, height, width = problem.terminal.shape
    kept = max(1, min(horizon + 1, kept_bytes // (16 * height * width)))
    planes, settled, epochs = _induction.solved(problem, max(kept, 2), horizon)
    last = planes[: epochs + 1] if kept > 1 else planes[epochs % 2][None].copy()
    return Solution(last, settled, epochs)
