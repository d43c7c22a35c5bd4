"""`are play`: a recording to live topics, with /clock, as `ros2 bag play --clock` does."""

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, Protocol

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

from are_ros.conventions import NS_PER_S, seconds_to_ns
from are_ros.errors import BagError
from are_ros.recording.lockstep import Lockstep
from are_ros.recording.play_options import PlayOptions
from are_ros.recording.play_outlets import CLOCK, PlayOutlets
from are_ros.recording.ros_session import ros_session
from are_ros.recording.subscribers import await_subscribers
from are_ros.replay.bag_clock import BagClock
from are_ros.replay.bag_reader import BagMessage, BagReader
from are_ros.replay.roles import find_roles
from are_ros.replay.runner import Progress

__all__ = ("PlayOptions", "PlayOutcome", "play")

_TF: Final = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_RECENT_NS: Final = 10 * NS_PER_S
"""Of what moves, so much from before the start is sent: as much as tf2 keeps."""
_ASK_S: Final = 0.05
_LATE_S: Final = 0.1
_LATCHED_S: Final = 5.0
"""The time does not go on before the map of the start has arrived, or this is over."""

ShouldStop = Callable[[], bool]


@dataclass
class PlayOutcome:
    """What was played: messages by recorded topic, how often, what was not and why."""

    counts: Mapping[str, int] = field(default_factory=dict)
    skipped: Mapping[str, str] = field(default_factory=dict)
    passes: int = 0
    is_complete: bool = True


class Pace(Protocol):
    """What decides when the next thing is sent."""

    def begin(self, now_ns: int) -> None:
        """Begin a pass at this time of the recording."""

    def wait_until(self, now_ns: int) -> bool:
        """Wait for this time of the recording; False if it is to end before."""

    def about_to_tell(self) -> None:
        """Get ready for the time to go on: everything earlier was sent."""

    def told(self) -> None:
        """Let what goes by the time follow."""


def play(
    options: PlayOptions,
    say: Callable[[str], None],
    open_progress: Callable[[int, int], Progress],
    should_stop: ShouldStop,
) -> PlayOutcome:
    """Play a recording until its end, or until told to stop.

    The first /clock is the start; the next are multiples of its period since the epoch, each sent
    after all messages of before it. What was latched before the start, and the transforms of the
    ten seconds before it, count as sent at the start. `should_stop` is asked at least every 50 ms.
    Raises AreError.
    """
    with BagReader(options.bags) as reader, ros_session("are_player") as node:
        recording = _Recording.of(reader, options)
        if recording.clock.sentence:
            say(recording.clock.sentence)
        outlets = PlayOutlets(node, reader, options, say)
        if not outlets.topics:
            raise BagError("nothing is left to play of the recording")
        teller = _Teller(node, options.clock_hz)
        pace: Pace = _Lifelike(options.rate, should_stop)
        if options.lockstep:
            pace = Lockstep(node, options.lockstep, outlets, should_stop)
        publishers = {options.target(name): one for name, one in outlets.publishers.items()}
        publishers |= teller.publishers
        is_complete = await_subscribers(node, publishers, options, should_stop)
        outcome = PlayOutcome(outlets.counts, outlets.skipped, is_complete=is_complete)
        progress = open_progress(recording.start_ns, recording.end_ns)
        while outcome.is_complete and (options.loop or not outcome.passes):
            outcome.is_complete = _play_once(recording, outlets, teller, pace, progress)
            outcome.passes += 1
        if isinstance(pace, _Lifelike) and pace.worst_s > _LATE_S:
            say(f"the player fell behind by up to {pace.worst_s:.2f} s; nothing was left out")
    return outcome


