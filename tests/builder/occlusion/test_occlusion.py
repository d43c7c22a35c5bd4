"""The z-buffer against a slow pixel-by-pixel twin, against Embree, and on scenes made by hand."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pytest
import trimesh

from are_ros.builder.occlusion.kernels import Visibility, render
from are_ros.builder.occlusion.meshes import MeshPool, MeshSelection
from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.occlusion.zbuffer import ZBuffer
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.cameras import (
    FORWARD_FROM_OPTICAL,
    FisheyeView,
    OmnidirectionalView,
    PinholeView,
    ViewModel,
)
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap
from tests.world.surface import exposed_faces

Floats = npt.NDArray[np.float64]
Mesh = tuple[npt.NDArray[np.floating], npt.NDArray[np.integer]]

VIEW = PinholeView.from_field_of_view(60, 44, math.pi / 2)
VIEWS: dict[str, ViewModel] = {
    "pinhole": VIEW,
    "distorted": PinholeView(60, 44, 40.0, 41.0, 29.0, 22.0, (-0.3, 0.02) + (0.0,) * 12),
    "fisheye": FisheyeView(60, 44, 15.0, 15.0, 30.0, 21.0, (0.01, 0.0, 0.0, 0.0)),
    "omnidirectional": OmnidirectionalView(96, 30, -0.8, 0.6),
}
NOTHING = VoxelField.empty()


def _camera(x: float, y: float, z: float, yaw: float = 0.0, pitch: float = 0.0) -> RigidTransform:
    """Return map_from_camera of an optical frame that looks along +x, turned by yaw and pitch."""
    return RigidTransform.from_xyz_ypr(x, y, z, yaw, pitch, 0.0) @ FORWARD_FROM_OPTICAL


def _boxes(*rows: tuple[float, float, float, float, float, float, float]) -> OrientedBoxes:
    """Return boxes of x, y, z of the centre, yaw, length, width, height."""
    table = np.array(rows, dtype=np.float64).reshape(-1, 7)
    return OrientedBoxes(table[:, :3], table[:, 3], 0.5 * table[:, 4:])


def _map_rays(view: ViewModel, map_from_camera: RigidTransform) -> Floats:
    rays = view.directions().reshape(-1, 3).astype(np.float64)
    turned: Floats = rays @ map_from_camera.rotation_matrix().T
    return turned


# The slow twin: float64, one box, voxel or triangle at a time, every pixel.


def _slab(origin: Floats, rays: Floats, low: Floats, high: Floats) -> Floats:
    """Return where rays enter a box: 0 from inside, inf if they miss."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - origin) / rays, (high - origin) / rays
    near = np.maximum(np.minimum(a, b).max(axis=1), 0.0)
    return np.where(near <= np.maximum(a, b).min(axis=1), near, np.inf)


def _in_box_frame(points: Floats, yaw: float) -> Floats:
    cosine, sine = math.cos(yaw), math.sin(yaw)
    turned: Floats = points @ np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return turned


def _triangle_depth(origin: Floats, rays: Floats, mesh: Mesh) -> Floats:
    best = np.full(len(rays), np.inf)
    for corner, second, third in mesh[0][mesh[1]]:
        a, b = second - corner, third - corner
        across = np.cross(rays, b)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1.0 / (across @ a)
            u = (across @ (origin - corner)) * scale
            beside = np.cross(origin - corner, a)
            v, t = (rays @ beside) * scale, (b @ beside) * scale
        hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t >= 0.0)
        best = np.where(hit, np.fmin(best, t), best)
    return best


def _voxel_depth(origin: Floats, rays: Floats, voxels: VoxelMap) -> Floats:
    turn = voxels.map_from_lattice.rotation_matrix()
    start, turned = (origin - voxels.map_from_lattice.translation_m) @ turn, rays @ turn
    size, best = np.array(voxels.voxel_size_m), np.full(len(rays), np.inf)
    for voxel in np.argwhere(voxels.occupied):
        depth = _slab(start, turned, voxel * size, (voxel + 1) * size)
        best = np.where(depth > 0.0, np.minimum(best, depth), best)
    return best


