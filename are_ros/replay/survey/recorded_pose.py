"""The transform of the map where none was recorded, from poses on it (amcl_pose, robot_pose)."""

from contextlib import suppress
from typing import Final

import numpy as np

from are_ros.bag.reader import BagReader
from are_ros.bag.roles import RolesFound
from are_ros.errors import AreError
from are_ros.messages.common import read_header, read_pose
from are_ros.parameters.model import Parameters
from are_ros.replay.recorded_frames import FRAME_ROLES, RecordedFrames
from are_ros.replay.survey.frame_survey import static_tf_option
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.transforms.tree import FrameTree

_POSE_TYPES: Final = (
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PoseStamped",
)
"""The first is that of localisation; the second counts where there is none on the map."""
_NOT_OF_THE_ROBOT: Final = ("initialpose", "goal")
"""Parts of the names of topics with a user's guess where the robot is, and where it is to go."""

_FOR_EVER_NS: Final = 2**62
"""The clock of the stamps may be quicker than that of the log, as in simulation."""


def option_of_poses(
    reader: BagReader,
    roles: RolesFound,
    parameters: Parameters,
    map_frame: str,
    standing: str,
    base_frame: str,
    *,
    is_top: bool = True,
) -> str:
    """Return what `are replay` needs to know of the map's place, with its numbers, "" for nothing.

    `standing` is the frame of the base's tree that the map is to be joined to, and `is_top` whether
    it has no parent, so that the map becomes it. `parameters` have the transforms that are given.
    One transform stands for the whole recording: that of the middle one of the poses, said with its
    largest distance from the others.
    """
    topics = [
        topic.name
        for type_name in _POSE_TYPES
        for topic in sorted(reader.topics, key=lambda one: one.name)
        if topic.type_name == type_name
        and not any(part in topic.name for part in _NOT_OF_THE_ROBOT)
    ]
    poses = [
        (topic, stamp_ns, pose)
        for topic in topics
        for stamp_ns, pose in _poses(reader, topic, map_frame)
    ]
    if not poses:
        return ""
    tree = _frames(reader, roles, parameters)
    placed = [
        (topic, pose, standing_from_base)
        for topic, stamp_ns, pose in poses
        if topic == poses[0][0]
        and (standing_from_base := tree.try_lookup(standing, base_frame, stamp_ns)) is not None
    ]
    if not placed:
        return ""
    topic, map_from_base, standing_from_base = placed[len(placed) // 2]
    found = map_from_base @ standing_from_base.inverse()
    x_m, y_m, z_m = found.translation_m.tolist()
    found = RigidTransform.planar(x_m, y_m, found.yaw_rad(), z_m)
    off_m = max(
        float(np.linalg.norm((found @ there).translation_m - pose.translation_m))
        for _, pose, there in placed
    )
    given, ends = (found, (map_frame, standing))
    if not is_top:
        given, ends = (found.inverse(), (standing, map_frame))
    return (
        f"{topic} tells it: give {static_tf_option(*ends, given.matrix())}, which is within"
        f" {off_m:.2f} m of all {len(placed)} poses"
    )


def _poses(reader: BagReader, topic: str, frame: str) -> list[tuple[int, RigidTransform]]:
    """Return the stamps and poses of a topic that are in a frame; others are left out."""
    found = []
    for message in reader.messages((topic,)):
        with suppress(AreError):
            value = reader.deserialize(message)
            header = read_header(value, topic)
            if header.frame_id == frame:
                pose = getattr(value.pose, "pose", value.pose)
                found.append((header.stamp_ns, read_pose(pose, "pose", topic)))
    return found


def _frames(reader: BagReader, roles: RolesFound, parameters: Parameters) -> FrameTree:
    """Return all transforms and odometry of a recording, and the transforms that are given."""
    recorded = RecordedFrames(parameters, _FOR_EVER_NS)
    chosen = roles.by_topic(FRAME_ROLES)
    for message in reader.messages(chosen):
        recorded.take_message(reader, message, chosen[message.topic])
    return recorded.tree
