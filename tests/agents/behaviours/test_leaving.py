"""Leaving: by the nearest exit that can be reached."""

import math
from typing import Any

import numpy as np
import pytest

from are_ros.agents.behaviours.leaving import Leaving, WalkingOut, choose_exits
from are_ros.agents.behaviours.open_view import OpenView
from are_ros.agents.behaviours.situation import Point
from tests.agents.behaviours.stage import Actor, Stage, alone, places_at, robot_at

EXITS = places_at([(1.0, 1.0)], [(20.0, 0.0), (5.0, 0.0), (-9.0, 0.0)])


def test_it_goes_to_the_nearest_exit_and_has_left() -> None:
    """It is out when it is there, and stands then."""
    leaving = Leaving()
    stage = Stage([Actor(0, leaving, (0.0, 0.0))], EXITS)
    goals = [stage.step()[0].goal_m for _ in range(10)]
    assert goals[0] == (5.0, 0.0)
    assert leaving.has_left
    assert (goals[-1], stage.actors[0].last and stage.actors[0].last.activity) == (None, "left")


def test_an_exit_without_a_way_is_never_tried_again() -> None:
    """The next nearest is; with none left it says so."""
    actor = Actor(0, Leaving(), (0.0, 0.0))
    goals = []
    for second in range(4):
        goals.append(alone(actor, EXITS, now_s=second).goal_m)
        actor.no_way = True
    assert goals == [(5.0, 0.0), (-9.0, 0.0), (20.0, 0.0), None]
    assert actor.last is not None
    assert actor.last.activity == "no way out"


def test_a_blocked_exit_is_left_for_another_and_may_come_back() -> None:
    """After 12 s it tries the next nearest, and then the first again."""
    actor = Actor(0, Leaving(), (0.0, 0.0))
    actor.blocked_s = 99.0
    goals = [alone(actor, EXITS, now_s=second).goal_m for second in range(40)]
    assert goals[:13] == [(5.0, 0.0)] * 13
    assert goals[13:26] == [(-9.0, 0.0)] * 13
    assert goals[26] == (5.0, 0.0)


def test_without_exits_it_goes_far_from_the_robot() -> None:
    """In a closed map the destination farthest from the robot is the way out, else from itself."""
    places = places_at([(1.0, 0.0), (9.0, 0.0), (-6.0, 0.0)])
    robot = robot_at((8.0, 0.0))
    assert alone(Actor(0, Leaving(), (0.0, 0.0)), places, robot=robot).goal_m == (-6.0, 0.0)
    assert alone(Actor(0, Leaving(), (0.0, 0.0)), places).goal_m == (9.0, 0.0)
    assert alone(Actor(0, Leaving(), (0.0, 0.0)), places_at([])).activity == "no way out"


# --- exits out of the robot's sight


SCREENED = OpenView(walls_m=[((3.0, -2.0), (3.0, 2.0))])


def exit_of_one_at(
    point_m: Point, left_s: float, *, exits_m: tuple[Point, ...] = (), last_m: Point | None = None
) -> Point | None:
    """Return the exit of one; the camera looks from (0, 0) along x, over the wall."""

    def hides(points_m: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, Any]:
        return np.abs(points_m[:, 1]) > 0.3 * points_m[:, 0]

    actor, way_out = Actor(0, Leaving(), point_m), WalkingOut()
    places, robot = places_at([(40.0, 41.0)], exits_m), robot_at((0.0, 0.0))
    situation = actor.situation(SCREENED, places, robot)._replace(left_s=left_s)
    way_out.exit_m = last_m
    choose_exits([(way_out, situation)], hides)
    return way_out.exit_m


def test_an_exit_in_reach_is_taken_and_kept_while_nobody_sees_it() -> None:
    """The nearest one of those out of sight, even where it stands unseen."""
    exits_m = ((20.0, 0.0), (5.0, 30.0), (-3.0, 1.0), (-2.0, 5.0))
    assert exit_of_one_at((-1.0, 1.0), 60.0, exits_m=exits_m) == (-3.0, 1.0)
    assert exit_of_one_at((-1.0, 1.0), 60.0, exits_m=exits_m, last_m=(-2.0, 5.0)) == (-2.0, 5.0)
    assert exit_of_one_at((-1.0, 1.0), 60.0, exits_m=exits_m, last_m=(20.0, 0.0)) == (-3.0, 1.0)
    assert exit_of_one_at((-1.0, 1.0), 5.5, exits_m=exits_m, last_m=(-2.0, 5.0)) == (-1.0, 1.0)


def test_one_in_view_goes_to_the_nearest_point_out_of_sight() -> None:
    """The straight way there has to be free."""
    found_m = exit_of_one_at((2.0, 0.3), 6.0)
    assert found_m is not None
    assert abs(found_m[1]) > 0.3 * found_m[0]
    assert math.dist(found_m, (2.0, 0.3)) == pytest.approx(1.0)


@pytest.mark.parametrize(("left_s", "is_behind"), [(6.0, True), (0.5, False)])
def test_a_point_behind_a_wall_is_better_if_there_is_time(left_s: float, is_behind: bool) -> None:
    """Any other is in sight when the robot turns; too late, any will do."""
    found_m = exit_of_one_at((3.5, 2.6), left_s)
    assert found_m is not None
    robot = Actor(1, Leaving(), (0.0, 0.0)).as_fellow()
    assert SCREENED.sees(robot, *found_m) != is_behind
    assert abs(found_m[1]) > 0.3 * found_m[0]


def test_an_exit_without_a_way_is_given_up_for_the_next() -> None:
    """When no place is left, all of them are tried again."""
    exits_m, robot = [(-3.0, 1.0), (-2.0, 5.0)], robot_at((0.0, 0.0))
    actor, way_out = Actor(0, WalkingOut(), (-1.0, 1.0), no_way=True), WalkingOut()

    def hides(points_m: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, Any]:
        return np.array([tuple(point_m) in exits_m for point_m in points_m.tolist()], np.bool_)

    chosen_m = []
    for _ in range(4):
        situation = actor.situation(SCREENED, places_at([], exits_m), robot)._replace(left_s=60.0)
        choose_exits([(way_out, situation)], hides)
        actor.last = way_out.decide(situation)
        chosen_m.append(way_out.exit_m)
    assert chosen_m == [*exits_m, None, exits_m[0]]
