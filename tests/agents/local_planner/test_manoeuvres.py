"""Vehicles turn round: forward where there is room, in few legs between walls, never for long."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from are_ros.agents.body import Body, MotionCommand
from are_ros.agents.local_planner.planner import Obstruction
from are_ros.agents.local_planner.primitives import point_ahead, way_left
from are_ros.agents.local_planner.state import NEVER, path_length, timing_of, workspace_of
from are_ros.agents.table import AgentTable
from tests.agents.local_planner.own_planners import MODULE
from tests.agents.local_planner.streets import (
    CAR,
    PALLET,
    SCOOTER,
    STEP_S,
    Street,
    boxes_at,
    environment,
    room,
    wall,
)


def driven(track: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the signed way [m] of the first one in each sub-step, negative in reverse."""
    poses = np.array([poses[0] for poses in track])
    steps = np.diff(poses[:, :2], axis=0)
    ways_m: NDArray[np.float64] = np.sum(
        steps * np.column_stack((np.cos(poses[1:, 2]), np.sin(poses[1:, 2]))), axis=1
    )
    return ways_m


def shunts(ways_m: NDArray[np.float64]) -> int:
    """Return how often the direction changes."""
    moving = ways_m[np.abs(ways_m) > 1e-3]
    return int(np.count_nonzero(np.diff(np.sign(moving))))


def go_on(street: Street, goal_m: tuple[float, float], speed_mps: float = 3.0) -> None:
    """Send the first one on a way that goes on at its sub-goal."""
    street.goals[1] = goal_m
    street.command(1, MotionCommand(goal_m, speed_mps, stop_there=False))


@pytest.mark.parametrize("body", [CAR, SCOOTER])
def test_in_the_open_a_vehicle_turns_round_forward(body: Body) -> None:
    """Where the way goes on behind it, however near its sub-goal is."""
    for away_m in (3.0, 6.0, 15.0):
        street = Street(environment(room(60.0, 60.0)))
        street.add(1, 30.0, 30.0, 0.0, body)
        go_on(street, (30.0 - away_m, 30.0), body.speed_mps)
        while street.table.arrays.memory[0]["passed_at"] == NEVER and street.index < 400:
            street.step()
        assert street.distance(1) < 3.0
        assert driven(street.track).min() > -1e-6
        assert street.planner.are_manoeuvring([0]) == [False]


def test_to_a_place_close_behind_it_a_vehicle_reverses() -> None:
    """Where its way ends: no loop is driven for two metres."""
    street = Street(environment(room(60.0, 60.0)))
    street.add(1, 30.0, 30.0, 0.0, CAR)
    street.send(1, 27.0, 30.0)
    street.run_until_there(10.0, within_m=0.3)
    assert np.abs(driven(street.track)).sum() < 3.5


@pytest.mark.parametrize(
    ("body", "width_m", "most"), [(CAR, 7.0, 10), (CAR, 8.0, 6), (CAR, 9.0, 4), (SCOOTER, 2.5, 4)]
)
def test_in_an_aisle_a_vehicle_turns_round_in_few_legs(
    body: Body, width_m: float, most: int
) -> None:
    """It is too narrow to turn in one, and the vehicle neither rocks nor goes back in reverse."""
    street = Street(environment(room(60.0, width_m)))
    street.add(1, 30.0, 0.5 * width_m, 0.0, body)
    go_on(street, (5.0, 0.5 * width_m), body.speed_mps)
    turned = False
    for _ in range(40):
        street.run(1.0)
        turned = turned or street.planner.are_manoeuvring([0]) == [True]
        if street.poses[0, 0] < 12.0:
            break
    assert turned
    assert street.planner.are_manoeuvring([0]) == [False]
    ways_m = driven(street.track)
    assert shunts(ways_m) <= most
    assert -ways_m[ways_m < 0.0].sum() < 2.5 * body.turn_radius_m
    assert abs(math.remainder(street.poses[0, 2] - math.pi, 2.0 * math.pi)) < 0.3


def test_out_of_a_slot_a_vehicle_backs_as_far_as_it_must() -> None:
    """Its nose is at a wall between two others; its way leads off to the side behind it."""
    cells = room(30.0, 24.0)
    wall(cells, (0.0, 13.0), (12.0, 24.0))
    wall(cells, (15.8, 30.0), (12.0, 24.0))
    street = Street(environment(cells))
    street.add(1, 14.4, 20.5, 0.5 * math.pi, CAR)
    go_on(street, (24.0, 6.0))
    while street.distance(1) > 4.0 and street.index < 800:
        street.step()
    ways_m = driven(street.track)
    assert street.distance(1) < 4.0
    assert shunts(ways_m) <= 2
    assert -ways_m[ways_m < 0.0].sum() < 16.0


