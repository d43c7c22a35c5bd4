"""Values of every horizon with bounded memory."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from are_ros.agents.mdp.coarse_map import CoarseMap
from are_ros.agents.mdp.model import TravelModel
from are_ros.agents.mdp.routes import AHEAD, best_action, is_settled
from are_ros.agents.mdp.value_tables import ValueTable, ValueTables
from are_ros.agents.navigation.terrain import Terrain
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.map_io import read_map_file
from are_ros.world.occupancy_grid import classify
from tests.agents.floors import terrain_of
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
    again = [bounded.plane(least, epochs) for epochs in range(HORIZON - AHEAD + 1)]
    assert len(least.planes) == 1
    for epochs, plane in enumerate(again):
        assert (plane == full.planes[min(epochs, len(full.planes) - 1)]).all()
    arrays = full.value_arrays, least.value_arrays
    by_epoch = [least.value_arrays._replace(planes=plane[None]) for plane in again]
    count = states = swept = 0
    for row, col in np.argwhere(np.isfinite(full.costs))[::step].tolist():
        for heading, left in product(range(4), range(1, HORIZON + 1)):
            nobody = NOBODY[: min(AHEAD, left)]
            holds = is_settled(arrays[1], row, col, left, len(nobody))
            assert holds or left < HORIZON
            state = (row, col, heading)
            ours = arrays[1] if holds else by_epoch[max(0, left - AHEAD)]
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
    """With the plane of the longest horizon, and that of the epoch where that does not hold."""
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
