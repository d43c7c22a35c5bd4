"""Markers as the bytes of MarkerArrays: what looks the same is written once, then only posed.

The bytes are those that a serialiser makes of the messages; rclpy publishes them as they are, and a
recording takes them.
"""

from collections.abc import Sequence
from struct import Struct
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from are_ros.builder.markers import NO_MARKERS, MarkerBatch, MarkerLook
from are_ros.messages.cdr import CdrWriter, encapsulated, pack_time

_COUNT: Final = Struct("<I")
_STAMP: Final = Struct("<2i")
_INTEGERS: Final = Struct("<3i")
_COLOUR: Final = Struct("<4f")
_UNTURNED: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_BEFORE: Final = bytes(4)
_BODY: Final = 8
"""In memory the body of a message, behind four bytes of encapsulation, begins at 8."""

_PADDING: Final = 3
"""Each marker ends with a bool after a number of four bytes; the next begins at four again."""


class MarkerEncoder:
    """Encodes the batches of a marker display, in their order.

    What is large of a look, its mesh, is encoded once. A batch of the same looks and ids as the one
    before costs no more than writing its poses and its stamp into the bytes of that one, and
    copying them.
    """

    def __init__(self) -> None:
        self._tails: WeakKeyDictionary[MarkerLook, bytes] = WeakKeyDictionary()
        self._template = _Template("", NO_MARKERS, ())

    def encode(self, frame_id: str, stamp_ns: int, batch: MarkerBatch) -> bytes:
        """Return a visualization_msgs/MarkerArray in a frame, the map's.

        InputError for a name or a text with the character NUL in it.
        """
        if not self._template.fits(frame_id, batch):
            self._template = _Template(frame_id, batch, [self._tail(look) for look in batch.looks])
        return self._template.filled(stamp_ns, batch.poses)

    def _tail(self, look: MarkerLook) -> bytes:
        if look not in self._tails:
            self._tails[look] = _tail(look)
        return self._tails[look]


class _Template:
    """A message of given looks and ids, into which poses and stamps are written.

    The body begins at a multiple of eight in memory, as it does for its own alignment, so that
    poses are float64 in it and stamps int32. `tails` are the looks from the pose on.
    """

    def __init__(self, frame_id: str, batch: MarkerBatch, tails: Sequence[bytes]) -> None:
        self._frame_id, self._looks, self._ids = frame_id, batch.looks, batch.ids
        parts = [_BEFORE + encapsulated(_COUNT.pack(len(tails)))]
        stamps_at, ids_at, poses_at = [], [], []
        at = _BODY + _COUNT.size
        for look, tail in zip(batch.looks, tails, strict=True):
            writer = CdrWriter(at % 8)
            writer.header(frame_id, 0)
            writer.text(look.namespace)
            writer.align(4)
            stamps_at.append(at)
            ids_at.append(at + len(writer.part()))
            writer.pack(_INTEGERS, 4, 0, look.kind, look.action)
            writer.align(8)
            head = writer.part()
            poses_at.append(at + len(head))
            at += len(head) + len(tail)
            parts += (head, tail)
        parts.append(bytes(-at % 8))
        whole = bytearray().join(parts)
        self._integers = np.frombuffer(whole, np.int32)
        self._integers[np.array(ids_at, dtype=np.int64) // 4] = batch.ids
        self._doubles = np.frombuffer(whole, np.float64)
        end = at - _PADDING if tails else at
        self._message = np.frombuffer(whole, np.uint8)[len(_BEFORE) : end]
        self._stamps_at = np.array(stamps_at, dtype=np.int64) // 4
        self._poses_at = np.array(poses_at, dtype=np.int64) // 8

    def fits(self, frame_id: str, batch: MarkerBatch) -> bool:
        """Return whether a batch has the same frame, looks and ids."""
        is_same = frame_id == self._frame_id and batch.looks == self._looks
        return is_same and np.array_equal(batch.ids, self._ids)

    def filled(self, stamp_ns: int, poses: npt.NDArray[np.float64]) -> bytes:
        """Return the message at a time, with poses (N, 7)."""
        seconds, nanoseconds = _STAMP.unpack(pack_time(stamp_ns))
        self._integers[self._stamps_at], self._integers[self._stamps_at + 1] = seconds, nanoseconds
        self._doubles[self._poses_at[:, None] + np.arange(7)] = poses
        return self._message.tobytes()


def _tail(look: MarkerLook) -> bytes:
    """Return what stands from the pose on."""
    writer = CdrWriter()
    writer.doubles(*_UNTURNED, *look.scale)
    writer.pack(_COLOUR, 4, *look.colour)
    writer.time(look.lifetime_ns)
    writer.byte(False)  # it is not locked to its frame
    writer.numbers(look.points, "<f8")
    writer.numbers(look.colours, "<f4")
    writer.text("")  # no texture: its resource, an image, and its coordinates
    writer.header("", 0)
    writer.text("")
    writer.count(0)
    writer.count(0)
    writer.text(look.text)
    writer.text("")  # no mesh: its resource, a file's name and data, and its materials
    writer.text("")
    writer.count(0)
    writer.byte(False)
    writer.align(4)
    return writer.part()
