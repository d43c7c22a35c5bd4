"""Tests of the map that decisions are made on."""

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from are_ros.agents.mdp.coarse_map import WALL_COMFORT_M, CoarseMap, CoarseMaps
from are_ros.agents.navigation.ground import heading_of
from tests.agents.floors import joins_within, local_components, terrain_of, two_rooms

DOOR_CELLS = 16  # of 0.05 m: 0.8 m
STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0))


def sides_join(coarse: CoarseMap, rows: int, cols: int) -> bool:
    """Tell whether the near left corner of a floor is joined with the far right one."""
    near = coarse.cell_of(*coarse.grid.cells_to_points([(8, 8)])[0])
    far = coarse.cell_of(*coarse.grid.cells_to_points([(rows - 9, cols - 9)])[0])
    assert near is not None
    assert far is not None
    return bool(coarse.components[near] == coarse.components[far])


@pytest.mark.parametrize("radius_m", [0.2, 0.25, 0.3, 0.35])
@pytest.mark.parametrize("thickness", [1, 2, 4, 7])
def test_a_door_of_80_cm_stays_open_wherever_it_lies(thickness: int, radius_m: float) -> None:
    """At each place of wall and door relative to the coarse cells, in walls along both axes."""
    for across, along in product(range(10), range(10)):
        wall = slice(40 + across, 40 + across + thickness)
        door = slice(30 + along, 30 + along + DOOR_CELLS)
        walls = two_rooms(80, 90, wall, door)
        for floor in (walls, np.ascontiguousarray(walls.T)):
            coarse = CoarseMap(terrain_of(floor), radius_m)
            assert sides_join(coarse, *floor.shape), (across, along)


@pytest.mark.parametrize("door_cells", [0, 4, 8])
def test_a_wall_of_one_cell_never_leaks(door_cells: int) -> None:
    """Neither without a door, nor where it is too narrow for the disc, wherever it lies."""
    for across, along in product(range(10), range(0, 10, 3)):
        door = slice(30 + along, 30 + along + door_cells)
        walls = two_rooms(80, 90, slice(40 + across, 41 + across), door)
        coarse = CoarseMap(terrain_of(walls), 0.25)
        assert not sides_join(coarse, 80, 90), (across, along)


@pytest.mark.parametrize("radius_m", [0.0, 0.1])
def test_a_wall_does_not_leak_for_the_thinnest(radius_m: float) -> None:
    """A body without extent does not slip through a wall of one cell, straight or stepped."""
    walls = np.eye(60, dtype=np.bool_) | np.eye(60, k=1, dtype=np.bool_)
    coarse = CoarseMap(terrain_of(walls), radius_m)
    below, above = coarse.cell_of(2.5, 0.5), coarse.cell_of(0.5, 2.5)
    assert below is not None
    assert above is not None
    assert coarse.components[below] != coarse.components[above]


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6))
def test_cells_anchors_and_edges_are_those_of_the_definition(seed: int) -> None:
    """On random clutter, against components labelled block by block by scipy."""
    random = np.random.default_rng(seed)
    walls = random.random((23, 31)) < random.choice([0.02, 0.1, 0.4])
    terrain = terrain_of(walls, resolution_m=0.1)
    coarse = CoarseMap(terrain, radius_m=0.05)
    fits = terrain.clearance_m >= np.float32(0.1)
    found = local_components(fits, 5)
    assert {tuple(cell) for cell in np.argwhere(coarse.components >= 0).tolist()} == set(found)
    for cell, component in found.items():
        anchor = terrain.grid.points_to_cells(coarse.anchors_m[cell][None])[0]
        assert component[tuple(anchor)]
        best_m = terrain.clearance_m[component].max() - 0.1
        assert coarse.room_m[cell] >= min(best_m, WALL_COMFORT_M) - 1e-6
    for direction, (row, col) in product(range(4), np.ndindex(coarse.shape)):
        other = (row + STEPS[direction][0], col + STEPS[direction][1])
        expected = joins_within(fits, 5, found, (row, col), other)
        assert coarse.edges[direction, row, col] == expected


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6))
def test_components_are_what_edges_join(seed: int) -> None:
    """Neighbours with an open edge have one number; what edges do not join has several."""
    walls = np.random.default_rng(seed).random((40, 40)) < 0.06
    coarse = CoarseMap(terrain_of(walls, resolution_m=0.1), radius_m=0.1)
    numbers = coarse.components
    pairs = []
    for direction, (row, col) in product(range(4), np.ndindex(coarse.shape)):
        if coarse.edges[direction, row, col]:
            other = (row + STEPS[direction][0], col + STEPS[direction][1])
            assert numbers[row, col] == numbers[other] >= 0
            pairs.append((row * coarse.shape[1] + col, other[0] * coarse.shape[1] + other[1]))
    assert len(set(numbers[numbers >= 0].tolist())) == _component_count(numbers, pairs)


