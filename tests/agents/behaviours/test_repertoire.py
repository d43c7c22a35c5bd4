"""The behaviours among which an artefact chooses."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from are_ros.agents.behaviours.calls import NO_CALL, reward_bounds_of, reward_of
from are_ros.agents.behaviours.crossing import Crossing
from are_ros.agents.behaviours.following import Following
from are_ros.agents.behaviours.gathering import Gathering
from are_ros.agents.behaviours.leaving import WalkingOut
from are_ros.agents.behaviours.open_view import OpenView
from are_ros.agents.behaviours.repertoire import Repertoire
from are_ros.agents.behaviours.situation import Intent, Situation, Standing
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from tests.agents.behaviours.stage import Actor, alone, fellow_at, row_of

TRAVELS = {"walking": 0.6, "running": 0.2, "stopping": 0.1, "following": 0.1}


def repertoire(
    shares: Mapping[str, float], begins: str, *, may_change: bool = True, by_exit: bool = False
) -> Repertoire:
    """Return what an artefact of a row with these shares can do."""
    row = replace(row_of(), behaviours=shares)
    history = PoseHistory(0, GroundPose(0.0, 0.0, 0.0, 0.0))
    one = Artefact(3, row, Origin.RANDOM, 0, history, behaviour=begins, may_change=may_change)
    return Repertoire.of(one, NO_CALL, by_exit=by_exit)


def situation_of_one() -> Situation:
    """Return what somebody alone knows."""
    seen: list[Situation] = []

    class Spy(Standing):
        def decide(self, situation: Situation) -> Intent:
            seen.append(situation)
            return super().decide(situation)

    alone(Actor(0, Spy(), (0.0, 0.0)))
    return seen[0]


def test_all_behaviours_of_the_row_are_there_and_the_first_is_in_force() -> None:
    """With their shares, whatever their order in the row."""
    found = repertoire(TRAVELS, "stopping")
    assert found.behaviour.name == "stopping"
    assert dict(zip(found.names, found.shares, strict=True)) == pytest.approx(TRAVELS)


def test_those_without_a_share_are_left_out() -> None:
    """They could never be drawn."""
    assert repertoire({"walking": 1.0, "running": 0.0}, "walking").names == ("walking",)


def test_a_behaviour_that_was_given_stays() -> None:
    """A scenario or a service call has said it."""
    assert repertoire(TRAVELS, "running", may_change=False).names == ("running",)


def test_who_only_stops_walks_in_between() -> None:
    """Else it would stand for ever, which is standing."""
    found = repertoire({"stopping": 1.0}, "stopping")
    assert set(found.names) == {"stopping", "walking"}


def test_walking_out_is_there_only_for_those_who_leave_by_an_exit() -> None:
    """And takes nothing of their time by chance."""
    found = repertoire(TRAVELS, "walking", by_exit=True)
    assert isinstance(found.way_out, WalkingOut)
    assert found.shares[found.names.index("leaving")] == 0.0
    assert repertoire(TRAVELS, "walking").way_out is None


def test_those_who_travel_share_a_journey_and_its_table() -> None:
    """The advantage of each is that of its best action; the others get no further, but rest."""
    found = repertoire(TRAVELS, "walking")
    values = np.array([[-0.5, -0.2, 0.1, -0.4, -0.5], [-0.5, 0.4, -0.2, -0.4, -0.6]])
    told = dict(zip(found.names, found.advantages(values, 0.2), strict=True))
    expected = {"walking": -0.3, "running": 0.0, "stopping": -0.7, "following": -0.7}
    assert told == pytest.approx(expected)


def test_who_gives_way_has_no_reason_to_do_something_else() -> None:
    """Where the best is to stay, that is as good as what the others do; -inf is not done at all."""
    found, moves = repertoire(TRAVELS, "walking"), [-0.9, -np.inf, -0.8, -np.inf]
    values = np.array([[-0.5, *moves], [-0.5, *moves]])
    assert found.advantages(values, 0.2) == [0.0] * 4


def test_bounds_of_rewards_hold_whatever_is_around() -> None:
    """Of those that look around; the others are asked at once, as are classes of a user."""

    class Shy(Gathering):
        def reward(self, situation: Situation) -> float:
            return super().reward(situation) - 1.0

    class Own(Crossing):
        def reward_bounds(self, situation: Situation) -> tuple[float, float]:
            raise AssertionError(situation)

    by_itself, near = situation_of_one(), fellow_at((1.0, 0.0), velocity_mps=(0.5, 0.0))
    host = fellow_at((2.0, 0.0), behaviour="gathering", activity="waiting")
    seen = set()
    for around in ((), (near,), (host,), (near, host)):
        situation = by_itself._replace(view=OpenView(around))
        for kind in (Following, Gathering, Crossing, Shy, Own):
            least, greatest = reward_bounds_of(kind(), situation)
            reward = reward_of(kind(), situation)
            assert least <= reward <= greatest
            assert (least < greatest) == (kind in {Following, Gathering})
            seen.add((kind, reward))
    assert len(seen) == 8
