"""Laser scans as bytes."""

from struct import Struct
from typing import Final

from are_ros.messages.cdr import CdrWriter
from are_ros.world.laser_scan import LaserScan

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
