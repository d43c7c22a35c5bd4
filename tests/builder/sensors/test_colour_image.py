"""Painted images: their encodings, what refuses, and the depth image of the same time."""

import io
import struct
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import PIL.Image
import pytest

from are_ros.builder.occlusion.meshes import MeshSelection
from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.scene import Scene
from are_ros.builder.sensors.colour_image import (
    ColourImage,
    ColourPixels,
    CompressedColour,
    RawColour,
    Studio,
)
from are_ros.builder.sensors.depth_image import DepthImage, RawDepth
from are_ros.builder.sensors.image import CompressedImage, Image
from are_ros.builder.sensors.lens import Lens
from are_ros.builder.sensors.obstacles import Obstacles
from are_ros.errors import InputError
from are_ros.parameters.model import Parameters, RenderingParameters
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.world.cameras import FORWARD_FROM_OPTICAL, CameraInfo
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

Pixels = npt.NDArray[np.uint8]
WIDTH, HEIGHT = 64, 48
K = (40.0, 0.0, 31.5, 0.0, 40.0, 23.5, 0.0, 0.0, 1.0)
INFO = CameraInfo(
    WIDTH,
    HEIGHT,
    "plumb_bob",
    (),
    K,
    (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    (*K[:3], 0.0, *K[3:6], 0.0, *K[6:], 0.0),
)
LENS = Lens("eye", INFO, INFO.view(rectified=False))
CAMERA = RigidTransform.from_xyz_ypr(0.0, 0.0, 1.0, 0.0, 0.0, 0.0) @ FORWARD_FROM_OPTICAL
PLAIN = RenderingParameters(noise=0.0, blur=0.0)
MOSAICS = {f"bayer_{order}8": 1 for order in ("rggb", "bggr", "gbrg", "grbg")}
YUV = dict.fromkeys(("yuv422", "yuv422_yuy2", "uyvy", "yuyv"), 2)
CHANNELS = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1, **MOSAICS, **YUV}


@pytest.fixture
def obstacles(make_scene: Any) -> Obstacles:
    """Return a post 2 m ahead, and a studio without noise."""
    row = make_scene().row(0)
    post = Artefact(7, row, Origin.SCRIPTED, 0, PoseHistory(0, GroundPose(2.0, 0.0, 0.0, 0.0)))
    scene, studio = Scene.of([post], 0), Studio(PLAIN, Parameters().seed)
    shapes = MeshSelection.boxes_only(1)
    return Obstacles(scene.boxes, shapes, scene=scene, studio=studio)


def grey(encoding: str, padding: int = 5) -> Image:
    """Return an image whose pixels and padding are random."""
    step = WIDTH * CHANNELS[encoding] + padding
    data = np.random.default_rng(3).integers(90, 160, (HEIGHT, step)).astype(np.uint8)
    return Image("eye", 100, encoding, 0, WIDTH, data)


def painted(pixels: ColourPixels, obstacles: Obstacles) -> ColourImage:
    """Return the image with the post."""
    return ColourImage(pixels).seen_through(LENS).augmented(CAMERA, obstacles)


@pytest.mark.parametrize("encoding", CHANNELS)
def test_every_encoding_is_painted_alike(encoding: str, obstacles: Obstacles) -> None:
    """Red is red, whatever the order; padding, alpha and all other pixels keep their bits."""
    image = grey(encoding)
    done = painted(RawColour(image), obstacles)
    assert done.truth is not None
    is_post = done.truth.ids == 7
    assert 200 < is_post.sum() < 1500
    (post,) = done.truth.in_image
    assert (post.artefact.id, post.visible_fraction) == (7, 1.0)
    assert post.visible_pixels == is_post.sum()
    assert isinstance(done.pixels, RawColour)
    after = done.pixels.image
    is_same = (after.pixels() == image.pixels()).reshape(HEIGHT, WIDTH, -1).all(axis=2)
    assert not is_same[is_post].all()
    assert is_same[:10].all()
    row_bytes = WIDTH * CHANNELS[encoding]
    assert (after.data[:, row_bytes:] == image.data[:, row_bytes:]).all()
    if CHANNELS[encoding] == 4:
        assert (after.pixels()[:, :, 3] == image.pixels()[:, :, 3]).all()
    reference = painted(RawColour(grey("rgb8")), obstacles).pixels.rgb()[is_post].mean(axis=0)
    found = done.pixels.rgb()[is_post].mean(axis=0)
    wanted = reference if encoding != "mono8" else reference @ (0.299, 0.587, 0.114)
    assert found == pytest.approx(np.broadcast_to(wanted, 3), abs=12)


