"""Times and durations of messages as integer nanoseconds."""

from typing import Any

from are_ros.conventions import NS_PER_S
from are_ros.messages.factory import MessageFactory


def read_time(time: Any) -> int:
    """Return a builtin_interfaces/Time or Duration in nanoseconds."""
    return int(time.sec) * NS_PER_S + int(time.nanosec)


def make_time(factory: MessageFactory, time_ns: int) -> Any:
    """Return a builtin_interfaces/Time; its nanoseconds lie in [0, 1e9), before the epoch too."""
    seconds, nanoseconds = divmod(time_ns, NS_PER_S)
    return factory.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
