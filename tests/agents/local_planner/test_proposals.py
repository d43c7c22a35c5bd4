"""What the planners propose, and what becomes of it: path following and the social force."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from are_ros.agents.body import PLANNERS, Body, MotionCommand
from are_ros.agents.local_planner import proposals as _proposals
from are_ros.agents.local_planner import state as _state
from are_ros.agents.local_planner.planner import Obstruction
from are_ros.agents.local_planner.robot import RobotMotion, robot_path
from are_ros.agents.local_planner.rollouts import GOING, PlanningGoal
from are_ros.agents.local_planner.walls import ClearanceLayers
from are_ros.agents.navigation.terrain import Terrains
from are_ros.world.footprint import Footprint
from tests.agents.local_planner.streets import (
    PALLET,
    PERSON,
    SCOOTER,
    STEP_S,
    Street,
    corridor,
    environment,
    room,
)

Vector = NDArray[np.float64]

AGV = Body((0.46, 0.31), (0.0, 0.0), 1.0, 1.4, 0.8, 1.0)


def way_of(street: Street, row: int = 0) -> np.ndarray:
    """Return x, y, yaw of a row at all sub-steps, (K, 3)."""
    return np.array([poses[row] for poses in street.track])


# --- path following


@pytest.mark.parametrize("yaw_rad", [0.0, 0.4, 2.5, -1.7])
def test_a_path_follower_turns_first_and_never_leaves_its_way(yaw_rad: float) -> None:
    """Once it moves at its heading it is on the straight line to the goal, and looks along it."""
    street = Street(environment(room(16.0, 10.0)))
    street.add(1, 2.0, 3.0, yaw_rad, AGV)
    street.send(1, 13.0, 7.0, planner="path_following")
    street.run_until_there(25.0)
    way = way_of(street)
    if abs(yaw_rad) > 0.5 + math.atan2(4.0, 11.0):
        assert (way[: round(0.3 / 0.05), :2] == way[0, :2]).all()
    onward = np.arctan2(7.0 - way[:, 1], 13.0 - way[:, 0])
    aside = np.abs(np.remainder(way[:, 2] - onward + np.pi, 2.0 * np.pi) - np.pi)
    is_far = np.hypot(13.0 - way[:, 0], 7.0 - way[:, 1]) > 0.5
    begins = int(np.argmax(aside < 1e-6))
    assert begins > 0 or yaw_rad == 0.0
    assert aside[begins:][is_far[begins:]].max() < 1e-6


def test_a_path_follower_brakes_behind_a_pallet_waits_and_goes_on() -> None:
    """It names the pallet, does not swerve for it, and goes on once it is gone."""
    street = Street(environment(room(16.0, 8.0)))
    street.add(1, 2.0, 4.0, 0.0, AGV)
    street.add(2, 8.0, 4.3, 0.5 * math.pi, PALLET)
    street.send(1, 14.0, 4.0, planner="path_following")
    street.run(40.0)
    assert street.speeds[0] == 0.0
    assert 7.0 < street.pose(1)[0] + 0.46 < 7.6
    what, who, since_s = street.obstruction(1)
    assert (what, who) == (Obstruction.ARTEFACT, 2)
    assert since_s > 25.0
    street.remove(2)
    street.run_until_there(15.0)
    assert np.abs(way_of(street)[:, 1] - 4.0).max() < 1e-9


TUGGER = Body((0.8, 0.4), (0.0, 0.0), 1.4, 1.5, 0.7, 0.8, 1.4)


@pytest.mark.parametrize(
    ("body", "width_m", "seconds"), [(AGV, 3.0, 30.0), (TUGGER, 3.0, 45.0), (TUGGER, 2.5, 75.0)]
)
def test_path_followers_that_meet_head_on_swerve_and_pass(
    body: Body, width_m: float, seconds: float
) -> None:
    """Both would wait nose to nose for minutes; each keeps to its way until they are near."""
    middle_m = 0.5 * width_m + 0.5
    street = Street(corridor(width_m, 44.0))
    street.add(1, 10.0, middle_m, 0.0, body)
    street.add(2, 34.0, middle_m, math.pi, body)
    street.send(1, 40.0, middle_m, planner="path_following")
    street.send(2, 4.0, middle_m, planner="path_following")
    street.run(4.0)
    assert (way_of(street)[:, 1] == middle_m).all()
    street.run_until_there(seconds, within_m=1.0)


def test_a_path_follower_with_another_planner_swerves_no_more() -> None:
    """Else the dynamic window would go on in the place of a user's planner."""
    street = Street(corridor(3.0, 20.0))
    for one, x_m, yaw_rad, goal_m in ((1, 5.0, 0.0, 18.0), (2, 15.0, math.pi, 2.0)):
        street.add(one, x_m, 2.0, yaw_rad, AGV)
        street.send(one, goal_m, 2.0, planner="path_following")
    memories = street.table.arrays.memory
    while memories["swerves_until"][0] <= street.table.now and street.index < 200:
        street.step()
    assert memories["swerves_until"][0] > street.table.now
    street.send(1, 18.0, 2.0, planner="social_force")
    assert memories["swerves_until"][0] <= street.table.now