def test_reseeding_draws_the_noise_of_images_anew(make_scene: Any) -> None:
    """As a builder of that seed has it."""
    builders = [make_scene({"seed": seed}).builder for seed in (1, 2)]
    builders[0].reseed(2, 1_000_000_000)
    first, second = (one.sensors._studio.noise(5).random(9).tolist() for one in builders)
    assert first == second


@pytest.mark.parametrize("encoding", MOSAICS)
def test_each_pixel_of_a_mosaic_has_its_colour(encoding: str) -> None:
    """Red, green or blue, as the name says, from the top left corner on; others keep their bits."""
    image = RawColour(Image("eye", 100, encoding, 0, 6, np.full((4, 6), 50, np.uint8)))
    before = image.rgb()
    assert (before == 50).all()
    painted_on = before.copy()
    painted_on[:, :4] = 10, 20, 30
    stored = image.with_rgb(painted_on, before, 90).image.pixels()
    by_colour = {"r": 10, "g": 20, "b": 30}
    tile = np.array([by_colour[one] for one in encoding[6:10]]).reshape(2, 2)
    assert (stored[:, :4] == np.tile(tile, (2, 2))).all()
    assert (stored[:, 4:] == 50).all()


@pytest.mark.parametrize("encoding", MOSAICS)
def test_a_mosaic_keeps_what_each_pixel_has_measured(encoding: str) -> None:
    """At the edges, too, where there are neighbours on one side only: no shadow brightens any."""
    image = RawColour(grey(encoding))
    before = image.rgb()
    same = image.with_rgb(before, before + np.uint8(1), 90)
    assert (same.image.pixels() == image.image.pixels()).all()


@pytest.mark.parametrize("encoding", YUV)
def test_pairs_of_yuv_share_their_colour(encoding: str) -> None:
    """Luma for itself, U and V of both; by the equations of BT.601, pixel by pixel."""
    luma = 1 if encoding in {"yuv422", "uyvy"} else 0
    data = np.empty((2, 8, 2), np.uint8)
    data[:, :, luma], data[:, 0::2, 1 - luma], data[:, 1::2, 1 - luma] = 100, 120, 140
    image = RawColour(Image("eye", 100, encoding, 0, 8, data.reshape(2, 16)))
    before = image.rgb()
    painted_on = before.copy()
    painted_on[0, 1], painted_on[1, 4], painted_on[1, 5] = (200, 30, 60), (20, 220, 40), (0, 0, 255)
    stored = image.with_rgb(painted_on, before, 90).image.pixels().astype(int)
    for row, pair in ((0, 0), (1, 2)):
        left, right = painted_on[row, 2 * pair : 2 * pair + 2].astype(float)
        u, v = (_chroma(0.5 * (left + right), k) for k in range(2))
        assert abs(stored[row, 2 * pair, 1 - luma] - u) <= 1
        assert abs(stored[row, 2 * pair + 1, 1 - luma] - v) <= 1
    for row, column in ((0, 1), (1, 4), (1, 5)):
        red, green, blue = painted_on[row, column].astype(float)
        wanted = 16.0 + (65.738 * red + 129.057 * green + 25.064 * blue) / 256.0
        assert abs(stored[row, column, luma] - wanted) <= 1
    assert stored[0, 0, luma] == 100  # the other one of a pair keeps its own
    data[0, :2], data[1, 4:6] = stored[0, :2], stored[1, 4:6]
    assert (stored == data).all()


