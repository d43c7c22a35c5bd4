"""Overhangs: found once for all heights, they are what a look at each height finds."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.world.boxes import TOUCH_TOLERANCE_M
from are_ros.world.environment import Environment, Ground, Overhangs, PlaneGround, VoxelGround
from are_ros.world.lattice_cover import covered
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

_CELL_M = 0.1


def _overhung(
    grid: OccupancyGrid, voxels: VoxelMap, ground: Ground, clearance_m: float, height_m: float
) -> npt.NDArray[np.bool_]:
    """Return the cells whose square meets a voxel in the way: of one height, voxel by voxel."""
    rows, cols = np.indices(grid.cells.shape)
    points_m = grid.cells_to_points(np.column_stack((rows.ravel(), cols.ravel())))
    floors_m = np.maximum(ground.heights(points_m), ground.lowest_m()).reshape(grid.cells.shape)
    base_m = float(voxels.map_from_lattice.translation_m[2])
    width_m, depth_m, layer_m = voxels.voxel_size_m
    local = grid.origin.inverse() @ voxels.map_from_lattice
    cosine, sine = math.cos(local.yaw_rad()), math.sin(local.yaw_rad())
    x0_m, y0_m, _ = local.translation_m
    lattice = np.array([0.0, 0.0, 1.0, 0.0, grid.resolution_m, grid.resolution_m])
    shape = (grid.height, grid.width)
    overhung = np.zeros(shape, np.bool_)
    for i, j, k in np.argwhere(voxels.occupied):
        along_m, across_m = (i + 0.5) * width_m, (j + 0.5) * depth_m
        x_m = x0_m + cosine * along_m - sine * across_m
        y_m = y0_m + sine * along_m + cosine * across_m
        box = np.array([[x_m, y_m, 0.0, cosine, sine, 0.5 * width_m, 0.5 * depth_m, 0.0]])
        row, col, mask = covered(box, 0, lattice, shape, TOUCH_TOLERANCE_M)
        here = (slice(row, row + mask.shape[0]), slice(col, col + mask.shape[1]))
        is_above = base_m + (k + 1) * layer_m > floors_m[here] + clearance_m + TOUCH_TOLERANCE_M
        is_below = base_m + k * layer_m < floors_m[here] + height_m - TOUCH_TOLERANCE_M
        overhung[here] |= mask & is_above & is_below
    return overhung


def _grid(yaw_rad: float) -> OccupancyGrid:
    cells = np.zeros((12, 17), np.int8)
    return OccupancyGrid(cells, _CELL_M, RigidTransform.planar(-0.2, 0.1, yaw_rad), "map")


def _voxels(seed: int, share: float, yaw_rad: float) -> VoxelMap:
    """Return a ragged floor, and voxels here and there above it, up to 2 m."""
    random = np.random.default_rng(seed)
    occupied = (random.random((9, 8, 20)) < share).astype(np.uint8)
    occupied[:, :, 2] = 1
    occupied[random.random((9, 8)) < 0.3, 3] = 1
    low = RigidTransform.planar(0.05, -0.05, yaw_rad, z=-0.3)
    return VoxelMap(low, (0.15, 0.15, 0.1), occupied)


@given(
    st.integers(0, 10_000),
    st.sampled_from([0.0, 0.02, 0.3]),
    st.sampled_from([0.0, 0.4, -2.0]),
    st.booleans(),
    st.sampled_from([0.06, 0.11, 0.2]),
)
def test_all_heights_find_the_very_cells_of_a_look_at_each(
    seed: int, share: float, yaw_rad: float, is_plane: bool, clearance_m: float
) -> None:
    """Bit by bit, also where voxels end at the very height, on a plane and on a found floor."""
    grid, voxels = _grid(0.25 * yaw_rad), _voxels(seed, share, yaw_rad)
    ground = PlaneGround(0.02) if is_plane else VoxelGround.from_voxels(voxels)
    overhangs = Overhangs(grid, voxels, ground, clearance_m)
    for height_m in (0.25, 0.4, 0.5, 1.0, 1.75, 3.0):
        expected = _overhung(grid, voxels, ground, clearance_m, height_m)
        assert (overhangs.below(height_m) == expected).all()


def test_nothing_hangs_where_there_are_no_voxels() -> None:
    """An empty lattice is in nobody's way."""
    voxels = VoxelMap(RigidTransform.identity(), (0.1, 0.1, 0.1), np.zeros((3, 3, 3), np.uint8))
    assert not Overhangs(_grid(0.0), voxels, PlaneGround(), 0.1).below(9.0).any()


def test_an_environment_looks_once_for_all_heights(monkeypatch: pytest.MonkeyPatch) -> None:
    """The voxels are gone through once, before the first tick, for whatever heights there are."""
    looks = []
    made = Overhangs.__init__

    def count(self: Overhangs, *parts: object) -> None:
        looks.append(self)
        made(self, *parts)  # type: ignore[arg-type] # as it was called

    monkeypatch.setattr(Overhangs, "__init__", count)
    grid = _grid(0.0)
    here = Environment(grid, classify(grid, 65, 25), _voxels(1, 0.1, 0.3), PlaneGround(), 0.1)
    here.prepare()
    assert len(looks) == 1
    assert here.overhangs is not None
    assert here.overhangs.below(0.25).sum() < here.overhangs.below(1.75).sum()
    assert len(looks) == 1


def test_an_extruded_map_has_no_overhangs() -> None:
    """Walls over cells say no more than the cells."""
    grid = _grid(0.0)
    classes = classify(grid, 65, 25)
    walls = VoxelMap.extruded(grid, classes.occupied, 2.0, 0.0)
    assert Environment(grid, classes, walls, PlaneGround(), 0.1).overhangs is None
    assert Environment(grid, classes, None, PlaneGround(), 0.1).overhangs is None
