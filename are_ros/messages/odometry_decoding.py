"""Odometry from its bytes straight to numbers: recordings hold thousands, mostly covariances."""

from struct import Struct
from struct import error as StructError  # noqa: N812

from are_ros.messages.odometry import OdometryNumbers

_LENGTH = Struct("<I")
_STAMP = Struct("<iII")
_ROS1_HEADER = Struct("<IIII")
_POSE = Struct("<7d")
_TWIST = Struct("<6d")
_COVARIANCE_BYTES = 36 * 8


def decode_odometry_cdr(data: bytes) -> OdometryNumbers:
    """Return the numbers of a ROS 2 Odometry in little-endian XCDR1.

    struct.error or UnicodeDecodeError if the bytes end too early or hold no such message.
    """
    seconds, nanoseconds, length = _STAMP.unpack_from(data, 4)
    frame_id = data[16 : 16 + length - 1].decode()
    position = (16 + length + 3) & ~3
    (length,) = _LENGTH.unpack_from(data, position)
    position += 4
    child_frame_id = data[position : position + length - 1].decode()
    # Doubles are aligned to 8 bytes from the end of the 4-byte encapsulation header.
    position = ((position + length + 3) & ~7) + 4
    return _with_numbers(frame_id, child_frame_id, seconds, nanoseconds, data, position)


def decode_odometry_ros1(data: bytes) -> OdometryNumbers:
    """Return the numbers of a ROS 1 Odometry; errors as the other."""
    _, seconds, nanoseconds, length = _ROS1_HEADER.unpack_from(data, 0)
    frame_id = data[16 : 16 + length].decode()
    position = 16 + length
    (length,) = _LENGTH.unpack_from(data, position)
    position += 4
    child_frame_id = data[position : position + length].decode()
    position += length
    return _with_numbers(frame_id, child_frame_id, seconds, nanoseconds, data, position)


def _with_numbers(
    frame_id: str, child_frame_id: str, seconds: int, nanoseconds: int, data: bytes, position: int
) -> OdometryNumbers:
    pose = _POSE.unpack_from(data, position)
    twist_at = position + _POSE.size + _COVARIANCE_BYTES
    twist = _TWIST.unpack_from(data, twist_at)
    if len(data) < twist_at + _TWIST.size + _COVARIANCE_BYTES:
        raise StructError("the covariance of the twist is cut off")
    return OdometryNumbers(
        frame_id, child_frame_id, seconds * 1_000_000_000 + nanoseconds, pose, twist
    )
