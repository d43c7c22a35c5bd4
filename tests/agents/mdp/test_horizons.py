"""Values of every horizon with bounded memory."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from are_ros._compiled import compiled
from are_ros.agents.mdp.coarse_map import CoarseMap
from are_ros.agents.mdp.model import TravelModel
from are_ros.agents.mdp.routes import (
    AHEAD,
    Doubles,
    Floats,
    ValueArrays,
    ValueTuple,
    action_values,
    best_action,
    is_settled,
)
from are_ros.agents.mdp.value_tables import SWEPT_EPOCHS, ValueTable, ValueTables, swept
from are_ros.agents.navigation.terrain import Terrain
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.map_io import read_map_file
from are_ros.world.occupancy_grid import classify
from tests.agents.floors import terrain_of

Counts = npt.NDArray[np.int64]
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


@compiled
def compare(
    full: ValueTuple, least: ValueTuple, again: Floats, anchors_m: Doubles, counts: Counts
) -> None:
    """Count states (cell, heading, horizon), those with another best action, and other values.

    And those that need other planes than the ones kept, as in navigation. `full` and `least` are
    the fields of `ValueArrays`.
    """
    everything, one_plane = ValueArrays(*full), ValueArrays(*least)
    all_planes = ValueArrays(again, (again.shape[0] - 1, HORIZON), *least[2:])
    (rows, columns), paces = everything.costs.shape, everything.paces.shape[0]
    kept, bounded = np.empty((paces, 5)), np.empty((paces, 5))
    nobody = np.empty((AHEAD, 0, 5))
    for row in range(rows):
        for col in range(columns):
            if everything.costs[row, col] == np.inf:
                continue
            for left in range(1, HORIZON + 1):
                others = nobody[: min(AHEAD, left)]
                holds = is_settled(one_plane, row, col, left, others.shape[0])
                for heading in range(4):
                    state = (row, col, heading)
                    action_values(everything, left, anchors_m, others, state, kept)
                    ours = one_plane if holds else all_planes
                    action_values(ours, left, anchors_m, others, state, bounded)
                    counts[0] += 1
                    counts[1] += best_action(kept, heading) != best_action(bounded, heading)
                    counts[2] += (kept != bounded).any()
                    counts[3] += not holds


def differing(coarse: CoarseMap, goal_m: tuple[float, float], kept_planes: int = 1) -> int:
    """Return in how many states the best action is another with bounded memory; values are equal.

    Of every cell from which a way leads to the goal, every heading, and every horizon.
    """
    kept_bytes = 16 * kept_planes * coarse.nearness.size
    sizes = (2**40, kept_bytes)
    everything, bounded = (ValueTables(HORIZON - AHEAD, kept_bytes=kept) for kept in sizes)
    full, least = (table_of(tables, coarse, goal_m) for tables in (everything, bounded))
    tables = [swept(least, t) for t in range(HORIZON - AHEAD + 1)]
    again = np.stack(
        [one.planes[min(t, one.epochs[0]) % SWEPT_EPOCHS] for t, one in enumerate(tables)]
    )
    assert len(least.planes) == kept_planes
    assert (again[: len(full.planes)] == full.planes).all()
    assert (again[len(full.planes) :] == full.planes[-1]).all()
    counts = np.zeros(4, np.int64)
    compare(tuple(full.value_arrays), tuple(least.value_arrays), again, coarse.anchors_m, counts)
    states, actions, values, computed_again = counts.tolist()
    assert states == np.isfinite(full.costs).sum() * 4 * HORIZON
    assert 0 < computed_again < states
    assert values == 0
    return int(actions)


def test_in_the_office_every_horizon_has_the_action_of_all_planes() -> None:
    """With the planes of the last horizons, and that of the epoch where these do not hold."""
    coarse = coarse_map(OFFICE)
    for goal_m, kept_planes in zip(goals_of(coarse, 2), (1, 7), strict=True):
        assert differing(coarse, goal_m, kept_planes) == 0


@pytest.mark.parametrize("name", ["nav2-maps/depot.yaml", "drl-jarvis-hall/i-108_10mm.yaml"])
def test_on_real_maps_every_horizon_has_the_action_of_all_planes(
    name: str, real_data: Path
) -> None:
    """As in the office."""
    coarse = coarse_map(real_data / name)
    for goal_m in goals_of(coarse, 3):
        assert differing(coarse, goal_m) == 0


def test_actions_of_another_plane_are_counted() -> None:
    """Without that plane they differ: the comparison sees it."""
    coarse = coarse_map(OFFICE)
    (goal_m,) = goals_of(coarse, 1)
    full = table_of(ValueTables(HORIZON - AHEAD, kept_bytes=2**40), coarse, goal_m)
    longest, counts = full.planes[-1:].copy(), np.zeros(4, np.int64)
    forced = full.value_arrays._replace(planes=longest, epochs=(0, HORIZON))
    compare(tuple(full.value_arrays), tuple(forced), full.planes, coarse.anchors_m, counts)
    assert min(counts[:3]) > 0
    assert counts[3] == 0


def test_a_goal_takes_at_most_a_megabyte() -> None:
    """On 200 x 200 cells."""
    coarse = CoarseMap(terrain_of(np.zeros((400, 400), np.bool_), 0.25), 0.2)
    assert coarse.shape == (200, 200)
    tables = ValueTables(HORIZON - AHEAD, max_trip_m=200.0)
    table = table_of(tables, coarse, (50.0, 50.0))
    assert table.costs.shape == (200, 200)
    assert table.nbytes < 2**20
    assert tables.nbytes == table.nbytes
