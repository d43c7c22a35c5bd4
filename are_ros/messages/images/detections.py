"""What images and cameras show, as vision_msgs: boxes in images, and boxes in the map.

vision_msgs has no field for a visible fraction: that of an image is in are_msgs/ImageTruth, that of
a camera's look in are_msgs/PerceivedArtefact.
"""

from collections.abc import Sequence
from typing import Final

from are_ros.agents.events import PerceivedArtefact
from are_ros.builder.scene import Scene
from are_ros.builder.sensors.colour_image import ColourImage
from are_ros.messages.cdr import CdrWriter
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.rigid_transform import RigidTransform

_CERTAIN: Final = (0.0,) * 36


def encode_boxes(image: ColourImage) -> bytes | None:
    """Return a vision_msgs/Detection2DArray of the artefacts with a pixel of their own in an image.

    None where nothing is known of what is painted. Pixel (0, 0) is the square from 0 to 1, so that
    a box from the first pixel of an image to its last is as large as the image. Poses are those of
    the middles of the artefacts' boxes, in the optical frame.
    """
    if image.truth is None:
        return None
    frame_id, stamp_ns = image.frame_id, image.stamp_ns
    seen = [one for one in image.truth.in_image if one.visible_pixels]
    writer = CdrWriter()
    writer.header(frame_id, stamp_ns)
    writer.count(len(seen))
    for one in seen:
        x, y, width, height = one.roi_px
        writer.header(frame_id, stamp_ns)
        writer.count(1)
        _append_hypothesis(writer, one.artefact.row.class_name, 1.0, one.camera_from_box, _CERTAIN)
        writer.doubles(x + 0.5 * width, y + 0.5 * height, 0.0, width, height)
        writer.text(str(one.artefact.id))
    return writer.message()


def encode_boxes_of_scene(frame_id: str, stamp_ns: int, scene: Scene) -> bytes:
    """Return a vision_msgs/Detection3DArray of all artefacts, as they truly are."""
    poses = (RigidTransform(pose[:3], pose[3:]) for pose in scene.poses)
    hypotheses = [
        [(row.class_name, 1.0, pose, _CERTAIN)] for row, pose in zip(scene.rows, poses, strict=True)
    ]
    return _encode_boxes(frame_id, stamp_ns, scene.ids.tolist(), hypotheses, scene.boxes)


def encode_boxes_of_perceived(
    frame_id: str, stamp_ns: int, perceived: Sequence[PerceivedArtefact], boxes: OrientedBoxes
) -> bytes:
    """Return a vision_msgs/Detection3DArray of what is perceived, N, with its boxes (N).

    The score of a class is the probability that there is an artefact of this class: existence times
    that of the class. The scores of all classes sum to the existence.
    """
    ids = [one.artefact_id for one in perceived]
    hypotheses = [
        [
            (name, one.existence * probability, one.map_from_artefact, one.pose_covariance)
            for name, probability in zip(one.classes, one.probabilities, strict=True)
        ]
        for one in perceived
    ]
    return _encode_boxes(frame_id, stamp_ns, ids, hypotheses, boxes)


_Hypothesis = tuple[str, float, RigidTransform, Sequence[float]]


def _encode_boxes(
    frame_id: str,
    stamp_ns: int,
    ids: Sequence[int],
    hypotheses: Sequence[Sequence[_Hypothesis]],
    boxes: OrientedBoxes,
) -> bytes:
    columns = boxes.centres_m.tolist(), boxes.yaws_rad.tolist(), boxes.half_sizes_m.tolist()
    writer = CdrWriter()
    writer.header(frame_id, stamp_ns)
    writer.count(len(ids))
    for number, results, (x, y, z), yaw_rad, halves_m in zip(
        ids, hypotheses, *columns, strict=True
    ):
        writer.header(frame_id, stamp_ns)
        writer.count(len(results))
        for result in results:
            _append_hypothesis(writer, *result)
        writer.pose(RigidTransform.planar(x, y, yaw_rad, z))
        writer.doubles(*(2.0 * half_m for half_m in halves_m))
        writer.text(str(number))
    return writer.message()


def _append_hypothesis(
    writer: CdrWriter,
    class_name: str,
    score: float,
    pose: RigidTransform,
    covariance: Sequence[float],
) -> None:
    writer.text(class_name)
    writer.doubles(score)
    writer.pose(pose)
    writer.doubles(*covariance)
