"""Tests of the way over fine cells that leads round a corner."""

import math
from collections import deque
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.agents.mdp.coarse_map import CoarseMap
from are_ros.agents.navigation.local_way import AHEAD, LEAST_M, MARGINS, way_round
from are_ros.agents.navigation.terrain import disc_fits
from tests.agents.floors import terrain_of, two_rooms

Mask = npt.NDArray[np.bool_]
Point = tuple[float, float]
CELL_M = 0.05


def to_points(points: list[Point]) -> npt.NDArray[np.float64]:
    """Return a way (K, 2)."""
    return np.array(points, np.float64).reshape(-1, 2)


def fitting(coarse: CoarseMap, radius_m: float) -> Mask:
    """Tell at which fine cells a disc fits."""
    field = coarse.ground.clearance_m
    cells, cell_m = np.ndindex(field.shape), coarse.grid.resolution_m
    fits = [disc_fits(field, row, col, radius_m, cell_m) for row, col in cells]
    return np.array(fits).reshape(field.shape)


def steps_between(open_cells: Mask, start: tuple[int, int], goal: tuple[int, int]) -> float:
    """Count the steps from cell to cell; inf where there is no way."""
    queue, known = deque([start]), {start: 0}
    while queue:
        row, col = queue.popleft()
        if (row, col) == goal:
            return known[goal]
        for r, c in ((row, col + 1), (row + 1, col), (row, col - 1), (row - 1, col)):
            inside = 0 <= r < open_cells.shape[0] and 0 <= c < open_cells.shape[1]
            if inside and open_cells[r, c] and (r, c) not in known:
                known[r, c] = known[row, col] + 1
                queue.append((r, c))
    return math.inf


def walk(coarse: CoarseMap, start_m: Point, goal_m: Point, radius_m: float) -> list[Point]:
    """Go from point to point, each time to where the search says, at most 40 times."""
    points = [start_m]
    for _ in range(40):
        if points[-1] == goal_m:
            break
        x_m, y_m, is_found = way_round(coarse.ground, points[-1], to_points([goal_m]), radius_m)
        assert is_found
        points.append((x_m, y_m))
    return points


def test_round_the_end_of_a_wall_it_goes_past_the_end() -> None:
    """From one side of a wall to the other: to its end first, which is seen, then to the goal."""
    walls = two_rooms(40, 40, slice(19, 21), slice(26, 40))
    terrain = terrain_of(walls)
    coarse = CoarseMap(terrain, 0.2)
    points = walk(coarse, (0.625, 1.025), (1.375, 1.025), 0.2)
    assert points[-1] == (1.375, 1.025)
    assert 3 <= len(points) <= 6
    assert max(y_m for _, y_m in points) > 1.4
    for before, after in pairwise(points):
        assert terrain.sees(before, after, 0.2)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), radius_m=st.sampled_from([0.06, 0.11, 0.16]))
def test_a_way_is_found_where_one_is_and_leads_nearer(seed: int, radius_m: float) -> None:
    """On random clutter, against a search cell by cell over all of the floor."""
    random = np.random.default_rng(seed)
    walls = random.random((30, 30)) < random.choice([0.01, 0.03, 0.08])
    terrain = terrain_of(walls, yaw_rad=0.0)
    coarse = CoarseMap(terrain, radius_m)
    fits = fitting(coarse, radius_m)
    cells = np.argwhere(fits)
    if len(cells) < 2:
        return
    start, goal = (tuple(cells[k].tolist()) for k in random.integers(len(cells), size=2))
    start_m, goal_m = (
        tuple(terrain.grid.cells_to_points(np.array([cell]))[0].tolist()) for cell in (start, goal)
    )
    x_m, y_m, is_found = way_round(coarse.ground, start_m, to_points([goal_m]), radius_m)
    # Three blocks beyond start and goal are all of a floor of three blocks a side.
    before = steps_between(fits, start, goal)
    assert is_found == math.isfinite(before)
    if not is_found:
        assert (x_m, y_m) == goal_m
        return
    there = tuple(terrain.grid.points_to_cells(np.array([(x_m, y_m)]))[0].tolist())
    assert fits[there]
    assert math.dist((x_m, y_m), start_m) >= LEAST_M or (x_m, y_m) == goal_m
    assert steps_between(fits, there, goal) < before or start == goal


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_the_points_lead_to_the_goal(seed: int) -> None:
    """Going from one to the next gets there, nearly always along what a disc rolls straight."""
    random = np.random.default_rng(seed)
    terrain = terrain_of(random.random((30, 30)) < 0.03)
    coarse = CoarseMap(terrain, 0.11)
    fits = fitting(coarse, 0.11)
    cells = np.argwhere(fits)
    start, goal = (tuple(cells[k].tolist()) for k in random.integers(len(cells), size=2))
    if math.isinf(steps_between(fits, start, goal)):
        return
    start_m, goal_m = (
        tuple(terrain.grid.cells_to_points(np.array([cell]))[0].tolist()) for cell in (start, goal)
    )
    assert walk(coarse, start_m, goal_m, 0.11)[-1] == goal_m


