"""Painting artefacts into images, against a slow twin that meets each triangle with each ray."""

import math
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from are_ros.builder.rendering.compositing import standard_noise
from are_ros.builder.rendering.painter import Lighting, PaintedBody, Painter, Painting
from are_ros.builder.rendering.surface import Surface, corner_normals, to_linear, to_srgb
from are_ros.world.cameras import FORWARD_FROM_OPTICAL, FisheyeView, PinholeView
from are_ros.world.rigid_transform import RigidTransform
from tests.builder.rendering.plain_surfaces import plain_surface

Floats = npt.NDArray[np.float64]
PINHOLE = PinholeView(64, 48, 40.0, 41.0, 31.0, 23.0)
DISTORTED = PinholeView(64, 48, 40.0, 41.0, 31.0, 23.0, (-0.25, 0.03, 0.002, -0.001) + (0.0,) * 10)
FISHEYE = FisheyeView(64, 48, 22.0, 22.0, 31.0, 23.0, (0.02, -0.01, 0.0, 0.0))
RECTIFIED = replace(
    PINHOLE, rectified_from_camera=(0.9998, 0.0, 0.02, 0.0, 1.0, 0.0, -0.02, 0.0, 0.9998)
)
VIEWS: dict[str, PinholeView | FisheyeView] = {
    "pinhole": PINHOLE,
    "distorted": DISTORTED,
    "fisheye": FISHEYE,
    "rectified": RECTIFIED,
}
PLAIN = Lighting(is_estimated=False, shadow=0.0, blur_px=0.0, noise=0.0)
CAMERA = RigidTransform.from_xyz_ypr(0.0, 0.0, 1.0, 0.0, 0.0, 0.0) @ FORWARD_FROM_OPTICAL
NOTHING = np.full((48, 64), np.inf, dtype=np.float32)
GREY = np.full((48, 64, 3), 120, dtype=np.uint8)


def cube(half: float = 0.5) -> Surface:
    """Return a closed grey cube."""
    signs = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)]) * 2.0 * half - half
    faces = np.array(
        [
            *((0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6), (0, 1, 4), (1, 5, 4)),
            *((2, 6, 3), (3, 6, 7), (0, 4, 2), (2, 4, 6), (1, 3, 5), (3, 7, 5)),
        ]
    )
    return plain_surface(signs[faces], np.full((12, 3), 0.6), is_closed=True)


def standing(
    surface: Surface, x: float, y: float, yaw: float = 0.3, half: float = 0.5
) -> PaintedBody:
    """Return a body on the floor."""
    pose = RigidTransform.planar(x, y, yaw, half)
    return PaintedBody(surface, pose, np.full(3, half), 0.0)


def paint(
    painter: Painter,
    bodies: list[PaintedBody],
    real: npt.NDArray[np.float32] = NOTHING,
    lighting: Lighting = PLAIN,
    pixels: npt.NDArray[np.uint8] = GREY,
) -> Painting:
    """Paint with a fixed seed."""
    return painter.paint(pixels, CAMERA, bodies, real, lighting, np.random.default_rng(1))


def sample_rays(painter: Painter) -> Floats:
    """Return the rays of the samples (2 H, 2 W, 3), out of their blocks."""
    height, blocks, _ = painter.samples.shape
    parts = painter.samples.reshape(height, blocks, 3, 2, 2, 4)
    rays = parts.transpose(0, 3, 1, 5, 4, 2).reshape(2 * height, 8 * blocks, 3)
    found: Floats = rays[:, : 2 * painter.view.width].astype(np.float64)
    return found


def ranges_of(painter: Painter, body: PaintedBody) -> Floats:
    """Return the first hits of all samples on a body, one triangle at a time; inf where none."""
    rays = sample_rays(painter)
    camera_from_box = CAMERA.inverse() @ body.map_from_box
    turn = camera_from_box.rotation_matrix()
    best = np.full(rays.shape[:2], np.inf)
    for triangle in body.surface.corners_m.astype(np.float64):
        corner, second, third = triangle @ turn.T + camera_from_box.translation_m
        a, b = second - corner, third - corner
        across = np.cross(rays, b)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1.0 / (across @ a)
            u = -(across @ corner) * scale
            beside = np.cross(-corner, a)
            v, t = (rays @ beside) * scale, (b @ beside) * scale
        hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0)
        best = np.where(hit, np.fmin(best, t), best)
    return best


