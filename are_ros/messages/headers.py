"""std_msgs/Header: the frame and the stamp of a message."""

from typing import Any, NamedTuple

from are_ros.errors import InputError
from are_ros.messages.factory import MessageFactory
from are_ros.messages.times import make_time, read_time


class Header(NamedTuple):
    """Frame and stamp; the frame's name has no leading slash."""

    frame_id: str
    stamp_ns: int


def read_header(message: Any, source: str) -> Header:
    """Return the header of a stamped message.

    A leading slash of the frame, as ROS 1 wrote it, is dropped. InputError if there is no frame.
    """
    frame_id = str(message.header.frame_id).lstrip("/")
    if not frame_id:
        raise InputError(f"{source}: header.frame_id is empty")
    return Header(frame_id, read_time(message.header.stamp))


def make_header(factory: MessageFactory, frame_id: str, stamp_ns: int) -> Any:
    """Return a std_msgs/Header."""
    stamp = make_time(factory, stamp_ns)
    return factory.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)
