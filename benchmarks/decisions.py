"""Backward induction by a stencil against QuantEcon's over a sparse matrix, in one run.

Rooms of 5 m with doors, cells of 0.5 m and four headings; staying, and four directions at each pace
with four outcomes (as intended, failed, slipped to the left, to the right). Both start from the
same V_0, zero but at the goal, so that every epoch changes something and none is left out;
QuantEcon's matrix is built before. Both keep one thread, whose time counts: other programs disturb
that less. Then: what one artefact's decision costs. Run:
python benchmarks/decisions.py [repetitions]
"""

import argparse
import functools
import importlib
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

from are_ros.agents.mdp.coarse_map import CoarseMap
from are_ros.agents.mdp.model import Problem, Solution, TravelModel, solve, ways_to
from are_ros.agents.mdp.model import problem_of as process_of
from are_ros.agents.mdp.value_tables import ValueTables
from are_ros.agents.navigation.step_kernels import prospect_of, way_along
from are_ros.agents.navigation.terrain import Terrain
from are_ros.agents.neighbours import Neighbourhood
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform

SIDES_AND_HORIZONS = ((200, 50), (64, 20))
REACHES = ((1,), (3,), (3, 5))
OUR_CALLS = 10  # short as they are, several to one measurement
CALLS = 2000
STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0))


def rooms(side: int) -> npt.NDArray[np.bool_]:
    """Return edges bool (4, side, side): walls every ten cells, a door of a cell in each."""
    edges = np.zeros((4, side, side), np.bool_)
    steps, doors = np.arange(side - 1) % 10 != 9, np.arange(side) % 10 == 4
    edges[0, :, :-1] = edges[2, :, 1:] = steps | doors[:, None]
    edges[1, :-1] = edges[3, 1:] = (steps | doors[:, None]).T
    return edges


