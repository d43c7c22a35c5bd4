"""Gathering: one place without any agreement, a ring, and apart again."""

import math
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

import pytest

from are_ros.agents.behaviours.gathering import Gathering
from are_ros.agents.behaviours.situation import Neighbour
from tests.agents.behaviours.stage import Actor, Stage, alone, fellow_at, lattice, places_at

MIDDLE = (10.0, 0.0)
PLACES = places_at([MIDDLE, (-10.0, 0.0), (0.0, 10.0), (0.0, -10.0)])


def group_at(points_m: Sequence[tuple[float, float]], activity: str = "talking") -> list[Neighbour]:
    """Return some who stand gathered."""
    return [
        fellow_at(point, 10 + k, behaviour="gathering", activity=activity)
        for k, point in enumerate(points_m)
    ]


@pytest.mark.parametrize("activity", ["talking", "waiting"])
def test_who_sees_others_gathered_goes_there(activity: str) -> None:
    """The place is the destination nearest to those who stand there, whatever the seed."""
    for seed in range(8):
        actor = Actor(0, Gathering(), (0.0, 0.0), seed=seed)
        assert alone(actor, PLACES, group_at([(10.8, 0.3)], activity)).goal_m == MIDDLE


def test_who_walks_to_a_meeting_is_no_meeting() -> None:
    """Those on their way are not joined: they would be followed about."""
    walking = group_at([(10.8, 0.3)], "walking")
    goals = {
        alone(Actor(0, Gathering(), (0.0, 0.0), seed=seed), PLACES, walking).goal_m
        for seed in range(20)
    }
    assert len(goals) == 4


def test_it_changes_to_where_others_are() -> None:
    """Somebody gathered who comes into sight changes its mind, unless its own place has some."""
    actor = Actor(0, Gathering(), (0.0, 0.0))
    first = alone(actor, PLACES).goal_m
    assert first is not None
    assert alone(actor, PLACES, group_at([first]), now_s=1.0).goal_m == first
    other = next(tuple(p) for p in PLACES.destinations_m.tolist() if tuple(p) != first)
    assert alone(actor, PLACES, group_at([other]), now_s=2.0).goal_m == other


def test_a_full_ring_is_not_joined() -> None:
    """Seven are enough."""
    ring = [(10.0 + math.cos(k), math.sin(k)) for k in range(7)]
    goals = {
        alone(Actor(0, Gathering(), (0.0, 0.0), seed=seed), PLACES, group_at(ring)).goal_m
        for seed in range(20)
    }
    assert len(goals) > 1


def test_the_slot_is_free_near_and_seen() -> None:
    """Near the place it goes to a point of the ring where nobody stands."""
    taken = fellow_at((9.1, 0.0), 10, behaviour="gathering", activity="talking")
    actor = Actor(0, Gathering(), (8.0, 0.0))
    intent = alone(actor, PLACES, [taken])
    assert intent.goal_m is not None
    assert math.dist(intent.goal_m, MIDDLE) == pytest.approx(0.9)
    assert math.dist(intent.goal_m, taken.point_m) >= 0.75
    assert intent.is_moving_goal


def test_a_place_with_no_free_slot_in_sight_is_given_up() -> None:
    """Behind a wall round the place it looks for another."""
    wall = (((9.0, -5.0), (9.0, 5.0)),)
    actor = Actor(0, Gathering(), (8.0, 0.0))
    group = group_at([(10.8, 0.0)])
    assert alone(actor, PLACES, group, wall).activity == "looking round"
    assert alone(actor, PLACES, group, wall, now_s=1.0).goal_m not in {None, MIDDLE}


def round_wall(radius_m: float) -> tuple[tuple[tuple[float, float], tuple[float, float]], ...]:
    """Return a closed wall about the middle, as 48 segments."""
    steps = [(k + 0.5) * math.tau / 48 for k in range(49)]
    points = [(10.0 + radius_m * math.cos(a), radius_m * math.sin(a)) for a in steps]
    return tuple(pairwise(points))


def test_where_no_slot_is_ever_seen_it_stands_in_the_middle() -> None:
    """With nobody there it walks on to the place itself, instead of looking round for ever."""
    walls = round_wall(0.85) + round_wall(0.95)
    actor, places = Actor(0, Gathering(), (8.0, 0.0)), places_at([MIDDLE])
    intent = alone(actor, places, (), walls)
    for second in range(1, 20):
        actor.move()
        intent = alone(actor, places, (), walls, now_s=second)
        if intent.activity != "walking":
            break
    assert intent.activity == "waiting"
    assert math.dist(actor.point_m, MIDDLE) < 0.5


def test_several_gather_at_one_place_in_a_ring_and_part() -> None:
    """Five who have agreed on nothing meet, four or more together, face the middle, and part.

    Nobody stands at the others' feet, and nobody stands for a minute.
    """
    actors = [Actor(k, Gathering(), (3.0 * k - 6.0, 2.0 * (-1) ** k)) for k in range(5)]
    stage = Stage(actors, lattice(4, 6.0))
    most, standing_s, longest_s, parted = 0, [0] * 5, 0, 0
    for _ in range(400):
        intents = stage.step()
        talking = [a for a, i in zip(actors, intents, strict=True) if i.activity == "talking"]
        for k, intent in enumerate(intents):
            parted += intent.goal_m is not None and standing_s[k] > 15
            standing_s[k] = standing_s[k] + 1 if intent.goal_m is None else 0
        longest_s = max(longest_s, *standing_s)
        most = max(most, *Counter(a.last.face_m for a in talking if a.last).values(), 0)
        for actor in talking:
            assert actor.last is not None
            middle_m = actor.last.face_m
            assert middle_m is not None
            assert 0.4 <= math.dist(actor.point_m, middle_m) <= 1.5
            others = [a for a in talking if a is not actor]
            assert all(math.dist(actor.point_m, a.point_m) > 0.25 for a in others)
    assert most >= 4
    assert longest_s < 60
    assert parted >= 5


def test_who_waits_alone_goes_on_after_a_while() -> None:
    """With nobody there it waits for 8 to 20 s, then tries another place."""
    actor = Actor(0, Gathering(), (0.0, 0.0))
    stage = Stage([actor], PLACES)
    faced: list[object] = []
    waits: list[int] = []
    for _ in range(300):
        (intent,) = stage.step()
        if intent.goal_m is None:
            assert intent.activity == "waiting"
            if not faced or faced[-1] != intent.face_m:
                faced.append(intent.face_m)
                waits.append(0)
            waits[-1] += 1
    assert len(set(faced)) >= 3
    assert all(8 <= wait <= 21 for wait in waits[:-1])


def test_who_is_left_alone_parts() -> None:
    """When the others have gone it does not go on talking to nobody."""
    actor = Actor(0, Gathering(), (9.1, 0.0))
    group = group_at([(10.9, 0.0)])
    for second in range(4):
        alone(actor, PLACES, group, now_s=second)
        actor.move()
    assert actor.last is not None
    assert actor.last.activity == "talking"
    intent = alone(actor, PLACES, now_s=5.0)
    assert intent.activity == "walking"
    assert intent.goal_m != MIDDLE
