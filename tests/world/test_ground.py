"""The floor among voxels: small scenes that can be read, slow twins, and a real ship."""

from collections import deque
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.world.environment import (
    Ground,
    PlaneGround,
    VoxelGround,
    filled_from_nearest,
    flood_floor,
    surface_counts,
)
from are_ros.world.map_io import read_map_file
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_files.octomap import read_octomap_file
from are_ros.world.voxel_map import VoxelMap

SIZE = 0.1
Voxels = npt.NDArray[np.uint8]


def room(nx: int = 40, ny: int = 30, nz: int = 30) -> Voxels:
    """Return an array whose lowest layer is a floor; its top lies at z = 0 in the map."""
    occupied = np.zeros((nx, ny, nz), dtype=np.uint8)
    occupied[:, :, 0] = 1
    return occupied


def ground_of(occupied: Voxels, yaw: float = 0.0, plane_m: float = 0.0) -> VoxelGround:
    """Return the floor of voxels of 10 cm whose first layer ends at z = 0."""
    origin = RigidTransform.planar(0.0, 0.0, yaw, -SIZE)
    return VoxelGround.from_voxels(VoxelMap(origin, (SIZE,) * 3, occupied), plane_m)


def test_a_plane_is_level_everywhere() -> None:
    """Every point has the height of the plane."""
    ground: Ground = PlaneGround(0.3)
    points = np.array([[0.0, 0.0], [1e6, -1e6]])
    assert ground.heights(points).tolist() == [0.3, 0.3]


def test_a_bare_floor_is_seen_in_every_column() -> None:
    """Its top, not its centre, is the height."""
    ground = ground_of(room())
    assert ground.is_seen.all()
    assert ground.heights_m == pytest.approx(0.0)


def test_what_is_not_finite_is_nowhere_else_than_on_the_floor() -> None:
    """A pose that is not finite is refused later, with a sentence."""
    points_m = np.array([[np.nan, 1.0], [np.inf, np.nan], [-np.inf, np.inf]])
    np.testing.assert_allclose(ground_of(room()).heights(points_m), 0.0, atol=1e-12)


def test_walls_tables_boxes_and_ceilings_are_no_floor() -> None:
    """Each rises more than a step, with or without floor below, and takes its neighbours' floor."""
    occupied = room()
    occupied[:, :, 29] = 1
    occupied[0:2, :, :] = 1
    occupied[10:15, 10:15, 7] = 1
    occupied[20:25, 5:10, 0] = 0
    occupied[20:25, 5:10, 7] = 1
    occupied[30:33, 20:23, 0:4] = 1
    ground = ground_of(occupied)
    assert ground.heights_m == pytest.approx(0.0)
    assert not ground.is_seen[0:2].any()
    assert ground.is_seen[10:15, 10:15].all()
    assert not ground.is_seen[20:25, 5:10].any()
    assert not ground.is_seen[30:33, 20:23].any()


