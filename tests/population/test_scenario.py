"""Scenarios as values: tracks in time, and what artefacts of one scenario must not share."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.errors import ScenarioError
from are_ros.population.artefact import GroundPose
from are_ros.population.scenario import Scenario, ScriptedArtefact, Track
from tests.agents.histories import GivenPoses

ROW = read_catalogue().rows[15]
POSE = GroundPose(1.0, 2.0, 0.0, 0.0)


def _one(artefact_id: int | None = None, name: str = "", follows: str = "") -> ScriptedArtefact:
    return ScriptedArtefact(ROW, POSE, 0, artefact_id=artefact_id, name=name, follows=follows)


def _track(times_ns: list[int]) -> Track:
    poses = np.random.default_rng(len(times_ns)).normal(scale=3.0, size=(len(times_ns), 4))
    return Track(np.array(times_ns, np.int64), poses)


@given(
    st.lists(st.integers(0, 2 * 10**9), min_size=1, max_size=8, unique=True),
    st.integers(-(10**8), 3 * 10**9),
)
def test_a_track_is_a_history_of_poses(times_ns: list[int], t_ns: int) -> None:
    """Its pose at any instant is that of a history with the same poses, to the last bit."""
    track = _track(sorted(times_ns))
    history = GivenPoses(int(track.times_ns[0]), track.pose(0))
    for k in range(1, len(track)):
        history.append(int(track.times_ns[k]), track.pose(k))
    assert track.pose_at(t_ns) == history.pose_at(t_ns)
    x_m, y_m, yaw_rad = track.poses_at(np.array([t_ns]))[0].tolist()
    expected = history.pose_at(t_ns)
    assert (x_m, y_m) == pytest.approx((expected.x_m, expected.y_m))
    assert math.remainder(yaw_rad - expected.yaw_rad, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_two_poses_within_a_microsecond_are_a_jump() -> None:
    """It counts for the interval in which the second pose lies, open before and closed after."""
    track = _track([0, 100_000, 199_999, 200_000, 300_000])
    assert track.jump_within(150_000, 200_000) == 3
    assert track.jump_within(200_000, 300_000) is None
    assert track.jump_within(0, 199_000) is None


@pytest.mark.parametrize(
    ("times_ns", "poses", "reason"),
    [
        ([], np.empty((0, 4)), "it has no pose"),
        ([0, 5, 5], np.zeros((3, 4)), "pose 2 is not later than the one before it"),
        ([0], np.array([[0.0, math.nan, 0.0, 0.0]]), "a number in it is not finite"),
    ],
)
def test_what_is_no_track_is_refused(times_ns: list[int], poses: object, reason: str) -> None:
    """Poses there must be, finite and in the order of time."""
    with pytest.raises(ScenarioError, match=reason):
        Track(np.array(times_ns, np.int64), np.array(poses))


@pytest.mark.parametrize(
    ("artefacts", "reason"),
    [
        ((_one(0),), r"artefact 0 \(person_adult\): id is 0, but ids are from 1 to"),
        ((_one(10**12),), "but ids are from 1 to 999999999999"),
        ((_one(10**9), _one(10**9)), "id is 1000000000, which another artefact has too"),
        ((_one(7),), "id is 7, but ids below 1000000000 are those of random arrivals"),
        ((_one(name="a"), _one(name="a")), r"artefact 0 \(a\): name is 'a', which another"),
        ((_one(name="a", follows="b"),), "follows 'b', but no artefact has this name"),
        ((_one(name="a", follows="a"),), "follows 'a', which follows it in turn: that is a circle"),
        ((_one(name="a", follows="b"), _one(name="b", follows="a")), "that is a circle"),
    ],
)
def test_what_artefacts_must_not_share_is_refused(
    artefacts: tuple[ScriptedArtefact, ...], reason: str
) -> None:
    """Ids and names are unique, low ids those of random arrivals, and nobody follows in vain."""
    with pytest.raises(ScenarioError, match=reason):
        Scenario(artefacts)


def test_low_ids_are_good_where_nobody_comes_at_random() -> None:
    """A saved run keeps the ids that it had; who follows somebody in a circle is in none."""
    a, b = _one(name="a", follows="b"), _one(name="b")
    chain = Scenario((_one(7), a, b, _one(name="c", follows="a")), random=False)
    assert chain.place(0) == "artefact 0 (person_adult)"
    assert chain.place(3) == "artefact 3 (c)"
