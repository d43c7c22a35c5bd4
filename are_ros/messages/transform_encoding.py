"""TFMessages from values straight to their bytes: recordings hold tens of thousands of them."""

from collections.abc import Sequence
from struct import Struct

from are_ros.conventions import NS_PER_S
from are_ros.messages.transforms import StampedTransform

_COUNT = Struct("<I")
_STAMP = Struct("<iI")
_POSE = Struct("<7d")
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"


def encode_transforms_cdr(transforms: Sequence[StampedTransform]) -> bytes:
    """Return a ROS 2 TFMessage in little-endian XCDR1; struct.error for a stamp out of range."""
    data = bytearray(_COUNT.pack(len(transforms)))
    for parent, child, stamp_ns, place, turn in transforms:
        _align(data, 4)
        data += _STAMP.pack(*divmod(stamp_ns, NS_PER_S))
        _append_text(data, parent)
        _align(data, 4)
        _append_text(data, child)
        _align(data, 8)
        data += _POSE.pack(*place, *turn)
    return _LITTLE_ENDIAN + bytes(data)


def _append_text(data: bytearray, text: str) -> None:
    encoded = text.encode()
    data += _COUNT.pack(len(encoded) + 1) + encoded + b"\0"


def _align(data: bytearray, size: int) -> None:
    """Pad to a multiple of a size, counted from the end of the encapsulation header."""
    data += bytes(-len(data) % size)
