"""Placement: uniform over the feasible poses, blocked only where there is none."""

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage, stats

from are_ros.artefacts._candidates import CandidateCells
from are_ros.artefacts._pose_lattice import HEADINGS, PoseLattice
from are_ros.artefacts._sought import Sought
from are_ros.artefacts._turning import Turning, turning_of
from are_ros.artefacts.artefact import GroundPose, boxes_of
from are_ros.artefacts.catalogue import CatalogueRow, MeshFile, MotionLimits
from are_ros.artefacts.placement import Placer
from are_ros.artefacts.randomness import Purpose, generator
from are_ros.artefacts.surroundings import Disc, KeepOut, Surroundings
from are_ros.artefacts.terrain import Terrains
from are_ros.world.environment import Environment
from are_ros.world.footprint import Footprint
from are_ros.world.ground import PlaneGround
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.oriented_boxes import OrientedBoxes
from are_ros.world.region import SpawnRegion
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

ROOMS = """
##########
#....#...#
#....#...#
#........#
#....#...#
#.##.....#
#........#
##########
"""

STANDS = MotionLimits()
TURNS = MotionLimits(speed_mps=1.0)
DRIVES = MotionLimits(speed_mps=1.0, turn_radius_m=0.5)


def _free(picture: str) -> Mask:
    return np.array([[cell == "." for cell in line.strip()] for line in picture.split()])


def _row(
    length_m: float,
    width_m: float,
    offset_m: tuple[float, float] = (0.0, 0.0),
    motion: MotionLimits = STANDS,
) -> CatalogueRow:
    size_m, centre_m, mesh = (length_m, width_m, 1.0), (*offset_m, 0.1), MeshFile(Path("none.obj"))
    return CatalogueRow(0, "box", "box", size_m, centre_m, mesh, motion=motion)


def _environment(
    free: Mask,
    resolution_m: float = 1.0,
    origin: RigidTransform | None = None,
    ground_m: float = 0.0,
) -> Environment:
    cells = np.where(free, 0, 100).astype(np.int8)
    grid = OccupancyGrid(cells, resolution_m, origin or RigidTransform.identity(), "map")
    return Environment(grid, classify(grid, 65, 25), None, PlaneGround(ground_m), 0.06)


def _region(mask: Mask, weight: npt.NDArray[np.float32] | None = None) -> SpawnRegion:
    return SpawnRegion(mask.copy(), weight, float(mask.sum()))


def _placer(free: Mask) -> Placer:
    return Placer(_environment(free), _region(free))


def _stream(number: int) -> np.random.Generator:
    return generator(1, Purpose.PLACE, number)


def _corners(row: CatalogueRow, poses: Floats) -> Floats:
    """Return the corners (N, 4, 2) of a row's footprints at poses (N, 3), by complex numbers."""
    offset = complex(*row.box_centre_in_artefact_m[:2])
    half = 0.5 * np.array(row.size_m[:2])
    local = offset + np.array(
        [complex(x, y) for x in (-half[0], half[0]) for y in (-half[1], half[1])]
    )
    turned = (poses[:, 0] + 1j * poses[:, 1])[:, None] + local * np.exp(1j * poses[:, 2])[:, None]
    return np.stack((turned.real, turned.imag), axis=-1)


def _parted(first: Floats, second: Floats, axes: Floats) -> npt.NDArray[np.bool_]:
    """Say which corner sets (N, 4, 2) are parted along any of the axes (N, K, 2)."""
    along_first, along_second = first @ np.swapaxes(axes, 1, 2), second @ np.swapaxes(axes, 1, 2)
    before = along_first.max(axis=1) <= along_second.min(axis=1) + 1e-9
    after = along_second.max(axis=1) <= along_first.min(axis=1) + 1e-9
    return np.asarray(np.any(before | after, axis=1))


def _axes(yaws_rad: Floats) -> Floats:
    cos, sin = np.cos(yaws_rad), np.sin(yaws_rad)
    return np.stack((np.stack((cos, sin), axis=-1), np.stack((-sin, cos), axis=-1)), axis=1)


