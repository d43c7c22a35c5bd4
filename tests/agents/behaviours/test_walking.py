"""Going from destination to destination: where, how fast, with which pauses, and what if not."""

import math

import pytest

from are_ros.agents.behaviours.situation import Behaviour, Point, Standing
from are_ros.agents.behaviours.walking import Driving, Running, Stopping, Walking, Wandering
from are_ros.population.catalogue import MotionLimits
from tests.agents.behaviours.stage import Actor, Stage, alone, lattice, places_at, row_of


def standing_spells(stage: Stage, seconds: int) -> list[int]:
    """Return how long, in decisions, the first actor stood each time."""
    wanted = [stage.step()[0].goal_m for _ in range(seconds)]
    spells, length = [], 0
    for goal_m in [*wanted, (0.0, 0.0)]:
        if goal_m is None:
            length += 1
        elif length:
            spells.append(length)
            length = 0
    return spells


def test_standing_stands() -> None:
    """It wants to be nowhere, and draws no random number."""
    actor = Actor(0, Standing(), (0.0, 0.0))
    before = actor.random.bit_generator.state
    assert alone(actor).goal_m is None
    assert actor.random.bit_generator.state == before


def test_a_walker_visits_many_destinations() -> None:
    """In ten minutes it reaches at least a dozen different ones."""
    actor = Actor(0, Walking(), (0.0, 0.0))
    stage = Stage([actor])
    reached = set()
    for _ in range(600):
        (intent,) = stage.step()
        if actor.arrived:
            reached.add(intent.goal_m)
    assert len(reached) >= 12


@pytest.mark.parametrize("kind", [Walking, Wandering, Driving])
def test_pauses_last_1_to_10_seconds(kind: type[Behaviour]) -> None:
    """Nobody who walks stands longer than ten seconds; all but runners do pause."""
    spells = standing_spells(Stage([Actor(0, kind(), (0.0, 0.0))]), 3000)
    assert len(spells) > 10
    assert 1 <= min(spells) <= max(spells) <= 10


def test_a_runner_never_pauses() -> None:
    """Running is without stops, and faster than the row's speed."""
    actor = Actor(0, Running(), (0.0, 0.0))
    assert standing_spells(Stage([actor]), 300) == []
    assert actor.last is not None
    assert 1.6 * 1.2 <= actor.last.speed_mps <= 2.0 * 1.2


