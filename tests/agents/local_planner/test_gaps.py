"""Gaps between paths, walls and the robot, against one exact test per sub-step."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from are_ros.agents.body import Body
from are_ros.agents.local_planner import gaps as _gaps
from are_ros.agents.local_planner import state as _state
from are_ros.agents.local_planner import walls as _walls
from are_ros.agents.local_planner.gaps import fill, find_neighbours
from are_ros.agents.local_planner.robot import RobotMotion, robot_cost, robot_path
from are_ros.agents.local_planner.rollouts import bounds_of
from are_ros.agents.local_planner.state import NEVER
from are_ros.agents.local_planner.walls import ClearanceLayers
from are_ros.agents.navigation.terrain import Terrains
from are_ros.world.footprint import Footprint, signed_distance_m
from tests.agents.local_planner.streets import (
    CAR,
    PERSON,
    SCOOTER,
    boxes_at,
    environment,
    room,
    wall,
)
from tests.world.overlapping import overlaps

_BODIES = (PERSON, SCOOTER, CAR, Body((0.4, 0.1), (0.2, -0.1)))


def _records(*bodies: Body) -> _state.Records:
    records = np.zeros(len(bodies), _state.BODY)
    for n, body in enumerate(bodies):
        _state.write_body(records[n], body, 0)
    return records


def _path(random: np.random.Generator, count: int, spread_m: float = 2.0) -> NDArray[np.float64]:
    """Return a smooth random path (count, 6)."""
    path = np.zeros((count, 6))
    path[0, :2] = random.uniform(-spread_m, spread_m, 2)
    path[1:, :2] = path[0, :2] + np.cumsum(random.normal(0.0, 0.05, (count - 1, 2)), axis=0)
    path[:, 2] = random.uniform(-3.0, 3.0) + np.cumsum(random.normal(0.0, 0.05, count))
    path[:, 3], path[:, 4] = np.cos(path[:, 2]), np.sin(path[:, 2])
    path[1:, 5] = np.hypot(*np.diff(path[:, :2], axis=0).T) / 0.05
    return path


_seeds = st.integers(0, 2**32 - 1)


@given(_seeds, st.sampled_from(_BODIES), st.sampled_from(_BODIES))
def test_separation_is_negative_just_where_boxes_overlap(seed: int, a: Body, b: Body) -> None:
    """The sign agrees with the exact test of open boxes."""
    random = np.random.default_rng(seed)
    p, q = _path(random, 1), _path(random, 1)
    records = _records(a, b)
    gap = _gaps.separation(p[0], records[0], q[0], records[1])
    hit = overlaps(boxes_at(p[:, :3], [a]), boxes_at(q[:, :3], [b]))[0]
    assert hit == (gap < -1e-9)


@given(_seeds, st.sampled_from(_BODIES), st.sampled_from(_BODIES), st.floats(0.0, 0.5))
def test_leaps_miss_no_meeting_of_two_paths(seed: int, a: Body, b: Body, comfort: float) -> None:
    """The first overlap and the least gap are those of a look at each sub-step.

    One that would stand where it cannot turn any more meets the other at the end.
    """
    random = np.random.default_rng(seed)
    plan, path = _path(random, 30), _path(random, 40)
    records = _records(a, b)
    start = int(random.integers(0, 35))
    pace = bounds_of(plan, 29, records[0], 0.05)[0] + bounds_of(path, 39, records[1], 0.05)[0]
    gap, found = _gaps.gap_between(
        plan, 29, records[0], path, start, 39, records[1], comfort, pace, NEVER, plan[0]
    )
    steps = np.arange(1, max(29, 39 - start) + 1)
    mine, theirs = plan[np.minimum(steps, 29)], path[np.minimum(start + steps, 39)]
    hits = overlaps(
        boxes_at(mine[:, :3], [a] * len(steps)), boxes_at(theirs[:, :3], [b] * len(steps))
    )
    if hits.any():
        assert found == steps[np.argmax(hits)]
        return
    gaps = [
        _gaps.separation(p, records[0], q, records[1]) for p, q in zip(mine, theirs, strict=True)
    ]
    far = np.hypot(*(mine - theirs)[:, :2].T) - records["radius"].sum()
    if found == NEVER:
        assert gap == min(comfort, np.maximum(far, gaps).min())
    else:
        assert found == steps[-1]
        assert _gaps._jams(mine[-1], records[0], theirs[-1], records[1])
        assert not _gaps._jams(plan[0], records[0], theirs[-1], records[1])


@given(_seeds, st.sampled_from(_BODIES), st.floats(0.0, 0.2))
def test_a_path_runs_into_a_wall_where_its_boxes_do(seed: int, body: Body, comfort: float) -> None:
    """The first closed cell is met at the sub-step at which the exact test says so."""
    random = np.random.default_rng(seed)
    cells = room(7.0, 6.0)
    wall(cells, (3.0, 3.2), (2.0, 4.0))
    here = environment(cells, (-3.0, -3.0, 0.2))
    _, floor = ClearanceLayers(Terrains()).of(here, [])
    path, record = _path(random, 40), _records(body)[0]
    boxes = boxes_at(path[:, :3], [body] * 40)
    free = here.is_placeable(boxes)
    pace = bounds_of(path, 39, record, 0.05)[0]
    box = np.zeros((1, 8))
    wanted = _walls.wall_gap_wanted(path[0], record, comfort, floor, box)
    kept, found = _walls.wall_conflict(
        path, 39, record, wanted, pace, floor, box, path[0], must_keep=False
    )
    if not free[0]:
        hits = here.hits_wall(boxes)
        assert hits[0] or found == (int(np.argmax(hits)) if hits.any() else NEVER)
    elif not free.all():
        assert found == int(np.argmin(free))
    elif found != NEVER:
        assert found == 39
        assert not _walls.turns_freely(path[39], record, floor)
    else:
        grown = Body((body.half_size_m[0] + comfort, body.half_size_m[1] + comfort), body.centre_m)
        roomy = here.is_placeable(boxes_at(path[:, :3], [grown] * 40))
        # round the corners of a grown box, that is: where its discs have the room, it is kept, too
        roomy |= [_walls.disc_room(pose, record, floor) >= comfort for pose in path]
        assert wanted == (comfort if roomy[0] else 0.0)
        assert kept == (not roomy[0] or bool(roomy.all()))
    hasty = _walls.wall_conflict(
        path, 39, record, wanted, pace, floor, box, path[0], must_keep=True
    )
    assert hasty == ((kept, found) if kept else (False, hasty[1]))
    assert hasty[1] in (found, NEVER)
    assert kept or wanted <= 0.0 or hasty[1] == NEVER


@given(_seeds, st.sampled_from(_BODIES), st.floats(0.05, 0.8))
def test_the_robot_costs_what_a_look_at_each_sub_step_says(
    seed: int, body: Body, comfort: float
) -> None:
    """Nobody may enter where it is; where it is predicted to be costs, and to be near it, too."""
    random = np.random.default_rng(seed)
    path, record = _path(random, 40), _records(body)[0]
    x, y, yaw = random.uniform(-2.5, 2.5, 3)
    square = Footprint(np.array([[-0.3, -0.2], [0.3, -0.2], [0.3, 0.2], [-0.3, 0.2]]), 0.05)
    motion = RobotMotion(square.at(x, y, yaw), x, y, yaw, *random.uniform(-0.8, 0.8, 3))
    robot, pace = robot_path(motion, 0.05), bounds_of(path, 39, record, 0.05)[0]
    told = robot_cost(path, 0, 39, record, comfort, robot, pace, np.zeros((1, 8)))

    boxes = boxes_at(path[:, :3], [body] * 40)
    still = signed_distance_m(motion.footprint, boxes)
    outlines = [Footprint(robot.outlines[min(k, 30)], 0.05) for k in range(40)]
    ahead = np.array([signed_distance_m(at, boxes.at(k))[0] for k, at in enumerate(outlines)])
    least_allowed = min(still[0], 0.01) - _gaps.TOUCH
    if (still < least_allowed).any():
        assert told == (math.inf, True)
        return
    gap = min(comfort, max(min(still.min(), ahead.min()), 0.0))
    cost, is_met = 0.6 * (1.0 - gap / comfort), bool((ahead < least_allowed).any())
    if is_met:
        cost += 6.0 - 0.05 * int(np.argmax(ahead < least_allowed))
    assert told[0] == pytest.approx(cost, abs=1e-9)
    assert told[1] == is_met


@given(_seeds, st.sampled_from(_BODIES))
def test_turning_freely_means_fitting_at_all_headings(seed: int, body: Body) -> None:
    """The disc that a body sweeps is open just if a fine fan of its corner's directions is."""
    random = np.random.default_rng(seed)
    cells = room(7.0, 6.0)
    here = environment(cells)
    _, floor = ClearanceLayers(Terrains()).of(here, [])
    pose = np.zeros(6)
    pose[:2] = random.uniform(0.0, 6.0, 2)
    record = _records(body)[0]
    distance = min(pose[0] - 0.1, 6.9 - pose[0], pose[1] - 0.1, 5.9 - pose[1])
    if abs(distance - body.radius_m) > 1e-6:
        assert _walls.turns_freely(pose, record, floor) == (distance > body.radius_m)


