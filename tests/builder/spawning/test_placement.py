"""Placement: uniform over the feasible poses, blocked only where there is none."""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from are_ros.agents.navigation.terrain import Terrains
from are_ros.builder.spawning._departure_constraint import (
    DepartureConstraint,
    departure_constraint_of,
)
from are_ros.builder.spawning.placement import (
    HEADINGS,
    CandidateCells,
    PlacementConstraints,
    PlacementQuery,
    Placer,
    lattice_cells,
    lattice_poses,
)
from are_ros.population.artefact import GroundPose, boxes_of
from are_ros.population.catalogue import CatalogueRow, MotionLimits
from are_ros.world.boxes import OrientedBoxes, overlaps_any
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.footprint import Footprint
from are_ros.world.occupancy_grid import classify
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap
from tests.builder.spawning.slow_placement import (
    DRIVES,
    ROOMS,
    STANDS,
    TURNS,
    Floats,
    Mask,
    axes_of,
    corners_of,
    environment_of,
    free_cells,
    parted,
    placer_of,
    region_of,
    roomy_cells,
    row_of,
    sets_out,
    stands_free,
    stream,
    turns_free,
)


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
        row_of(1.7, 0.6),
        row_of(0.0, 0.0),
        row_of(1.4, 0.5, (0.4, -0.1)),
        pytest.param(row_of(1.4, 0.5, (0.2, -0.1), DRIVES), marks=pytest.mark.long),
        row_of(1.9, 0.9, motion=DRIVES),
        row_of(1.2, 0.6, motion=TURNS),
        row_of(0.8, 0.5, (0.3, -0.1), TURNS),
    ],
)
def test_poses_are_uniform_over_the_feasible_ones(row: CatalogueRow) -> None:
    """3,000 poses against plain rejection over the whole map: chi-square, level 1/1,000.

    Of what moves those count from where it can set out.
    """
    free = free_cells(ROOMS)
    placer = placer_of(free)
    poses = _array([placer.place(row, stream(number)) for number in range(3000)])
    assert len(poses) == 3000
    assert stands_free(row, poses, free).all()
    tries = np.random.default_rng(5).random((30000, 3)) * (10.0, 8.0, math.tau)
    on_free = free[tries[:, 1].astype(np.int64), tries[:, 0].astype(np.int64)]
    oracle = tries[on_free & stands_free(row, tries, free)]
    if row.motion is not STANDS:
        assert sets_out(row, poses, free, 1e-6).all()
        gets_off = sets_out(row, oracle, free)
        assert 0.2 < gets_off.mean() < 0.95
        oracle = oracle[gets_off]
    assert len(oracle) > 1500
    assert _same_law(poses, oracle) > 1e-3


