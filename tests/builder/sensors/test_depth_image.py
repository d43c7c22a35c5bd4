"""Augmented depths: every pixel against plain numpy, and rays against OpenCV."""

import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
import trimesh

from are_ros.builder.occlusion.meshes import MeshPool, MeshSelection
from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.sensors.depth_image import (
    DepthImage,
    InverseDepth,
    Metres,
    Millimetres,
    RawDepth,
)
from are_ros.builder.sensors.image import Image
from are_ros.builder.sensors.lens import Lens
from are_ros.builder.sensors.obstacles import Obstacles
from are_ros.errors import InputError
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.cameras import CameraInfo
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float64]
Numbers = npt.NDArray[Any]

WIDTH, HEIGHT = 54, 41
CAMERA = RigidTransform.from_xyz_ypr(0.1, 0.2, 0.3, 0.3 - 0.5 * math.pi, 0.1, -0.5 * math.pi)
"""An optical frame that looks forward and to the left."""
BOXES = OrientedBoxes(
    np.array([[3.0, 0.5, 0.1], [4.0, 2.5, 0.0], [2.0, 1.3, 0.4]]),
    np.array([0.3, 1.0, 0.2]),
    np.array([[0.4, 0.3, 0.8], [0.6, 0.3, 0.5], [0.4, 0.4, 0.4]]),
)
BALL = trimesh.creation.icosphere(2, 0.4)
SHAPES = MeshSelection(MeshPool.of([(BALL.vertices, BALL.faces)]), np.array([-1, -1, 0], np.int64))
LENSES: dict[str, tuple[str, tuple[float, ...]]] = {
    "pinhole": ("plumb_bob", (0.0, 0.0, 0.0, 0.0, 0.0)),
    "plumb_bob": ("plumb_bob", (-0.25, 0.08, 1e-3, -2e-3, 0.01)),
    "rational": ("rational_polynomial", (0.3, 0.1, 5e-4, 2e-4, 0.01, 0.6, 0.2, 0.03)),
    "fisheye": ("equidistant", (-0.02, 0.01, -3e-3, 1e-3)),
}
K = (30.0, 0.0, 26.2, 0.0, 31.0, 19.7, 0.0, 0.0, 1.0)


def info(lens: str = "pinhole", **changes: Any) -> CameraInfo:
    """Return a CameraInfo of the images here."""
    model, numbers = LENSES[lens]
    fx, _, cx, _, fy, cy = K[:6]
    values: dict[str, Any] = {
        "width": WIDTH,
        "height": HEIGHT,
        "distortion_model": model,
        "d": numbers,
        "k": K,
        "r": tuple(np.eye(3).ravel()),
        "p": (fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0),
        "source": "/depth/camera_info",
    }
    return CameraInfo(**(values | changes))


def lens_of(camera: CameraInfo, *, rectified: bool = False) -> Lens:
    """Return the lens of a CameraInfo."""
    return Lens("camera", camera, camera.view(rectified=rectified))


def slow_rays(lens: str) -> Floats:
    """Return the rays (H * W, 3) to 1 m of depth that OpenCV projects to the pixels."""
    model, numbers = LENSES[lens]
    matrix, here = np.array(K).reshape(3, 3), (np.zeros(3), np.zeros(3))
    project = cv2.fisheye.projectPoints if model == "equidistant" else cv2.projectPoints
    pixels = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), 2).reshape(-1, 2)
    rays = np.column_stack(((pixels - matrix[:2, 2]) / np.diag(matrix)[:2], np.ones(len(pixels))))
    for _ in range(400):
        found = project(rays[:, None], *here, matrix, np.array(numbers))[0].reshape(-1, 2)
        rays[:, :2] -= 0.7 * (found - pixels) / np.diag(matrix)[:2]
    assert np.abs(found - pixels).max() < 1e-9
    return rays


