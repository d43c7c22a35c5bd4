"""Tests of the decision process of going to a place."""

import math
import re
from dataclasses import replace
from itertools import islice, pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import lil_matrix
from scipy.sparse.csgraph import dijkstra

from are_ros.agents.mdp import travel_kernels as _travel_kernels
from are_ros.agents.mdp.model import (
    MAX_REACH,
    UNREACHABLE,
    Problem,
    Solution,
    TravelModel,
    solve,
    ways_to,
)
from are_ros.errors import ParameterError
from are_ros.population.catalogue import CatalogueRow, MotionLimits, RewardWeights
from are_ros.population.meshes.shapes import Shape
from tests.agents.mdp.slow_travel import (
    STEPS,
    SlowTravel,
    plain_epochs,
    quantecon_arguments,
    random_edges,
    travel_problem,
)

Arguments = tuple[npt.NDArray[np.bool_], npt.NDArray[np.float32], tuple[int, int], TravelModel]


def some_arguments(seed: int, shape: tuple[int, int] = (6, 7)) -> Arguments:
    """Return edges, nearness, goal and model of a random small map."""
    random = np.random.default_rng(seed)
    edges = random_edges(random.choice([0.5, 0.8, 1.0]), shape, random)
    nearness = random.random(shape).astype(np.float32)
    goal = (int(random.integers(shape[0])), int(random.integers(shape[1])))
    reach = int(random.integers(1, 4))
    reaches = (reach,) if random.random() < 0.5 else (reach, reach + int(random.integers(1, 5)))
    model = TravelModel(
        reaches=reaches,
        slip=float(random.choice([0.0, 0.1, 0.2])),
        time=0.1,
        clearance=float(random.random()),
        effort=tuple(0.2 * float(random.random()) * pace for pace in range(len(reaches))),
        rest=0.1 * float(random.random()),
        goal=float(random.random()),
        late=1.0 + float(random.random()),
        quarter_turn=float(0.2 * random.random()),
        half_turn=float(0.5 + random.random()),
    )
    return edges, nearness, goal, model


def one_pace(model: TravelModel, reach: int, slip: float | None = None) -> TravelModel:
    """Return a model with this reach only."""
    slip = model.slip if slip is None else slip
    return replace(model, reaches=(reach,), effort=model.effort[:1], slip=slip)


def open_floor(height: int, width: int) -> npt.NDArray[np.bool_]:
    """Return the edges of a floor without walls."""
    return random_edges(2.0, (height, width), np.random.default_rng(0))


