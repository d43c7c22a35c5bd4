"""Tests of the values that are kept by type and goal."""

import math

import numpy as np
import pytest

from are_ros.agents.mdp import value_tables
from are_ros.agents.mdp.coarse_map import CoarseMap, nearness_to_walls
from are_ros.agents.mdp.model import TravelModel, solve, ways_to
from are_ros.agents.mdp.travel_kernels import cut_out
from are_ros.agents.mdp.value_tables import ValueTables
from tests.agents.floors import terrain_of, two_rooms
from tests.agents.mdp.slow_travel import travel_problem

WALKER = TravelModel(reaches=(3,))
POINT_M = (1.1, 1.2)


def two_room_map(version: int = 0, radius_m: float = 0.25) -> CoarseMap:
    """Return a floor of 5 x 4 m with a wall and a door in it."""
    walls = two_rooms(80, 100, slice(50, 52), slice(30, 46))
    return CoarseMap(terrain_of(walls, version=version), radius_m)


def test_a_table_holds_the_solution_of_its_problem() -> None:
    """Planes, lengths and costs are those of the decision process of the whole map."""
    coarse = two_room_map()
    table = ValueTables(horizon=6).value(coarse, WALKER, POINT_M)
    assert table is not None
    assert table.goal == coarse.cell_of(*POINT_M)
    nearness = nearness_to_walls(coarse.room_m)
    problem = travel_problem(coarse.edges, nearness, table.goal, WALKER)
    assert (table.planes == solve(problem, 6).planes).all()
    assert (table.lengths == problem.lengths).all()
    assert (table.costs == ways_to(coarse.edges, nearness, table.goal, WALKER).costs).all()
    assert table.corner == (0, 0)


def test_tables_are_kept_by_map_type_and_goal_cell() -> None:
    """Another point of the same cell has the same table; another cell, type or map has not."""
    tables, coarse = ValueTables(horizon=5), two_room_map()

    def planes(coarse: CoarseMap, model: TravelModel, goal_m: tuple[float, float]) -> int:
        table = tables.value(coarse, model, goal_m)
        assert table is not None
        return id(table.planes)

    first = planes(coarse, WALKER, POINT_M)
    assert planes(coarse, WALKER, (1.3, 1.4)) == first
    assert planes(two_room_map(), TravelModel(reaches=(3,)), POINT_M) == first
    others = [
        planes(coarse, WALKER, (1.6, 1.2)),
        planes(coarse, TravelModel(reaches=(2,)), POINT_M),
        planes(two_room_map(version=1), WALKER, POINT_M),
        planes(two_room_map(radius_m=0.3), WALKER, POINT_M),
    ]
    assert len({first, *others}) == 5
    assert len(tables) == 5
    tables.clear()
    assert len(tables) == tables.nbytes == 0


def test_a_table_ends_at_the_point_that_was_asked_for() -> None:
    """Points of one cell share values and keep their own ends; one in a wall gets an anchor."""
    tables, coarse = ValueTables(horizon=5), two_room_map()
    ends = []
    for goal_m in (POINT_M, (1.3, 1.4), (2.45, 1.2)):
        table = tables.value(coarse, WALKER, goal_m)
        assert table is not None
        ends.append(table.goal_m)
    assert ends[:2] == [POINT_M, (1.3, 1.4)]
    assert ends[2] == tuple(coarse.anchors_m[2, 4])


def test_the_least_recently_used_go_first() -> None:
    """The bound in bytes holds, and asking for a table keeps it."""
    coarse = two_room_map()
    goals_m = [(0.3 + 0.5 * k, 0.3) for k in range(4)]
    tables = ValueTables(horizon=5)
    first = tables.value(coarse, WALKER, goals_m[0])
    assert first is not None
    tables = ValueTables(horizon=5, budget_bytes=3 * first.nbytes)
    kept = [tables.value(coarse, WALKER, goal_m) for goal_m in goals_m[:3]]
    assert tables.nbytes <= 3 * first.nbytes
    tables.value(coarse, WALKER, goals_m[0])
    tables.value(coarse, WALKER, goals_m[3])
    assert len(tables) == 3
    again = [tables.value(coarse, WALKER, goal_m) for goal_m in goals_m[:2]]
    assert kept[0] is not None
    assert again[0] is not None
    assert again[0].planes is kept[0].planes
    assert kept[1] is not None
    assert again[1] is not None
    assert again[1].planes is not kept[1].planes


