"""Tests of who followed whom."""

from collections.abc import Sequence
from dataclasses import replace

from are_ros.draw.artefacts import following_stretches
from are_ros.draw.scene import Doing, Life, Track
from tests.draw.made_runs import TICK_NS, walker

END_NS = TICK_NS * 101


def _follower(number: int, leader: int) -> Life:
    activity = f"following artefact {leader}"
    return walker(number, (2, 2), (8, 2), behaviour="following", activity=activity)


def _does(life: Life, *activities: tuple[int, str]) -> Life:
    """Return a life that does other things, each from a tick on."""
    return replace(life, doings=tuple(Doing(TICK_NS * i, "following", a) for i, a in activities))


def _found(lives: Sequence[Life]) -> list[tuple[int, int, int, int]]:
    """Return the ids of followers and leaders, and the ticks of starts and ends."""
    return [
        (
            one.follower.artefact_id,
            one.leader.artefact_id,
            one.start_ns // TICK_NS,
            one.end_ns // TICK_NS,
        )
        for one in following_stretches(lives, END_NS)
    ]


def test_the_activity_names_the_leader() -> None:
    """The one that is named leads, however near another is."""
    lives = [walker(1, (3, 2), (9, 2)), walker(12, (2, 9), (8, 9)), _follower(4, 12)]
    assert _found(lives) == [(4, 12, 1, 101)]


def test_in_the_order_of_the_followers() -> None:
    """Followers may lead others, and come in the order of the lives."""
    lives = [_follower(3, 2), _follower(2, 1), walker(1, (3, 2), (9, 2))]
    assert _found(lives) == [(3, 2, 1, 101), (2, 1, 1, 101)]


def test_a_stretch_per_leader() -> None:
    """Who takes another leader at once ends a stretch, and begins one."""
    follower = _does(
        _follower(3, 1), (1, "following artefact 1"), (41, "following artefact 2"), (91, "walking")
    )
    lives = [walker(1, (3, 2), (9, 2)), walker(2, (3, 4), (9, 4)), follower]
    assert _found(lives) == [(3, 1, 1, 41), (3, 2, 41, 91)]


def test_waiting_behind_the_leader_belongs_to_the_stretch() -> None:
    """It still follows who stands for a while; waiting for somebody in its way is another thing."""
    doings = ["following artefact 1", "waiting behind artefact 1", "following artefact 1", ""]
    follower = _does(_follower(3, 1), *((1 + 20 * k, doing) for k, doing in enumerate(doings)))
    assert _found([walker(1, (3, 2), (9, 2)), follower]) == [(3, 1, 1, 61)]


def test_only_while_it_follows() -> None:
    """What it does before and after does not count, nor does a moment, nor a word without an id."""
    follows = "following artefact 1"
    follower = _does(
        _follower(2, 1), (1, ""), (31, follows), (71, "waiting for artefact 1"), (95, follows)
    )
    lives = [walker(1, (3, 2), (9, 2)), follower]
    assert _found(lives) == [(2, 1, 31, 71)]


def test_who_leaves_follows_until_then() -> None:
    """A stretch ends with the life of the follower."""
    lives = [walker(1, (3, 2), (9, 2)), replace(_follower(2, 1), departure_ns=TICK_NS * 60)]
    assert _found(lives) == [(2, 1, 1, 60)]


def test_a_leader_is_one_of_the_lives() -> None:
    """Who is not there, or has no pose, leads nobody; nor does a life without doings follow."""
    footprints = walker(1, (3, 2), (9, 2)).footprints
    nowhere = Track(footprints.stamps_ns[:0].copy(), footprints.poses[:0].copy())
    unseen = replace(walker(1, (3, 2), (9, 2)), footprints=nowhere)
    idle = replace(walker(5, (3, 2), (9, 2)), doings=())
    assert _found([unseen, _follower(2, 1), _follower(3, 77), idle]) == []
