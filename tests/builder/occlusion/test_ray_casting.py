"""Rays on voxels against slabs of every voxel, a walk from voxel to voxel, and Embree."""

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy.ndimage import distance_transform_cdt

from are_ros.builder.occlusion.rays import FAR, VoxelField, chessboard_distance, free_cone, trace
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_files.octomap import read_octomap_file
from are_ros.world.voxel_map import VoxelMap
from tests.world.surface import exposed_faces

Floats = npt.NDArray[np.float64]


def _voxels(
    seed: int,
    shape: tuple[int, int, int],
    size: tuple[float, float, float] = (0.3, 0.2, 0.5),
    share: float = 0.05,
) -> VoxelMap:
    occupied = np.random.default_rng(seed).random(shape) < share
    pose = RigidTransform.planar(1.0, -2.0, 0.7, z=-0.4)
    return VoxelMap(pose, size, occupied.astype(np.uint8))


def _unit_rays(seed: int, count: int) -> Floats:
    rays = np.random.default_rng(seed).normal(size=(count, 3))
    unit: Floats = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return unit


def _inside(voxels: VoxelMap, fraction: tuple[float, float, float]) -> Floats:
    """Return a point of the map frame at a fraction of the lattice's extent."""
    point = np.array(fraction) * voxels.occupied.shape * np.array(voxels.voxel_size_m)
    inside: Floats = voxels.map_from_lattice.apply(point[np.newaxis])[0]
    return inside


def _slab_hits(voxels: VoxelMap, origin: Floats, rays: Floats, max_range: float) -> Floats:
    """Return first hits by testing every occupied voxel, but for the one around the origin."""
    turn = voxels.map_from_lattice.rotation_matrix()
    start = (origin - voxels.map_from_lattice.translation_m) @ turn
    inverse = 1.0 / (rays @ turn)
    best = np.full(len(rays), np.inf)
    size = np.array(voxels.voxel_size_m)
    for voxel in np.argwhere(voxels.occupied):
        a, b = (voxel * size - start) * inverse, ((voxel + 1) * size - start) * inverse
        near, far = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
        best = np.where((near <= far) & (near > 0.0), np.minimum(best, near), best)
    return np.where(best <= max_range, best, np.inf)


def _walked_hit(voxels: VoxelMap, origin: Floats, ray: Floats, max_range: float) -> float:
    """Return the first hit by walking from voxel to voxel (Amanatides and Woo); origin inside."""
    turn, size = voxels.map_from_lattice.rotation_matrix(), np.array(voxels.voxel_size_m)
    start = (origin - voxels.map_from_lattice.translation_m) @ turn / size
    step = ray @ turn / size
    voxel, t = np.floor(start).astype(int), 0.0
    while True:
        walls = voxel + (step > 0)
        times = (walls - start) / step
        axis = int(np.argmin(times))
        t = float(times[axis])
        voxel[axis] += 1 if step[axis] > 0 else -1
        if t > max_range or (voxel < 0).any() or (voxel >= voxels.occupied.shape).any():
            return math.inf
        if voxels.occupied[tuple(voxel)]:
            return t


@pytest.mark.parametrize(
    "shape", [(7, 9, 5), (1, 1, 1), (2, 5, 1), (20, 30, 10), (3, 1, 2), (300, 4, 1), (5, 40, 40)]
)
def test_the_distance_field_is_the_chessboard_distance(shape: tuple[int, int, int]) -> None:
    """The three sweeps give scipy's exact chessboard transform, cut off at its largest value."""
    occupied = (np.random.default_rng(sum(shape)).random(shape) < 0.01).astype(np.uint8)
    occupied[0, 0, 0] = 1
    expected = distance_transform_cdt(occupied == 0, "chessboard").transpose(2, 0, 1)
    np.testing.assert_array_equal(chessboard_distance(occupied), np.minimum(expected, FAR))


def test_an_empty_lattice_is_far_from_everything() -> None:
    """Without an occupied voxel every distance is the cut-off."""
    assert (chessboard_distance(np.zeros((3, 4, 5), dtype=np.uint8)) == FAR).all()


@pytest.mark.parametrize("length", [32_518, 33_000, 70_000])
def test_the_distance_field_of_a_long_map(length: int) -> None:
    """More voxels than a number of 16 bits has: a hall of 330 m with voxels of a centimetre."""
    occupied = np.zeros((1, length, 1), dtype=np.uint8)
    occupied[0, (100, length - 5)] = 1
    along = np.arange(length)
    expected = np.minimum(np.abs(along - 100), np.abs(along - (length - 5)))
    np.testing.assert_array_equal(chessboard_distance(occupied)[0, 0], np.minimum(expected, FAR))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("fraction", [(0.5, 0.5, 0.5), (-0.1, 0.3, 0.2), (0.4, 0.6, 1.1)])
