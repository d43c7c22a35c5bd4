"""Where vehicles can set out, against boxes that are put along six arcs one by one."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from are_ros.agents.body import Body
from are_ros.agents.mdp.coarse_map import CoarseMaps, rounded_up_m
from are_ros.agents.navigation.profile import NavigationProfile
from are_ros.agents.navigation.terrain import Terrains
from are_ros.builder.spawning._departure_constraint import (
    LEAST_PART_M,
    DepartureConstraint,
    VehicleDepartureCheck,
    departure_constraint_of,
    discs_are_free,
)
from are_ros.population.catalogue import CatalogueRow, MotionLimits
from are_ros.world.rigid_transform import RigidTransform
from tests.builder.spawning.slow_placement import (
    DRIVES,
    TURNS,
    Floats,
    Mask,
    drives_off,
    environment_of,
    row_of,
    sets_out,
)


def setting_out(row: CatalogueRow, free: Mask) -> VehicleDepartureCheck:
    """Return what a vehicle needs on a map of 1 m cells, all of it its region."""
    constraint = departure_constraint_of(row, environment_of(free), Terrains(), np.ones_like(free))
    assert isinstance(constraint, VehicleDepartureCheck)
    return constraint


def lifted(poses: Floats) -> Floats:
    """Return poses (N, 4), x, y, 0, yaw, of poses (N, 3)."""
    return np.insert(poses, 2, 0.0, axis=1)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    share=st.floats(0.0, 0.2),
    sizes=st.tuples(st.floats(0.2, 4.0), st.floats(0.2, 2.0)),
    offset=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
    radius_m=st.floats(0.3, 6.0),
)
def test_first_metres_are_free_where_boxes_along_them_are(
    seed: int,
    share: float,
    sizes: tuple[float, float],
    offset: tuple[float, float],
    radius_m: float,
) -> None:
    """Random clutter, vehicles and poses; where a box just touches either answer will do."""
    random = np.random.default_rng(seed)
    free = random.random((9, 12)) >= share
    motion = MotionLimits(speed_mps=1.0, turn_radius_m=radius_m)
    row = row_of(*sizes, (offset[0] * sizes[0], offset[1] * sizes[1]), motion)
    poses = random.random((60, 3)) * (12.0, 9.0, math.tau)
    found = setting_out(row, free).leads_out(lifted(poses))
    assert not (found & ~drives_off(row, poses, free, 1e-5)).any()
    assert not (drives_off(row, poses, free, -1e-5) & ~found).any()


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 0.2), length_m=st.floats(0.5, 3.0))
def test_it_sets_out_where_a_way_leads_on_and_its_first_metres_are_free(
    seed: int, share: float, length_m: float
) -> None:
    """Both together, on random clutter, against the slow twin."""
    random = np.random.default_rng(seed)
    free = random.random((9, 12)) >= share
    row, poses = row_of(length_m, 0.7, motion=DRIVES), random.random((60, 3))
    poses *= (12.0, 9.0, math.tau)
    constraint = setting_out(row, free)
    found = constraint.is_free_at(poses) & constraint.leads_out(lifted(poses))
    if not (sets_out(row, poses, free, -1e-5) ^ sets_out(row, poses, free, 1e-5)).any():
        np.testing.assert_array_equal(found, sets_out(row, poses, free))


def test_a_map_that_is_turned_and_fine_gives_the_same() -> None:
    """Ten cells to the metre, turned by a radian: arcs of the same length, in finer steps."""
    random = np.random.default_rng(3)
    coarse = random.random((9, 12)) >= 0.1
    row, poses = row_of(1.6, 0.8, motion=DRIVES), random.random((200, 3)) * (12.0, 9.0, math.tau)
    fine = np.kron(coarse, np.ones((10, 10), np.bool_))
    origin = RigidTransform.planar(3.0, -2.0, 1.0)
    environment = environment_of(fine, 0.1, origin)
    constraint = departure_constraint_of(row, environment, Terrains(), np.ones_like(fine))
    assert constraint is not None
    turned = (poses[:, 0] + 1j * poses[:, 1]) * np.exp(1j) + complex(3.0, -2.0)
    moved = np.column_stack((turned.real, turned.imag, poses[:, 2] + 1.0))
    found = constraint.leads_out(lifted(moved))
    assert 20 < found.sum() < 180
    assert not (found & ~drives_off(row, poses, coarse, 1e-6)).any()


def test_a_car_between_two_walls_does_not_set_out_and_one_with_room_behind_does() -> None:
    """In a slot of its width: 0.2 m before and behind it, or as much as it turns on behind."""
    row = row_of(2.6, 0.9, motion=DRIVES)
    for cells, is_out in ((3, False), (5, True)):
        free = np.zeros((3, 8), np.bool_)
        free[1, 1 : 1 + cells] = True
        pose = np.array([[float(cells) - 0.5, 1.5, 0.0, 0.0]])
        assert setting_out(row, free).leads_out(pose).tolist() == [is_out]


def test_a_part_too_short_for_a_trip_is_a_pocket() -> None:
    """Of two rooms, seven cells and six cells long, those of 2.6 m or more are roamed."""
    free = np.zeros((9, 20), np.bool_)
    free[1:8, 1:8] = free[1:7, 10:12] = True
    body, points = Body.of(row_of(0.4, 0.2, motion=DRIVES)), np.array([(4.5, 4.5), (11.0, 4.5)])
    for cell_m, expected in ((1.0, [True, True]), (0.4, [True, False]), (0.3, [False, False])):
        terrain = Terrains().of(environment_of(free, cell_m), 1.0)
        roaming = VehicleDepartureCheck(terrain, body, 0.1, np.ones_like(free))
        assert discs_are_free(terrain.clearance_m, terrain.lattice, cell_m * points, 0.1).all()
        assert roaming.is_free_at(cell_m * points).tolist() == expected
        assert roaming.is_anywhere == any(expected)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 0.6), cell_m=st.floats(0.2, 1.0))
def test_of_the_large_parts_those_with_a_cell_of_the_region_count(
    seed: int, share: float, cell_m: float
) -> None:
    """Random clutter and regions, asked about in random order, against all parts labelled."""
    random = np.random.default_rng(seed)
    free, region = random.random((20, 25)) >= share, random.random((20, 25)) < 0.03
    terrain = Terrains().of(environment_of(free, cell_m), 1.0)
    body, radius_m = Body.of(row_of(0.4, 0.2, motion=DRIVES)), 0.1
    labels, _ = ndimage.label(free)  # cells are wider than the disc
    large = np.zeros_like(free)
    for number, slices in enumerate(ndimage.find_objects(labels), 1):
        is_long = max(side.stop - side.start for side in slices) * cell_m >= LEAST_PART_M
        large |= (labels == number) & (is_long and region[labels == number].any())
    expected = ndimage.binary_dilation(large, np.ones((3, 3))) & free
    cells = random.permutation(np.argwhere(free))
    check = VehicleDepartureCheck(terrain, body, radius_m, region)
    halves = np.array_split(terrain.grid.cells_to_points(cells), 2)
    found = np.concatenate([check.is_free_at(points_m) for points_m in halves])
    np.testing.assert_array_equal(found, expected[tuple(cells.T)])
    assert check.is_anywhere == large.any()
    assert VehicleDepartureCheck(terrain, body, radius_m, region).is_anywhere == large.any()


@pytest.mark.parametrize("size_m", [(1.25, 0.58), (2.1, 1.1), (4.3, 1.8), (0.4, 0.4)])
def test_the_disc_is_that_of_the_map_that_ways_are_looked_for_in(
    size_m: tuple[float, float],
) -> None:
    """Its radius is rounded as `CoarseMaps` rounds it."""
    row = row_of(*size_m, motion=DRIVES)
    terrain = Terrains().of(environment_of(np.ones((9, 9), np.bool_)), 1.0)
    radius_m = NavigationProfile.of(row, Body.of(row)).radius_m
    assert CoarseMaps().of(terrain, radius_m).radius_m == rounded_up_m(radius_m)
    assert setting_out(row, np.ones((9, 9), np.bool_)).radius_m == rounded_up_m(radius_m)


def test_what_turns_on_the_spot_leads_out_at_any_heading() -> None:
    """Its disc is all that it needs."""
    free = np.ones((4, 4), np.bool_)
    constraint = departure_constraint_of(
        row_of(0.6, 0.4, motion=TURNS), environment_of(free), Terrains(), free
    )
    assert type(constraint) is DepartureConstraint
    assert constraint.leads_out(np.zeros((3, 4))).all()
