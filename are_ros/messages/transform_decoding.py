"""TFMessages from their bytes straight to values: recordings hold tens of thousands of them."""

from struct import Struct

from are_ros.messages.transforms import StampedTransform

_COUNT = Struct("<I")
_STAMP_AND_LENGTH = Struct("<iII")
_ROS1_HEADER = Struct("<IIII")
_POSE = Struct("<7d")

_CDR_LITTLE_ENDIAN = b"\x00\x01"


def is_plain_cdr(data: bytes) -> bool:
    """Tell whether these bytes begin as little-endian XCDR1, which is what ROS 2 writes."""
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
        stamp_ns = seconds * 1_000_000_000 + nanoseconds
        transforms.append(StampedTransform(parent, child, stamp_ns, numbers[:3], numbers[3:]))
    return transforms


def decode_transforms_ros1(data: bytes) -> list[StampedTransform]:
    """Return the transforms of a ROS 1 TFMessage (or tf/tfMessage); errors as the other."""
    (count,) = _COUNT.unpack_from(data, 0)
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
        stamp_ns = seconds * 1_000_000_000 + nanoseconds
        transforms.append(StampedTransform(parent, child, stamp_ns, numbers[:3], numbers[3:]))
    return transforms
