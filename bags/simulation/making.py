"""Messages of a robot, made by the factory of either middleware: for recordings and tests."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.messages.common import (
    Header,
    MessageFactory,
    Values,
    Vector3,
    make_header,
    make_point,
    make_pose,
    make_vector,
)
from are_ros.messages.goals import StampedPoints
from are_ros.world.cameras import CameraInfo
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


def make_camera_info(factory: MessageFactory, header: Header, info: CameraInfo) -> Any:
    """Return a sensor_msgs/CameraInfo of ROS 2."""
    x, y, width, height = info.roi
    return factory.make(
        "sensor_msgs/msg/CameraInfo",
        header=make_header(factory, header.frame_id, header.stamp_ns),
        width=info.width,
        height=info.height,
        distortion_model=info.distortion_model,
        d=np.array(info.d, dtype=np.float64),
        k=np.array(info.k, dtype=np.float64),
        r=np.array(info.r, dtype=np.float64),
        p=np.array(info.p, dtype=np.float64),
        binning_x=info.binning_x,
        binning_y=info.binning_y,
        roi=factory.make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=x, y_offset=y, width=width, height=height
        ),
    )


def make_path(factory: MessageFactory, path: StampedPoints) -> Any:
    """Return a nav_msgs/Path through the points, its poses unturned."""
    header = make_header(factory, path.frame_id, path.stamp_ns)
    unturned = np.array((0.0, 0.0, 0.0, 1.0))
    poses = [
        factory.make(
            "geometry_msgs/msg/PoseStamped",
            header=header,
            pose=make_pose(factory, RigidTransform(point.copy(), unturned)),
        )
        for point in path.points_m
    ]
    return factory.make("nav_msgs/msg/Path", header=header, poses=poses)


def make_clicked_point(factory: MessageFactory, point: StampedPoints) -> Any:
    """Return the geometry_msgs/PointStamped of the first point."""
    return factory.make(
        "geometry_msgs/msg/PointStamped",
        header=make_header(factory, point.frame_id, point.stamp_ns),
        point=make_point(factory, point.points_m[0]),
    )


def make_scan(factory: MessageFactory, scan: LaserScan) -> Any:
    """Return the sensor_msgs/LaserScan of a scan; its arrays are views."""
    return factory.make(
        "sensor_msgs/msg/LaserScan",
        header=make_header(factory, scan.frame_id, scan.stamp_ns),
        angle_min=scan.angle_min_rad,
        angle_max=scan.angle_max_rad,
        angle_increment=scan.angle_increment_rad,
        time_increment=scan.time_increment_s,
        scan_time=scan.scan_time_s,
        range_min=scan.range_min_m,
        range_max=scan.range_max_m,
        ranges=scan.ranges,
        intensities=scan.intensities,
    )


def make_twist(factory: MessageFactory, linear_m_s: Values, angular_rad_s: Values) -> Any:
    """Return a geometry_msgs/Twist."""
    return factory.make(
        "geometry_msgs/msg/Twist",
        linear=make_vector(factory, linear_m_s),
        angular=make_vector(factory, angular_rad_s),
    )
