"""Tests of whom followers are taken to follow."""

from dataclasses import replace

from are_ros.replay._picture_company import companies
from are_ros.replay.life_record import Doing, Life
from tests.replay.film_records import TICK_NS, walker

END_NS = TICK_NS * 101


def _follower(number: int, x_m: float, **options: object) -> Life:
    return walker(number, (x_m, 2), (x_m + 6, 2), behaviour="following", **options)  # type: ignore[arg-type]


def test_the_nearest_all_along_leads() -> None:
    """Of two who walk, and one who stands nearer, the nearer walker is the leader."""
    lives = [
        walker(1, (3.2, 2), (9.2, 2)),
        walker(2, (5.0, 2), (11, 2)),
        walker(3, (4, 2.5), (4, 2.51)),
        _follower(4, 2.0),
    ]
    (found,) = companies(lives, END_NS)
    assert (found.follower.artefact_id, found.leader.artefact_id) == (4, 1)
    assert (found.start_ns, found.end_ns) == (TICK_NS, END_NS)


def test_nobody_near_is_nobody() -> None:
    """Who is metres away all the time, or hardly there, leads nobody."""
    far = walker(1, (2, 9), (8, 9))
    short = replace(walker(2, (3, 2), (9, 2)), departure_ns=TICK_NS * 20)
    assert companies([far, short, _follower(4, 2.0)], END_NS) == []


def test_of_two_followers_the_younger_follows() -> None:
    """Two who follow in a row: the second follows the first, never the other way round."""
    found = companies([_follower(1, 3.0), _follower(2, 2.0)], END_NS)
    assert [(one.follower.artefact_id, one.leader.artefact_id) for one in found] == [(2, 1)]


def test_only_while_it_follows() -> None:
    """What it does before and after it follows does not count."""
    doings = (
        Doing(TICK_NS, "following", "walking"),
        Doing(TICK_NS * 31, "following"),
        Doing(TICK_NS * 71, "following", "walking"),
        Doing(TICK_NS * 95, "following"),
    )
    lives = [walker(1, (3, 2), (9, 2)), replace(_follower(2, 2.0), doings=doings)]
    found = companies(lives, END_NS)
    assert [(one.start_ns, one.end_ns) for one in found] == [(TICK_NS * 31, TICK_NS * 71)]
    assert found[0].instants(2).tolist() == [TICK_NS * 41, TICK_NS * 61]
