"""The surface against a face-by-face twin, closed where it must be."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_files.octomap import read_octomap_file
from are_ros.world.voxel_map import VoxelMap
from tests.world.surface import exposed_faces, exposed_quads

IDENTITY = RigidTransform.identity()
Face = tuple[tuple[float, ...], tuple[int, ...]]


def slow_faces(occupied: npt.NDArray[np.uint8]) -> list[Face]:
    """Return centre and outward normal of each exposed face, in voxels."""
    filled = {tuple(int(c) for c in voxel) for voxel in np.argwhere(occupied)}
    faces: list[Face] = []
    for voxel in filled:
        for axis in range(3):
            for side in (-1, 1):
                normal = tuple(side * int(axis == a) for a in range(3))
                if tuple(v + n for v, n in zip(voxel, normal, strict=True)) not in filled:
                    centre = tuple(v + 0.5 + 0.5 * n for v, n in zip(voxel, normal, strict=True))
                    faces.append((centre, normal))
    return sorted(faces)


def is_closed_surface(occupied: npt.NDArray[np.uint8]) -> bool:
    """Return whether no two voxels touch in an edge alone (then each edge has two faces)."""
    padded = np.pad(occupied, 1)
    for axis in range(3):
        moved = np.moveaxis(padded, axis, 0)
        a, b, c, d = moved[:, :-1, :-1], moved[:, 1:, 1:], moved[:, :-1, 1:], moved[:, 1:, :-1]
        if ((a & b & ~c & ~d) | (c & d & ~a & ~b)).astype(bool).any():
            return False
    return True


@settings(deadline=None)
@given(seed=st.integers(0, 2**31), yaw=st.floats(-3.1, 3.1))
def test_faces_are_those_of_the_slow_twin(seed: int, yaw: float) -> None:
    """Position, outward normal and number of faces, volume and area, on a turned lattice."""
    generator = np.random.default_rng(seed)
    shape = tuple(generator.integers(1, 5, 3))
    occupied = (generator.random(shape) < generator.uniform(0.1, 1.0)).astype(np.uint8)
    occupied.flat[0] = 1
    size = (0.1, 0.2, 2.5)
    voxels = VoxelMap(RigidTransform.planar(3.0, -2.0, yaw, 0.5), size, occupied)
    mesh = exposed_faces(voxels)
    local = voxels.map_from_lattice.inverse().apply(mesh.vertices) / np.array(size)
    pairs = local[mesh.faces].reshape(-1, 2, 3, 3)
    normals = np.cross(pairs[:, :, 1] - pairs[:, :, 0], pairs[:, :, 2] - pairs[:, :, 0])
    assert normals[:, 0] == pytest.approx(normals[:, 1], abs=1e-6)
    centres = pairs.reshape(-1, 6, 3)
    middle = (centres.min(axis=1) + centres.max(axis=1)) / 2
    found = sorted(
        (tuple(np.round(2 * m) / 2), tuple(np.rint(n).astype(int).tolist()))
        for m, n in zip(middle, normals[:, 0], strict=True)
    )
    expected = slow_faces(occupied)
    assert found == expected
    assert mesh.volume == pytest.approx(occupied.sum() * np.prod(size))
    area = {0: size[1] * size[2], 1: size[0] * size[2], 2: size[0] * size[1]}
    assert mesh.area == pytest.approx(sum(area[int(np.argmax(np.abs(n)))] for _, n in expected))
    assert len(np.unique(np.round(local), axis=0)) == len(local)


@settings(deadline=None)
@given(seed=st.integers(0, 2**31))
def test_the_surface_is_closed_where_it_must_be(seed: int) -> None:
    """Watertight exactly when no two voxels touch in an edge alone; wound alike in any case."""
    generator = np.random.default_rng(seed)
    occupied = (generator.random((3, 3, 3)) < generator.uniform(0.05, 1.0)).astype(np.uint8)
    occupied[1, 1, 1] = 1
    mesh = exposed_faces(VoxelMap(IDENTITY, (1.0, 1.0, 1.0), occupied))
    assert mesh.is_watertight == is_closed_surface(occupied)
    if mesh.is_watertight:
        assert mesh.is_winding_consistent


def test_one_voxel_is_a_box() -> None:
    """Twelve triangles, eight corners, the given size, anisotropic as a wall's voxel is."""
    mesh = exposed_faces(VoxelMap(IDENTITY, (0.1, 0.2, 3.0), np.ones((1, 1, 1), np.uint8)))
    assert (len(mesh.faces), len(mesh.vertices)) == (12, 8)
    assert mesh.bounds.tolist() == [[0.0, 0.0, 0.0], [0.1, 0.2, 3.0]]
    assert mesh.is_watertight


def test_no_voxel_has_no_surface() -> None:
    """An empty map gives an empty mesh, not an error."""
    corners, quads = exposed_quads(np.zeros((2, 2, 2), np.uint8))
    assert (corners.shape, quads.shape) == ((0, 3), (0, 4))
    assert (
        len(exposed_faces(VoxelMap(IDENTITY, (1.0,) * 3, np.zeros((2, 2, 2), np.uint8))).faces) == 0
    )


def test_the_surface_of_a_real_corridor_encloses_its_voxels(real_data: Path) -> None:
    """Volume by the divergence theorem equals the number of voxels times theirs."""
    centres, size = read_octomap_file(real_data / "octomap-geb079/geb079.bt")
    voxels = VoxelMap.from_centres(centres, size, IDENTITY)
    mesh = exposed_faces(voxels)
    assert mesh.volume == pytest.approx(185_673 * size**3, rel=1e-9)
    differences = sum(
        int(np.count_nonzero(np.diff(np.pad(voxels.occupied, 1).astype(np.int8), axis=axis)))
        for axis in range(3)
    )
    assert len(mesh.faces) == 2 * differences
