"""geometry_msgs/Pose <-> rigid transforms."""

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
    try:
        return RigidTransform.checked(
            (at.x, at.y, at.z), (rotation.x, rotation.y, rotation.z, rotation.w)
        )
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
