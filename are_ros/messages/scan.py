"""sensor_msgs/LaserScan <-> the core's scan."""

from typing import Any

import numpy as np

from are_ros.messages.arrays import read_array
from are_ros.messages.factory import MessageFactory
from are_ros.messages.headers import make_header
from are_ros.messages.times import read_time
from are_ros.world.laser_scan import LaserScan


def read_scan(message: Any, source: str = "scan") -> LaserScan:
    """Return the scan of a message; ranges and intensities are views of its data.

    InputError, whose sentence begins with `source`, as `LaserScan.checked`.
    """
    return LaserScan(
        frame_id=str(message.header.frame_id).lstrip("/"),
        stamp_ns=read_time(message.header.stamp),
        angle_min_rad=float(message.angle_min),
        angle_max_rad=float(message.angle_max),
        angle_increment_rad=float(message.angle_increment),
        time_increment_s=float(message.time_increment),
        scan_time_s=float(message.scan_time),
        range_min_m=float(message.range_min),
        range_max_m=float(message.range_max),
        ranges=read_array(message.ranges, np.float32),
        intensities=read_array(message.intensities, np.float32),
    ).checked(source)


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