def test_the_newest_stays_whatever_it_needs() -> None:
    """A budget too small for one table keeps the last one."""
    tables, coarse = ValueTables(horizon=5, budget_bytes=1), two_room_map()
    for x_m in (0.5, 1.0, 1.5):
        assert tables.value(coarse, WALKER, (x_m, 1.0)) is not None
        assert len(tables) == 1


def test_a_goal_that_nobody_can_be_near_has_no_table() -> None:
    """In the middle of a thick wall, and outside the map."""
    walls = two_rooms(40, 160, slice(30, 130), None)
    coarse = CoarseMap(terrain_of(walls), 0.25)
    tables = ValueTables()
    assert tables.value(coarse, WALKER, (4.0, 1.0)) is None
    assert tables.value(coarse, WALKER, (-4.0, 1.0)) is None


def test_a_table_knows_from_where_its_goal_can_be_reached() -> None:
    """Not from behind a wall, nor from outside its window."""
    walls = two_rooms(60, 200, slice(150, 152), None)
    coarse = CoarseMap(terrain_of(walls), 0.25)
    table = ValueTables(max_trip_m=3.0).value(coarse, WALKER, (5.2, 1.2))
    assert table is not None
    assert table.corner == (0, 4)
    assert table.reaches((2, 5))
    assert table.cost(table.goal) == 0.0
    assert not table.reaches((2, 16))
    assert table.cost((2, 3)) == math.inf
    assert table.cost((2, 19)) == math.inf


def test_a_window_on_a_large_map_equals_the_whole_inside() -> None:
    """Where the best ways stay inside the window, its values are those of the whole map."""
    walls = np.random.default_rng(3).random((400, 500)) < 0.0005
    coarse = CoarseMap(terrain_of(walls), 0.25)
    goal_m = tuple(coarse.anchors_m[20, 25].tolist())
    whole = ValueTables(horizon=40, kept_bytes=2**22).value(coarse, WALKER, (goal_m[0], goal_m[1]))
    window = ValueTables(40, max_trip_m=6.0, kept_bytes=2**22).value(
        coarse, WALKER, (goal_m[0], goal_m[1])
    )
    assert whole is not None
    assert window is not None
    assert whole.planes.shape[2:] == (40, 50)
    assert window.planes.shape[2:] == (25, 25)
    assert window.corner == (8, 13)
    near = (slice(None), slice(14, 27), slice(19, 32))
    inner = (slice(None), slice(6, 19), slice(6, 19))
    for epochs in (0, 3, 40):
        theirs = whole.planes[min(epochs, len(whole.planes) - 1)][near]
        ours = window.planes[min(epochs, len(window.planes) - 1)][inner]
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-6)


def test_a_window_has_no_edges_that_lead_out() -> None:
    """Edges and prices inside are those of the map; edges across its border are closed."""
    coarse = two_room_map()
    ways = ways_to(coarse.edges, coarse.nearness, (3, 3), WALKER, window=((2, 1), (5, 4)))
    edges = cut_out(coarse.edges, ((2, 1), (5, 4)))
    whole = ways_to(coarse.edges, coarse.nearness, (3, 3), WALKER)
    assert ways.goal == (1, 2)
    assert (ways.price == whole.price[2:5, 1:4]).all()
    assert (edges[0, :, :-1] == coarse.edges[0, 2:5, 1:3]).all()
    assert (edges[1, :-1] == coarse.edges[1, 2:4, 1:4]).all()
    assert not edges[0, :, -1].any()
    assert not edges[1, -1].any()
    assert not edges[2, :, 0].any()
    assert not edges[3, 0].any()


def test_walls_are_minded_within_half_a_metre() -> None:
    """Wholly where the disc touches them, a quarter as much at half of that, not beyond."""
    room_m = np.array([0.0, 0.25, 0.5, 3.0], np.float32)
    assert nearness_to_walls(room_m).tolist() == pytest.approx([1.0, 0.25, 0.0, 0.0])