@dataclass(frozen=True, eq=False)
class _Recording:
    """The window of a recording that is played, and the time it goes by."""

    reader: BagReader
    clock: BagClock
    first_log_ns: int
    last_log_ns: int

    @classmethod
    def of(cls, reader: BagReader, options: PlayOptions) -> "_Recording":
        first_ns = reader.start_ns + seconds_to_ns(options.start_s)
        last_ns = reader.end_ns
        if options.duration_s is not None:
            last_ns = min(last_ns, first_ns + seconds_to_ns(options.duration_s))
        if first_ns >= last_ns:
            length_s = (reader.end_ns - reader.start_ns) / NS_PER_S
            raise BagError(f"the recording is {length_s:.1f} s long: nothing is left to play")
        roles = find_roles(reader.topics, {})
        return cls(reader, BagClock.of(reader, roles, first_ns, last_ns), first_ns, last_ns)

    @property
    def start_ns(self) -> int:
        return self.clock.at(self.first_log_ns)

    @property
    def end_ns(self) -> int:
        return self.clock.at(self.last_log_ns)

    def messages(self, topics: tuple[str, ...]) -> Iterator[tuple[int, BagMessage]]:
        """Yield (time, message), first what counts as sent at the start."""
        for message in self._earlier(topics):
            yield self.start_ns, message
        for message in self.reader.messages(topics, self.first_log_ns, self.last_log_ns):
            yield max(self.clock.at(message.log_time_ns), self.start_ns), message

    def _earlier(self, topics: tuple[str, ...]) -> Iterator[BagMessage]:
        known = [topic for topic in self.reader.topics if topic.name in topics]
        latched = {topic.name for topic in known if topic.is_latched or "static" in topic.name}
        moving = {topic.name for topic in known if topic.type_name in _TF} - latched
        if self.first_log_ns == self.reader.start_ns or not latched | moving:
            return
        recent_ns = self.first_log_ns - _RECENT_NS
        for message in self.reader.messages(latched | moving, stop_ns=self.first_log_ns):
            if message.topic in latched or message.log_time_ns >= recent_ns:
                yield message


def _play_once(
    recording: _Recording, outlets: PlayOutlets, teller: "_Teller", pace: Pace, progress: Progress
) -> bool:
    """Play the recording once; tell whether it came to its end."""
    pace.begin(recording.start_ns)
    _tell(recording.start_ns, teller, pace)
    clock = teller.times_after(recording.start_ns, recording.end_ns)
    clock_ns = next(clock, None)
    has_begun = False
    for now_ns, message in recording.messages(outlets.topics):
        while clock_ns is not None and clock_ns <= now_ns:
            if not pace.wait_until(clock_ns):
                return False
            if not has_begun:
                outlets.wait_for_latched(_LATCHED_S)
                pace.begin(clock_ns)
                has_begun = True
            _tell(clock_ns, teller, pace)
            clock_ns = next(clock, None)
        if not pace.wait_until(now_ns):
            return False
        outlets.publish(message)
        progress(now_ns)
    while clock_ns is not None:
        if not pace.wait_until(clock_ns):
            return False
        _tell(clock_ns, teller, pace)
        clock_ns = next(clock, None)
    progress(recording.end_ns)
    return True


def _tell(now_ns: int, teller: "_Teller", pace: Pace) -> None:
    pace.about_to_tell()
    teller.tell(now_ns)
    pace.told()


class _Teller:
    """Publishes /clock, reliably, or not at all."""

    def __init__(self, node: Node, clock_hz: float) -> None:
        self._period_ns = round(NS_PER_S / clock_hz) if clock_hz else 0
        qos = QoSProfile(depth=10)
        self.publishers = {CLOCK: node.create_publisher(Clock, CLOCK, qos)} if clock_hz else {}

    def times_after(self, start_ns: int, end_ns: int) -> Iterator[int]:
        """Yield the multiples of the period after the start, and last the end."""
        if not self._period_ns:
            return
        yield from range(
            (start_ns // self._period_ns + 1) * self._period_ns, end_ns, self._period_ns
        )
        yield end_ns

    def tell(self, now_ns: int) -> None:
        """Publish the time."""
        for publisher in self.publishers.values():
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(now_ns, NS_PER_S)
            publisher.publish(message)


class _Lifelike:
    """Sends each thing at its time, `rate` times as fast as it happened."""

    def __init__(self, rate: float, should_stop: ShouldStop) -> None:
        self.worst_s = 0.0
        self._rate = rate
        self._should_stop = should_stop
        self._asked_s = 0.0

    def begin(self, now_ns: int) -> None:
        """Begin a pass: now is this time of the recording."""
        self._zero_ns, self._zero_s = now_ns, time.monotonic()

    def wait_until(self, now_ns: int) -> bool:
        """Sleep until it is time; tell whether to go on."""
        due_s = self._zero_s + (now_ns - self._zero_ns) / NS_PER_S / self._rate
        while True:
            here_s = time.monotonic()
            if here_s - self._asked_s >= _ASK_S:
                self._asked_s = here_s
                if self._should_stop():
                    return False
            if here_s >= due_s:
                self.worst_s = max(self.worst_s, here_s - due_s)
                return True
            time.sleep(min(due_s - here_s, _ASK_S))

    def about_to_tell(self) -> None:
        """Do nothing: time goes on by itself."""

    def told(self) -> None:
        """Do nothing."""
