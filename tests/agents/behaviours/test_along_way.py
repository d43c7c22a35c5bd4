"""Along a way: the waypoints of a scenario, in their order."""

from are_ros.agents.behaviours.along_way import AlongWay
from tests.agents.behaviours.stage import Actor, Stage, alone

WAY = ((2.0, 0.0), (2.0, 3.0), (-1.0, 3.0))


def goals_of(repeat: bool, seconds: int) -> list[tuple[float, float] | None]:
    """Return the goals of one who starts at the origin, repetitions left out."""
    behaviour = AlongWay(WAY, repeat=repeat)
    stage = Stage([Actor(0, behaviour, (0.0, 0.0))])
    goals = [stage.step()[0].goal_m for _ in range(seconds)]
    return [
        goal for goal, before in zip(goals, [(0.0, 0.0), *goals], strict=False) if goal != before
    ]


def test_waypoints_come_in_their_order_and_it_stands_at_the_end() -> None:
    """Each is reached before the next."""
    assert goals_of(repeat=False, seconds=30) == [(2.0, 0.0), (2.0, 3.0), (-1.0, 3.0), None]


def test_a_way_may_be_gone_again_and_again() -> None:
    """After the last comes the first."""
    assert goals_of(repeat=True, seconds=30)[:5] == [
        (2.0, 0.0),
        (2.0, 3.0),
        (-1.0, 3.0),
        (2.0, 0.0),
        (2.0, 3.0),
    ]


def test_a_waypoint_that_cannot_be_reached_is_left_out_unless_it_is_the_last() -> None:
    """The end of the way is not given up."""
    actor = Actor(0, AlongWay(WAY), (0.0, 0.0))
    goals = []
    for second in range(5):
        goals.append(alone(actor, now_s=second).goal_m)
        actor.no_way = True
    assert goals == [(2.0, 0.0), (2.0, 3.0), (-1.0, 3.0), (-1.0, 3.0), (-1.0, 3.0)]