def slow_hits(rays: Floats, pose: RigidTransform = CAMERA) -> Floats:
    """Return the depth [m] of the first hit of each ray (N, 3), inf for none: each triangle."""
    parts = []
    whole = zip(BOXES.centres_m, BOXES.yaws_rad, BOXES.half_sizes_m, SHAPES.indices, strict=True)
    for centre, yaw, half, mesh in whole:
        part = BALL.copy() if mesh >= 0 else trimesh.creation.box(2.0 * half)
        part.apply_transform(trimesh.transformations.rotation_matrix(yaw, (0, 0, 1)))
        parts.append(np.asarray(part.apply_translation(centre).triangles))
    directions, depths = rays @ pose.rotation_matrix().T, np.full(len(rays), np.inf)
    for corner, second, third in np.concatenate(parts):
        a, b, apart = second - corner, third - corner, pose.translation_m - corner
        across = np.cross(directions, b)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1.0 / (across @ a)
            u, v = (across @ apart) * scale, (directions @ np.cross(apart, a)) * scale
            t = (np.cross(apart, a) @ b) * scale
        is_met = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t >= 0.0)
        depths = np.where(is_met & (t < depths), t, depths)
    return depths


def image_of(
    stored: Numbers, encoding: str = "16UC1", *, is_bigendian: bool = False, padding: int = 0
) -> RawDepth:
    """Return the message of numbers (H, W)."""
    order = ">" if is_bigendian else "<"
    number = "f4" if encoding == "32FC1" else "u2"
    rows = np.ascontiguousarray(stored.astype(order + number)).view(np.uint8)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=7)
    return RawDepth(
        Image.checked(
            rows.reshape(-1),
            frame_id="camera",
            stamp_ns=5,
            encoding=encoding,
            is_bigendian=int(is_bigendian),
            shape=stored.shape[:2],
            step=rows.shape[1],
        )
    )


def surroundings(seed: int = 1) -> Floats:
    """Return real depths (H, W) [m], near and far, a fifth of them without a return."""
    rng = np.random.default_rng(seed)
    depths_m: Floats = np.round(rng.uniform(0.5, 6.0, (HEIGHT, WIDTH)), 3)
    depths_m[rng.random((HEIGHT, WIDTH)) < 0.2] = np.nan
    return depths_m


def obstacles(surface: VoxelField | None = None, depth_range_m: float = 10.0) -> Obstacles:
    """Return two boxes and a ball."""
    return Obstacles(BOXES, SHAPES, surface, depth_range_m)


def expected(real_m: Floats, hits_m: Floats, hidden: npt.NDArray[np.bool_] | None = None) -> Floats:
    """Return the depths (H, W) [m] by the rules, pixel by pixel."""
    after_m: Floats = real_m.copy()
    hits_m = hits_m.reshape(real_m.shape)
    for place in np.ndindex(real_m.shape):
        if math.isnan(real_m[place]):
            if hits_m[place] <= 10.0 and (hidden is None or not hidden[place]):
                after_m[place] = hits_m[place]
        elif hits_m[place] < real_m[place]:
            after_m[place] = hits_m[place]
    return after_m


@pytest.mark.parametrize("name", list(LENSES))
def test_each_pixel_is_what_its_ray_meets(name: str) -> None:
    """In metres, to a ten-thousandth of a millimetre; pixels that keep their depth keep bits."""
    real_m = surroundings()
    image = image_of(real_m, "32FC1")
    after = DepthImage(image, lens_of(info(name))).augmented(CAMERA, obstacles())
    wanted = expected(real_m, slow_hits(slow_rays(name)))
    found = after.pixels.stored()
    np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-7)
    changed = (wanted != real_m) & ~np.isnan(wanted)
    assert changed.sum() > 150
    same = found.view(np.uint32) == image.stored().view(np.uint32)
    assert (same == ~changed).all()


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize("encoding", ["16UC1", "mono16", "32FC1"])
def test_encodings_and_paddings(encoding: str, is_bigendian: bool) -> None:
    """The same depths, to the step of the encoding; padding stays."""
    real_m = surroundings(2)
    numbers = real_m if encoding == "32FC1" else np.nan_to_num(np.rint(1e3 * real_m))
    image = image_of(numbers, encoding, is_bigendian=is_bigendian, padding=3)
    after = DepthImage(image, lens_of(info())).augmented(CAMERA, obstacles())
    wanted = expected(real_m, slow_hits(slow_rays("pinhole")))
    if encoding == "32FC1":
        np.testing.assert_allclose(after.pixels.stored(), wanted, rtol=1e-7)
    else:
        np.testing.assert_array_equal(after.pixels.stored(), np.nan_to_num(np.rint(1e3 * wanted)))
    assert isinstance(after.pixels, RawDepth)
    assert (after.pixels.image.data[:, -3:] == 7).all()
    assert after.pixels.image.data.shape == image.image.data.shape