@pytest.mark.parametrize(
    ("body", "width_m", "away_m", "seconds"),
    [(CAR, 5.0, 60.0, 60.0), (CAR, 3.0, 60.0, 60.0), (SCOOTER, 1.5, 30.0, 60.0)],
)
def test_where_it_cannot_turn_a_vehicle_backs_out_however_far(
    body: Body, width_m: float, away_m: float, seconds: float
) -> None:
    """Farther than a search looks: it goes as near as that finds, and searches again."""
    street = Street(environment(room(away_m + 30.0, width_m)))
    street.add(1, away_m + 15.0, 0.5 * width_m, 0.0, body)
    go_on(street, (15.0, 0.5 * width_m), body.speed_mps)
    while street.distance(1) > 3.0 and street.index < seconds / STEP_S:
        street.step()
    assert street.distance(1) < 3.0
    assert shunts(driven(street.track)) <= 8


PARKED = Body((2.2, 0.9), (0.0, 0.0), 1.5, 0.0)


def among(street: Street, *poses: tuple[float, float, float], body: Body = PARKED) -> Street:
    """Let others stand there for good."""
    for one, pose in enumerate(poses, 2):
        street.add(one, *pose, body)
    return street


@pytest.mark.parametrize(
    ("width_m", "parked", "seconds"),
    [
        (9.0, [(25.0, 1.3, 0.0)], 25.0),
        (9.0, [(27.0, 1.3, 0.0), (34.0, 7.7, 0.0)], 25.0),
        (11.0, [(15.0 + 3.0 * k, 1.3 + 1.0, 0.5 * math.pi) for k in range(9)], 45.0),
        (14.0, [(15.0 + 3.0 * k, 1.3 + 1.0, 0.5 * math.pi) for k in range(9)], 25.0),
    ],
)
def test_a_vehicle_turns_round_among_those_that_stand(
    width_m: float, parked: list[tuple[float, float, float]], seconds: float
) -> None:
    """It looks for a manoeuvre that meets none, and does not wait for them on its legs."""
    street = among(Street(environment(room(60.0, width_m))), *parked)
    street.add(1, 30.0, 0.5 * width_m + 0.5, 0.0, CAR)
    go_on(street, (5.0, 0.5 * width_m))
    waits_s = 0.0
    while street.distance(1) > 5.0 and street.index < seconds / STEP_S:
        street.step()
        waits_s = max(waits_s, street.obstruction(1)[2])
    assert street.distance(1) < 5.0
    assert waits_s < 4.0


def test_a_vehicle_passes_who_stands_close_ahead() -> None:
    """The dynamic window does not get round it; a manoeuvre does."""
    street = among(Street(environment(room(60.0, 9.0))), (12.0, 4.5, 0.3))
    street.add(1, 6.0, 4.5, 0.0, CAR)
    go_on(street, (55.0, 4.5))
    while street.distance(1) > 5.0 and street.index < 35.0 / STEP_S:
        street.step()
    assert street.distance(1) < 5.0
    assert shunts(driven(street.track)) <= 3


def test_a_vehicle_that_is_boxed_in_waits_until_the_way_is_free() -> None:
    """It does not move to and fro meanwhile, and says who is in its way."""
    street = among(Street(environment(room(60.0, 9.0))), (10.8, 4.5, 0.5 * math.pi))
    street.add(1, 6.0, 4.5, 0.0, CAR)
    go_on(street, (55.0, 4.5))
    street.run(30.0)
    kind, who, since_s = street.obstruction(1)
    assert (kind, who) == (Obstruction.ARTEFACT, 2)
    assert since_s > 20.0
    assert shunts(driven(street.track)) == 0
    street.remove(2)
    street.track.clear()
    street.run(10.0)
    assert street.pose(1)[0] > 12.0


CITY_CAR = Body((1.775, 0.81), (0.0, 0.0), 1.48, 3.0, 1.5, 0.6, 4.6)


def test_what_leaves_a_vehicle_no_manoeuvre_is_named_though_its_first_arcs_meet_walls() -> None:
    """A car aslant in a bay of 6 x 8 m, with a pallet; it said that a wall is in its way."""
    cells = room(20.0, 8.0)
    wall(cells, (6.0, 20.0), (0.0, 2.5))
    wall(cells, (6.0, 20.0), (5.5, 8.0))
    street = Street(environment(cells))
    street.add(1, 4.08, 5.84, 2.2, CITY_CAR)
    street.add(2, 2.91, 4.84, 0.0, PALLET)
    go_on(street, (18.0, 4.0))
    street.run(20.0)
    assert street.obstruction(1)[:2] == (Obstruction.ARTEFACT, 2)


def test_a_planner_of_a_user_drives_no_manoeuvre() -> None:
    """A vehicle that gets one in the middle of a manoeuvre is in none from then on."""
    street = Street(environment(room(60.0, 8.0)))
    street.add(1, 30.0, 4.0, 0.0, CAR)
    go_on(street, (5.0, 4.0))
    street.run(1.0)
    assert street.planner.are_manoeuvring([0]) == [True]
    street.send(1, 5.0, 4.0, planner=f"{MODULE}:Sideways")
    street.run(1.0)
    assert street.planner.are_manoeuvring([0]) == [False]


