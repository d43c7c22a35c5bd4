"""Artefacts on tracks: poses at sub-steps, jumps, doings, and what the others plan by."""

import numpy as np
import pytest

from are_ros.artefacts.artefact import Artefact, Origin, PoseHistory
from are_ros.artefacts.catalogue_file import read_catalogue
from are_ros.artefacts.scenario import Doing, Track
from are_ros.artefacts.track_player import TrackPlayer

ROW = read_catalogue().rows[15]
PERIOD_NS = 50
START_NS = 10_000


def _track(*poses: tuple[int, float], doings: tuple[Doing, ...] = ()) -> Track:
    """Return a track that moves along x only."""
    rows = [(x_m, 1.0, 0.0, 0.0) for _, x_m in poses]
    return Track(np.array([t_ns for t_ns, _ in poses]), np.array(rows), doings)


def _player(track: Track, arrives_ns: int = START_NS, artefact_id: int = 4) -> TrackPlayer:
    player = TrackPlayer(PERIOD_NS)
    player.add(_artefact(track, arrives_ns, artefact_id), track, START_NS)
    return player


def _artefact(track: Track, arrives_ns: int, artefact_id: int = 4) -> Artefact:
    history = PoseHistory(arrives_ns, track.pose_at(arrives_ns - START_NS))
    return Artefact(artefact_id, ROW, Origin.SCRIPTED, arrives_ns, history)


def _history(player: TrackPlayer) -> PoseHistory:
    return player._parts[4].artefact.history


def test_poses_are_those_of_the_track_at_the_sub_steps() -> None:
    """It stands, moves between two poses however these lie between sub-steps, and stands again."""
    period_ns = 50_000_000
    track = _track((0, 0.0), (2 * period_ns, 0.0), (9 * period_ns // 2, 5.0))
    player, artefact = TrackPlayer(period_ns), _artefact(track, START_NS)
    player.add(artefact, track, START_NS)
    found = []
    for k in range(1, 7):
        poses, moved = player.move(START_NS + k * period_ns)
        found.append((float(poses[0, 0]), bool(moved[0])))
    assert [x_m for x_m, _ in found] == [0.0, 0.0, 2.0, 4.0, 5.0, 5.0]
    assert [is_moving for _, is_moving in found] == [False, False, True, True, True, False]
    assert artefact.history.pose_at(START_NS + 2 * period_ns).x_m == 0.0
    assert artefact.history.pose_at(START_NS + 5 * period_ns // 2).x_m == pytest.approx(1.0)
    assert artefact.history.velocity_at(START_NS + 3 * period_ns)[0] == pytest.approx(40.0)
    assert artefact.history.velocity_at(START_NS + 6 * period_ns) == (0.0, 0.0, 0.0)


def test_a_jump_is_no_motion() -> None:
    """It stays until a nanosecond before, and has jumped, not moved."""
    period_ns = 50_000_000
    track = _track((0, 0.0), (2 * period_ns - 1, 0.0), (2 * period_ns, 3.0))
    player = TrackPlayer(period_ns)
    artefact = _artefact(track, START_NS)
    player.add(artefact, track, START_NS)
    player.move(START_NS + period_ns)
    poses, moved = player.move(START_NS + 2 * period_ns)
    assert poses.tolist() == [[3.0, 1.0, 0.0, 0.0]]
    assert not moved[0]
    assert artefact.history.pose_at(START_NS + 2 * period_ns - 1).x_m == 0.0
    assert artefact.history.velocity_at(START_NS + 2 * period_ns) == (0.0, 0.0, 0.0)


def test_who_comes_late_is_where_the_track_is() -> None:
    """What the track had before its arrival does not count."""
    player = _player(_track((0, 0.0), (100, 4.0)), START_NS + 30)
    assert _history(player).latest.x_m == pytest.approx(1.2)
    poses, moved = player.move(START_NS + 50)
    assert poses[0, 0] == 2.0
    assert moved[0]
    assert _history(player).pose_at(START_NS + 40).x_m == pytest.approx(1.6)


def test_doings_are_told_at_their_times() -> None:
    """Behaviour, activity and what is known of the end; the one of the arrival at once."""
    doings = (Doing(0, "walking", "pausing", 900), Doing(70, "leaving", "", None))
    track = _track((0, 0.0), doings=doings)
    player, artefact = TrackPlayer(PERIOD_NS), _artefact(track, START_NS)
    player.add(artefact, track, START_NS)
    said = (artefact.behaviour, artefact.activity, artefact.departure_ns)
    assert said == ("walking", "pausing", START_NS + 900)
    assert player.next_ns() == START_NS + 70
    player.tell(START_NS + 69)
    assert artefact.behaviour == "walking"
    player.tell(START_NS + 70)
    assert (artefact.behaviour, artefact.activity, artefact.departure_ns) == ("leaving", "", None)
    assert player.next_ns() is None


def test_a_pause_shifts_all_that_is_to_come() -> None:
    """Poses and doings wait for as long as time stood still."""
    player = _player(_track((0, 0.0), (100, 4.0), doings=(Doing(60, "walking"),)))
    player.postpone(1000)
    assert player.next_ns() == START_NS + 1060
    poses, _ = player.move(START_NS + 1050)
    assert poses[0, 0] == 2.0


def test_others_know_where_it_will_be() -> None:
    """The next sub-steps, held at the end; x, y and yaw."""
    player = _player(_track((0, 0.0), (100, 4.0)))
    ahead = player.ahead(4, START_NS, 4)
    np.testing.assert_allclose(ahead, [[x_m, 1.0, 0.0] for x_m in (2.0, 4.0, 4.0, 4.0)])


def test_who_has_a_pose_at_its_end_lives_through_the_sub_step() -> None:
    """It moves there and is met there before it goes; else its life is over at the instant."""
    player = _player(_track((0, 0.0), (50, 4.0), (75, 5.0)))
    assert player.ends_with_step(4, START_NS + 50)
    assert not player.ends_with_step(4, START_NS + 75)  # no sub-step ends then
    assert not player.ends_with_step(4, START_NS + 100)
    assert not player.ends_with_step(5, START_NS + 50)
    assert not player.leaving
    player._parts[4].artefact.is_leaving = True
    assert list(player.leaving) == [4]
    player.remove(4)
    player.remove(4)
    assert 4 not in player


def test_all_are_in_the_order_of_their_ids() -> None:
    """However they come; nobody is left after a new beginning."""
    player = _player(_track((0, 0.0)), artefact_id=9)
    track = _track((0, 7.0))
    player.add(_artefact(track, START_NS, 2), track, START_NS)
    assert player.ids == (2, 9)
    poses, moved = player.move(START_NS + 50)
    assert poses[:, 0].tolist() == [7.0, 0.0]
    assert not moved.any()
    player.clear()
    assert player.move(START_NS + 100)[0].shape == (0, 4)
