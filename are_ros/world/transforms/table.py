"""The tables of a frame tree: frames by name and number, and each edge's samples in time order."""

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from are_ros.errors import UnknownFrameError
from are_ros.world.transforms.lookup import (
    DYNAMIC,
    FRAME_WIDTH,
    ROOT,
    SAMPLE_WIDTH,
    STAMP,
    STATIC,
    Integers,
    Pose,
)


class FrameNames:
    """Numbers the frames in the order in which they come; leading slashes do not count.

    `numbers` holds each spelling that was met, so that the usual case is one look at a dict.
    """

    def __init__(self) -> None:
        self.numbers: dict[str, int] = {}
        self._names: list[str] = []

    def __getitem__(self, number: int) -> str:
        return self._names[number]

    def __len__(self) -> int:
        return len(self._names)

    def __contains__(self, name: str) -> bool:
        return name.lstrip("/") in self.numbers

    def number_or_add(self, name: str) -> int:
        """Return a frame's number, a new one for a new name."""
        number = self.numbers.get(name)
        if number is not None:
            return number
        plain = name.lstrip("/")
        number = self.numbers.get(plain)
        if number is None:
            number = len(self._names)
            self._names.append(plain)
        self.numbers[name] = self.numbers[plain] = number
        return number

    def number(self, name: str) -> int:
        """Return a known frame's number, or raise UnknownFrameError."""
        number = self.numbers.get(name.lstrip("/"))
        if number is None:
            known = ", ".join(sorted(self._names)) or "none"
            raise UnknownFrameError(f"frame {name!r} was not seen so far; known frames: {known}")
        return number


_ROW: Final = struct.Struct("2q7d")
_FRAME: Final = struct.Struct("3q")
_FIRST_SIZE: Final = 64


class TransformSource(IntEnum):
    """Where a transform comes from; the higher one wins where two speak of the same edge.

    Odometry messages are below tf or, where the user prefers them, above it.
    """

    ODOMETRY = 0
    TF = 1
    PREFERRED_ODOMETRY = 2
    PARAMETER = 3

    @property
    def is_odometry(self) -> bool:
        """Whether odometry messages tell it."""
        return self in {TransformSource.ODOMETRY, TransformSource.PREFERRED_ODOMETRY}


@dataclass(slots=True)
class Edge:
    """One frame's edge to its parent: its segment of the table and what was last received.

    Rows [first, end) are in use, ascending in stamp; [begin, limit) is reserved. `parent` is that
    of the newest sample; older ones may have another.
    """

    child: int
    parent: int
    source: TransformSource
    is_static: bool
    begin: int
    limit: int
    first: int
    end: int
    newest_ns: int


