"""tf2_msgs/TFMessage <-> stamped transforms between named frames, by objects and by bytes."""

from collections.abc import Sequence
from struct import Struct
from struct import error as StructError  # noqa: N812
from typing import Any, NamedTuple

from are_ros.conventions import NS_PER_S
from are_ros.messages.cdr import CdrWriter
from are_ros.messages.common import read_quaternion, read_time, read_vector


class StampedTransform(NamedTuple):
    """One edge of the frame tree at one stamp: `parent_from_child`, with names as they came.

    Metres and a quaternion; nothing is checked here, the frame tree does that.
    """

    parent: str
    child: str
    stamp_ns: int
    translation_m: tuple[float, float, float]
    rotation_xyzw: tuple[float, float, float, float]


def read_transforms(message: Any) -> list[StampedTransform]:
    """Return the transforms of a TFMessage in their order."""
    return [
        StampedTransform(
            stamped.header.frame_id,
            stamped.child_frame_id,
            read_time(stamped.header.stamp),
            read_vector(stamped.transform.translation),
            read_quaternion(stamped.transform.rotation),
        )
        for stamped in message.transforms
    ]


# TFMessages and their bytes, without message objects: recordings hold tens of thousands of them.

_COUNT = Struct("<I")
_STAMP_AND_LENGTH = Struct("<iII")
_POSE = Struct("<7d")

_CDR_LITTLE_ENDIAN = b"\x00\x01"


def is_plain_cdr(data: bytes) -> bool:
    """Return whether these bytes are little-endian XCDR1, which ROS 2 writes."""
    return data[:2] == _CDR_LITTLE_ENDIAN


def decode_transforms_cdr(data: bytes) -> list[StampedTransform]:
    """Return the transforms of a ROS 2 TFMessage in little-endian XCDR1.

    struct.error or UnicodeDecodeError if the bytes end too early or hold no such message.
    """
    (count,) = _COUNT.unpack_from(data, 4)
    position = 8
    transforms: list[StampedTransform] = []
    for _ in range(count):
        position = (position + 3) & ~3
        seconds, nanoseconds, length = _STAMP_AND_LENGTH.unpack_from(data, position)
        position += 12
        parent = data[position : position + length - 1].decode()
        position = (position + length + 3) & ~3
        (length,) = _COUNT.unpack_from(data, position)
        position += 4
        child = data[position : position + length - 1].decode()
        # Doubles are aligned to 8 bytes from the end of the 4-byte encapsulation header.
        position = ((position + length + 3) & ~7) + 4
        numbers = _POSE.unpack_from(data, position)
        position += 56
        stamp_ns = seconds * NS_PER_S + nanoseconds
        transforms.append(StampedTransform(parent, child, stamp_ns, numbers[:3], numbers[3:]))
    return transforms


ROS1_DIGEST = "94810edda583a504dfda3829e70d7eec"
"""The MD5 sum by which ROS 1 knows the definition of tf2_msgs/TFMessage, and of tf/tfMessage."""

_ROS1_HEADER = Struct("<IIII")


def decode_transforms_ros1(data: bytes) -> list[StampedTransform]:
    """Return the transforms of a ROS 1 TFMessage.

    struct.error or UnicodeDecodeError if the bytes are too few or too many, or no such message.
    """
    (count,) = _COUNT.unpack_from(data)
    position = 4
    transforms: list[StampedTransform] = []
    for _ in range(count):
        _, seconds, nanoseconds, length = _ROS1_HEADER.unpack_from(data, position)
        position += 16
        parent = data[position : position + length].decode()
        position += length
        (length,) = _COUNT.unpack_from(data, position)
        position += 4
        child = data[position : position + length].decode()
        position += length
        numbers = _POSE.unpack_from(data, position)
        position += 56
        stamp_ns = seconds * NS_PER_S + nanoseconds
        transforms.append(StampedTransform(parent, child, stamp_ns, numbers[:3], numbers[3:]))
    if position != len(data):
        raise StructError(f"{len(data) - position} bytes follow the message")
    return transforms


def encode_transforms_cdr(transforms: Sequence[StampedTransform]) -> bytes:
    """Return a ROS 2 TFMessage; struct.error for a stamp out of range, InputError for a NUL."""
    writer = CdrWriter()
    writer.count(len(transforms))
    for parent, child, stamp_ns, place, turn in transforms:
        writer.header(parent, stamp_ns)
        writer.text(child)
        writer.doubles(*place, *turn)
    return writer.message()


class OdometryNumbers(NamedTuple):
    """The fields of an Odometry that are used, unchecked.

    `pose` is x, y, z [m] and a quaternion x, y, z, w. The child frame may be empty.
    """

    frame_id: str
    child_frame_id: str
    stamp_ns: int
    pose: tuple[float, ...]


def read_odometry_numbers(message: Any) -> OdometryNumbers:
    """Return the numbers of a nav_msgs/Odometry, unchecked."""
    pose = message.pose.pose
    return OdometryNumbers(
        str(message.header.frame_id),
        str(message.child_frame_id),
        read_time(message.header.stamp),
        (*read_vector(pose.position), *read_quaternion(pose.orientation)),
    )