def _chroma(rgb: np.ndarray[Any, Any], which: int) -> float:
    """Return U (0) or V (1) of a colour, as BT.601 has them for 8 bits."""
    shares = ((-37.945, -74.494, 112.439), (112.439, -94.154, -18.285))[which]
    return 128.0 + float(np.dot(rgb, shares)) / 256.0


def test_a_shadow_makes_no_luma_greater() -> None:
    """Of colours that RGB does not have, too: they come back as others."""
    rng = np.random.default_rng(5)
    image = RawColour(Image("eye", 1, "yuyv", 0, 64, rng.integers(0, 256, (64, 128), np.uint8)))
    before = image.rgb()
    shaded = (before * 0.995).astype(np.uint8)
    assert (shaded != before).any()
    stored = image.with_rgb(shaded, before, 90).image.pixels()
    assert (stored[:, :, 0] <= image.image.pixels()[:, :, 0]).all()


def test_yuv_of_an_odd_width_is_refused() -> None:
    """There is a pair that is cut through."""
    with pytest.raises(InputError, match="'uyvy' needs an even width, but it is 3"):
        RawColour(Image("eye", 1, "uyvy", 0, 3, np.zeros((2, 6), np.uint8))).check()


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_compressed_images_stay_what_they_are(suffix: str, obstacles: Obstacles) -> None:
    """A JPEG stays a JPEG; it is compressed anew only if something is painted."""
    smooth = np.full((HEIGHT, WIDTH, 3), (90, 120, 150), dtype=np.uint8)
    data = cv2.imencode(suffix, smooth)[1].reshape(-1)
    image = CompressedImage("eye", 100, "bgr8; jpeg compressed bgr8", data)
    done = painted(CompressedColour(image), obstacles)
    assert isinstance(done.pixels, CompressedColour)
    after = cv2.imdecode(done.pixels.image.data, cv2.IMREAD_COLOR)
    assert after is not None
    assert done.pixels.image.data[:3].tobytes() == data[:3].tobytes()
    assert np.abs(after[:8].astype(int) - smooth[:8]).max() < 6
    assert done.truth is not None
    assert np.abs(after.astype(int) - smooth)[done.truth.ids == 7].mean() > 10
    behind = ColourImage(CompressedColour(image)).seen_through(LENS)
    away = behind.augmented(
        RigidTransform.planar(0.0, 0.0, np.pi, 1.0) @ FORWARD_FROM_OPTICAL, obstacles
    )
    assert away.pixels is behind.pixels


def test_where_nothing_is_visible_the_pixels_are_the_same_object(obstacles: Obstacles) -> None:
    """Behind a real thing, too: the depth image of the same time says so."""
    wall = DepthImage(RawDepth(Image("eye", 100, "16UC1", 0, WIDTH, depths(900))))
    assert isinstance(obstacles.studio, Studio)
    obstacles.studio.keep_depth(wall)
    raw = RawColour(grey("rgb8"))
    hidden = painted(raw, obstacles)
    assert hidden.pixels is raw
    assert hidden.truth is not None
    assert not hidden.truth.ids.any()


