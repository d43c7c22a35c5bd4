"""Boxes as vision_msgs, and the truth about an image: what rclpy and rosbags read of the bytes."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from are_ros.agents.events import PerceivedArtefact, Sighting
from are_ros.bag.types import jazzy_typestore
from are_ros.builder.rendering.painter import PaintedBody
from are_ros.builder.scene import Scene
from are_ros.builder.sensors.colour_image import ColourImage, ImageTruth, RawColour
from are_ros.builder.sensors.image import Image
from are_ros.messages.images.colour import encode_mask, encode_truth
from are_ros.messages.images.detections import (
    encode_boxes,
    encode_boxes_of_perceived,
    encode_boxes_of_scene,
)
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.cameras import FORWARD_FROM_OPTICAL
from are_ros.world.rigid_transform import RigidTransform

BOXES_2D, BOXES_3D = "vision_msgs/msg/Detection2DArray", "vision_msgs/msg/Detection3DArray"
TRUTH = "are_msgs/msg/ImageTruth"
ROW = CatalogueRow(3, "tall", "person", (0.5, 0.6, 1.7), (0.0, 0.1, -0.05), Shape.WALL)
STILL, CERTAIN = (0.0, 0.0, 0.0), (0.0,) * 36
BOTH = Callable[[bytes, str], tuple[Any, Any]]
CAMERA = RigidTransform.from_xyz_ypr(1.0, 0.0, 1.2, 0.0, 0.0, 0.0) @ FORWARD_FROM_OPTICAL
NO_SURFACE: Any = None


def artefact(number: int, x_m: float) -> Artefact:
    """Return an artefact that stands at x, turned by 0.5 rad."""
    return Artefact(number, ROW, Origin.RANDOM, 0, PoseHistory(0, GroundPose(x_m, 2.0, 0.25, 0.5)))


def image_of_three() -> ColourImage:
    """Return an image of 6 x 4 pixels: 5 covers three of them, 8 is hidden, 9 outside of it."""
    mask = np.full((4, 6), -1, dtype=np.int32)
    mask[1, 2] = mask[1, 4] = mask[2, 3] = 0
    artefacts = [artefact(number, 3.0 + number) for number in (5, 8, 9)]
    half_m = 0.5 * np.array(ROW.size_m)
    bodies = [
        PaintedBody(NO_SURFACE, RigidTransform.planar(3.0 + k, 0.5, 0.0, 1.2), half_m, 0.0)
        for k in range(3)
    ]
    truth = ImageTruth(mask, CAMERA, artefacts, bodies, np.array((0.25, 0.0, np.nan)))
    pixels = Image("eye", 7_000_000_009, "mono8", 0, 6, np.zeros((4, 6), np.uint8))
    return ColourImage(RawColour(pixels), truth=truth)


def read(data: bytes | None, type_name: str) -> Any:
    """Return a message as rosbags reads it."""
    assert data is not None
    return jazzy_typestore().deserialize_cdr(data, type_name)


def test_the_truth_about_an_image_names_what_is_hidden_too() -> None:
    """What is outside of it is left out; the pose of the box is in the optical frame."""
    told = read(encode_truth(image_of_three()), TRUTH)
    assert (told.header.frame_id, told.header.stamp.sec, told.header.stamp.nanosec) == ("eye", 7, 9)
    seen, hidden = told.artefacts
    assert (seen.id, seen.label, seen.class_name) == (5, "tall", "person")
    roi = seen.roi
    assert (roi.x_offset, roi.y_offset, roi.width, roi.height, roi.do_rectify) == (2, 1, 3, 2, 0)
    assert (seen.visible_pixels, seen.visible_fraction) == (3, 0.25)
    at = seen.box.position
    assert (at.x, at.y, at.z) == pytest.approx((-0.5, 0.0, 2.0))  # 0.5 m to the left, 2 m ahead
    assert (seen.size.x, seen.size.y, seen.size.z) == ROW.size_m
    assert (hidden.id, hidden.visible_pixels, hidden.visible_fraction) == (8, 0, 0.0)
    assert (hidden.roi.width, hidden.roi.height) == (0, 0)


def test_the_boxes_of_an_image_are_those_of_its_mask() -> None:
    """Tight, to the outer edges of the pixels; what has no pixel of its own has no box."""
    image = image_of_three()
    told = read(encode_boxes(image), BOXES_2D)
    (one,) = told.detections
    assert told.header == one.header
    assert (one.id, one.results[0].hypothesis.class_id, one.results[0].hypothesis.score) == (
        *("5", "person"),
        1.0,
    )
    center = one.bbox.center
    assert (center.position.x, center.position.y, center.theta) == (3.5, 2.0, 0.0)
    assert (one.bbox.size_x, one.bbox.size_y) == (3.0, 2.0)
    mask = read(encode_mask(image), "sensor_msgs/msg/Image")
    ids = np.array(mask.data).view("<i4").reshape(4, 6)
    rows, columns = np.nonzero(ids == 5)
    edges = columns.min(), columns.max() + 1, rows.min(), rows.max() + 1
    assert edges == (2, 5, 1, 3)
    assert (0.5 * (edges[0] + edges[1]), 0.5 * (edges[2] + edges[3])) == (3.5, 2.0)


def test_of_an_image_that_nothing_is_known_of_nothing_is_told() -> None:
    """It passed through: no list says that nobody is in it."""
    image = ColourImage(image_of_three().pixels)
    assert encode_truth(image) is encode_boxes(image) is encode_mask(image) is None


def test_the_scene_is_told_with_certainty() -> None:
    """The box is where it is, the pose of the hypothesis that of F_A."""
    scene = Scene.of([artefact(5, 1.0), artefact(8, 4.0)], 0)
    told = read(encode_boxes_of_scene("map", 100, scene), BOXES_3D)
    assert [one.id for one in told.detections] == ["5", "8"]
    one = told.detections[1]
    box, pose = one.bbox.center, one.results[0].pose
    assert (box.position.x, box.position.y, box.position.z) == pytest.approx(
        scene.boxes.centres_m[1].tolist()
    )
    assert 2.0 * math.atan2(box.orientation.z, box.orientation.w) == pytest.approx(0.5)
    assert (one.bbox.size.x, one.bbox.size.y, one.bbox.size.z) == pytest.approx(ROW.size_m)
    assert (pose.pose.position.x, pose.pose.position.z) == (4.0, 0.25 + ROW.com_height_m)
    assert not pose.covariance.any()
    assert one.results[0].hypothesis.score == 1.0


def perceived(number: int, classes: dict[str, float], existence: float) -> PerceivedArtefact:
    """Return what is perceived of one."""
    pose, covariance = RigidTransform.planar(1.0, 2.0, 0.5, 0.4), tuple(map(float, range(36)))
    return PerceivedArtefact(
        number, "x", tuple(classes), tuple(classes.values()), pose, covariance, ROW.size_m, STILL,
        STILL, CERTAIN, Sighting(9, 10, (1, 2, 3, 4), 2.5), existence,
    )  # fmt: skip


def test_the_scores_of_the_perceived_sum_to_their_existence() -> None:
    """Each is the probability that there is an artefact, and that it is of this class."""
    boxes = OrientedBoxes.standing(np.array([[5.0, 6.0, 0.0, 0.2]]), np.array([[1.0, 2, 3, 0, 0]]))
    one = perceived(10**12, {"person": 0.75, "car": 0.25}, 0.5)
    told = read(encode_boxes_of_perceived("map", 100, [one], boxes), BOXES_3D)
    (detection,) = told.detections
    assert detection.id == str(10**12)
    scores = {r.hypothesis.class_id: r.hypothesis.score for r in detection.results}
    assert scores == {"person": 0.375, "car": 0.125}
    assert detection.results[0].pose.covariance.tolist() == [*range(36)]
    assert (detection.bbox.center.position.x, detection.bbox.size.z) == (5.0, 6.0)
    assert detection.header == told.header


def test_rclpy_reads_the_same(both_readings: BOTH) -> None:
    """Field by field what rosbags reads, whatever the alignment of texts and lists."""
    image, scene = image_of_three(), Scene.of([artefact(5, 1.0), artefact(1234, 4.0)], 0)
    many = [perceived(k, {"a" * k: 0.5, "b": 0.5}, 0.9) for k in range(1, 10)]
    boxes = OrientedBoxes.standing(np.zeros((9, 4)), np.ones((9, 5)))
    messages: dict[str, list[bytes | None]] = {
        BOXES_2D: [encode_boxes(image)],
        TRUTH: [encode_truth(image)],
        BOXES_3D: [
            encode_boxes_of_scene("earth", 100, scene),
            encode_boxes_of_perceived("m", 100, many, boxes),
        ],
    }
    for type_name, encoded in messages.items():
        for data in encoded:
            assert data is not None
            by_rclpy, by_rosbags = both_readings(data, type_name)
            assert by_rclpy == by_rosbags
