"""Tests of the places that one can get to."""

import math
from itertools import combinations

import numpy as np
import pytest

from are_ros.agents.mdp.coarse_map import CoarseMap
from are_ros.agents.navigation.destinations import (
    APART_M,
    FEWEST,
    Destinations,
    ReachableDestinations,
)
from tests.agents.floors import terrain_of, two_rooms

LEFT_M = ((1.0, 1.0), (1.0, 4.0), (2.0, 2.5), (1.0, 2.5))
RIGHT_M = ((5.0, 1.0), (5.0, 4.0))


def places_of(*points_m: tuple[float, float]) -> Destinations:
    """Return destinations, and one exit."""
    return Destinations(np.array(points_m, np.float64).reshape(-1, 2), np.array([[3.0, 3.0]]))


def rooms(door: slice | None = None) -> CoarseMap:
    """Return a floor of 6 x 5 m, with a wall across and perhaps a door."""
    return CoarseMap(terrain_of(two_rooms(100, 120, slice(60, 62), door)), 0.25)


def test_destinations_are_those_of_ones_own_room() -> None:
    """Where there are enough of them, no others are added; exits are all of them."""
    places = places_of(*LEFT_M, *RIGHT_M)
    found = ReachableDestinations(places).places_from(rooms(), (1.5, 1.5))
    assert [tuple(point) for point in found.destinations_m.tolist()] == list(LEFT_M)
    assert np.array_equal(found.exits_m, places.exits_m)


def test_a_door_joins_the_rooms() -> None:
    """Then all can be reached from anywhere, and one answer serves for both rooms."""
    reach = ReachableDestinations(places_of(*LEFT_M, *RIGHT_M))
    coarse = rooms(slice(40, 60))
    found = reach.places_from(coarse, (1.5, 1.5))
    assert len(found.destinations_m) == 6
    assert reach.places_from(coarse, (5.0, 3.0)) is found


@pytest.mark.parametrize("known_m", [(), RIGHT_M[:1], RIGHT_M])
def test_too_few_are_filled_up_with_others_in_the_same_room(
    known_m: tuple[tuple[float, float], ...],
) -> None:
    """Well apart, each where the disc fits, and after those that there were."""
    coarse = rooms()
    found = (
        ReachableDestinations(places_of(*LEFT_M, *known_m))
        .places_from(coarse, (5.0, 3.0))
        .destinations_m
    )
    assert len(found) == FEWEST
    assert [tuple(point) for point in found[: len(known_m)].tolist()] == list(known_m)
    for one, other in combinations(found.tolist(), 2):
        assert math.dist(one, other) >= APART_M
    for x_m, y_m in found.tolist():
        assert x_m > 3.0
        assert coarse.holds(x_m, y_m)


def test_a_place_beside_which_there_is_no_room_is_moved_to_where_the_disc_fits() -> None:
    """To the nearest cell's anchor; two that fall together are one."""
    coarse = rooms()
    places = places_of((0.05, 1.0), (0.1, 1.05), *LEFT_M[1:])
    found = ReachableDestinations(places).places_from(coarse, (1.5, 1.5)).destinations_m
    assert len(found) == FEWEST
    for x_m, y_m in found.tolist():
        assert coarse.holds(x_m, y_m)


def test_spare_room_is_asked_for_beside_the_disc() -> None:
    """A corridor where only the narrow disc fits is a way, not a place."""
    walls = two_rooms(100, 200, slice(60, 140), slice(44, 56))
    coarse = CoarseMap(terrain_of(walls), 0.25)
    found = (
        ReachableDestinations(places_of((5.0, 2.5)))
        .places_from(coarse, (1.0, 1.0), 0.1)
        .destinations_m
    )
    assert len(found) == FEWEST
    for x_m, y_m in found.tolist():
        assert x_m < 3.0 or x_m > 7.0
        assert coarse.holds(x_m, y_m, 0.35)


def test_who_is_shut_in_has_no_destinations() -> None:
    """In a closet there is nowhere to go; off the map all are known."""
    walls = np.ones((60, 60), np.bool_)
    walls[2:16, 2:16] = False
    walls[25:, 2:] = False
    places = places_of((1.5, 2.0))
    reach, coarse = ReachableDestinations(places), CoarseMap(terrain_of(walls), 0.2)
    shut_in = reach.places_from(coarse, (0.45, 0.45))
    assert len(shut_in.destinations_m) == 0
    assert shut_in.exits_m is places.exits_m
    assert reach.places_from(coarse, (-9.0, 0.0)) is places


@pytest.mark.parametrize("known_m", [(), ((1.55, 0.6),)])
def test_a_place_in_the_middle_of_a_small_part_gives_way_to_its_ends(
    known_m: tuple[tuple[float, float], ...],
) -> None:
    """A closet of 2.9 m has no place 1.6 m from its middle, but two that are so far apart."""
    walls = np.ones((60, 80), np.bool_)
    walls[2:22, 2:60] = False
    walls[30:58, 2:78] = False
    coarse = CoarseMap(terrain_of(walls), 0.2)
    places = places_of(*known_m, (2.0, 2.0))
    found = ReachableDestinations(places).places_from(coarse, (1.0, 0.6)).destinations_m
    assert len(found) >= 2
    for one, other in combinations(found.tolist(), 2):
        assert math.dist(one, other) >= APART_M
    for x_m, y_m in found.tolist():
        assert y_m < 1.2
        assert coarse.holds(x_m, y_m)
