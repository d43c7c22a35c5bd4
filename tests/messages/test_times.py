"""Times of messages as nanoseconds."""

import pytest

from are_ros.messages.common import read_time
from bags.simulation.making import RosbagsFactory, make_time


@pytest.mark.parametrize("time_ns", [0, 1, 999_999_999, 1_000_000_000, 1_411_663_034_997_264_120])
def test_times_come_back(factory: RosbagsFactory, time_ns: int) -> None:
    """Making and reading a time are inverse."""
    assert read_time(make_time(factory, time_ns)) == time_ns


def test_nanoseconds_are_never_negative(factory: RosbagsFactory) -> None:
    """Before the epoch the seconds are negative and the nanoseconds are not."""
    time = make_time(factory, -1)
    assert (time.sec, time.nanosec) == (-1, 999_999_999)
    assert read_time(time) == -1
