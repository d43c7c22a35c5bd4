"""Artefacts on tracks: poses at sub-steps, jumps, and what the others plan by."""

import numpy as np
import pytest

from are_ros.agents.track_player import FollowedTrack
from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.scenario import Track

ROW = read_catalogue().rows[15]
PERIOD_NS = 50
START_NS = 10_000


def _track(*poses: tuple[int, float]) -> Track:
    """Return a track that moves along x only."""
    rows = [(x_m, 1.0, 0.0, 0.0) for _, x_m in poses]
    return Track(np.array([t_ns for t_ns, _ in poses]), np.array(rows))


def _following(
    track: Track, arrives_ns: int = START_NS, period_ns: int = PERIOD_NS
) -> FollowedTrack:
    found = FollowedTrack(track, START_NS, period_ns)
    found.begin(_artefact(track, arrives_ns))
    return found


def _artefact(track: Track, arrives_ns: int, artefact_id: int = 4) -> Artefact:
    history = PoseHistory(arrives_ns, track.pose_at(arrives_ns - START_NS))
    return Artefact(artefact_id, ROW, Origin.SCRIPTED, arrives_ns, history)


def _ways(track: FollowedTrack, first_ns: int, x_m: float, count: int) -> list[tuple[float, float]]:
    """Return the x of both ends of the legs of the next sub-steps of one that is at x."""
    found, period_ns = [], track.period_ns
    for step_ns in range(first_ns, first_ns + count * period_ns, period_ns):
        jumped = track.jump(step_ns)
        x_m = x_m if jumped is None else jumped.x_m
        end = track.advance(step_ns, GroundPose(x_m, 1.0, 0.0, 0.0))
        found.append((x_m, end.x_m))
        x_m = end.x_m
    return found


def test_poses_are_those_of_the_track_at_the_sub_steps() -> None:
    """It stands, moves between two poses however these lie between sub-steps, and stands again."""
    period_ns = 50_000_000
    track = _track((0, 0.0), (2 * period_ns, 0.0), (9 * period_ns // 2, 5.0))
    ways = _ways(_following(track, period_ns=period_ns), START_NS, 0.0, 6)
    assert ways == [(0.0, 0.0), (0.0, 0.0), (0.0, 2.0), (2.0, 4.0), (4.0, 5.0), (5.0, 5.0)]


def test_a_jump_with_a_sub_step_is_no_motion() -> None:
    """It goes on where it was bound for until then, and begins where it has jumped to."""
    period_ns = 50_000_000
    jump = (2 * period_ns - 1, 1.0), (2 * period_ns, 3.0)
    following = _following(_track((0, 0.0), *jump, (3 * period_ns, 4.0)), period_ns=period_ns)
    first, second, third = _ways(following, START_NS, 0.0, 3)
    assert first[1] == second[0] == pytest.approx(0.5)
    assert second[1] == 1.0
    assert third == (3.0, 4.0)


def test_a_jump_between_two_sub_steps_waits_for_the_later() -> None:
    """Until then it stands, wherever within the sub-step the jump is."""
    period_ns = 50_000_000
    for at_ns in (period_ns + 2, 3 * period_ns // 2, 2 * period_ns - 1):
        track = _track((0, 0.0), (at_ns - 1, 0.0), (at_ns, 3.0))
        following = _following(track, period_ns=period_ns)
        assert _ways(following, START_NS, 0.0, 3) == [(0.0, 0.0), (0.0, 0.0), (3.0, 3.0)]


def test_who_comes_late_is_where_the_track_is() -> None:
    """What the track had before its arrival does not count; the way to the next sub-step does."""
    track = _track((0, 0.0), (100, 4.0))
    artefact = _artefact(track, START_NS + 30)
    assert artefact.history.latest.x_m == pytest.approx(1.2)
    following = FollowedTrack(track, START_NS, PERIOD_NS)
    assert following.begin(artefact) == (START_NS + 50, GroundPose(2.0, 1.0, 0.0, 0.0))


def test_a_pause_shifts_all_that_is_to_come() -> None:
    """Poses wait for as long as time stood still."""
    player = _following(_track((0, 0.0), (100, 4.0)))
    player.postpone(1000)
    assert _ways(player, START_NS + 1000, 0.0, 1) == [(0.0, 2.0)]


def test_others_know_where_it_will_be() -> None:
    """The next sub-steps, held at the end; x, y and yaw."""
    player = _following(_track((0, 0.0), (100, 4.0)))
    ahead = player.ahead(START_NS, 4)
    np.testing.assert_allclose(ahead, [[x_m, 1.0, 0.0] for x_m in (2.0, 4.0, 4.0, 4.0)])
