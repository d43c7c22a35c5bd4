"""The resolver: remedies in their order, and the invariant that nobody ever overlaps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from are_ros.agents.collisions import (
    CollisionResolver,
    ContactPolicy,
    Displace,
    Hold,
    Outcome,
    Remove,
    Resolution,
)
from are_ros.conventions import OCCUPIED
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.footprint import Footprint, penetration_m
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform
from tests.world.overlapping import overlapping_pairs


def _environment(*walls: tuple[int, int, int, int]) -> Environment:
    """Return 10 m x 10 m of cells of 0.1 m, with walls (row, col, end row, end col)."""
    cells = np.zeros((100, 100), dtype=np.int8)
    for row, col, end_row, end_col in walls:
        cells[row:end_row, col:end_col] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1, RigidTransform.identity(), "map")
    return Environment(grid, classify(grid, 65, 25), None, PlaneGround(0.0), 0.06)


_OPEN = _environment()


def _boxes(*points: tuple[float, float], half_m: float = 0.25) -> OrientedBoxes:
    """Return upright boxes of 2 m on the ground, 0.5 m square, at points."""
    centres_m = np.column_stack((np.array(points).reshape(-1, 2), np.ones(len(points))))
    halves_m = np.tile([half_m, half_m, 1.0], (len(points), 1))
    return OrientedBoxes(centres_m, np.zeros(len(points)), halves_m)


def _resolve(
    proposed: OrientedBoxes,
    last_safe: OrientedBoxes,
    environment: Environment = _OPEN,
    robot: Footprint | None = None,
    policy: ContactPolicy | None = None,
) -> Resolution:
    resolver = CollisionResolver(policy or Displace(), 2.0)
    return resolver.resolve(np.arange(len(proposed)), proposed, last_safe, environment, robot)


def _outcomes(resolution: Resolution) -> list[Outcome]:
    return [Outcome(value) for value in resolution.outcomes]


def test_safe_poses_are_kept() -> None:
    """Two that pass each other get what they proposed."""
    resolution = _resolve(_boxes((1.1, 1.0), (3.0, 1.0)), _boxes((1.0, 1.0), (3.1, 1.0)))
    assert resolution.is_all_kept
    assert resolution.boxes.centres_m[:, 0].tolist() == [1.1, 3.0]


def test_who_walks_into_a_wall_moves_back() -> None:
    """The first remedy: the last safe pose."""
    wall = _environment((0, 20, 100, 21))
    resolution = _resolve(_boxes((1.8, 1.0)), _boxes((1.7, 1.0)), wall)
    assert _outcomes(resolution) == [Outcome.MOVED_BACK]
    assert resolution.boxes.centres_m[0].tolist() == [1.7, 1.0, 1.0]


def test_the_lower_id_goes_first() -> None:
    """Both want the gap: the first gets it, the second stays where it was."""
    resolution = _resolve(_boxes((2.0, 1.0), (2.2, 1.0)), _boxes((1.6, 1.0), (2.6, 1.0)))
    assert _outcomes(resolution) == [Outcome.KEPT, Outcome.MOVED_BACK]


def test_poses_that_are_safe_together_are_taken_as_they_are() -> None:
    """Those behind one another move on, whoever has the lower id."""
    for order in (1, -1):
        ahead, behind = [((3.0, 1.0), (2.5, 1.0)), ((2.4, 1.0), (1.9, 1.0))][::order]
        queue = _resolve(_boxes(ahead[0], behind[0]), _boxes(ahead[1], behind[1]))
        assert _outcomes(queue) == [Outcome.KEPT, Outcome.KEPT]


def test_once_somebody_is_in_the_way_a_place_is_free_only_when_its_holder_has_left_it() -> None:
    """The first is refused where the second still stands; the third, into the first, goes back."""
    proposed = _boxes((2.0, 1.0), (1.0, 1.0), (2.1, 1.0))
    outcomes = _outcomes(_resolve(proposed, _boxes((1.0, 1.0), (2.0, 1.0), (5.0, 1.0))))
    assert outcomes == [Outcome.MOVED_BACK, Outcome.MOVED_BACK, Outcome.MOVED_BACK]


def test_a_new_wall_displaces_to_the_nearest_place() -> None:
    """The second remedy: 0.3 m to the left, heading kept, reported as a shift."""
    wall = _environment((0, 49, 100, 55))
    standing = _boxes((5.0, 5.0), (8.0, 8.0))
    resolution = _resolve(standing, standing, wall)
    assert _outcomes(resolution) == [Outcome.DISPLACED_TO_SAFE, Outcome.KEPT]
    assert resolution.shifts_m[0, 0] < 0.0
    assert np.hypot(*resolution.shifts_m[0]) == pytest.approx(0.4)
    assert resolution.boxes.centres_m[0, :2] == pytest.approx(resolution.shifts_m[0] + 5.0)


def test_without_a_place_it_leaves() -> None:
    """A map that covers everything around lets it go."""
    standing = _boxes((5.0, 5.0))
    resolution = _resolve(standing, standing, _environment((0, 0, 100, 100)))
    assert _outcomes(resolution) == [Outcome.LEAVES]


def test_the_displaced_are_heeded_by_all_after_them() -> None:
    """Two covered by one wall go to different places, also far from where they were."""
    standing = _boxes((5.0, 5.0), (5.0, 5.6), (4.2, 5.0))
    resolution = _resolve(standing, standing, _environment((0, 47, 100, 56)))
    assert _outcomes(resolution)[:2] == [Outcome.DISPLACED_TO_SAFE] * 2
    assert not len(overlapping_pairs(resolution.boxes))


def test_an_artefact_never_moves_into_a_robot() -> None:
    """Its proposal is refused under every policy; that is no contact."""
    robot = Footprint.disc(0.3).at(2.0, 1.0, 0.0)
    for policy in (Hold(), Displace(), Remove()):
        moved = _resolve(_boxes((1.6, 1.0)), _boxes((1.4, 1.0)), _OPEN, robot, policy)
        assert _outcomes(moved) == [Outcome.MOVED_BACK]
        assert moved.contacts == ()


@pytest.mark.parametrize(
    ("policy", "outcome"),
    [
        (Hold(), Outcome.KEPT),
        (Displace(), Outcome.DISPLACED_TO_SAFE),
        (Remove(), Outcome.LEAVES_ON_CONTACT),
    ],
)
def test_a_robot_that_moves_into_a_standing_artefact(
    policy: ContactPolicy, outcome: Outcome
) -> None:
    """The contact is reported with its depth, and the policy says what follows."""
    robot = Footprint.disc(0.3).at(1.5, 1.0, 0.0)
    standing = _boxes((1.0, 1.0))
    resolution = _resolve(standing, standing, _OPEN, robot, policy)
    assert _outcomes(resolution) == [outcome]
    assert resolution.contacts[0].penetration_m == pytest.approx(0.05)
    if outcome is Outcome.DISPLACED_TO_SAFE:
        assert not penetration_m(robot, resolution.boxes).any()


def test_one_that_is_held_may_back_out_but_not_go_deeper() -> None:
    """While the overlap lasts, it may move away from the robot, never further into it."""
    robot = Footprint.disc(0.3).at(1.5, 1.0, 0.0)
    back = _resolve(_boxes((0.98, 1.0)), _boxes((1.0, 1.0)), _OPEN, robot, Hold())
    deeper = _resolve(_boxes((1.02, 1.0)), _boxes((1.0, 1.0)), _OPEN, robot, Hold())
    assert _outcomes(back) == [Outcome.KEPT]
    assert _outcomes(deeper) == [Outcome.MOVED_BACK]


def test_a_standing_scene_is_kept_until_there_is_another_map_or_a_robot() -> None:
    """Where nothing moved, the result has the boxes given; a new map or a robot is looked at."""
    resolver = CollisionResolver(Displace(), 2.0)
    ids, standing = np.array([3, 8]), _boxes((5.0, 5.0), (7.0, 7.0))
    assert resolver.resolve(ids, standing, standing, _OPEN, None).is_all_kept
    again = resolver.resolve(ids, standing, standing, _OPEN, None)
    assert again.boxes is standing
    robot = Footprint.disc(0.3).at(5.3, 5.0, 0.0)
    contact = resolver.resolve(ids, standing, standing, _OPEN, robot)
    assert _outcomes(contact)[0] is Outcome.DISPLACED_TO_SAFE
    wall = _environment((49, 49, 51, 51))
    covered = resolver.resolve(ids, standing, standing, wall, None)
    assert _outcomes(covered) == [Outcome.DISPLACED_TO_SAFE, Outcome.KEPT]


@pytest.mark.parametrize("tracked", [0, 1])
def test_others_make_way_for_who_follows_a_track(tracked: int) -> None:
    """Whichever has the lower id: a track goes on, and who stands in its way is displaced."""
    here, there = (1.0, 1.0), (1.45, 1.0)
    places = [(here, here), (there, there)]
    places[tracked] = ((1.6, 1.0), (0.8, 1.0)) if tracked == 0 else ((0.9, 1.0), (1.6, 1.0))
    proposed, last_safe = (_boxes(*points) for points in zip(*places, strict=True))
    resolver, ids = CollisionResolver(Displace(), 2.0), np.arange(2)
    resolution = resolver.resolve(ids, proposed, last_safe, _OPEN, None, fixed=[tracked])
    expected = [Outcome.DISPLACED_TO_SAFE] * 2
    expected[tracked] = Outcome.KEPT
    assert _outcomes(resolution) == expected
    assert resolution.boxes.centres_m[tracked].tolist() == proposed.centres_m[tracked].tolist()
    assert not len(overlapping_pairs(resolution.boxes))


def test_a_track_into_the_robot_is_a_contact_when_it_gets_there() -> None:
    """Not a sub-step later: its end pose is its pose, whatever is there."""
    there, before = _boxes((1.0, 1.0), (3.0, 1.0)), _boxes((0.2, 1.0), (3.0, 1.0))
    robot = Footprint.disc(0.3).at(1.1, 1.0, 0.0)
    resolver, ids = CollisionResolver(Hold(), 2.0), np.array([1, 2])
    resolution = resolver.resolve(ids, there, before, _OPEN, robot, fixed=[0])
    assert resolution.is_all_kept
    assert [contact.artefact_id for contact in resolution.contacts] == [1]
    assert resolver.resolve(ids, before, there, _OPEN, robot, fixed=[0]).contacts == ()


@pytest.mark.parametrize("tracked", [0, 1])
def test_who_would_run_into_a_track_is_held_back(tracked: int) -> None:
    """Of two that would meet the one without a track stays, whatever its id."""
    last_safe, proposed = _boxes((1.0, 1.0), (1.9, 1.0)), _boxes((1.3, 1.0), (1.6, 1.0))
    resolver = CollisionResolver(Displace(), 2.0)
    assert resolver.held_back(proposed, last_safe).tolist() == [False, True]
    held = resolver.held_back(proposed, last_safe, [tracked])
    assert held.tolist() == [tracked == 1, tracked == 0]


def test_a_track_goes_on_through_walls_and_other_tracks() -> None:
    """Nothing stops it; where two meet, both go on."""
    wall = _environment((0, 20, 100, 21))
    last_safe, proposed = _boxes((1.5, 1.0), (2.5, 1.0)), _boxes((1.9, 1.0), (2.1, 1.0))
    resolver, ids = CollisionResolver(Displace(), 2.0), np.arange(2)
    resolution = resolver.resolve(ids, proposed, last_safe, wall, None, fixed=[0, 1])
    assert resolution.is_all_kept
    assert resolution.boxes.centres_m[:, 0].tolist() == [1.9, 2.1]


def test_nobody_at_all_is_resolved() -> None:
    """An empty population has no collisions."""
    nobody = OrientedBoxes.empty()
    assert _resolve(nobody, nobody).is_all_kept


def _stepped(boxes: OrientedBoxes, generator: np.random.Generator, step_m: float) -> OrientedBoxes:
    moves_m = generator.normal(0.0, step_m, (len(boxes), 2))
    moves_m[generator.random(len(boxes)) < 0.3] = 0.0
    centres_m = boxes.centres_m + np.pad(moves_m, ((0, 0), (0, 1)))
    turned = np.where(moves_m[:, 0] == 0.0, 0.0, generator.normal(0.0, 0.3, len(boxes)))
    return OrientedBoxes(centres_m, boxes.yaws_rad + turned, boxes.half_sizes_m)


def _check_invariant(
    resolution: Resolution, environment: Environment, robot: Footprint
) -> NDArray[np.bool_]:
    """Assert that who stays is clear of walls, robot and others; return who stays."""
    stays = resolution.outcomes < Outcome.LEAVES
    boxes = resolution.boxes.take(stays)
    assert not environment.hits_wall(boxes).any()
    assert not len(overlapping_pairs(boxes))
    assert not (penetration_m(robot, boxes) > 1e-9).any()
    return stays


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 100_000), st.sampled_from([0.05, 0.3, 1.5]))
def test_no_two_ever_overlap(seed: int, step_m: float) -> None:
    """A dense crowd, walls that appear, and a robot: from overlapping starts on, all are apart."""
    generator = np.random.default_rng(seed)
    count = 40
    halves_m = np.column_stack((generator.uniform(0.1, 0.5, (count, 2)), np.ones(count)))
    centres_m = np.column_stack((generator.uniform(2.0, 8.0, (count, 2)), np.ones(count)))
    boxes = OrientedBoxes(centres_m, generator.uniform(-3.0, 3.0, count), halves_m)
    resolver, ids = CollisionResolver(Displace(), 2.0), np.arange(count)
    environment = _OPEN
    for step in range(6):
        if step == 3:
            row, col = generator.integers(20, 70, 2)
            environment = _environment((row, col, row + 10, col + 10))
        x, y = generator.uniform(2.0, 8.0, 2)
        robot = Footprint.disc(0.4).at(x, y, 0.0)
        proposed = _stepped(boxes, generator, step_m)
        resolution = resolver.resolve(ids, proposed, boxes, environment, robot)
        stays = _check_invariant(resolution, environment, robot)
        boxes, ids = resolution.boxes.take(stays), ids[stays]
    assert len(ids) > count // 4


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 100_000), st.sampled_from([0.05, 0.3, 1.5]))
def test_only_tracks_ever_overlap(seed: int, step_m: float) -> None:
    """A crowd in which some follow tracks, of any id: the others keep apart from all."""
    generator = np.random.default_rng(seed)
    count = 25
    boxes = _boxes(*generator.uniform(2.0, 8.0, (count, 2)).tolist())
    resolver, ids = CollisionResolver(Displace(), 2.0), np.arange(count)
    is_tracked = generator.random(count) < 0.3
    for _ in range(6):
        proposed, fixed = _stepped(boxes, generator, step_m), np.flatnonzero(is_tracked).tolist()
        resolution = resolver.resolve(ids, proposed, boxes, _OPEN, None, fixed=fixed)
        assert (resolution.outcomes[fixed] == Outcome.KEPT).all()
        stays = resolution.outcomes < Outcome.LEAVES
        boxes, ids, is_tracked = resolution.boxes.take(stays), ids[stays], is_tracked[stays]
        assert all(is_tracked[list(pair)].all() for pair in overlapping_pairs(boxes))
    assert not is_tracked.all()
