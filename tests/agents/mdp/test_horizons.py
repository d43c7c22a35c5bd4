"""Values of every horizon with bounded memory, and those of who leaves the map when life ends."""

import math
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.agents.mdp.coarse_map import CoarseMap, nearness_to_walls
from are_ros.agents.mdp.model import TravelModel
from are_ros.agents.mdp.routes import AHEAD, best_action, is_settled
from are_ros.agents.mdp.value_tables import ValueTable, ValueTables
from are_ros.agents.navigation.terrain import Terrain
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.map_io import read_map_file
from are_ros.world.occupancy_grid import classify
from tests.agents.floors import terrain_of, two_rooms
from tests.agents.mdp.slow_travel import SlowTravel, State
from tests.agents.mdp.ways import brings_at

NOBODY = np.empty((AHEAD, 0, 5))
HORIZON = 40
OFFICE = Path(__file__).parents[3] / "bags" / "sample_office_map.yaml"
RUNNER = TravelModel((3, 5), slip=0.1, effort=(0.0, 0.07), rest=0.095, late=2.0)


def coarse_map(path: Path) -> CoarseMap:
    """Return the coarse map of a map file, for a disc of 0.3 m."""
    grid = read_map_file(path)
    environment = Environment(grid, classify(grid, 65, 25), None, PlaneGround(), 0.06)
    return CoarseMap(Terrain(environment, 1.75), 0.3)


def goals_of(coarse: CoarseMap, count: int) -> list[tuple[float, float]]:
    """Return anchors of the largest component."""
    largest = np.bincount(coarse.components[coarse.components >= 0]).argmax()
    cells = np.argwhere(coarse.components == largest)
    chosen = np.random.default_rng(3).permutation(len(cells))[:count]
    return [coarse.anchor_of((row, col)) for row, col in cells[chosen].tolist()]


def table_of(tables: ValueTables, coarse: CoarseMap, goal_m: tuple[float, float]) -> ValueTable:
    """Return the values of going there."""
    table = tables.value(coarse, RUNNER, goal_m)
    assert table is not None
    return table


def differing(coarse: CoarseMap, goal_m: tuple[float, float], step: int = 1) -> tuple[int, int]:
    """Return how many states have another best action with bounded memory, of how many.

    At every horizon, by the same planes as navigation: that of the longest horizon where it holds.
    """
    everything, bounded = (ValueTables(HORIZON - AHEAD, kept_bytes=kept) for kept in (2**40, 0))
    full, least = (table_of(tables, coarse, goal_m) for tables in (everything, bounded))
    again = bounded.all_planes(least)
    assert len(least.planes) == 1
    assert (again == full.planes).all()
    arrays = full.value_arrays, least.value_arrays, least.value_arrays._replace(planes=again)
    count = states = swept = 0
    for row, col in np.argwhere(np.isfinite(full.costs))[::step].tolist():
        for heading, left in product(range(4), range(1, HORIZON + 1)):
            nobody = NOBODY[: min(AHEAD, left)]
            holds = is_settled(arrays[1], row, col, left, len(nobody))
            assert holds or left < HORIZON
            state, ours = (row, col, heading), arrays[1] if holds else arrays[2]
            one, other = (
                brings_at(values, coarse, left, nobody, state) for values in (arrays[0], ours)
            )
            count += best_action(one, heading) != best_action(other, heading)
            assert (one == other).all()
            states += 1
            swept += not holds
    assert 0 < swept < states
    return count, states


def test_in_the_office_every_horizon_has_the_action_of_all_planes() -> None:
    """With the plane of the longest horizon, and all of them only where that does not hold."""
    coarse = coarse_map(OFFICE)
    for goal_m in goals_of(coarse, 2):
        assert differing(coarse, goal_m, step=2)[0] == 0


@pytest.mark.parametrize(
    ("name", "step"), [("nav2-maps/depot.yaml", 4), ("drl-jarvis-hall/i-108_10mm.yaml", 8)]
)
def test_on_real_maps_every_horizon_has_the_action_of_all_planes(
    name: str, step: int, real_data: Path
) -> None:
    """As in the office."""
    coarse = coarse_map(real_data / name)
    (goal_m,) = goals_of(coarse, 1)
    assert differing(coarse, goal_m, step)[0] == 0


def test_a_goal_takes_at_most_a_megabyte() -> None:
    """On 200 x 200 cells."""
    coarse = CoarseMap(terrain_of(np.zeros((400, 400), np.bool_), 0.25), 0.2)
    assert coarse.shape == (200, 200)
    tables = ValueTables(HORIZON - AHEAD, max_trip_m=200.0)
    table = table_of(tables, coarse, (50.0, 50.0))
    assert table.costs.shape == (200, 200)
    assert table.nbytes < 2**20
    assert tables.nbytes == table.nbytes


