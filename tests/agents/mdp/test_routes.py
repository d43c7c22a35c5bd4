"""Tests of what to do next on the way to a goal."""

import math
from itertools import pairwise, product

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.agents.mdp import routes as _route_kernels
from are_ros.agents.mdp.coarse_map import CoarseMap, nearness_to_walls
from are_ros.agents.mdp.model import TravelModel
from are_ros.agents.mdp.value_tables import ValueTable, ValueTables
from are_ros.agents.navigation.step_kernels import FADE_M
from tests.agents.floors import terrain_of, two_rooms
from tests.agents.mdp.slow_travel import Epoch, SlowTravel
from tests.agents.mdp.ways import Action, brings_at, choose, packed, way

Others = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]

NOBODY: Others = (np.empty((0, 2)), np.empty(0), np.empty(0))
STEPPER = TravelModel(reaches=(1,), quarter_turn=0.02, half_turn=0.04)


def somebody(x_m: float, y_m: float, radius_m: float = 0.3, weight: float = 0.5) -> Others:
    """Return one other person."""
    return np.array([[x_m, y_m]]), np.array([radius_m]), np.array([weight])


def table_of(coarse: CoarseMap, goal_m: tuple[float, float], model: TravelModel) -> ValueTable:
    """Return the values of going there."""
    table = ValueTables(horizon=60).value(coarse, model, goal_m)
    assert table is not None
    return table


def open_floor(yaw_rad: float = 0.0) -> CoarseMap:
    """Return a floor of 6 x 6 m without walls in it."""
    return CoarseMap(terrain_of(np.zeros((120, 120), np.bool_), yaw_rad=yaw_rad), 0.25)


def door_floor() -> CoarseMap:
    """Return a floor of 6 x 5 m, with a wall across and a door at its upper end."""
    return CoarseMap(terrain_of(two_rooms(100, 120, slice(60, 62), slice(78, 94))), 0.25)


@pytest.mark.parametrize("yaw_rad", [0.0, 0.5, -2.0])
@pytest.mark.parametrize("action", [Action.EAST, Action.NORTH, Action.WEST, Action.SOUTH])
def test_on_an_open_floor_one_goes_straight_to_the_goal(action: Action, yaw_rad: float) -> None:
    """In each direction of a turned map, along anchors to the very point."""
    coarse = open_floor(yaw_rad)
    angle = yaw_rad + (action - 1) * math.pi / 2
    middle_m = coarse.anchors_m[6, 6]
    goal_m = middle_m + 2.05 * np.array([math.cos(angle), math.sin(angle)])
    table = table_of(coarse, (goal_m[0], goal_m[1]), STEPPER)
    chosen = choose(table, coarse, middle_m[0], middle_m[1], angle, 30, *NOBODY)
    assert chosen is action
    points_m = way(table, coarse, middle_m[0], middle_m[1], action - 1, chosen)
    assert len(points_m) == 4
    np.testing.assert_allclose(points_m[-1], goal_m)
    along = (points_m - middle_m) @ np.array([math.cos(angle), math.sin(angle)])
    np.testing.assert_allclose(along, [0.5, 1.0, 1.5, 2.05], atol=0.051)


def test_in_the_goals_cell_there_is_no_way_to_go() -> None:
    """One is there."""
    coarse = open_floor()
    table = table_of(coarse, (3.1, 3.2), STEPPER)
    points_m = way(table, coarse, 3.3, 3.3, 0, Action.STAY)
    assert points_m.shape == (0, 2)


def test_where_no_way_is_known_one_stays() -> None:
    """Behind a wall, and outside the map."""
    coarse = CoarseMap(terrain_of(two_rooms(60, 60, slice(30, 31), None)), 0.25)
    table = table_of(coarse, (0.5, 0.5), STEPPER)
    for x_m in (2.5, 9.0):
        assert choose(table, coarse, x_m, 0.5, 0.0, 30, *NOBODY) is Action.STAY
        points_m = way(table, coarse, x_m, 0.5, 0, Action.WEST)
        assert points_m.shape == (0, 2)


