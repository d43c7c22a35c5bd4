"""geometry_msgs/Pose <-> rigid transforms."""

from collections.abc import Sequence
from typing import Any

from are_ros.errors import InputError, InvalidTransformError
from are_ros.messages.factory import MessageFactory
from are_ros.messages.geometry import make_point, make_quaternion
from are_ros.world.rigid_transform import RigidTransform


def read_pose(pose: Any, field: str, source: str) -> RigidTransform:
    """Return a Pose as `parent_from_pose`; InputError if it is not finite or no rotation.

    `field` is its name in the message, `source` the topic: the error's sentence begins so.
    """
    at, rotation = pose.position, pose.orientation
    quaternion = (rotation.x, rotation.y, rotation.z, rotation.w)
    return checked_pose((at.x, at.y, at.z), quaternion, field, source)


def checked_pose(
    translation_m: Sequence[float], rotation_xyzw: Sequence[float], field: str, source: str
) -> RigidTransform:
    """Return 3 + 4 numbers of a message as a transform; InputError as `read_pose`."""
    try:
        return RigidTransform.checked(translation_m, rotation_xyzw)
    except InvalidTransformError as cause:
        message = f"{source}: {field}: {cause}"
        raise InputError(message) from cause


def make_pose(factory: MessageFactory, parent_from_pose: RigidTransform) -> Any:
    """Return a geometry_msgs/Pose."""
    return factory.make(
        "geometry_msgs/msg/Pose",
        position=make_point(factory, parent_from_pose.translation_m.tolist()),
        orientation=make_quaternion(factory, parent_from_pose.rotation_xyzw.tolist()),
    )