# --- exits


def slow_values(
    coarse: CoarseMap, goal: tuple[int, int], exits: list[tuple[int, int]]
) -> list[dict[State, float]]:
    """Return V_0 .. V_8 of one who wants to be near an exit at the end, by dictionaries.

    Each pace comes twice: with moves cut for the ways to the goal, and for those to the exits.
    """
    nearness = nearness_to_walls(coarse.room_m)
    to_goal = SlowTravel(coarse.edges, nearness, goal, RUNNER)
    outs = [SlowTravel(coarse.edges, nearness, cell, RUNNER) for cell in exits]
    out = SlowTravel(coarse.edges, nearness, exits[0], RUNNER)
    out.goal = (-1, -1)
    out.cost = {cell: min(one.cost[cell] for one in outs) for cell in out.cost}
    start = {state: max(-1e6, -RUNNER.late * out.cost[state[:2]]) for state in out.states}
    leaving = [start]
    for _ in range(8):
        leaving.append(out.better(leaving[-1]))
    there = [(*goal, heading) for heading in range(4)]
    values = [start | {state: RUNNER.goal + start[state] for state in there}]
    for epoch in range(1, 9):
        one, other = to_goal.better(values[-1]), out.better(values[-1])
        best = {state: max(one[state], other[state]) for state in one}
        given = {state: RUNNER.goal + leaving[epoch][state] for state in there}
        values.append(best | given)
    return values


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6))
def test_values_with_exits_are_those_of_the_slow_twin(seed: int) -> None:
    """To the goal while there is time, and out as life runs down, for each number of epochs."""
    random = np.random.default_rng(seed)
    coarse = CoarseMap(terrain_of(random.random((30, 40)) < 0.003, resolution_m=0.1), 0.1)
    goal_m, exits = (1.55, 1.55), [(0, 0), (5, 7)]
    goal = coarse.cell_of(*goal_m)
    exits = [cell for cell in exits if coarse.components[cell] >= 0]
    assert goal is not None
    if not any(coarse.components[cell] == coarse.components[goal] for cell in exits):
        return
    tables = ValueTables(horizon=8)
    table = tables.value(coarse, RUNNER, goal_m, exits=tuple(exits))
    assert table is not None
    assert table.out is not None
    apart = np.isinf(table.costs)
    for epochs, expected in enumerate(slow_values(coarse, goal, exits)):
        plane = table.planes[min(epochs, len(table.planes) - 1)]
        ours = [plane[h, r, c] for r, c, h in expected if not apart[r, c]]
        theirs = [value for (r, c, _), value in expected.items() if not apart[r, c]]
        np.testing.assert_allclose(ours, theirs, atol=1e-5)


def test_the_goal_is_gone_to_in_time_and_left_in_time() -> None:
    """In a corridor with the exit behind: far from the end one goes on, near it one turns back."""
    walls = np.zeros((20, 240), np.bool_)
    walls[:5] = walls[-5:] = True
    coarse, tables = CoarseMap(terrain_of(walls), 0.1), ValueTables(horizon=60)
    model = TravelModel((1,), goal=3.0, late=2.0, rest=0.05)
    door = coarse.cell_of(0.3, 0.5)
    assert door is not None
    table = tables.value(coarse, model, (11.3, 0.5), exits=(door,))
    assert table is not None
    middle = coarse.cell_of(6.3, 0.5)
    assert middle is not None
    moves = [
        best_action(brings_at(table.value_arrays, coarse, left, NOBODY, (*middle, 0)), 0)[1]
        for left in (60, 50, 14, 3)
    ]
    assert moves == [1, 1, 3, 3]


def test_without_a_way_out_it_is_as_without_exits() -> None:
    """An exit behind a wall does not count."""
    coarse = CoarseMap(terrain_of(two_rooms(60, 60, slice(30, 31), None)), 0.25)
    tables, exit_ = ValueTables(horizon=9), coarse.cell_of(2.5, 0.5)
    assert exit_ is not None
    one = tables.value(coarse, RUNNER, (0.5, 0.5), exits=(exit_,))
    assert one is not None
    assert one.out is None
    assert tables.value(coarse, RUNNER, (0.5, 0.5)) is not None
    assert math.isinf(one.cost(exit_))
    assert (one.planes == table_of(tables, coarse, (0.5, 0.5)).planes).all()