def as_array(values: dict[tuple[int, int, int], float], shape: tuple[int, ...]) -> Any:
    """Return values by state as an array (4, h, w)."""
    array = np.empty((4, *shape))
    for (row, col, heading), value in values.items():
        array[heading, row, col] = value
    return array


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_all_values_are_those_of_the_slow_twin(seed: int) -> None:
    """V_h agrees with dictionaries in float64 for each number of epochs left."""
    arguments = some_arguments(seed)
    solution = solve(travel_problem(*arguments), 7)
    for epochs, values in enumerate(SlowTravel(*arguments).values(7)):
        expected = as_array(values, (6, 7))
        np.testing.assert_allclose(solution.plane(epochs), expected, rtol=1e-5, atol=1e-5)


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_a_penalty_adds_to_the_price_of_being_somewhere(seed: int) -> None:
    """With others who stand there for good the values are those of the slow twin, too."""
    arguments = some_arguments(seed)
    penalty = np.random.default_rng(seed + 1).random((6, 7)).astype(np.float32)
    solution = solve(travel_problem(*arguments, penalty), 5)
    for epochs, values in enumerate(SlowTravel(*arguments, penalty).values(5)):
        expected = as_array(values, (6, 7))
        np.testing.assert_allclose(solution.plane(epochs), expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("seed", range(12))
def test_values_are_those_of_quantecon(seed: int) -> None:
    """Backward induction agrees with QuantEcon's on the same process as a sparse matrix."""
    from quantecon.markov import DiscreteDP
    from quantecon.markov.ddp import backward_induction

    problem = travel_problem(*some_arguments(seed, (9, 8)))
    with pytest.warns(UserWarning, match="infinite horizon"):
        process = DiscreteDP(
            *quantecon_arguments(problem)[:2], 1.0, *quantecon_arguments(problem)[2:]
        )
    terminal = problem.terminal.ravel().astype(np.float64)
    theirs, _ = backward_induction(process, 12, terminal)
    ours = solve(problem, 12)
    for epochs in range(13):
        expected = theirs[12 - epochs].reshape(4, 9, 8)
        np.testing.assert_allclose(ours.plane(epochs), expected, rtol=1e-5, atol=1e-5)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_values_never_rise_with_the_epochs_left_if_nothing_is_lost_by_being_late(seed: int) -> None:
    """V_0 is then a bound that no policy of one pace beats, so each epoch can but correct it.

    Where turning costs nothing: else a longer way with fewer turns may do better than V_0 says.
    """
    edges, nearness, goal, model = some_arguments(seed)
    model = one_pace(model, model.reaches[0])
    model = replace(model, late=1.0, rest=0.0, quarter_turn=0.0, half_turn=0.0)
    solution = solve(travel_problem(edges, nearness, goal, model), 12)
    assert (np.diff(solution.planes, axis=0) <= 2e-6).all()


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_a_cell_is_settled_from_the_last_epoch_on_that_changed_it(seed: int) -> None:
    """And not before that, if it ever was changed."""
    solution = solve(travel_problem(*some_arguments(seed)), 12)
    changed = (np.diff(solution.planes, axis=0) != 0.0).any(axis=1)
    last = np.where(changed.any(axis=0), len(changed) - changed[::-1].argmax(axis=0), 0)
    assert (solution.settled == last).all()


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_the_goal_is_the_best_place(seed: int) -> None:
    """Being at the goal is worth its reward at any time and heading; anywhere else is worse."""
    edges, nearness, goal, model = some_arguments(seed)
    solution = solve(travel_problem(edges, nearness, goal, model), 12)
    at_goal = solution.planes[:, :, goal[0], goal[1]]
    assert (at_goal == np.float32(model.goal)).all()
    assert solution.planes.max() == np.float32(model.goal)
    assert (solution.planes == at_goal.max()).sum() == at_goal.size


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_where_no_way_leads_the_value_stays_what_it_is(seed: int) -> None:
    """Cells without a way to the goal keep one low value, whatever the horizon."""
    problem, costs = travel_problem(*some_arguments(seed)), ways_to(*some_arguments(seed)).costs
    apart = np.isinf(costs)
    planes = solve(problem, 12).planes
    assert (planes[:, :, apart] == UNREACHABLE).all()
    assert (planes[:, :, ~apart] > -1e3).all()
    assert not problem.lengths[:, apart].any()


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), reach=st.integers(1, 9))
def test_every_cell_with_a_way_comes_nearer_to_the_goal(seed: int, reach: int) -> None:
    """Whatever the reach, some move from each cell ends where less of the way is left."""
    edges, nearness, goal, model = some_arguments(seed)
    slow = SlowTravel(edges, nearness, goal, one_pace(model, reach))
    left = ways_to(edges, nearness, goal, slow.model).costs
    for cell in np.argwhere(np.isfinite(left)).tolist():
        ends = [slow.moved((cell[0], cell[1]), d) for d in range(4)]
        costs = [left[end[-1]] for end in ends if end]
        assert tuple(cell) == goal or min(costs) < left[tuple(cell)]


@pytest.mark.parametrize(
    ("open_share", "spread", "power"),
    [(0.8, 0.0, 1), (0.8, 1.0, 1), (0.9, 100.0, 4), (1.0, 1e7, 20)],
)
def test_prices_of_ways_are_exact_however_wild_prices_are(
    open_share: float, spread: float, power: int
) -> None:
    """Also where the dearest step costs a million times the cheapest, against scipy's Dijkstra.

    In the last case so many cells are looked at again that the memory for it has to grow.
    """
    random = np.random.default_rng(4)
    edges = random_edges(open_share, (40, 40), random)
    price = (0.01 + spread * random.random((40, 40)) ** power).astype(np.float32)
    graph = lil_matrix((1600, 1600))
    for direction, row, col in np.argwhere(edges).tolist():
        step = STEPS[direction]
        graph[row * 40 + col, (row + step[0]) * 40 + col + step[1]] = price[row, col]
    expected = dijkstra(graph.tocsr(), indices=613).reshape(40, 40)
    ours = _travel_kernels.way_prices(edges, price, 1, (15, 13))
    np.testing.assert_allclose(ours, expected, rtol=1e-5)


def test_moves_go_as_far_as_the_reach_and_end_at_walls_and_at_the_goal() -> None:
    """On a corridor of nine cells with a closed edge, three cells an epoch."""
    edges = open_floor(1, 9)
    edges[0, 0, 1] = edges[2, 0, 2] = False
    problem = travel_problem(edges, np.zeros((1, 9), np.float32), (0, 7), TravelModel(reaches=(3,)))
    assert problem.lengths[0, 0].tolist() == [0, 0, 3, 3, 3, 2, 1, 0, 0]
    assert problem.lengths[2, 0].tolist() == [0, 0, 0, 1, 1, 1, 1, 0, 1]
    assert not problem.lengths[[1, 3]].any()
    assert (problem.terminal[:, 0, :2] == UNREACHABLE).all()


