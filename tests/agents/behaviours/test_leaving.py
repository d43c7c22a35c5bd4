"""Leaving: by the nearest exit that can be reached."""

from are_ros.agents.behaviours.leaving import Leaving
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
