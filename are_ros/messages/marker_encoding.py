"""Markers straight to the bytes of a MarkerArray: no object per point, colour or corner.

The bytes are those that a serialiser makes of `markers.make_markers`; rclpy publishes them as they
are, and a recording takes them.
"""

from collections.abc import Iterable
from struct import Struct
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.markers import Marker
from are_ros.conventions import NS_PER_S
from are_ros.errors import InputError

_ENCAPSULATION: Final = b"\x00\x01\x00\x00"
_STAMP: Final = Struct("<iI")
_INTEGERS: Final = Struct("<3i")
_POSE_AND_SCALE: Final = Struct("<10d")
_COLOUR_LIFETIME: Final = Struct("<4fiI?")
_COUNT: Final = Struct("<I")
_NUL: Final = b"\0"
_NO_TEXT: Final = b"\1\0\0\0\0\0\0\0"
"""An empty string, padded to four bytes."""

_NO_TEXTURE: Final = _NO_TEXT + bytes(8) + 2 * _NO_TEXT + bytes(8)
"""Resource, image (stamp, frame, format, data) and coordinates of a texture, all empty."""


def encode_markers(frame_id: str, stamp_ns: int, markers: Iterable[Marker]) -> bytes:
    """Return a visualization_msgs/MarkerArray in little-endian XCDR1, with its encapsulation.

    InputError for a name or a text with the character NUL in it.
    """
    body = bytearray(4)
    header = bytearray(_STAMP.pack(*divmod(stamp_ns, NS_PER_S)))
    _append_string(header, frame_id)
    count = 0
    for marker in markers:
        _append_marker(body, bytes(header), marker)
        count += 1
    _COUNT.pack_into(body, 0, count)
    return _ENCAPSULATION + bytes(body)


def _append_marker(body: bytearray, header: bytes, marker: Marker) -> None:
    pose = marker.map_from_marker
    _align(body, 4)
    body += header
    _append_string(body, marker.namespace)
    _align(body, 4)
    body += _INTEGERS.pack(marker.marker_id, marker.kind, marker.action)
    _align(body, 8)
    place, turn = pose.translation_m.tolist(), pose.rotation_xyzw.tolist()
    body += _POSE_AND_SCALE.pack(*place, *turn, *marker.scale)
    lifetime = divmod(marker.lifetime_ns, NS_PER_S)
    body += _COLOUR_LIFETIME.pack(*marker.colour, *lifetime, False)
    _append_numbers(body, marker.points, "<f8", 8)
    _append_numbers(body, marker.colours, "<f4", 4)
    _align(body, 4)
    body += _NO_TEXTURE
    for text in (marker.text, "", ""):
        _append_string(body, text)
    _align(body, 4)
    body += _COUNT.pack(0) + _NUL


def _append_numbers(
    body: bytearray, rows: npt.NDArray[np.floating], dtype: str, alignment: int
) -> None:
    """Append a sequence of points (N, 3) or colours (N, 4)."""
    _align(body, 4)
    body += _COUNT.pack(len(rows))
    if len(rows):
        _align(body, alignment)
        body += rows.astype(dtype).tobytes()


def _append_string(body: bytearray, text: str) -> None:
    if "\0" in text:
        raise InputError(f"a message's text cannot hold the character NUL: {text!r}")
    data = text.encode() + _NUL
    _align(body, 4)
    body += _COUNT.pack(len(data)) + data


def _align(body: bytearray, alignment: int) -> None:
    body += bytes(-len(body) % alignment)
