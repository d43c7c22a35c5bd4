"""Rays on meshes against a loop over all triangles and against Embree."""

import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.builder.occlusion.meshes import MeshPool, cast, cast_tile
from are_ros.builder.occlusion.rays import PIXELS
from are_ros.errors import InputError

Floats = npt.NDArray[np.float64]
Mesh = tuple[npt.NDArray[np.floating], npt.NDArray[np.integer]]


def _solid(name: str) -> Mesh:
    made = {
        "box": lambda: trimesh.creation.box((1.0, 0.6, 1.8)),
        "ball": lambda: trimesh.creation.icosphere(subdivisions=2, radius=0.8),
        "ring": lambda: trimesh.creation.torus(0.8, 0.2, 16, 12),
    }[name]()
    return np.array(made.vertices), np.array(made.faces)


def _rays_towards(seed: int, origin: Floats, spread: float, count: int) -> Floats:
    rays = np.random.default_rng(seed).normal(scale=spread, size=(count, 3)) - origin
    unit: Floats = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return unit


def _loop_hits(mesh: Mesh, origin: Floats, rays: Floats, max_range: float) -> Floats:
    """Return first hits by solving corner + u a + v b = origin + t ray for each triangle."""
    best = np.full(len(rays), np.inf)
    for corner, second, third in mesh[0][mesh[1]]:
        a, b = second - corner, third - corner
        columns = np.stack((np.tile(a, (len(rays), 1)), np.tile(b, (len(rays), 1)), -rays), axis=2)
        usable = np.abs(np.linalg.det(columns)) > 1e-14
        right = np.broadcast_to((origin - corner)[:, np.newaxis], (usable.sum(), 3, 1))
        solved = np.full((len(rays), 3), np.nan)
        solved[usable] = np.linalg.solve(columns[usable], right)[:, :, 0]
        u, v, t = solved.T
        hit = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9) & (t >= 0.0) & (t <= max_range)
        best = np.where(hit, np.fmin(best, t), best)
    return best


def _first_hits(pool: MeshPool, mesh: int, start: Floats, rays: Floats, range_m: float) -> Floats:
    """Return the distance to a mesh along unit rays (N, 3), inf if none."""
    x, y, z = start.tolist()
    return np.array(
        [cast(pool.tree, mesh, x, y, z, dx, dy, dz, float(range_m)) for dx, dy, dz in rays.tolist()]
    )


@pytest.mark.parametrize("name", ["box", "ball", "ring"])
@pytest.mark.parametrize("origin", [(3.0, 0.4, 0.2), (0.1, 0.05, -0.1), (-1.5, 2.0, 4.0)])
def test_hits_agree_with_a_loop_over_all_triangles(
    name: str, origin: tuple[float, float, float]
) -> None:
    """From outside and inside, distances agree to 1e-9 m."""
    mesh, start = _solid(name), np.array(origin)
    rays = _rays_towards(1, start, 0.8, 300)
    hits = _first_hits(MeshPool.of([mesh]), 0, start, rays, 10.0)
    np.testing.assert_allclose(hits, _loop_hits(mesh, start, rays, 10.0), atol=1e-9)
    assert np.isfinite(hits).sum() > 50


def test_hits_agree_with_embree() -> None:
    """On a mesh of 5,120 triangles Embree finds the same distances to 1e-4 m."""
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    solid = trimesh.creation.icosphere(subdivisions=4)
    solid.vertices *= 1.0 + 0.2 * np.sin(5.0 * solid.vertices[:, :1])
    start = np.array([2.5, 0.3, -0.7])
    rays = _rays_towards(2, start, 0.7, 4000)
    points, which, _ = RayMeshIntersector(solid).intersects_location(
        np.tile(start, (len(rays), 1)), rays, multiple_hits=False
    )
    expected = np.full(len(rays), np.inf)
    expected[which] = np.linalg.norm(points - start, axis=1)
    pool = MeshPool.of([(np.array(solid.vertices), np.array(solid.faces))])
    hits = _first_hits(pool, 0, start, rays, 10.0)
    with np.errstate(invalid="ignore"):
        apart = (hits != expected) & ~(np.abs(hits - expected) < 1e-4)
    assert apart.sum() <= 1


