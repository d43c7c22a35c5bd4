"""The maps of a building."""

import numpy as np
import pytest

from are_ros.conventions import FREE, OCCUPIED, UNKNOWN
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap
from bags.simulation.building import (
    CELL_M,
    VOXEL_M,
    Building,
    Cuboid,
    Cylinder,
    surface_centres_m,
)


@pytest.fixture(scope="module")
def hut() -> Building:
    """Return 2 m by 1 m of floor, a wall of 0.1 m in the west, a lintel, a block of 0.4 m."""
    return Building(
        Cuboid.between(0.0, 0.0, 2.0, 1.0, 0.0),
        (
            Cuboid.between(0.0, 0.0, 0.1, 1.0, 2.4),
            Cuboid.between(0.5, 0.0, 0.6, 1.0, 2.4, 2.1),
            Cuboid.between(1.2, 0.2, 1.6, 0.6, 0.7),
        ),
    )


def test_the_grid_is_unknown_outside_and_free_inside(hut: Building) -> None:
    """A row through the block: margin, wall, floor, the block's two skins, floor, margin."""
    grid = hut.grid(stamp_ns=7)
    assert (grid.height, grid.width, grid.resolution_m) == (40, 60, CELL_M)
    assert (grid.frame_id, grid.stamp_ns) == ("map", 7)
    row = grid.cells[grid.points_to_cells([(0.0, 0.4)])[0, 0]].tolist()
    outside, wall, floor = [UNKNOWN] * 10, [OCCUPIED] * 2, [FREE] * 22
    block = [OCCUPIED] * 2 + [UNKNOWN] * 4 + [OCCUPIED] * 2
    assert row == outside + wall + floor + block + [FREE] * 8 + outside


def test_points_of_the_floor_lie_where_the_grid_says(hut: Building) -> None:
    """The grid's origin is half a metre beyond the corner of the outline."""
    grid = hut.grid()
    cells = grid.points_to_cells([(0.05, 0.5), (0.15, 0.5), (1.25, 0.25), (-0.01, 0.5), (2.01, 1)])
    assert grid.cells[cells[:, 0], cells[:, 1]].tolist() == [OCCUPIED, FREE, OCCUPIED, -1, -1]


def test_voxels_have_floor_walls_lintel_and_block(hut: Building) -> None:
    """Voxel counts by hand, and the column under the lintel is open."""
    voxels = hut.voxels()
    floor, wall, lintel, block = 20 * 10, 10 * 24, 10 * 3, 4 * 4 * 7
    assert voxels.occupied_count == floor + wall + lintel + block
    centres = voxels.centres_m()
    assert (centres[:, 2].min(), centres[:, 2].max()) == pytest.approx((-0.05, 2.35))
    column = centres[np.all(np.abs(centres[:, :2] - (0.55, 0.45)) < 0.01, axis=1), 2]
    assert column.tolist() == pytest.approx([-0.05, 2.15, 2.25, 2.35])


def test_every_occupied_cell_has_its_voxel() -> None:
    """M3D holds M2D: a turned box and a cylinder, whose outlines cut cells and voxels."""
    solids = (Cuboid(1.0, 1.0, 1.1, 0.53, 0.8, yaw_rad=0.6), Cylinder(2.0, 1.3, 0.31, 0.8))
    building = Building(Cuboid.between(0.0, 0.0, 3.0, 2.0, 0.0), solids)
    grid, voxels = building.grid(), building.voxels()
    points = grid.cells_to_points(np.argwhere(grid.cells == OCCUPIED))
    at = voxels.points_to_voxels(np.column_stack((points, np.full(len(points), 0.75))))
    assert len(at) > 100
    assert voxels.occupied[at[:, 0], at[:, 1], at[:, 2]].all()


def test_a_slice_holds_what_meets_its_height(hut: Building) -> None:
    """The laser sees wall and block at 0.2 m, the wall alone at 1 m, the lintel too at 2.2 m."""
    wall, block, lintel = 2 * 20, 8 * 8, 2 * 20
    counts = [hut.slice_at(height).occupied_count for height in (0.2, 1.0, 2.2)]
    assert counts == [wall + block, wall, wall + lintel]


def test_the_surface_is_what_has_a_free_neighbour() -> None:
    """Against a slow look at all six neighbours, with voxels at the lattice's edge."""
    occupied = (np.random.default_rng(5).random((7, 6, 5)) < 0.85).astype(np.uint8)
    voxels = VoxelMap(RigidTransform.planar(1.0, 2.0, 0.3), (VOXEL_M,) * 3, occupied)
    expected = []
    for voxel in np.argwhere(occupied):
        steps = [voxel + sign * axis for axis in np.eye(3, dtype=int) for sign in (-1, 1)]
        inside = [all(0 <= c < n for c, n in zip(s, occupied.shape, strict=True)) for s in steps]
        if not all(ok and occupied[tuple(s)] for ok, s in zip(inside, steps, strict=True)):
            expected.append(voxels.map_from_lattice.apply((voxel[None] + 0.5) * VOXEL_M)[0])
    assert 20 < len(expected) < voxels.occupied_count
    np.testing.assert_allclose(surface_centres_m(voxels), expected)
