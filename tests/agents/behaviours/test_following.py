"""Following: behind the leader, along its trail, and another one when it leaves."""

import math
from itertools import pairwise

import pytest

from are_ros.agents.behaviours.following import Following
from are_ros.agents.behaviours.situation import Intent, Neighbour, Point
from are_ros.agents.behaviours.walking import Walking
from are_ros.population.catalogue import MotionLimits
from tests.agents.behaviours.stage import (
    NO_WALLS,
    Actor,
    Stage,
    alone,
    fellow_at,
    lattice,
    row_of,
)

KEEP_M = 1.6
"""A gap of 1 m between two bodies of 0.3 m radius."""


def led_by(follower: Actor, leader: Neighbour, second: float = 0.0) -> Intent:
    """Let the follower decide beside one other, and go."""
    intent = alone(follower, neighbours=[leader], now_s=second)
    follower.move()
    return intent


def test_a_follower_stays_behind() -> None:
    """Of who walks straight on it wants to be 1 m behind, and gets there and stays there."""
    follower = Actor(9, Following(), (-6.0, 2.0))
    for second in range(40):
        leader = fellow_at((0.8 * second, 0.0), velocity_mps=(0.8, 0.0))
        intent = led_by(follower, leader, second)
        assert intent.activity.startswith("following artefact ")
        assert intent.goal_m is None or intent.goal_m[0] <= leader.x_m - KEEP_M + 1e-9
        if second > 20:
            apart_m = math.dist(follower.point_m, leader.point_m)
            assert KEEP_M - 0.1 <= apart_m <= KEEP_M + 1.0
            assert intent.is_moving_goal


def test_who_is_too_fast_for_it_is_not_followed() -> None:
    """It would lose a runner at once; who walks briskly it can keep up with."""
    for speed_mps, is_followed in ((1.0, True), (6.0, False)):
        follower = Actor(9, Following(), (-4.0, 0.0))
        intent = led_by(follower, fellow_at((0.0, 0.0), velocity_mps=(speed_mps, 0.0)))
        assert intent.activity.startswith("following artefact ") == is_followed


def test_it_waits_behind_a_leader_that_stops() -> None:
    """Near enough it stands and looks at the leader."""
    follower = Actor(9, Following(), (-1.5, 0.0))
    led_by(follower, fellow_at((0.0, 0.0), velocity_mps=(0.5, 0.0)))
    leader = fellow_at((0.0, 0.0))
    intent = led_by(follower, leader, 1.0)
    assert (intent.goal_m, intent.face_m) == (None, leader.point_m)
    assert intent.activity == "waiting behind artefact 1"


def test_it_does_not_walk_round_a_leader_that_turns_on_the_spot() -> None:
    """What is behind the leader is on this side of it, wherever it looks."""
    follower = Actor(9, Following(), (-4.0, 0.0))
    led_by(follower, fellow_at((0.0, 0.0), velocity_mps=(0.5, 0.0)))
    for yaw_rad in (0.0, 2.0, -2.0):
        leader = fellow_at((0.2, 0.0))._replace(yaw_rad=yaw_rad)
        goal_m = led_by(follower, leader, 1.0).goal_m
        assert goal_m is not None
        assert math.dist(goal_m, leader.point_m) == pytest.approx(KEEP_M)
        assert goal_m[0] < -1.0


def test_it_makes_way_for_a_leader_that_comes_towards_it() -> None:
    """It does not wait in front of its leader, but goes behind it."""
    follower = Actor(9, Following(), (1.2, 0.0))
    intent = led_by(follower, fellow_at((0.0, 0.0), velocity_mps=(0.5, 0.0)))
    assert intent.goal_m == (-KEEP_M, 0.0)


def test_it_follows_the_trail_round_a_corner() -> None:
    """Behind a wall it goes where the leader went, step by step, through no wall."""
    walls = (((3.0, -2.0), (3.0, 4.0)),)
    way = [(1.0 * k, 0.0) for k in range(3)] + [(2.0, 1.0 * k) for k in range(1, 6)]
    way += [(2.0 + 1.0 * k, 5.0) for k in range(1, 4)] + [(5.0, 5.0 - k) for k in range(1, 9)]
    slow = MotionLimits(0.5, 1.5, 3.0)
    follower = Actor(9, Following(leader_id=1), (-4.0, 0.0), row_of(slow))
    hidden = 0
    for second, (here, there) in enumerate(pairwise(way)):
        velocity = (there[0] - here[0], there[1] - here[1])
        leader = fellow_at(here, velocity_mps=velocity)
        start_m = follower.point_m
        intent = alone(follower, neighbours=[leader], walls_m=walls, now_s=second)
        follower.move()
        is_hidden = crosses(start_m, leader.point_m, 3.0)
        if is_hidden:
            hidden += 1
            assert intent.activity.startswith("following artefact ")
            assert intent.goal_m is not None
            assert min(math.dist(intent.goal_m, point) for point in way) < 1e-9
        assert not crosses(start_m, follower.point_m, 3.0)
    assert hidden >= 3
    assert follower.point_m[0] > 3.0


def crosses(start: Point, end: Point, wall_x: float) -> bool:
    """Say whether a segment crosses the wall at x from -2 to 4."""
    if (start[0] - wall_x) * (end[0] - wall_x) >= 0:
        return False
    share = (wall_x - start[0]) / (end[0] - start[0])
    return -2.0 < start[1] + share * (end[1] - start[1]) < 4.0


