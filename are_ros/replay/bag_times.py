"""When the messages of a recording were stamped, and when they were recorded, source by source.

One pass over the messages that move (transforms, odometry, scans, CameraInfo) tells what a replay
has to know before it begins: whether stamps and times of recording go by one clock, where the
recording has gaps, and how long scans have to wait for their transforms.
"""

from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from struct import Struct
from struct import error as StructError  # noqa: N812
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.errors import AreError, InputError
from are_ros.replay.bag_reader import BagMessage, BagReader

MOVING_ROLES = ("tf", "odom", "scan", "camera/camera_info")
"""The roles whose messages come all the time while a robot is recorded."""

BASE_FRAMES = ("base_footprint", "base_link")
"""The usual names of the robot's base, the preferred one first."""

Ints = npt.NDArray[np.int64]
Edge = tuple[str, str]

_NONE = np.empty(0, np.int64)
_FEWEST_STAMPS = 5
"""A source of fewer stamps tells no clock, unless there is no better one."""

_CLOCK = "/clock"
_CLOCK_SAMPLES = 50
_CLOCK_AGREES_NS = NS_PER_S // 5
_STAMP_AT = 4
"""Where the stamp of a message with a header lies, in CDR and in ROS 1 alike."""
_STAMP = {True: Struct("<iI"), False: Struct(">iI")}


@dataclass(frozen=True, eq=False)
class Times:
    """What a source stamped: times of recording and stamps, int64 (N,) [ns], in order of the log.

    `name` is how a sentence calls the source. `is_edge`: it is an edge of the transforms, which
    may be dated ahead on purpose, so that it can be used until the next one comes. `is_clock`:
    it is /clock.
    """

    name: str
    log_ns: Ints
    stamps_ns: Ints
    is_edge: bool = False
    is_clock: bool = False


@dataclass(frozen=True, eq=False)
class RecordedTimes:
    """The times of one window of a recording that begins at `bag_start_ns`.

    `sources` are those that tell a clock, the most telling first: /clock (only where it disagrees
    with the times of recording), odometry, edges that move, scans. A fixed joint tells none: it is
    often dated far ahead. `edges` are all edges
    (parent, child) of odometry and /tf, `static_edges` those of /tf_static. `scans` are the topics
    of the scans, by name, and `scan_frames` their frames. `moving_log_ns`, int64 (N,) ascending,
    are the times of recording of all messages that move.
    """

    bag_start_ns: int
    sources: tuple[Times, ...]
    edges: Mapping[Edge, Times]
    static_edges: frozenset[Edge]
    scans: Mapping[str, Times]
    scan_frames: Mapping[str, str]
    moving_log_ns: Ints

    @classmethod
    def read(
        cls,
        reader: BagReader,
        role_of_topic: Mapping[str, str],
        start_ns: int,
        stop_ns: int,
    ) -> "RecordedTimes":
        """Read the window [start_ns, stop_ns) of the log; what is malformed is left out.

        BagError where the recording is damaged.
        """
        moving = {t: role for t, role in role_of_topic.items() if role in MOVING_ROLES}
        logs: dict[str, array[int]] = {topic: array("q") for topic in moving}
        stamps: dict[str, array[int]] = {topic: array("q") for topic in moving}
        transforms = _Transforms()
        messages = reader.messages(list(moving), start_ns, stop_ns) if moving else ()
        for message in messages:
            logs[message.topic].append(message.log_time_ns)
            if moving[message.topic] == "tf":
                transforms.take(reader, message)
            else:
                stamps[message.topic].append(_stamp_ns(message, is_ros1=reader.is_ros1))

        def topics(wanted: str) -> dict[str, Times]:
            names = (topic for topic, role in moving.items() if role == wanted)
            return {name: _times(name, logs[name], stamps[name]) for name in names}

        odometry, scans, edges = topics("odom"), topics("scan"), transforms.edges()
        moved = [times for edge, times in edges.items() if edge in transforms.moving]
        found = [*odometry.values(), *moved, *scans.values()] or list(edges.values())
        for name, times in odometry.items():
            if (edge := _odometry_edge(reader, name, edges)) is not None:
                edges.setdefault(edge, times)
        return cls(
            bag_start_ns=reader.start_ns,
            sources=(*_clock(reader, start_ns, stop_ns), *_telling(found)),
            edges=edges,
            static_edges=frozenset(_static_edges(reader, role_of_topic, stop_ns)),
            scans=scans,
            scan_frames={topic: _frame_of(reader, topic) for topic in scans},
            moving_log_ns=np.sort(np.concatenate([_ints(log) for log in logs.values()] or [_NONE])),
        )


