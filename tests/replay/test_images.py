"""Painted images and masks of replays of real recordings, against rays cast by Embree."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from are_ros.bag.reader import BagReader
from are_ros.builder.assembly import catalogue_of
from are_ros.parameters.model import Parameters
from are_ros.population.meshes.appearance import drawn_mesh
from are_ros.population.randomness import Purpose, generator
from tests.oracles.recorded import Frames, read_inputs
from tests.replay.conftest import RunAre

Floats = npt.NDArray[np.float64]
Standing = tuple[str, float, float, float]
"""A label, x, y and yaw."""
BODIES: tuple[Standing, ...] = (
    ("person_child_small", -2.12, -2.6, 0.35),
    ("structure_cone", -2.0, -1.83, 0.0),
)
"""Both stand partly behind the chair, which the map of the robot does not have."""
CELLS = 320
MAP = """
image: free.pgm
resolution: 0.05
origin: [-8.0, -8.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.25
"""


def on_a_free_map(folder: Path, bodies: Sequence[Standing]) -> tuple[object, ...]:
    """Return the options of a replay in which bodies stand on a map of 16 m that is free."""
    rows = "".join(f"  - {{label: {label}, at: {at}}}\n" for label, *at in bodies)
    header = "scenario: {name: standing, random: false}\nartefacts:\n"
    (folder / "standing.yaml").write_text(header + rows)
    (folder / "free.yaml").write_text(MAP)
    (folder / "free.pgm").write_bytes(b"P5 %d %d 255\n" % (CELLS, CELLS) + b"\xfe" * CELLS**2)
    return ("--scenario", folder / "standing.yaml", "--map", folder / "free.yaml")


@pytest.fixture(scope="module")
def redwood(real_data: Path, run_are: RunAre, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the results of the five frames with a child and a cone behind the chair."""
    folder: Path = tmp_path_factory.mktemp("redwood")
    bag = real_data / "redwood-rgbd"
    chosen = ("sensors.masks:=true", "sensors.boxes:=true", "sensors.gate:=all")
    words = (*(word for one in chosen for word in ("--set", one)), "--with-inputs")
    files = on_a_free_map(folder, BODIES)
    done = run_are("replay", bag, *files, *words, "--out", folder / "out")
    assert done.returncode == 0, done.stderr
    return folder / "out"


def messages(recording: Path, topic: str) -> list[Any]:
    """Return the messages of a topic."""
    with BagReader([recording / "augmented.mcap"]) as reader:
        return [reader.deserialize(m) for m in reader.messages(topics=[topic])]


def pixels_of(image: Any, dtype: str) -> npt.NDArray[Any]:
    """Return the pixels of an image without padding."""
    data = np.asarray(image.data, np.uint8).reshape(image.height, image.step)
    return np.ascontiguousarray(data).view(dtype)


def map_from_camera(frames: Frames, stamp: Any) -> Floats:
    """Return the camera's pose (3, 4)."""
    found = frames.lookup("map", "camera_optical_frame", stamp.sec * 10**9 + stamp.nanosec)
    assert found is not None
    turn, shift = found
    return np.column_stack((turn, shift))


@pytest.mark.parametrize("body", range(len(BODIES)))
def test_who_is_behind_the_chair_has_one_place_in_all_five_frames(redwood: Path, body: int) -> None:
    """The mask is what rays meet before what the depth image has, but for edges of a pixel."""
    trimesh = pytest.importorskip("trimesh")
    label, x, y, yaw = BODIES[body]
    pytest.importorskip("embreex")
    frames = read_inputs(redwood / "augmented.mcap").frames
    info = messages(redwood, "/camera/camera_info")[0]
    fx, cx, fy, cy = info.k[0], info.k[2], info.k[4], info.k[5]
    u, v = np.meshgrid(np.arange(info.width), np.arange(info.height))
    rays = np.stack(((u - cx) / fx, (v - cy) / fy, np.ones_like(u)), axis=2).reshape(-1, 3)
    lengths = np.linalg.norm(rays, axis=1)
    row = next(r for r in catalogue_of(Parameters()).rows if r.label == label)
    masks, images = (messages(redwood, f"/ar_builder/camera/image{end}") for end in ("/mask", ""))
    number = int(np.unique(pixels_of(masks[-1], "<i4"))[1 + body])
    looks = generator(Parameters().seed, Purpose.APPEARANCE, number)
    vertices = drawn_mesh(row, looks).corners_m.reshape(-1, 3) + row.box_centre_in_artefact_m
    faces = np.arange(len(vertices)).reshape(-1, 3)
    low = vertices[:, 2].min()
    cos, sin = math.cos(yaw), math.sin(yaw)
    turned = vertices @ np.array(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0))).T
    solid = trimesh.Trimesh(turned + np.array((x, y, -low)), faces, process=False)
    depths = {one.header.stamp.nanosec: one for one in messages(redwood, "/camera/depth")}
    before = {one.header.stamp.nanosec: one for one in messages(redwood, "/camera/image")}
    assert len(images) == 5
    assert len(masks) == 5
    for mask in masks[1:]:
        stamp = mask.header.stamp
        pose = map_from_camera(frames, stamp)
        origins = np.tile(pose[:3, 3], (len(rays), 1))
        places, which, _ = solid.ray.intersects_location(
            origins, (rays / lengths[:, np.newaxis]) @ pose[:3, :3].T, multiple_hits=False
        )
        hits = np.full(len(rays), np.inf)
        hits[which] = np.linalg.norm(places - pose[:3, 3], axis=1)
        real = pixels_of(depths[stamp.nanosec], "<u2").reshape(-1) * 1e-3 * lengths
        real[real == 0.0] = np.inf
        heights = pose[2, 3] + real * (rays @ pose[2, :3]) / lengths
        is_hidden = (real + 0.02 < hits) & (heights > 0.06)
        wanted = (np.isfinite(hits) & ~is_hidden).reshape(info.height, info.width)
        found = pixels_of(mask, "<i4").reshape(info.height, info.width) == number
        near = np.zeros_like(wanted)
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                near |= np.roll(wanted, (down, right), (0, 1)) != wanted
        assert found.sum() > 5_000
        # Where body and chair are as near, 2 cm decide: a few pixels may differ.
        assert np.count_nonzero((found != wanted)[~near]) <= 2e-3 * found.sum()
        assert np.count_nonzero(found != wanted) < 0.03 * found.sum()
        assert is_hidden[np.isfinite(hits)].mean() > 0.02  # the chair is before it
        shown = pixels_of(images_at(images, stamp.nanosec), "u1").reshape(*found.shape, -1)
        real_pixels = pixels_of(before[stamp.nanosec], "u1").reshape(*found.shape, -1)
        assert (shown != real_pixels).any(axis=2)[found].mean() > 0.98