def test_where_nothing_of_the_trail_is_seen_a_way_is_planned() -> None:
    """Carried off behind a wall, it asks for a way to the oldest point of the trail."""
    follower = Actor(9, Following(), (-2.0, 0.0))
    led_by(follower, fellow_at((0.0, 0.0), velocity_mps=(0.5, 0.0)))
    follower.point_m = (-20.0, 0.0)
    walls = (((-10.0, -50.0), (-10.0, 50.0)),)
    intent = alone(follower, neighbours=[fellow_at((0.5, 0.0))], walls_m=walls, now_s=1.0)
    assert (intent.goal_m, intent.is_moving_goal) == ((0.0, 0.0), False)


def test_it_does_not_stop_at_a_point_of_the_trail_that_it_has_come_to() -> None:
    """As near to it as one has arrived, it goes on to the next, which it does not see."""
    follower = Actor(9, Following(leader_id=1), (0.0, 0.0))
    corner, behind = (0.0, 0.35), (1.0, 0.7)
    for second, point in enumerate((corner, behind)):
        alone(follower, neighbours=[fellow_at(point, velocity_mps=(0.3, 0.3))], now_s=second)
    walls = (((0.5, -5.0), (0.5, 5.0)),)
    intent = alone(follower, neighbours=[fellow_at((1.1, 0.7))], walls_m=walls, now_s=2.0)
    assert (intent.goal_m, intent.is_moving_goal) == (behind, False)


def test_another_leader_is_found_when_the_leader_has_left() -> None:
    """Who is dead leads nobody; the next nearest who moves does."""
    first = fellow_at((3.0, 0.0), 1, (0.5, 0.0))
    second = fellow_at((0.0, 8.0), 2, (0.0, 0.5))
    follower = Actor(9, Following(), (0.0, 0.0))
    led = alone(follower, neighbours=[first, second])
    assert led.face_m == first.point_m
    led = alone(follower, neighbours=[second], now_s=1.0)
    assert led.face_m == second.point_m


def test_who_stands_for_long_is_left() -> None:
    """After 15 to 40 s behind somebody who stands it walks, and does not come back at once."""
    follower = Actor(9, Following(), (-1.5, 0.0))
    led_by(follower, fellow_at((0.0, 0.0), velocity_mps=(0.5, 0.0)))
    intents = [led_by(follower, fellow_at((0.0, 0.0)), second) for second in range(1, 60)]
    waited = [intent.activity for intent in intents].index("walking")
    assert 15 <= waited <= 41
    moving = fellow_at((0.0, 0.0), velocity_mps=(0.5, 0.0))
    assert led_by(follower, moving, 60.0 - 1.0 + 0.5).activity == "walking" or waited < 30


def test_a_leader_to_whom_there_is_no_way_is_left() -> None:
    """It walks instead of standing at a fence."""
    follower = Actor(9, Following(), (-3.0, 0.0))
    leader = fellow_at((0.0, 0.0), velocity_mps=(0.5, 0.0))
    led_by(follower, leader)
    follower.blocked_s = 9.0
    assert led_by(follower, leader, 10.0).activity == "walking"


def test_nobody_leads_who_is_unseen_far_or_standing() -> None:
    """Only who moves, near and in sight, is followed; until then it walks."""
    wall = (((2.0, -5.0), (2.0, 5.0)),)
    moving = (0.5, 0.0)
    cases = [
        (fellow_at((4.0, 0.0), velocity_mps=moving), wall),
        (fellow_at((13.0, 0.0), velocity_mps=moving), NO_WALLS),
        (fellow_at((4.0, 0.0)), NO_WALLS),
    ]
    for neighbour, walls in cases:
        intent = alone(Actor(9, Following(), (0.0, 0.0)), neighbours=[neighbour], walls_m=walls)
        assert intent.activity == "walking"


def test_two_followers_do_not_follow_each_other() -> None:
    """Only the younger follows the other, so that no circle of followers stands for ever."""
    older = fellow_at((4.0, 0.0), 3, (0.5, 0.0), "following")
    assert (
        alone(Actor(9, Following(), (0.0, 0.0)), neighbours=[older]).activity
        == "following artefact 3"
    )
    assert alone(Actor(2, Following(), (0.0, 0.0)), neighbours=[older]).activity == "walking"


class Tailing(Following):
    """A follower of a user's own."""

    name = "tailing"


def test_followers_of_a_users_own_class_do_not_follow_each_other_either() -> None:
    """Their behaviour is called by module and class, whatever their `name` is."""
    key = f"{Tailing.__module__}:{Tailing.__qualname__}"
    for kind, behaviour in ((Tailing, key), (Tailing, "following"), (Following, "following")):
        follower = Actor(1, kind(), (-4.0, 0.0))
        other = fellow_at((0.0, 0.0), velocity_mps=(0.5, 0.0))
        older = other._replace(id=9, behaviour=behaviour)
        assert not alone(follower, neighbours=[older]).activity.startswith("following artefact ")
        walker = other._replace(id=9, behaviour="walking")
        assert alone(follower, neighbours=[walker], now_s=1.0).activity == "following artefact 9"


def test_a_chain_of_followers_moves_with_a_walker() -> None:
    """On the stage three follow one who walks, and are near it most of the time."""
    actors = [Actor(0, Walking(), (0.0, 0.0))]
    actors += [Actor(k, Following(), (-2.0 * k, 0.5)) for k in (1, 2, 3)]
    stage = Stage(actors, lattice(7))
    near, total = 0, 0
    for second in range(200):
        stage.step()
        if second > 20:
            total += 1
            near += all(math.dist(a.point_m, actors[0].point_m) < 12.0 for a in actors[1:])
    assert near > 0.8 * total