def test_moves_end_where_the_way_turns_off() -> None:
    """Three cells an epoch do not run past a door that is not a multiple of three away."""
    edges = open_floor(2, 9)
    edges[1, 0] = edges[3, 1] = False
    edges[1, 0, 4] = edges[3, 1, 4] = True
    problem = travel_problem(edges, np.zeros((2, 9), np.float32), (1, 4), TravelModel(reaches=(3,)))
    assert problem.lengths[0, 0].tolist() == [3, 3, 2, 1, 1, 1, 1, 1, 0]


def test_it_ends_early_when_nothing_changes() -> None:
    """Once V_h is V_{h-1} everywhere all later ones are, and are not computed."""
    problem = travel_problem(open_floor(4, 4), np.zeros((4, 4), np.float32), (0, 0), TravelModel())
    early, late = solve(problem, 40), solve(problem, 300)
    assert early.epochs == late.epochs < 40
    assert (early.planes == late.planes).all()
    assert (early.plane(early.epochs) == early.plane(39)).all()


@pytest.mark.parametrize("goal", [(0, 0), (39, 69)])
@pytest.mark.parametrize("kept_bytes", [0, 2**30])
def test_it_ends_no_sooner_than_the_last_cell_is_settled(
    goal: tuple[int, int], kept_bytes: int
) -> None:
    """On a map of many cells, those far from the goal change when all others do not any more."""
    nearness = np.zeros((40, 70), np.float32)
    problem = travel_problem(open_floor(40, 70), nearness, goal, TravelModel())
    epochs = pairwise(plain_epochs(problem))
    expected = next(k for k, (old, new) in enumerate(epochs, 1) if (old == new).all())
    assert expected > 2
    assert solve(problem, 200, kept_bytes).epochs == expected


def test_a_short_horizon_keeps_nobody_from_setting_out() -> None:
    """With a few epochs for a long way, going ahead is worth more than staying."""
    model = TravelModel(quarter_turn=0.1, half_turn=0.2)
    problem = travel_problem(open_floor(1, 50), np.zeros((1, 50), np.float32), (0, 49), model)
    plane = solve(problem, 3).plane(3)
    assert plane[0, 0, 1] + problem.gains[1, 0, 0] > plane[0, 0, 0] + problem.gains[0, 0, 0]
    assert plane[2, 0, 0] == pytest.approx(plane[0, 0, 0] - model.half_turn)


def test_large_tables_keep_the_longest_horizon_only() -> None:
    """Beyond the bound of memory the one plane left is the last of those kept otherwise."""
    problem = travel_problem(*some_arguments(3))
    everything, last = solve(problem, 6), solve(problem, 6, kept_bytes=1000)
    assert everything.planes.shape == (7, 4, 6, 7)
    assert last.planes.shape == (1, 4, 6, 7)
    assert (last.plane(2) == everything.plane(6)).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1), (50, 45)])
