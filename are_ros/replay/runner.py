"""A replay: the inputs of a recording through the builder, tick by tick."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.assembly import parse_static_transform
from are_ros.builder.schedule import TickSchedule
from are_ros.builder.sensor_path import ReleasedScan
from are_ros.builder.tick import Tick
from are_ros.conventions import NS_PER_S, seconds_to_ns
from are_ros.errors import BagError
from are_ros.messages.feed import Feed
from are_ros.replay.bag_clock import BagClock
from are_ros.replay.bag_reader import BagMessage, BagReader
from are_ros.replay.bag_times import MOVING_ROLES, Ints, RecordedTimes
from are_ros.replay.options import ReplayOptions
from are_ros.replay.roles import RolesFound
from are_ros.replay.stopwatch import Progress, Stopwatch
from are_ros.replay.timeline import GAP_NS, Span, Stretches, scan_waits, stretches_of
from are_ros.wording import duration_text

_FED_BEFORE_START = ("map", "octomap_point_cloud_centers", "camera/camera_info", "tf", "tf_static")
_SCAN_ROLE = "scan"
_DEFAULT_SCANS = ("scan",)
_READ_ROLES = (*_FED_BEFORE_START, "odom", _SCAN_ROLE, "plan")


class Listener(Protocol):
    """What takes the outputs of a replay, in their order."""

    def take_tick(self, tick: Tick) -> None:
        """Take a tick."""

    def take_scans(self, scans: Sequence[ReleasedScan]) -> None:
        """Take scans that left the sensor path."""

    def take_input(self, message: BagMessage, received_ns: int) -> None:
        """Take an input, after the builder did."""


@dataclass(frozen=True, eq=False)
class Timeline:
    """What a replay reads of a recording, and when: known before the replay begins.

    `spans` are [start, stop) of the log [ns]; nothing moves between them. Seconds of the options
    count from `begin_ns`. `waits` tell how long scans wait for their transforms [ns], by topic.
    """

    role_of_topic: Mapping[str, str]
    begin_ns: int
    stretches: Stretches
    clock: BagClock
    waits: Mapping[str, Ints]

    @classmethod
    def of(cls, reader: BagReader, options: ReplayOptions, roles: RolesFound) -> "Timeline":
        """Read the times of the window that the options ask for.

        Raises BagError where the window holds nothing, or a scan topic is absent.
        """
        role_of_topic = topics_to_read(reader, options, roles)
        begin_ns = beginning(reader, role_of_topic)
        start_ns = begin_ns + seconds_to_ns(options.start_s)
        stop_ns = _end_ns(reader, start_ns, options)
        times = RecordedTimes.read(reader, role_of_topic, start_ns, stop_ns)
        clock = BagClock.of(times)
        given = [parse_static_transform(text)[:2] for text in options.parameters.frames.static]
        return cls(
            role_of_topic=role_of_topic,
            begin_ns=begin_ns,
            stretches=stretches_of(times, clock, start_ns, stop_ns, reader.files),
            clock=clock,
            waits=scan_waits(times, clock, options.parameters.frames.map, given),
        )

    def sentences(self, bag_start_ns: int) -> list[str]:
        """Return what a user should know of it."""
        said = self.stretches.sentences(self.begin_ns)
        if self.begin_ns > bag_start_ns:
            ahead = duration_text(self.begin_ns - bag_start_ns)
            said.insert(0, f"nothing moves in the first {ahead}: the replay begins after them")
        return [*said, *filter(None, (self.clock.sentence, self.clock.disagreement))]


class Replay:
    """Runs one builder over the spans of a recording's timeline, by its `clock`.

    Ticks run at the multiples of the tick period since the epoch, each with what was received
    before it. What was recorded before a span and lasts (maps, transforms) counts as received at
    its beginning. In the gaps between spans nothing happens; all artefacts go before each.
    """

    def __init__(
        self,
        reader: BagReader,
        builder: ArBuilder,
        options: ReplayOptions,
        timeline: Timeline,
        stopwatch: Stopwatch,
    ) -> None:
        self.role_of_topic = timeline.role_of_topic
        self.clock = timeline.clock
        self._spans = timeline.stretches.spans
        self.start_ns = self.clock.at(self._spans[0][0])
        self.end_ns = self.clock.at(self._spans[-1][1])
        self.feed = Feed(reader, builder, self.role_of_topic)
        self.ticks = 0
        self._skipped_ns = 0
        self._reader = reader
        self._builder = builder
        reader.learn_types(self.role_of_topic)
        self._stopwatch = stopwatch
        self._tick_rate_hz = options.parameters.builder.tick_rate
        self._schedule = TickSchedule.of(self._tick_rate_hz, self.start_ns)

    @property
    def length_ns(self) -> int:
        """How long it is by its clock, without the gaps."""
        return sum(self.clock.at(stop) - self.clock.at(start) for start, stop in self._spans)

    def scan_topics(self) -> tuple[str, ...]:
        """Return the topics of the scans that are augmented."""
        roles = self.role_of_topic.items()
        return tuple(topic for topic, role in roles if role == _SCAN_ROLE)

    def run(self, listener: Listener, progress: Progress) -> None:
        """Run to the end; `progress` is told the time reached, the gaps taken off."""
        before_ns = self._reader.start_ns
        for index, span in enumerate(self._spans):
            if index:
                self._skip_gap(self.clock.at(before_ns), self.clock.at(span[0]))
            self._run_span(before_ns, span, listener, progress)
            before_ns = span[1]
        progress(self.end_ns - self._skipped_ns)

    def _skip_gap(self, from_ns: int, to_ns: int) -> None:
        """Go on after a gap, as if a new recording began."""
        self._builder.interrupt(from_ns, to_ns)
        self._schedule = TickSchedule.of(self._tick_rate_hz, to_ns)
        self._skipped_ns += to_ns - from_ns

    def _run_span(self, before_ns: int, span: Span, listener: Listener, progress: Progress) -> None:
        start_ns, end_ns = self.clock.at(span[0]), self.clock.at(span[1])
        for message in self._messages(before_ns, span):
            received_ns = max(self.clock.at(message.log_time_ns), start_ns)
            self._run_ticks(received_ns, listener)
            self.feed.take(message, received_ns)
            listener.take_input(message, received_ns)
            self._hand_over_scans(listener)
            progress(received_ns - self._skipped_ns)
        self._run_ticks(end_ns - 1, listener)
        self._builder.finish(end_ns)
        self._hand_over_scans(listener)

    def _messages(self, before_ns: int, span: Span) -> Iterator[BagMessage]:
        """Yield what is fed from before the span, then the span's messages."""
        if span[0] > before_ns:
            early = [t for t, role in self.role_of_topic.items() if role in _FED_BEFORE_START]
            yield from self._reader.messages(early, before_ns, span[0])
        yield from self._reader.messages(list(self.role_of_topic), *span)

    def _run_ticks(self, until_ns: int, listener: Listener) -> None:
        while (tick_ns := self._schedule.pop(until_ns)) is not None:
            with self._stopwatch.tick():
                tick = self._builder.step(tick_ns)
            listener.take_tick(tick)
            self._hand_over_scans(listener)
            self.ticks += 1

    def _hand_over_scans(self, listener: Listener) -> None:
        if scans := self._builder.take_scans():
            listener.take_scans(scans)