@pytest.mark.parametrize("reach", [1, 2, 3, 7])
def test_the_way_leads_through_the_door(reach: int) -> None:
    """From one room to the other, by neighbouring anchors, whatever the reach."""
    coarse = door_floor()
    table = table_of(coarse, (5.3, 0.5), TravelModel(reaches=(reach,)))
    start_m = (0.7, 0.7)
    action = choose(table, coarse, *start_m, 0.0, 30, *NOBODY)
    points_m = way(table, coarse, *start_m, 0, action, 40)
    assert points_m[-1].tolist() == [5.3, 0.5]
    cells = [coarse.cell_of(*start_m), *(coarse.cell_of(*point_m) for point_m in points_m)]
    for one, other in pairwise(cells):
        assert one is not None
        assert other is not None
        assert abs(one[0] - other[0]) + abs(one[1] - other[1]) == 1
    crossed = np.flatnonzero(np.diff(points_m[:, 0] > 3.05))
    assert len(crossed) == 1
    assert (points_m[crossed[0] : crossed[0] + 2, 1] > 3.9).all()


def test_a_way_is_cut_to_what_was_asked_for() -> None:
    """Of a long way the first points."""
    coarse = door_floor()
    table = table_of(coarse, (5.3, 0.5), STEPPER)
    action = choose(table, coarse, 0.7, 0.7, 0.0, 30, *NOBODY)
    longer = way(table, coarse, 0.7, 0.7, 0, action, 99)
    first = way(table, coarse, 0.7, 0.7, 0, action, 5)
    assert (first == longer[:5]).all()
    assert len(first) == 5 < len(longer)


def test_from_every_place_the_way_leads_to_the_goal() -> None:
    """The best actions end at the goal from each cell and heading, with slips to fear or not."""
    walls = np.random.default_rng(2).random((100, 120)) < 0.004
    coarse = CoarseMap(terrain_of(walls), 0.25)
    slipping = TravelModel(reaches=(2,), slip=0.2, half_turn=3.0)
    dear = TravelModel(reaches=(1,), quarter_turn=0.3, half_turn=3.0)
    for model, horizon in ((TravelModel(reaches=(3,)), 60), (slipping, 60), (dear, 60), (dear, 20)):
        table = ValueTables(horizon=horizon).value(coarse, model, (3.0, 2.5))
        assert table is not None
        for (row, col), heading in product(np.ndindex(coarse.shape), range(4)):
            x_m, y_m = coarse.anchors_m[row, col].tolist()
            if not table.reaches((row, col)) or (row, col) == table.goal:
                continue
            yaw_rad = heading * math.pi / 2
            action = choose(table, coarse, x_m, y_m, yaw_rad, 60, *NOBODY)
            points_m = way(table, coarse, x_m, y_m, heading, action, 500)
            assert tuple(points_m[-1]) == table.goal_m


@pytest.mark.parametrize(("goal_m", "action"), [((9.3, 4.8), 1), ((2.8, 9.3), 2), ((9.1, 9.3), 1)])
def test_in_the_open_the_way_is_by_the_straight_line(
    goal_m: tuple[float, float], action: int
) -> None:
    """No point of it, after the move, is farther from the line than a cell."""
    coarse = CoarseMap(terrain_of(np.zeros((200, 200), np.bool_)), 0.25)
    table, start_m = table_of(coarse, goal_m, STEPPER), np.array(coarse.anchors_m[2, 2])
    x_m, y_m = start_m.tolist()
    points_m = way(table, coarse, x_m, y_m, 0, Action(action), 99)
    along = (np.array(goal_m) - start_m) / math.dist(goal_m, start_m)
    away_m = np.abs((points_m - start_m) @ np.array([-along[1], along[0]]))
    assert tuple(points_m[-1]) == table.goal_m
    assert away_m.max() < 0.5


def test_a_way_costs_what_the_values_are_made_of() -> None:
    """The prices of its cells sum up to the cost of the cheapest way."""
    coarse = CoarseMap(terrain_of(np.random.default_rng(2).random((100, 120)) < 0.004), 0.25)
    model = TravelModel(reaches=(3,))
    table = table_of(coarse, (3.0, 2.5), model)
    for row, col in np.argwhere(np.isfinite(table.costs)).tolist():
        x_m, y_m = coarse.anchor_of((row, col))
        points_m = way(table, coarse, x_m, y_m, 0, Action.STAY, 99)
        cells = [coarse.cell_of(*point_m) for point_m in points_m.tolist()]
        cost = sum(model.time + model.clearance * coarse.nearness[cell] for cell in cells) / 3
        assert cost == pytest.approx(table.cost((row, col)), rel=1e-4, abs=1e-6)


