"""What a process of ROS needs before rclpy starts: its signals, and room for its messages."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from are_ros.errors import NodeError

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


class Stop:
    """Set by a signal, which does nothing else: raised exceptions would crash what is compiled."""

    def __init__(self) -> None:
        self.is_set = False

    def __call__(self, number: int, frame: Any) -> None:
        """Take a signal."""
        del number, frame
        self.is_set = True

    def should_stop(self) -> bool:
        """Tell whether a signal came."""
        return self.is_set


@contextmanager
def stop_on_signals(*, is_last: bool = True) -> Iterator[Stop]:
    """Give out what SIGINT and SIGTERM set while the block runs; for the main thread.

    Where the process ends after the block (`is_last`), later signals are ignored once one came.
    """
    stop = Stop()
    before = {number: signal.signal(number, stop) for number in _SIGNALS}
    try:
        yield stop
    finally:
        for number, previous in before.items():
            signal.signal(number, signal.SIG_IGN if is_last and stop.is_set else previous)


# How Fast DDS, the middleware of ROS 2 as it comes, carries the messages of a process.


PROFILE: Final = Path(__file__).parent / "data" / "fastdds.xml"
PROFILE_VARIABLE: Final = "FASTRTPS_DEFAULT_PROFILES_FILE"

_CHOICES: Final = (PROFILE_VARIABLE, "FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS")
_PROFILE_HERE: Final = Path("DEFAULT_FASTRTPS_PROFILES.xml")
_SHARED_MEMORY: Final = Path("/dev/shm")  # noqa: S108 - where Fast DDS has its segments
_ROOM_BYTES: Final = 48 << 20
"""For the segments of node, recorder and player, and as much again for others."""


def make_room() -> None:
    """Let this process send more at once than Fast DDS has room for, and repair losses soon.

    To be called before rclpy starts. What the user has chosen for Fast DDS stays, and so does its
    default where shared memory is short. Other middlewares do not look.
    """
    if _is_chosen() or not has_room():
        return
    os.environ[PROFILE_VARIABLE] = str(PROFILE)


def _is_chosen() -> bool:
    return any(os.environ.get(name) for name in _CHOICES) or _PROFILE_HERE.exists()


def has_room() -> bool:
    """Tell whether shared memory holds what the profile asks for."""
    try:
        free = os.statvfs(_SHARED_MEMORY)
    except OSError:
        return False
    return free.f_bavail * free.f_frsize >= _ROOM_BYTES


@contextmanager
def refusals_of_ros() -> Iterator[None]:
    """Make a NodeError of what ROS finds wrong, without the line of its own sources."""
    from rclpy.exceptions import ParameterException  # after the signals: rclpy takes long to import

    try:
        yield
    except (RuntimeError, ParameterException) as cause:
        reason = str(cause).partition(", at /")[0]
        raise NodeError(f"ROS does not start: {reason}") from cause