@pytest.mark.parametrize("suffix", ["", ".png", ".jpg"])
def test_an_image_of_another_size_than_its_lens_has_no_mask_of_nobody(
    suffix: str, obstacles: Obstacles
) -> None:
    """Whether anybody is there or not: it is refused, with both sizes."""
    small = np.full((HEIGHT // 2, WIDTH // 2, 3), 100, np.uint8)
    pixels: ColourPixels = RawColour(
        Image("eye", 100, "rgb8", 0, WIDTH // 2, small.reshape(HEIGHT // 2, -1))
    )
    if suffix:
        data = cv2.imencode(suffix, small)[1].reshape(-1)
        pixels = CompressedColour(CompressedImage("eye", 100, "rgb8; compressed", data))
    image, sizes = ColourImage(pixels, LENS), "it has 32 x 24 pixels, and camera_info is of 64 x 48"
    away = RigidTransform.planar(0.0, 0.0, np.pi, 1.0) @ FORWARD_FROM_OPTICAL
    for pose in (CAMERA, away):
        with pytest.raises(InputError, match=sizes):
            image.augmented(pose, obstacles)
    with pytest.raises(InputError, match=sizes):
        image.with_nobody(CAMERA)


FISHEYE = replace(INFO, distortion_model="equidistant", k=(12.0, *K[1:4], 12.0, *K[5:]))


@pytest.mark.parametrize("aside_rad", [0.5, 1.6, 2.0, 2.2])
@pytest.mark.parametrize("wall_x_m", [1.2, 3.0])
def test_a_fisheye_paints_what_walls_leave_beyond_90_degrees(
    obstacles: Obstacles, aside_rad: float, wall_x_m: float
) -> None:
    """So far from the axis no depth is known, but a wall before the post hides it all the same."""
    at = RigidTransform.from_xyz_ypr(wall_x_m, -4.0, -1.0, 0.0, 0.0, 0.0)
    wall = VoxelField.of(VoxelMap(at, (0.1, 0.1, 0.1), np.ones((1, 80, 60), np.uint8)))
    camera = RigidTransform.from_xyz_ypr(0.0, 0.0, 1.0, aside_rad, 0.0, 0.0)
    lens = Lens("eye", FISHEYE, FISHEYE.view(rectified=False))
    raw = RawColour(grey("rgb8"))
    done = ColourImage(raw, lens).augmented(
        camera @ FORWARD_FROM_OPTICAL, replace(obstacles, surface=wall)
    )
    assert done.truth is not None
    assert done.truth.ids.any() == (wall_x_m > 2.0)
    assert (done.pixels is raw) == (wall_x_m < 2.0)


def depths(millimetres: int) -> Pixels:
    """Return the bytes of depths, all the same."""
    return np.full((HEIGHT, WIDTH), millimetres, dtype="<u2").view(np.uint8).reshape(HEIGHT, -1)


@pytest.mark.parametrize(
    ("frame", "stamp_ns", "millimetres", "is_hidden"),
    [
        ("eye", 100, 900, True),
        ("eye", 100 + 4_000_000, 900, True),
        ("eye", 100 + 6_000_000, 900, False),
        ("other", 100, 900, False),
        ("eye", 100, 3000, False),
        ("eye", 100, 0, False),
    ],
)
def test_only_the_depth_image_of_the_same_time_and_frame_hides(
    obstacles: Obstacles, frame: str, stamp_ns: int, millimetres: int, is_hidden: bool
) -> None:
    """Within 5 ms; what is farther hides nothing, nor what has no return."""
    assert isinstance(obstacles.studio, Studio)
    image = Image(frame, stamp_ns, "16UC1", 0, WIDTH, depths(millimetres))
    obstacles.studio.keep_depth(DepthImage(RawDepth(image)))
    raw = RawColour(grey("rgb8"))
    assert (painted(raw, obstacles).pixels is raw) == is_hidden


@pytest.mark.parametrize("is_hidden", [True, False])
def test_of_two_cameras_in_one_frame_the_depth_image_of_the_same_lens_hides(
    obstacles: Obstacles, *, is_hidden: bool
) -> None:
    """Whichever came first; one of them sees a wall close by."""
    assert isinstance(obstacles.studio, Studio)
    k = (2.0 * LENS.info.k[0], *LENS.info.k[1:])
    tele = Lens(LENS.frame_id, replace(LENS.info, k=k), LENS.view)
    for lens, is_wall in ((tele, not is_hidden), (LENS, is_hidden), (tele, not is_hidden)):
        image = Image("eye", 100, "16UC1", 0, WIDTH, depths(900 if is_wall else 3000))
        obstacles.studio.keep_depth(DepthImage(RawDepth(image)).seen_through(lens))
    raw = RawColour(grey("rgb8"))
    assert (painted(raw, obstacles).pixels is raw) == is_hidden


@pytest.mark.parametrize(
    ("frame", "stamp_ns", "rows", "reason"),
    [
        ("eye", 100, HEIGHT, ""),
        ("nose", 100, HEIGHT, "they are in another frame"),
        ("eye", 20_000_000, HEIGHT, "they are more than 5 ms apart"),
        ("eye", 100, HEIGHT - 1, "their sizes differ"),
    ],
)
def test_it_is_said_why_depth_images_hide_nothing(
    obstacles: Obstacles, frame: str, stamp_ns: int, rows: int, reason: str
) -> None:
    """Of two images; where there is no depth image at all, nothing is to be said."""
    assert isinstance(obstacles.studio, Studio)
    painted(RawColour(grey("rgb8")), obstacles)
    assert obstacles.studio.doubt_about_depth == ""
    image = Image(frame, stamp_ns, "16UC1", 0, WIDTH, depths(900)[:rows])
    obstacles.studio.keep_depth(DepthImage(RawDepth(image)))
    for _ in range(2):
        painted(RawColour(grey("rgb8")), obstacles)
    said = obstacles.studio.doubt_about_depth
    assert said.startswith("2 of 2 images with artefacts had no depth image" if reason else "")
    assert f"({reason})" in said or not reason
    assert bool(said) == bool(reason)


def test_another_camera_without_a_depth_camera_is_no_cause_for_doubt(obstacles: Obstacles) -> None:
    """One has its own, and in the frame of the other there is none."""
    assert isinstance(obstacles.studio, Studio)
    image = Image("eye", 100, "16UC1", 0, WIDTH, depths(900))
    obstacles.studio.keep_depth(DepthImage(RawDepth(image)))
    other = replace(grey("rgb8"), frame_id="nose")
    for pixels in (other, other, grey("rgb8"), other):
        painted(RawColour(pixels), obstacles)
    assert obstacles.studio.doubt_about_depth == ""


def test_an_image_waits_for_its_depth_image_if_there_are_such() -> None:
    """The first is waited for only if it is expected."""
    studio, image = Studio(PLAIN, 1), ColourImage(RawColour(grey("rgb8")))
    assert not studio.lacks_depth(image)
    studio.expects_depth = True
    assert studio.lacks_depth(image)
    for stamp_ns, lacks in ((-10_000_000, True), (100, False)):
        depth = Image("eye", stamp_ns, "16UC1", 0, WIDTH, depths(900))
        studio.keep_depth(DepthImage(RawDepth(depth)))
        assert studio.lacks_depth(image) == lacks
    studio.forget()
    studio.keep_depth(DepthImage(RawDepth(Image("other", 0, "16UC1", 0, WIDTH, depths(900)))))
    assert not studio.lacks_depth(image)


def compressed(suffix: str, stored: npt.NDArray[Any], form: str = "jpeg") -> CompressedColour:
    """Return what OpenCV makes of pixels."""
    data = cv2.imencode(suffix, stored)[1].reshape(-1)
    return CompressedColour(CompressedImage("eye", 100, form, data))


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_grey_stays_grey_whatever_the_format_says(suffix: str, obstacles: Obstacles) -> None:
    """Many drivers write "jpeg" and no more: the data tell."""
    done = painted(compressed(suffix, np.full((HEIGHT, WIDTH), 120, np.uint8)), obstacles)
    assert done.truth is not None
    assert isinstance(done.pixels, CompressedColour)
    after = cv2.imdecode(done.pixels.image.data, cv2.IMREAD_UNCHANGED)
    assert after is not None
    assert after.shape == (HEIGHT, WIDTH)


def test_an_alpha_channel_stays(obstacles: Obstacles) -> None:
    """Number by number."""
    stored = np.random.default_rng(4).integers(90, 160, (HEIGHT, WIDTH, 4)).astype(np.uint8)
    done = painted(compressed(".png", stored, "bgra8; png compressed bgra8"), obstacles)
    assert isinstance(done.pixels, CompressedColour)
    after = cv2.imdecode(done.pixels.image.data, cv2.IMREAD_UNCHANGED)
    assert after is not None
    assert (after[:, :, 3] == stored[:, :, 3]).all()
    assert (after[:, :, :3] != stored[:, :, :3]).any()


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_a_picture_that_claims_to_be_huge_is_refused(suffix: str, obstacles: Obstacles) -> None:
    """Before it is decompressed."""
    pixels = compressed(suffix, np.full((HEIGHT, WIDTH, 3), 120, np.uint8))
    data, sizes = pixels.image.data.tobytes(), ((">HH", (HEIGHT, WIDTH)), (">II", (WIDTH, HEIGHT)))
    form, size = sizes[suffix == ".png"]
    other = data.replace(struct.pack(form, *size), struct.pack(form, 60_000, 60_001), 1)
    assert other != data
    broken = CompressedImage("eye", 1, "jpeg", np.frombuffer(other, np.uint8).copy())
    with pytest.raises(InputError, match=r"it claims to have 6000[01] x 6000[01] pixels"):
        painted(CompressedColour(broken), obstacles)


@pytest.mark.parametrize("shape", [(HEIGHT, WIDTH), (HEIGHT, WIDTH, 3)])
def test_a_picture_of_16_bits_is_refused(shape: tuple[int, ...], obstacles: Obstacles) -> None:
    """Painted in 8 it would not be what its format says."""
    with pytest.raises(InputError, match="of 16 bits; grey, RGB and RGBA of 8 bits are painted on"):
        painted(compressed(".png", np.full(shape, 30_000, np.uint16)), obstacles)


def test_a_jpeg_of_cmyk_is_refused(obstacles: Obstacles) -> None:
    """Its fourth number is black, and no alpha; OpenCV writes none of the kind."""
    file = io.BytesIO()
    PIL.Image.new("CMYK", (WIDTH, HEIGHT), (10, 20, 30, 40)).save(file, "JPEG")
    image = CompressedImage("eye", 100, "jpeg", np.frombuffer(file.getvalue(), np.uint8).copy())
    with pytest.raises(InputError, match="its pixels have CMYK of 8 bits; grey, RGB and RGBA"):
        painted(CompressedColour(image), obstacles)


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        (Image("eye", 1, "rgb16", 0, 4, np.zeros((4, 24), np.uint8)), "'rgb16' is not painted on"),
        (Image("eye", 1, "16UC1", 0, 2, np.zeros((4, 4), np.uint8)), "'16UC1' is not painted on"),
    ],
)
def test_an_encoding_that_is_not_painted_on_is_refused(
    image: Image, reason: str, obstacles: Obstacles
) -> None:
    """With those that are; but not before: the image is to pass unchanged."""
    with pytest.raises(InputError, match=reason):
        painted(RawColour(image), obstacles)
    with pytest.raises(InputError, match=reason):
        RawColour(image).rgb()


def test_what_cannot_be_painted_is_refused_in_a_sentence(obstacles: Obstacles) -> None:
    """No lens, another size, damaged data."""
    with pytest.raises(InputError, match="its CameraInfo is not known"):
        ColourImage(RawColour(grey("rgb8"))).augmented(CAMERA, obstacles)
    small = Image("eye", 1, "rgb8", 0, 2, np.zeros((3, 6), np.uint8))
    with pytest.raises(InputError, match="it has 2 x 3 pixels, and camera_info is of 64 x 48"):
        painted(RawColour(small), obstacles)
    for data, reason in ((b"GIF89a", "neither JPEG nor PNG"), (b"\xff\xd8\xff\xe0", "are damaged")):
        broken = CompressedImage("eye", 1, "jpeg", np.frombuffer(data, np.uint8).copy())
        with pytest.raises(InputError, match=reason):
            painted(CompressedColour(broken), obstacles)
