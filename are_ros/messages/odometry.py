"""nav_msgs/Odometry as numbers: where the base stands in the odometry frame."""

from typing import Any, NamedTuple

from are_ros.messages.common import read_time, read_vector


class OdometryNumbers(NamedTuple):
    """The fields of an Odometry that are used, unchecked.

    `pose` is x, y, z [m] and a quaternion x, y, z, w. The child frame may be empty.
    """

    frame_id: str
    child_frame_id: str
    stamp_ns: int
    pose: tuple[float, ...]


def read_odometry_numbers(message: Any) -> OdometryNumbers:
    """Return the numbers of a nav_msgs/Odometry, unchecked."""
    header, pose = message.header, message.pose.pose
    rotation = pose.orientation
    return OdometryNumbers(
        str(header.frame_id),
        str(message.child_frame_id),
        read_time(header.stamp),
        (*read_vector(pose.position), rotation.x, rotation.y, rotation.z, rotation.w),
    )
