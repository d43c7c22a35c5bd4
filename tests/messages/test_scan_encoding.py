"""Laser scans as bytes."""

from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.messages.sensors import encode_scan
from bags.simulation.making import RosbagsFactory, make_scan

FLOATS = st.floats(width=32)
RANGES = st.lists(FLOATS, max_size=5).map(lambda values: np.array(values, np.float32))
SCANS = st.builds(
    LaserScan,
    st.sampled_from(["", "l", "laser", "Bühne"]),
    st.integers(-(10**18), 2 * 10**18),
    *[FLOATS] * 7,
    RANGES,
    RANGES,
)


@given(scan=SCANS)
def test_the_bytes_are_those_of_the_message(
    on_the_wire: Callable[[Any], bytes], factory: RosbagsFactory, scan: LaserScan
) -> None:
    """Encoding directly and serialising the object give the same, NaN and infinity too."""
    assert encode_scan(scan) == on_the_wire(make_scan(factory, scan))


def test_rclpy_reads_it(both_readings: Callable[[bytes, str], tuple[Any, Any]]) -> None:
    """Field by field what rosbags reads."""
    ranges = np.array([1.0, np.nan, np.inf], np.float32)
    scan = LaserScan("laser", 7, -0.5, 0.5, 0.5, 0.1, 0.2, 0.3, 9.0, ranges, ranges[:0])
    by_rclpy, by_rosbags = both_readings(encode_scan(scan), "sensor_msgs/msg/LaserScan")
    assert by_rclpy == by_rosbags
    assert by_rclpy["ranges"] == ["1.0", "nan", "inf"]
