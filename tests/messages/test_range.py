"""sensor_msgs/Range and back, and its bytes."""

from collections.abc import Callable
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from are_ros.builder.sensors.range_reading import RangeReading
from are_ros.messages.sensors import encode_range, read_range
from bags.simulation.making import RosbagsFactory, make_header

FLOATS = st.floats(width=32)
READINGS = st.builds(
    RangeReading,
    st.sampled_from(["", "s", "sonar", "Bühne"]),
    st.integers(-(10**18), 2 * 10**18),
    st.sampled_from([0, 1]),
    *[FLOATS] * 5,
)


def message(factory: RosbagsFactory, reading: RangeReading) -> Any:
    """Return the message object of a reading."""
    return factory.make(
        "sensor_msgs/msg/Range",
        header=make_header(factory, reading.frame_id, reading.stamp_ns),
        radiation_type=reading.radiation_type,
        field_of_view=reading.field_of_view_rad,
        min_range=reading.min_range_m,
        max_range=reading.max_range_m,
        range=reading.range_m,
        variance=reading.variance_m2,
    )


@given(reading=READINGS)
def test_the_bytes_are_those_of_the_message(
    on_the_wire: Callable[[Any], bytes], factory: RosbagsFactory, reading: RangeReading
) -> None:
    """Encoding directly and serialising the object give the same, NaN and infinity too."""
    assert encode_range(reading) == on_the_wire(message(factory, reading))


def test_what_is_read_is_what_was_sent(
    over_the_wire: Callable[[Any], Any], factory: RosbagsFactory
) -> None:
    """Each number comes back; a slash before the frame is dropped."""
    reading = RangeReading("sonar", 5_000_000_007, 1, 0.5, 0.25, 4.0, 1.5, 0.125)
    assert read_range(over_the_wire(message(factory, reading))) == reading


def test_rclpy_reads_it(both_readings: Callable[[bytes, str], tuple[Any, Any]]) -> None:
    """Field by field what rosbags reads."""
    reading = RangeReading("sonar", 7, 1, 0.5, 0.25, 4.0, 1.5, 0.125)
    by_rclpy, by_rosbags = both_readings(encode_range(reading), "sensor_msgs/msg/Range")
    assert by_rclpy == by_rosbags
    assert (by_rclpy["range"], by_rclpy["radiation_type"]) == ("1.5", "1.0")
