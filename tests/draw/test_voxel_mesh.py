"""The surface of voxels as a mesh, beside the faces counted one by one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from are_ros.draw.viewer import between, coarsened, surface
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

SIZE_M = (0.5, 0.25, 1.0)
NORMALS = {(-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, 1)}
small_maps = arrays(np.uint8, st.tuples(*[st.integers(1, 4)] * 3), elements=st.integers(0, 1))


def voxels_of(occupied: NDArray[np.uint8], *, is_extruded: bool = False) -> VoxelMap:
    """Return a map whose low corner is the origin."""
    return VoxelMap(RigidTransform.identity(), SIZE_M, occupied, is_extruded)


def exposed_area_m2(occupied: NDArray[np.uint8], normal: tuple[int, int, int]) -> float:
    """Return the area of the faces that look one way, one voxel after the other."""
    x, y, z = SIZE_M
    area_m2 = abs(normal[0]) * y * z + abs(normal[1]) * x * z + abs(normal[2]) * x * y
    count = 0
    for place in np.argwhere(occupied):
        beside = place + normal
        is_inside = (beside >= 0).all() and (beside < occupied.shape).all()
        count += not (is_inside and occupied[tuple(beside)])
    return count * area_m2


@given(small_maps)
def test_the_mesh_has_the_faces_that_are_exposed(occupied: NDArray[np.uint8]) -> None:
    """Each way by area, and its triangles look outwards; none looks down."""
    vertices, faces = surface(voxels_of(occupied))
    corners = vertices[faces].astype(np.float64)
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas_m2 = 0.5 * np.linalg.norm(crosses, axis=1)
    assert (areas_m2 > 0.0).all()
    normals = np.rint(crosses / (2.0 * areas_m2[:, np.newaxis])).astype(int)
    assert {tuple(normal) for normal in normals.tolist()} <= NORMALS
    for normal in NORMALS:
        found = areas_m2[(normals == normal).all(axis=1)].sum()
        assert found == pytest.approx(exposed_area_m2(occupied, normal))


def test_a_wall_is_five_rectangles() -> None:
    """However many voxels it has."""
    _, faces = surface(voxels_of(np.ones((30, 2, 8), dtype=np.uint8)))
    assert len(faces) == 2 * 5


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