def test_zone_weights_are_densities() -> None:
    """Points fall three times as densely where the weight is 3: binomial, level 1/1,000."""
    free = np.ones((6, 8), np.bool_)
    weight = np.ones((6, 8), np.float32)
    weight[:, :2] = 3.0
    placer = Placer(environment_of(free), region_of(free, weight))
    poses = _array([placer.place(row_of(0.0, 0.0), stream(number)) for number in range(2000)])
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
    free = free_cells(SLOTS)
    placer = placer_of(free)
    poses = _array([placer.place(row_of(3.0, 1.0), stream(number)) for number in range(400)])
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
    free = free_cells("##### #...# ##### #...# #####")
    weight = free.astype(np.float32)
    weight[3] *= 4.0
    placer = Placer(environment_of(free), region_of(free, weight))
    poses = _array([placer.place(row_of(3.0, 1.0), stream(number)) for number in range(400)])
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

    What turns is placed where it can set out if the lattice holds such a pose, and else anywhere.
    Where a box touches a wall the oracle may round the other way, so it tests boxes 1 um larger
    and smaller.
    """
    free = np.random.default_rng(seed).random((7, 8)) > 0.15
    offset_m = (offset[0] * sizes[0], offset[1] * sizes[1])
    row = row_of(*sizes, offset_m, motion)
    larger = row_of(sizes[0] + 1e-6, sizes[1] + 1e-6, offset_m)
    smaller = row_of(max(sizes[0] - 1e-6, 0.0), max(sizes[1] - 1e-6, 0.0), offset_m)
    placer, lattice = placer_of(free), _lattice(free)
    pose = placer.place(row, stream(seed))
    if pose is None:
        assert not stands_free(larger, lattice, free).any()
        assert placer.place(row, stream(seed + 1)) is None
    elif min(sizes) > 1e-6:
        assert stands_free(smaller, _array([pose]), free).all()
    boxes, _ = placer._standing(row, np.insert(lattice, 2, 0.0, axis=1))
    departure = departure_constraint_of(row, placer._environment, Terrains(), free)
    placeable = placer._environment.is_placeable(boxes)
    assert _lattice_poses(placer, row, None) == np.count_nonzero(placeable)
    if departure is None or (roomy_cells(row, free, -1e-6) != roomy_cells(row, free, 1e-6)).any():
        return
    off = [sets_out(row, lattice, free, slack_m) for slack_m in (-1e-6, 1e-6)]
    least, most = (np.count_nonzero(placeable & gets_off) for gets_off in off)
    assert least <= _lattice_poses(placer, row, departure) <= most
    if least:
        assert pose is not None
        assert sets_out(row, _array([pose]), free, 1e-6).all()


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    sizes=st.tuples(st.floats(0.5, 4.0), st.floats(0.3, 1.5)),
    radius_m=st.floats(0.5, 5.0),
)
def test_what_drives_is_placed_where_it_fits_and_sets_out_from_there_if_it_can(
    seed: int, sizes: tuple[float, float], radius_m: float
) -> None:
    """Random clutter: if one of a hundred poses is such that it sets out, it is placed so."""
    random = np.random.default_rng(seed)
    free = random.random((7, 8)) > 0.15
    row = row_of(*sizes, motion=MotionLimits(speed_mps=1.0, turn_radius_m=radius_m))
    pose = placer_of(free).place(row, stream(seed))
    as_it_stands = placer_of(free).place(replace(row, motion=STANDS), stream(seed))
    assert (pose is None) == (as_it_stands is None)
    tries = random.random((1000, 3)) * (8.0, 7.0, math.tau)
    if sets_out(row, tries, free, -1e-6).mean() >= 0.01:
        assert pose is not None
        assert sets_out(row, _array([pose]), free, 1e-6).all()


POCKET = """
################
#........#..#..#
#........#..####
#........#..#..#
#........#..#..#
################
"""


def test_who_walks_arrives_in_pockets_as_often_as_their_area_is_large() -> None:
    """A hall, a nook and two cells beside it: by the area that the disc has, level 1/1,000."""
    free, row, radius_m = free_cells(POCKET), row_of(0.48, 0.36, motion=TURNS), 0.3
    placer = placer_of(free)
    poses = _array([placer.place(row, stream(number)) for number in range(3000)])
    parts_m = ((1, 9, 1, 5), (10, 12, 1, 5), (13, 15, 1, 2), (13, 15, 3, 5))
    areas, counts = [], []
    for x0, x1, y0, y1 in parts_m:
        inside = (poses[:, 0] > x0) & (poses[:, 0] < x1) & (poses[:, 1] > y0) & (poses[:, 1] < y1)
        areas.append((x1 - x0 - 2.0 * radius_m) * (y1 - y0 - 2.0 * radius_m))
        counts.append(np.count_nonzero(inside))
    assert sum(counts) == len(poses)
    expected = len(poses) * np.array(areas) / sum(areas)
    assert stats.chisquare(counts, expected).pvalue > 1e-3


def test_a_vehicle_does_not_arrive_where_no_way_leads_on() -> None:
    """In a part too short for a trip it would stand; in a small one that is long it does not."""
    free = free_cells(POCKET)
    row = row_of(0.6, 0.4, motion=MotionLimits(speed_mps=1.0, turn_radius_m=0.5))
    placer = placer_of(free)
    poses = _array([placer.place(row, stream(number)) for number in range(600)])
    assert (poses[:, 0] < 12.0).all()
    # discs of 0.26 m: 7.48 x 3.48 m of the hall, 1.48 x 3.48 m of the nook, less at the walls
    assert 40 < np.count_nonzero(poses[:, 0] > 10.0) < 130


def _lattice_poses(placer: Placer, row: CatalogueRow, departure: DepartureConstraint | None) -> int:
    """Count what the static map allows of the lattice."""
    query = PlacementQuery(row, PlacementConstraints(within=(0.0, 0.0, math.inf)), departure)
    return sum(
        placer._feasible(query, lattice_poses(placer._grid, piece), is_checked=is_checked)[0].size
        for piece, is_checked in placer._lattice_poses(query, placer._cells)
    )


def test_a_search_gives_the_same_however_much_is_known() -> None:
    """The map is asked about some thousand poses at a time; what is known changes no pose."""
    free, row = np.ones((80, 80), np.bool_), row_of(0.9, 0.4)
    spot = np.array([4.05, 3.05])  # the centre of a cell, too small a spot for draws

    def at_the_spot(boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        is_there: npt.NDArray[np.bool_] = np.hypot(*(boxes.centres_m[:, :2] - spot).T) < 1e-3
        return is_there

    around = PlacementConstraints(allowed=at_the_spot)
    placer = placer_of(free, 0.1)
    found = [placer.place(row, stream(1), around) for _ in range(12)]
    (static,) = placer._static.values()
    assert not static.unchecked.size
    assert static.allowed.size == _lattice_poses(placer, row, None) > 60_000
    assert {*found} == {placer_of(free, 0.1).place(row, stream(1), around)} != {None}


@dataclass(frozen=True)
class _Ramp:
    """A ground that is as high as x - 20, from 0 to `top_m`."""

    top_m: float

    def lowest_m(self) -> float:
        return 0.0

    def highest_m(self) -> float:
        return self.top_m

    def heights(self, points_m: npt.NDArray[np.floating]) -> Floats:
        return np.clip(points_m[:, 0] - 20.0, 0.0, self.top_m)


@pytest.mark.parametrize(("top_m", "least_share"), [(0.0, 0.5), (0.4, 0.5), (3.0, 0.0)])
@pytest.mark.parametrize("is_group", [False, True])
def test_what_a_search_leaves_out_overlaps_another(
    top_m: float, least_share: float, *, is_group: bool
) -> None:
    """On a turned map, beside what stands and what hangs high: only poses that are taken.

    Where the ground is so uneven that boxes may stand above each other, none is left out.
    """
    free, row = np.ones((60, 70), np.bool_), row_of(0.8, 0.5, (0.1, 0.05))
    flat = environment_of(free, 0.1, RigidTransform.planar(20.0, -5.0, 0.7))
    environment = replace(flat, ground=_Ramp(top_m))
    middle_m = flat.grid.cells_to_points(np.array([[30, 35]]))[0]
    generator = np.random.default_rng(3)
    around_m = middle_m + generator.uniform(-3.0, 3.0, (25, 2))
    yaws_rad, half_sizes_m = generator.uniform(-4.0, 4.0, 25), generator.uniform(0.1, 0.6, (25, 3))
    centres_m = np.column_stack((around_m, half_sizes_m[:, 2]))
    centres_m[:8, 2] += 5.0
    others = OrientedBoxes(centres_m, yaws_rad, half_sizes_m)
    placer = Placer(environment, region_of(free))
    within = (*middle_m, math.inf) if is_group else None

    def numbers(boxes: OrientedBoxes) -> npt.NDArray[np.int64]:
        query = PlacementQuery(row, PlacementConstraints(boxes, within=within))
        return np.concatenate([piece for piece, _ in placer._lattice_poses(query, placer._cells)])

    out = np.setdiff1d(numbers(OrientedBoxes.empty()), numbers(others))
    boxes, _ = placer._standing(row, lattice_poses(environment.grid, out))
    assert overlaps_any(boxes, others).all()
    everywhere = np.flatnonzero(np.ones(60 * 70 * HEADINGS))
    boxes, _ = placer._standing(row, lattice_poses(environment.grid, everywhere))
    are_taken = overlaps_any(boxes, others).reshape(-1, HEADINGS).all(axis=1)
    assert out.size >= least_share * HEADINGS * np.count_nonzero(are_taken)
    assert bool(out.size) == (least_share > 0.0)


def test_nothing_ever_overlaps() -> None:
    """A map is filled until it is full: no two boxes overlap, none the robot's clearance."""
    free = free_cells(ROOMS)
    placer = placer_of(free)
    robot = Footprint.disc(0.4).at(7.5, 5.5, 0.3)
    goal = Footprint(np.array([[2.0, 2.0]]))
    keep_out = ((robot, 0.5), (goal, 0.7))
    rows = [row_of(1.2, 0.5), row_of(0.6, 0.6, (0.1, 0.0)), row_of(0.4, 0.3)]
    standing: list[tuple[CatalogueRow, GroundPose]] = []
    others = OrientedBoxes.empty()
    for number in range(150):
        row = rows[number % 3]
        pose = placer.place(row, stream(number), PlacementConstraints(others, keep_out))
        if pose is not None:
            standing.append((row, pose))
            others = boxes_of([row for row, _ in standing], [pose for _, pose in standing])
    assert 15 < len(standing) < 150
    corners = np.concatenate([corners_of(row, _array([pose])) for row, pose in standing])
    yaws_rad = np.array([pose.yaw_rad for _, pose in standing])
    first, second = np.triu_indices(len(standing), 1)
    axes = np.concatenate((axes_of(yaws_rad[first]), axes_of(yaws_rad[second])), axis=1)
    assert parted(corners[first], corners[second], axes).all()
    edges = np.linspace(corners, np.roll(corners, -1, axis=1), 60).reshape(-1, 2)
    assert np.hypot(*(edges - (7.5, 5.5)).T).min() > 0.9 - 1e-9
    assert np.hypot(*(edges - (2.0, 2.0)).T).min() > 0.7 - 1e-9


