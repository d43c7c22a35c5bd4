"""`are play`: a recording to live topics, with /clock, as `ros2 bag play --clock` does."""

import time
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from heapq import merge
from operator import itemgetter
from typing import Final

from are_ros.bag.clock import CLOCK_TOPIC, MOVING_ROLES, BagClock, RecordedTimes
from are_ros.bag.reader import BagMessage, BagReader
from are_ros.bag.recording import PREFIX
from are_ros.bag.roles import TF_TYPES, find_roles
from are_ros.bag.stretches import Window, stretches_of
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError
from are_ros.node.startup import ros_session
from are_ros.record.lockstep import Lockstep, Pace, ShouldStop
from are_ros.record.publishers import (
    OWN_CLOCK,
    ClockPublisher,
    PlayedTopics,
    PlayOptions,
    await_subscribers,
)
from are_ros.replay.progress import OpenProgress, Progress, Say
from are_ros.wording import counted, duration_text

# The window of a recording that is played, and its clock.


_RECENT_NS: Final = 10 * NS_PER_S
"""Transforms of this long before the start are sent: tf2 keeps as much."""
_LASTING_ROLES: Final = ("map", "octomap_point_cloud_centers")
"""These roles and static transforms count as latched, however they were recorded: some recordings
do not tell."""