def test_any_shape_will_do(shape: tuple[int, int]) -> None:
    """Maps of one cell, thin ones, and ones of more cells than fit into the scratch."""
    model = TravelModel(reaches=(2,), slip=0.1)
    nearness = np.zeros(shape, np.float32)
    problem = travel_problem(open_floor(*shape), nearness, (0, 0), model)
    values = SlowTravel(open_floor(*shape), nearness, (0, 0), model).values(2)[-1]
    ours = solve(problem, 2).plane(2)
    np.testing.assert_allclose(ours, as_array(values, shape), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("shape", [(9, 8), (40, 70), (5, 300), (1, 2000), (700, 2)])
@pytest.mark.parametrize("reaches", [(1,), (3,), (2, 4), (3, 6), (7, 11)])
@pytest.mark.parametrize("slip", [0.0, 0.1, 0.2])
def test_whatever_is_kept_it_is_plain_induction_to_the_last_bit(
    shape: tuple[int, int], reaches: tuple[int, ...], slip: float
) -> None:
    """All planes, or that of the longest horizon alone."""
    edges, nearness, goal, model = some_arguments(reaches[0] + sum(shape), shape)
    effort = tuple(0.07 * pace for pace in range(len(reaches)))
    model = replace(model, reaches=reaches, effort=effort, slip=slip)
    problem = travel_problem(edges, nearness, goal, model)
    expected = list(islice(plain_epochs(problem), 10))
    everything, last = solve(problem, 9, kept_bytes=2**30), solve(problem, 9, kept_bytes=0)
    for epochs, values in enumerate(expected):
        assert (everything.plane(epochs) == values).all()
    assert last.planes.shape == (1, 4, *shape)
    assert (last.planes[0] == expected[-1]).all()


def test_a_solution_answers_for_more_epochs_than_it_has() -> None:
    """Beyond the last plane the last one holds."""
    planes = np.zeros((2, 4, 1, 1), np.float32)
    planes[1] = 1.0
    solution = Solution(planes, np.zeros((1, 1), np.int32), 1)
    assert solution.plane(0).max() == 0.0
    assert solution.plane(1).min() == solution.plane(99).min() == 1.0


def row_with(motion: MotionLimits) -> CatalogueRow:
    """Return a catalogue row that moves so."""
    rewards = RewardWeights(goal=2.0, time=0.2, clearance=0.3)
    box, nowhere = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
    surface = next(iter(Shape))
    return CatalogueRow(0, "one", "some", box, nowhere, surface, motion=motion, rewards=rewards)


def test_a_type_becomes_numbers() -> None:
    """Reach is speed times period in cells; turning on the spot costs the time that it takes."""
    row = row_with(MotionLimits(speed_mps=1.4, turn_rate_radps=0.5 * np.pi))
    model = TravelModel.of(row, (1.4, 2.6), cell_size_m=0.5, period_s=1.0, slip=0.1)
    assert model.reaches == (3, 5)
    assert (model.goal, model.time, model.clearance, model.slip) == (2.0, 0.2, 0.3, 0.1)
    assert model.effort == pytest.approx((0.0, 1.05 * 0.2 * 2 / 3))
    assert (model.rest, model.late) == pytest.approx((0.95 * 0.2, 3.0))
    assert (model.quarter_turn, model.half_turn) == pytest.approx((0.2, 0.4))


def test_who_cannot_turn_on_the_spot_pays_dearly_for_turning_around() -> None:
    """A quarter turn takes a quarter of the circle, a half one twenty seconds more."""
    row = row_with(MotionLimits(speed_mps=5.0, turn_rate_radps=9.0, turn_radius_m=5.0))
    model = TravelModel.of(row, (5.0,), cell_size_m=0.5, period_s=1.0, slip=0.0)
    assert model.reaches == (10,)
    assert model.quarter_turn == pytest.approx(0.2 * 0.5 * np.pi)
    assert model.half_turn == pytest.approx(2.0 * model.quarter_turn + 0.2 * 20.0)


def test_who_is_slow_goes_one_cell() -> None:
    """Even a speed of nothing has a reach of one cell."""
    model = TravelModel.of(row_with(MotionLimits()), (0.0,), 0.5, 1.0, 0.0)
    assert model.reaches == (1,)


def test_who_is_faster_than_any_number_goes_as_far_as_anyone() -> None:
    """A user's behaviour may give 1e308 m/s, of which the cells per epoch are inf."""
    model = TravelModel.of(row_with(MotionLimits()), (1.0, 1e308), 0.05, 1.0, 0.0)
    assert model.reaches == (20, MAX_REACH)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("reaches", (0,)),
        ("reaches", (1, 256)),
        ("effort", (0.0, 1.0)),
        ("effort", (-1.0,)),
        ("slip", -0.1),
        ("slip", 1.1),
        ("rest", 0.2),
        ("late", 0.5),
        ("time", 0.0),
        ("clearance", -1.0),
        ("quarter_turn", math.nan),
        ("half_turn", math.inf),
    ],
)
def test_impossible_numbers_are_refused(field: str, value: Any) -> None:
    """In a sentence that holds the number."""
    numbers: dict[str, Any] = {field: value}
    with pytest.raises(ParameterError, match=re.escape(str(value))):
        replace(TravelModel(), **numbers)


@pytest.mark.parametrize("heading", range(4))
def test_who_must_turn_first_loses_by_putting_it_off(heading: int) -> None:
    """Where turning is dear and resting cheap, as for a car whose goal is behind it.

    V_0 without that turn made resting for ever, and being late, the best that it could do.
    """
    model = TravelModel(reaches=(4,), rest=0.095, late=3.0, quarter_turn=0.42, half_turn=2.83)
    edges = open_floor(41, 41)
    solution = solve(travel_problem(edges, np.zeros((41, 41), np.float32), (20, 8), model), 40)
    plane = solution.plane(40)
    assert plane[heading, 20, 20] == solution.plane(39)[heading, 20, 20]


def test_a_problem_says_what_it_is_made_of() -> None:
    """The terminal value is the goal's less what the way costs, and turning on it."""
    problem: Problem = travel_problem(
        open_floor(1, 3), np.array([[0.0, 1.0, 0.0]], np.float32), (0, 2), TravelModel(goal=5.0)
    )
    turns = np.array([0.0, 0.1, 0.2, 0.1])[:, np.newaxis, np.newaxis]
    expected = np.array([[4.3, 4.9, 5.0]]) - turns * np.array([[1.0, 1.0, 0.0]])
    np.testing.assert_allclose(problem.terminal, expected, rtol=1e-6)
    np.testing.assert_allclose(problem.gains[0], [[-0.1, -0.6, 0.0]], rtol=1e-6)
