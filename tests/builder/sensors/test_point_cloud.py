"""Augmented clouds: every ray against trimesh, which shares no code with ours."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.builder.occlusion.meshes import MeshPool, MeshSelection
from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.sensors.obstacles import Obstacles
from are_ros.builder.sensors.point_cloud import (
    CloudField,
    PointCloud,
    _farthest_return,
    _returns_in,
)
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float64]
HERE = RigidTransform.identity()
TILTED = RigidTransform.from_xyz_ypr(0.4, -0.3, 0.2, 0.7, 0.1, -0.2)
CAMERA = RigidTransform.from_xyz_ypr(0.1, 0.2, 0.3, 0.3 - 0.5 * math.pi, 0.0, -0.5 * math.pi)
"""An optical frame that looks forward and to the left."""
FORMATS = {"f4": 7, "f8": 8, "u2": 4, "u4": 6, "u1": 2}

WORLD = OrientedBoxes(
    np.array([[3.0, 0.5, 0.1], [2.0, -2.0, 0.0], [-2.5, 1.0, 0.2]]),
    np.array([0.3, 1.0, -0.4]),
    np.array([[0.4, 0.3, 0.8], [0.3, 0.3, 0.5], [0.5, 0.2, 0.6]]),
)
BALL = trimesh.creation.icosphere(2, 0.5)
BALL_M = (1.5, 1.8, 0.1)


def obstacles(surface: VoxelField | None = None) -> Obstacles:
    """Return three boxes and a ball."""
    ball = OrientedBoxes(np.array([BALL_M]), np.zeros(1), np.full((1, 3), 0.5))
    boxes = OrientedBoxes(
        *(
            np.concatenate((getattr(WORLD, name), getattr(ball, name)))
            for name in ("centres_m", "yaws_rad", "half_sizes_m")
        )
    )
    shapes = MeshSelection(
        MeshPool.of([(BALL.vertices, BALL.faces)]), np.array([-1, -1, -1, 0], np.int64)
    )
    return Obstacles(boxes, shapes, surface)


def oracle(pose: RigidTransform, rays: Floats) -> Floats:
    """Return the first hit [m] of each ray (N, 3) of a sensor, inf for none, by trimesh."""
    parts = [BALL.copy().apply_translation(BALL_M)]
    for centre, yaw, half in zip(WORLD.centres_m, WORLD.yaws_rad, WORLD.half_sizes_m, strict=True):
        part = trimesh.creation.box(2.0 * half)
        part.apply_transform(trimesh.transformations.rotation_matrix(yaw, (0, 0, 1)))
        parts.append(part.apply_translation(centre))
    scene = trimesh.util.concatenate(parts)
    directions = rays @ pose.rotation_matrix().T
    origins = np.tile(pose.translation_m, (len(rays), 1))
    places, ray, _ = scene.ray.intersects_location(origins, directions, multiple_hits=True)
    hits = np.full(len(rays), np.inf)
    np.minimum.at(hits, ray, np.linalg.norm(places - pose.translation_m, axis=1))
    return hits


def cloud_of(
    points_m: Floats,
    kind: str = "f4",
    *,
    is_bigendian: bool = False,
    padding: int = 0,
    **others: npt.NDArray[np.generic],
) -> PointCloud:
    """Return a cloud of points (H, W, 3) and other fields (H, W)."""
    order, (height, width) = ">" if is_bigendian else "<", points_m.shape[:2]
    columns = {axis: points_m[..., k].astype(kind) for k, axis in enumerate("xyz")} | others
    dtype = np.dtype([(name, order + one.dtype.str[1:]) for name, one in columns.items()])
    table = np.zeros((height, width), dtype)
    for name, one in columns.items():
        table[name] = one
    rows = table.view(np.uint8).reshape(height, width * dtype.itemsize)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=7)
    offsets = [(dtype.fields or {})[name][1] for name in columns]
    fields = [
        CloudField(name, offset, FORMATS[one.dtype.str[1:]])
        for (name, one), offset in zip(columns.items(), offsets, strict=True)
    ]
    return PointCloud.checked(
        rows.reshape(-1),
        frame_id="lidar",
        stamp_ns=5,
        fields=fields,
        is_bigendian=is_bigendian,
        is_dense=False,
        shape=(height, width),
        steps=(rows.shape[1], dtype.itemsize),
    )


def column(cloud: PointCloud, name: str) -> npt.NDArray[np.generic]:
    """Return a field of all points (N,)."""
    field = next(one for one in cloud.fields if one.name == name)
    form = next(form for form, number in FORMATS.items() if number == field.datatype)
    rows = cloud.data[:, : cloud.width * cloud.point_step].reshape(-1, cloud.point_step)
    size = np.dtype(form).itemsize
    raw = rows[:, field.offset : field.offset + size].tobytes()
    return np.frombuffer(raw, (">" if cloud.is_bigendian else "<") + form)


def laser_rays(elevations: Sequence[float], azimuths: Floats, stagger: float = 0.0) -> Floats:
    """Return the unit vectors (rings, columns, 3) of a turning laser, odd rings staggered."""
    up, around = np.meshgrid(elevations, azimuths, indexing="ij")
    around = around + stagger * (np.arange(len(elevations)) % 2)[:, None]
    flat = np.cos(up)
    return np.stack((flat * np.cos(around), flat * np.sin(around), np.sin(up)), axis=2)


def camera_rays(height: int, width: int, focal: float) -> Floats:
    """Return the unit vectors (height, width, 3) of a camera that looks along z."""
    rows, columns = np.mgrid[:height, :width].astype(float)
    x, y = (columns - 0.5 * width + 0.2) / focal, (rows - 0.5 * height - 0.4) / focal
    rays = np.stack((x, y, np.ones_like(x)), axis=2)
    return np.asarray(rays / np.linalg.norm(rays, axis=2, keepdims=True))


ELEVATIONS = np.radians(np.arange(-15.0, 16.0, 2.0))
AZIMUTHS = np.radians(np.arange(-180.0, 180.0, 0.4))


@pytest.mark.parametrize("pose", [HERE, TILTED])
@pytest.mark.parametrize("kind", ["f4", "f8"])
def test_returns_behind_an_artefact_are_on_it(pose: RigidTransform, kind: str) -> None:
    """Any rays, at any distance: 4,000 of them, each as trimesh has it; the others keep bits."""
    rng = np.random.default_rng(3)
    rays = rng.normal(size=(4_000, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    points_m = (rays * rng.uniform(0.3, 6.0, (4_000, 1))).astype(kind).astype(np.float64)
    cloud = cloud_of(points_m[None], kind)
    after = cloud.augmented(pose, obstacles())
    ranges_m = np.linalg.norm(points_m, axis=1)
    hits_m = oracle(pose, points_m / ranges_m[:, None])
    is_hit = hits_m < ranges_m
    assert 50 < is_hit.sum() < 1_000
    found = after.points_m()[:4_000]
    expected = np.where(is_hit[:, None], points_m * (hits_m / ranges_m)[:, None], points_m)
    np.testing.assert_allclose(found, expected, atol=2e-6)
    same = (found == points_m).all(axis=1)
    assert (same == ~is_hit).all()


def far_room(rays: Floats, missing: npt.NDArray[np.bool_], nothing: float = math.nan) -> Floats:
    """Return points on a ball of 8 m, and nothing where missing."""
    return np.where(missing[..., None], nothing, 8.0 * rays)


@pytest.mark.parametrize("nothing", [math.nan, math.inf, 0.0])
@pytest.mark.parametrize("name", ["camera", "laser", "staggered", "transposed", "half turn"])
def test_rays_of_an_organised_cloud_without_return(name: str, nothing: float) -> None:
    """A third has no return, and whole columns and rows: the hits are where trimesh has them."""
    pose = CAMERA if name == "camera" else TILTED
    rays = {
        "camera": camera_rays(60, 80, 50.0),
        "laser": laser_rays(ELEVATIONS, AZIMUTHS),
        "staggered": laser_rays(ELEVATIONS, AZIMUTHS, 0.003),
        "transposed": laser_rays(ELEVATIONS, AZIMUTHS).swapaxes(0, 1).copy(),
        "half turn": laser_rays(ELEVATIONS, AZIMUTHS[200:700]),
    }[name]
    rng = np.random.default_rng(5)
    missing = rng.random(rays.shape[:2]) < 0.3
    missing[:, 20:24] = True
    missing[8, :] |= name != "staggered"  # by how much that row is shifted nobody can tell
    if name == "camera":
        missing[:, :3] = missing[-2:] = True
    cloud = cloud_of(far_room(rays, missing, nothing))
    after = cloud.augmented(pose, obstacles())
    hits_m = oracle(pose, rays.reshape(-1, 3))
    expected = np.where(
        (hits_m < 8.0)[:, None], rays.reshape(-1, 3) * hits_m[:, None], cloud.points_m()
    )
    found = after.points_m()
    is_edge = np.zeros(len(hits_m), np.bool_)
    for turn in np.eye(3) * 2e-5:  # rays that graze an edge may be on either side of it
        is_edge |= np.isfinite(oracle(pose, _turned(rays, turn))) != np.isfinite(hits_m)
    assert is_edge.sum() < 4
    np.testing.assert_allclose(found[~is_edge], expected[~is_edge], atol=2e-4)
    assert (missing.ravel() & (hits_m < 8.0)).sum() > 40
    untouched = hits_m == np.inf
    before = cloud.points_m()[untouched].view(np.uint32)
    assert (found[untouched & ~is_edge].view(np.uint32) == before[~is_edge[untouched]]).all()


def _turned(rays: Floats, by: Floats) -> Floats:
    turned = rays.reshape(-1, 3) + np.cross(by, rays.reshape(-1, 3))
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))


@pytest.mark.parametrize("has_rings", [True, False])
def test_gaps_of_an_unorganised_laser_cloud(*, has_rings: bool) -> None:
    """Rays that did not come back, in gaps of up to 8 degrees: those that hit are there, once."""
    rng = np.random.default_rng(7)
    rays = laser_rays(ELEVATIONS, AZIMUTHS)
    missing = rng.random(rays.shape[:2]) < 0.2
    missing[:, 450:470] = missing[5, 400:520] = True
    is_there = ~missing.ravel()
    rings = np.repeat(np.arange(len(ELEVATIONS), dtype=np.uint16), 900)
    order = rng.permutation(np.flatnonzero(is_there))
    others = {"ring": rings[order][None]} if has_rings else {}
    cloud = cloud_of((8.0 * rays.reshape(-1, 3)[order])[None], **others)
    after = cloud.augmented(HERE, obstacles())
    hits_m = oracle(HERE, rays.reshape(-1, 3))
    wanted = rays.reshape(-1, 3)[~is_there & np.isfinite(hits_m)]
    added = after.points_m()[len(order) :].astype(np.float64)
    assert len(wanted) > 80
    assert abs(len(added) - len(wanted)) <= 2
    ranges_m = np.linalg.norm(added, axis=1)
    np.testing.assert_allclose(ranges_m, oracle(HERE, added / ranges_m[:, None]), atol=1e-4)
    apart = 1.0 - (added / ranges_m[:, None]) @ wanted.T
    assert np.count_nonzero(apart.min(axis=1) > 1e-8) <= 2
    if has_rings:
        elevations = np.arcsin(added[:, 2] / ranges_m)
        ring = column(after, "ring")[len(order) :].astype(int)
        np.testing.assert_allclose(elevations, ELEVATIONS[ring], atol=1e-5)


def test_a_laser_sees_nothing_where_it_does_not_look() -> None:
    """One of 120 degrees, forward: what stands behind and beside it gets no points."""
    azimuths = np.radians(np.arange(-60.0, 60.0, 0.4))
    rays = laser_rays(ELEVATIONS, azimuths).reshape(-1, 3)
    cloud = cloud_of((8.0 * rays)[None])
    after = cloud.augmented(HERE, obstacles())
    points_m = after.points_m().astype(np.float64)
    assert after.width == cloud.width
    assert (np.abs(np.arctan2(points_m[:, 1], points_m[:, 0])) <= math.radians(60.01)).all()
    assert (np.linalg.norm(points_m, axis=1) < 7.9).sum() > 100


@pytest.mark.parametrize("pose", [HERE, CAMERA])
def test_points_in_a_hole_of_a_cloud_without_rows_are_as_dense(pose: RigidTransform) -> None:
    """Directions anywhere in a cone, none in the middle: as many per solid angle."""
    rng = np.random.default_rng(9)
    forward = 2 if pose is CAMERA else 0
    towards = np.eye(3)[forward]
    rays = rng.normal(size=(60_000, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    cosines = rays @ towards
    middle = pose.rotation_matrix().T @ (WORLD.centres_m[0] - pose.translation_m)
    in_hole = rays @ (middle / np.linalg.norm(middle)) > math.cos(0.06)
    rays, in_hole = rays[cosines > math.cos(0.7)], in_hole[cosines > math.cos(0.7)]
    cloud = cloud_of((8.0 * rays[~in_hole])[None])
    after = cloud.augmented(pose, obstacles())
    added = after.points_m()[cloud.width :].astype(np.float64)
    inside = added @ (middle / np.linalg.norm(middle)) / np.linalg.norm(added, axis=1)
    assert in_hole.sum() > 40
    share = np.count_nonzero(inside > math.cos(0.06)) / in_hole.sum()
    assert 0.5 < share < 2.0


def test_lines_of_a_laser_that_does_not_scan_line_by_line_are_no_rows() -> None:
    """Rays anywhere, of four lasers at random: as if their numbers were not known."""
    rng = np.random.default_rng(9)
    rays = rng.normal(size=(9_000, 3)) * (1.0, 1.0, 0.3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    lines = rng.integers(0, 4, len(rays), dtype=np.uint8)
    without = cloud_of((8.0 * rays)[None]).augmented(HERE, obstacles())
    after = cloud_of((8.0 * rays)[None], line=lines[None]).augmented(HERE, obstacles())
    np.testing.assert_array_equal(after.points_m(), without.points_m())


@pytest.mark.parametrize("has_rings", [True, False])
@pytest.mark.parametrize("tilt_rad", [0.2, -1.5])
def test_rows_of_a_tilted_frame_have_another_pole(tilt_rad: float, *, has_rings: bool) -> None:
    """A turning laser in a frame along whose z it does not turn: the same rays are missing."""
    tilted = RigidTransform.from_xyz_ypr(0.0, 0.0, 0.0, 0.0, 0.4, tilt_rad)
    rays = laser_rays(ELEVATIONS, AZIMUTHS).reshape(-1, 3)
    rings = np.repeat(np.arange(len(ELEVATIONS), dtype=np.uint8), 900)
    is_there = np.random.default_rng(7).random(len(rays)) > 0.2
    rays = 8.0 * rays[is_there]
    others: dict[str, Any] = {"ring": rings[is_there][None]} if has_rings else {}
    straight = cloud_of(rays[None], "f8", **others).augmented(HERE, obstacles())
    cloud = cloud_of(tilted.inverse().apply(rays)[None], "f8", **others)
    after = cloud.augmented(HERE @ tilted, obstacles())
    assert straight.width > len(rays) + 80
    assert after.width == straight.width
    found, wanted = tilted.apply(after.points_m()), straight.points_m()
    apart = np.linalg.norm(found[:, None] - wanted[len(rays) :], axis=2)
    np.testing.assert_allclose(found[: len(rays)], wanted[: len(rays)], atol=1e-6)
    assert apart.min(axis=0).max() < 1e-5


def wall(distance_m: float) -> VoxelField:
    """Return a wall of voxels across the x axis."""
    occupied = np.zeros((2, 80, 40), np.uint8)
    occupied[0] = 1
    at = RigidTransform.from_xyz_ypr(distance_m, -4.0, -2.0, 0.0, 0.0, 0.0)
    return VoxelField.of(VoxelMap(at, (0.1, 0.1, 0.1), occupied))


def test_where_nothing_came_back_the_walls_of_the_map_hide() -> None:
    """A return proves that its ray is free, whatever the map says; a hole does not."""
    rays = camera_rays(60, 80, 50.0)
    pose = RigidTransform.from_xyz_ypr(0.0, 0.0, 0.0, -0.5 * math.pi, 0.0, -0.5 * math.pi)
    missing = np.zeros((60, 80), np.bool_)
    missing[:, ::2] = True
    cloud = cloud_of(far_room(rays, missing))
    hits_m = oracle(pose, rays.reshape(-1, 3)).reshape(60, 80)
    for surface, is_hidden in ((wall(1.0), True), (wall(5.0), False)):
        after = cloud.augmented(pose, obstacles(surface)).points_m().reshape(60, 80, 3)
        on_it = np.linalg.norm(after, axis=2) < 7.9
        assert (on_it[:, 1::2] == np.isfinite(hits_m[:, 1::2])).all()
        assert on_it[:, ::2].any() != is_hidden


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize("is_organised", [False, True])
def test_other_fields(*, is_bigendian: bool, is_organised: bool) -> None:
    """Strength 0, the range in its own unit, the rest as received; padding and order stay."""
    rays = laser_rays(ELEVATIONS, AZIMUTHS)
    missing = np.zeros(rays.shape[:2], np.bool_)
    missing[::3, 400:500:7] = True
    points_m, count = far_room(rays, missing), rays.shape[0] * rays.shape[1]
    if not is_organised:
        points_m = points_m[~missing][None]
    shape = points_m.shape[:2]
    cloud = cloud_of(
        points_m,
        is_bigendian=is_bigendian,
        padding=5,
        intensity=np.full(shape, 9.0, np.float32),
        reflectivity=np.full(shape, 77, np.uint16),
        range=np.full(shape, 8_000, np.uint32),
        t=np.arange(shape[0] * shape[1], dtype=np.uint32).reshape(shape),
    )
    after = cloud.augmented(HERE, obstacles())
    assert (after.fields, after.point_step) == (cloud.fields, cloud.point_step)
    ranges_m = np.linalg.norm(after.points_m().astype(np.float64), axis=1)
    on_it = ranges_m < 7.9
    assert on_it.sum() > 100
    for name in ("intensity", "reflectivity"):
        values = column(after, name)
        assert (values[on_it] == 0).all()
        assert (values[~on_it] == column(cloud, name)[0]).all()
    np.testing.assert_allclose(column(after, "range")[on_it], 1000.0 * ranges_m[on_it], atol=1.0)
    before, times = column(cloud, "t"), column(after, "t")
    assert (times[: len(before)] == before).all()
    if is_organised:
        assert len(times) == count
        assert (after.data[:, -5:] == 7).all()
    else:
        assert len(times) > len(before)
        assert np.isin(times, before).all()


def test_untouched_clouds_come_back_as_the_same_object() -> None:
    """With nothing in view, nothing at all, or everything in front, nothing is made anew."""
    rays = laser_rays(ELEVATIONS, AZIMUTHS).reshape(-1, 3)
    far = OrientedBoxes(np.array([[30.0, 0.0, 0.0]]), np.zeros(1), np.full((1, 3), 0.5))
    nobody = Obstacles(far, MeshSelection.boxes_only(1))
    clouds = (cloud_of((8.0 * rays)[None]), cloud_of((0.3 * rays)[None]))
    assert clouds[0].augmented(HERE, nobody) is clouds[0]
    assert clouds[1].augmented(HERE, obstacles()) is clouds[1]
    for nothing in (np.empty((1, 0, 3)), np.full((4, 4, 3), np.nan), np.empty((0, 0, 3))):
        cloud = cloud_of(nothing)
        assert cloud.augmented(HERE, obstacles()) is cloud


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    shape=st.tuples(st.integers(1, 9), st.integers(1, 40)),
    special=st.sampled_from([0.0, math.nan, math.inf, -math.inf, 1e38, 1e-30]),
    share=st.floats(0.0, 1.0),
)
def test_whatever_a_cloud_holds_it_passes(
    seed: int, shape: tuple[int, int], special: float, share: float
) -> None:
    """Odd numbers anywhere: no error and no warning, and points only ever come nearer."""
    rng = np.random.default_rng(seed)
    points_m = rng.normal(size=(*shape, 3)) * 4.0
    points_m[rng.random((*shape, 3)) < share] = special
    cloud = cloud_of(points_m)
    after = cloud.augmented(TILTED, obstacles())
    count = shape[0] * shape[1]
    found, before = (one.points_m()[:count].astype(np.float64) for one in (after, cloud))
    moved = ~((found == before) | (np.isnan(found) & np.isnan(before))).all(axis=1)
    is_return = np.isfinite(before).all(axis=1) & (np.abs(before).max(axis=1) > 1e-3)
    closer = np.linalg.norm(found, axis=1) < np.linalg.norm(before, axis=1)
    assert closer[moved & is_return].all()
    assert np.isfinite(found[moved]).all()


@pytest.mark.parametrize("kind", ["<f4", "<f8", ">f4"])
@pytest.mark.parametrize("step", [16, 27])
def test_what_is_far_from_all_costs_one_look(kind: str, step: int) -> None:
    """The farthest return and the returns in a cone, as numpy finds them, wherever numbers lie."""
    random, size = np.random.default_rng(step), np.dtype(kind).itemsize
    values = random.normal(size=(3, 203)).astype(kind)
    values[:, ::7], values[1, 3::11], values[:, 5::13] = np.nan, np.inf, 0.0
    rows = np.zeros((203, 3 * size + step), np.uint8)
    rows[:, : 3 * size] = np.ascontiguousarray(values.T).view(np.uint8).reshape(203, -1)
    fields = tuple(CloudField(name, k * size, 6 + size // 4) for k, name in enumerate("xyz"))
    cloud = PointCloud(
        "laser", 0, fields, kind[0] == ">", False, 203, rows.shape[1], rows.reshape(1, -1)
    )
    axes = cloud._coordinates()
    ranges_m = np.sqrt((values.astype(np.float64) ** 2).sum(axis=0))
    is_return = np.isfinite(ranges_m) & (ranges_m > 0.0)
    assert _farthest_return(*axes) == ranges_m[is_return].max()
    rays = (values / np.where(is_return, ranges_m, 1.0)).T.astype(np.float64)
    expected = np.flatnonzero(is_return & (rays[:, 2] > 0.3))
    found, ours, lengths_m = _returns_in(*axes, np.array([(0.0, 0.0, 1.0, 0.3)]))
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_allclose(ours, rays[expected], atol=1e-7)
    np.testing.assert_array_equal(lengths_m, ranges_m[expected])


@pytest.mark.parametrize("shape", [(1, 0), (0, 0), (0, 5)])
@pytest.mark.parametrize("with_rings", [False, True])
def test_a_cloud_without_points_stays_as_it_is(shape: tuple[int, int], *, with_rings: bool) -> None:
    """Also where its sensor stands within the ball about an artefact, whatever its fields are."""
    fields = [CloudField(name, 4 * k, 7) for k, name in enumerate("xyz")]
    fields += [CloudField("ring", 12, 4)] if with_rings else []
    cloud = PointCloud.checked(
        np.empty(0, np.uint8),
        frame_id="laser",
        stamp_ns=1,
        fields=fields,
        is_bigendian=False,
        is_dense=True,
        shape=shape,
        steps=(16 * shape[1], 16),
    )
    near = OrientedBoxes(np.array([[0.3, 0.0, 0.0]]), np.zeros(1), np.full((1, 3), 0.5))
    assert cloud.augmented(HERE, Obstacles(near, MeshSelection.boxes_only(1))) is cloud


def test_a_body_of_which_only_the_near_side_is_within_reach_is_met() -> None:
    """Its centre is farther than every return."""
    angles = np.arange(360) * math.tau / 360
    ring = np.stack((2.0 * np.cos(angles), 2.0 * np.sin(angles), 0.0 * angles), axis=1)
    far = OrientedBoxes(np.array([[2.3, 0.0, 0.0]]), np.zeros(1), np.array([[0.5, 0.3, 1.0]]))
    cloud = PointCloud.of_points("laser", 1, ring)
    changed = cloud.augmented(HERE, Obstacles(far, MeshSelection.boxes_only(1)))
    assert np.linalg.norm(changed.points_m(), axis=1).min() == pytest.approx(1.8, abs=1e-3)
