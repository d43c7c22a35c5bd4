"""A replay: the inputs of a recording through the builder, tick by tick."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Protocol

from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.schedule import TickSchedule
from are_ros.builder.sensor_path import ReleasedScan
from are_ros.builder.tick import Tick
from are_ros.conventions import NS_PER_S, seconds_to_ns
from are_ros.errors import BagError
from are_ros.messages.feed import Feed
from are_ros.replay.bag_clock import BagClock
from are_ros.replay.bag_reader import BagMessage, BagReader
from are_ros.replay.options import ReplayOptions
from are_ros.replay.roles import RolesFound
from are_ros.replay.stopwatch import Stopwatch

_FED_BEFORE_START = ("map", "octomap_point_cloud_centers", "camera/camera_info", "tf", "tf_static")
_SCAN_ROLE = "scan"
_MOVING_ROLES = ("tf", "odom", "scan", "camera/camera_info")
_LONG_BEFORE_NS = 60 * NS_PER_S
_DEFAULT_SCANS = ("scan",)
_READ_ROLES = (*_FED_BEFORE_START, "odom", _SCAN_ROLE, "plan")

Progress = Callable[[int], None]


class Listener(Protocol):
    """What takes the outputs of a replay, in their order."""

    def take_tick(self, tick: Tick) -> None:
        """Take a tick."""

    def take_scans(self, scans: Sequence[ReleasedScan]) -> None:
        """Take scans that left the sensor path."""

    def take_input(self, message: BagMessage, received_ns: int) -> None:
        """Take an input, after the builder did."""


class Replay:
    """Runs one builder over the window [start_ns, end_ns) of a recording, by its `clock`.

    Ticks run at the multiples of the tick period since the epoch, each with what was received
    before it. What was recorded before the window (maps, transforms) counts as received at its
    beginning.
    """

    def __init__(
        self,
        reader: BagReader,
        builder: ArBuilder,
        options: ReplayOptions,
        roles: RolesFound,
        stopwatch: Stopwatch,
    ) -> None:
        """Raise BagError where the window holds nothing, or a scan topic is absent."""
        self.role_of_topic = topics_to_read(reader, options, roles)
        begin_ns, self.sentence = _beginning(reader, self.role_of_topic)
        self._first_log_ns = begin_ns + seconds_to_ns(options.start_s)
        self._last_log_ns = _end_ns(reader, self._first_log_ns, options)
        self.clock = BagClock.of(reader, roles, self._first_log_ns, self._last_log_ns)
        self.start_ns = self.clock.at(self._first_log_ns)
        self.end_ns = self.clock.at(self._last_log_ns)
        self.feed = Feed(reader, builder, self.role_of_topic)
        self.ticks = 0
        self._reader = reader
        self._builder = builder
        reader.learn_types(self.role_of_topic)
        self._stopwatch = stopwatch
        self._schedule = TickSchedule.of(options.parameters.builder.tick_rate, self.start_ns)

    def scan_topics(self) -> tuple[str, ...]:
        """Return the topics of the scans that are augmented."""
        roles = self.role_of_topic.items()
        return tuple(topic for topic, role in roles if role == _SCAN_ROLE)

    def run(self, listener: Listener, progress: Progress) -> None:
        """Run to the end; `progress` is told the log time reached."""
        for message in self._messages():
            received_ns = max(self.clock.at(message.log_time_ns), self.start_ns)
            self._run_ticks(received_ns, listener)
            self.feed.take(message, received_ns)
            listener.take_input(message, received_ns)
            self._hand_over_scans(listener)
            progress(received_ns)
        self._run_ticks(self.end_ns - 1, listener)
        self._builder.finish(self.end_ns)
        self._hand_over_scans(listener)
        progress(self.end_ns)

    def _messages(self) -> Iterator[BagMessage]:
        """Yield what is fed from before the window, then the window's messages."""
        if self._first_log_ns > self._reader.start_ns:
            early = [t for t, role in self.role_of_topic.items() if role in _FED_BEFORE_START]
            yield from self._reader.messages(early, stop_ns=self._first_log_ns)
        topics = list(self.role_of_topic)
        yield from self._reader.messages(topics, self._first_log_ns, self._last_log_ns)

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


def _beginning(reader: BagReader, role_of_topic: Mapping[str, str]) -> tuple[int, str]:
    """Return the log time at which the recording begins, and what is to be said of it.

    What lies long before everything that moves (a latched map with the time of its making, or
    with none) does not count.
    """
    moving = [topic for topic, role in role_of_topic.items() if role in _MOVING_ROLES]
    firsts = (next(reader.messages((topic,)), None) for topic in moving)
    begin_ns = min((first.log_time_ns for first in firsts if first), default=reader.start_ns)
    if begin_ns - reader.start_ns <= _LONG_BEFORE_NS:
        return reader.start_ns, ""
    ahead_s = (begin_ns - reader.start_ns) / NS_PER_S
    return begin_ns, f"nothing moves in the first {ahead_s:.0f} s: the replay begins after them"


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