def _component_count(numbers: np.ndarray, pairs: list[tuple[int, int]]) -> int:
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    rows, cols = np.array(pairs, np.int64).reshape(-1, 2).T
    graph = coo_matrix((np.ones(len(pairs)), (rows, cols)), shape=(numbers.size, numbers.size))
    count = int(connected_components(graph)[0])
    return count - int((numbers < 0).sum())


def test_of_two_parts_of_a_cell_the_larger_counts() -> None:
    """A cell that a wall divides stands for its larger part, and joins that part's neighbours."""
    walls = np.zeros((10, 30), np.bool_)
    walls[:, 13] = True
    coarse = CoarseMap(terrain_of(walls, resolution_m=0.1), radius_m=0.0, cell_size_m=1.0)
    assert coarse.edges[0, 0].tolist() == [False, True, False]
    assert 1.4 < coarse.anchors_m[0, 1, 0] < 2.0


def test_the_anchor_has_most_room_and_then_is_most_central() -> None:
    """Next to a wall it lies away from it, and in the middle of its cell along the wall."""
    walls = np.zeros((50, 50), np.bool_)
    walls[:, :2] = True
    coarse = CoarseMap(terrain_of(walls), 0.2)
    column, row = coarse.anchors_m[2, 0]
    assert column == pytest.approx(0.475)
    assert abs(row - 1.25) == pytest.approx(0.025)
    assert coarse.room_m[2, 0] == pytest.approx(8 * 0.05 - 0.225)


def test_in_the_open_anchors_are_in_the_middle() -> None:
    """Where there is room enough everywhere they are as far apart as the cells."""
    coarse = CoarseMap(terrain_of(np.zeros((90, 90), np.bool_)), 0.1)
    steps_m = np.diff(coarse.anchors_m[2:7, 2:7], axis=0)
    np.testing.assert_allclose(steps_m, np.broadcast_to((0.0, 0.5), steps_m.shape), atol=1e-9)


@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, math.pi / 2, -2.5])
def test_a_turned_map_gives_the_same_cells_elsewhere(yaw_rad: float) -> None:
    """Origin and rotation move the anchors, and turn the headings; cells and edges stay."""
    walls = two_rooms(60, 70, slice(33, 35), slice(20, 36))
    plain = CoarseMap(terrain_of(walls), 0.25)
    turned = CoarseMap(terrain_of(walls, origin_m=(3.0, -7.0), yaw_rad=yaw_rad), 0.25)
    assert (turned.edges == plain.edges).all()
    assert (turned.components == plain.components).all()
    spin = np.array(
        [[math.cos(yaw_rad), math.sin(yaw_rad)], [-math.sin(yaw_rad), math.cos(yaw_rad)]]
    )
    expected = plain.anchors_m @ spin + (3.0, -7.0)
    np.testing.assert_allclose(turned.anchors_m, expected, atol=1e-9)
    for row, col in np.argwhere(turned.components >= 0).tolist():
        assert turned.cell_of(*turned.anchors_m[row, col]) == (row, col)
    for heading in range(4):
        for off_rad in (-0.7, 0.0, 0.7, 2 * math.pi):
            yaw = yaw_rad + heading * math.pi / 2 + off_rad
            assert heading_of(turned.ground.lattice, yaw) == heading


def test_a_point_by_a_wall_belongs_to_the_cell_on_its_own_side() -> None:
    """Where the disc does not fit, the cell is the nearest one that no wall hides."""
    walls = two_rooms(60, 60, slice(30, 31), None)
    coarse = CoarseMap(terrain_of(walls), 0.25)
    for col in range(25, 30):
        cell = coarse.cell_of((col + 0.5) * 0.05, 1.525)
        assert cell == (3, 2)
    for col in range(31, 36):
        cell = coarse.cell_of((col + 0.5) * 0.05, 1.525)
        assert cell == (3, 3)
        assert not coarse.holds((col + 0.5) * 0.05, 1.525)
    assert coarse.holds(1.0, 1.525)