def _stands_free(row: CatalogueRow, poses: Floats, free: Mask) -> Mask:
    """Test corners against the map's edge, and boxes against each blocked square, by axes."""
    corners = _corners(row, poses)
    height, width = free.shape
    clear: Mask = np.all(
        (corners > -1e-9) & (corners < np.array((width, height)) + 1e-9), axis=(1, 2)
    )
    for y, x in np.argwhere(~free):
        square = np.array([(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)], dtype=np.float64)
        left = np.flatnonzero(clear)
        axes = np.concatenate((_axes(poses[left, 2]), _axes(np.zeros(len(left)))), axis=1)
        squares = np.broadcast_to(square, (len(left), 4, 2))
        clear[left] = _parted(corners[left], squares, axes)
    return np.asarray(clear, dtype=np.bool_)


def _turns_free(row: CatalogueRow, points_m: Floats, free: Mask, slack_m: float = 1e-9) -> Mask:
    """Test the disc that holds the box against the map's edge and each blocked square."""
    corners_m = _corners(row, np.zeros((1, 3)))[0]
    radius_m = np.hypot(*corners_m.T).max() - slack_m
    height, width = free.shape
    room_m = np.minimum(points_m, (width, height) - points_m).min(axis=1)
    for y, x in np.argwhere(~free):
        nearest = np.clip(points_m, (x, y), (x + 1, y + 1))
        room_m = np.minimum(room_m, np.hypot(*(nearest - points_m).T))
    return np.asarray(room_m >= radius_m)


def _roomy(row: CatalogueRow, free: Mask, slack_m: float = 1e-9) -> Mask:
    """Return the cells of parts that discs roam, and beside; the large ones."""
    centres_m = (np.argwhere(np.ones_like(free))[:, ::-1] + 0.5).astype(np.float64)
    labels, count = ndimage.label(_turns_free(row, centres_m, free, slack_m).reshape(free.shape))
    sizes = np.bincount(labels[free], minlength=count + 1)
    sizes[0] = 0
    large = np.isin(labels, np.flatnonzero((sizes > 0) & (sizes >= 0.25 * sizes.max())))
    return np.asarray(ndimage.binary_dilation(large, np.ones((3, 3))), np.bool_)


def _sets_out(row: CatalogueRow, points_m: Floats, free: Mask, slack_m: float = 1e-9) -> Mask:
    """Test that it can turn, and is not shut in."""
    cols, rows = np.floor(points_m).astype(np.int64).T
    roomy = _roomy(row, free, slack_m)[rows, cols]
    return np.asarray(_turns_free(row, points_m, free, slack_m) & roomy, np.bool_)


def _array(poses: list[GroundPose | None]) -> Floats:
    return np.array([(pose.x_m, pose.y_m, pose.yaw_rad) for pose in poses if pose is not None])