def test_on_a_large_map_a_trip_has_a_table_of_its_part(monkeypatch: pytest.MonkeyPatch) -> None:
    """It holds start and goal and the way between them; a part without a way gives the whole."""
    monkeypatch.setattr(value_tables, "SHARED_CELLS", 64)
    monkeypatch.setattr(value_tables, "TRIP_MARGINS_M", (0.5,))
    walls = np.zeros((400, 400), np.bool_)
    walls[200:204, :380] = True  # the way from one side to the other is at the far end
    coarse, tables = CoarseMap(terrain_of(walls), 0.25), ValueTables(horizon=5)
    start, beyond = coarse.cell_of(3.0, 3.0), coarse.cell_of(1.0, 13.0)
    assert start is not None
    assert beyond is not None
    part, whole = (tables.value(coarse, WALKER, POINT_M, start=one) for one in (start, beyond))
    assert part is not None
    assert whole is not None
    assert part.costs.shape == (7, 7)
    assert part.corner == (1, 1)
    assert whole.costs.shape == coarse.shape
    assert part.cost(start) == pytest.approx(whole.cost(start))
    assert whole.reaches(beyond)
    assert not part.reaches(beyond)


def test_a_part_that_may_miss_the_best_way_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """The way around a wall is in the part where that is surely the best, else all is looked at."""
    monkeypatch.setattr(value_tables, "SHARED_CELLS", 64)
    monkeypatch.setattr(value_tables, "TRIP_MARGINS_M", (1.0, 3.0))
    walls = np.zeros((400, 400), np.bool_)
    walls[200:204, 20:180] = True  # from x = 1 to 9 m
    coarse, tables = CoarseMap(terrain_of(walls), 0.25), ValueTables(horizon=5)
    for x_m, is_far in ((8.0, False), (5.0, True)):
        start = coarse.cell_of(x_m, 12.0)
        assert start is not None
        table = tables.value(coarse, WALKER, (x_m, 8.0), start)
        whole = ValueTables(horizon=5).value(coarse, WALKER, (x_m, 8.0))
        assert table is not None
        assert whole is not None
        assert table.cost(start) == pytest.approx(whole.cost(start))
        assert (table.costs.size == whole.costs.size) == is_far


@pytest.mark.parametrize("shared_cells", [64, 10**6])
def test_who_starts_beyond_the_longest_trip_finds_its_way_all_the_same(
    monkeypatch: pytest.MonkeyPatch, shared_cells: int
) -> None:
    """From each side of the goal, and at the cost that a table of the whole map has."""
    monkeypatch.setattr(value_tables, "SHARED_CELLS", shared_cells)
    coarse = CoarseMap(terrain_of(np.zeros((400, 400), np.bool_)), 0.25)
    for far_m in (1.0, 19.0):
        start = coarse.cell_of(far_m, far_m)
        assert start is not None
        table = ValueTables(5, max_trip_m=3.0).value(coarse, WALKER, (10.0, 10.0), start)
        whole = ValueTables(5).value(coarse, WALKER, (10.0, 10.0))
        assert table is not None
        assert whole is not None
        assert table.cost(start) == whole.cost(start) < math.inf


def test_the_table_of_a_trip_ends_with_the_life_and_goes_on_if_that_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its planes are those of a table of all epochs; what comes later is computed when needed."""
    monkeypatch.setattr(value_tables, "SHARED_CELLS", 64)
    coarse = CoarseMap(terrain_of(np.zeros((400, 400), np.bool_)), 0.25)
    start = coarse.cell_of(3.0, 3.0)
    tables = ValueTables(horizon=20)
    short, whole = (tables.value(coarse, WALKER, POINT_M, start, left) for left in (5, None))
    assert short is not None
    assert whole is not None
    assert short.epochs == (5, 5)
    assert whole.epochs[1] == 20
    for epochs in range(6):
        at = min(epochs, whole.epochs[0])
        assert (short.planes[epochs] == whole.planes[at]).all()
    later = value_tables.swept(short, 11)
    last = min(11, later.epochs[0])
    assert (later.planes[last % len(later.planes)] == whole.planes[min(11, whole.epochs[0])]).all()


def test_planes_of_later_epochs_hold_only_where_they_are_settled() -> None:
    """A life that ends later than it was to asks the table for more epochs than it began with."""
    coarse = CoarseMap(terrain_of(np.zeros((400, 400), np.bool_)), 0.25)
    whole = ValueTables(horizon=60, kept_bytes=2**30).value(coarse, WALKER, POINT_M)
    short = ValueTables(horizon=4).value(coarse, WALKER, POINT_M)
    assert whole is not None
    assert short is not None
    later = value_tables.swept(short, 15)
    last = later.planes[later.epochs[0] % len(later.planes)]
    for epochs in range(later.epochs[0]):
        holds = later.settled <= epochs
        assert (last[:, holds] == whole.planes[epochs][:, holds]).all()