def test_without_an_artefact_in_view_it_is_the_same_image() -> None:
    """Behind the camera, or behind all that came back, or rounded to what was there."""
    lens = lens_of(info())
    behind = DepthImage(image_of(np.full((HEIGHT, WIDTH), 500)), lens)
    assert behind.augmented(CAMERA, obstacles()) is behind
    away = RigidTransform.from_xyz_ypr(9.0, 0.2, 0.3, 0.3 - 0.5 * math.pi, 0.1, -0.5 * math.pi)
    image = DepthImage(image_of(np.zeros((HEIGHT, WIDTH))), lens)
    assert image.augmented(away, obstacles()) is image
    hits = slow_hits(slow_rays("pinhole")).reshape(HEIGHT, WIDTH)
    there = DepthImage(image_of(np.where(hits < 9.0, np.rint(1e3 * hits), 500)), lens)
    assert there.augmented(CAMERA, obstacles()) is there


def test_walls_hide_only_from_pixels_without_a_return() -> None:
    """A wall of the map across the view, at x = 2.5 m, and depths that contradict it."""
    occupied = np.ones((1, 80, 60), np.uint8)
    at = RigidTransform.from_xyz_ypr(2.5, -4.0, -3.0, 0.0, 0.0, 0.0)
    surface = VoxelField.of(VoxelMap(at, (0.1, 0.1, 0.1), occupied))
    real_m, rays = surroundings(3), slow_rays("pinhole")
    image = DepthImage(image_of(real_m, "32FC1"), lens_of(info()))
    found = image.augmented(CAMERA, obstacles(surface)).pixels.stored()
    hits_m = slow_hits(rays)
    ends_x = CAMERA.translation_m[0] + hits_m * (rays @ CAMERA.rotation_matrix().T)[:, 0]
    hidden = (ends_x > 2.5).reshape(HEIGHT, WIDTH)
    wanted = expected(real_m, hits_m, hidden)
    holes = np.isnan(real_m) & np.isfinite(hits_m.reshape(hidden.shape))
    assert min((holes & hidden).sum(), (holes & ~hidden).sum()) > 10
    np.testing.assert_allclose(found, wanted, rtol=1e-7)


def test_the_depth_range_ends_what_holes_show() -> None:
    """A pixel without a return shows nothing beyond the camera's range."""
    image = DepthImage(image_of(np.zeros((HEIGHT, WIDTH))), lens_of(info()))
    found = image.augmented(CAMERA, obstacles(depth_range_m=2.5)).pixels.stored() * 1e-3
    hits_m = slow_hits(slow_rays("pinhole")).reshape(HEIGHT, WIDTH)
    np.testing.assert_allclose(found, np.where(hits_m <= 2.5, hits_m, 0.0), atol=5.001e-4)
    assert 0 < np.count_nonzero(found) < np.count_nonzero(hits_m < 9.0)


def test_depth_of_a_rectified_image_goes_along_its_axis() -> None:
    """P and R take the place of K and D; the frame stays that of the camera."""
    turn = RigidTransform.from_xyz_ypr(0.0, 0.0, 0.0, 0.1, -0.2, 0.05).rotation_matrix()
    camera = info("plumb_bob", r=tuple(turn.ravel()))
    image = DepthImage(image_of(np.zeros((HEIGHT, WIDTH))), lens_of(camera, rectified=True))
    found = image.augmented(CAMERA, obstacles()).pixels.stored() * 1e-3
    hits_m = slow_hits(slow_rays("pinhole") @ turn).reshape(HEIGHT, WIDTH)
    np.testing.assert_allclose(found, np.where(hits_m < 9.0, hits_m, 0.0), atol=5.001e-4)
    assert np.count_nonzero(found) > 300


