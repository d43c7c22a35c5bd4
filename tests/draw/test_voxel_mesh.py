"""The voxels that the viewer draws: as boxes, wider, and between two heights."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from are_ros.draw.viewer import between, coarsened
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.surface import boxes_of
from are_ros.world.voxel_map import VoxelMap

SIZE_M = (0.5, 0.25, 1.0)
small_maps = arrays(np.uint8, st.tuples(*[st.integers(1, 4)] * 3), elements=st.integers(0, 1))


def voxels_of(occupied: NDArray[np.uint8], *, is_extruded: bool = False) -> VoxelMap:
    """Return a map whose low corner is the origin."""
    return VoxelMap(RigidTransform.identity(), SIZE_M, occupied, is_extruded)


@given(small_maps)
def test_the_boxes_fill_what_is_occupied(occupied: NDArray[np.uint8]) -> None:
    """Each occupied voxel lies in one box, and no other voxel does."""
    filled = np.zeros_like(occupied)
    for (x0, y0, z0), (x1, y1, z1) in zip(*boxes_of(occupied), strict=True):
        filled[x0:x1, y0:y1, z0:z1] += 1
    np.testing.assert_array_equal(filled, occupied)


def test_a_wall_is_one_box() -> None:
    """However many voxels it has, and whichever way it goes."""
    for shape in ((30, 2, 8), (2, 30, 8), (1, 1, 9)):
        low, high = boxes_of(np.ones(shape, dtype=np.uint8))
        assert (low.tolist(), high.tolist()) == ([[0, 0, 0]], [[*shape]])


def test_coarser_voxels_hold_all_that_is_occupied() -> None:
    """One occupied voxel is enough, also at an edge that does not divide."""
    occupied = np.zeros((5, 4, 3), dtype=np.uint8)
    occupied[4, 1, 2] = 1
    coarse = coarsened(voxels_of(occupied), 2)
    assert coarse.voxel_size_m == (1.0, 0.5, 2.0)
    assert np.argwhere(coarse.occupied).tolist() == [[2, 0, 1]]


def test_walls_stay_as_high_as_they_are() -> None:
    """An extruded map is made coarser along the ground only."""
    coarse = coarsened(voxels_of(np.ones((4, 4, 1), dtype=np.uint8), is_extruded=True), 2)
    assert coarse.occupied.shape == (2, 2, 1)
    assert coarse.voxel_size_m == (1.0, 0.5, 1.0)


def test_layers_are_cut_by_their_middles() -> None:
    """Of layers of 1 m, from 0 m up, the second and third have theirs between 1 and 3 m."""
    part = between(voxels_of(np.ones((1, 1, 5), dtype=np.uint8)), 1.0, 3.0)
    assert part is not None
    assert part.occupied.shape == (1, 1, 2)
    assert part.map_from_lattice.translation_m.tolist() == [0.0, 0.0, 1.0]


def test_what_lies_outside_is_nothing() -> None:
    """No layer, or none with anything in it."""
    occupied = np.zeros((1, 1, 5), dtype=np.uint8)
    occupied[0, 0, 4] = 1
    assert between(voxels_of(occupied), 1.0, 3.0) is None
    assert between(voxels_of(occupied), 10.0, 12.0) is None


def test_tall_voxels_are_cut() -> None:
    """A wall of 1 m, of which 0.4 m are drawn."""
    part = between(voxels_of(np.ones((1, 1, 1), dtype=np.uint8), is_extruded=True), 0.1, 0.4)
    assert part is not None
    assert part.voxel_size_m == (0.5, 0.25, 0.4)
