"""Avoiding: away from the robot, never nearer."""

import math

import pytest

from are_ros.agents.behaviours.avoiding import Avoiding
from are_ros.agents.behaviours.open_view import OpenView
from are_ros.agents.behaviours.situation import WORTH, Point
from tests.agents.behaviours.stage import NO_WALLS, Actor, Stage, alone, lattice, robot_at


@pytest.mark.parametrize("start", [(2.0, 0.0), (-1.0, 3.0), (0.5, -0.5), (0.0, -3.9)])
def test_near_the_robot_it_goes_away(start: Point) -> None:
    """No point of its straight way is nearer to the robot than it is now."""
    intent = alone(Actor(0, Avoiding(), start), robot=robot_at((0.0, 0.0)))
    assert intent.activity == "avoiding"
    assert intent.goal_m is not None
    away = (intent.goal_m[0] - start[0]) * start[0] + (intent.goal_m[1] - start[1]) * start[1]
    assert away > 0.0
    assert intent.robot_comfort_m is not None
    assert intent.robot_comfort_m > 1.0


def test_along_a_wall_it_still_goes_away() -> None:
    """With a wall behind it, it slips away sideways."""
    wall = (((3.0, -50.0), (3.0, 50.0)),)
    intent = alone(Actor(0, Avoiding(), (2.0, 0.0)), walls_m=wall, robot=robot_at((0.0, 0.0)))
    assert intent.goal_m is not None
    assert intent.goal_m[0] < 3.0
    assert math.dist(intent.goal_m, (0.0, 0.0)) > 2.0


def test_in_a_corner_it_stands_and_looks_at_the_robot() -> None:
    """Rather than pass the robot it stays, and says why."""
    walls = (((2.3, -9.0), (2.3, 9.0)), ((-9.0, 0.3), (9.0, 0.3)), ((-9.0, -0.3), (9.0, -0.3)))
    intent = alone(Actor(0, Avoiding(), (2.0, 0.0)), walls_m=walls, robot=robot_at((0.0, 0.0)))
    assert (intent.goal_m, intent.activity, intent.face_m) == (None, "cornered", (0.0, 0.0))


def test_it_is_worth_something_near_the_robot_unless_it_gets_nowhere() -> None:
    """Who is cornered does something else before long; who walks avoids nobody 5 m away."""
    corner = (((2.3, -9.0), (2.3, 9.0)), ((-9.0, 0.3), (9.0, 0.3)), ((-9.0, -0.3), (9.0, -0.3)))

    def worth(actor: Actor, *, is_cornered: bool = False) -> float:
        view = OpenView([actor.as_fellow()], corner if is_cornered else NO_WALLS)
        avoiding = Avoiding()
        before = avoiding.reward(actor.situation(view, lattice(), robot_at((0.0, 0.0))))
        actor.last = avoiding.decide(actor.situation(view, lattice(), robot_at((0.0, 0.0))))
        after = avoiding.reward(actor.situation(view, lattice(), robot_at((0.0, 0.0))))
        assert before == 3.0 * WORTH * (math.dist(actor.point_m, (0.0, 0.0)) < 4.0)
        return after

    assert worth(Actor(0, Avoiding(), (2.0, 0.0))) == 3.0 * WORTH
    assert worth(Actor(0, Avoiding(), (2.0, 0.0)), is_cornered=True) == 0.0
    assert worth(Actor(0, Avoiding(), (5.0, 0.0))) == 0.0


def test_it_goes_on_until_it_is_far_enough() -> None:
    """Between 4 and 6 m it depends on whether it was going away already."""
    actor = Actor(0, Avoiding(), (5.0, 0.0))
    assert alone(actor, robot=robot_at((0.0, 0.0))).activity == "walking"
    actor.point_m = (3.5, 0.0)
    assert alone(actor, robot=robot_at((0.0, 0.0)), now_s=1.0).activity == "avoiding"
    actor.point_m = (5.0, 0.0)
    assert alone(actor, robot=robot_at((0.0, 0.0)), now_s=2.0).activity == "avoiding"
    actor.point_m = (6.5, 0.0)
    assert alone(actor, robot=robot_at((0.0, 0.0)), now_s=3.0).activity == "walking"


def test_its_destinations_are_not_past_the_robot() -> None:
    """The straight way to them keeps 5 m from the robot, or what there is of it."""
    robot = robot_at((0.0, 0.0))
    for seed in range(30):
        intent = alone(Actor(0, Avoiding(), (7.0, 1.0), seed=seed), lattice(7), robot=robot)
        assert intent.goal_m is not None
        for k in range(101):
            x_m = 7.0 + 0.01 * k * (intent.goal_m[0] - 7.0)
            y_m = 1.0 + 0.01 * k * (intent.goal_m[1] - 1.0)
            assert math.hypot(x_m, y_m) > 4.9


def test_a_slow_robot_never_comes_near() -> None:
    """On the stage it keeps away from a robot that is slower than it."""
    actor = Actor(0, Avoiding(), (5.0, 0.3))
    stage = Stage([actor], lattice(7), robot_at((0.0, 0.0), (0.5, 0.0)))
    for _ in range(60):
        before_m, was = actor.point_m, stage.robot
        (intent,) = stage.step()
        assert was is not None
        if intent.activity == "avoiding":
            assert math.dist(actor.point_m, was.point_m) > math.dist(before_m, was.point_m)
        assert stage.robot is not None
        assert math.dist(actor.point_m, stage.robot.point_m) > 3.0


def test_without_a_robot_it_walks() -> None:
    """There is nothing to keep away from."""
    assert alone(Actor(0, Avoiding(), (0.0, 0.0))).activity == "walking"