def test_a_dynamic_window_swerves_where_a_path_follower_waits() -> None:
    """The same scene with the other planner, so that the test above can fail."""
    street = Street(environment(room(16.0, 8.0)))
    street.add(1, 2.0, 4.0, 0.0, AGV)
    street.add(2, 8.0, 4.3, 0.5 * math.pi, PALLET)
    street.send(1, 14.0, 4.0)
    street.run_until_there(30.0)
    assert np.abs(way_of(street)[:, 1] - 4.0).max() > 0.3


def test_people_get_out_of_the_way_of_a_path_follower_which_never_makes_way() -> None:
    """Head on in a corridor where two abreast have room: the one that can swerve does."""
    street = Street(corridor(2.4))
    street.add(1, 1.5, 1.7, 0.0, AGV)
    street.add(2, 10.5, 1.7, math.pi, PERSON)
    street.send(1, 11.0, 1.7, planner="path_following")
    street.send(2, 1.0, 1.7)
    street.run_until_there(40.0)
    assert np.abs(way_of(street)[:, 1] - 1.7).max() < 1e-9


def test_a_path_follower_in_a_gap_backs_out_when_it_is_sent_back() -> None:
    """Where it cannot turn it goes straight back; else it would wait for ever."""
    cells = room(10.0, 4.0)
    cells[:34, 60:120] = cells[46:, 60:120] = 100
    street = Street(environment(cells))
    street.add(1, 4.0, 2.0, 0.0, PERSON)
    street.send(1, 1.5, 2.0, planner="path_following")
    street.run_until_there(30.0)


def test_a_vehicle_that_follows_its_path_waits_and_does_not_steer_around() -> None:
    """It stops behind a pallet; sent elsewhere it goes back first, for it has no room to turn."""
    street = Street(environment(room(20.0, 12.0)))
    street.add(1, 3.0, 6.0, 0.0, SCOOTER)
    street.add(2, 10.0, 6.3, 0.5 * math.pi, PALLET)
    street.send(1, 17.0, 6.0, planner="path_following")
    street.run(30.0)
    assert street.speeds[0] == 0.0
    assert street.obstruction(1)[:2] == (Obstruction.ARTEFACT, 2)
    assert np.abs(way_of(street)[:, 1] - 6.0).max() < 0.02
    street.send(1, 5.0, 10.0, planner="path_following")
    street.run_until_there(60.0, within_m=0.45)


def test_another_planner_is_planned_with_at_once() -> None:
    """Who was to follow its path and is told to use the dynamic window goes round the pallet."""
    street = Street(environment(room(16.0, 8.0)))
    street.add(1, 2.0, 4.0, 0.0, AGV)
    street.add(2, 8.0, 4.0, 0.5 * math.pi, PALLET)
    for planner, seconds in (("path_following", 15.0), ("dynamic_window", 50.0)):
        assert math.dist(street.pose(1)[:2], (14.0, 4.0)) > 6.0
        street.command(1, MotionCommand((14.0, 4.0), 1.4, planner=planner))
        street.run(seconds)
    assert math.dist(street.pose(1)[:2], (14.0, 4.0)) < 0.12


