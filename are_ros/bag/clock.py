"""The clock of a replay: the times of recording, or the stamps where the two disagree.

A recording made under simulated time, from another recording, or on another machine than the
robot's has stamps that lie seconds, hours or years from the times at which its messages were
written. Poses would be too old or still to come; so the clock of the stamps is recovered: from
/clock where it was recorded, else from the stamps of odometry, transforms and scans.
"""

from array import array
from collections import deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros.bag.file_order import JumpBack
from are_ros.bag.reader import STAMP_AT, BagMessage, BagReader, stamp_in
from are_ros.conventions import IDLE_NS, NS_PER_S
from are_ros.errors import BagError, InputError
from are_ros.messages.sensors import SENSORS
from are_ros.wording import duration_text, listed

# Stamps and times of recording, source by source.
#
# One pass over the moving messages (transforms, odometry, scans, CameraInfo) shows whether stamps
# and times of recording have one clock, where the recording has gaps, and how long scans have to
# wait for their transforms.


MOVING_ROLES = ("tf", "odom", *SENSORS, "camera/camera_info")
"""The roles whose messages come all the time while a robot is recorded."""

BASE_FRAMES = ("base_footprint", "base_link")
"""The usual names of the robot's base, the preferred one first."""


def base_frame_of(frames: Collection[str], odometry_child: str = "") -> str:
    """Return the robot's base among frames, "" where none can be told.

    It is a frame of a usual name, else the only one within a namespace (robot1/base_link), else the
    child frame of the odometry.
    """
    prefixes = {f.removesuffix(name) for name in BASE_FRAMES for f in frames if _is_base(f, name)}
    prefix = "" if "" in prefixes else next(iter(prefixes), "") if len(prefixes) == 1 else None
    usual = [] if prefix is None else [prefix + name for name in BASE_FRAMES]
    return next((name for name in (*usual, odometry_child) if name in frames), "")


def _is_base(frame: str, name: str) -> bool:
    return frame == name or frame.endswith(f"/{name}")


def chain_above(frame: str, parents: Mapping[str, str]) -> list[str]:
    """Return a frame and the parents above it, `parents` by child; those of a ring come once."""
    chain = [frame]
    while (above := parents.get(chain[-1])) is not None and above not in chain:
        chain.append(above)
    return chain


Ints = npt.NDArray[np.int64]
Edge = tuple[str, str]

_NONE = np.empty(0, np.int64)
_FEWEST_STAMPS = 5
"""A source with fewer stamps is used for the clock only if there is no better one."""

CLOCK_TOPIC = "/clock"
_CLOCK_SAMPLES = 50
_CLOCK_AGREES_NS = NS_PER_S // 5


@dataclass(frozen=True, eq=False)
class Times:
    """One source of stamps: times of recording and stamps, int64 (N,) [ns], in order of the log.

    `name` is how a sentence calls the source. `is_edge`: it is an edge of the transforms, which
    may be dated ahead on purpose, so that it can be used until the next one comes.
    """

    name: str
    log_ns: Ints
    stamps_ns: Ints
    is_edge: bool = False


