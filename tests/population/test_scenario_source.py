"""The source of scripted artefacts: exact times, ids that are never given twice."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.agents.behaviours.registry import make_behaviour
from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.errors import ParameterError
from are_ros.population.artefact import GroundPose, Origin
from are_ros.population.departures import Cause
from are_ros.population.scenario import (
    FIRST_ADMITTED_ID,
    Scenario,
    ScriptedArtefact,
    ScriptedOffer,
    ScriptedSource,
    Track,
)

ROW = read_catalogue().rows[15]
POSE = GroundPose(1.0, 2.0, 0.0, 0.5)
START_NS = 1_700_000_000_000_000_007


def _at(arrives_ns: int, **values: object) -> ScriptedArtefact:
    return ScriptedArtefact(ROW, POSE, arrives_ns, **values)  # type: ignore[arg-type]


def _source(*artefacts: ScriptedArtefact, random: bool = True) -> ScriptedSource:
    source = ScriptedSource(Scenario(artefacts, random))
    source.restart(START_NS)
    source.open(START_NS)
    return source


def _all(source: ScriptedSource) -> list[ScriptedOffer]:
    offers = []
    while source.next_ns() is not None:
        due_ns = source.next_ns()
        offers.append(source.take())
        assert offers[-1].time_ns == due_ns
    return offers


@given(st.lists(st.integers(0, 10**15), max_size=12))
def test_offers_come_at_their_exact_times_in_order(arrivals_ns: list[int]) -> None:
    """To the nanosecond; of two at one instant the first of the file is first."""
    offers = _all(_source(*(_at(t_ns, name=str(k)) for k, t_ns in enumerate(arrivals_ns))))
    expected = sorted(enumerate(arrivals_ns), key=lambda item: item[1])
    found = [(offer.time_ns - START_NS, offer.place) for offer in offers]
    assert found == [(t_ns, f"artefact {k} ({k})") for k, t_ns in expected]
    assert [offer.artefact_id for offer in offers] == [FIRST_ADMITTED_ID + k for k, _ in expected]


def test_nobody_comes_before_there_is_a_map() -> None:
    """Who was due before comes with it; who is due later at its own time."""
    source = ScriptedSource(Scenario((_at(0), _at(90))))
    assert source.next_ns() is None
    source.restart(START_NS)
    assert source.next_ns() is None
    source.open(START_NS + 50)
    source.open(START_NS + 70)
    assert [offer.time_ns for offer in _all(source)] == [START_NS + 50, START_NS + 90]
    with pytest.raises(ParameterError, match="no artefact of the scenario is due"):
        source.take()


def test_ids_come_back_exactly_and_are_given_once() -> None:
    """Those of the scenario are as they are there; all others are the first that are free."""
    artefacts = (_at(0, artefact_id=7), _at(1), _at(2, artefact_id=FIRST_ADMITTED_ID + 2))
    source = _source(*artefacts, random=False)
    low = FIRST_ADMITTED_ID
    assert source.new_id() == low + 1
    assert [offer.artefact_id for offer in _all(source)] == [7, low, low + 2]
    assert source.new_id() == low + 3


def test_a_scenario_that_runs_again_brings_others() -> None:
    """After a restart who was offered comes again under another id; who was not, under its own."""
    source = _source(_at(0, artefact_id=3), _at(10, artefact_id=4), random=False)
    assert source.take().artefact_id == 3
    source.restart(START_NS - 1000)
    assert [(o.time_ns, o.artefact_id) for o in _all(source)] == [
        (START_NS - 1000, FIRST_ADMITTED_ID),
        (START_NS - 990, 4),
    ]


def test_a_pause_lets_those_to_come_wait() -> None:
    """Time that stood still does not count."""
    source = _source(_at(0), _at(10))
    source.take()
    source.postpone(1000)
    offer = source.take()
    assert (offer.time_ns, offer.start_ns) == (START_NS + 1010, START_NS + 1000)


def test_an_offer_carries_what_the_artefact_is_to_be() -> None:
    """Row, pose, life, behaviour, origin and cause as the scenario has them."""
    given_one = _at(0, stays_ns=5, behaviour="running", origin=Origin.RANDOM, cause=Cause.DISPLACED)
    offer = _source(given_one).take()
    assert (offer.artefact, offer.pose, offer.options) == (given_one, POSE, {})


def test_a_way_becomes_the_options_of_along_way() -> None:
    """The behaviour takes them."""
    way = ((1.0, 2.0), (3.0, 4.0))
    offer = _source(_at(0, behaviour="along_way", way_m=way, loop=True)).take()
    assert offer.options == {"waypoints_m": way, "repeat": True}
    assert make_behaviour(offer.artefact.behaviour, offer.options).name == "along_way"


def test_who_follows_is_told_the_id_of_its_leader() -> None:
    """Also when the scenario runs again, and the leader is another."""
    source = _source(_at(0, behaviour="following", follows="b"), _at(1, name="b"))
    assert [offer.options for offer in _all(source)] == [{"leader_id": FIRST_ADMITTED_ID + 1}, {}]
    source.restart(START_NS)
    leader, follower = FIRST_ADMITTED_ID + 3, source.take()
    assert follower.options == {"leader_id": leader}
    assert source.take().artefact_id == leader


def test_who_has_a_track_arrives_where_the_track_is_then() -> None:
    """Height and all, also when the map comes late."""
    poses = np.array([[0.0, 0.0, 0.1, 0.0], [1.0, 2.0, 0.3, 0.0]])
    track = Track(np.array([0, 100]), poses)
    source = ScriptedSource(Scenario((_at(0, track=track),)))
    source.restart(START_NS)
    source.open(START_NS + 50)
    offer = source.take()
    assert offer.pose == track.pose_at(50)
    assert offer.pose.z_m == pytest.approx(0.2)
    assert offer.artefact.track is track
