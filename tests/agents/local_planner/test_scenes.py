"""Scenes: narrow places, streams, knots, vehicles, crowds; all is inspected at each sub-step."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.agents.body import PLANNERS, Body, MotionCommand
from are_ros.agents.local_planner.planner import Obstruction
from are_ros.agents.local_planner.robot import RobotMotion
from are_ros.agents.navigation.terrain import Terrain
from are_ros.conventions import UNKNOWN
from are_ros.population.artefact import GroundPose
from are_ros.world.footprint import Footprint, signed_distance_m
from tests.agents.local_planner.streets import (
    CAR,
    PALLET,
    PERSON,
    SCOOTER,
    STEP_S,
    Street,
    boxes_at,
    corridor,
    environment,
    room,
    wall,
)


def test_a_walker_arrives_without_oscillation_and_turns_to_the_face() -> None:
    """It comes to a stand within a decimetre, once, and then looks where it shall."""
    street = Street(environment(room(12.0, 8.0)))
    street.add(1, 2.0, 2.0, 2.0)
    street.goals[1] = (9.0, 5.0)
    street.command(1, MotionCommand((9.0, 5.0), 1.3, face_rad=-2.0))
    street.run(12.0)
    distances = [math.dist(poses[0, :2], (9.0, 5.0)) for poses in street.track]
    start = int(np.argmax(distances))
    assert distances[-1] < 0.02
    assert np.diff(distances[start:]).max() < 2e-3
    assert math.remainder(street.pose(1)[2] + 2.0, math.tau) == pytest.approx(0.0, abs=0.03)


@pytest.mark.parametrize("speed_mps", [0.0, 1.3])
def test_one_that_has_nowhere_to_go_turns_to_the_face(speed_mps: float) -> None:
    """A person on the spot, once it stands; a car, which cannot, stays as it is."""
    street = Street(environment(room(16.0, 8.0)))
    street.add(1, 3.0, 4.0, 0.0)
    street.add(2, 9.0, 4.0, 0.0, CAR)
    if speed_mps:
        street.send(1, 7.0, 4.0)
        street.run(1.5)
        assert street.speeds[0] > 1.0
    for one in (1, 2):
        street.command(one, MotionCommand(None, speed_mps, face_rad=2.5))
    street.run(5.0)
    assert math.remainder(street.pose(1)[2] - 2.5, math.tau) == pytest.approx(0.0, abs=0.03)
    assert street.speeds.tolist() == [0.0, 0.0]
    assert street.pose(2)[:3].tolist() == [9.0, 4.0, 0.0]
    held = street.pose(1).tolist()
    street.run(2.0)
    assert street.pose(1).tolist() == held


def test_a_sub_goal_on_the_way_is_passed_at_full_speed() -> None:
    """One that does not stop there keeps its speed, and goes on to the next without a halt."""
    street = Street(environment(room(16.0, 8.0)))
    street.add(1, 1.0, 4.0, 0.0)
    street.send(1, 6.0, 4.0, stop_there=False)
    street.run(2.0)
    speeds = []
    for k in range(60):
        if k == 40:
            street.send(1, 12.0, 6.0)
        street.step()
        speeds.append(float(street.speeds[0]))
    assert min(speeds) > 1.2


@pytest.mark.parametrize("planner", PLANNERS)
def test_one_that_passes_a_corner_goes_on_along_its_way(planner: str) -> None:
    """It leaves the line to its sub-goal there and stands at the point beyond; else it runs past.

    Before it has passed its sub-goal, the point beyond changes nothing.
    """
    tracks = []
    for beyond_m in (None, (6.0, 1.5)):
        street = Street(environment(room(16.0, 8.0)))
        street.add(1, 3.0, 5.0, 0.0)
        street.command(1, MotionCommand((6.0, 5.0), 1.3, False, planner=planner, beyond_m=beyond_m))
        street.run(10.0)
        tracks.append(np.array(street.track)[:, 0, :2])
    straight, bent = tracks
    is_before = bent[:, 0] < 5.6
    assert np.array_equal(bent[is_before], straight[is_before])
    assert straight[:, 0].max() > 6.6
    assert bent[:, 0].max() < 6.2
    assert math.dist(bent[-1], (6.0, 1.5)) < 0.12
    assert np.hypot(*(bent[-1] - bent[-2])) == 0.0


def test_one_that_has_passed_its_sub_goal_comes_back_to_it() -> None:
    """With no other order it stands at what it was to pass, in the end."""
    street = Street(environment(room(16.0, 8.0)))
    street.add(1, 1.0, 4.0, 0.0)
    street.send(1, 6.0, 4.0, stop_there=False)
    street.run(12.0)
    assert street.distance(1) < 0.12
    assert street.speeds[0] == 0.0


@pytest.mark.parametrize("planner", PLANNERS)
def test_one_that_sets_out_beside_a_corner_gets_round_it(planner: str) -> None:
    """Each second it is told the same corner again, 0.29 m away, until it has been nearer.

    A slow robot counted as past the corner as soon as it moved, turned to what comes after, and
    back at the next order: for minutes.
    """
    corner_m, beyond_m = (5.23, 4.83), (4.6, 4.0)
    street = Street(environment(room(12.0, 8.0)))
    street.add(1, 5.0, 5.0, -2.08, Body((0.18, 0.18), (0.0, 0.0), 0.4, 0.6, 0.8, 1.5))
    near = False
    for _ in range(8):
        near = near or math.dist(street.pose(1)[:2], corner_m) < 0.25
        to_m, then_m = (beyond_m, None) if near else (corner_m, beyond_m)
        street.command(1, MotionCommand(to_m, 0.6, near, planner=planner, beyond_m=then_m))
        street.run(1.0)
    assert math.dist(street.pose(1)[:2], beyond_m) < 0.2


def test_one_that_stands_beside_a_sub_goal_on_the_way_goes_to_it() -> None:
    """It is near enough to have passed it, had it been moving; standing it turns round first."""
    for yaw_rad in (0.0, 1.5, math.pi):
        street = Street(environment(room(8.0, 6.0)))
        street.add(1, 4.0, 3.0, yaw_rad)
        street.send(1, 4.3, 3.0, stop_there=False)
        street.run(0.5)
        street.send(1, 4.3, 3.0, stop_there=False)
        street.run_until_there(2.0)


def test_a_sub_goal_on_the_way_is_stopped_at_where_there_is_no_room_to_go_on() -> None:
    """At the end of a niche, closer to its wall than one walks in a second and brakes."""
    cells = room(8.0, 4.0)
    wall(cells, (5.0, 8.0), (0.0, 1.6))
    wall(cells, (5.0, 8.0), (2.4, 4.0))
    wall(cells, (5.9, 8.0), (0.0, 4.0))
    street = Street(environment(cells))
    street.add(1, 4.6, 2.0, 2.0)
    street.send(1, 5.56, 2.0, stop_there=False)
    street.run_until_there(4.0)


def test_who_is_kept_from_a_gap_by_somebody_in_it_waits_for_that_one() -> None:
    """Not for the wall, though the first that it would try, at full speed, meets the wall."""
    cells = room(8.0, 4.0)
    wall(cells, (4.0, 4.4), (0.0, 1.6))
    wall(cells, (4.0, 4.4), (2.4, 4.0))
    wall(cells, (4.85, 5.1), (0.0, 4.0))
    street = Street(environment(cells))
    street.add(1, 3.2, 2.0, 0.0)
    street.add(2, 4.2, 2.0, 0.0)
    street.send(1, 4.5, 2.0, stop_there=False)
    obstructions = set()
    for _ in range(100):
        street.step()
        what, who, since_s = street.obstruction(1)
        if since_s > 0.5:
            obstructions.add((what, who))
    assert (Obstruction.ARTEFACT, 2) in obstructions
    assert (Obstruction.WALL, -1) not in obstructions


@pytest.mark.parametrize(("width_m", "seconds"), [(2.0, 12.0), (1.6, 40.0)])
def test_two_pass_each_other_in_a_corridor(width_m: float, seconds: float) -> None:
    """Where there is room for two abreast, both reach the other end."""
    street = Street(corridor(width_m))
    middle = 0.5 * width_m + 0.5
    street.add(1, 1.0, middle, 0.0)
    street.add(2, 11.0, middle, math.pi)
    street.send(1, 11.0, middle)
    street.send(2, 1.0, middle)
    street.run_until_there(seconds)


def test_two_who_meet_in_a_gap_too_narrow_to_turn_in_back_out() -> None:
    """Face to face between walls in which no disc of theirs fits, they get to where they turn."""
    cells = room(10.0, 4.0)
    wall(cells, (4.0, 6.0), (0.0, 1.7))
    wall(cells, (4.0, 6.0), (2.3, 4.0))
    street = Street(environment(cells))
    street.add(1, 4.7, 2.0, 0.0)
    street.add(2, 5.3, 2.0, math.pi)
    street.send(1, 2.0, 2.0)
    street.send(2, 8.0, 2.0)
    street.run_until_there(40.0)


def test_one_that_another_keeps_from_turning_steps_back() -> None:
    """Both want to go east; the person faces west, with a robot half a metre before it.

    They stood for minutes: the person had no room to turn, and the robot follows its path.
    """
    street = Street(environment(room(12.0, 8.0)))
    street.add(1, 3.73, 4.0, 0.0, Body((0.18, 0.18)))
    street.add(2, 4.16, 4.21, math.pi, Body((0.165, 0.29)))
    street.send(1, 11.0, 3.65, planner="path_following")
    street.send(2, 8.8, 4.4)
    street.run_until_there(25.0)


def test_in_too_narrow_a_corridor_one_backs_off_and_both_turn_away_when_told() -> None:
    """One is named to the other as what hinders it; ordered back, both get there."""
    street = Street(corridor(0.9))
    street.add(1, 1.0, 0.95, 0.0)
    street.add(2, 11.0, 0.95, math.pi)
    street.send(1, 11.0, 0.95)
    street.send(2, 1.0, 0.95)
    obstructions, farthest = set(), {1: 0.0, 2: 12.0}
    for _ in range(30):
        street.run(0.5)
        obstructions |= {street.obstruction(one)[:2] for one in (1, 2)}
        x = {one: float(street.pose(one)[0]) for one in (1, 2)}
        farthest = {1: max(farthest[1], x[1]), 2: min(farthest[2], x[2])}
    assert {(Obstruction.ARTEFACT, 1), (Obstruction.ARTEFACT, 2)} & obstructions
    assert farthest[1] - x[1] > 1.0 or x[2] - farthest[2] > 1.0
    is_pushed_left = x[1] + x[2] < 12.0
    street.send(1 if is_pushed_left else 2, 10.0 if is_pushed_left else 2.0, 0.95)
    street.send(2 if is_pushed_left else 1, 11.0 if is_pushed_left else 1.0, 0.95)
    street.run_until_there(25.0)


def _gap() -> Street:
    """Return a room of 10 m with a gap of 0.9 m in a wall at x from 4 to 4.4 m."""
    cells = room(10.0, 5.0)
    wall(cells, (4.0, 4.4), (0.0, 2.05))
    wall(cells, (4.0, 4.4), (2.95, 5.0))
    return Street(environment(cells))


def test_one_that_stands_in_a_gap_steps_aside_for_who_has_waited() -> None:
    """Not at once, for it may go on by itself."""
    street = _gap()
    street.add(1, 6.5, 2.5, math.pi)
    street.add(2, 4.2, 2.5, 0.0)
    street.send(1, 1.5, 2.5)
    street.run(7.0)
    assert street.pose(2).tolist() == [4.2, 2.5, 0.0]
    street.run_until_there(30.0)


def test_followers_in_a_row_let_their_leader_out_of_a_niche() -> None:
    """They stand behind it, face to face in the gap, two more behind: nobody has a way.

    The first that is pushed asks the next one; the leader is out within half a minute.
    """
    street = _gap()
    street.add(1, 5.2, 2.5, math.pi)
    for one, x_m in ((2, 4.6), (3, 3.9), (4, 3.3)):
        street.add(one, x_m, 2.5, 0.0)
    street.send(1, 1.2, 2.5)
    street.run_until_there(30.0)


def test_who_follows_its_path_steps_aside_late_and_only_where_it_stands() -> None:
    """It stands in the only gap: for seconds it does not care, and in the end the other is out."""
    street = _gap()
    street.add(1, 6.5, 2.5, math.pi)
    street.add(2, 4.2, 2.5, 0.0)
    street.send(1, 1.5, 2.5)
    street.command(2, MotionCommand(None, 0.0, planner="path_following"))
    street.run(14.0)
    assert street.pose(2).tolist() == [4.2, 2.5, 0.0]
    street.run_until_there(90.0)


CARRIER = Body((0.6, 0.4), (-0.05, 0.0), 1.0, 1.2, 0.7, 1.0)


@pytest.mark.parametrize("begin_s", [0, 8, 16, 24, 32, 40])
@pytest.mark.parametrize("ids", [(1, 2), (2, 1)])
def test_two_in_each_others_turn_take_turns_to_push(ids: tuple[int, int], begin_s: int) -> None:
    """Only one of them can make room; with the priority at the other they stood for minutes."""
    street = Street(environment(room(10.25, 14.0)), index=round(begin_s / STEP_S))
    near, far = ids
    street.add(near, 8.89, 5.26, -0.58, CARRIER)
    street.add(far, 9.21, 6.54, -0.06, CARRIER)
    street.send(near, 7.23, 7.73, stop_there=False, planner="path_following")
    street.send(far, 5.03, 9.18, planner="path_following")
    street.run_until_there(45.0, within_m=1.0)


def _cross_a_door(width_m: float, count: int, seconds: float) -> float:
    """Send people through a door from both sides; return when the last has reached its place."""
    cells = room(12.0, 8.0)
    wall(cells, (5.95, 6.1), (0.0, 4.0 - 0.5 * width_m))
    wall(cells, (5.95, 6.1), (4.0 + 0.5 * width_m, 8.0))
    street = Street(environment(cells))
    terrain = Terrain(street.environment, 1.7)
    for one in range(count):
        back, y_m = one // 2 * 0.7, 4.0 + (one // 2 % 3 - 1)
        x_m = 4.6 - back if one % 2 == 0 else 7.4 + back
        street.add(one, x_m, y_m, 0.0 if one % 2 == 0 else math.pi)
        street.goals[one] = (12.0 - x_m, y_m + 0.3)
    missing = set(street.goals)
    for k in range(round(seconds / STEP_S)):
        if k % 20 == 0:
            for one in street.goals:
                _guide(street, terrain, one)
        street.step()
        missing -= {one for one in missing if street.distance(one) < 0.15}
        if not missing:
            return k * STEP_S
    raise AssertionError(f"{missing} did not get through")


def _guide(street: Street, terrain: Terrain, one: int) -> None:
    """Send one to the last point of its way through the door that it sees."""
    x_m, y_m, _ = street.pose(one).tolist()
    goal = street.goals[one]
    side = 1.0 if goal[0] > 6.0 else -1.0
    way = [(6.025 - 0.7 * side, 4.0), (6.025, 4.0), (6.025 + 0.7 * side, 4.0), goal]
    if (x_m - 6.025) * side > 0.5:
        way = way[3:]
    seen = [point for point in way if terrain.sees((x_m, y_m), point, 0.33)] or way[:1]
    speed = PERSON.speed_mps
    street.command(one, MotionCommand(seen[-1], speed, stop_there=seen[-1] == goal))


@pytest.mark.parametrize(("width_m", "seconds"), [(0.8, 150.0), (1.0, 120.0), (1.2, 90.0)])
def test_a_knot_of_ten_at_a_door_dissolves(width_m: float, seconds: float) -> None:
    """Five from each side get through a door that lets one through at a time."""
    _cross_a_door(width_m, 10, seconds)


def test_two_streams_cross() -> None:
    """Eight from the left and eight from below pass through each other."""
    street = Street(environment(room(14.0, 14.0)))
    for n in range(8):
        along, across = 1.0 + 0.8 * (n % 4), 6.2 + 1.2 * (n // 4)
        street.add(n, along, across, 0.0)
        street.add(8 + n, across, along, 0.5 * math.pi)
        street.send(n, along + 9.0, across)
        street.send(8 + n, across, along + 9.0)
    assert street.run_until_there(30.0) < 20.0


def test_twelve_swap_places_across_a_circle() -> None:
    """Everybody on a circle of 5 m gets to the opposite place."""
    street = Street(environment(room(14.0, 14.0)))
    for n in range(12):
        angle = math.tau * n / 12
        x_m, y_m = 5.0 * math.cos(angle), 5.0 * math.sin(angle)
        street.add(n, 7.0 + x_m, 7.0 + y_m, angle + math.pi)
        street.send(n, 7.0 - x_m, 7.0 - y_m)
    street.run_until_there(60.0)


def test_a_follower_waits_behind_one_that_stands_and_goes_around() -> None:
    """Somebody who stands in the way is passed, with room for him."""
    street = Street(environment(room(12.0, 6.0)))
    street.add(1, 1.5, 3.0, 0.0)
    street.add(2, 6.0, 3.0, 0.0, PALLET)
    street.send(1, 10.5, 3.0)
    assert street.run_until_there(15.0) < 10.0


@pytest.mark.parametrize("yaw_rad", [0.0, 2.0])
@pytest.mark.parametrize("y_m", [0.95, 1.15, 1.35])
def test_nobody_paces_to_and_fro_in_front_of_what_closes_the_way(
    y_m: float, yaw_rad: float
) -> None:
    """A pallet across a corridor: a turn away and a detour, not a round each four seconds."""
    street = Street(corridor(1.3, 14.0))
    street.add(0, 4.0, y_m, yaw_rad)
    street.add(1, 5.2, 1.15, 0.5 * math.pi, PALLET)
    street.send(0, 12.0, 1.15)
    yaws_rad = []
    for _ in range(round(12.0 / STEP_S)):
        street.step()
        yaws_rad.append(float(street.pose(0)[2]))
    turned_rad = sum(abs(math.remainder(b - a, math.tau)) for a, b in pairwise(yaws_rad))
    assert turned_rad < 2.0 * math.tau


def test_a_wide_barrier_is_walked_around() -> None:
    """A row of boxes across most of the room, not on the map, does not hold anybody for ever."""
    street = Street(environment(room(12.0, 9.0)))
    street.add(1, 1.5, 4.5, 0.0)
    for n in range(3):
        street.add(10 + n, 6.0, 3.2 + 1.25 * n, 0.5 * math.pi, PALLET)
    street.send(1, 10.5, 4.5)
    street.run_until_there(60.0)


def test_a_car_finds_its_way_among_people() -> None:
    """A car and fifteen people get where they want to be."""
    street = Street(environment(room(30.0, 16.0)))
    random = np.random.default_rng(2)
    street.add(0, 4.0, 8.0, 0.0, CAR)
    street.send(0, 26.0, 8.0)
    for n in range(1, 16):
        street.add(n, 8.0 + 1.1 * n, 2.0 + 12.0 * random.random(), 0.0)
        street.send(n, *(8.0 + 16.0 * random.random(), 2.0 + 12.0 * random.random()))
    street.run_until_there(90.0, within_m=0.5)


@pytest.mark.parametrize(
    ("size_m", "start", "goal", "body"),
    [
        ((24.0, 9.0), (12.0, 4.5, 0.0), (3.0, 4.5), CAR),
        ((24.0, 9.0), (5.0, 4.5, 0.0), (4.0, 6.0), CAR),
        ((30.0, 30.0), (15.0, 15.0, 0.0), (15.0, 19.0), CAR),
        ((12.0, 5.0), (8.0, 2.5, 0.0), (2.0, 2.5), SCOOTER),
    ],
)
def test_a_vehicle_manoeuvres_to_what_lies_behind_or_beside_it(
    size_m: tuple[float, float],
    start: tuple[float, float, float],
    goal: tuple[float, float],
    body: Body,
) -> None:
    """By arcs, in reverse where there is no other way; it never slides."""
    street = Street(environment(room(*size_m)))
    street.add(1, *start, body)
    street.send(1, *goal)
    street.run_until_there(60.0, within_m=0.45)


def test_a_vehicle_does_not_stand_beside_a_sub_goal_on_its_way() -> None:
    """Beside the end of its way it has arrived; at one to pass nobody might give it another."""
    for stop_there, away_m in ((True, 0.3), (False, 0.0)):
        cells = room(12.0, 5.0)
        wall(cells, (6.7, 7.0), (0.0, 5.0))
        street = Street(environment(cells))
        street.add(1, 6.0, 2.5, 0.0, SCOOTER)
        street.send(1, 6.0, 2.8, stop_there=stop_there)
        street.run(25.0)
        assert street.distance(1) == pytest.approx(away_m, abs=0.1)
        assert street.speeds[0] == 0.0


def test_a_vehicle_shunts_out_of_a_slot_that_leaves_it_two_decimetres() -> None:
    """Boxed in before and behind, open to its left: turning a little each time, it gets out."""
    cells = room(8.0, 6.0)
    wall(cells, (2.0, 2.75), (0.0, 2.0))
    wall(cells, (4.85, 5.5), (0.0, 2.0))
    street = Street(environment(cells))
    street.add(1, 3.75, 1.55, 0.0, SCOOTER)
    street.send(1, 6.0, 4.5)
    street.run_until_there(90.0, within_m=0.6)


def test_a_car_turns_round_in_a_street_that_is_narrower_than_its_circle() -> None:
    """With a goal far behind, in a street of 8 m, a car with a circle of 10.6 m gets there."""
    street = Street(environment(room(60.0, 8.0)))
    street.add(1, 50.0, 4.0, 0.0, CAR)
    street.send(1, 5.0, 4.0)
    street.run_until_there(90.0, within_m=0.45)


def _robot(index: int, speed_mps: float) -> RobotMotion:
    """Return a robot that winds its way through the room."""
    t = index * STEP_S
    x_m, y_m = 2.0 + speed_mps * t, 8.0 + math.sin(0.4 * t)
    footprint = Footprint.disc(0.3).at(x_m, y_m, 0.0)
    return RobotMotion(footprint, x_m, y_m, 0.0, speed_mps, 0.4 * math.cos(0.4 * t), 0.0)


@pytest.mark.parametrize("speed_mps", [0.5, 1.0])
def test_a_crowd_makes_way_for_the_robot(speed_mps: float) -> None:
    """A robot that drives through twenty people, as predicted, touches nobody."""
    random = np.random.default_rng(5)
    street = Street(environment(room(16.0, 16.0)))
    for n in range(20):
        street.add(n, 4.0 + 2.4 * (n % 5), 2.0 + 3.2 * (n // 5), random.random() * 6.0)
    for k in range(round(12.0 / speed_mps / STEP_S)):
        if k % 100 == 0:
            for n in range(20):
                street.send(n, *(1.0 + 14.0 * random.random(2)).tolist())
        robot = _robot(street.index, speed_mps)
        street.step(robot)
        assert signed_distance_m(robot.footprint, street.boxes()).min() > 0.0


def test_nobody_walks_into_a_robot_that_stands() -> None:
    """A robot in the way is an obstacle, and is named as what hinders where it fills a corridor."""
    street = Street(corridor(1.2))
    street.add(1, 1.0, 1.1, 0.0)
    street.send(1, 11.0, 1.1)
    footprint = Footprint.disc(0.4).at(6.0, 1.1, 0.0)
    robot = RobotMotion(footprint, 6.0, 1.1, 0.0, 0.0, 0.0, 0.0)
    for _ in range(240):
        street.step(robot)
        assert signed_distance_m(footprint, street.boxes()).min() > 0.0
    assert street.obstruction(1)[:2] == (Obstruction.ROBOT, -1)


def _towards(index: int, speed_mps: float) -> RobotMotion:
    """Return a robot that drives along x, at y = 3, from x = 1 on."""
    x_m = 1.0 + speed_mps * index * STEP_S
    return RobotMotion(Footprint.disc(0.3).at(x_m, 3.0, 0.0), x_m, 3.0, 0.0, speed_mps, 0.0, 0.0)


@pytest.mark.parametrize("speed_mps", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("yaw_rad", [0.0, 2.0, math.pi])
def test_who_stands_in_the_robots_way_steps_aside(speed_mps: float, yaw_rad: float) -> None:
    """On either side of its line, or on it, whatever the heading; who is beside it stays there."""
    street = Street(environment(room(12.0, 6.0)))
    places_m = [(3.0, 3.0), (6.0, 3.2), (9.0, 2.6), (6.0, 4.2)]
    for n, (x_m, y_m) in enumerate(places_m):
        street.add(n, x_m, y_m, yaw_rad)
    least_m = math.inf
    for _ in range(round(9.5 / speed_mps / STEP_S)):
        robot = _towards(street.index, speed_mps)
        street.step(robot)
        least_m = min(least_m, float(signed_distance_m(robot.footprint, street.boxes()).min()))
    assert least_m > 0.0
    assert street.pose(3)[:2].tolist() == list(places_m[3])


def test_who_follows_a_path_does_not_step_aside() -> None:
    """An AGV that stands keeps its place; the robot has to stop for it."""
    street = Street(environment(room(12.0, 6.0)))
    street.add(1, 6.0, 3.0, math.pi)
    street.send(1, 6.0, 3.0, planner="path_following")
    street.run(10.0, lambda index: _towards(index, 0.4))
    assert street.distance(1) == 0.0


def test_one_that_the_robot_has_come_to_touch_can_walk_away() -> None:
    """A contact is the robot's; it does not hold the artefact."""
    street = Street(environment(room(10.0, 6.0)))
    street.add(1, 5.0, 3.0, 0.0)
    street.send(1, 8.0, 3.0)
    footprint = Footprint.disc(0.3).at(4.6, 3.0, 0.0)
    robot = RobotMotion(footprint, 4.6, 3.0, 0.0, 0.0, 0.0, 0.0)
    assert signed_distance_m(footprint, street.boxes())[0] < 0.0
    street.run(6.0, lambda _: robot)
    assert street.distance(1) < 0.12