def test_hits_agree_with_the_slabs_of_every_voxel(
    seed: int, fraction: tuple[float, float, float]
) -> None:
    """From inside and outside the lattice, distances agree to 1e-4 m but for one grazing ray."""
    voxels = _voxels(seed, (12, 15, 9), share=0.15)
    origin, rays = _inside(voxels, fraction), _unit_rays(seed, 500)
    hits = VoxelField.of(voxels).first_hits(origin, rays, 4.0)
    expected = _slab_hits(voxels, origin, rays, 4.0)
    assert np.isfinite(expected).sum() > 20
    with np.errstate(invalid="ignore"):
        apart = (hits != expected) & ~(np.abs(hits - expected) < 1e-4)
    assert apart.sum() <= 1


@pytest.mark.parametrize("share", [0.0, 0.002, 0.3])
def test_hits_agree_with_a_walk_from_voxel_to_voxel(share: float) -> None:
    """In sparse and dense maps the leaps end where the walk ends."""
    voxels = _voxels(3, (40, 30, 20), (0.1, 0.1, 0.1), share)
    origin, rays = _inside(voxels, (0.41, 0.52, 0.63)), _unit_rays(8, 300)
    hits = VoxelField.of(voxels).first_hits(origin, rays, 10.0)
    expected = np.array([_walked_hit(voxels, origin, ray, 10.0) for ray in rays])
    np.testing.assert_allclose(hits, expected, atol=1e-4)


def test_rays_in_a_real_corridor_agree_with_a_walk(real_data: Path) -> None:
    """In a real octomap of 185,673 voxels, 200 rays from 4 free places end where the walk ends."""
    centres, size = read_octomap_file(next((real_data / "octomap-geb079").glob("*.bt")))
    voxels = VoxelMap.from_centres(centres, size, RigidTransform.planar(3.0, 2.0, 0.5))
    field, rng = VoxelField.of(voxels), np.random.default_rng(4)
    free = np.argwhere(voxels.occupied == 0)
    for place in rng.choice(free, 4):
        shift = np.array((0.31, 0.47, 0.53))
        origin = voxels.map_from_lattice.apply((place[np.newaxis] + shift) * size)[0]
        rays = _unit_rays(int(place.sum()), 200)
        expected = np.array([_walked_hit(voxels, origin, ray, 20.0) for ray in rays])
        np.testing.assert_allclose(field.first_hits(origin, rays, 20.0), expected, atol=1e-3)


def test_no_ray_looks_outside_the_lattice() -> None:
    """Rays towards the upper edges of a lattice never meet what lies behind it in memory."""
    shape = (9, 30, 40)  # z, x, y
    room = np.zeros((2 * shape[0], *shape[1:]), dtype=np.uint8)  # occupied, where not overwritten
    field, high = room[: shape[0]], np.array((*shape[1:], shape[0]), dtype=np.float64)
    field[:], field[0, 3, 3] = 2, 0  # short leaps; one voxel low in a corner
    generator = np.random.default_rng(5)
    for _ in range(20):
        origin = generator.uniform(2.0, high - 2.0)
        aims = generator.uniform(0.5 * high, high, (20000, 3))
        aims[:, 2] = high[2]
        aims[:10000, 0], aims[10000:, 1] = high[0], high[1]
        rays = np.ascontiguousarray((aims - origin).T, dtype=np.float32)
        hits = np.empty(20000, dtype=np.float32)
        limits, which = np.full(20000, 50.0, dtype=np.float32), np.arange(20000)
        trace(field, origin.astype(np.float32), -1, rays, which, np.float32(0.0), limits, hits)
        assert np.isinf(hits).all()


def test_an_empty_map_hits_nothing() -> None:
    """A lattice without a single voxel is an empty environment."""
    nothing = VoxelMap(RigidTransform.identity(), (1.0, 1.0, 1.0), np.empty((0, 4, 4), np.uint8))
    assert np.isinf(VoxelField.of(nothing).first_hits(np.zeros(3), _unit_rays(1, 40), 9.0)).all()


