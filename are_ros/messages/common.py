"""What messages are made of: headers, times, arrays of numbers, vectors, poses; and a factory."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.errors import InputError, InvalidTransformError
from are_ros.world.rigid_transform import RigidTransform

# How messages are built: each adapter gives a factory for its own kind of message object.


class MessageFactory(Protocol):
    """Builds message objects of one middleware.

    `type_name` is the full name, as "nav_msgs/msg/OccupancyGrid". A field that is left out has its
    type's default. Arrays of numbers come as one-dimensional numpy arrays of the field's dtype,
    nested messages as what `make` returned, sequences of strings or messages as lists.
    """

    def make(self, type_name: str, /, **fields: Any) -> Any:
        """Return a new message object of the type with the fields given."""


# Times and durations of messages as integer nanoseconds.


def read_time(time: Any) -> int:
    """Return a builtin_interfaces/Time or Duration in nanoseconds."""
    return int(time.sec) * NS_PER_S + int(time.nanosec)


def make_time(factory: MessageFactory, time_ns: int) -> Any:
    """Return a builtin_interfaces/Time; its nanoseconds lie in [0, 1e9), before the epoch too."""
    seconds, nanoseconds = divmod(time_ns, NS_PER_S)
    return factory.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)


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


# The number arrays of messages as numpy arrays, without a copy where the dtype allows.


Scalar = TypeVar("Scalar", bound=np.generic)


def read_array(data: Any, dtype: type[Scalar]) -> npt.NDArray[Scalar]:
    """Return a field's numbers as an array (N,) of `dtype`.

    `data` is what a message object holds: a numpy array (rosbags), an `array.array` (rclpy), bytes
    or a sequence. The first three are viewed, not copied, where they are of that dtype already.
    """
    if isinstance(data, (bytes, bytearray, memoryview)):
        return np.frombuffer(data, dtype=np.uint8).view(dtype)
    return np.asarray(data, dtype=dtype)


# Points, rotations and velocities of geometry_msgs as plain numbers.


Vector3 = tuple[float, float, float]
Values = Sequence[float] | npt.NDArray[np.float64]


def read_vector(vector: Any) -> Vector3:
    """Return x, y, z of a Point or a Vector3, whatever they are."""
    return vector.x, vector.y, vector.z


def make_point(factory: MessageFactory, xyz_m: Values) -> Any:
    """Return a geometry_msgs/Point of three metres."""
    x, y, z = xyz_m
    return factory.make("geometry_msgs/msg/Point", x=float(x), y=float(y), z=float(z))


def make_vector(factory: MessageFactory, xyz: Values) -> Any:
    """Return a geometry_msgs/Vector3."""
    x, y, z = xyz
    return factory.make("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))


def make_quaternion(factory: MessageFactory, xyzw: Values) -> Any:
    """Return a geometry_msgs/Quaternion."""
    x, y, z, w = xyzw
    return factory.make(
        "geometry_msgs/msg/Quaternion", x=float(x), y=float(y), z=float(z), w=float(w)
    )


# geometry_msgs/Pose <-> rigid transforms.


def read_pose(pose: Any, field: str, source: str) -> RigidTransform:
    """Return a Pose as `parent_from_pose`; InputError if it is not finite or no rotation.

    `field` is its name in the message, `source` the topic: the error's sentence begins so.
    """
    at, rotation = pose.position, pose.orientation
    try:
        return RigidTransform.checked(
            (at.x, at.y, at.z), (rotation.x, rotation.y, rotation.z, rotation.w)
        )
    except InvalidTransformError as cause:
        message = f"{source}: {field}: {cause}"
        raise InputError(message) from cause


def make_pose(factory: MessageFactory, parent_from_pose: RigidTransform) -> Any:
    """Return a geometry_msgs/Pose."""
    return factory.make(
        "geometry_msgs/msg/Pose",
        position=make_point(factory, parent_from_pose.translation_m.tolist()),
        orientation=make_quaternion(factory, parent_from_pose.rotation_xyzw.tolist()),
    )