def test_a_leg_is_open_to_its_end_and_is_driven_as_it_was_found() -> None:
    """Laid out anew in small steps, among walls at random, no box on it covers a closed cell."""
    random, legs = np.random.default_rng(7), 0
    for _ in range(6):
        cells = room(24.0, 9.0)
        for x_m, y_m in random.uniform((2.0, 0.5), (21.0, 8.0), (5, 2)):
            wall(cells, (x_m, x_m + 0.4), (y_m, y_m + 0.4))
        place = environment(cells)
        street = Street(place)
        if not place.is_placeable(boxes_at(np.array([(12.0, 4.5, 0.0)]), [SCOOTER]))[0]:
            continue
        street.add(1, 12.0, 4.5, 0.0, SCOOTER)
        go_on(street, (float(random.choice((1.0, 23.0))), float(random.uniform(1.0, 8.0))), 1.6)
        before = 0
        for _ in range(200):
            street.run(0.1)
            memory = street.table.arrays.memory[0]
            if memory["leg"] != 0 and memory["leg_search"] != before:
                before, legs = int(memory["leg_search"]), legs + 1
                poses = leg_of(street.poses[0], memory)
                assert place.is_placeable(boxes_at(poses, [SCOOTER] * len(poses))).all()
    assert legs >= 5


def leg_of(pose: NDArray[np.float64], memory: np.void) -> NDArray[np.float64]:
    """Return poses (K, 3) on a leg, back from its end to where the vehicle is."""
    x_m, y_m, yaw_rad = (float(memory[name]) for name in ("leg_x", "leg_y", "leg_yaw"))
    poses, step_m = [(x_m, y_m, yaw_rad)], -0.02 * float(memory["leg"])
    while math.hypot(x_m - pose[0], y_m - pose[1]) > 0.05 and len(poses) < 1000:
        turn_rad = step_m * float(memory["leg_bend"])
        middle_rad = yaw_rad + 0.5 * turn_rad
        x_m, y_m = x_m + step_m * math.cos(middle_rad), y_m + step_m * math.sin(middle_rad)
        yaw_rad += turn_rad
        poses.append((x_m, y_m, yaw_rad))
    assert len(poses) < 1000
    return np.array(poses)


def test_the_point_ahead_is_the_sub_goal_where_the_way_ends_else_one_beyond() -> None:
    """So far beyond that the way there leads forward, whatever the vehicle's heading is."""
    street = Street(environment(room(60.0, 60.0)))
    street.add(1, 30.0, 30.0, 0.4, CAR)
    pose, arrays = street.table.arrays.path[0, 0], street.table.arrays
    radius_m = CAR.turn_radius_m
    street.send(1, 28.0, 33.0)
    assert point_ahead(pose, arrays.command[0], arrays.memory[0], radius_m) == (28.0, 33.0, 0.0)
    for angle_rad in np.linspace(-3.1, 3.1, 13):
        for away_m in (0.7, 4.0, 12.0, 30.0):
            goal_m = 30.0 + away_m * math.cos(angle_rad), 30.0 + away_m * math.sin(angle_rad)
            go_on(street, goal_m)
            assert arrays.memory[0]["passed_at"] == NEVER
            x_m, y_m, closed_m = point_ahead(pose, arrays.command[0], arrays.memory[0], radius_m)
            beyond_m = math.hypot(x_m - goal_m[0], y_m - goal_m[1])
            assert closed_m == pytest.approx(beyond_m + 0.35)
            assert math.hypot(x_m - 30.0, y_m - 30.0) == pytest.approx(max(away_m, 4.0 * radius_m))
            back_m = way_left(30.0, 30.0, 0.4 + math.pi, x_m, y_m, radius_m)
            assert way_left(30.0, 30.0, 0.4, x_m, y_m, radius_m) < 2.0 * back_m


@pytest.mark.parametrize("step_s", [0.05, 0.75, 1.0])
def test_the_search_writes_only_where_its_poses_are(step_s: float) -> None:
    """With long sub-steps paths have few poses, and a leg of the search would have more."""
    street = Street(environment(room(60.0, 8.0)), AgentTable(step_s), inspects=False)
    workspace = street.planner._workspace
    memory = np.full(workspace.paths.size + 600, 7.0)
    paths = memory[: workspace.paths.size].reshape(workspace.paths.shape)
    scratch = workspace_of(8, path_length(timing_of(step_s)))
    street.planner._workspace = scratch._replace(paths=paths)
    street.add(1, 30.0, 4.0, 0.0, CAR)
    go_on(street, (10.0, 4.0))
    for _ in range(5):
        street.step()
    assert (paths != 7.0).any()
    assert (memory[workspace.paths.size :] == 7.0).all()