def beginning(reader: BagReader, role_of_topic: Mapping[str, str]) -> int:
    """Return the log time at which the recording begins.

    What lies long before everything that moves (a latched map with the time of its making, or
    with none) does not count.
    """
    moving = [topic for topic, role in role_of_topic.items() if role in MOVING_ROLES]
    firsts = (next(reader.messages((topic,)), None) for topic in moving)
    begin_ns = min((first.log_time_ns for first in firsts if first), default=reader.start_ns)
    return begin_ns if begin_ns - reader.start_ns >= GAP_NS else reader.start_ns


def _end_ns(reader: BagReader, start_ns: int, options: ReplayOptions) -> int:
    end_ns = reader.end_ns
    if options.duration_s is not None:
        end_ns = min(end_ns, start_ns + seconds_to_ns(options.duration_s))
    if start_ns >= end_ns:
        length_s = (reader.end_ns - reader.start_ns) / NS_PER_S
        option = f"--start {options.start_s:g}"
        if start_ns < reader.end_ns:
            option = f"--duration {options.duration_s:g}"
        raise BagError(
            f"{option}: the recording is {length_s:.1f} s long, and nothing of it is to be replayed"
        )
    return end_ns


def topics_to_read(reader: BagReader, options: ReplayOptions, roles: RolesFound) -> dict[str, str]:
    """Return the role of each topic that the builder needs."""
    chosen: dict[str, str] = {}
    for role in _READ_ROLES:
        topic = roles.topic(role)
        if topic is not None and not _is_replaced(role, options):
            chosen[topic] = role
    if options.parameters.sensors.scans != _DEFAULT_SCANS:
        chosen = {topic: role for topic, role in chosen.items() if role != _SCAN_ROLE}
        chosen |= dict.fromkeys(_named_scans(reader, options), _SCAN_ROLE)
    return chosen


def _is_replaced(role: str, options: ReplayOptions) -> bool:
    """Say whether a file stands in for a topic."""
    by_file = {"map": options.map_file, "octomap_point_cloud_centers": options.octomap_file}
    return by_file.get(role) is not None


def _named_scans(reader: BagReader, options: ReplayOptions) -> list[str]:
    """Return the topics that `sensors.scans` names; BagError where one is no scan there."""
    names = [f"/{name.lstrip('/')}" for name in options.parameters.sensors.scans]
    scans = {topic.name for topic in reader.topics if topic.type_name.endswith("/LaserScan")}
    for name in names:
        if name not in scans:
            known = ", ".join(sorted(scans)) or "none"
            raise BagError(f"sensors.scans: the recording has no scan '{name}'; its scans: {known}")
    return names
