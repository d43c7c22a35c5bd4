"""Walls and free space for boxes, against one test per cell and per voxel."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from are_ros.conventions import FREE, OCCUPIED, UNKNOWN
from are_ros.world.boxes import TOUCH_TOLERANCE_M, OrientedBoxes
from are_ros.world.environment import Environment, PlaneGround, VoxelGround
from are_ros.world.lattice_cover import covered, lattice_row
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap
from tests.world.overlapping import overlaps

_ORIGIN = RigidTransform.planar(-1.0, 0.5, 0.4)


def _grid(
    cells: NDArray[np.int8], resolution_m: float = 0.1, origin: RigidTransform = _ORIGIN
) -> OccupancyGrid:
    return OccupancyGrid(cells, resolution_m, origin, "map")


def _environment(
    grid: OccupancyGrid, voxels: VoxelMap | None = None, clearance_m: float = 0.06
) -> Environment:
    return Environment(grid, classify(grid, 65, 25), voxels, PlaneGround(0.0), clearance_m)


def _scattered(generator: np.random.Generator, shape: tuple[int, int]) -> NDArray[np.int8]:
    """Return free cells with a few unknown and occupied ones."""
    values = np.array([FREE, UNKNOWN, OCCUPIED], dtype=np.int8)
    return values[generator.choice(3, size=shape, p=(0.98, 0.01, 0.01))]


def _boxes_over(grid: OccupancyGrid, count: int, generator: np.random.Generator) -> OrientedBoxes:
    """Return boxes of 5 cm to 2 m in and around a grid."""
    extent = generator.uniform(-0.1, 1.1, (count, 2)) * (grid.width, grid.height)
    local_m = np.column_stack((extent * grid.resolution_m, np.zeros(count)))
    halves_m = 0.025 * 40.0 ** generator.uniform(0.0, 1.0, (count, 3))
    centres_m = grid.origin.apply(local_m)
    centres_m[:, 2] = halves_m[:, 2]
    return OrientedBoxes(centres_m, generator.uniform(-4.0, 4.0, count), halves_m)


def _covered(grid: OccupancyGrid, boxes: OrientedBoxes, i: int) -> tuple[NDArray[np.bool_], bool]:
    """Return the covered cells inside the grid, and whether any is outside."""
    shift = grid.origin @ RigidTransform.planar(-80 * grid.resolution_m, -80 * grid.resolution_m, 0)
    lattice = lattice_row(shift, grid.resolution_m, grid.resolution_m)
    shape = (grid.height + 160, grid.width + 160)
    row, column, patch = covered(boxes.packed, i, lattice, shape, TOUCH_TOLERANCE_M)
    mask = np.zeros(shape, dtype=np.bool_)
    mask[row : row + patch.shape[0], column : column + patch.shape[1]] = patch
    inner = mask[80:-80, 80:-80]
    return inner, bool(np.count_nonzero(inner) < np.count_nonzero(mask))


@pytest.mark.parametrize("resolution_m", [0.02, 0.1])
def test_leaping_over_free_space_misses_no_cell(resolution_m: float) -> None:
    """Boxes hit a wall or are placeable just as their covered cells, one by one, say.

    Cells outside the grid are walls.
    """
    generator = np.random.default_rng(7)
    grid = _grid(_scattered(generator, (40, 60)), resolution_m)
    classes = classify(grid, 65, 25)
    boxes = _boxes_over(grid, 300, generator)
    environment = _environment(grid)
    hits, placeable = environment.hits_wall(boxes), environment.is_placeable(boxes)
    for i in range(len(boxes)):
        cells, is_outside = _covered(grid, boxes, i)
        assert hits[i] == (is_outside or (cells & classes.occupied).any())
        assert placeable[i] == (not is_outside and bool(classes.free[cells].all()))
    assert 20 < np.count_nonzero(hits) < 290
    assert 5 < np.count_nonzero(placeable) < 280


def test_clearance_is_the_distance_to_the_nearest_centre() -> None:
    """Compared with all pairs of cells; cells around the grid count as not free."""
    cells = _scattered(np.random.default_rng(1), (12, 17))
    grid = _grid(cells, 0.25)
    padded = np.pad(cells, 1, constant_values=UNKNOWN)
    blocked = np.argwhere(padded != FREE) - 1
    centres = np.argwhere(np.ones_like(cells))
    apart = np.hypot(*(centres[:, None] - blocked[None]).transpose(2, 0, 1)).min(axis=1)
    clearance = _environment(grid).clearance_m
    assert clearance.dtype == np.float32
    assert np.allclose(clearance.ravel(), 0.25 * apart, rtol=1e-6)


def test_lookup_gives_the_clearance_of_points() -> None:
    """The middle of a 5 x 5 grid of 0.1 m is 0.3 m from the cells outside; a far point has 0."""
    environment = _environment(_grid(np.zeros((5, 5), dtype=np.int8)))
    points_m = np.vstack((environment.grid.cells_to_points([[2, 2]]), [[50.0, 50.0]]))
    assert environment.lookup(points_m) == pytest.approx([0.3, 0.0])


def test_outside_the_map_is_a_wall() -> None:
    """A box half or wholly outside hits it; unknown cells are no wall, but not placeable."""
    cells = np.zeros((20, 20), dtype=np.int8)
    cells[:, 15:] = UNKNOWN
    grid = _grid(cells, 0.1, RigidTransform.planar(0.0, 0.0, 0.0))
    centres_m = [[0.0, 1.0, 1.0], [-9.0, 1.0, 1.0], [1.5, 1.0, 1.0], [1.0, 1.0, 1.0]]
    boxes = OrientedBoxes(np.array(centres_m), np.zeros(4), np.full((4, 3), 0.5))
    environment = _environment(grid)
    assert environment.hits_wall(boxes).tolist() == [True, True, False, False]
    assert environment.is_placeable(boxes).tolist() == [False, False, False, True]


def test_a_box_against_the_edge_of_the_map_only_touches_it() -> None:
    """Flush with the edge is inside, a millimetre beyond is a hit: on each side, and turned."""
    for yaw_rad in (0.0, 0.7):
        origin = RigidTransform.planar(3.0, -2.0, yaw_rad)
        grid = _grid(np.zeros((10, 20), dtype=np.int8), 0.1, origin)
        for beyond_m in (0.0, 0.001):
            low, x_high, y_high = 0.2 - beyond_m, 1.8 + beyond_m, 0.8 + beyond_m
            local_m = [[low, 0.5, 1.0], [x_high, 0.5, 1.0], [1.0, low, 1.0], [1.0, y_high, 1.0]]
            centres_m = origin.apply(np.array(local_m))
            boxes = OrientedBoxes(centres_m, np.full(4, yaw_rad), np.full((4, 3), 0.2))
            environment = _environment(grid)
            assert environment.hits_wall(boxes).tolist() == [beyond_m > 0.0] * 4
            assert environment.is_placeable(boxes).tolist() == [beyond_m == 0.0] * 4


def test_a_box_larger_than_the_map_hits_its_outside() -> None:
    """On a map that became a single cell, and far beside it."""
    environment = _environment(_grid(np.zeros((1, 1), dtype=np.int8)))
    centres_m = np.array([[-1.0, 0.5, 1.0], [-1.0, 0.6, 1.0], [1e6, 0.5, 1.0], [-9.0, -9e5, 1.0]])
    boxes = OrientedBoxes(centres_m, np.arange(4.0), np.full((4, 3), 0.3))
    assert environment.hits_wall(boxes).all()


def test_a_box_against_a_wall_only_touches_it() -> None:
    """Flush with a wall is placeable; a millimetre into it is a hit."""
    cells = np.zeros((10, 10), dtype=np.int8)
    cells[:, 7] = OCCUPIED
    grid = _grid(cells, 0.1, RigidTransform.planar(0.0, 0.0, 0.0))
    centres_m = np.array([[0.5, 0.5, 1.0], [0.501, 0.5, 1.0]])
    boxes = OrientedBoxes(centres_m, np.zeros(2), np.full((2, 3), 0.2))
    assert _environment(grid).hits_wall(boxes).tolist() == [False, True]
    assert _environment(grid).is_placeable(boxes).tolist() == [True, False]


def _slow_voxel_hits(
    voxels: VoxelMap, boxes: OrientedBoxes, floors_m: NDArray[np.float64], clearance_m: float
) -> NDArray[np.bool_]:
    """Test each occupied voxel as an oriented box, unless its top is within the floor."""
    centres_m = voxels.centres_m()
    count = len(centres_m)
    yaw = np.full(count, voxels.map_from_lattice.yaw_rad())
    halves_m = np.tile(0.5 * np.array(voxels.voxel_size_m), (count, 1))
    cuboids = OrientedBoxes(centres_m, yaw, halves_m)
    tops_m = centres_m[:, 2] + halves_m[:, 2]
    return np.array(
        [
            (overlaps(boxes.at(i), cuboids) & (tops_m > floors_m[i] + clearance_m + 1e-9)).any()
            for i in range(len(boxes))
        ]
    )


@given(st.integers(0, 10_000), st.sampled_from([(0.1, 0.1, 0.1), (0.1, 0.25, 0.07)]))
def test_voxels_are_hit_as_oriented_boxes_are(
    seed: int, size_m: tuple[float, float, float]
) -> None:
    """On a turned lattice, also of unequal sizes: one separating-axis test per voxel agrees."""
    generator = np.random.default_rng(seed)
    lattice = RigidTransform.planar(-0.5, 0.2, generator.uniform(-3.0, 3.0), z=-0.1)
    occupied = (generator.random((12, 10, 6)) < 0.02).astype(np.uint8)
    voxels = VoxelMap(lattice, size_m, occupied)
    grid = _grid(np.zeros((60, 60), dtype=np.int8), 0.1, RigidTransform.planar(-3.0, -3.0, 0.0))
    environment = _environment(grid, voxels)
    boxes = _boxes_over(grid, 40, generator)
    expected = _slow_voxel_hits(voxels, boxes, np.zeros(40), 0.06)
    expected |= _environment(grid).hits_wall(boxes)
    assert np.array_equal(environment.hits_wall(boxes), expected)
    free = _environment(grid).is_placeable(boxes)
    assert np.array_equal(environment.is_placeable(boxes), free & ~expected)


def test_voxels_of_the_floor_are_no_collision() -> None:
    """A floor whose top is within the clearance is stood upon; a voxel above it is hit."""
    occupied = np.zeros((20, 20, 8), dtype=np.uint8)
    occupied[:, :, 0] = 1
    occupied[10, 10, 1] = 1
    voxels = VoxelMap(RigidTransform.planar(0.0, 0.0, 0.0, z=-0.05), (0.1, 0.1, 0.1), occupied)
    grid = _grid(np.zeros((20, 20), dtype=np.int8), 0.1, RigidTransform.planar(0.0, 0.0, 0.0))
    centres_m = np.array([[0.5, 0.5, 0.3], [1.0, 1.0, 0.3]])
    boxes = OrientedBoxes(centres_m, np.zeros(2), np.full((2, 3), 0.3))
    assert _environment(grid, voxels, 0.05).hits_wall(boxes).tolist() == [False, True]
    assert _environment(grid, voxels, 0.04).hits_wall(boxes).tolist() == [True, True]


def test_the_floor_is_that_under_each_box() -> None:
    """On a ground found in voxels a box stands on a terrace of 0.2 m, and another hits its step."""
    occupied = np.zeros((20, 10, 8), dtype=np.uint8)
    occupied[:, :, 0] = 1
    occupied[10:, :, :2] = 1
    voxels = VoxelMap(RigidTransform.planar(0.0, 0.0, 0.0), (0.1, 0.1, 0.1), occupied)
    grid = _grid(np.zeros((10, 20), dtype=np.int8), 0.1, RigidTransform.planar(0.0, 0.0, 0.0))
    ground = VoxelGround.from_voxels(voxels, plane_height_m=0.1)
    environment = Environment(grid, classify(grid, 65, 25), voxels, ground, 0.02)
    centres_m = np.array([[0.5, 0.5, 0.4], [1.5, 0.5, 0.5], [0.9, 0.5, 0.4]])
    boxes = OrientedBoxes(centres_m, np.zeros(3), np.full((3, 3), 0.3))
    assert environment.ground_heights_m(boxes) == pytest.approx([0.1, 0.2, 0.1])
    assert environment.hits_wall(boxes).tolist() == [False, False, True]


def test_extruded_walls_are_implied_by_the_grid() -> None:
    """With or without its extrusion, a grid gives the same answers."""
    generator = np.random.default_rng(3)
    grid = _grid(_scattered(generator, (30, 30)))
    walls = VoxelMap.extruded(grid, classify(grid, 65, 25).occupied, 2.0, 0.0)
    boxes = _boxes_over(grid, 100, generator)
    bare, walled = _environment(grid), _environment(grid, walls)
    assert np.array_equal(bare.hits_wall(boxes), walled.hits_wall(boxes))
    assert np.array_equal(bare.is_placeable(boxes), walled.is_placeable(boxes))


def test_no_boxes_and_no_free_cell_are_fine() -> None:
    """An empty set gives an empty answer; on a map without free cells nothing is placeable."""
    environment = _environment(_grid(np.full((4, 4), UNKNOWN, dtype=np.int8)))
    assert environment.hits_wall(OrientedBoxes.empty()).shape == (0,)
    box = OrientedBoxes(np.zeros((1, 3)), np.zeros(1), np.full((1, 3), 0.01))
    assert not environment.is_placeable(box)[0]