def test_every_mesh_of_a_pool_is_found_by_its_number() -> None:
    """Meshes of unlike sizes, one triangle among them, keep their own triangles."""
    single = (
        np.array([[0.0, -1.0, -1.0], [0.0, 1.0, -1.0], [0.0, 0.0, 1.0]]),
        np.array([[0, 1, 2]]),
    )
    meshes = [_solid("ball"), single, _solid("box")]
    pool = MeshPool.of(meshes)
    assert len(pool) == 3
    start, ahead = np.array([5.0, 0.0, 0.0]), np.array([[-1.0, 0.0, 0.0]])
    for number, mesh in enumerate(meshes):
        hits = _first_hits(pool, number, start, ahead, 10.0)
        np.testing.assert_allclose(hits, _loop_hits(mesh, start, ahead, 10.0))


def test_the_range_is_closed_and_may_be_endless() -> None:
    """A surface exactly at the range is hit; an endless range changes nothing else."""
    pool = MeshPool.of([_solid("box")])
    start, rays = np.array([2.5, 0.1, 0.2]), np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert _first_hits(pool, 0, start, rays, 2.0).tolist() == [2.0, np.inf]
    assert _first_hits(pool, 0, start, rays, 1.999).tolist() == [np.inf, np.inf]
    assert _first_hits(pool, 0, start, rays, np.inf).tolist()[1] == np.inf


@pytest.mark.parametrize(
    ("mesh", "reason"),
    [
        ((np.zeros((3, 3)), np.empty((0, 3), dtype=int)), "has no triangle"),
        ((np.full((3, 3), np.nan), np.array([[0, 1, 2]])), "not finite"),
        ((np.zeros((3, 3)), np.array([[0, 1, 3]])), "names another"),
    ],
)
def test_a_broken_mesh_is_refused(mesh: Mesh, reason: str) -> None:
    """The sentence names the mesh by number, and the reason."""
    with pytest.raises(InputError, match=rf"mesh 1 .*{reason}"):
        MeshPool.of([_solid("box"), mesh])


@settings(max_examples=40, deadline=None)
@given(
    name=st.sampled_from(["box", "ball", "ring"]),
    origin=st.tuples(*[st.floats(-4.0, 4.0)] * 3),
    aim=st.tuples(*[st.floats(-0.8, 0.8)] * 3),
    seed=st.integers(0, 99),
)
def test_a_tile_of_rays_hits_what_single_rays_hit(
    name: str, origin: tuple[float, float, float], aim: tuple[float, float, float], seed: int
) -> None:
    """The tile's SIMD walk finds the single rays' distances to 1e-4 m, but for grazing rays."""
    pool, start = MeshPool.of([_solid(name)]), np.array(origin)
    axis = np.array(aim) - start + 1e-3
    axis /= np.linalg.norm(axis)
    rays = axis + np.random.default_rng(seed).uniform(-0.05, 0.05, (PIXELS, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    spread = float(np.linalg.norm(rays - axis, axis=1).max())
    grown = spread * (float(np.linalg.norm(start)) + 1.5)
    depths = np.full(PIXELS, np.inf, dtype=np.float32)
    camera, plane = start.astype(np.float32), np.ascontiguousarray(rays.T, dtype=np.float32)
    cast_tile(pool.tree, 0, camera, axis.astype(np.float32), grown, plane, depths)
    expected = _first_hits(pool, 0, start, rays, 100.0)
    with np.errstate(invalid="ignore"):
        apart = (depths != expected) & ~(np.abs(depths - expected) < 1e-4)
    assert apart.sum() <= 2