def test_unknown_cells_are_not_entered_but_left() -> None:
    """Nobody goes where nothing is known, but who stands there gets out of it."""
    cells = room(12.0, 6.0)
    cells[:, 80:160] = UNKNOWN
    street = Street(environment(cells), inspects=False)
    street.add(1, 2.0, 3.0, 0.0)
    street.add(2, 6.0, 2.0, 0.0)
    street.send(1, 10.0, 3.0)
    street.send(2, 10.0, 2.0)
    for _ in range(200):
        street.step()
        assert street.environment.is_placeable(street.boxes())[0]
    assert street.distance(2) < 0.12
    assert street.distance(1) > 6.0


@pytest.mark.parametrize("seed", [0, 1])
def test_a_mixed_crowd_keeps_to_all_limits(seed: int) -> None:
    """People, scooters and cars with random goals on a turned map: nothing overlaps, ever."""
    street = _mixed_crowd(seed, 20)
    _wander(street, np.random.default_rng(seed), 60.0)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(8))
def test_a_mixed_crowd_keeps_to_all_limits_for_minutes(seed: int) -> None:
    """The same for five minutes each, with more of them."""
    street = _mixed_crowd(100 + seed, 35)
    _wander(street, np.random.default_rng(seed), 300.0)


def _mixed_crowd(seed: int, count: int) -> Street:
    random = np.random.default_rng(seed)
    cells = room(30.0, 20.0)
    for _ in range(6):
        x_m, y_m = random.uniform(3.0, 25.0), random.uniform(3.0, 16.0)
        lengths = (3.0, 0.2) if random.random() < 0.5 else (0.2, 3.0)
        wall(cells, (x_m, x_m + lengths[0]), (y_m, y_m + lengths[1]))
    street = Street(environment(cells, (-3.0, 2.0, 0.3)))
    while len(street.bodies) < count:
        body = (PERSON, PERSON, PERSON, SCOOTER, CAR, PALLET)[random.integers(6)]
        x_m, y_m = _anywhere(street, random)
        yaw_rad = random.uniform(0.0, 6.0)
        boxes = boxes_at(np.array([[x_m, y_m, yaw_rad]]), [body])
        if street.environment.is_placeable(boxes)[0] and street.planner.is_clear(boxes)[0]:
            street.add(len(street.bodies), x_m, y_m, yaw_rad, body)
    return street