def test_what_a_crowd_takes_is_left_out_and_changes_no_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each arrival comes where it would if each pose were looked at; far fewer are."""
    looked_at = [0]

    def standing(self: Placer, row: CatalogueRow, poses: Floats) -> tuple[OrientedBoxes, Floats]:
        looked_at[0] += len(poses)
        return stands(self, row, poses)

    def filled() -> list[GroundPose | None]:
        placer, poses = placer_of(np.ones((30, 30), np.bool_), 0.1), list[GroundPose]()
        places = list[GroundPose | None]()
        for number in range(120):
            row = row_of(0.55, 0.3, motion=TURNS if number % 2 else STANDS)
            others = PlacementConstraints(boxes_of([row] * len(poses), poses))
            places.append(placer.place(row, stream(number), others))
            poses += [place for place in places[-1:] if place is not None]
        return places

    stands = Placer._standing
    monkeypatch.setattr(Placer, "_standing", standing)
    quick, few = filled(), looked_at[0]
    none = np.zeros((30, 30), np.bool_)
    monkeypatch.setattr(Placer, "_taken_cells", lambda *_: none)
    looked_at[0] = 0
    assert quick == filled()
    assert quick.count(None) > 60
    assert few < 0.2 * looked_at[0]


def test_a_crowd_blocks_and_its_leaving_frees() -> None:
    """Boxes in every slot block the next; without one of them its slot is the only place."""
    free = free_cells("##### #...# ##### #...# #####")
    placer, row = placer_of(free), row_of(3.0, 1.0)
    poses = [GroundPose(2.5, 1.5, 0.0, 0.0), GroundPose(2.5, 3.5, 0.0, 0.0)]
    both, one = boxes_of([row, row], poses), boxes_of([row], poses[:1])
    assert placer.place(row, stream(1), PlacementConstraints(both)) is None
    found = placer.place(row, stream(1), PlacementConstraints(one))
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
    free = free_cells("######### #.......# #########")
    placer, row = placer_of(free), row_of(1.3, 0.5, motion=TURNS)
    poses = _array([placer.place(row, stream(number)) for number in range(1000)])
    assert len(poses) == 1000
    assert not turns_free(row, poses[:, :2], free).any()
    tries = np.random.default_rng(5).random((30000, 3)) * (9.0, 3.0, math.tau)
    assert _same_law(poses, tries[stands_free(row, tries, free)]) > 1e-3


def test_what_turns_goes_where_it_cannot_only_if_there_is_no_other_place() -> None:
    """The room takes walkers until its middle is taken; only then one stands in the corridor."""
    free, row = free_cells(CORRIDOR), row_of(1.3, 0.5, motion=TURNS)
    placer = placer_of(free)
    poses = _array([placer.place(row, stream(number)) for number in range(200)])
    assert (poses[:, 1] > 3.0).all()
    assert turns_free(row, poses[:, :2], free).all()
    middle = boxes_of([row_of(2.6, 2.6)], [GroundPose(2.5, 4.5, 0.0, 0.0)])
    placed = [
        placer.place(row, stream(number), PlacementConstraints(middle)) for number in range(20)
    ]
    assert (_array(placed)[:, 1] < 2.0).sum() == 20
    corridor = PlacementConstraints(within=(4.5, 1.5, 1.0))
    assert placer.place(row, stream(1), corridor) is not None
    assert [
        placer_of(free).place(row, stream(k), PlacementConstraints(middle)) for k in range(5)
    ] == (placed[:5])


GARAGE = """
###########
#...#######
###########
#.........#
#.........#
#.........#
###########
"""


def test_what_drives_is_wedged_in_only_if_there_is_no_other_place() -> None:
    """A slot as long as the car is not taken before the hall beside it is full."""
    free, row = free_cells(GARAGE), row_of(2.9, 0.9, motion=DRIVES)
    placer = placer_of(free)
    poses = _array([placer.place(row, stream(number)) for number in range(200)])
    assert (poses[:, 1] > 3.0).all()
    assert sets_out(row, poses, free, 1e-6).all()
    middle = boxes_of([row_of(8.6, 2.8)], [GroundPose(5.5, 4.5, 0.0, 0.0)])
    placed = [
        placer.place(row, stream(number), PlacementConstraints(middle)) for number in range(5)
    ]
    assert (_array(placed)[:, 1] < 2.0).sum() == 5
    assert [
        placer_of(free).place(row, stream(k), PlacementConstraints(middle)) for k in range(5)
    ] == (placed)


def test_what_can_drive_off_nowhere_is_placed_where_it_fits() -> None:
    """In an alley as wide as the car, where only lattice poses fit, and in a garage of its size."""
    row = row_of(2.0, 1.0, motion=DRIVES)
    for picture in ("######## #......# ########", "##### #...# #...# #...# #####"):
        placer, free = placer_of(free_cells(picture)), free_cells(picture)
        poses = _array([placer.place(row, stream(number)) for number in range(20)])
        assert len(poses) == 20
        assert stands_free(row, poses, free).all()
        assert not sets_out(row, poses, free).any()


def test_what_only_stands_needs_no_room_to_set_out() -> None:
    """A parked car is as well in the slot as in the hall, and so is a person on guard."""
    free = free_cells(GARAGE)
    for motion in (TURNS, DRIVES):
        row = replace(row_of(2.9, 0.9, motion=motion), behaviours={"standing": 1.0})
        assert departure_constraint_of(row, environment_of(free), Terrains(), free) is None
        as_it_stands = replace(row, motion=STANDS)
        for number in range(20):
            pose = placer_of(free).place(row, stream(number))
            assert pose == placer_of(free).place(as_it_stands, stream(number))


def test_what_hangs_low_is_in_the_way_of_turning() -> None:
    """Under a shelf on high legs nobody who walks arrives, nor where it would touch it turning."""
    free, row = np.ones((8, 8), np.bool_), row_of(1.2, 0.6, motion=TURNS)
    grid = environment_of(free).grid
    shelf = np.zeros((8, 8, 10), np.uint8)
    shelf[2:4, 5:7, 5:] = 1
    above = VoxelMap(RigidTransform.identity(), (1.0, 1.0, 0.1), shelf)
    environment = Environment(grid, classify(grid, 65, 25), above, PlaneGround(0.0), 0.06)
    placer = Placer(environment, region_of(free))
    poses = _array([placer.place(row, stream(number)) for number in range(300)])
    open_below = free.copy()
    open_below[5:7, 2:4] = False
    assert turns_free(row, poses[:, :2], open_below).all()


def test_a_group_stays_near_its_first_member_uniformly() -> None:
    """Points within 2.5 m of the first: uniform over the free part of the disc, 1/1,000."""
    free = free_cells(ROOMS)
    disc = PlacementConstraints(within=(4.0, 4.0, 2.5))
    placer = placer_of(free)
    row = row_of(0.0, 0.0)
    placed = [placer.place(row, stream(number), disc) for number in range(2000)]
    poses = _array(placed)
    assert len(poses) == 2000
    assert np.hypot(poses[:, 0] - 4.0, poses[:, 1] - 4.0).max() <= 2.5
    tries = np.random.default_rng(5).random((20000, 3)) * (10.0, 8.0, math.tau)
    near = np.hypot(tries[:, 0] - 4.0, tries[:, 1] - 4.0) <= 2.5
    oracle = tries[near & free[tries[:, 1].astype(np.int64), tries[:, 0].astype(np.int64)]]
    assert _same_law(poses, oracle) > 1e-3
    outside = PlacementConstraints(within=(-50.0, 3.0, 2.0))
    assert placer.place(row, stream(1), outside) is None


def test_a_turned_map_with_high_ground_agrees_with_the_environment() -> None:
    """Poses on a fine, turned and shifted grid are placeable boxes on the ground's height."""
    free = np.kron(free_cells(ROOMS), np.ones((5, 5), np.bool_))
    environment = environment_of(free, 0.2, RigidTransform.planar(30.0, -7.0, 2.2), ground_m=0.3)
    placer = Placer(environment, region_of(free))
    row = row_of(1.2, 0.5, (0.2, 0.05))
    placed = [placer.place(row, stream(number)) for number in range(100)]
    poses = [pose for pose in placed if pose is not None]
    boxes = boxes_of([row] * len(poses), poses)
    assert len(poses) == 100
    assert environment.is_placeable(boxes).all()
    np.testing.assert_allclose(boxes.centres_m[:, 2] - boxes.half_sizes_m[:, 2], 0.3)


