"""nav_msgs/Odometry <-> where the base stands in the odometry frame, and how it moves."""

import math
from dataclasses import dataclass
from typing import Any

from are_ros.errors import InputError
from are_ros.messages.factory import MessageFactory
from are_ros.messages.geometry import Vector3, make_twist, read_vector
from are_ros.messages.headers import make_header, read_header
from are_ros.messages.poses import make_pose, read_pose
from are_ros.world.rigid_transform import RigidTransform


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


def read_odometry(message: Any, source: str = "odom") -> OdometryReading:
    """Return the reading of a nav_msgs/Odometry; InputError if a number is not finite."""
    frame_id, stamp_ns = read_header(message, source)
    twist = message.twist.twist
    linear, angular = read_vector(twist.linear), read_vector(twist.angular)
    if not math.isfinite(sum(linear) + sum(angular)):
        raise InputError(f"{source}: twist.twist is not finite: {linear}, {angular}")
    return OdometryReading(
        frame_id,
        str(message.child_frame_id).lstrip("/"),
        stamp_ns,
        read_pose(message.pose.pose, "pose.pose", source),
        linear,
        angular,
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
