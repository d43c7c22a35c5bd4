"""nav_msgs/Odometry <-> where the base stands in the odometry frame, and how it moves."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from are_ros.errors import InputError
from are_ros.messages.common import (
    MessageFactory,
    Vector3,
    make_header,
    make_pose,
    make_twist,
    read_pose,
    read_time,
    read_vector,
)
from are_ros.world.rigid_transform import RigidTransform


class OdometryNumbers(NamedTuple):
    """What of an Odometry is used, as it was sent: nothing is checked here.

    `pose` is x, y, z [m] and a quaternion x, y, z, w; `twist` linear [m/s] and angular velocity
    [rad/s], x, y, z each.
    """

    frame_id: str
    child_frame_id: str
    stamp_ns: int
    pose: tuple[float, ...]
    twist: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class OdometryReading:
    """One odometry message; the child frame is "" where the message leaves it out.

    The velocities are those of the child, in the child's frame.
    """

    frame_id: str
    child_frame_id: str
    stamp_ns: int
    frame_from_child: RigidTransform
    linear_velocity_m_s: Vector3
    angular_velocity_rad_s: Vector3


def read_odometry_numbers(message: Any) -> OdometryNumbers:
    """Return the numbers of a nav_msgs/Odometry, whatever they are."""
    header, pose, twist = message.header, message.pose.pose, message.twist.twist
    rotation = pose.orientation
    return OdometryNumbers(
        str(header.frame_id),
        str(message.child_frame_id),
        read_time(header.stamp),
        (*read_vector(pose.position), rotation.x, rotation.y, rotation.z, rotation.w),
        (*read_vector(twist.linear), *read_vector(twist.angular)),
    )


def read_odometry(message: Any, source: str = "odom") -> OdometryReading:
    """Return the reading of a nav_msgs/Odometry; InputError if a number is not finite."""
    numbers = read_odometry_numbers(message)
    frame_id, twist = numbers.frame_id.lstrip("/"), numbers.twist
    if not frame_id:
        raise InputError(f"{source}: header.frame_id is empty")
    if not math.isfinite(sum(twist)):
        raise InputError(f"{source}: twist.twist is not finite: {twist[:3]}, {twist[3:]}")
    return OdometryReading(
        frame_id,
        numbers.child_frame_id.lstrip("/"),
        numbers.stamp_ns,
        read_pose(message.pose.pose, "pose.pose", source),
        (twist[0], twist[1], twist[2]),
        (twist[3], twist[4], twist[5]),
    )


def make_odometry(factory: MessageFactory, reading: OdometryReading) -> Any:
    """Return a nav_msgs/Odometry, its covariances zero."""
    twist = make_twist(factory, reading.linear_velocity_m_s, reading.angular_velocity_rad_s)
    return factory.make(
        "nav_msgs/msg/Odometry",
        header=make_header(factory, reading.frame_id, reading.stamp_ns),
        child_frame_id=reading.child_frame_id,
        pose=factory.make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=make_pose(factory, reading.frame_from_child),
        ),
        twist=factory.make("geometry_msgs/msg/TwistWithCovariance", twist=twist),
    )
