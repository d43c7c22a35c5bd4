"""Convention values of nav_msgs/OccupancyGrid and of time, named once."""

from typing import Final

FREE: Final = 0
UNKNOWN: Final = -1
OCCUPIED: Final = 100

NS_PER_S: Final = 1_000_000_000
IDLE_NS: Final = 60 * NS_PER_S
"""After this time without inputs, sub-steps are skipped; events of the population go on."""
NEVER_NS: Final = -(2**63)
"""The time of what has not been yet: before any other."""


def seconds_to_ns(seconds: float) -> int:
    """Return a duration in seconds as the nearest integer nanosecond."""
    return round(seconds * NS_PER_S)