def test_a_ramp_is_followed_to_its_platform() -> None:
    """One voxel up in four columns is walkable, so the platform at its end is floor too."""
    occupied = room(80)
    tops = np.clip((np.arange(80) - 20) // 4, 0, 8)
    for i, top in enumerate(tops):
        occupied[i, :, : top + 1] = 1
    ground = ground_of(occupied)
    assert ground.heights_m == pytest.approx(np.broadcast_to(tops[:, None] * SIZE, (80, 30)))


def test_a_platform_without_a_way_up_is_no_floor() -> None:
    """It takes the height of the floor around, and so its voxels stay obstacles."""
    occupied = room()
    occupied[20:, :, 0:9] = 1
    ground = ground_of(occupied)
    assert ground.heights_m == pytest.approx(0.0)
    assert ground.is_seen[:20].all()
    assert not ground.is_seen[20:].any()


def test_a_heap_climbed_voxel_by_voxel_is_cut_off() -> None:
    """Steep sides are no ramp: nothing more than a step and a slope of 0.3 above is kept."""
    occupied = room()
    for top in range(1, 8):
        occupied[20 - 7 + top : 20 + 7 - top, 15 - 7 + top : 15 + 7 - top, top] = 1
    assert ground_of(occupied).heights_m.max() <= 2 * SIZE + 1e-9


def test_the_main_level_is_sought_near_the_plane() -> None:
    """A floor half a metre off is found, a ceiling three metres up is not taken for one."""
    sunk = np.roll(room(), 4, axis=2)
    assert ground_of(sunk).heights_m == pytest.approx(0.4)
    ceiling = np.roll(room(), 28, axis=2)
    assert ground_of(ceiling).heights_m == pytest.approx(0.0)
    assert not ground_of(ceiling).is_seen.any()
    assert ground_of(ceiling, plane_m=2.7).heights_m == pytest.approx(2.8)


def test_of_two_equal_levels_the_lower_is_the_main_one() -> None:
    """The choice does not depend on the order of columns."""
    occupied = room()
    occupied[:20, :, 0:3] = 1
    assert ground_of(occupied).heights_m == pytest.approx(0.0)


def test_an_extruded_map_has_only_the_plane() -> None:
    """Low walls are not taken for a floor."""
    grid = OccupancyGrid(np.zeros((4, 5), np.int8), 0.1, RigidTransform.identity(), "map")
    voxels = VoxelMap.extruded(grid, np.ones((4, 5), np.bool_), 0.3, 0.0)
    ground = VoxelGround.from_voxels(voxels, plane_height_m=0.1)
    assert ground.heights_m == pytest.approx(0.1)
    assert not ground.is_seen.any()


def test_heights_follow_the_lattice_and_reach_beyond_it() -> None:
    """On a turned lattice a point finds its column; beside it, the nearest border column."""
    occupied = room(80)
    for i in range(80):
        occupied[i, :, : 1 + i // 8] = 1
    ground = ground_of(occupied, yaw=2.0)
    turned = RigidTransform.planar(0.0, 0.0, 2.0)
    local = np.array([[0.05, 1.0, 0.0], [4.05, 0.5, 0.0], [99.0, 1.0, 0.0], [-9.0, -9.0, 0.0]])
    assert ground.heights(turned.apply(local)[:, :2]) == pytest.approx([0.0, 0.5, 0.9, 0.0])


def slow_surfaces(column: Voxels) -> list[int]:
    """Return every k with voxel k - 1 occupied and voxel k not."""
    padded = [*column.tolist(), 0]
    return [k for k in range(1, len(padded)) if padded[k - 1] and not padded[k]]


def slow_flood(occupied: Voxels, level: int, step: int) -> dict[tuple[int, int], int]:
    """Return the floor by the rule, column by column, in plain Python."""
    columns = list(np.ndindex(occupied.shape[:2]))
    surfaces = {column: slow_surfaces(occupied[column]) for column in columns}

    def nearest(column: tuple[int, ...], k: int) -> int | None:
        close = [s for s in surfaces[column[0], column[1]] if abs(s - k) <= step]
        return min(close, key=lambda s: (abs(s - k), s), default=None)

    floor: dict[tuple[int, int], int] = {}
    for i, j in columns:
        found = nearest((i, j), level)
        if found is not None:
            floor[i, j] = found
    queue = deque(floor)
    while queue:
        i, j = queue.popleft()
        for column in ((i - 1, j), (i, j - 1), (i, j + 1), (i + 1, j)):
            if column in surfaces and column not in floor:
                found = nearest(column, floor[i, j])
                if found is not None:
                    floor[column] = found
                    queue.append(column)
    return floor


@settings(deadline=None)
@given(seed=st.integers(0, 2**31), step=st.integers(1, 3), level=st.integers(0, 6))
def test_the_flood_agrees_with_its_slow_twin(seed: int, step: int, level: int) -> None:
    """Random voxels, all surfaces and every column's floor."""
    generator = np.random.default_rng(seed)
    shape = tuple(generator.integers(1, 8, 3))
    occupied = (generator.random(shape) < generator.uniform(0.1, 0.6)).astype(np.uint8)
    counts = surface_counts(occupied)
    everything = [k for c in np.ndindex(*shape[:2]) for k in slow_surfaces(occupied[c])]
    assert counts.tolist() == np.bincount(everything or [0], minlength=shape[2] + 1).tolist() or (
        not everything and not counts.any()
    )
    tops = flood_floor(occupied, level, step, -99)
    expected = slow_flood(occupied, level, step)
    assert {(int(i), int(j)): int(tops[i, j]) for i, j in np.argwhere(tops != -99)} == expected


@settings(deadline=None)
@given(seed=st.integers(0, 2**31))
def test_gaps_take_a_nearest_value(seed: int) -> None:
    """Every filled column has the value of one of the columns fewest steps away."""
    generator = np.random.default_rng(seed)
    tops = generator.integers(0, 9, generator.integers(1, 10, 2)).astype(np.int32)
    tops[generator.random(tops.shape) < 0.8] = -99
    filled = filled_from_nearest(tops, -99)
    known = np.argwhere(tops != -99)
    for i, j in np.ndindex(*tops.shape):
        if len(known):
            steps = np.abs(known - (i, j)).sum(axis=1)
            near = known[steps == steps.min()]
            assert filled[i, j] in tops[near[:, 0], near[:, 1]]
        else:
            assert filled[i, j] == -99


def test_the_floor_of_a_real_ship_is_level(real_data: Path) -> None:
    """Where the ship's grid is free, at least 99 % of the floor is seen, at height 0."""
    folder = real_data / "drl-ship-interior-gazebo"
    centres, size = read_octomap_file(folder / "ship_interior_20mm.bt")
    voxels = VoxelMap.from_centres(centres, size, RigidTransform.identity())
    ground = VoxelGround.from_voxels(voxels)
    grid = read_map_file(folder / "ship_interior_10mm.yaml", "map")
    points = grid.cells_to_points(np.argwhere(classify(grid, 65, 25).free))
    heights = ground.heights(points)
    assert np.mean(np.abs(heights) < 1e-6) > 0.99
    columns = voxels.points_to_voxels(np.column_stack((points, heights)))[:, :2]
    assert ground.is_seen[tuple(columns.T)].mean() > 0.99


def test_the_floor_of_a_real_corridor_is_near_level(real_data: Path) -> None:
    """Scanned at 8 cm, with most of the floor unseen: all found heights lie within 25 cm of 0."""
    centres, size = read_octomap_file(real_data / "octomap-geb079/geb079.bt")
    voxels = VoxelMap.from_centres(centres, size, RigidTransform.identity())
    ground = VoxelGround.from_voxels(voxels)
    assert ground.is_seen.mean() > 0.2
    assert np.abs(ground.heights_m).max() < 0.25
    assert np.median(ground.heights_m) == pytest.approx(0.0)