@dataclass(frozen=True, eq=False)
class RecordedTimes:
    """The times of one window of a recording from whose `bag_start_ns` --start counts.

    `sources` are the candidates for the clock, the best first: /clock (only where it disagrees with
    the times of recording), odometry, moving edges, scans. Fixed joints are none: they are often
    dated far ahead. `edges` are all edges (parent, child) of odometry and /tf, `static_edges` those
    of /tf_static. `odometry_child` is the child frame of the odometry, "" without any. `scans` are
    the times of each scan topic, `scan_frames` the frames. The log times of all moving messages are
    `moving_log_ns`, int64 (N,) ascending. `next_moving_ns` is the log time of the first one after
    the window, None where the window ends with the recording. `still_since_ns` is that of the last
    one before the window, or a minute before it; None where the window begins with the recording.
    `jump_back` are the log times within the window that occur twice, None without.
    """

    bag_start_ns: int
    sources: tuple[Times, ...]
    edges: Mapping[Edge, Times]
    static_edges: frozenset[Edge]
    scans: Mapping[str, Times]
    scan_frames: Mapping[str, str]
    moving_log_ns: Ints
    next_moving_ns: int | None = None
    still_since_ns: int | None = None
    odometry_child: str = ""
    jump_back: JumpBack | None = None

    @classmethod
    def read(
        cls,
        reader: BagReader,
        role_of_topic: Mapping[str, str],
        start_ns: int,
        stop_ns: int,
    ) -> "RecordedTimes":
        """Read the window [start_ns, stop_ns) of the log; malformed messages are left out.

        BagError where the recording is damaged.
        """
        moving = {t: role for t, role in role_of_topic.items() if role in MOVING_ROLES}
        logs: dict[str, array[int]] = {topic: array("q") for topic in moving}
        stamps: dict[str, array[int]] = {topic: array("q") for topic in moving}
        transforms = _Transforms()
        messages = reader.messages(list(moving), start_ns, stop_ns) if moving else ()
        for message in messages:
            if not reader.is_expected(message):
                continue
            logs[message.topic].append(message.log_time_ns)
            if moving[message.topic] == "tf":
                transforms.take(reader, message)
            else:
                stamp_ns = stamp_in(message.data, is_ros1=reader.is_ros1)
                stamps[message.topic].append(stamp_ns or 0)

        def topics(wanted: str) -> dict[str, Times]:
            names = (topic for topic, role in moving.items() if role == wanted)
            return {name: _times(name, logs[name], stamps[name]) for name in names}

        odometry, edges = topics("odom"), transforms.edges()
        scans = {name: times for role in SENSORS for name, times in topics(role).items()}
        moved = [times for edge, times in edges.items() if edge in transforms.moving]
        found = [*odometry.values(), *moved, *scans.values()] or list(edges.values())
        odometry_child = ""
        for name, times in odometry.items():
            if (edge := _odometry_edge(reader, name, edges)) is not None:
                edges.setdefault(edge, times)
                odometry_child = edge[1]
        return cls(
            bag_start_ns=begin_of(reader, moving),
            sources=(*_clock(reader, start_ns, stop_ns), *_telling(found)),
            edges=edges,
            static_edges=frozenset(_static_edges(reader, role_of_topic, stop_ns)),
            scans=scans,
            scan_frames={topic: _frame_of(reader, topic) for topic in scans},
            moving_log_ns=np.sort(np.concatenate([_NONE, *logs.values()])),
            next_moving_ns=first_time(reader, moving, stop_ns),
            still_since_ns=_still_since(reader, moving, start_ns),
            odometry_child=odometry_child,
            jump_back=reader.jump_back(moving, start_ns, stop_ns),
        )


def first_time(
    reader: BagReader, topics: Collection[str], start_ns: int | None = None
) -> int | None:
    """Return the log time of the first message of some topics from `start_ns` on, None without."""
    if not topics or (start_ns is not None and start_ns >= reader.end_ns):
        return None
    first = next(reader.messages(list(topics), start_ns), None)
    return None if first is None else first.log_time_ns


def begin_of(reader: BagReader, moving: Collection[str]) -> int:
    """Return the log time from which --start counts.

    What lies a minute or more before everything that moves does not count.
    """
    first_ns = first_time(reader, moving) or reader.start_ns
    return first_ns if first_ns - reader.start_ns >= IDLE_NS else reader.start_ns


def _still_since(reader: BagReader, moving: Collection[str], start_ns: int) -> int | None:
    """Return the log time of the last message before a window, or a minute before the window."""
    if not moving or start_ns <= reader.start_ns:
        return None
    since_ns = max(start_ns - IDLE_NS, reader.start_ns)
    last = deque(reader.messages(list(moving), since_ns, start_ns), maxlen=1)
    return last[0].log_time_ns if last else since_ns


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
    return Times(name, np.array(log), np.array(stamps), is_edge)


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


def _clock(reader: BagReader, start_ns: int, stop_ns: int) -> list[Times]:
    """Return the times of /clock where it was recorded and differs from the log."""
    if not any(topic.name == CLOCK_TOPIC and topic.is_usable for topic in reader.topics):
        return []
    at = 0 if reader.is_ros1 else STAMP_AT

    def instants() -> Iterable[tuple[int, int]]:
        for message in reader.messages((CLOCK_TOPIC,), start_ns, stop_ns):
            stamp_ns = stamp_in(message.data, at, is_ros1=reader.is_ros1)
            yield message.log_time_ns, stamp_ns or 0

    first = [stamp_ns - log_ns for log_ns, stamp_ns in islice(instants(), _CLOCK_SAMPLES)]
    if not first or abs(float(np.median(first))) < _CLOCK_AGREES_NS:
        return []
    log_ns, stamps_ns = np.array(list(instants()), dtype=np.int64).T
    return [Times(CLOCK_TOPIC, log_ns, stamps_ns)]