def test_what_is_not_allowed_is_refused() -> None:
    """A predicate on boxes confines them to x > 7; one that refuses all blocks."""
    placer, row = placer_of(free_cells(ROOMS)), row_of(0.4, 0.4)
    right = PlacementConstraints(allowed=lambda boxes: boxes.centres_m[:, 0] > 7.0)
    poses = _array([placer.place(row, stream(number), right) for number in range(50)])
    assert len(poses) == 50
    assert poses[:, 0].min() > 7.0
    nowhere = PlacementConstraints(allowed=lambda boxes: np.zeros(len(boxes), np.bool_))
    assert placer.place(row, stream(1), nowhere) is None


@pytest.mark.parametrize(
    "row", [row_of(0.8, 0.4, motion=motion) for motion in (STANDS, TURNS, DRIVES)]
)
def test_memory_and_distant_neighbours_change_no_draw(row: CatalogueRow) -> None:
    """The same stream gives the same pose in a fresh placer, after blocked ones, beside others."""
    free, huge = free_cells(ROOMS), row_of(9.0, 9.0)
    used = placer_of(free)
    assert used.place(huge, stream(3)) is None
    expected = used.place(row, stream(7))
    assert expected is not None
    assert placer_of(free).place(row, stream(7)) == expected
    far = GroundPose(1.5 if expected.x_m > 5.0 else 8.0, 6.5, 0.0, 0.0)
    others = boxes_of([row_of(0.2, 0.2)], [far])
    assert used.place(row, stream(7), PlacementConstraints(others)) == expected