class EdgeTable:
    """`samples` and `frames` as the kernels take them, and the edges by child frame."""

    def __init__(self, history_ns: int) -> None:
        self.history_ns = history_ns
        self.edges: dict[int, Edge] = {}
        self._adopt_frames(np.zeros((16, FRAME_WIDTH), np.int64))
        self._adopt(np.zeros((1024, SAMPLE_WIDTH), np.int64))
        self._used = 0

    def _adopt(self, samples: Integers) -> None:
        """Take a new array of rows; the memory views write to it far quicker than indexing."""
        self.samples = samples
        self._bytes = samples.data.cast("B")
        self._words = self._bytes.cast("q")

    def _adopt_frames(self, frames: Integers) -> None:
        self.frames = frames
        self._frame_bytes = frames.data.cast("B")

    def reserve_frame(self, frame: int) -> None:
        """Make room for a frame's number; a new one is a root."""
        if frame >= len(self.frames):
            self._adopt_frames(np.concatenate((self.frames, np.zeros_like(self.frames))))

    def stamp_of(self, row: int) -> int:
        """Return a row's stamp [ns]."""
        return self._words[row * SAMPLE_WIDTH + STAMP]

    def open(self, child: int, parent: int, source: TransformSource, *, is_static: bool) -> Edge:
        """Return a new, empty edge in place of the child's old one."""
        begin = self._reserve(1 if is_static else _FIRST_SIZE)
        limit = self._used
        edge = Edge(child, parent, source, is_static, begin, limit, begin, begin, newest_ns=-1)
        self.edges[child] = edge
        return edge

    def drop(self, child: int) -> None:
        """Make the child a root."""
        del self.edges[child]
        self.frames[child] = ROOT

    def _reserve(self, rows: int) -> int:
        """Return the beginning of so many fresh rows, after packing all edges anew if need be."""
        if self._used + rows > len(self.samples):
            self._repack(rows)
        begin, self._used = self._used, self._used + rows
        return begin

    def _repack(self, extra: int) -> None:
        """Copy what is in use to a new array, each edge with as much room again."""
        old, self._used = self.samples, 0
        sizes = [max(2 * (edge.end - edge.first), 1) for edge in self.edges.values()]
        samples = np.zeros((2 * (sum(sizes) + extra), SAMPLE_WIDTH), np.int64)
        for edge, size in zip(self.edges.values(), sizes, strict=True):
            count, begin = edge.end - edge.first, self._used
            samples[begin : begin + count] = old[edge.first : edge.end]
            edge.begin = edge.first = begin
            edge.end, edge.limit = begin + count, begin + size
            self._used += size
        self._adopt(samples)
        for edge in self.edges.values():
            self.publish(edge)

    def publish(self, edge: Edge) -> None:
        """Tell the kernels of the edge."""
        kind = STATIC if edge.is_static else DYNAMIC
        at = edge.child * _FRAME.size
        _FRAME.pack_into(self._frame_bytes, at, edge.first, edge.end, kind)

    def hold(self, edge: Edge, parent: int, pose: Pose) -> None:
        """Write the one sample of a static edge."""
        edge.parent, edge.end = parent, edge.begin + 1
        _ROW.pack_into(self._bytes, edge.begin * _ROW.size, 0, parent, *pose)
        self.publish(edge)

    def pose_of(self, row: int) -> Pose:
        """Return a row's seven numbers."""
        stored: Pose = _ROW.unpack_from(self._bytes, row * _ROW.size)[2:]
        return stored

    def append(self, edge: Edge, parent: int, stamp_ns: int, pose: Pose) -> None:
        """Write a sample newer than all others; what is older than the history falls off."""
        if edge.end == edge.limit:
            self._make_room(edge)
        row = edge.end
        _ROW.pack_into(self._bytes, row * _ROW.size, stamp_ns, parent, *pose)
        edge.end, edge.newest_ns = row + 1, stamp_ns
        words, first, oldest_kept = self._words, edge.first, stamp_ns - self.history_ns
        while words[first * SAMPLE_WIDTH] < oldest_kept:
            first += 1
        edge.first, edge.parent = first, parent
        self.publish(edge)

    def insert(self, edge: Edge, parent: int, stamp_ns: int, pose: Pose) -> bool:
        """Write a sample not newer than all others; False if it is older than the history.

        At a stamp that is taken the first sample stays, unless the newcomer names another parent.
        """
        if stamp_ns < edge.newest_ns - self.history_ns:
            return False
        stamps = self.samples[edge.first : edge.end, STAMP]
        at = edge.first + int(np.searchsorted(stamps, stamp_ns))
        if self.stamp_of(at) != stamp_ns:
            at = self._open_gap(edge, at)
        elif self.samples[at, 1] == parent:
            return True
        _ROW.pack_into(self._bytes, at * _ROW.size, stamp_ns, parent, *pose)
        if at == edge.end - 1:
            edge.parent = parent
        self.publish(edge)
        return True

    def _open_gap(self, edge: Edge, at: int) -> int:
        """Shift the rows from `at` on by one; return where the gap is now."""
        offset = at - edge.first
        if edge.end == edge.limit:
            self._make_room(edge)
        at = edge.first + offset
        self.samples[at + 1 : edge.end + 1] = self.samples[at : edge.end].copy()
        edge.end += 1
        return at

    def _make_room(self, edge: Edge) -> None:
        """Slide the rows down where half the segment is free, else move them to a larger one."""
        count, begin = edge.end - edge.first, edge.begin
        if edge.first - begin < count:
            size = 2 * (edge.limit - begin)
            begin = self._reserve(size)
            edge.begin, edge.limit = begin, begin + size
        self.samples[begin : begin + count] = self.samples[edge.first : edge.end].copy()
        edge.first, edge.end = begin, begin + count

    def forget_after(self, now_ns: int, edges: Iterable[Edge] | None = None) -> None:
        """Drop the samples stamped after `now_ns` of dynamic edges (all); an emptied one goes."""
        for edge in tuple(self.edges.values() if edges is None else edges):
            if edge.is_static:
                continue
            stamps = self.samples[edge.first : edge.end, STAMP]
            edge.end = edge.first + int(np.searchsorted(stamps, now_ns, side="right"))
            if edge.end == edge.first:
                self.drop(edge.child)
                continue
            edge.newest_ns = self.stamp_of(edge.end - 1)
            edge.parent = int(self.samples[edge.end - 1, 1])
            self.publish(edge)