def _twin(
    view: ViewModel,
    map_from_camera: RigidTransform,
    boxes: OrientedBoxes,
    voxels: VoxelMap,
    meshes: Sequence[Mesh | None] | None,
    mutual: bool,
    max_range: float,
    by_mesh: bool = False,
) -> npt.NDArray[np.bool_]:
    """Return for each artefact and pixel whether it is seen, and whether it is met: (2, N, P)."""
    origin, rays = map_from_camera.translation_m, _map_rays(view, map_from_camera)
    has_ray = rays.any(axis=1)
    environment = _voxel_depth(origin, rays, voxels)
    depths, shapes = [], []
    for i in range(len(boxes)):
        yaw, half = float(boxes.yaws_rad[i]), boxes.half_sizes_m[i]
        start = _in_box_frame((origin - boxes.centres_m[i])[np.newaxis], yaw)[0]
        turned = _in_box_frame(rays, yaw)
        depth = _slab(start, turned, -half, half)
        mesh = None if meshes is None else meshes[i]
        shapes.append(depth if mesh is None else _triangle_depth(start, turned, mesh))
        target = shapes[-1] if by_mesh else depth
        depths.append(np.where(has_ray & (target <= max_range), target, np.inf))
    seen = []
    for i, depth in enumerate(depths):
        others = [shape for j, shape in enumerate(shapes) if j != i and mutual]
        front = np.min([environment, *others], axis=0)
        seen.append((depth <= max_range) & (depth <= front + 1e-3))
    return np.array([seen, np.isfinite(depths)])


def _random_scene(seed: int) -> tuple[RigidTransform, OrientedBoxes, VoxelMap, list[Mesh]]:
    """Return a camera among eight boxes, and some eighty voxels."""
    rng = np.random.default_rng(seed)
    x, y, z, yaw, pitch = rng.uniform((-0.3, -0.3, 0.5, -3.1, -0.4), (0.3, 0.3, 1.5, 3.1, 0.4))
    camera = _camera(x, y, z, yaw, pitch)
    bearings, ranges = yaw + rng.uniform(-1.0, 1.0, 8), rng.uniform(1.5, 6.0, 8)
    table = np.column_stack(
        (
            ranges * np.cos(bearings),
            ranges * np.sin(bearings),
            rng.uniform(0.4, 1.2, 8),
            rng.uniform(-3.1, 3.1, 8),
            rng.uniform(0.3, 1.3, (8, 3)),
        )
    )
    boxes = _boxes(*(tuple(row) for row in table.tolist()))
    occupied = (rng.random((14, 12, 6)) < 0.08).astype(np.uint8)
    occupied[6:11, 2:7] = 0
    pose = RigidTransform.planar(-5.0, -4.0, 0.2, z=-0.2)
    voxels = VoxelMap(pose, (0.7, 0.7, 0.5), occupied)
    meshes = [_mesh_in(half, i) for i, half in enumerate(boxes.half_sizes_m)]
    return camera, boxes, voxels, meshes


