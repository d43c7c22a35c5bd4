"""Slow, obvious twins of the decision process: dictionaries, and matrices for QuantEcon."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from are_ros.agents.mdp.model import Problem, TravelModel, problem_of, ways_to

Cell = tuple[int, int]
State = tuple[int, int, int]
STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0))


def random_edges(
    open_share: float, shape: Cell, random: np.random.Generator
) -> npt.NDArray[np.bool_]:
    """Return edges bool (4, h, w), the same both ways, so many of them open."""
    edges = np.zeros((4, *shape), np.bool_)
    edges[0, :, :-1] = edges[2, :, 1:] = random.random((shape[0], shape[1] - 1)) < open_share
    edges[1, :-1] = edges[3, 1:] = random.random((shape[0] - 1, shape[1])) < open_share
    return edges


def travel_problem(
    edges: npt.NDArray[np.bool_],
    nearness: npt.NDArray[np.float32],
    goal: Cell,
    model: TravelModel,
    penalty: npt.NDArray[np.float32] | None = None,
) -> Problem:
    """Return the process of going to a cell.

    `penalty` (h, w), not negative, adds to the cost of an epoch in each cell: others that stand
    there for good, the exact counterpart of the lookahead. The ways do not depend on it.
    """
    ways = ways_to(edges, nearness, goal, model)
    if penalty is not None:
        ways = replace(ways, price=ways.price + penalty.astype(np.float32))
    return problem_of(ways)


class Epoch(NamedTuple):
    """What others do in one epoch: what being in a cell costs more, and where nobody can enter."""

    penalty: npt.NDArray[np.float64]
    occupied: npt.NDArray[np.bool_]


class SlowTravel:
    """The decision process of going to a goal, by its definition, in float64.

    Action 0 is to stay, 1 + 4 * pace + direction to move.
    """

    def __init__(
        self,
        edges: npt.NDArray[np.bool_],
        nearness: npt.NDArray[np.float32],
        goal: Cell,
        model: TravelModel,
        penalty: npt.NDArray[np.float32] | None = None,
    ) -> None:
        """Take what `travel_problem` takes."""
        self.edges, self.goal, self.model = edges, goal, model
        cells = list(product(range(edges.shape[1]), range(edges.shape[2])))
        self.actions = 1 + 4 * len(model.reaches)
        self.price = {cell: model.time + model.clearance * float(nearness[cell]) for cell in cells}
        self.cost = self._costs(cells)
        if penalty is not None:
            self.price = {cell: self.price[cell] + float(penalty[cell]) for cell in cells}
        self.states = [(*cell, heading) for cell in cells for heading in range(4)]
        self.nobody = Epoch(np.zeros(nearness.shape), np.zeros(nearness.shape, np.bool_))

    def _costs(self, cells: list[Cell]) -> dict[Cell, float]:
        """Relax every edge until nothing changes."""
        cost = dict.fromkeys(cells, math.inf) | {self.goal: 0.0}
        while True:
            relaxed = {
                cell: min([cost[cell], *(self._through(cost, cell, d) for d in range(4))])
                for cell in cells
            }
            if relaxed == cost:
                return cost
            cost = relaxed

    def _through(self, cost: dict[Cell, float], cell: Cell, direction: int) -> float:
        if not self.edges[direction][cell]:
            return math.inf
        following = self.stepped(cell, direction)
        return self.price[following] / self.model.reaches[0] + cost[following]

    @staticmethod
    def stepped(cell: Cell, direction: int) -> Cell:
        """Return the neighbour."""
        return cell[0] + STEPS[direction][0], cell[1] + STEPS[direction][1]

    def ends(self, cell: Cell) -> bool:
        """Tell whether nothing changes any more."""
        return cell == self.goal or self.cost[cell] == math.inf

    def moved(self, cell: Cell, direction: int, pace: int = 0) -> list[Cell]:
        """Return the cells that a move enters if nobody is in the way."""
        entered: list[Cell] = []
        while not self.ends(cell) and len(entered) < self.model.reaches[pace]:
            following = self.stepped(cell, direction)
            if not self.edges[direction][cell]:
                break
            if entered and self.cost[following] > self.cost[cell]:
                break
            entered.append(following)
            cell = following
        return entered

    def terminal(self) -> dict[State, float]:
        """Return V_0: late for the rest of the way, for turning to it and from axis to axis."""
        model = self.model
        turn = (0.0, model.quarter_turn, model.half_turn, model.quarter_turn)
        values = {}
        for row, col, heading in self.states:
            here = self.cost[row, col]
            shorter = [
                direction
                for direction, (down, right) in enumerate(STEPS)
                if self.edges[direction, row, col] and self.cost[row + down, col + right] < here
            ]
            late = here + min((turn[(d - heading) % 4] for d in shorter), default=0.0)
            late += model.quarter_turn if len({d % 2 for d in shorter}) == 2 else 0.0
            values[row, col, heading] = -1e6 if here == math.inf else model.goal - model.late * late
        return values

    def outcomes(
        self, state: State, action: int, epoch: Epoch
    ) -> Iterator[tuple[float, float, State]]:
        """Yield probability, gain and next state of an action that goes somewhere."""
        cell, slip = state[:2], self.model.slip
        pace, direction = divmod(action - 1, 4)
        reach, effort = self.model.reaches[pace], self.model.effort[pace]
        failed = -self.price[cell] - epoch.penalty[cell] - effort
        for turn, chance in ((0, 1.0 - slip), (1, slip / 4), (3, slip / 4)):
            actual = (direction + turn) % 4
            entered = self.moved(cell, actual, pace)
            gain = -1.0 if self.ends(cell) else failed
            if entered and not any(epoch.occupied[other] for other in entered):
                dearer = 1.0 + effort / self.model.time
                costs = [(self.price[c] + epoch.penalty[c]) * dearer for c in entered]
                yield chance, -sum(costs) / reach, (*entered[-1], actual)
            else:
                yield chance, gain, (*cell, actual)
        yield slip / 2, -1.0 if self.ends(cell) else failed, (*cell, direction)

    def value_of(
        self,
        values: dict[State, float],
        state: State,
        action: int,
        epoch: Epoch | None = None,
    ) -> float:
        """Return what an action brings."""
        cell, heading, model = state[:2], state[2], self.model
        epoch = epoch or self.nobody
        if action == 0:
            gain = model.rest - self.price[cell] - epoch.penalty[cell]
            return values[state] + (0.0 if self.ends(cell) else gain)
        turn = (0.0, model.quarter_turn, model.half_turn, model.quarter_turn)
        expected = sum(
            chance * (gain + values[following])
            for chance, gain, following in self.outcomes(state, action, epoch)
        )
        return expected - turn[(action - 1 - heading) % 4]

    def better(self, values: dict[State, float], epoch: Epoch | None = None) -> dict[State, float]:
        """Return V_h of V_{h-1}."""
        return {
            s: max(self.value_of(values, s, a, epoch) for a in range(self.actions))
            for s in self.states
        }

    def values(self, horizon: int) -> list[dict[State, float]]:
        """Return V_0 .. V_horizon."""
        found = [self.terminal()]
        for _ in range(horizon):
            found.append(self.better(found[-1]))
        return found


def quantecon_arguments(
    problem: Problem,
) -> tuple[
    npt.NDArray[np.float64], sparse.csr_matrix, npt.NDArray[np.int64], npt.NDArray[np.int64]
]:
    """Return R, Q, and the states and actions of their rows, for QuantEcon's DiscreteDP.

    State heading * h * w + cell, so that values reshape to (4, h, w).
    """
    cells, model = problem.terminal[0].size, problem.model
    straight, fails, aside = model.chances
    rewards: list[float] = []
    rows: list[int] = []
    columns: list[int] = []
    chances: list[float] = []
    count = 1 + 4 * len(model.reaches)
    for state, action in product(range(4 * cells), range(count)):
        heading, cell = divmod(state, cells)
        stay = float(problem.gains[0].flat[cell])
        outcomes, turn = [(1.0, stay, state)], 0.0
        if action > 0:
            pace, direction = divmod(action - 1, 4)
            turn = _turn(model, heading, direction)
            outcomes = [
                (chance, *_outcome(problem, pace, cell, (direction + quarter) % 4))
                for quarter, chance in ((0, straight), (1, aside), (3, aside))
            ]
            failed = stay - model.rest - model.effort[pace]
            outcomes.append((fails, failed, direction * cells + cell))
        for chance, _, following in outcomes:
            rows.append(len(rewards))
            columns.append(following)
            chances.append(chance)
        rewards.append(sum(chance * gain for chance, gain, _ in outcomes) - turn)
    shape = (len(rewards), 4 * cells)
    matrix = sparse.csr_matrix((chances, (rows, columns)), shape=shape)
    states, actions = np.divmod(np.arange(len(rewards)), count)
    return np.array(rewards), matrix, states, actions


def _outcome(problem: Problem, pace: int, cell: int, direction: int) -> tuple[float, int]:
    _, height, width = problem.terminal.shape
    row, col = divmod(cell, width)
    length = min(problem.model.reaches[pace], int(problem.lengths[direction, row, col]))
    end = (row + length * STEPS[direction][0]) * width + col + length * STEPS[direction][1]
    gain = float(problem.gains[1 + 4 * pace + direction, row, col])
    return gain, direction * height * width + end


def _turn(model: TravelModel, heading: int, direction: int) -> float:
    return (0.0, model.quarter_turn, model.half_turn, model.quarter_turn)[(direction - heading) % 4]


def plain_epochs(problem: Problem) -> Iterator[npt.NDArray[np.float32]]:
    """Yield V_0, V_1, ... float32 (4, h, w), whole planes at a time, each from the last one."""
    model = problem.model
    straight, fails, aside = map(np.float32, model.chances)
    turns = np.array([0.0, model.quarter_turn, model.half_turn, model.quarter_turn], np.float32)
    values = problem.terminal
    while True:
        yield values
        best = np.full(values.shape, -np.inf, np.float32)
        for pace in range(len(model.reaches)):
            brings = _brings(problem, values, pace)
            failed = problem.gains[0] - (np.float32(model.effort[pace]) + np.float32(model.rest))
            for d in range(4):
                sides = aside * (brings[(d + 1) % 4] + brings[(d + 3) % 4])
                move = (straight * brings[d] + sides) + fails * (values[d] + failed)
                best[d] = np.maximum(best[d], move)
        values = np.stack(
            [
                np.max(
                    [values[h] + problem.gains[0]]
                    + [best[(h + turn) % 4] - turns[turn] for turn in range(4)],
                    axis=0,
                )
                for h in range(4)
            ]
        )


def _brings(
    problem: Problem, values: npt.NDArray[np.float32], pace: int
) -> list[npt.NDArray[np.float32]]:
    """Return what going each way for an epoch brings, of values (4, h, w)."""
    rows, cols = np.indices(problem.terminal.shape[1:])
    lengths = np.minimum(problem.lengths, problem.model.reaches[pace]).astype(np.int64)
    return [
        values[d][rows + STEPS[d][0] * lengths[d], cols + STEPS[d][1] * lengths[d]]
        + problem.gains[1 + 4 * pace + d]
        for d in range(4)
    ]