def test_the_part_of_a_cell_that_does_not_count_leads_to_its_own_neighbour() -> None:
    """A point in the smaller part of a divided cell is taken to the side it can go to."""
    walls = np.zeros((10, 30), np.bool_)
    walls[:, 13] = True
    coarse = CoarseMap(terrain_of(walls, resolution_m=0.1), radius_m=0.0, cell_size_m=1.0)
    assert coarse.cell_of(1.25, 0.5) == (0, 0)
    assert coarse.cell_of(1.45, 0.5) == (0, 1)


def test_points_in_walls_and_outside() -> None:
    """From within a wall the nearest side counts; far from everything and outside, none does."""
    walls = two_rooms(100, 160, slice(40, 140), None)
    coarse = CoarseMap(terrain_of(walls), 0.25)
    assert coarse.cell_of(2.2, 2.5) == (5, 3)
    assert coarse.cell_of(4.5, 2.5) is None
    assert coarse.cell_of(-0.1, 2.5) is None
    assert coarse.cell_of(math.nan, 2.5) is None


def test_a_map_without_room_has_no_open_cell() -> None:
    """All is closed, and every question is answered with none."""
    coarse = CoarseMap(terrain_of(np.ones((30, 30), np.bool_)), 0.25)
    assert (coarse.components == -1).all()
    assert not coarse.edges.any()
    assert np.isnan(coarse.anchors_m).all()
    assert coarse.cell_of(0.5, 0.5) is None


@pytest.mark.parametrize(
    ("resolution_m", "cell_size_m", "expected_m"),
    [(0.05, 0.5, 0.5), (0.03, 0.5, 0.51), (1.0, 0.5, 1.0), (0.5, 0.5, 0.5)],
)
def test_the_cell_size_is_a_multiple_of_the_resolution(
    resolution_m: float, cell_size_m: float, expected_m: float
) -> None:
    """The nearest one, and never less than one cell of the grid."""
    terrain = terrain_of(np.zeros((40, 33), np.bool_), resolution_m)
    coarse = CoarseMap(terrain, 0.0, cell_size_m)
    assert coarse.cell_size_m == pytest.approx(expected_m)
    side = round(expected_m / resolution_m)
    assert coarse.shape == (-(-40 // side), -(-33 // side))


def test_the_rooms_of_a_large_clutter_are_those_of_the_fine_map() -> None:
    """Two anchors with one number are joined on the fine map, too (the converse may fail)."""
    walls = np.random.default_rng(5).random((200, 200)) < 0.01
    terrain = terrain_of(walls)
    coarse = CoarseMap(terrain, 0.2)
    fine, _ = ndimage.label(terrain.clearance_m >= np.float32(0.225))
    cells = terrain.grid.points_to_cells(coarse.anchors_m[coarse.components >= 0])
    labels = fine[cells[:, 0], cells[:, 1]]
    numbers = coarse.components[coarse.components >= 0]
    assert len(set(zip(numbers.tolist(), labels.tolist(), strict=True))) == numbers.max() + 1


def test_maps_are_kept_by_version_height_and_radius() -> None:
    """Radii are rounded up to 1 cm, large ones to 5; what is asked for again is not made again."""
    maps = CoarseMaps()
    walls = np.zeros((40, 40), np.bool_)
    old, new = terrain_of(walls, version=1), terrain_of(walls, version=2)
    first = maps.of(old, 0.241)
    assert first.radius_m == pytest.approx(0.25)
    assert maps.of(old, 0.25) is first
    assert maps.of(old, 0.251) is not first
    assert maps.of(new, 0.25) is not first
    assert maps.of(old, 0.25) is first
    assert maps.of(old, 0.51).radius_m == pytest.approx(0.55)


def test_only_the_latest_maps_are_kept() -> None:
    """After many others the first is made anew."""
    maps = CoarseMaps()
    walls = np.zeros((20, 20), np.bool_)
    first = maps.of(terrain_of(walls, version=0), 0.1)
    for version in range(1, 65):
        maps.of(terrain_of(walls, version=version), 0.1)
    assert maps.of(terrain_of(walls, version=0), 0.1) is not first
