"""sensor_msgs/LaserScan <-> the core's scan."""

from struct import Struct
from typing import Any, Final

import numpy as np

from are_ros.messages.cdr import CdrWriter
from are_ros.messages.common import MessageFactory, make_header, read_array, read_time
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


# Laser scans as bytes.


_NUMBERS: Final = Struct("<7f")


def encode_scan(scan: LaserScan) -> bytes:
    """Return a sensor_msgs/LaserScan."""
    writer = CdrWriter()
    writer.header(scan.frame_id, scan.stamp_ns)
    writer.pack(
        _NUMBERS,
        4,
        scan.angle_min_rad,
        scan.angle_max_rad,
        scan.angle_increment_rad,
        scan.time_increment_s,
        scan.scan_time_s,
        scan.range_min_m,
        scan.range_max_m,
    )
    writer.numbers(scan.ranges, "<f4")
    writer.numbers(scan.intensities, "<f4")
    return writer.message()
