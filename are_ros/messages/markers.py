"""Markers as the bytes of MarkerArrays: what looks the same is written once, then only posed.

The bytes are those that a serialiser makes of the messages; rclpy publishes them as they are, and a
recording takes them.
"""

from struct import Struct
from typing import Final, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from are_ros.builder.markers import NO_MARKERS, MarkerBatch, MarkerLook
from are_ros.messages.cdr import CdrWriter, encapsulated, pack_time

# Writing what changes of markers into the bytes of all of them, in machine code.


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

    Each look is encoded once. A batch of the same looks and ids as the one before costs no more
    than writing its poses and its stamp into the bytes of that one, and copying them. The
    constructor compiles the kernel that does it, or loads it from the cache.
    """

    def __init__(self) -> None:
        self._frame_id = ""
        self._blocks: WeakKeyDictionary[MarkerLook, _Block] = WeakKeyDictionary()
        self._template = _Template(NO_MARKERS, ())
        self._template.filled(0, NO_MARKERS.poses)

    def encode(self, frame_id: str, stamp_ns: int, batch: MarkerBatch) -> bytes:
        """Return a visualization_msgs/MarkerArray in a frame, the map's.

        InputError for a name or a text with the character NUL in it.
        """
        if frame_id != self._frame_id:
            self._frame_id, self._blocks = frame_id, WeakKeyDictionary()
            self._template = _Template(NO_MARKERS, ())
        if not self._template.fits(batch):
            blocks = tuple([self._blocks.get(look) or self._block(look) for look in batch.looks])
            self._template = _Template(batch, blocks)
        return self._template.filled(stamp_ns, batch.poses)

    def _block(self, look: MarkerLook) -> "_Block":
        heads = _head(self._frame_id, look, 0), _head(self._frame_id, look, 4)
        self._blocks[look] = _Block(heads, len(_named(self._frame_id, look, 0).part()), _tail(look))
        return self._blocks[look]


class _Block(NamedTuple):
    """A marker as bytes without stamp, id and pose, which are zero.

    The heads are those of markers that begin at a multiple of eight and 4 bytes behind one; both
    end at a multiple of eight, and the id is `id_at` bytes behind their beginning. The tail begins
    with the pose, and ends at a multiple of four.
    """

    heads: tuple[bytes, bytes]
    id_at: int
    tail: bytes


class _Template:
    """A message of given looks and ids, into which poses and stamps are written.

    The body begins at a multiple of eight in memory, as it does for its own alignment, so that
    poses are float64 in it and stamps int32.
    """

    def __init__(self, batch: MarkerBatch, blocks: tuple[_Block, ...]) -> None:
        self._looks, self._ids = batch.looks, batch.ids
        parts = [_BEFORE + encapsulated(_COUNT.pack(len(blocks)))]
        stamps_at, ids_at, poses_at = [], [], []
        at = _BODY + _COUNT.size
        for block in blocks:
            head, tail = block.heads[at // 4 % 2], block.tail
            stamps_at.append(at)
            ids_at.append(at + block.id_at)
            poses_at.append(at + len(head))
            at += len(head) + len(tail)
            parts += (head, tail)
        parts.append(bytes(-at % 8))
        whole = bytearray().join(parts)
        self._integers = np.frombuffer(whole, np.int32)
        self._integers[np.array(ids_at, dtype=np.int64) // 4] = batch.ids
        self._doubles = np.frombuffer(whole, np.float64)
        end = at - _PADDING if blocks else at
        self._message = np.frombuffer(whole, np.uint8)[len(_BEFORE) : end]
        self._stamps_at = np.array(stamps_at, dtype=np.int64) // 4
        self._poses_at = np.array(poses_at, dtype=np.int64) // 8

    def fits(self, batch: MarkerBatch) -> bool:
        """Return whether a batch has the same looks and ids."""
        return batch.looks == self._looks and np.array_equal(batch.ids, self._ids)

    def filled(self, stamp_ns: int, poses: npt.NDArray[np.float64]) -> bytes:
        """Return the message at a time, with poses (N, 7)."""
        seconds, nanoseconds = _STAMP.unpack(pack_time(stamp_ns))
        self._integers[self._stamps_at], self._integers[self._stamps_at + 1] = seconds, nanoseconds
        self._doubles[self._poses_at[:, None] + np.arange(7)] = poses
        return self._message.tobytes()


def _named(frame_id: str, look: MarkerLook, phase: int) -> CdrWriter:
    """Return what stands before a marker's id, without the stamp, for a marker of this phase."""
    writer = CdrWriter(phase)
    writer.header(frame_id, 0)
    writer.text(look.namespace)
    writer.align(4)
    return writer


def _head(frame_id: str, look: MarkerLook, phase: int) -> bytes:
    """Return what stands before the pose, without stamp and id, for a marker of this phase."""
    writer = _named(frame_id, look, phase)
    writer.pack(_INTEGERS, 4, 0, look.kind, look.action)
    writer.align(8)
    return writer.part()


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