@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, -2.5])
def test_a_turned_map_gives_the_same_way_turned(yaw_rad: float) -> None:
    """Points of the map frame go in and come out."""
    walls = two_rooms(40, 40, slice(19, 21), slice(26, 40))
    straight, turned = (CoarseMap(terrain_of(walls, yaw_rad=yaw), 0.2) for yaw in (0.0, yaw_rad))
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)

    def turn(point: Point) -> Point:
        return cosine * point[0] - sine * point[1], sine * point[0] + cosine * point[1]

    start_m, goal_m = (0.63, 1.02), (1.37, 1.02)
    found = way_round(straight.ground, start_m, to_points([goal_m]), 0.2)
    other = way_round(turned.ground, turn(start_m), to_points([turn(goal_m)]), 0.2)
    assert other[:2] == pytest.approx(turn((found[0], found[1])), abs=1e-9)


@pytest.mark.parametrize("radius_m", [0.2, 0.35])
def test_who_is_pressed_against_a_wall_goes_to_where_its_disc_fits(radius_m: float) -> None:
    """It starts where the disc does not fit, over open cells, never through the wall."""
    walls = two_rooms(40, 40, slice(19, 21), slice(24, 40))
    coarse = CoarseMap(terrain_of(walls), radius_m)
    x_m, y_m, is_found = way_round(
        coarse.ground, (0.88, 0.6), to_points([(1.475, 1.325)]), radius_m
    )
    assert is_found
    assert x_m < 0.95
    there = coarse.grid.points_to_cells(np.array([(x_m, y_m)]))[0]
    assert fitting(coarse, radius_m)[tuple(there)]


def test_without_a_way_it_is_the_first_point() -> None:
    """Behind a wall without a door there is none, and from outside the map neither."""
    coarse = CoarseMap(terrain_of(two_rooms(40, 40, slice(19, 21), None)), 0.2)
    way_m = to_points([(1.5, 1.0), (1.6, 1.0)])
    assert way_round(coarse.ground, (0.5, 1.0), way_m, 0.2) == (1.5, 1.0, False)
    assert way_round(coarse.ground, (-3.0, 1.0), way_m, 0.2) == (1.5, 1.0, False)


def test_only_the_first_points_of_the_way_are_looked_for() -> None:
    """What is farther away is left to the next decision."""
    coarse = CoarseMap(terrain_of(np.zeros((40, 80), np.bool_)), 0.2)
    way_m = to_points([(1.0, 1.0), (1.5, 1.0), (3.5, 1.0)])
    x_m, y_m, _ = way_round(coarse.ground, (0.5, 1.0), way_m, 0.2)
    assert (x_m, y_m) == tuple(way_m[AHEAD - 1])
    assert MARGINS[0] == 0


@given(st.integers(0, 19), st.integers(0, 19), st.floats(0.01, 0.6))
def test_a_disc_fits_where_it_covers_open_squares_only(row: int, col: int, radius_m: float) -> None:
    """Against the distance from the centre to each closed square."""
    walls = np.zeros((20, 20), np.bool_)
    walls[8:10, :11] = walls[3, 15] = True
    terrain = terrain_of(walls)
    closed = np.argwhere(np.pad(walls, 1, constant_values=True)) - 1
    gaps = np.maximum(np.abs(closed - (row, col)) - 0.5, 0.0) * CELL_M
    least_m = np.hypot(*gaps.T).min()
    if abs(least_m - radius_m) > 1e-6:
        fits = disc_fits(terrain.clearance_m, row, col, radius_m, CELL_M)
        assert fits == (least_m > radius_m and not walls[row, col])