# --- the social force


def slow_repulsion(x: Vector, y: Vector, radii_m: float, heading: Vector) -> Vector:
    """Return minus the gradient of A B exp((r - b(x)) / B), seen, by differences.

    `x` is the place from the other, `y` the other's way in a step.
    """

    def axis(place: Vector) -> float:
        ways = np.linalg.norm(place) + np.linalg.norm(place - y)
        return 0.5 * math.sqrt(ways**2 - y @ y)

    slope = np.array([axis(x + h) - axis(x - h) for h in 1e-6 * np.eye(2)]) / 2e-6
    cosine = -(x @ heading) / np.linalg.norm(x)
    sight = _proposals.BEHIND + (1.0 - _proposals.BEHIND) * (1.0 + cosine) / 2.0
    depth = min((radii_m - axis(x)) / _proposals.OTHERS_M, 0.0)
    return np.asarray(sight * _proposals.OTHERS_MPS2 * math.exp(depth) * slope)


@given(st.integers(0, 2**32 - 1))
def test_repulsion_is_minus_the_gradient_of_the_potential(seed: int) -> None:
    """Elliptical, seen at an angle, against a slow twin by differences."""
    random = np.random.default_rng(seed)
    x, v = random.uniform(-3.0, 3.0, 2), random.uniform(-2.5, 2.5, 2)
    y, angle = _proposals.AHEAD_S * v, random.uniform(-3.0, 3.0)
    heading = np.array([math.cos(angle), math.sin(angle)])
    radii_m = random.uniform(0.3, 1.2)
    ways = np.linalg.norm(x) + np.linalg.norm(x - y)
    if ways**2 - y @ y < 0.05 or np.linalg.norm(x - y) < 0.01:
        return  # on the way of the other, where the ellipse is none
    force = _proposals.repulsion(x[0], x[1], v[0], v[1], radii_m, heading[0], heading[1])
    assert force == pytest.approx(slow_repulsion(x, y, radii_m, heading), abs=1e-5)


def test_the_social_force_is_the_sum_of_its_terms() -> None:
    """Driving force, two others, the robot and a wall, against the same sum in plain numpy."""
    street = Street(environment(room(12.0, 8.0)), inspects=False)
    ids, poses = (1, 4, 9), ((5.0, 0.56, 0.3), (6.0, 1.0, 2.8), (5.2, 1.6, -1.0))
    for one, pose in zip(ids, poses, strict=True):
        street.add(one, *pose)
        street.send(one, 11.0, 4.0)
    robot = RobotMotion(Footprint.disc(0.3).at(6.5, 1.5, 0.0), 6.5, 1.5, 0.0, -0.4, 0.1, 0.0)
    arrays = street.table.arrays
    for row, speed in enumerate((1.1, 0.9, 0.5)):
        arrays.path[row, :, _state.SPEED] = speed
    workspace = _state.workspace_of(3, arrays.path.shape[1])
    workspace.near[:2] = (1, 2)
    _, floor = ClearanceLayers(Terrains()).of(street.environment, street.table.heights)
    aim = PlanningGoal(GOING, 0.2, 6.0, 1.35, 1.0, 0.0, ends=False, own=0.2)
    pose = arrays.path[0, 0]
    path = robot_path(robot, STEP_S)
    got = _proposals.social_force(arrays, 0, aim, pose, 0, floor, path, workspace, 2)
    heading = np.array([math.cos(0.3), math.sin(0.3)])
    mine, here = 1.1 * heading, np.array(poses[0][:2])
    force = (1.35 * np.array([math.cos(0.2), math.sin(0.2)]) - mine) / _proposals.RELAXATION_S
    movers = [((6.0, 1.0), 0.9, 2.8), ((5.2, 1.6), 0.5, -1.0)]
    for place, speed, yaw in movers:
        y = _proposals.AHEAD_S * (speed * np.array([math.cos(yaw), math.sin(yaw)]) - mine)
        force = force + slow_repulsion(here - place, y, 2.0 * PERSON.radius_m, heading)
    y = _proposals.AHEAD_S * (np.array([-0.4, 0.1]) - mine)
    force = force + slow_repulsion(here - (6.5, 1.5), y, 0.3 + PERSON.radius_m, heading)
    # of the wall below, the middle of the outermost cells is at 0.075, that of this one at 0.575
    push = _proposals.WALLS_MPS2 * math.exp((PERSON.radius_m - 0.475) / _proposals.WALLS_M)
    assert got == pytest.approx(force + np.array((0.0, push)), abs=1e-4)