def _bins(poses: Floats) -> npt.NDArray[np.int64]:
    """Give each pose within 10 m x 10 m its bin of 2 m x 2 m x quarter turn."""
    quarter = ((poses[:, 2] + 0.25 * np.pi) % math.tau / (0.5 * np.pi)).astype(np.int64)
    return ((poses[:, 0] // 2) * 5 + poses[:, 1] // 2).astype(np.int64) * 4 + quarter


def _same_law(first: Floats, second: Floats) -> float:
    counts = np.array([np.bincount(_bins(poses), minlength=100) for poses in (first, second)])
    counts = counts[:, counts.sum(axis=0) > 20]
    return float(stats.chi2_contingency(counts).pvalue)


@pytest.mark.parametrize(
    "row",
    [
        _row(1.7, 0.6),
        _row(0.0, 0.0),
        _row(1.4, 0.5, (0.4, -0.1)),
        _row(1.4, 0.5, (0.4, -0.1), DRIVES),
        _row(1.2, 0.6, motion=TURNS),
        _row(0.8, 0.5, (0.3, -0.1), TURNS),
    ],
)
def test_poses_are_uniform_over_the_feasible_ones(row: CatalogueRow) -> None:
    """3,000 poses against plain rejection over the whole map: chi-square, level 1/1,000.

    Of what turns on the spot those count where it can turn.
    """
    free = _free(ROOMS)
    placer = _placer(free)
    poses = _array([placer.place(row, _stream(number)) for number in range(3000)])
    assert len(poses) == 3000
    assert _stands_free(row, poses, free).all()
    tries = np.random.default_rng(5).random((30000, 3)) * (10.0, 8.0, math.tau)
    on_free = free[tries[:, 1].astype(np.int64), tries[:, 0].astype(np.int64)]
    feasible = on_free & _stands_free(row, tries, free)
    if row.motion is TURNS:
        assert _sets_out(row, poses[:, :2], free).all()
        can_turn = _sets_out(row, tries[:, :2], free)
        assert 0.2 < can_turn[feasible].mean() < 0.9
        feasible &= can_turn
    oracle = tries[feasible]
    assert len(oracle) > 1500
    assert _same_law(poses, oracle) > 1e-3


def test_zone_weights_are_densities() -> None:
    """Points fall three times as densely where the weight is 3: binomial, level 1/1,000."""
    free = np.ones((6, 8), np.bool_)
    weight = np.ones((6, 8), np.float32)
    weight[:, :2] = 3.0
    placer = Placer(_environment(free), _region(free, weight))
    poses = _array([placer.place(_row(0.0, 0.0), _stream(number)) for number in range(2000)])
    left = int((poses[:, 0] < 2.0).sum())
    assert stats.binomtest(left, 2000, 0.5).pvalue > 1e-3
    assert stats.kstest(poses[:, 1] / 6.0, "uniform").pvalue > 1e-3
    assert stats.kstest(poses[poses[:, 0] < 2.0, 0] / 2.0, "uniform").pvalue > 1e-3


SLOTS = """
###########
#...#######
###########
#...##....#
#####.#####
#####.#####
#####.#####
###########
"""


def test_a_box_that_fits_only_on_the_lattice_is_found_uniformly() -> None:
    """A box of exactly 3 x 1 cells has ten lattice poses in five slots: chi-square, 1/1,000."""
    free = _free(SLOTS)
    placer = _placer(free)
    poses = _array([placer.place(_row(3.0, 1.0), _stream(number)) for number in range(400)])
    rounded = {tuple(pose) for pose in np.round(poses, 6)}
    assert {pose[:2] for pose in rounded} == {
        (2.5, 1.5),
        (2.5, 3.5),
        (7.5, 3.5),
        (8.5, 3.5),
        (5.5, 5.5),
    }
    assert len(rounded) == 10
    _, counts = np.unique(np.round(poses, 6), axis=0, return_counts=True)
    assert stats.chisquare(counts).pvalue > 1e-3


def test_the_lattice_honours_the_weights() -> None:
    """With weight 4 on one of the two slots it is taken four times as often: level 1/1,000."""
    free = _free("##### #...# ##### #...# #####")
    weight = free.astype(np.float32)
    weight[3] *= 4.0
    placer = Placer(_environment(free), _region(free, weight))
    poses = _array([placer.place(_row(3.0, 1.0), _stream(number)) for number in range(400)])
    assert stats.binomtest(int((poses[:, 1] > 2.0).sum()), 400, 0.8).pvalue > 1e-3


def _lattice(free: Mask) -> Floats:
    centres = np.argwhere(free)[:, ::-1] + 0.5
    angles = np.arange(HEADINGS) * math.tau / HEADINGS
    return np.array([(x, y, angle) for x, y in centres for angle in angles]).reshape(-1, 3)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    sizes=st.tuples(st.floats(0.0, 4.0), st.floats(0.0, 3.0)),
    offset=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
    motion=st.sampled_from((STANDS, TURNS)),
)
def test_blocked_if_and_only_if_the_lattice_holds_none(
    seed: int, sizes: tuple[float, float], offset: tuple[float, float], motion: MotionLimits
) -> None:
    """Random clutter, random boxes: what is placed is free, and what is not is nowhere free.

    What turns is placed where it can if the lattice holds such a pose, and else anywhere.
    Where a box touches a wall the oracle may round the other way, so it tests boxes 1 um larger
    and smaller.
    """
    free = np.random.default_rng(seed).random((7, 8)) > 0.15
    offset_m = (offset[0] * sizes[0], offset[1] * sizes[1])
    row = _row(*sizes, offset_m, motion)
    larger = _row(sizes[0] + 1e-6, sizes[1] + 1e-6, offset_m)
    smaller = _row(max(sizes[0] - 1e-6, 0.0), max(sizes[1] - 1e-6, 0.0), offset_m)
    placer, lattice = _placer(free), _lattice(free)
    pose = placer.place(row, _stream(seed))
    if pose is None:
        assert not _stands_free(larger, lattice, free).any()
        assert placer.place(row, _stream(seed + 1)) is None
    elif min(sizes) > 1e-6:
        assert _stands_free(smaller, _array([pose]), free).all()
    boxes, _ = placer._standing(row, np.insert(lattice, 2, 0.0, axis=1))
    turning = turning_of(row, placer._environment, Terrains(), free)
    placeable = placer._environment.is_placeable(boxes)
    assert _lattice_poses(placer, row, None) == np.count_nonzero(placeable)
    if turning is None or (_roomy(row, free, -1e-6) != _roomy(row, free, 1e-6)).any():
        return
    turns = [_sets_out(row, lattice[:, :2], free, slack_m) for slack_m in (-1e-6, 1e-6)]
    least, most = (np.count_nonzero(placeable & can_turn) for can_turn in turns)
    assert least <= _lattice_poses(placer, row, turning) <= most
    if least:
        assert pose is not None
        assert _sets_out(row, _array([pose])[:, :2], free, 1e-6).all()


def test_nobody_who_walks_arrives_in_a_pocket() -> None:
    """A nook that a body of its size cannot leave is left out, a room of some size is not."""
    free = _free("#" * 16 + (" #" + "." * 9 + "#" + "." * 4 + "#") * 2 + " " + "#" * 16)
    nook = _free("#" * 16 + (" #" + "." * 11 + "#" + "." * 2 + "#") * 2 + " " + "#" * 16)
    walker = _row(0.6, 0.6, motion=TURNS)
    for plan, is_used in ((free, True), (nook, False)):
        wall = 1 + int(np.flatnonzero(~plan[1, 1:-1])[0])
        placer = _placer(plan)
        poses = _array([placer.place(walker, _stream(number)) for number in range(100)])
        assert bool((poses[:, 0] > wall).any()) == is_used


def _lattice_poses(placer: Placer, row: CatalogueRow, turning: Turning | None) -> int:
    """Count what the static map allows of the lattice."""
    nearby = Surroundings(), Disc(0.0, 0.0, math.inf)
    pieces = placer._static_poses(Sought(row, *nearby, turning), placer._cells)
    return sum(piece.size for piece in pieces)


def test_nothing_ever_overlaps() -> None:
    """A map is filled until it is full: no two boxes overlap, none the robot's clearance."""
    free = _free(ROOMS)
    placer = _placer(free)
    robot = Footprint.disc(0.4).at(7.5, 5.5, 0.3)
    goal = Footprint(np.array([[2.0, 2.0]]))
    keep_out = (KeepOut(robot, 0.5), KeepOut(goal, 0.7))
    rows = [_row(1.2, 0.5), _row(0.6, 0.6, (0.1, 0.0)), _row(0.4, 0.3)]
    standing: list[tuple[CatalogueRow, GroundPose]] = []
    others = OrientedBoxes.empty()
    for number in range(150):
        row = rows[number % 3]
        pose = placer.place(row, _stream(number), Surroundings(others, keep_out))
        if pose is not None:
            standing.append((row, pose))
            others = boxes_of([row for row, _ in standing], [pose for _, pose in standing])
    assert 15 < len(standing) < 150
    corners = np.concatenate([_corners(row, _array([pose])) for row, pose in standing])
    yaws_rad = np.array([pose.yaw_rad for _, pose in standing])
    first, second = np.triu_indices(len(standing), 1)
    axes = np.concatenate((_axes(yaws_rad[first]), _axes(yaws_rad[second])), axis=1)
    assert _parted(corners[first], corners[second], axes).all()
    edges = np.linspace(corners, np.roll(corners, -1, axis=1), 60).reshape(-1, 2)
    assert np.hypot(*(edges - (7.5, 5.5)).T).min() > 0.9 - 1e-9
    assert np.hypot(*(edges - (2.0, 2.0)).T).min() > 0.7 - 1e-9


def test_a_crowd_blocks_and_its_leaving_frees() -> None:
    """Boxes in every slot block the next; without one of them its slot is the only place."""
    free = _free("##### #...# ##### #...# #####")
    placer, row = _placer(free), _row(3.0, 1.0)
    poses = [GroundPose(2.5, 1.5, 0.0, 0.0), GroundPose(2.5, 3.5, 0.0, 0.0)]
    both, one = boxes_of([row, row], poses), boxes_of([row], poses[:1])
    assert placer.place(row, _stream(1), Surroundings(both)) is None
    found = placer.place(row, _stream(1), Surroundings(one))
    assert found is not None
    assert (found.x_m, found.y_m) == (2.5, 3.5)


CORRIDOR = """
#########
#.......#
#########
#...#####
#...#####
#...#####
#########
"""


def test_what_cannot_turn_anywhere_is_placed_where_it_fits() -> None:
    """In a corridor too narrow to turn in: uniform over the feasible poses, level 1/1,000."""
    free = _free("######### #.......# #########")
    placer, row = _placer(free), _row(1.3, 0.5, motion=TURNS)
    poses = _array([placer.place(row, _stream(number)) for number in range(1000)])
    assert len(poses) == 1000
    assert not _turns_free(row, poses[:, :2], free).any()
    tries = np.random.default_rng(5).random((30000, 3)) * (9.0, 3.0, math.tau)
    assert _same_law(poses, tries[_stands_free(row, tries, free)]) > 1e-3


def test_what_turns_goes_where_it_cannot_only_if_there_is_no_other_place() -> None:
    """The room takes walkers until its middle is taken; only then one stands in the corridor."""
    free, row = _free(CORRIDOR), _row(1.3, 0.5, motion=TURNS)
    placer = _placer(free)
    poses = _array([placer.place(row, _stream(number)) for number in range(200)])
    assert (poses[:, 1] > 3.0).all()
    assert _turns_free(row, poses[:, :2], free).all()
    middle = boxes_of([_row(2.6, 2.6)], [GroundPose(2.5, 4.5, 0.0, 0.0)])
    placed = [placer.place(row, _stream(number), Surroundings(middle)) for number in range(20)]
    assert (_array(placed)[:, 1] < 2.0).sum() == 20
    corridor = Disc(4.5, 1.5, 1.0)
    assert placer.place(row, _stream(1), within=corridor) is not None
    assert [_placer(free).place(row, _stream(k), Surroundings(middle)) for k in range(5)] == (
        placed[:5]
    )


def test_what_hangs_low_is_in_the_way_of_turning() -> None:
    """Under a shelf on high legs nobody who walks arrives, nor where it would touch it turning."""
    free, row = np.ones((8, 8), np.bool_), _row(1.2, 0.6, motion=TURNS)
    grid = _environment(free).grid
    shelf = np.zeros((8, 8, 10), np.uint8)
    shelf[2:4, 5:7, 5:] = 1
    above = VoxelMap(RigidTransform.identity(), (1.0, 1.0, 0.1), shelf)
    environment = Environment(grid, classify(grid, 65, 25), above, PlaneGround(0.0), 0.06)
    placer = Placer(environment, _region(free))
    poses = _array([placer.place(row, _stream(number)) for number in range(300)])
    open_below = free.copy()
    open_below[5:7, 2:4] = False
    assert _turns_free(row, poses[:, :2], open_below).all()


def test_a_group_stays_near_its_first_member_uniformly() -> None:
    """Points within 2.5 m of the first: uniform over the free part of the disc, 1/1,000."""
    free = _free(ROOMS)
    disc = Disc(4.0, 4.0, 2.5)
    placer = _placer(free)
    row = _row(0.0, 0.0)
    placed = [placer.place(row, _stream(number), within=disc) for number in range(2000)]
    poses = _array(placed)
    assert len(poses) == 2000
    assert np.hypot(poses[:, 0] - 4.0, poses[:, 1] - 4.0).max() <= 2.5
    tries = np.random.default_rng(5).random((20000, 3)) * (10.0, 8.0, math.tau)
    near = np.hypot(tries[:, 0] - 4.0, tries[:, 1] - 4.0) <= 2.5
    oracle = tries[near & free[tries[:, 1].astype(np.int64), tries[:, 0].astype(np.int64)]]
    assert _same_law(poses, oracle) > 1e-3
    assert placer.place(row, _stream(1), within=Disc(-50.0, 3.0, 2.0)) is None


def test_a_turned_map_with_high_ground_agrees_with_the_environment() -> None:
    """Poses on a fine, turned and shifted grid are placeable boxes on the ground's height."""
    free = np.kron(_free(ROOMS), np.ones((5, 5), np.bool_))
    environment = _environment(free, 0.2, RigidTransform.planar(30.0, -7.0, 2.2), ground_m=0.3)
    placer = Placer(environment, _region(free))
    row = _row(1.2, 0.5, (0.2, 0.05))
    placed = [placer.place(row, _stream(number)) for number in range(100)]
    poses = [pose for pose in placed if pose is not None]
    boxes = boxes_of([row] * len(poses), poses)
    assert len(poses) == 100
    assert environment.is_placeable(boxes).all()
    np.testing.assert_allclose(boxes.centres_m[:, 2] - boxes.half_sizes_m[:, 2], 0.3)


def test_what_is_not_allowed_is_refused() -> None:
    """A predicate on boxes confines them to x > 7; one that refuses all blocks."""
    placer, row = _placer(_free(ROOMS)), _row(0.4, 0.4)
    right = Surroundings(allowed=lambda boxes: boxes.centres_m[:, 0] > 7.0)
    poses = _array([placer.place(row, _stream(number), right) for number in range(50)])
    assert len(poses) == 50
    assert poses[:, 0].min() > 7.0
    nowhere = Surroundings(allowed=lambda boxes: np.zeros(len(boxes), np.bool_))
    assert placer.place(row, _stream(1), nowhere) is None


@pytest.mark.parametrize("row", [_row(0.8, 0.4), _row(0.8, 0.4, motion=TURNS)])
def test_memory_and_distant_neighbours_change_no_draw(row: CatalogueRow) -> None:
    """The same stream gives the same pose in a fresh placer, after blocked ones, beside others."""
    free, huge = _free(ROOMS), _row(9.0, 9.0)
    used = _placer(free)
    assert used.place(huge, _stream(3)) is None
    expected = used.place(row, _stream(7))
    assert expected is not None
    assert _placer(free).place(row, _stream(7)) == expected
    far = GroundPose(1.5 if expected.x_m > 5.0 else 8.0, 6.5, 0.0, 0.0)
    others = boxes_of([_row(0.2, 0.2)], [far])
    assert used.place(row, _stream(7), Surroundings(others)) == expected


def test_a_lattice_of_very_many_cells_is_thinned_evenly() -> None:
    """Of 600 x 600 cells of 1 cm every fifth row and column stay, and a full slot is found."""
    free = np.ones((600, 600), np.bool_)
    environment = _environment(free, 0.01)
    placer, lattice = Placer(environment, _region(free)), PoseLattice(environment.grid)
    thinned = lattice.thinned(placer._cells.flat)
    rows, cols = np.divmod(np.sort(thinned), 600)
    assert thinned.size == 120 * 120
    assert set(rows % 5) == set(cols % 5) == {2}
    few = lattice.thinned(np.arange(1000, dtype=np.int32))
    assert few.size == 1000
    corner = Surroundings(allowed=lambda boxes: boxes.centres_m[:, :2].max(axis=1) < 0.06)
    pose = placer.place(_row(0.0, 0.0), _stream(1), corner)
    assert pose is not None
    assert max(pose.x_m, pose.y_m) < 0.06


def test_an_empty_region_has_no_place() -> None:
    """Nowhere to arrive means blocked, for points too."""
    free = _free(ROOMS)
    placer = Placer(_environment(free), _region(np.zeros_like(free)))
    assert placer.place(_row(0.0, 0.0), _stream(1)) is None


@given(levels=st.lists(st.floats(1.0, 20.0), min_size=1, max_size=30), radius=st.floats(0.0, 25.0))
def test_cells_with_room_are_those_with_clearance(levels: list[float], radius: float) -> None:
    """The prefix holds every cell with the clearance, and none that lacks half a cell of it."""
    clearance = np.array(levels, np.float32)
    cells = CandidateCells.ordered(np.arange(len(levels), dtype=np.int32), clearance, None)
    np.testing.assert_array_equal(
        cells.flat, np.argsort(-(clearance * 4).astype(int), kind="stable")
    )
    kept = set(cells.with_room(radius).flat.tolist())
    assert set(np.flatnonzero(clearance >= radius - 0.2072).tolist()) <= kept
    assert kept <= set(np.flatnonzero(clearance >= radius - 0.71).tolist())