@dataclass(frozen=True, eq=False)
class PlayWindow:
    """The window of a recording that is played, chosen as for a replay, and its clock.

    The topics `lasting` hold maps and static transforms.
    """

    reader: BagReader
    clock: BagClock
    window: Window
    lasting: frozenset[str]
    gaps_ns: int = 0

    @classmethod
    def of(cls, reader: BagReader, options: PlayOptions) -> "PlayWindow":
        """Return the window that the options ask for; BagError where it holds nothing."""
        roles = find_roles(reader.topics, {})
        role_of_topic = roles.by_topic((*MOVING_ROLES, *_LASTING_ROLES))
        window = Window.of(reader, role_of_topic, options.start_s, options.duration_s)
        times = RecordedTimes.read(reader, role_of_topic, window.start_ns, window.stop_ns)
        clock = BagClock.of(times)
        gaps = stretches_of(times, clock, window.start_ns, window.stop_ns).gaps
        lasting = {topic for topic, role in role_of_topic.items() if role in _LASTING_ROLES}
        lasting |= {
            topic.name
            for topic in reader.topics
            if topic.type_name in TF_TYPES and "static" in topic.name
        }
        return cls(reader, clock, window, frozenset(lasting), sum(gap.length_ns for gap in gaps))

    @property
    def start_ns(self) -> int:
        """The time at which it begins."""
        return self.clock.at(self.window.start_ns)

    @property
    def end_ns(self) -> int:
        """The time at which it ends."""
        return self.clock.at(self.window.stop_ns)

    def messages(self, topics: Collection[str]) -> Iterator[tuple[int, BagMessage]]:
        """Yield (time, message) of the window."""
        for message in self.reader.messages(topics, self.window.start_ns, self.window.stop_ns):
            yield max(self.clock.at(message.log_time_ns), self.start_ns), message

    def earlier(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """Yield latched messages and recent transforms of before the start."""
        known = [topic for topic in self.reader.topics if topic.name in topics]
        latched = {topic.name for topic in known if topic.is_latched or "static" in topic.name}
        latched |= self.lasting & set(topics)
        moving = {topic.name for topic in known if topic.type_name in TF_TYPES} - latched
        start_ns = self.window.start_ns
        if start_ns == self.reader.start_ns or not latched | moving:
            return
        recent_ns = start_ns - _RECENT_NS
        for message in self.reader.messages(latched | moving, stop_ns=start_ns):
            if message.topic in latched or message.log_time_ns >= recent_ns:
                yield message


# The pace of real time.


_ASK_S: Final = 0.05
_REST_S: Final = 0.5
_APART_S: Final = 0.001
"""The pause between messages from before the start: a reader's queue is short."""


class RealTimePace(Pace):
    """Sends each message at its time, `rate` times as fast as it was recorded."""

    def __init__(self, rate: float, should_stop: ShouldStop) -> None:
        super().__init__(should_stop)
        self.worst_s = 0.0
        self._rate = rate
        self._asked_s = 0.0

    def begin(self, now_ns: int) -> None:
        """Begin a pass: now is this time of the recording."""
        self._zero_ns, self._zero_s = now_ns, time.monotonic()

    def wait_until(self, now_ns: int) -> bool:
        """Sleep until this time; False if the player is to stop."""
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

    def wait_a_little(self) -> bool:
        """Sleep for as long as a reader takes for a message; False if the player is to stop."""
        time.sleep(_APART_S)
        return not self._should_stop()

    def rest(self) -> None:
        """Sleep for a moment: messages would be received late while a node processes the map."""
        time.sleep(_REST_S)


_LATE_S: Final = 0.1
_LINGER_S: Final = 0.1
"""The publishers stay this long, so that the last messages arrive. (Acknowledgements take up to
three seconds: an idle publisher asks its readers that seldom.)"""
_LATCHED_S: Final = 5.0
"""/clock waits at most this long for the arrival of the first map."""


@dataclass
class PlayOutcome:
    """The result of a play: messages by topic, skipped topics with the reason, passes."""

    counts: Mapping[str, int]
    skipped: Mapping[str, str]
    is_complete: bool
    passes: int = 0

    @property
    def is_whole(self) -> bool:
        """Whether all was played that is to be; a recorded /clock is not where the player's is."""
        return self.skipped.items() <= {(CLOCK_TOPIC, OWN_CLOCK)}


def play(
    options: PlayOptions,
    say: Say,
    open_progress: OpenProgress,
    should_stop: ShouldStop,
) -> PlayOutcome:
    """Play a recording until its end, or until told to stop.

    The first /clock is the start; the next are multiples of its period since the epoch, each sent
    after all messages of before it. What was latched before the start, and the transforms of the
    ten seconds before it, count as sent at the start. `should_stop` is asked at least every 50 ms.
    Raises AreError.
    """
    with BagReader(options.bags) as reader, ros_session("are_player") as node:
        recording = PlayWindow.of(reader, options)
        for sentence in (*reader.unnamed, *recording.window.sentences("the player")):
            say(sentence)
        if recording.clock.sentence:
            say(recording.clock.sentence)
        if recording.gaps_ns:
            say(
                f"nothing moves for {duration_text(recording.gaps_ns)} of the recording, which are "
                "played too: --start and --duration choose a part"
            )
        options.check_topics([topic.name for topic in reader.topics])
        topics = PlayedTopics(node, reader, options, recording.lasting, say)
        if not topics.publishers:
            raise BagError("nothing is left to play of the recording")
        if outputs := sum(PREFIX in topic for topic in topics.publishers):
            say(
                f"the recording holds {counted(outputs, 'output topic')} of {PREFIX.strip('/')}, "
                "played too: beside a live node its messages would come between that one's"
            )
        clock = ClockPublisher(node, options.clock_hz)
        pace: Pace = RealTimePace(options.rate, should_stop)
        if options.lockstep:
            pace = Lockstep(node, options.lockstep, should_stop)
        publishers = {options.target(name): one for name, one in topics.publishers.items()}
        publishers |= clock.publishers
        is_complete = await_subscribers(node, publishers, options, say, should_stop)
        outcome = PlayOutcome(topics.counts, topics.skipped, is_complete=is_complete)
        progress = open_progress(recording.start_ns, recording.end_ns)
        while outcome.is_complete and (options.loop or not outcome.passes):
            outcome.is_complete = _play_once(recording, topics, clock, pace, progress)
            outcome.passes += 1
        if outcome.is_complete:
            pace.end()
        time.sleep(_LINGER_S)
        for sentence in (*topics.left_out(), *_lateness(pace)):
            say(sentence)
    return outcome


def _lateness(pace: Pace) -> list[str]:
    """Return a sentence where the player could not keep the pace."""
    if not isinstance(pace, RealTimePace) or pace.worst_s <= _LATE_S:
        return []
    return [f"the player fell behind by up to {pace.worst_s:.2f} s; it left out nothing for that"]


def _play_once(
    recording: PlayWindow,
    topics: PlayedTopics,
    clock: ClockPublisher,
    pace: Pace,
    progress: Progress,
) -> bool:
    """Play the recording once; return whether it came to its end."""
    pace.begin(recording.start_ns)
    pace.tell(recording.start_ns, clock)
    for early in recording.earlier(topics.publishers):
        if not pace.wait_a_little():
            return False
        pace.send(early, topics)
    pace.begin(recording.start_ns)
    times_ns = clock.times_after(recording.start_ns, recording.end_ns)
    instants: Iterator[tuple[int, BagMessage | None]] = ((at_ns, None) for at_ns in times_ns)
    recorded = recording.messages(topics.publishers)
    has_begun = False
    for now_ns, message in merge(instants, recorded, key=itemgetter(0)):
        if not pace.wait_until(now_ns):
            return False
        if message is not None:
            pace.send(message, topics)
            progress(now_ns)
            continue
        if not has_begun:
            has_begun = True
            if topics.wait_for_latched(_LATCHED_S):
                pace.rest()
            pace.begin(now_ns)
        pace.tell(now_ns, clock)
    progress(recording.end_ns)
    return True
