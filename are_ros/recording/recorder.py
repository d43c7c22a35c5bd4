"""`are record`: live topics into an MCAP file, as `ros2 bag record` does."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from are_ros.conventions import seconds_to_ns
from are_ros.recording._topic_types import TopicTypes
from are_ros.recording.answers import Answers
from are_ros.recording.file_writer import FileWriter
from are_ros.recording.inbox import Inbox
from are_ros.recording.live_messages import Received, Stamped
from are_ros.recording.log_clock import LogClock, SimulatedClock, WallClock
from are_ros.recording.record_options import RecordOptions
from are_ros.recording.ros_session import ros_session
from are_ros.recording.topic_follower import TopicFollower
from are_ros.replay.bag_folder import describe_folder
from are_ros.replay.bag_writer import BagWriter
from are_ros.wording import counted

NODE_NAME: Final = "are_recorder"

_LOOK_S = 0.1
"""How often new topics and publishers are looked for."""

_REST_S = 0.004
"""How long nothing is taken after nothing was there, unless somebody asks: 2 % of a core, and no
queue fills in it."""

_NOTES = {
    "what": "live topics, recorded by are record",
    "if_unfinished": "a file named .part was not ended in order: `mcap recover` saves it",
}


@dataclass(frozen=True)
class RecordOutcome:
    """What a recording did; all mappings are by topic.

    `counts` are the messages in `file`, topics without one among them; `skipped` the topics that
    could not be recorded, with the reason, which was said. `missed` never arrived (the network, or
    a queue of the middleware, lost them; known only where a topic has one publisher), `dropped`
    came faster than the disk, or the memory before the first /clock, could take them.
    """

    file: Path
    counts: Mapping[str, int]
    file_bytes: int
    skipped: Mapping[str, str]
    missed: Mapping[str, int]
    dropped: Mapping[str, int]

    def sentences(self) -> Iterator[str]:
        """Yield what a user should know of a recording that is not complete."""
        if not self.counts:
            yield "nothing is recorded: no message arrived on any topic"
        for topic, count in self.missed.items():
            yield f"{topic}: {counted(count, 'message')} never arrived"
        for topic, count in self.dropped.items():
            yield f"{topic}: {counted(count, 'message')} dropped, the disk was too slow"


def record(
    options: RecordOptions,
    say: Callable[[str], None],
    on_ready: Callable[[], None],
    should_stop: Callable[[], bool],
) -> RecordOutcome:
    """Record until told to stop, or until the duration is over.

    `say` takes sentences for the user; `on_ready` is called once, when all of `wait_for` are
    connected; `should_stop` is asked in this thread every few milliseconds, but for the moments
    when a package of types is loaded. All that arrived before the stop is in the file. AreError for
    what is wrong; what was recorded until then is then in `<name>.part`.
    """
    awaited = options.awaited_topics()
    options.prepare_place()
    types = TopicTypes()
    clock = SimulatedClock(say) if options.use_sim_time else WallClock()
    bag = BagWriter(options.file, types.store, notes=_NOTES, keeps_partial=True)
    with ros_session(NODE_NAME, has_services=True) as node, FileWriter(bag) as file:
        inbox = Inbox(node)
        follower = TopicFollower(node, options, types, inbox, file, say)
        recording = _Recording(options, inbox, Answers(node), follower, file, clock)
        recording.run(awaited, on_ready, should_stop)
        recording.finish()
    if options.is_folder:
        describe_folder(options.file)
    return recording.outcome()


class _Recording:
    """One recording while it runs."""

    def __init__(
        self,
        options: RecordOptions,
        inbox: Inbox,
        answers: Answers,
        follower: TopicFollower,
        file: FileWriter,
        clock: LogClock,
    ) -> None:
        self._options = options
        self._inbox = inbox
        self._answers = answers
        self._follower = follower
        self._file = file
        self._clock = clock
        self._is_ready = False
        self._started_ns: int | None = None

    def run(
        self,
        awaited: frozenset[str],
        on_ready: Callable[[], None],
        should_stop: Callable[[], bool],
    ) -> None:
        """Pass messages on until it is over."""
        look_s = 0.0
        while not should_stop() and not self._is_over():
            if time.monotonic() >= look_s:
                has_seen_all = self._follower.look()
                look_s = time.monotonic() + (_LOOK_S if has_seen_all else 0.0)
                if has_seen_all and not self._is_ready and self._follower.are_connected(awaited):
                    self._is_ready = True
                    on_ready()
            is_asked = self._answers.take()
            has_passed = self._pass_on(self._inbox.take_all())
            self._answers.give()
            if not (is_asked or has_passed):
                self._answers.wait(_REST_S)

    def finish(self) -> None:
        """Pass on what arrived until now, and nothing that comes meanwhile."""
        end_ns = time.time_ns()
        while self._pass_on([m for m in self._inbox.take_all() if m.received_ns <= end_ns]):
            pass
        self._put(self._clock.rest())
        self._follower.finish()

    def outcome(self) -> RecordOutcome:
        """Return what became of it, once the file is closed."""
        return RecordOutcome(
            file=self._options.file,
            counts=self._file.counts(),
            file_bytes=self._options.file.stat().st_size,
            skipped=self._follower.skipped,
            missed=self._inbox.missed(),
            dropped=self._file.dropped + self._clock.dropped,
        )

    def _pass_on(self, messages: Sequence[Received]) -> bool:
        """Give messages to the file; return whether there were any."""
        if messages:
            self._put(self._clock.stamp(messages))
        return bool(messages)

    def _put(self, messages: Iterator[Stamped]) -> None:
        """Give the file what it is to hold: not a /clock that only tells the time."""
        self._file.put([m for m in messages if self._options.is_selected(m.topic)])

    def _is_over(self) -> bool:
        now_ns = self._clock.now_ns()
        if self._options.duration_s is None or not self._is_ready or now_ns is None:
            return False
        if self._started_ns is None:
            self._started_ns = now_ns
        return now_ns - self._started_ns >= seconds_to_ns(self._options.duration_s)