def images_at(images: list[Any], nanosec: int) -> Any:
    """Return the image of a stamp."""
    return next(one for one in images if one.header.stamp.nanosec == nanosec)


def test_the_first_image_before_anybody_came_is_unchanged(redwood: Path) -> None:
    """Byte for byte, as received."""
    first, real = (
        messages(redwood, topic)[0] for topic in ("/ar_builder/camera/image", "/camera/image")
    )
    assert first.header.stamp == real.header.stamp
    assert (np.asarray(first.data) == np.asarray(real.data)).all()


def test_boxes_and_fractions_are_those_of_the_masks(redwood: Path) -> None:
    """The tight box of each mask; and the pose of the box is where the camera sees its middle."""
    masks, truths, boxes = (
        messages(redwood, f"/ar_builder/camera/image/{name}") for name in ("mask", "truth", "boxes")
    )
    info = messages(redwood, "/camera/camera_info")[0]
    assert len(masks) == len(truths) == len(boxes) == 5
    for mask, truth, detections in zip(masks, truths, boxes, strict=True):
        assert repr(mask.header) == repr(truth.header) == repr(detections.header)
        ids = pixels_of(mask, "<i4").reshape(info.height, info.width)
        assert {one.id for one in truth.artefacts if one.visible_pixels} == {*ids[ids > 0].tolist()}
        assert len(detections.detections) == len(np.unique(ids[ids > 0]))
        for one in truth.artefacts:
            rows, columns = np.nonzero(ids == one.id)
            assert one.visible_pixels == len(rows)
            assert 0.05 < one.visible_fraction < 1.0  # it stands behind the chair
            (box,) = [box for box in detections.detections if box.id == str(one.id)]
            x, y = box.bbox.center.position.x, box.bbox.center.position.y
            assert (x - 0.5 * box.bbox.size_x, x + 0.5 * box.bbox.size_x) == (
                columns.min(),
                columns.max() + 1,
            )
            assert (y - 0.5 * box.bbox.size_y, y + 0.5 * box.bbox.size_y) == (
                rows.min(),
                rows.max() + 1,
            )
            at = one.box.position
            u = info.k[0] * at.x / at.z + info.k[2]
            assert columns.min() - 40 < u < columns.max() + 40
            assert repr(box.results[0].pose.pose.position) == repr(at)


def test_are_check_judges_the_images(redwood: Path, run_are: RunAre) -> None:
    """Pixels, masks and boxes of a real recording."""
    done = run_are("check", redwood)
    said = {line.partition(":")[0]: line for line in done.stdout.splitlines()}
    assert said["painted images"].startswith("painted images: passed, 5 images (1 as they came")
    assert said["boxes"].startswith("boxes: passed, ")
