"""Crossing: across the robot's path, in front of it, again and again."""

import math
from dataclasses import replace

import numpy as np
import pytest

from are_ros.agents.behaviours.crossing import Crossing
from are_ros.agents.behaviours.situation import Point
from tests.agents.behaviours.stage import Actor, Stage, alone, lattice, robot_at


def test_the_path_is_the_rest_of_the_plan_then_straight_on() -> None:
    """Lengths count along the plan from the robot; beyond its end the way is straight."""
    path = robot_at((1.0, 0.0), (0.5, 0.0), [(0, 0), (1, 0), (2, 0), (2, 0), (2, 3)]).path
    assert path.at(0.5) == ((1.5, 0.0), (1.0, 0.0))
    assert path.at(2.0) == ((2.0, 1.0), (0.0, 1.0))
    assert path.at(9.0) == ((2.0, 8.0), (0.0, 1.0))
    assert path.distance_m((2.0, 6.0), 10.0) == pytest.approx(0.0, abs=0.13)
    assert path.distance_m((2.0, 6.0), 4.0) == pytest.approx(3.25, abs=0.2)


def test_without_a_fitting_plan_the_path_is_straight_on() -> None:
    """An old plan elsewhere counts for nothing; who stands looks along its heading."""
    (point, along) = robot_at((0.0, 0.0), (0.0, 0.4), [(9, 9), (9, 10)]).path.at(2.0)
    assert point == pytest.approx((0.0, 2.0))
    assert along == pytest.approx((0.0, 1.0))
    assert robot_at((0.0, 0.0), (0.0, 0.0)).path.at(2.0)[0] == (2.0, 0.0)


@pytest.mark.parametrize("start", [(4.0, 3.0), (4.0, -3.0), (2.0, 1.0), (7.0, -1.5)])
def test_its_goal_is_across_the_path_in_front_of_the_robot(start: Point) -> None:
    """The straight way to it meets the robot's path ahead of the robot, in time."""
    actor = Actor(0, Crossing(), start)
    robot = robot_at((0.0, 0.0), (0.5, 0.0))
    intent = alone(actor, robot=robot)
    assert intent.activity == "crossing"
    assert intent.goal_m is not None
    assert intent.goal_m[1] * start[1] < 0.0
    share = start[1] / (start[1] - intent.goal_m[1])
    crossing_x = start[0] + share * (intent.goal_m[0] - start[0])
    assert crossing_x > robot.radius_m + 0.3
    meets_s = share * math.dist(start, intent.goal_m) / intent.speed_mps
    assert 0.5 * meets_s < crossing_x
    assert intent.robot_comfort_m is not None


def test_it_crosses_the_plan_where_the_plan_turns() -> None:
    """With a plan round a corner the goal is across the plan's next leg."""
    plan = [(0.1 * k, 0.0) for k in range(11)] + [(1.0, 0.1 * k) for k in range(1, 80)]
    actor = Actor(0, Crossing(), (4.0, 3.0))
    intent = alone(actor, robot=robot_at((0.0, 0.0), (0.5, 0.0), plan))
    assert intent.goal_m is not None
    assert intent.goal_m[0] < 1.0


def test_it_crosses_again_and_again() -> None:
    """In front of a robot that drives slowly it comes and goes many times."""
    actor = Actor(0, Crossing(), (4.0, 3.0))
    stage = Stage([actor], lattice(), robot_at((-10.0, 0.0), (0.2, 0.0)))
    sides = []
    for _ in range(120):
        stage.step()
        if stage.robot and actor.last and actor.last.activity == "crossing":
            assert actor.point_m[0] > stage.robot.x_m
            sides.append(np.sign(actor.point_m[1]))
    changes = int(np.count_nonzero(np.diff(sides)))
    assert changes >= 6


def test_it_comes_near_a_robot_that_is_far_or_behind_a_wall() -> None:
    """It walks to the destination nearest to the robot's way, a place that is planned to."""
    far = alone(Actor(0, Crossing(), (-10.0, -10.0)), robot=robot_at((6.0, 10.0), (0.5, 0.0)))
    assert (far.goal_m, far.activity, far.is_moving_goal) == ((10.0, 10.0), "walking", False)
    wall = (((-20.0, 1.0), (20.0, 1.0)),)
    hidden = alone(Actor(0, Crossing(), (1.0, 3.0)), walls_m=wall, robot=robot_at((-4.0, 0.0)))
    assert (hidden.goal_m, hidden.activity) == ((0.0, 0.0), "walking")


def test_who_cannot_cross_walks_about_for_a_while() -> None:
    """Blocked for 3 s it lets the robot be, and tries again after 6 s."""
    actor = Actor(0, Crossing(), (4.0, 3.0))
    robot = robot_at((0.0, 0.0), (0.0, 0.0))
    assert alone(actor, robot=robot).activity == "crossing"
    actor.blocked_s = 5.0
    seen = [alone(actor, robot=robot, now_s=second).activity for second in range(1, 12)]
    actor.blocked_s = 0.0
    assert seen[:3] == ["crossing"] * 3
    assert seen[3:9] == ["walking"] * 6
    assert seen[9] == "crossing"


def test_a_crossing_is_aimed_anew_when_the_robot_turns_away() -> None:
    """Once the middle is off the robot's path there is another goal."""
    actor = Actor(0, Crossing(), (4.0, 3.0))
    first = alone(actor, robot=robot_at((0.0, 0.0), (0.5, 0.0)))
    second = alone(actor, robot=robot_at((0.0, 0.0), (0.0, 0.5)), now_s=1.0)
    assert second.activity == "crossing"
    assert second.goal_m != first.goal_m
    assert second.goal_m is not None
    assert second.goal_m[0] < 0.0


def test_before_a_robot_that_turns_on_the_spot_it_gets_across() -> None:
    """It keeps its goal, and pauses there; it circled round the robot."""
    actor = Actor(0, Crossing(), (4.0, 3.0))
    stage = Stage([actor], lattice(), robot_at((0.0, 0.0), (0.0, 0.0)))
    pauses = 0
    for k in range(60):
        stage.robot = replace(robot_at((0.0, 0.0), (0.0, 0.0)), yaw_rad=0.5 * k)
        stage.step()
        pauses += actor.last is not None and actor.last.activity == "pausing"
    assert pauses > 10


def test_without_a_robot_it_walks() -> None:
    """There is nothing to cross."""
    assert alone(Actor(0, Crossing(), (4.0, 3.0))).activity == "walking"