def _mesh_in(half: Floats, number: int) -> Mesh:
    """Return a mesh that just fits a box: the box, an ellipsoid, or a leaning pyramid."""
    if number % 3 == 0:
        made = trimesh.creation.box(2.0 * half)
        return np.array(made.vertices), np.array(made.faces)
    if number % 3 == 1:
        ball = trimesh.creation.icosphere(subdivisions=1)
        return np.array(ball.vertices) / np.abs(ball.vertices).max(axis=0) * half, ball.faces
    points = np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [0.7, 0, 1]]) * half
    faces = [[0, 1, 2], [0, 2, 3], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
    return points, np.array(faces)


def _selection(meshes: Sequence[Mesh | None] | None) -> MeshSelection | None:
    if meshes is None:
        return None
    there = np.array([mesh is not None for mesh in meshes])
    pool = MeshPool.of([mesh for mesh in meshes if mesh is not None])
    return MeshSelection(pool, np.where(there, np.cumsum(there) - 1, -1))


@pytest.mark.parametrize("name", list(VIEWS))
@pytest.mark.parametrize("mode", ["box", "mesh", "some mesh", "alone", "by mesh"])
@pytest.mark.parametrize("seed", range(5))
def test_random_scenes_agree_with_the_slow_twin(name: str, mode: str, seed: int) -> None:
    """Counts differ by at most one pixel per artefact, for every view and kind of occluder."""
    view, (camera, boxes, voxels, meshes) = VIEWS[name], _random_scene(seed)
    used: Sequence[Mesh | None] | None = meshes if "mesh" in mode else None
    by_mesh = mode == "by mesh"
    if mode == "some mesh":
        used = [mesh if i % 2 else None for i, mesh in enumerate(meshes)]
    seen, met = _twin(view, camera, boxes, voxels, used, mode != "alone", 6.0, by_mesh)
    field, shapes = VoxelField.of(voxels), _selection(used)
    result = ZBuffer(view, 6.0).visibility(
        camera, boxes, field, shapes, mode != "alone", by_mesh=by_mesh
    )
    assert np.abs(result.visible_pixels - seen.sum(axis=1)).max() <= 1
    assert np.abs(result.unoccluded_pixels - met.sum(axis=1)).max() <= 1


@pytest.mark.parametrize("seed", range(5))
def test_rectangle_and_nearest_distance_are_those_of_the_visible_pixels(seed: int) -> None:
    """Region and range of each artefact are the twin's, over its visible pixels."""
    camera, boxes, voxels, _ = _random_scene(seed)
    seen, _ = _twin(VIEW, camera, boxes, voxels, None, True, 20.0)
    result = ZBuffer(VIEW, 20.0).visibility(camera, boxes, VoxelField.of(voxels))
    origin, rays = camera.translation_m, _map_rays(VIEW, camera)
    compared = 0
    for i, mask in enumerate(seen):
        if mask.sum() != result.visible_pixels[i]:
            continue
        assert tuple(result.rois[i].tolist()) == _rectangle(mask.reshape(VIEW.height, VIEW.width))
        yaw, half = float(boxes.yaws_rad[i]), boxes.half_sizes_m[i]
        start = _in_box_frame((origin - boxes.centres_m[i])[np.newaxis], yaw)[0]
        depth = _slab(start, _in_box_frame(rays, yaw), -half, half)
        assert result.nearest_m[i] == pytest.approx(depth.min(where=mask, initial=np.inf), abs=1e-5)
        compared += int(mask.any())
    assert compared >= 2


def _rectangle(mask: npt.NDArray[np.bool_]) -> tuple[int, int, int, int]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not rows.size:
        return 0, 0, 0, 0
    x, y = int(columns[0]), int(rows[0])
    return x, y, int(columns[-1]) - x + 1, int(rows[-1]) - y + 1


@pytest.mark.parametrize("seed", range(3))
def test_random_scenes_agree_with_embree(seed: int) -> None:
    """With Embree for the environment and the meshes, counts differ by at most two pixels.

    Embree's own float32 may decide another edge pixel than ours, hence one more than the twin's.
    """
    view = PinholeView.from_field_of_view(160, 120, math.pi / 2)
    camera, boxes, voxels, meshes = _random_scene(seed)
    rays, origin = _map_rays(view, camera), camera.translation_m
    environment = _embree_depth(exposed_faces(voxels), origin, rays)
    shapes, depths = [], []
    for i, (vertices, faces) in enumerate(meshes):
        yaw, half = float(boxes.yaws_rad[i]), boxes.half_sizes_m[i]
        pose = RigidTransform.planar(0.0, 0.0, yaw)
        placed = trimesh.Trimesh(pose.apply(vertices) + boxes.centres_m[i], faces, process=False)
        shapes.append(_embree_depth(placed, origin, rays))
        start = _in_box_frame((origin - boxes.centres_m[i])[np.newaxis], yaw)[0]
        depths.append(_slab(start, _in_box_frame(rays, yaw), -half, half))
    field = VoxelField.of(voxels)
    result = ZBuffer(view, 50.0).visibility(camera, boxes, field, _selection(meshes))
    for i, depth in enumerate(depths):
        front = np.min([environment, *shapes[:i], *shapes[i + 1 :]], axis=0)
        seen = np.isfinite(depth) & (depth <= front + 1e-3)
        assert abs(int(result.visible_pixels[i]) - int(seen.sum())) <= 2


def _embree_depth(mesh: trimesh.Trimesh, origin: Floats, rays: Floats) -> Floats:
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    points, which, _ = RayMeshIntersector(mesh).intersects_location(
        np.tile(origin, (len(rays), 1)), rays, multiple_hits=False
    )
    depth = np.full(len(rays), np.inf)
    depth[which] = np.linalg.norm(points - origin, axis=1)
    return depth


def _wall(y_from: float, y_to: float) -> VoxelField:
    """Return a wall of 0.1 m voxels at 2.0 <= x < 2.1, from y_from to y_to, 2 m high."""
    count = round((y_to - y_from) / 0.1)
    pose = RigidTransform.planar(2.0, y_from, 0.0)
    return VoxelField.of(VoxelMap(pose, (0.1, 0.1, 0.1), np.ones((1, count, 20), dtype=np.uint8)))


AHEAD = _camera(0.0, 0.0, 1.0)
PERSON = _boxes((4.0, 0.0, 0.9, 0.0, 0.6, 0.6, 1.8))


def _agrees_with_twin(boxes: OrientedBoxes, voxels: VoxelMap, camera: RigidTransform) -> list[int]:
    """Compare to within a pixel where nothing is hidden by other artefacts; return what is seen."""
    seen, _ = _twin(VIEW, camera, boxes, voxels, None, False, 20.0)
    result = ZBuffer(VIEW, 20.0).visibility(camera, boxes, VoxelField.of(voxels), mutual=False)
    assert np.abs(result.visible_pixels - seen.sum(axis=1)).max() <= 1
    counts: list[int] = result.visible_pixels.tolist()
    return counts


def test_a_box_between_a_pillar_and_a_wall_is_hidden_by_the_pillar_alone() -> None:
    """Rays beside thin pillars meet a wall, which tells nothing of what stands before it."""
    occupied = np.zeros((31, 40, 20), dtype=np.uint8)
    occupied[0, ::4], occupied[30] = 1, 1
    voxels = VoxelMap(RigidTransform.planar(2.0, -2.0, 0.0), (0.1, 0.1, 0.1), occupied)
    before = _boxes((3.5, 0.0, 0.9, 0.0, 0.4, 1.8, 1.8), (7.0, 0.0, 0.9, 0.0, 0.4, 1.8, 1.8))
    between, behind = _agrees_with_twin(before, voxels, _camera(0.013, 0.021, 1.03))
    assert between > 100
    assert behind == 0


def test_the_voxel_around_the_camera_blocks_no_ray_of_which_a_neighbour_is_blocked() -> None:
    """Rays to the left meet the voxel beside the camera's own; those to the right see a box."""
    occupied = np.zeros((1, 2, 1), dtype=np.uint8)
    occupied[0] = 1
    voxels = VoxelMap(RigidTransform.identity(), (1.0, 1.0, 1.0), occupied)
    box = _boxes((4.0, 0.5, 0.5, 0.0, 0.5, 3.0, 2.0))
    (seen,) = _agrees_with_twin(box, voxels, _camera(0.05, 0.97, 0.5))
    assert seen > 100


def test_a_box_behind_a_wall_is_met_and_not_seen() -> None:
    """The wall hides all of it: nothing visible, no rectangle, no distance."""
    result = ZBuffer(VIEW, 20.0).visibility(AHEAD, PERSON, _wall(-2.0, 2.0))
    assert result.unoccluded_pixels[0] > 50
    assert result.visible_pixels[0] == 0
    assert result.rois.tolist() == [[0, 0, 0, 0]]
    assert result.nearest_m[0] == np.inf


def test_a_box_in_front_of_a_wall_is_seen_whole() -> None:
    """What stands nearer than the wall loses no pixel; its nearest face is 1.2 m off."""
    near = _boxes((1.5, 0.0, 0.9, 0.0, 0.6, 0.6, 1.8))
    result = ZBuffer(VIEW, 20.0).visibility(AHEAD, near, _wall(-2.0, 2.0))
    assert result.visible_pixels[0] == result.unoccluded_pixels[0] > 200
    assert result.nearest_m[0] == pytest.approx(1.2, abs=0.001)


def test_a_half_hidden_box_shows_its_other_half() -> None:
    """A wall on the left (y > 0) leaves the right half of the image's columns."""
    result = ZBuffer(VIEW, 20.0).visibility(AHEAD, PERSON, _wall(0.0, 2.0))
    assert result.visible_pixels[0] * 2 == result.unoccluded_pixels[0]
    assert result.rois[0, 0] == 30


@pytest.mark.parametrize("tilt", [0.0, 0.2, 0.5])
def test_a_box_on_the_floor_loses_no_pixel_to_it(tilt: float) -> None:
    """The box's bottom is exactly the top of the floor's voxels: a tie does not hide."""
    floor = np.ones((120, 120, 1), dtype=np.uint8)
    pose = RigidTransform.planar(-1.0, -3.0, 0.0, z=-0.05)
    field = VoxelField.of(VoxelMap(pose, (0.05, 0.05, 0.05), floor))
    view = PinholeView.from_field_of_view(320, 240, math.pi / 2)
    camera = _camera(0.013, 0.021, 1.0, 0.1, tilt)
    result = ZBuffer(view, 20.0).visibility(camera, PERSON, field)
    assert result.visible_pixels[0] == result.unoccluded_pixels[0] > 1000


def test_a_camera_inside_a_box_sees_it_in_every_pixel() -> None:
    """Z_a is 0 everywhere; the box itself then hides all others, its mesh only what it covers."""
    boxes = _boxes((0.0, 0.0, 1.0, 0.3, 1.0, 1.0, 1.0), (3.0, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0))
    result = ZBuffer(VIEW, 20.0).visibility(AHEAD, boxes, _wall(-2.0, 2.0))
    assert result.visible_pixels.tolist() == [60 * 44, 0]
    assert result.rois[0].tolist() == [0, 0, 60, 44]
    assert result.nearest_m[0] == 0.0
    behind = np.array([[-0.4, -0.1, -0.1], [-0.4, 0.1, -0.1], [-0.4, 0.0, 0.1]])
    shapes = MeshSelection(MeshPool.of([(behind, np.array([[0, 1, 2]]))]), np.array([0, -1]))
    result = ZBuffer(VIEW, 20.0).visibility(AHEAD, boxes, NOTHING, shapes)
    assert result.visible_pixels[0] == 60 * 44
    assert result.visible_pixels[1] == result.unoccluded_pixels[1] > 100


def test_a_box_behind_the_camera_is_not_met() -> None:
    """A pinhole meets nothing behind its plane; an omnidirectional camera does."""
    behind = _boxes((-3.0, 0.0, 0.9, 0.0, 0.6, 0.6, 1.8))
    assert ZBuffer(VIEW, 20.0).visibility(AHEAD, behind, NOTHING).unoccluded_pixels[0] == 0
    around = ZBuffer(VIEWS["omnidirectional"], 20.0).visibility(AHEAD, behind, NOTHING)
    assert around.visible_pixels[0] > 20
    assert around.rois[0, [0, 2]].tolist() == [0, 96]


def test_a_box_across_the_image_border_counts_within_the_image() -> None:
    """Half of the box lies outside: the rectangle ends at the border."""
    aside = _boxes((3.0, 3.0, 0.9, 0.0, 0.02, 1.0, 1.8))
    result = ZBuffer(VIEW, 20.0).visibility(AHEAD, aside, NOTHING)
    assert result.rois[0, 0] == 0
    assert result.rois[0, 2] == pytest.approx(5, abs=1)


def test_pixels_outside_the_circle_of_a_fisheye_see_nothing() -> None:
    """A box around the camera fills exactly the pixels that have a ray."""
    view = FisheyeView(60, 44, 8.0, 8.0, 30.0, 21.0)
    inside = ZBuffer(view, 20.0).visibility(
        AHEAD, _boxes((0.0, 0.0, 1.0, 0.0, 9.0, 9.0, 9.0)), NOTHING
    )
    rays = int(view.directions().any(axis=2).sum())
    assert inside.visible_pixels[0] == inside.unoccluded_pixels[0] == rays < 60 * 44


def test_a_box_at_the_edge_of_a_fisheye_is_seen_up_to_the_edge() -> None:
    """A box straight back is met only where the lens has rays that far off its axis."""
    view, back = FisheyeView(60, 60, 9.0, 9.0, 29.5, 29.5), _boxes((-2.0, 0.0, 1.0, 0.0, 1, 1, 1))
    result = ZBuffer(view, 20.0).visibility(AHEAD, back, NOTHING)
    seen, met = _twin(view, AHEAD, back, _no_voxels(), None, True, 20.0)
    assert result.visible_pixels[0] == pytest.approx(int(seen.sum()), abs=1)
    assert result.unoccluded_pixels[0] == pytest.approx(int(met.sum()), abs=1)
    assert 0 < met.sum() < 60 * 60 / 2


def _no_voxels() -> VoxelMap:
    return VoxelMap(RigidTransform.identity(), (1.0, 1.0, 1.0), np.zeros((1, 1, 1), np.uint8))


def test_beyond_the_range_nothing_is_met() -> None:
    """The distance counts along the ray: a wide box at the range is met in the middle only."""
    wide = _boxes((5.5, 0.0, 1.0, 0.0, 1.0, 9.0, 1.0))
    full = ZBuffer(VIEW, 20.0).visibility(AHEAD, wide, NOTHING).unoccluded_pixels[0]
    part = ZBuffer(VIEW, 5.1).visibility(AHEAD, wide, NOTHING).unoccluded_pixels[0]
    none = ZBuffer(VIEW, 4.9).visibility(AHEAD, wide, NOTHING).unoccluded_pixels[0]
    assert full > part > none == 0
    endless = ZBuffer(VIEW, math.inf).visibility(AHEAD, wide, NOTHING)
    assert endless.visible_pixels[0] == endless.unoccluded_pixels[0] == full


def test_the_nearer_of_two_boxes_hides_the_other_unless_told_not_to() -> None:
    """Mutual occlusion acts by the box, by the mesh, or not at all."""
    boxes = _boxes((5.0, 0.0, 1.0, 0.0, 0.4, 0.4, 0.8), (2.0, 0.0, 1.0, 0.0, 1.0, 1.0, 1.2))
    buffer = ZBuffer(VIEW, 20.0)
    by_box = buffer.visibility(AHEAD, boxes, NOTHING)
    assert by_box.visible_pixels[0] == 0
    assert by_box.visible_pixels[1] == by_box.unoccluded_pixels[1]
    corner = np.array([[-0.5, 0.3, 0.5], [-0.5, 0.5, 0.5], [-0.5, 0.5, 0.6]])
    shapes = MeshSelection(MeshPool.of([(corner, np.array([[0, 1, 2]]))]), np.array([-1, 0]))
    for result in (
        buffer.visibility(AHEAD, boxes, NOTHING, shapes),
        buffer.visibility(AHEAD, boxes, NOTHING, mutual=False),
    ):
        np.testing.assert_array_equal(result.visible_pixels, result.unoccluded_pixels)


def test_a_camera_in_an_occupied_voxel_looks_out_of_it() -> None:
    """A noisy map does not blind the robot; a neighbouring voxel hides as any other."""
    occupied = np.zeros((40, 20, 20), dtype=np.uint8)
    occupied[10, 10, 10] = 1
    pose, size = RigidTransform.planar(-1.0, -1.0, 0.0), (0.1, 0.1, 0.1)
    camera, buffer = _camera(0.05, 0.05, 1.05), ZBuffer(VIEW, 20.0)
    clear = buffer.visibility(camera, PERSON, VoxelField.of(VoxelMap(pose, size, occupied)))
    assert clear.visible_pixels[0] == clear.unoccluded_pixels[0] > 50
    occupied[11, 8:13, 8:13] = 1
    blind = buffer.visibility(camera, PERSON, VoxelField.of(VoxelMap(pose, size, occupied)))
    assert blind.visible_pixels[0] == 0


def test_no_artefacts_give_an_empty_answer() -> None:
    """Arrays of length zero, read-only as always."""
    result = ZBuffer(VIEW, 20.0).visibility(AHEAD, OrientedBoxes.empty(), NOTHING)
    assert isinstance(result, Visibility)
    assert result.rois.shape == (0, 4)
    assert not result.visible_pixels.flags.writeable


def test_the_same_scene_gives_the_same_answer_at_any_image_size() -> None:
    """Sizes that are no multiple of the tile lose and invent no pixel at their borders."""
    around = _boxes((0.0, 0.0, 1.0, 0.0, 9.0, 9.0, 9.0))
    for width, height in ((1, 1), (16, 16), (17, 15), (31, 33)):
        view = PinholeView.from_field_of_view(width, height, 1.0)
        result = ZBuffer(view, 20.0).visibility(AHEAD, around, NOTHING)
        assert result.visible_pixels[0] == width * height
        assert result.rois[0].tolist() == [0, 0, width, height]


def test_the_kernel_is_compiled_once_for_every_use() -> None:
    """Boxes, meshes and any environment share one machine code: a second would stall a tick."""
    buffer, boxes = ZBuffer(VIEW, 20.0), _boxes((3.0, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0))
    shapes = MeshSelection(MeshPool.of([_mesh_in(boxes.half_sizes_m[0], 0)]), np.array([0]))
    for field in (NOTHING, _wall(-2.0, 2.0)):
        buffer.visibility(AHEAD, boxes, field)
        buffer.visibility(AHEAD, boxes, field, shapes, mutual=False)
    assert len(getattr(render, "signatures")) == 1  # noqa: B009 - numba's, unknown to mypy