def _odometry_edge(reader: BagReader, topic: str, known: Iterable[Edge]) -> Edge | None:
    """Return (frame, child frame) of the odometry; an empty child means the base."""
    first = reader.first_object(topic)
    if first is None or not first.header.frame_id:
        return None
    frames = {frame for edge in known for frame in edge}
    base = base_frame_of(frames) or BASE_FRAMES[0]
    return first.header.frame_id.lstrip("/"), first.child_frame_id.lstrip("/") or base


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
    first = reader.first_object(topic)
    header = getattr(first, "header", None)
    return "" if header is None else str(header.frame_id).lstrip("/")


_AHEAD_NS = NS_PER_S // 5
_BEHIND_NS = NS_PER_S // 2
"""Stamps go by another clock where they lie later than the recording by more than the first, or
earlier by more than the second: a message may be under way for some tenths of a second, but none
comes before it was stamped."""
_STEADY_NS = 3 * NS_PER_S // 10
"""An offset that varies by less than this is a constant, and the rest is delay."""
_TOPIC_APART_NS = 3 * NS_PER_S // 4
_EDGE_APART_NS = 3 * NS_PER_S // 2
"""Sources whose stamps are further apart have no common clock. A transform may be dated a second
ahead on purpose (transform_tolerance)."""
_LOOP_NS = NS_PER_S


@dataclass(frozen=True, eq=False)
class BagClock:
    """Maps log times [ns] to the times of the replay, never decreasing.

    The map is linear between the known instants (int64 (N,) each, N of 0 for the identity), with
    slope 1 outside them. `sentence` describes it, empty for the identity. `disagreement` names the
    sources whose stamps have no clock in common with the others; `apart` are their names.
    """

    log_ns: Ints
    clock_ns: Ints
    sentence: str = ""
    disagreement: str = ""
    apart: frozenset[str] = frozenset()

    @classmethod
    def of(cls, times: RecordedTimes) -> "BagClock":
        """Return the clock of a recording's window.

        It is the clock that most sources share, the log's if they agree with it. Raises BagError
        where the stamps or the log times jump back, as in a recording that looped.
        """
        if times.jump_back is not None:
            raise BagError(_said_of(times.jump_back, times.bag_start_ns))
        source = _reference(times.sources)
        if source is None:
            return cls(_NONE, _NONE)
        log_ns, clock_ns, sentence = _instants(source, times.bag_start_ns)
        clock = cls(log_ns, clock_ns, sentence)
        disagreement, apart = _disagreement(clock, source, times.sources)
        return cls(log_ns, clock_ns, sentence, disagreement, frozenset(apart))

    def at(self, log_time_ns: int) -> int:
        """Return the time of a log time."""
        if not len(self.log_ns):
            return log_time_ns
        index = int(np.searchsorted(self.log_ns, log_time_ns, side="right"))
        if index == 0:
            return max(0, int(self.clock_ns[0] - self.log_ns[0]) + log_time_ns)
        since_ns = log_time_ns - int(self.log_ns[index - 1])
        if index == len(self.log_ns):
            return int(self.clock_ns[-1]) + since_ns
        log_step_ns = int(self.log_ns[index] - self.log_ns[index - 1])
        clock_step_ns = int(self.clock_ns[index] - self.clock_ns[index - 1])
        return int(self.clock_ns[index - 1]) + since_ns * clock_step_ns // log_step_ns

    def at_many(self, log_times_ns: Ints) -> Ints:
        """Return the times of log times, int64 (N,): `at`, to about a microsecond."""
        if not len(self.log_ns):
            return log_times_ns
        offsets_ns, begin_ns = self.clock_ns - self.log_ns, self.log_ns[0]
        # Outside the known instants the offset stays what it is at the next one.
        grown_ns = offsets_ns - offsets_ns[0]
        grown_ns = np.interp(log_times_ns - begin_ns, self.log_ns - begin_ns, grown_ns)
        times_ns: Ints = np.maximum(0, log_times_ns + offsets_ns[0] + grown_ns.astype(np.int64))
        return times_ns


def _reference(sources: Sequence[Times]) -> Times | None:
    """Return the source whose clock most others share, the first of several; /clock if there."""
    if not sources:
        return None
    if sources[0].name == CLOCK_TOPIC:
        return sources[0]
    offsets = np.array([np.median(one.stamps_ns - one.log_ns) for one in sources])
    company = np.abs(offsets[:, np.newaxis] - offsets) <= _TOPIC_APART_NS
    return sources[int(company.sum(axis=1).argmax())]