def test_one_steps_aside_for_who_stands_in_the_way() -> None:
    """With somebody ahead a quarter turn is better than going on, or than staying."""
    coarse = open_floor()
    table = table_of(coarse, (5.25, 3.25), TravelModel(quarter_turn=0.02, half_turn=2.0))
    assert choose(table, coarse, 1.25, 3.25, 0.0, 30, *NOBODY) is Action.EAST
    crowd = somebody(1.95, 3.25, radius_m=0.3, weight=2.0)
    chosen = choose(table, coarse, 1.25, 3.25, 0.0, 30, *crowd)
    assert chosen in {Action.NORTH, Action.SOUTH}


def test_in_a_corridor_one_waits_for_who_comes() -> None:
    """Where there is no way around, staying is better than running into somebody."""
    walls = np.zeros((20, 120), np.bool_)
    walls[:5] = walls[-5:] = True
    coarse = CoarseMap(terrain_of(walls), 0.1)
    table = table_of(coarse, (5.3, 0.5), STEPPER)
    start_m = (1.25, 0.5)
    assert choose(table, coarse, *start_m, 0.0, 30, *NOBODY) is Action.EAST
    crowd = somebody(2.1, 0.5, radius_m=0.4, weight=2.0)
    assert choose(table, coarse, *start_m, 0.0, 30, *crowd) in {Action.STAY, Action.WEST}


def test_a_step_aside_is_not_undone_in_the_same_epoch() -> None:
    """To the north, then on to the east; back to the south would be as cheap."""
    coarse = open_floor()
    table = table_of(coarse, (5.25, 2.25), TravelModel(reaches=(3,)))
    points_m = way(table, coarse, 1.25, 3.25, 0, Action.NORTH)
    assert points_m[:3, 1].tolist() == [points_m[0, 1]] * 3
    assert (np.diff(points_m[:3, 0]) > 0.3).all()


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6))
def test_a_walker_neither_goes_back_for_others_nor_turns_into_them(seed: int) -> None:
    """Moves that are not made have no value: back from where the way leads, and those that fail.

    The way is that of six cells along falling costs; back is more than 120 degrees from it.
    """
    random = np.random.default_rng(seed)
    coarse = CoarseMap(terrain_of(random.random((40, 50)) < 0.003, resolution_m=0.1), 0.1)
    reaches = (2, 4)
    model = TravelModel(reaches=reaches, effort=(0.0, 0.05), rest=0.09)
    table = table_of(coarse, (2.55, 1.55), model)
    crowd = random.random((3, 2)) * 4.0, random.random(3), random.random(3)
    is_met, best_move = occupied(coarse, crowd), int(random.integers(0, 5))
    steps = [(0, 1), (1, 0), (0, -1), (-1, 0)]
    for row, col in np.argwhere(np.isfinite(table.costs))[::37].tolist():
        brings = random.random((2, 5))
        before = brings.copy()
        others, state = packed(*crowd), (row, col, int(random.integers(0, 4)))
        _route_kernels.leave_out(
            table.value_arrays, coarse.anchors_m, others, state, best_move, brings
        )
        assert (brings[:, 0] == before[:, 0]).all()
        here_m, points_m = coarse.anchors_m[row, col], np.empty((6, 2))
        arrays, stays = table.value_arrays, (0, 0)
        count = _route_kernels.follow(arrays, coarse.anchors_m, state, stays, points_m)
        ahead_m = points_m[:count][-1:] - here_m
        for pace, direction in product(range(2), range(4)):
            rows, cols = steps[direction]
            length = min(reaches[pace], int(table.lengths[direction, row, col]))
            fails = any(is_met[row + k * rows, col + k * cols] for k in range(1, length + 1))
            move, is_back = direction + 1, False
            if length and len(ahead_m):
                step_m = coarse.anchors_m[row + rows, col + cols] - here_m
                turn = math.atan2(*step_m[::-1]) - math.atan2(*ahead_m[0, ::-1])
                is_back = abs(math.remainder(turn, math.tau)) > math.radians(120.0)
                is_back |= bool(table.costs[row + rows, col + cols] > table.costs[row, col])
            if fails and move == best_move:
                assert brings[pace, move] == before[0, 0] - 0.09
            elif fails or is_back:
                assert brings[pace, move] == -np.inf
            else:
                assert brings[pace, move] == before[pace, move]


