"""What messages are made of: headers, times, arrays of numbers, vectors, poses."""

from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.errors import InputError, InvalidTransformError
from are_ros.world.rigid_transform import RigidTransform


def read_time(time: Any) -> int:
    """Return a builtin_interfaces/Time or Duration in nanoseconds."""
    return int(time.sec) * NS_PER_S + int(time.nanosec)


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


def read_vector(vector: Any) -> Vector3:
    """Return x, y, z of a Point or a Vector3, whatever they are."""
    return vector.x, vector.y, vector.z


def read_quaternion(rotation: Any) -> tuple[float, float, float, float]:
    """Return x, y, z, w of a Quaternion, whatever they are."""
    return rotation.x, rotation.y, rotation.z, rotation.w


def read_pose(pose: Any, field: str, source: str) -> RigidTransform:
    """Return a Pose as `parent_from_pose`; InputError if it is not finite or no rotation.

    `field` is its name in the message, `source` the topic: the error's sentence begins so.
    """
    try:
        return RigidTransform.checked(read_vector(pose.position), read_quaternion(pose.orientation))
    except InvalidTransformError as cause:
        message = f"{source}: {field}: {cause}"
        raise InputError(message) from cause