def _instants(source: Times, bag_start_ns: int) -> tuple[Ints, Ints, str]:
    """Return log times, the clock's times at them, and a sentence; all empty for the log's."""
    offsets_ns = source.stamps_ns - source.log_ns
    low_ns, middle_ns, high_ns = np.percentile(offsets_ns, (10, 50, 90)).tolist()
    if low_ns >= -_BEHIND_NS and high_ns <= _AHEAD_NS:
        return _NONE, _NONE, ""
    is_steady = high_ns - low_ns <= _STEADY_NS
    told_ns = middle_ns if is_steady else float(max(offsets_ns.min(), offsets_ns.max(), key=abs))
    order = "ahead of" if told_ns > 0 else "behind"
    length = duration_text(abs(round(told_ns)))
    sentence = (
        f"the stamps lie {'' if is_steady else 'up to '}{length} {order} the times of recording "
        f"(another machine's clock, simulated time, or a recording of a recording): the replay "
        f"goes by the stamps of {source.name}"
    )
    if is_steady:
        first_ns = source.log_ns[:1]
        return first_ns, first_ns + int(np.median(offsets_ns)), sentence
    instants = np.stack([source.log_ns, source.stamps_ns], axis=1)
    _check_no_loop(source.name, instants, bag_start_ns)
    return source.log_ns, np.maximum.accumulate(source.stamps_ns), sentence


def _said_of(jump: JumpBack, bag_start_ns: int) -> str:
    from_s, until_s = ((ns - bag_start_ns) / NS_PER_S for ns in (jump.from_ns, jump.until_ns))
    # Rounded inwards, so that nothing of another part is in a window of just these numbers.
    tenth_ns = NS_PER_S // 10
    lone = [
        (-((bag_start_ns - first_ns) // tenth_ns) / 10, (last_ns - bag_start_ns) // tenth_ns / 10)
        for first_ns, last_ns in jump.lone
    ]
    windows = [f"--start {first:.1f} --duration {last - first:.1f}" for first, last in lone]
    advice = f"replay one part of it: {' or '.join(windows)}" if windows else "all of it is mixed"
    return (
        f"{jump.topic}: the log times jump back from {until_s:.1f} s to {from_s:.1f} s (the clock"
        f" was set, or a simulation began anew while it was recorded by its own clock): {advice}"
    )


def _check_no_loop(topic: str, instants: Ints, bag_start_ns: int) -> None:
    back_ns = -np.diff(instants[:, 1])
    if len(back_ns) and back_ns.max() > _LOOP_NS:
        worst = int(back_ns.argmax())
        at_s = (int(instants[worst + 1, 0]) - bag_start_ns) / NS_PER_S
        raise BagError(
            f"{topic}: the stamps jump back by {back_ns[worst] / NS_PER_S:.1f} s, {at_s:.1f} s "
            "into the recording (it looped, or a clock was set back): replay one part of it with "
            "--start and --duration"
        )


def _disagreement(
    clock: BagClock, reference: Times, sources: Sequence[Times]
) -> tuple[str, list[str]]:
    """Return a sentence about the sources with another clock, and their names."""

    def offset_ns(source: Times) -> float:
        return float(np.median(source.stamps_ns - clock.at_many(source.log_ns)))

    apart = {one.name: offset_ns(one) - offset_ns(reference) for one in sources}
    limits = {one.name: _EDGE_APART_NS if one.is_edge else _TOPIC_APART_NS for one in sources}
    parts, all_names = [], []
    for word, sign in (("later", 1), ("earlier", -1)):
        names = [name for name, by_ns in apart.items() if sign * by_ns > limits[name]]
        if names:
            all_names += names
            most = duration_text(max(round(abs(apart[name])) for name in names))
            are = "are" if len(names) > 1 else "is"
            parts.append(f"{listed(names)} {are} stamped up to {most} {word} than {reference.name}")
    if not parts:
        return "", []
    sentence = (
        f"{listed(parts)} when they are recorded: there is no common clock. The replay goes by "
        f"{reference.name}; wherever it needs both, in scans above all, it errs by that time. "
        "Set the machines' clocks (NTP, chrony) and record anew, or leave those scans out "
        "(sensors.scans)"
    )
    return sentence, all_names