def test_from_inside_an_artefact_there_is_no_depth() -> None:
    """It is 0, or too close; a pixel that says too close itself stays."""
    inside = RigidTransform.from_xyz_ypr(3.0, 0.5, 0.1, 0.0, 0.0, 0.0)
    real_m = np.full((HEIGHT, WIDTH), 2.0)
    lens = lens_of(info())
    found = DepthImage(image_of(1e3 * real_m), lens).augmented(inside, obstacles())
    assert not found.pixels.stored().any()
    found = DepthImage(image_of(real_m, "32FC1"), lens).augmented(inside, obstacles())
    assert np.isneginf(found.pixels.stored()).all()
    assert found.augmented(CAMERA, obstacles()) is found


def test_a_lens_that_does_not_fit_is_refused() -> None:
    """None at all, or one of another size."""
    image = DepthImage(image_of(np.zeros((HEIGHT, WIDTH))))
    with pytest.raises(InputError, match="its CameraInfo is not known"):
        image.augmented(CAMERA, obstacles())
    smaller = image.seen_through(lens_of(info(width=53)))
    with pytest.raises(InputError) as caught:
        smaller.augmented(CAMERA, obstacles())
    sentence = "it has 54 x 41 pixels, and /depth/camera_info is of 53 x 41"
    assert str(caught.value) == sentence


def test_colours_are_no_depths() -> None:
    """The encodings that hold depths are named."""
    with pytest.raises(InputError, match="'mono8' holds no depth; known are 16UC1, mono16, 32FC1"):
        RawDepth(Image("camera", 5, "mono8", 0, 2, np.zeros((2, 2), np.uint8)))


QUANTUM: dict[str, tuple[Any, Callable[[Floats], Floats]]] = {
    "millimetres": (Millimetres(), lambda m: np.full_like(m, 5.0e-4)),
    "metres": (Metres(), lambda m: 1e-7 * m),
    "inverse": (InverseDepth(10100.0, -1009.0), lambda m: 0.51 * m * m / 10100.0),
}


@pytest.mark.parametrize("name", list(QUANTUM))
def test_a_depth_becomes_the_nearest_number(name: str) -> None:
    """Within half a step; numbers that came back are written as they were."""
    code, half_step_m = QUANTUM[name]
    depths_m = np.random.default_rng(4).uniform(0.3, 9.9, 2000)
    numbers = code.stored(depths_m)
    back_m = code.depths_m(numbers)
    assert (np.abs(back_m - depths_m) <= 1.01 * half_step_m(depths_m) + 1e-12).all()
    assert (code.stored(back_m) == numbers).all()


def test_no_depth() -> None:
    """What each code has for it; negative metres and infinity are none, -inf is too close."""
    assert np.isnan(Millimetres().depths_m(np.zeros(1, np.uint16))).all()
    assert np.isnan(InverseDepth(10100.0, -1009.0).depths_m(np.zeros(1, np.uint16))).all()
    depths = Metres().depths_m(np.array([np.nan, np.inf, 0.0, -1.0, -np.inf, 2.0], np.float32))
    np.testing.assert_array_equal(depths, [np.nan, np.nan, np.nan, np.nan, -np.inf, 2.0])
    assert InverseDepth(10100.0, -1009.0).farthest_m == 10.0
    assert InverseDepth(10100.0, -1009.0).stored(np.array([0.01, 10.01])).tolist() == [0, 0]


@pytest.mark.parametrize("ab", [(0.0, 0.0), (math.nan, 0.0), (1.0, 1.0), (1.0, math.inf)])
def test_inverse_depths_need_their_parameters(ab: tuple[float, float]) -> None:
    """Others code no depth."""
    with pytest.raises(InputError, match="which code no depth"):
        InverseDepth(*ab)