def quarters(samples: npt.NDArray[np.bool_]) -> Floats:
    """Return the share of each pixel's four samples."""
    rows, columns = samples.shape
    four = samples.reshape(rows // 2, 2, columns // 2, 2)
    share: Floats = four.mean(axis=(1, 3))
    return share


@pytest.mark.parametrize("name", VIEWS)
def test_a_body_covers_the_pixels_whose_rays_meet_it(name: str) -> None:
    """Within a thousandth of the samples: rays are float32. Its share is the mask."""
    painter = Painter(VIEWS[name])
    body = standing(cube(), 2.5, 0.2)
    hits = np.isfinite(ranges_of(painter, body))
    painting = paint(painter, [body])
    assert painting.visible_fractions == pytest.approx([1.0])
    share = quarters(hits)
    is_sure = (share == 0.0) | (share == 1.0)
    wrong = (painting.mask == 0) != (share >= 0.5)
    assert (share == 1.0).sum() > 60
    assert np.count_nonzero(wrong & is_sure) == 0
    assert np.count_nonzero(wrong) <= 3
    assert painting.pixels is not None
    is_changed = (painting.pixels != GREY).any(axis=2)
    assert not is_changed[share == 0.0].any()
    assert is_changed[share == 1.0].all()


@pytest.mark.parametrize("name", ["pinhole", "distorted", "fisheye"])
def test_points_are_projected_as_opencv_does(name: str) -> None:
    """And a pixel's ray goes back to the pixel."""
    view = VIEWS[name]
    rays = view.directions().reshape(-1, 3).astype(np.float64)
    places = np.stack(np.meshgrid(np.arange(64), np.arange(48)), axis=2).reshape(-1, 2)
    assert rays.any(axis=1).all()
    assert view.project(3.0 * rays) == pytest.approx(places, abs=1e-3)
    points = np.random.default_rng(2).uniform((-1, -1, 1.2), (1, 1, 5), (500, 3))
    assert view.project(points) == pytest.approx(by_opencv(view, points), abs=1e-6)


def by_opencv(view: PinholeView | FisheyeView, points: Floats) -> Floats:
    """Return the pixels (N, 2) of points (N, 3)."""
    matrix = np.array(((view.fx, 0.0, view.cx), (0.0, view.fy, view.cy), (0.0, 0.0, 1.0)))
    none, numbers = np.zeros(3), np.array(view.distortion)
    if isinstance(view, FisheyeView):
        found, _ = cv2.fisheye.projectPoints(points[:, np.newaxis], none, none, matrix, numbers)
    else:
        found, _ = cv2.projectPoints(points, none, none, matrix, numbers[:8])
    pixels: Floats = np.asarray(found, dtype=np.float64).reshape(-1, 2)
    return pixels


def test_what_is_behind_the_camera_or_beyond_the_lens_has_no_pixel() -> None:
    """NaN, and such a body is not painted."""
    behind = np.array(((0.0, 0.0, -1.0), (0.3, 0.1, -2.0)))
    assert np.isnan(PINHOLE.project(behind)).all()
    folds = replace(PINHOLE, distortion=(-0.3,) + (0.0,) * 13)
    assert np.isnan(folds.project(np.array(((1.2, 0.0, 1.0),)))).all()
    assert np.isfinite(folds.project(np.array(((0.9, 0.0, 1.0),)))).all()
    painting = paint(Painter(PINHOLE), [standing(cube(), -2.5, 0.0)])
    assert painting.pixels is None
    assert np.isnan(painting.visible_fractions).all()


def test_a_body_around_the_camera_is_painted_everywhere() -> None:
    """Its triangles reach behind the camera: they are looked for in the whole image."""
    body = replace(standing(cube(3.0), 0.0, 0.0), surface=replace(cube(3.0), is_closed=False))
    assert (paint(Painter(PINHOLE), [body]).mask == 0).all()


def test_real_things_hide_to_the_pixel_and_the_floor_does_not() -> None:
    """A wall hides what is more than 2 cm behind it; what is really there near the floor never."""
    painter, body = Painter(DISTORTED), standing(cube(), 2.5, 0.0)
    whole = paint(painter, [body]).mask == 0
    real = NOTHING.copy()
    real[:, :30] = 1.5
    half = paint(painter, [body], real)
    assert ((half.mask == 0) == (whole & (np.arange(64) >= 30))).all()
    counted = quarters(np.isfinite(ranges_of(painter, body)))
    share = counted[:, 30:].sum() / counted.sum()
    assert half.visible_fractions[0] == pytest.approx(share, abs=0.01)
    # The floor, seen up to 5 cm too high, is in front of the cube's lower edge.
    rays = painter.rays.astype(np.float64) @ CAMERA.rotation_matrix().T
    down = rays[:, :, 2] < -1e-3
    floor = np.where(down, (0.05 - 1.0) / np.where(down, rays[:, :, 2], -1.0), np.inf)
    noisy = paint(painter, [body], floor.astype(np.float32))
    assert ((noisy.mask == 0) == whole).all()
    table = np.where(down, (0.3 - 1.0) / np.where(down, rays[:, :, 2], -1.0), np.inf)
    assert (paint(painter, [body], table.astype(np.float32)).mask == 0).sum() < 0.9 * whole.sum()


def test_the_nearer_body_hides_the_other_whatever_their_order() -> None:
    """The mask names each by its place in the list."""
    painter = Painter(PINHOLE)
    near, far = standing(cube(0.3), 2.0, 0.0, half=0.3), standing(cube(), 4.0, 0.0)
    one, other = paint(painter, [near, far]), paint(painter, [far, near])
    assert one.visible_fractions[::-1] == pytest.approx(other.visible_fractions)
    assert one.visible_fractions[0] == 1.0
    assert 0.1 < one.visible_fractions[1] < 0.95
    # Where each has two samples of a pixel, the mask has the one with the higher number.
    assert np.count_nonzero(one.mask != np.array([1, 0, -1])[other.mask]) < 10
    assert one.pixels is not None
    assert other.pixels is not None
    assert (one.pixels == other.pixels).all()


def test_what_was_painted_before_leaves_nothing_behind() -> None:
    """A painter may be used again; the same seed gives the same image."""
    painter, body = Painter(PINHOLE), standing(cube(), 2.5, 0.0)
    first = paint(painter, [body], lighting=Lighting())
    paint(painter, [standing(cube(), 1.8, 0.4), body], np.full_like(NOTHING, 2.2))
    again = paint(painter, [body], lighting=Lighting())
    assert first.pixels is not None
    assert again.pixels is not None
    assert (first.pixels == again.pixels).all()


def test_the_light_is_that_of_the_image() -> None:
    """In a dark picture an artefact is dark, in a warm one warm; brightness multiplies."""
    painter, body = Painter(PINHOLE), standing(cube(), 2.5, 0.0)
    plain = replace(PLAIN, is_estimated=True)

    def colour(pixels: npt.NDArray[np.uint8], lighting: Lighting) -> Floats:
        painting = paint(painter, [body], lighting=lighting, pixels=pixels)
        assert painting.pixels is not None
        found = to_linear(painting.pixels[painting.mask == 0] / 255.0)
        middle: Floats = np.median(found, axis=0)
        return middle

    usual, dark = colour(GREY, plain), colour(GREY // 2, plain)
    assert dark.mean() / usual.mean() == pytest.approx(
        to_linear(np.float64(60 / 255)) / to_linear(np.float64(120 / 255)), rel=0.05
    )
    warm = GREY.copy()
    warm[:, :, 0], warm[:, :, 2] = 150, 90
    red, _, blue = colour(warm, plain)
    assert red > 1.2 * blue
    assert colour(GREY, replace(plain, brightness=0.5)) == pytest.approx(0.5 * usual, rel=0.05)
    assert colour(GREY, replace(PLAIN, brightness=0.5)) == pytest.approx(
        0.5 * colour(GREY, PLAIN), rel=0.05
    )


def test_the_floor_is_darker_below_a_body_and_a_wall_is_not() -> None:
    """Most at its foot."""
    painter, body = Painter(PINHOLE), standing(cube(0.3), 2.5, 0.0, half=0.3)
    shaded = paint(painter, [body], lighting=replace(PLAIN, shadow=0.6))
    assert shaded.pixels is not None
    outside = shaded.mask == -1
    is_darker = outside & (shaded.pixels < 118).all(axis=2)
    assert is_darker.sum() > 20
    assert np.nonzero(is_darker)[0].min() > 24
    wall = np.full_like(NOTHING, 2.9)
    before_wall = paint(painter, [body], wall, replace(PLAIN, shadow=0.6))
    assert before_wall.pixels is not None
    floor_m = 1.0 / np.maximum(-(painter.rays @ CAMERA.rotation_matrix().T)[:, :, 2], 1e-3)
    is_wall = floor_m > 2.9 + 0.3
    bare = paint(painter, [body], wall).pixels
    assert bare is not None
    assert (before_wall.pixels == bare)[is_wall].all()
    assert (outside & is_wall).sum() > 500


@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_the_shadow_of_a_long_body_ends_where_that_of_others_does(yaw: float) -> None:
    """Seen from above, a wall of 2.4 m darkens the floor beside it, and nothing beyond 0.6 m."""
    painter = Painter(PinholeView(160, 120, 80.0, 80.0, 79.5, 59.5))
    camera = RigidTransform(np.array((0.0, 0.0, 4.0)), np.array((1.0, 0.0, 0.0, 0.0)))
    cubical, halves_m = cube(), np.array((1.2, 0.06, 0.1))
    flat = replace(cubical, points_m=(cubical.points_m * 2.0 * halves_m).astype(np.float32))
    body = PaintedBody(flat, RigidTransform.planar(0.0, 0.0, yaw, 0.1), halves_m, 0.0)
    grey, nothing = np.full((120, 160, 3), 120, np.uint8), np.full((120, 160), np.inf, np.float32)
    lighting, draws = replace(PLAIN, shadow=0.6), np.random.default_rng(1)
    painting = painter.paint(grey, camera, [body], nothing, lighting, draws)
    assert painting.pixels is not None
    rays = painter.rays.astype(np.float64) @ camera.rotation_matrix().T
    floor_m = -4.0 * rays[:, :, :2] / rays[:, :, 2:]
    turn = np.array(((math.cos(yaw), -math.sin(yaw)), (math.sin(yaw), math.cos(yaw))))
    apart_m = np.linalg.norm(np.maximum(np.abs(floor_m @ turn) - halves_m[:2], 0.0), axis=2)
    is_dark = np.asarray((painting.pixels < 118).all(axis=2))
    assert is_dark[(apart_m > 0.06) & (apart_m < 0.1)].mean() > 0.9
    assert not is_dark[apart_m > 0.61].any()


def test_far_from_the_map_s_origin_all_is_painted_as_near_it() -> None:
    """In metres of UTM float32 has steps of half a metre; shadows were cut into strips."""
    painter, near = Painter(PINHOLE), standing(cube(0.3), 2.5, 0.1, half=0.3)
    shaded, moved = replace(PLAIN, shadow=0.6), RigidTransform.planar(450e3, 5.2e6 + 0.2, 0.0)
    far = replace(near, map_from_box=moved @ near.map_from_box)
    here = paint(painter, [near], lighting=shaded)
    there = painter.paint(GREY, moved @ CAMERA, [far], NOTHING, shaded, np.random.default_rng(1))
    assert here.pixels is not None
    assert there.pixels is not None
    assert (here.pixels < 118).all(axis=2).sum() > 20
    assert np.abs(here.pixels.astype(np.int16) - there.pixels).max() <= 1


def test_blur_and_noise_touch_only_what_is_painted() -> None:
    """Blur softens the edge; noise has the standard deviation that is asked for."""
    painter, body = Painter(PINHOLE), standing(cube(), 2.5, 0.0)
    sharp, grainy = (
        paint(painter, [body]),
        paint(painter, [body], lighting=replace(PLAIN, noise=4.0)),
    )
    assert sharp.pixels is not None
    assert grainy.pixels is not None
    apart = grainy.pixels.astype(int) - sharp.pixels
    assert not apart[sharp.mask == -1][:, 0].std() > 4.0
    inside = quarters(np.isfinite(ranges_of(painter, body))) == 1.0
    assert apart[inside].std() == pytest.approx(4.0, rel=0.25)
    soft = paint(painter, [body], lighting=replace(PLAIN, blur_px=1.0))
    assert soft.pixels is not None
    assert (soft.mask == sharp.mask).all()
    found = [p.pixels for p in (sharp, soft) if p.pixels is not None]
    steps = [np.abs(np.diff(one.astype(int), axis=1)).max() for one in found]
    assert steps[1] < 0.7 * steps[0]


def test_a_painter_that_is_prepared_paints_the_same() -> None:
    """Its rays are there before the first image, and are not computed again."""
    prepared, body = Painter(DISTORTED), standing(cube(), 2.5, 0.0)
    prepared.prepare()
    samples = vars(prepared)["samples"]
    one, other = paint(prepared, [body]), paint(Painter(DISTORTED), [body])
    assert prepared.samples is samples
    assert one.pixels is not None
    assert other.pixels is not None
    assert (one.pixels == other.pixels).all()


def test_noise_is_nearly_normal_and_that_of_a_seed() -> None:
    """Mean, deviation and tails of 200,000 numbers; neighbours and seeds do not go together."""
    drawn = np.array([[standard_noise(np.uint64(s), k) for k in range(100_000)] for s in (7, 8)])
    assert drawn.mean() == pytest.approx(0.0, abs=0.01)
    assert drawn.std() == pytest.approx(1.0, abs=0.01)
    assert (np.abs(drawn) > 2.0).mean() == pytest.approx(0.0455, abs=0.004)
    assert np.corrcoef(drawn[0, 1:], drawn[0, :-1])[0, 1] == pytest.approx(0.0, abs=0.015)
    assert np.corrcoef(drawn)[0, 1] == pytest.approx(0.0, abs=0.015)
    assert standard_noise(np.uint64(7), 5) == drawn[0, 5]


@pytest.mark.parametrize("name", ["distorted", "fisheye"])
def test_small_triangles_bulge_no_more_than_is_allowed_for(name: str) -> None:
    """A fine sphere, of triangles of a few pixels, covers what its rays meet."""
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(3, radius=0.5)
    corners = np.asarray(ball.vertices)[ball.faces]
    surface = plain_surface(corners, np.full((len(corners), 3), 0.5), is_closed=True)
    painter = Painter(VIEWS[name])
    for x, y in ((1.6, 0.0), (1.6, 0.9), (3.0, -1.5)):
        body = standing(surface, x, y)
        share = quarters(np.isfinite(ranges_of(painter, body)))
        mask = paint(painter, [body]).mask
        assert (share == 1.0).any()
        assert (mask[share == 1.0] == 0).all()
        assert (mask[share == 0.0] == -1).all()


def test_normals_of_a_sphere_are_round_and_those_of_a_cube_are_flat() -> None:
    """A bend of more than 53 degrees is an edge."""
    trimesh = pytest.importorskip("trimesh")
    sphere = trimesh.creation.icosphere(2)
    corners = sphere.vertices[sphere.faces]
    assert (corner_normals(corners) * corners).sum(axis=2).min() > 0.995
    flat = cube().corners_m.astype(np.float64)
    across = np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    assert corner_normals(flat) == pytest.approx(np.repeat(across[:, np.newaxis], 3, 1))


def test_normals_at_corners_are_the_sums_over_the_faces_there_that_bend_little() -> None:
    """Face by face, on a cone, whose tip has both: neighbours within the crease and others."""
    turns = np.linspace(0.0, math.tau, 10)
    rim = np.column_stack((np.cos(turns), np.sin(turns), np.zeros(10)))
    tip = np.tile((0.0, 0.0, 0.7), (9, 1))
    corners = np.stack((rim[:-1], rim[1:], tip), axis=1)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    units = across / np.linalg.norm(across, axis=1, keepdims=True)
    found = corner_normals(corners)
    for face in range(9):
        for corner in range(3):
            total = np.zeros(3)
            for other in range(9):
                touches = np.abs(corners[other] - corners[face, corner]).max(axis=1).min() < 1e-9
                if touches and units[face] @ units[other] >= 0.6:
                    total += across[other]
            assert found[face, corner] == pytest.approx(total / np.linalg.norm(total))


def test_a_texture_is_laid_on_the_triangles() -> None:
    """Its left half is red, its right half blue."""
    texture = np.zeros((2, 4, 3), dtype=np.uint8)
    texture[:, :2, 0] = texture[:, 2:, 2] = 255
    corners = np.array([[[0.0, 0.5, -0.5], [0.0, -0.5, -0.5], [0.0, -0.5, 0.5]]] * 2)
    corners[1] = ((0.0, 0.5, -0.5), (0.0, -0.5, 0.5), (0.0, 0.5, 0.5))
    uvs = np.array([[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]], dtype=np.float32)
    sheet = replace(plain_surface(corners, np.full((2, 3), 0.5)), uvs=uvs, texture=texture)
    painting = paint(Painter(PINHOLE), [standing(sheet, 2.0, 0.0, yaw=0.0)])
    assert painting.pixels is not None
    columns = np.nonzero((painting.mask == 0).any(axis=0))[0]
    left, right = painting.pixels[30, columns[3]], painting.pixels[30, columns[-4]]
    assert left[0] > 100 > left[2]
    assert right[2] > 100 > right[0]


def test_each_body_has_its_own_texture_also_where_it_reaches_behind_the_camera() -> None:
    """A red sheet and a green floor that goes on below the camera, whose corners have no pixel."""
    uvs = np.full((2, 3, 2), 0.5, dtype=np.float32)
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])[[[0, 1, 2], [0, 2, 3]]]
    upright = np.stack((np.zeros((2, 3)), *np.moveaxis(square, 2, 0)), axis=2)
    level = np.concatenate((5.0 * square, np.full((2, 3, 1), -0.5)), axis=2)
    bodies = []
    for channel, corners in enumerate((0.2 * upright, level)):
        texture = np.zeros((1, 1, 3), dtype=np.uint8)
        texture[..., channel] = 255
        plain = plain_surface(corners, np.full((2, 3), 0.5))
        sheet = replace(plain, uvs=uvs, texture=texture)
        bodies.append(replace(standing(sheet, 2.0 - channel, 0.0, 0.0), ground_m=-9.0))
    for order in (bodies, bodies[::-1]):
        painting = paint(Painter(PINHOLE), order)
        assert painting.pixels is not None
        assert (painting.mask[-1] == order.index(bodies[1])).all()
        for channel, body in enumerate(bodies):
            is_own = (painting.mask == order.index(body)).astype(np.uint8)
            inside = painting.pixels[cv2.erode(is_own, np.ones((3, 3))) > 0]
            assert len(inside) > 10
            assert (inside[:, channel] > 50).all()
            assert inside.sum() == inside[:, channel].sum()


def test_srgb_goes_there_and_back() -> None:
    """For all 256 values."""
    values = np.arange(256) / 255.0
    assert to_srgb(to_linear(values)) == pytest.approx(values, abs=1e-6)
    assert math.isclose(float(to_linear(np.float64(0.5))), 0.21404, abs_tol=1e-4)
