"""The judge of painted images, masks and boxes: what it accepts, and what it finds wrong."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from are_ros.bag.decoded import Scene, value_of
from are_ros.bag.types import jazzy_typestore
from are_ros.builder.certainty.perception import Perception
from are_ros.builder.occlusion.meshes import MeshSelection
from are_ros.builder.scene import Scene as TruthScene
from are_ros.builder.sensors.colour_image import (
    ColourImage,
    ColourPixels,
    CompressedColour,
    RawColour,
    Studio,
)
from are_ros.builder.sensors.image import CompressedImage, Image
from are_ros.builder.sensors.lens import Lens
from are_ros.builder.sensors.obstacles import Obstacles
from are_ros.checks.oracle.frames import TF
from are_ros.checks.record import Record
from are_ros.checks.result import CheckResult, Outcome
from are_ros.checks.sensors.colours import ColourFrame, Mask, change_of
from are_ros.checks.sensors.painted import check_boxes, check_images
from are_ros.messages.artefacts import ArtefactEncoder, encode_perceived
from are_ros.messages.images.colour import encode_colour, encode_mask, encode_truth
from are_ros.messages.images.detections import (
    encode_boxes,
    encode_boxes_of_perceived,
    encode_boxes_of_scene,
)
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.world.cameras import FORWARD_FROM_OPTICAL, CameraInfo
from are_ros.world.rigid_transform import RigidTransform

MS = 1_000_000
STAMP_NS, TICKS_NS = 1_050 * MS, (1_000 * MS, 1_100 * MS)
WIDTH, HEIGHT = 160, 120
K = (100.0, 0.0, 79.5, 0.0, 100.0, 59.5, 0.0, 0.0, 1.0)
TURN = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
INFO = CameraInfo(WIDTH, HEIGHT, "plumb_bob", (), K, TURN, (*K[:3], 0, *K[3:6], 0, *K[6:], 0))
CAMERA = RigidTransform.from_xyz_ypr(0.0, 0.0, 1.0, 0.0, 0.0, 0.0) @ FORWARD_FROM_OPTICAL
ROW = CatalogueRow(0, "post", "thing", (0.4, 0.4, 1.6), (0.0, 0.0, 0.0), Shape.CRATE)
IN, OUT = "/camera/image", "/ar_builder/camera/image"


def truth() -> TruthScene:
    """Return a post 3 m before the camera, and one behind it."""
    places = GroundPose(3.0, 0.2, 0.0, 0.3), GroundPose(-3.0, 0.0, 0.0, 0.0)
    posts = [
        Artefact(7 + k, ROW, Origin.RANDOM, 0, PoseHistory(0, at)) for k, at in enumerate(places)
    ]
    return TruthScene.of(posts, STAMP_NS)


def grey() -> npt.NDArray[np.uint8]:
    """Return a smooth image with some texture."""
    random = np.random.default_rng(4)
    coarse = random.integers(80, 180, (12, 16, 3)).astype(np.uint8)
    return np.asarray(cv2.resize(coarse, (WIDTH, HEIGHT)), np.uint8)


def raw() -> RawColour:
    """Return it as it comes raw, with padding."""
    rows = np.pad(grey().reshape(HEIGHT, -1), ((0, 0), (0, 4)), constant_values=9)
    return RawColour(Image("camera", STAMP_NS, "bgr8", 0, WIDTH, rows))


def unusual(encoding: str) -> RawColour:
    """Return a raw image as cameras send it: a mosaic, or YUV of 4:2:2."""
    random = np.random.default_rng(4)
    channels = 1 if encoding.startswith("bayer") else 2
    coarse = random.integers(80, 180, (12, 16, channels)).astype(np.uint8)
    rows = cv2.resize(coarse, (WIDTH, HEIGHT)).reshape(HEIGHT, -1)
    return RawColour(Image("camera", STAMP_NS, encoding, 0, WIDTH, np.asarray(rows, np.uint8)))


def packed(suffix: str) -> CompressedColour:
    """Return it compressed."""
    data = cv2.imencode(suffix, grey())[1].reshape(-1)
    return CompressedColour(CompressedImage("camera", STAMP_NS, "bgr8; compressed bgr8", data))


def painted(pixels: ColourPixels) -> ColourImage:
    """Return what the builder makes of it."""
    parameters, scene = Parameters(), truth()
    studio = Studio(parameters.rendering, parameters.seed)
    shapes = MeshSelection.boxes_only(len(scene))
    lens = Lens("camera", INFO, INFO.view(rectified=False))
    obstacles = Obstacles(scene.boxes, shapes, scene=scene, studio=studio)
    return ColourImage(pixels).seen_through(lens).augmented(CAMERA, obstacles)


def read(data: bytes | None, type_name: str) -> Any:
    """Return a message as the checks have it."""
    assert data is not None
    return value_of(type_name, jazzy_typestore().deserialize_cdr(data, type_name), STAMP_NS)


def info_message() -> Any:
    """Return the CameraInfo."""
    return SimpleNamespace(
        width=WIDTH, height=HEIGHT, distortion_model="plumb_bob", d=np.zeros(0), binning_x=0,
        binning_y=0, k=np.array(K), r=np.array(TURN), p=np.array(INFO.p),
        roi=SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0),
    )  # fmt: skip


def record_of(before: ColourPixels, after: ColourImage) -> Record:
    """Return a recording of one image, with what was told of it."""
    record = Record(Parameters(), has_images=True, topics=frozenset((IN, OUT)))
    scene = truth()
    for at_ns in TICKS_NS:
        data = ArtefactEncoder().encode("map", at_ns, scene)
        record.scenes.append(read(data, "are_msgs/msg/ArtefactArray"))
        record.scenes[-1] = replace(record.scenes[-1], at_ns=at_ns)
    numbers = (*CAMERA.translation_m.tolist(), *CAMERA.rotation_xyzw.tolist())
    record.frames.add("map", "camera", 0, 0, numbers, TF, is_static=True)
    record.scans.infos["/camera/camera_info"] = info_message()
    is_raw = isinstance(before, RawColour)
    kind = f"sensor_msgs/msg/{'Image' if is_raw else 'CompressedImage'}"
    for topic, image in ((IN, ColourImage(before)), (OUT, after)):
        frame = ColourFrame.of_message(read(encode_colour(image), kind), STAMP_NS + MS)
        assert frame is not None
        record.paintings.add(topic, frame, record.scans.info_of)
    told = record.paintings.add_told
    told(f"{OUT}/mask", read(encode_mask(after), "sensor_msgs/msg/Image"))
    told(f"{OUT}/truth", read(encode_truth(after), "are_msgs/msg/ImageTruth"))
    told(f"{OUT}/boxes", read(encode_boxes(after), "vision_msgs/msg/Detection2DArray"))
    return record


def with_pixels(image: ColourImage, change: Callable[[npt.NDArray[Any]], None]) -> ColourImage:
    """Return a raw image with some pixels changed."""
    assert isinstance(image.pixels, RawColour)
    pixels = image.pixels.image.pixels().copy()
    change(pixels)
    return replace(image, pixels=RawColour(image.pixels.image.with_pixels(pixels)))


def failure(result: CheckResult) -> str:
    """Return what a check found wrong."""
    assert result.outcome is Outcome.FAILED, result.sentence()
    return result.counter_example


@pytest.mark.parametrize(
    "make",
    [
        raw,
        lambda: unusual("bayer_grbg8"),
        lambda: unusual("yuv422_yuy2"),
        lambda: unusual("uyvy"),
        lambda: packed(".jpg"),
        lambda: packed(".png"),
    ],
)
def test_what_the_builder_paints_is_right(make: Callable[[], ColourPixels]) -> None:
    """Raw, and compressed anew: with shadow, blur and noise."""
    before = make()
    after = painted(before)
    assert after.pixels is not before
    record = record_of(before, after)
    for result in (check_images(record), check_boxes(record)):
        assert result.outcome is Outcome.PASSED, result.sentence()
    (changed,) = record.paintings.changed.kept
    assert changed.change.is_changed.sum() > 500


def test_an_image_that_nobody_is_in_passes_byte_for_byte() -> None:
    """The same bytes are counted, and need no geometry; other padding is a fault."""
    before = raw()
    after = painted(before)
    record = record_of(before, replace(after, pixels=before))
    assert record.paintings.unchanged == 1
    assert "is unchanged, but its mask is not empty" in failure(check_images(record))
    rows = before.image.data.copy()
    rows[:, -1] = 0
    other = RawColour(replace(before.image, data=rows))
    record = record_of(before, replace(after, pixels=other))
    assert "another size, encoding or padding" in failure(check_images(record))


def test_a_png_that_was_compressed_for_nothing_is_found() -> None:
    """The pixels are the same, the bytes are not."""
    before = packed(".png")
    data = cv2.imencode(".png", grey(), [cv2.IMWRITE_PNG_COMPRESSION, 0])[1].reshape(-1)
    other = CompressedColour(replace(before.image, data=data))
    record = record_of(before, replace(painted(before), pixels=other))
    assert "though nothing is painted" in failure(check_images(record))


def test_pixels_that_change_where_no_artefact_is_are_found() -> None:
    """Far from the post; and brighter ones on the floor about it."""
    before = raw()
    after = painted(before)

    def stray(pixels: npt.NDArray[Any]) -> None:
        pixels[5, 10] += 1

    found = failure(check_images(record_of(before, with_pixels(after, stray))))
    assert "1 pixel (row 5, column 10 the first) changed, where no artefact is" in found

    def bright(pixels: npt.NDArray[Any]) -> None:
        pixels[95, 100] = 255

    found = failure(check_images(record_of(before, with_pixels(after, bright))))
    assert "(row 95, column 100 the first) brighter beside an artefact" in found


@pytest.mark.parametrize("encoding", ["bayer_rggb8", "yuyv"])
def test_in_an_unusual_raw_image_what_changes_elsewhere_is_found(encoding: str) -> None:
    """One byte; of a luma that is greater beside an artefact, too."""
    before = unusual(encoding)
    after = painted(before)

    def stray(pixels: npt.NDArray[Any]) -> None:
        pixels.reshape(HEIGHT, WIDTH, -1)[5, 10, 0] += 1

    found = failure(check_images(record_of(before, with_pixels(after, stray))))
    assert "1 pixel (row 5, column 10 the first) changed, where no artefact is" in found

    def bright(pixels: npt.NDArray[Any]) -> None:
        pixels.reshape(HEIGHT, WIDTH, -1)[95, 100, 0] = 255

    found = failure(check_images(record_of(before, with_pixels(after, bright))))
    assert "(row 95, column 100 the first) brighter beside an artefact" in found


def test_in_a_jpeg_what_changes_elsewhere_is_found() -> None:
    """Beyond what compressing alone changes."""
    before = packed(".jpg")
    after = painted(before)
    pixels = after.pixels.rgb()[:, :, ::-1].copy()
    pixels[4:12, 4:12] += 40
    data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].reshape(-1)
    assert isinstance(after.pixels, CompressedColour)
    other = CompressedColour(replace(after.pixels.image, data=data))
    found = failure(check_images(record_of(before, replace(after, pixels=other))))
    assert "changed, where no artefact is" in found


def test_masks_are_where_their_artefacts_are() -> None:
    """One that is shifted is not; nor one of the artefact that is behind the camera."""
    before = raw()
    after = painted(before)
    assert after.truth is not None
    for mask in (np.roll(after.truth.mask, 30, axis=1), np.where(after.truth.mask == 0, 1, -1)):
        wrong = replace(after, truth=replace(after.truth, mask=mask.astype(np.int32)))
        found = failure(check_images(record_of(before, wrong)))
        assert "where its box is not" in found


def test_a_mask_of_what_was_not_painted_is_found() -> None:
    """Most of its pixels are as they came."""
    before = raw()
    after = painted(before)
    assert after.truth is not None
    was = raw().image.pixels()

    def undo(pixels: npt.NDArray[Any]) -> None:
        pixels[:80] = was[:80]

    assert "of the pixels of its mask differ" in failure(
        check_images(record_of(before, with_pixels(after, undo)))
    )


def test_a_painted_image_without_its_input_is_found() -> None:
    """In a replay; and without any input the check is skipped, and says what it needs."""
    record = record_of(raw(), painted(raw()))
    late = replace(next(iter(record.paintings.changed.kept)), stamp_ns=1)
    frame = ColourFrame(late.stamp_ns, 5, "camera", grey(), b"", ())
    record.paintings.add(OUT, frame, record.scans.info_of)
    assert "has no image of this stamp" in failure(check_images(record))
    record.paintings.input_topics.clear()
    assert check_images(record).outcome is Outcome.SKIPPED


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda one: setattr(one.roi, "width", one.roi.width + 1), "is not that of its mask"),
        (lambda one: setattr(one, "visible_pixels", 3), "is not that of its mask"),
        (lambda one: setattr(one, "visible_fraction", 1.5), "the visible fraction 1.5"),
        (lambda one: setattr(one, "class_name", "car"), "boxes are not those of the truth"),
    ],
)
def test_a_truth_that_is_not_that_of_the_mask_is_found(change: Any, said: str) -> None:
    """Rectangles, numbers of pixels, fractions, classes."""
    record = record_of(raw(), painted(raw()))
    (told,) = record.paintings.truths.values()
    change(told.artefacts[0])
    assert said in failure(check_boxes(record))


def test_boxes_in_the_map_are_those_of_the_lists() -> None:
    """Of the artefacts, and of the perceived with their scores."""
    record, scene = record_of(raw(), painted(raw())), truth()
    artefacts = read(encode_boxes_of_scene("map", 1, scene), "vision_msgs/msg/Detection3DArray")
    record.artefact_boxes.append((STAMP_NS, artefacts))
    told = Perception(STAMP_NS, tuple(seen(scene, k) for k in range(2)))
    data = encode_perceived("map", STAMP_NS, "robot", told.artefacts)
    record.perceived.append(read(data, "are_msgs/msg/PerceivedArtefactArray"))
    boxes = encode_boxes_of_perceived("map", STAMP_NS, told.artefacts, scene.boxes)
    perceived = read(boxes, "vision_msgs/msg/Detection3DArray")
    record.perceived_boxes.append((STAMP_NS, perceived))
    record.scenes[0] = as_of(record.scenes[0], STAMP_NS)
    right = check_boxes(record)
    assert (right.outcome, right.looked_at) == (Outcome.PASSED, 4)
    nobody = encode_boxes_of_scene("map", 1, TruthScene.of([], STAMP_NS))
    farewell = STAMP_NS, read(nobody, "vision_msgs/msg/Detection3DArray")
    record.artefact_boxes.append(farewell)
    assert "are not those of the list" in failure(check_boxes(record))
    record.farewells_ns.append(STAMP_NS)
    assert check_boxes(record).outcome is Outcome.PASSED
    artefacts.detections[0].bbox.center.position.x += 0.1
    assert "boxes of the artefacts are not those" in failure(check_boxes(record))
    artefacts.detections[0].bbox.center.position.x -= 0.1
    perceived.detections[1].results[0].hypothesis.score = 0.9
    assert "boxes of the perceived are not those" in failure(check_boxes(record))


def as_of(scene: Scene, stamp_ns: int) -> Scene:
    """Return a scene with another stamp."""
    return replace(scene, stamp_ns=stamp_ns)


def seen(scene: TruthScene, k: int) -> Any:
    """Return what an observer without any uncertainty knows of one."""
    from are_ros.agents.events import Sighting
    from are_ros.builder.observation import perceived_artefact

    return perceived_artefact(scene.state(k), Sighting(9, 10, (1, 2, 3, 4), 2.5))


def test_changes_are_counted_by_what_compressing_does_not_explain() -> None:
    """A JPEG that is only compressed anew, by any tables, has no changed pixel."""
    before = packed(".jpg")
    for quality in (40, 75, 95):
        again = cv2.imdecode(before.image.data, cv2.IMREAD_COLOR)
        assert again is not None
        data = cv2.imencode(".jpg", again, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].reshape(-1)
        frames = [
            ColourFrame.of_message(
                SimpleNamespace(
                    header=SimpleNamespace(
                        stamp=SimpleNamespace(sec=1, nanosec=0), frame_id="camera"
                    ),
                    format="jpeg",
                    data=one,
                ),
                1,
            )
            for one in (before.image.data, data)
        ]
        real, output = frames
        assert real is not None
        assert output is not None
        assert not change_of(real, output).is_changed.any()


def test_a_mask_knows_its_regions() -> None:
    """Tight rectangles, by id, and the ids themselves."""
    ids = np.zeros((4, 6), "<i4")
    ids[1, 2] = ids[3, 4] = 70
    ids[0, 0] = 2
    message = SimpleNamespace(
        encoding="32SC1", height=4, width=6, step=24, is_bigendian=0, data=ids.view(np.uint8)
    )
    mask = Mask.of_message(message)
    assert {i: tuple(region) for i, region in mask.regions.items()} == {
        2: (0, 0, 1, 1, 1),
        70: (2, 1, 3, 3, 2),
    }
    assert (mask.ids == ids).all()
    message.encoding = "mono8"
    with pytest.raises(ValueError, match="a mask is 32SC1, not mono8"):
        Mask.of_message(message)