def frozen(coarse: CoarseMap, others: Others) -> npt.NDArray[np.float32]:
    """Return what others cost in each cell, one by one."""
    penalty = np.zeros(coarse.shape, np.float32)
    for row, col in np.ndindex(coarse.shape):
        for point_m, radius_m, weight in zip(*others, strict=True):
            away_m = math.dist(coarse.anchors_m[row, col], point_m) - radius_m
            penalty[row, col] += weight * min(1.0, max(0.0, 1.0 - away_m / FADE_M))
    return penalty


def occupied(coarse: CoarseMap, others: Others) -> npt.NDArray[np.bool_]:
    """Return the cells in which one would meet somebody."""
    away_m = np.hypot(*np.moveaxis(coarse.anchors_m[:, :, None] - others[0], -1, 0))
    return np.asarray((away_m < others[1]).any(axis=-1))


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), ahead=st.integers(1, 2))
def test_the_lookahead_is_exact_where_others_move_and_then_are_gone(seed: int, ahead: int) -> None:
    """What each action brings is what the slow twin says, by all states and all epochs.

    In the first epochs others cost what they do where they are then, and nobody gets to there.
    """
    random = np.random.default_rng(seed)
    coarse = CoarseMap(terrain_of(random.random((40, 50)) < 0.003, resolution_m=0.1), 0.1)
    reach, epochs_left = int(random.integers(1, 4)), int(random.integers(ahead, 9))
    model = TravelModel(
        reaches=(reach, reach + 2),
        slip=float(random.choice([0.0, 0.1, 0.2])),
        effort=(0.0, 0.05),
        rest=0.09,
        late=2.0,
    )
    crowds = [
        (random.random((3, 2)) * 4.0, random.random(3), random.random(3)) for _ in range(ahead)
    ]
    table = table_of(coarse, (2.55, 1.55), model)
    slow = SlowTravel(coarse.edges, nearness_to_walls(coarse.room_m), table.goal, model)
    epochs = [
        Epoch(frozen(coarse, crowd).astype(np.float64), occupied(coarse, crowd)) for crowd in crowds
    ]
    values = slow.values(epochs_left - ahead)[-1]
    for epoch in reversed(epochs[1:]):
        values = slow.better(values, epoch)
    others = np.array([packed(*crowd) for crowd in crowds])
    for state in slow.states[:: 1 + len(slow.states) // 30]:
        if not slow.ends(state[:2]):
            ours = brings_at(table.value_arrays, coarse, epochs_left, others, state)
            expected = [slow.value_of(values, state, a, epochs[0]) for a in range(slow.actions)]
            assert ours[:, 0] == pytest.approx([expected[0]] * 2, abs=1e-5)
            np.testing.assert_allclose(ours[:, 1:].ravel(), expected[1:], atol=1e-5)


def test_of_equal_actions_the_one_ahead_is_taken() -> None:
    """At equal values one walks straight on, then left, right, back, and stays last."""
    best = _route_kernels.best_action
    for heading in range(4):
        brings = np.zeros((2, 5))
        assert best(brings, heading) == (0, 1 + heading)
        brings[:, 1 + heading] = -1.0
        assert best(brings, heading) == (0, 1 + (heading + 1) % 4)
        brings[:, 1 + (heading + 1) % 4] = -1.0
        assert best(brings, heading) == (0, 1 + (heading + 3) % 4)
        brings[1, 1 + heading] = 1.0
        assert best(brings, heading) == (1, 1 + heading)
    assert best(np.array([[1.0, 0.0, 0.0, 0.0, 0.0]]), 2) == (0, Action.STAY)