def test_hits_agree_with_embree() -> None:
    """On the exposed faces of 6,000 voxels, Embree finds the same distances to 1e-3 m."""
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    voxels = _voxels(5, (60, 50, 40), (0.1, 0.1, 0.1))
    origin, rays = _inside(voxels, (0.503, 0.507, 0.511)), _unit_rays(6, 5000)
    assert VoxelField.of(voxels).lattice_rays(origin)[1] == -1
    tracer = RayMeshIntersector(exposed_faces(voxels))
    points, which, _ = tracer.intersects_location(
        np.tile(origin, (len(rays), 1)), rays, multiple_hits=False
    )
    expected = np.full(len(rays), np.inf)
    expected[which] = np.linalg.norm(points - origin, axis=1)
    hits = VoxelField.of(voxels).first_hits(origin, rays, 100.0)
    with np.errstate(invalid="ignore"):
        apart = (hits != expected) & ~(np.abs(hits - expected) < 1e-3)
    assert apart.sum() <= 2


def test_tall_voxels_of_an_extruded_map_are_hit_at_their_sides() -> None:
    """One layer of 2 m tall voxels: the wall is met at its face, and missed above it."""
    occupied = np.zeros((40, 40, 1), dtype=np.uint8)
    occupied[30] = 1
    field = VoxelField.of(VoxelMap(RigidTransform.identity(), (0.1, 0.1, 2.0), occupied, True))
    origin = np.array([1.0, 2.0, 1.0])
    up = np.array([2.0, 0.0, 1.1]) / math.hypot(2.0, 1.1)
    hits = field.first_hits(origin, np.array([[1.0, 0.0, 0.0], up, [-1.0, 0.0, 0.0]]), 10.0)
    np.testing.assert_allclose(hits, [2.0, np.inf, np.inf], atol=1e-6)


def test_the_range_is_closed() -> None:
    """A wall exactly at the range is seen, one a little beyond is not."""
    occupied = np.zeros((4, 1, 1), dtype=np.uint8)
    occupied[3] = 1
    field = VoxelField.of(VoxelMap(RigidTransform.identity(), (1.0, 1.0, 1.0), occupied))
    origin, ahead = np.array([0.5, 0.5, 0.5]), np.array([[1.0, 0.0, 0.0]])
    assert field.first_hits(origin, ahead, 2.5)[0] == 2.5
    assert field.first_hits(origin, ahead, 2.4999)[0] == np.inf


def test_an_occupied_voxel_around_the_origin_is_ignored_and_its_neighbour_is_not() -> None:
    """From inside an occupied voxel the ray sees the next occupied one."""
    occupied = np.zeros((6, 1, 1), dtype=np.uint8)
    occupied[[0, 1, 5]] = 1
    field = VoxelField.of(VoxelMap(RigidTransform.identity(), (1.0, 1.0, 1.0), occupied))
    both = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    np.testing.assert_allclose(
        field.first_hits(np.array([0.25, 0.5, 0.5]), both, 9.0), [0.75, np.inf]
    )
    np.testing.assert_allclose(
        field.first_hits(np.array([1.25, 0.5, 0.5]), both, 9.0), [3.75, 0.25]
    )


def test_axis_aligned_rays_and_zero_directions_are_served() -> None:
    """A ray along an axis, even along an edge, is finite work; a zero direction hits nothing."""
    voxels = VoxelMap(RigidTransform.identity(), (1.0, 1.0, 1.0), np.ones((3, 3, 3), np.uint8))
    rays = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 0.0]])
    hits = VoxelField.of(voxels).first_hits(np.array([-1.0, 1.0, 1.0]), rays, 9.0)
    np.testing.assert_array_equal(hits, [1.0, np.inf, np.inf])


def test_no_environment_hits_nothing() -> None:
    """The empty field gives infinity in every direction."""
    hits = VoxelField.empty().first_hits(np.array([0.3, 0.3, 0.3]), _unit_rays(1, 50), 100.0)
    assert np.isinf(hits).all()


@pytest.mark.parametrize("seed", range(5))
def test_no_ray_of_a_bundle_hits_before_the_free_distance(seed: int) -> None:
    """Rays within the spread of an axis hit nothing nearer than the bundle's free distance."""
    voxels = _voxels(seed, (50, 50, 30), (0.1, 0.08, 0.12), 0.003)
    field, origin = VoxelField.of(voxels), _inside(voxels, (0.5, 0.5, 0.5))
    start, ignored, matrix = field.lattice_rays(origin)
    total = 0.0
    for number, axis in enumerate(_unit_rays(seed, 40)):
        rays = axis + 0.03 * _unit_rays(number, 200)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        spread = np.float32(np.linalg.norm(rays - axis, axis=1).max())
        spreads = spread / np.array(field.voxel_size_m, dtype=np.float32)
        lattice_axis = matrix @ axis.astype(np.float32)
        free = free_cone(field.distances, start, ignored, lattice_axis, spreads, np.float32(9.0))
        assert field.first_hits(origin, rays, 9.0).min() >= free - 1e-4
        total += float(free)
    assert total > 4.0