def test_discs_cover_the_box() -> None:
    """Every point of a box lies in one of its discs."""
    for body in (*_BODIES, Body((0.06, 1.0)), Body((3.7, 1.2))):
        count, gap_m, radius_m = body.discs()
        half = np.array(body.half_size_m)
        points = np.stack(np.meshgrid(*(np.linspace(-h, h, 41) for h in half)), -1).reshape(-1, 2)
        axis = 0 if half[0] >= half[1] else 1
        centres = np.zeros((count, 2))
        centres[:, axis] = gap_m * (np.arange(count) - 0.5 * (count - 1))
        far = np.hypot(*np.moveaxis(points[:, None] - centres, -1, 0)).min(axis=1)
        assert far.max() <= radius_m + 1e-12


@given(_seeds, st.integers(1, 60))
def test_buckets_find_all_that_may_come_near(seed: int, count: int) -> None:
    """Nobody whose circle meets the reach is missed, nobody comes twice, with the gap wanted."""
    random = np.random.default_rng(seed)
    agents = _state.agent_arrays(count, 1)
    workspace = _state.workspace_of(count, 1)
    squares = np.column_stack((random.uniform(-30, 30, (count, 2)), random.uniform(0.1, 6, count)))
    agents.place["x"], agents.place["y"], agents.place["reach"] = squares.T
    agents.command["comfort"], agents.body[:] = 0.5, _records(PERSON)
    agents.path[:, 0, 3] = 1.0
    agents.path[:, 0, :2] = squares[:, :2] + random.uniform(-0.05, 0.05, (count, 2))
    buckets = fill(squares)
    for me in range(count):
        pose, reach = agents.path[me, 0].copy(), squares[me, 2]
        found = find_neighbours(buckets, agents, me, pose, reach, 0, workspace)
        near = workspace.near[:found].tolist()
        gaps = np.hypot(*(squares[:, :2] - pose[:2]).T) - squares[:, 2] - reach
        expected = set(np.flatnonzero(gaps < 0.0).tolist()) - {me}
        assert len(near) == len(set(near))
        assert set(near) == expected
        records = agents.body
        for other, wanted in zip(near, workspace.wanted, strict=False):
            gap = _gaps.separation(pose, records[me], agents.path[other, 0], records[other])
            apart = np.hypot(*(agents.path[other, 0, :2] - pose[:2])) - 2.0 * PERSON.radius_m
            assert wanted == (min(max(gap, 0.0), 0.5) if apart < 0.5 else 0.5)