def test_a_lone_walker_by_social_force_reaches_its_goal() -> None:
    """Straight, at its speed, and it stands there."""
    street = Street(environment(room(14.0, 8.0)))
    street.add(1, 2.0, 3.0, 2.0)
    street.send(1, 12.0, 5.0, planner="social_force")
    seconds = street.run_until_there(15.0)
    assert seconds < math.hypot(10.0, 2.0) / 1.35 + 2.5
    street.run(2.0)
    assert street.speeds[0] == 0.0
    assert street.distance(1) < 0.12


@pytest.mark.parametrize("offset_m", [0.0, 0.1, -0.2])
def test_two_by_social_force_pass_each_other(offset_m: float) -> None:
    """Head on, in line or nearly: they get there, hardly slower than alone."""
    street = Street(environment(room(16.0, 8.0)))
    for one, x_m, to_m, y_m in ((1, 2.0, 14.0, 4.0), (2, 14.0, 2.0, 4.0 + offset_m)):
        street.add(one, x_m, y_m, 0.0 if to_m > x_m else math.pi)
        street.send(one, to_m, y_m, planner="social_force")
    assert street.run_until_there(20.0) < 12.0 / 1.35 + 3.0


def test_two_streams_by_social_force_flow_through_a_corridor() -> None:
    """Thirty people, half of them each way, in 4 m: all get through; the street inspects them."""
    street = Street(corridor(4.0, 30.0))
    for n in range(30):
        along, across = n // 6 * 1.1, 1.0 + 1.1 * (n // 2 % 3) + 0.3 * (n % 2)
        x_m, to_m = (6.0 - along, 29.0) if n % 2 == 0 else (24.0 + along, 1.0)
        street.add(n, x_m, across, 0.0 if n % 2 == 0 else math.pi)
        street.send(n, to_m, across, planner="social_force")
    while street.bodies and street.index < 60.0 / STEP_S:
        street.step()
        for one in [one for one in street.bodies if street.distance(one) <= 1.5]:
            street.remove(one)
    assert not street.bodies


def test_a_vehicle_told_to_use_the_social_force_uses_the_dynamic_window() -> None:
    """Its way is the same to the last bit."""
    ways = []
    for planner in ("social_force", "dynamic_window"):
        street = Street(environment(room(20.0, 12.0)))
        street.add(1, 3.0, 6.0, 0.0, SCOOTER)
        street.add(2, 10.0, 6.3, 0.5 * math.pi, PALLET)
        street.send(1, 17.0, 7.0, planner=planner)
        street.run(12.0)
        ways.append(way_of(street).tobytes())
    assert ways[0] == ways[1]


@pytest.mark.parametrize("seed", [0, 1])
def test_a_crowd_of_all_planners_keeps_to_all_limits(seed: int) -> None:
    """People, robots and scooters, each with its planner, sent anywhere: nothing overlaps."""
    random = np.random.default_rng(seed)
    street = Street(environment(room(16.0, 12.0)))
    for n in range(24):
        body = (PERSON, PERSON, AGV, SCOOTER)[n % 4]
        street.add(n, 1.5 + 2.4 * (n % 6), 1.8 + 2.7 * (n // 6), random.uniform(-3.0, 3.0), body)
    for k in range(800):
        if k % 6 == 0:
            one = int(random.integers(24))
            place = random.uniform((0.5, 0.5), (15.5, 11.5))
            street.send(one, *place, planner=PLANNERS[one % 3])
        street.step()
    assert street.emergency_stops == 0