class _Transforms:
    """The times of each edge of /tf, and the edges (`moving`) whose pose ever changed."""

    def __init__(self) -> None:
        self.moving: set[Edge] = set()
        self._edge_of: dict[Edge, Edge] = {}
        self._times: dict[Edge, tuple[array[int], array[int]]] = {}
        self._first: dict[Edge, Any] = {}

    def take(self, reader: BagReader, message: BagMessage) -> None:
        """Take the transforms of a message."""
        try:
            transforms = reader.transforms(message)
        except InputError:
            return
        for parent, child, stamp_ns, *pose in transforms:
            edge = self._edge_of.get((parent, child))
            if edge is None:
                edge = parent.lstrip("/"), child.lstrip("/")
                self._edge_of[parent, child] = edge
                self._times.setdefault(edge, (array("q"), array("q")))
                self._first.setdefault(edge, pose)
            log, stamps = self._times[edge]
            log.append(message.log_time_ns)
            stamps.append(stamp_ns)
            if edge not in self.moving and pose != self._first[edge]:
                self.moving.add(edge)

    def edges(self) -> dict[Edge, Times]:
        """Return the times of each edge; the names have no leading slash."""
        return {
            edge: _times(f"{edge[0]} -> {edge[1]}", *times, is_edge=True)
            for edge, times in self._times.items()
        }


def _times(name: str, log: "array[int]", stamps: "array[int]", *, is_edge: bool = False) -> Times:
    return Times(name, _ints(log), _ints(stamps), is_edge)


def _ints(values: "array[int]") -> Ints:
    return np.array(values, dtype=np.int64)


def _telling(found: Sequence[Times]) -> list[Times]:
    """Return the sources without the messages that have no stamp, and without rare sources."""
    stamped = []
    for one in found:
        has_stamp = one.stamps_ns > 0
        stamped.append(
            Times(one.name, one.log_ns[has_stamp], one.stamps_ns[has_stamp], one.is_edge)
        )
    frequent = [one for one in stamped if len(one.log_ns) >= _FEWEST_STAMPS]
    return frequent or [one for one in stamped if len(one.log_ns)]


def _stamp_ns(message: BagMessage, *, is_ros1: bool, at: int = _STAMP_AT) -> int:
    """Return the stamp in the bytes of a message, 0 where they are too short."""
    data = message.data
    try:
        seconds, nanoseconds = _STAMP[is_ros1 or bool(data[1] & 1)].unpack_from(data, at)
    except (StructError, IndexError):
        return 0
    return int(seconds) * NS_PER_S + int(nanoseconds)


def _clock(reader: BagReader, start_ns: int, stop_ns: int) -> list[Times]:
    """Return the times of /clock where it was recorded and is not that of the log."""
    if not any(topic.name == _CLOCK and topic.count for topic in reader.topics):
        return []
    at = 0 if reader.is_ros1 else _STAMP_AT

    def instants() -> Iterable[tuple[int, int]]:
        for message in reader.messages((_CLOCK,), start_ns, stop_ns):
            stamp_ns = _stamp_ns(message, is_ros1=reader.is_ros1, at=at)
            yield message.log_time_ns, stamp_ns

    first = [stamp_ns - log_ns for log_ns, stamp_ns in islice(instants(), _CLOCK_SAMPLES)]
    if not first or abs(float(np.median(first))) < _CLOCK_AGREES_NS:
        return []
    log_ns, stamps_ns = np.array(list(instants()), dtype=np.int64).T
    return [Times(_CLOCK, log_ns, stamps_ns, is_clock=True)]


def _odometry_edge(reader: BagReader, topic: str, known: Iterable[Edge]) -> Edge | None:
    """Return (frame, child frame) of the odometry; an empty child means the base."""
    first = next(reader.messages((topic,)), None)
    try:
        numbers = None if first is None else reader.odometry(first)
    except AreError:
        return None
    if numbers is None or not numbers.frame_id:
        return None
    frames = {frame for edge in known for frame in edge}
    base = next((name for name in BASE_FRAMES if name in frames), BASE_FRAMES[0])
    return numbers.frame_id.lstrip("/"), numbers.child_frame_id.lstrip("/") or base


def _static_edges(
    reader: BagReader, role_of_topic: Mapping[str, str], stop_ns: int
) -> Iterable[Edge]:
    topics = [topic for topic, role in role_of_topic.items() if role == "tf_static"]
    for message in reader.messages(topics, stop_ns=stop_ns) if topics else ():
        try:
            transforms = reader.transforms(message)
        except InputError:
            continue
        yield from ((one.parent.lstrip("/"), one.child.lstrip("/")) for one in transforms)


def _frame_of(reader: BagReader, topic: str) -> str:
    first = next(reader.messages((topic,)), None)
    try:
        return "" if first is None else str(reader.deserialize(first).header.frame_id).lstrip("/")
    except AreError:
        return ""