def test_a_lattice_of_very_many_cells_is_thinned_evenly() -> None:
    """Of 600 x 600 cells of 1 cm every fifth row and column stay, and a full slot is found."""
    free = np.ones((600, 600), np.bool_)
    environment = environment_of(free, 0.01)
    placer = Placer(environment, region_of(free))
    thinned = lattice_cells(environment.grid, placer._cells.flat)
    rows, cols = np.divmod(np.sort(thinned), 600)
    assert thinned.size == 120 * 120
    assert set(rows % 5) == set(cols % 5) == {2}
    few = lattice_cells(environment.grid, np.arange(1000, dtype=np.int32))
    assert few.size == 1000
    corner = PlacementConstraints(allowed=lambda boxes: boxes.centres_m[:, :2].max(axis=1) < 0.06)
    pose = placer.place(row_of(0.0, 0.0), stream(1), corner)
    assert pose is not None
    assert max(pose.x_m, pose.y_m) < 0.06


def test_an_empty_region_has_no_place() -> None:
    """Nowhere to arrive means blocked, for points too."""
    free = free_cells(ROOMS)
    placer = Placer(environment_of(free), region_of(np.zeros_like(free)))
    assert placer.place(row_of(0.0, 0.0), stream(1)) is None


def test_cells_of_equal_clearance_keep_their_order() -> None:
    """More clearance first, by quarters of a cell and up to a bound; of equal cells the first."""
    generator = np.random.default_rng(2)
    clearance = generator.choice([0.0, 0.3, 1.0, 1.2, 7.7, 16384.0, 1e6], 5000).astype(np.float32)
    flat = generator.permutation(9000)[:5000].astype(np.int32)
    cells = CandidateCells.ordered(flat, clearance)
    levels = np.minimum(clearance * 4, 65535).astype(int)
    order = np.argsort(-levels, kind="stable")
    np.testing.assert_array_equal(cells.flat, flat[order])
    np.testing.assert_array_equal(cells.depths, 65535 - levels[order])


@given(levels=st.lists(st.floats(1.0, 20.0), min_size=1, max_size=30), radius=st.floats(0.0, 25.0))
def test_cells_with_room_are_those_with_clearance(levels: list[float], radius: float) -> None:
    """The prefix holds every cell with the clearance, and none that lacks half a cell of it."""
    clearance = np.array(levels, np.float32)
    cells = CandidateCells.ordered(np.arange(len(levels), dtype=np.int32), clearance)
    np.testing.assert_array_equal(
        cells.flat, np.argsort(-(clearance * 4).astype(int), kind="stable")
    )
    kept = set(cells.with_room(radius).flat.tolist())
    assert set(np.flatnonzero(clearance >= radius - 0.2072).tolist()) <= kept
    assert kept <= set(np.flatnonzero(clearance >= radius - 0.71).tolist())