def test_a_leap_is_never_too_far() -> None:
    """It takes at least a sub-step, and no more than the room allows."""
    assert _gaps.leap(0.0, 0.1) == 1
    assert _gaps.leap(0.35, 0.1) == 4
    assert _gaps.leap(math.inf, 0.0) > 1000


@given(_seeds, st.sampled_from(_BODIES))
def test_a_point_has_the_room_that_it_is_said_to_have(seed: int, body: Body) -> None:
    """No closed cell is nearer than that, and it is not far from what there is."""
    random = np.random.default_rng(seed)
    cells = room(7.0, 6.0)
    wall(cells, (3.0, 3.2), (2.0, 4.0))
    here = environment(cells)
    _, floor = ClearanceLayers(Terrains()).of(here, [])
    x, y = random.uniform(0.2, 5.8, 2)
    told = _walls.point_room(x, y, _records(body)[0], floor)
    rows, columns = np.nonzero(cells)
    dx = np.maximum(np.maximum(0.05 * columns - x, x - 0.05 * (columns + 1)), 0.0)
    dy = np.maximum(np.maximum(0.05 * rows - y, y - 0.05 * (rows + 1)), 0.0)
    assert np.hypot(dx, dy).min() - 0.08 < told <= np.hypot(dx, dy).min() + 1e-6


@given(_seeds, st.integers(0, 39))
def test_the_circle_of_a_path_holds_it(seed: int, last: int) -> None:
    """All its points are in it, and it is no larger than half the diagonal of their rectangle."""
    path = _path(np.random.default_rng(seed), 40)
    _, (x, y, radius) = bounds_of(path, last, np.zeros(1, _state.BODY)[0], 0.05)
    points = path[: last + 1, :2]
    assert np.hypot(*(points - (x, y)).T).max() <= radius + 1e-12
    assert radius <= 0.5 * np.hypot(*np.ptp(points, axis=0)) + 1e-12