def problem_of(side: int, reaches: tuple[int, ...]) -> Problem:
    """Return the process of going to the middle; beyond the goal V_0 is zero."""
    nearness = np.random.default_rng(0).random((side, side)).astype(np.float32)
    model, goal = _model(reaches), (side // 2, side // 2)
    problem = process_of(ways_to(rooms(side), nearness, goal, model))
    terminal = np.zeros_like(problem.terminal)
    terminal[:, goal[0], goal[1]] = model.goal
    return replace(problem, terminal=terminal)


def _model(reaches: tuple[int, ...]) -> TravelModel:
    effort = tuple(0.105 * (reach / reaches[0] - 1.0) for reach in reaches)
    return TravelModel(reaches, slip=0.1, effort=effort, rest=0.095, late=2.0)


def quantecon_process(problem: Problem, markov: Any) -> Any:
    """Return the same as QuantEcon's DiscreteDP; state heading * h * w + cell."""
    _, height, width = problem.terminal.shape
    cells, model, count = height * width, problem.model, 1 + 4 * len(problem.model.reaches)
    states = np.repeat(np.arange(4 * cells), count)
    actions = np.tile(np.arange(count), 4 * cells)
    gains, lengths = problem.gains.reshape(-1, cells), problem.lengths.reshape(4, cells)
    stay = gains[0, states % cells].astype(np.float64)
    moves = np.flatnonzero(actions > 0)
    cell, (pace, intended) = states[moves] % cells, np.divmod(actions[moves] - 1, 4)
    straight, fails, aside = model.chances
    lost = np.array(model.effort)[pace] + model.rest
    turns = np.array([0.0, model.quarter_turn, model.half_turn, model.quarter_turn])
    rewards = np.where(actions == 0, stay, 0.0)
    rewards[moves] = fails * (stay[moves] - lost) - turns[(intended - states[moves] // cells) % 4]
    entries = [
        (np.flatnonzero(actions == 0), states[actions == 0], 1.0),
        (moves, intended * cells + cell, fails),
    ]
    for turn, chance in ((0, straight), (1, aside), (3, aside)):
        direction = (intended + turn) % 4
        length = np.minimum(lengths[direction, cell], np.array(model.reaches)[pace])
        step = np.array([row * width + col for row, col in STEPS])[direction]
        entries.append((moves, direction * cells + cell + length * step, chance))
        rewards[moves] += chance * gains[1 + 4 * pace + direction, cell]
    matrix = sparse.csr_matrix(
        (
            np.concatenate([np.full(len(rows), chance) for rows, _, chance in entries]),
            (np.concatenate([e[0] for e in entries]), np.concatenate([e[1] for e in entries])),
        ),
        shape=(len(states), 4 * cells),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # beta = 1 has no infinite horizon, which is not asked for
        return markov.DiscreteDP(rewards, matrix, 1.0, states, actions)


def milliseconds(action: Callable[[], object], calls: int = 1) -> float:
    """Return what one call takes of this thread's time [ms], of several; others count less."""
    start = time.thread_time()
    for _ in range(calls):
        action()
    return 1e3 * (time.thread_time() - start) / calls


def compare(side: int, horizon: int, reaches: tuple[int, ...], repetitions: int) -> None:
    """Check that both agree, then print medians of interleaved runs and their ratio."""
    markov = importlib.import_module("quantecon.markov")
    induction = importlib.import_module("quantecon.markov.ddp").backward_induction
    problem = problem_of(side, reaches)
    process = quantecon_process(problem, markov)
    terminal = problem.terminal.ravel().astype(np.float64)
    theirs = functools.partial(induction, process, horizon, terminal)
    ours = functools.partial(solve, problem, horizon)
    apart = difference(theirs()[0], ours(), horizon)
    times = [(milliseconds(theirs), milliseconds(ours, OUR_CALLS)) for _ in range(repetitions)]
    theirs_ms, ours_ms = np.median(times, axis=0)
    print(
        f"{side:3d} x {side:3d} x 4 states, T = {horizon}, reaches {reaches!s:6}: "
        f"{theirs_ms:9.2f} {ours_ms:9.3f} {theirs_ms / ours_ms:8.1f}   {apart:.1e}"
    )


def difference(theirs: npt.NDArray[np.float64], ours: Solution, horizon: int) -> float:
    """Return by how much values differ at most, over all epochs kept; SystemExit if by too much."""
    if ours.epochs != horizon:
        raise SystemExit(f"only {ours.epochs} of {horizon} epochs were computed")
    first = horizon + 1 - len(ours.planes)
    kept = np.array([ours.plane(epoch) for epoch in range(horizon, first - 1, -1)])
    apart = float(np.abs(theirs[: len(kept)].reshape(kept.shape) - kept).max())
    if apart > 1e-4 * np.abs(theirs).max():
        raise SystemExit(f"the values differ by {apart}")
    return apart


def furnished_hall() -> CoarseMap:
    """Return a hall of 32 x 32 m with a thousand posts, for a disc of 0.25 m."""
    cells = np.zeros((640, 640), np.int8)
    cells.ravel()[np.random.default_rng(1).permutation(cells.size)[:1000]] = 100
    grid = OccupancyGrid(cells, 0.05, RigidTransform.identity(), "map")
    environment = Environment(grid, classify(grid, 65, 25), None, PlaneGround(), 0.06)
    return CoarseMap(Terrain(environment, 1.75), 0.25)


def decide() -> None:
    """Print what a decision takes, once its values are there and before."""
    coarse, model, tables = furnished_hall(), _model((3, 5)), ValueTables()
    random = np.random.default_rng(2)
    corner_m = coarse.anchors_m[5, 5]
    goals_m = [tuple((corner_m + random.random(2) * 20.0).tolist()) for _ in range(6)]
    tables_ms = [milliseconds(functools.partial(tables.value, coarse, model, g)) for g in goals_m]
    table = tables.value(coarse, model, goals_m[0])
    if table is None:
        raise SystemExit("the goal is in a wall")
    print(f"values of a new goal, 64 x 64 cells, 60 epochs: {np.median(tables_ms[1:]):.2f} ms")
    x_m, y_m = coarse.anchors_m[60, 60].tolist()
    poses = np.zeros((11, 4))
    poses[:, :2] = random.random((11, 2)) * 3.0 + (x_m - 1.5, y_m - 1.5)
    poses[0, :2] = x_m, y_m
    cells = Neighbourhood(poses[:, :2]).cells
    crowd = (*cells, poses, poses[:, None, :2] + ((1.0, 0.0), (2.0, 0.0)), np.full(11, 0.3))
    ends, no_robot = (0.25, goals_m[0], goals_m[0], 0.5, 0.0, False), (np.zeros((2, 2)), -1.0)
    active = (tuple(coarse.ground), tuple(table.value_arrays), ends)
    choice = (crowd, no_robot, (0, True, 30), False, np.empty((2, 5)), *active)
    way = (*active, (x_m, y_m, 0.0), (0, 3), np.empty((128, 2)))
    calls: dict[str, Callable[[], object]] = {
        "values of a known goal": functools.partial(tables.value, coarse, model, goals_m[0]),
        "actions, 10 others": functools.partial(prospect_of, *choice),
        "the way of one": functools.partial(way_along, *way),
    }
    for name, call in calls.items():
        call()
        times = [milliseconds(call, CALLS) for _ in range(5)]
        print(f"{name:24s} {1e3 * np.median(times):8.2f} us")


def main(repetitions: int) -> None:
    """Print all figures of one run."""
    try:
        version = importlib.import_module("quantecon").__version__
    except ImportError:
        raise SystemExit("QuantEcon is not installed: pip install quantecon") from None
    print(f"QuantEcon {version}; median of {repetitions}, one thread each")
    print(f"{'':47s} {'theirs ms':>9s} {'ours ms':>9s} {'ratio':>8s}   difference")
    for side, horizon in SIDES_AND_HORIZONS:
        for reaches in REACHES:
            compare(side, horizon, reaches, repetitions)
    decide()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("repetitions", nargs="?", type=int, default=5)
    main(parser.parse_args().repetitions)
