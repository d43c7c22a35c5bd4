"""The surface against a face-by-face twin, and merged against that, closed where it must be."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.surface import exposed_surface
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


def covered_faces(surface: trimesh.Trimesh) -> dict[Face, float]:
    """Return how much of each unit face triangles in voxels cover, found by clipping."""
    found: dict[Face, float] = {}
    for corners, normal in zip(surface.triangles, np.rint(surface.face_normals), strict=True):
        axis = int(np.abs(normal).argmax())
        flat = np.delete(corners, axis, axis=1)
        low, high = np.floor(flat.min(axis=0)).astype(int), np.ceil(flat.max(axis=0)).astype(int)
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                part = clipped([*map(tuple, flat.tolist())], (i, j))
                if part > 1e-12:
                    middle = tuple(np.insert((i + 0.5, j + 0.5), axis, corners[0, axis]).tolist())
                    key = middle, tuple(int(n) for n in normal)
                    found[key] = found.get(key, 0.0) + part
    return found


def clipped(polygon: list[tuple[float, ...]], square: tuple[int, int]) -> float:
    """Return the area of a polygon within a unit square, by cutting at each side in turn."""
    for axis in range(2):
        for sign, bound in ((1.0, float(square[axis])), (-1.0, -float(square[axis] + 1))):
            kept: list[tuple[float, ...]] = []
            for a, b in zip(polygon, [*polygon[1:], *polygon[:1]], strict=True):
                over_a, over_b = sign * a[axis] - bound, sign * b[axis] - bound
                if over_a >= 0.0:
                    kept.append(a)
                if over_a * over_b < 0.0:
                    share = over_a / (over_a - over_b)
                    kept.append(tuple(p + share * (q - p) for p, q in zip(a, b, strict=True)))
            polygon = kept
    pairs = zip(polygon, [*polygon[1:], *polygon[:1]], strict=True)
    return abs(sum(a[0] * b[1] - a[1] * b[0] for a, b in pairs)) / 2.0


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**31), yaw=st.floats(-3.1, 3.1))
def test_the_merged_surface_covers_each_exposed_face_once(seed: int, yaw: float) -> None:
    """With the same normal, and nothing else; on a turned lattice of unequal sides."""
    generator = np.random.default_rng(seed)
    shape = tuple(generator.integers(1, 6, 3))
    occupied = (generator.random(shape) < generator.uniform(0.1, 1.0)).astype(np.uint8)
    size = (0.1, 0.2, 2.5)
    voxels = VoxelMap(RigidTransform.planar(3.0, -2.0, yaw, 0.5), size, occupied)
    vertices, faces = exposed_surface(voxels)
    local = voxels.map_from_lattice.inverse().apply(vertices) / np.array(size)
    covered = covered_faces(trimesh.Trimesh(local.round(9), faces, process=False))
    expected = slow_faces(occupied)
    assert sorted(covered) == expected
    assert list(covered.values()) == pytest.approx([1.0] * len(expected))
    assert len(np.unique(local.round(6), axis=0)) == len(local)
    assert np.array_equal(np.unique(faces), np.arange(len(vertices)))


@settings(deadline=None, max_examples=200)
@given(seed=st.integers(0, 2**31))
def test_the_merged_surface_is_closed_as_the_other_is(seed: int) -> None:
    """Each edge has as many triangles as the unmerged surface has there; none is degenerate."""
    generator = np.random.default_rng(seed)
    occupied = (generator.random((5, 4, 5)) < generator.uniform(0.05, 1.0)).astype(np.uint8)
    occupied[1, 1, 1] = 1
    voxels = VoxelMap(IDENTITY, (1.0, 1.0, 1.0), occupied)
    mesh = trimesh.Trimesh(*exposed_surface(voxels), process=False)
    _, times = np.unique(np.sort(mesh.edges, axis=1), axis=0, return_counts=True)
    assert set(times.tolist()) <= {2, 4}
    assert mesh.is_watertight == is_closed_surface(occupied)
    assert mesh.volume == pytest.approx(occupied.sum())
    assert mesh.area_faces.min() > 0.1
    ends = mesh.vertices[mesh.edges]
    forward = {(*a, *b) for a, b in ends.tolist()}
    assert all((*b, *a) in forward for a, b in ends.tolist())


def test_a_wall_is_merged_to_few_triangles() -> None:
    """A box of any length has twelve, and a corner of two walls not many more."""
    box = np.ones((40, 3, 20), np.uint8)
    assert len(exposed_surface(VoxelMap(IDENTITY, (0.1,) * 3, box)).faces) == 12
    corner = np.zeros((40, 40, 20), np.uint8)
    corner[:, :2] = corner[:2] = 1
    assert len(exposed_surface(VoxelMap(IDENTITY, (0.1,) * 3, corner)).faces) < 40


def test_nothing_has_no_surface() -> None:
    """An empty map gives empty arrays."""
    vertices, faces = exposed_surface(VoxelMap(IDENTITY, (1.0,) * 3, np.zeros((2, 2, 2), np.uint8)))
    assert (vertices.shape, faces.shape) == ((0, 3), (0, 3))


def test_rays_hit_the_merged_surface_of_a_real_corridor_where_the_voxels_are(
    real_data: Path,
) -> None:
    """Random rays, by embree, against a walk from voxel to voxel."""
    centres, size = read_octomap_file(real_data / "octomap-geb079/geb079.bt")
    voxels = VoxelMap.from_centres(centres, size, IDENTITY)
    mesh = trimesh.Trimesh(*exposed_surface(voxels), process=False)
    assert mesh.volume == pytest.approx(185_673 * size**3, rel=1e-9)
    generator = np.random.default_rng(8)
    low, high = voxels.bounds_m()
    starts = generator.uniform(low, high, (4000, 3))
    is_free = [not inside(voxels, point) for point in starts]
    starts = starts[is_free][:2000]
    directions = generator.normal(size=starts.shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hits = mesh.ray.intersects_location(starts, directions, multiple_hits=False)
    found = np.full(len(starts), np.inf)
    found[hits[1]] = np.linalg.norm(hits[0] - starts[hits[1]], axis=1)
    expected = np.array([walked_m(voxels, *ray) for ray in zip(starts, directions, strict=True)])
    assert np.isfinite(expected).sum() > 900
    # embree counts in single precision: a ray that grazes an edge may pass it.
    is_same = np.isclose(found, expected, atol=1e-4) | (found == expected)
    assert is_same.mean() > 0.998


def inside(voxels: VoxelMap, point_m: npt.NDArray[np.float64]) -> bool:
    """Say whether a point is in an occupied voxel."""
    i, j, k = voxels.points_to_voxels(point_m[np.newaxis])[0].tolist()
    nx, ny, nz = voxels.occupied.shape
    return 0 <= i < nx and 0 <= j < ny and 0 <= k < nz and bool(voxels.occupied[i, j, k])


def walked_m(
    voxels: VoxelMap, start_m: npt.NDArray[np.float64], direction: npt.NDArray[np.float64]
) -> float:
    """Return where a ray enters an occupied voxel [m], trying the middle between all crossings."""
    size_m = voxels.voxel_size_m[0]
    low_m, high_m = voxels.bounds_m()
    crossings = [0.0]
    for axis in range(3):
        planes_m = np.arange(voxels.occupied.shape[axis] + 1) * size_m + low_m[axis]
        crossings += ((planes_m - start_m[axis]) / direction[axis]).tolist()
    along = np.unique([t for t in crossings if t >= 0.0])
    middles = start_m + 0.5 * (along[:-1] + along[1:])[:, np.newaxis] * direction
    is_within = ((middles > low_m) & (middles < high_m)).all(axis=1)
    voxel = voxels.points_to_voxels(middles[is_within])
    hit = voxels.occupied[tuple(voxel.T)].astype(bool)
    return float(along[:-1][is_within][hit][0]) if hit.any() else float("inf")