def _anywhere(street: Street, random: np.random.Generator) -> tuple[float, float]:
    grid = street.environment.grid
    local = np.array([[random.uniform(0.5, 29.5), random.uniform(0.5, 19.5), 0.0]])
    x_m, y_m, _ = grid.origin.apply(local)[0].tolist()
    return x_m, y_m


def _wander(street: Street, random: np.random.Generator, seconds: float) -> None:
    """Send everybody to random places, another one each eight seconds or so."""
    for k in range(round(seconds / STEP_S)):
        if k % 8 == 0:
            one = int(random.integers(len(street.bodies)))
            street.send(one, *_anywhere(street, random))
        street.step()
    assert street.plans_made > 10 * seconds
    assert street.emergency_stops == 0


_places = st.tuples(st.floats(0.6, 5.4), st.floats(0.6, 3.4), st.floats(-4.0, 4.0))


@settings(max_examples=25)
@given(st.lists(st.tuples(_places, _places), min_size=1, max_size=7), st.integers(0, 1000))
def test_small_random_scenes_keep_the_invariants(
    trips: list[tuple[tuple[float, float, float], tuple[float, float, float]]], index: int
) -> None:
    """Whoever is placed clear of the others, and sent anywhere, overlaps nothing on the way."""
    cells = room(6.0, 4.0)
    wall(cells, (2.9, 3.1), (0.0, 1.4))
    street = Street(environment(cells), index=index)
    for one, (start, goal) in enumerate(trips):
        boxes = boxes_at(np.array([start]), [PERSON])
        if street.environment.is_placeable(boxes)[0] and street.planner.is_clear(boxes)[0]:
            street.add(one, *start)
            street.send(one, *goal[:2])
    street.run(6.0)


def test_a_displaced_one_breaks_a_path_and_the_walker_avoids_it() -> None:
    """One put onto the path of a walker at full speed is walked around, or stopped for in time."""
    street = Street(environment(room(14.0, 8.0)))
    street.add(1, 1.5, 4.0, 0.0)
    street.add(2, 5.0, 1.0, 0.0)
    street.send(1, 12.0, 4.0)
    street.run(2.0)
    ahead = street.trajectory(1)[-1]
    street.put(2, GroundPose(float(ahead[0]), 4.0, 0.0, 0.0))
    street.forget()
    street.run_until_there(15.0) if street.goals.pop(2, None) else street.run(12.0)
    assert street.distance(1) < 0.12