def test_who_stops_goes_on_to_where_it_was_going() -> None:
    """A stop on the way is no change of mind, nor is a run."""
    walking = Walking()
    actor = Actor(0, walking, (0.0, 0.0))
    stage, goals = Stage([actor], lattice(3, 30.0)), list[Point | None]()
    kinds = (walking, Stopping(journey=walking.journey), Running(journey=walking.journey))
    for second in range(12):
        actor.behaviour = kinds[second // 2 % 3]
        goals.append(stage.step()[0].goal_m)
    assert goals.count(None) == 4
    assert len({goal for goal in goals if goal}) == 1


def test_a_wanderer_strolls_to_what_is_near() -> None:
    """Its goals are among the nearest, its speed is less than a walk."""
    actor = Actor(0, Wandering(), (0.0, 0.0))
    stage = Stage([actor], lattice(11))
    for _ in range(300):
        start_m = actor.point_m
        (intent,) = stage.step()
        if intent.goal_m is not None:
            assert math.dist(start_m, intent.goal_m) < 11.0
            assert intent.speed_mps <= 0.7 * 1.2


@pytest.mark.parametrize("kind", [Walking, Running, Driving, Wandering])
def test_without_a_way_another_destination_is_chosen_at_once(kind: type[Behaviour]) -> None:
    """The one that cannot be reached is none of the next."""
    actor = Actor(0, kind(), (0.0, 0.0))
    first = alone(actor).goal_m
    for second in range(3):
        actor.no_way = True
        assert alone(actor, now_s=1.0 + second).goal_m not in {first, None}


def test_who_is_blocked_for_long_goes_elsewhere() -> None:
    """After 5 to 12 s of being kept from going on, but not before."""
    actor = Actor(0, Walking(), (0.0, 0.0))
    first = alone(actor).goal_m
    changed_s = None
    for second in range(1, 20):
        actor.blocked_s = float(second)
        if alone(actor, now_s=second).goal_m != first:
            changed_s = second
            break
    assert changed_s is not None
    assert 5 < changed_s <= 13


def test_who_gave_up_the_only_destination_tries_it_again() -> None:
    """It is too near to the other one for a trip, and would stand for the rest of its life."""
    actor, places = Actor(0, Walking(), (0.0, 0.0)), places_at([(0.8, 0.0), (2.4, 0.0)])
    for second in range(40):
        actor.blocked_s = float(second)
        assert alone(actor, places, now_s=second).goal_m == (2.4, 0.0)


def test_what_blocked_an_earlier_trip_is_not_held_against_the_next() -> None:
    """Time blocked counts from the trip's own beginning."""
    actor = Actor(0, Walking(), (0.0, 0.0))
    actor.blocked_s = 100.0
    first = alone(actor).goal_m
    assert [alone(actor, now_s=second).goal_m for second in range(1, 5)] == [first] * 4


def test_a_pace_is_for_life() -> None:
    """Each walks at 80 to 100 % of the row's speed, always the same, not all alike."""
    speeds: list[float] = []
    for artefact_id in range(5):
        actor = Actor(artefact_id, Walking(), (0.0, 0.0))
        stage = Stage([actor])
        of_one = {i.speed_mps for _ in range(200) if (i := stage.step()[0]).goal_m}
        assert len(of_one) == 1
        speeds += of_one
    assert len(set(speeds)) == 5
    assert 0.8 * 1.2 <= min(speeds) <= max(speeds) <= 1.2


def test_a_car_has_arrived_within_half_its_turning_radius() -> None:
    """A vehicle that cannot turn on the spot does not circle about a point."""
    actor = Actor(0, Driving(), (0.0, 0.0), row_of(MotionLimits(3.0, 1.5, 0.6, 5.0, 1.0)))
    assert alone(actor).arrive_within_m == 2.5


def test_with_nowhere_to_go_a_walker_stands_and_says_so() -> None:
    """A map without destinations, or with one where it is already, is a cause with a name."""
    for places in (places_at([]), places_at([(0.1, 0.0)])):
        intent = alone(Actor(0, Walking(), (0.0, 0.0)), places)
        assert (intent.goal_m, intent.activity) == (None, "nowhere to go")


def test_a_car_in_a_pocket_has_no_trips_that_are_over_at_once() -> None:
    """Destinations that it is not out of reach of are none: it would stand, and say it drives."""
    car = row_of(MotionLimits(3.0, 1.5, 0.6, 5.0, 1.0))
    actor = Actor(0, Driving(), (0.0, 0.0), car)
    intents = [alone(actor, places_at([(1.9, 0.0), (0.0, -2.2)]), now_s=s) for s in range(20)]
    assert {intent.activity for intent in intents} == {"nowhere to go"}
    assert alone(actor, places_at([(1.9, 0.0), (0.0, -2.95)])).goal_m == (0.0, -2.95)


def test_in_a_tiny_map_a_walker_goes_to_and_fro() -> None:
    """Destinations nearer than 3 m are taken where there are no others."""
    stage = Stage([Actor(0, Walking(), (0.0, 0.0))], places_at([(0.0, 0.0), (1.5, 0.0)]))
    goals = {stage.step()[0].goal_m for _ in range(100)}
    assert goals - {None} == {(0.0, 0.0), (1.5, 0.0)}


def test_far_destinations_are_taken_only_where_there_are_no_nearer_ones() -> None:
    """Trips are of at most 40 m, so that they can be planned on part of a large map."""
    actor = Actor(0, Walking(), (0.0, 0.0))
    assert alone(actor, places_at([(90.0, 0.0), (0.0, 39.0), (60.0, 0.0)])).goal_m == (0.0, 39.0)
    actor = Actor(0, Walking(), (0.0, 0.0))
    assert alone(actor, places_at([(90.0, 0.0), (60.0, 0.0)])).goal_m == (60.0, 0.0)


def test_a_new_map_with_fewer_places_is_survived() -> None:
    """Destinations given up in an old map are nothing in the new one."""
    actor = Actor(0, Walking(), (0.0, 0.0))
    for second in range(6):
        alone(actor, lattice(9), now_s=second)
        actor.no_way = True
    assert alone(actor, places_at([(4.0, 0.0)]), now_s=7.0).goal_m == (4.0, 0.0)
