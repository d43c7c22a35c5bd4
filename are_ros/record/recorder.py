"""`are record`: live topics into an MCAP file, as `ros2 bag record` does."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from are_ros.bag.types import InstalledTypes
from are_ros.bag.writer import BagWriter
from are_ros.conventions import NS_PER_S, seconds_to_ns
from are_ros.node.startup import ros_session
from are_ros.record.file import FileWriter, SimulatedClock, WallClock
from are_ros.record.inbox import Inbox, Stamped
from are_ros.record.topics import RecordOptions, TopicFollower
from are_ros.replay.progress import Say
from are_ros.wording import counted

# The services of a node without an executor.


_MOST_AT_ONCE: Final = 10


class RequestQueue:
    """Takes the requests to all services of a node, and answers them on demand.

    A player in lockstep asks whether all messages from before its request were taken. So a request
    is taken first, then all messages, and then the request is answered.
    """

    def __init__(self, node: Node) -> None:
        self._context = node.context
        self._services = tuple(node.services)
        self._pending: list[tuple[Any, Any, Any]] = []
        """Service, request and header of each request that is not answered yet."""

    def wait(self, timeout_s: float) -> None:
        """Sleep until there is a request, but no longer than this."""
        services = self._services
        with self._context.handle:
            wait_set = rclpy_implementation.WaitSet(
                0, 0, 0, 0, len(services), 0, self._context.handle
            )
            wait_set.clear_entities()
            for service in services:
                wait_set.add_service(service.handle)
            wait_set.wait(int(timeout_s * NS_PER_S))

    def take(self) -> bool:
        """Take the waiting requests; return whether any request is unanswered."""
        for service in self._services:
            for _ in range(_MOST_AT_ONCE):
                content, header = service.handle.service_take_request(service.srv_type.Request)
                if header is None:
                    break
                self._pending.append((service, content, header))
        return bool(self._pending)

    def give(self) -> None:
        """Answer all requests that were taken."""
        pending, self._pending = self._pending, []
        for service, content, header in pending:
            answer = service.callback(content, service.srv_type.Response())
            service.send_response(answer, header)


NODE_NAME: Final = "are_recorder"

_LOOK_S = 0.1
"""How often new topics and publishers are looked for."""

_REST_S = 0.004
"""The pause after an empty look, unless a request comes: 2 % of a core, and no queue fills."""

_NOTES = {
    "what": "live topics, recorded by are record",
    "if_unfinished": "a file named .part was not ended in order: `mcap recover` saves it",
}


@dataclass(frozen=True)
class RecordOutcome:
    """The result of a recording; all mappings are by topic.

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
        """Yield a sentence for each way in which the recording is not complete."""
        if not self.counts:
            yield "nothing is recorded: no message arrived on any topic"
        for topic, count in self.missed.items():
            yield f"{topic}: {counted(count, 'message')} never arrived"
        for topic, count in self.dropped.items():
            yield f"{topic}: {counted(count, 'message')} dropped, the disk was too slow"


def record(
    options: RecordOptions,
    say: Say,
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
    types = InstalledTypes()
    clock = SimulatedClock(say) if options.use_sim_time else WallClock()
    bag = BagWriter(options.path, types.store, notes=_NOTES, keeps_partial=True)
    with ros_session(NODE_NAME, has_services=True) as node, FileWriter(bag) as file:
        inbox = Inbox(node)
        follower = TopicFollower(node, options, types, inbox, file, say)
        recording = _Recording(options, inbox, RequestQueue(node), follower, file, clock)
        recording.run(awaited, on_ready, should_stop)
        recording.finish()
    return recording.outcome()


class _Recording:
    """One recording while it runs."""

    def __init__(
        self,
        options: RecordOptions,
        inbox: Inbox,
        answers: RequestQueue,
        follower: TopicFollower,
        file: FileWriter,
        clock: WallClock,
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
        """Pass on the messages that have arrived until now."""
        end_ns = time.time_ns()
        while self._pass_on([m for m in self._inbox.take_all() if m.log_time_ns <= end_ns]):
            pass
        self._put(self._clock.rest())
        self._follower.finish()

    def outcome(self) -> RecordOutcome:
        """Return the result, once the file is closed."""
        return RecordOutcome(
            file=self._options.path,
            counts=self._file.counts(),
            file_bytes=self._options.path.stat().st_size,
            skipped=self._follower.skipped,
            missed=self._inbox.missed(),
            dropped=self._file.dropped + self._clock.dropped,
        )

    def _pass_on(self, messages: Sequence[Stamped]) -> bool:
        """Give messages to the file; return whether there were any."""
        if messages:
            self._put(self._clock.stamp(messages))
        return bool(messages)

    def _put(self, messages: Iterator[Stamped]) -> None:
        """Write the selected messages; an unselected /clock only gives the time."""
        self._file.put([m for m in messages if self._options.is_selected(m.topic)])

    def _is_over(self) -> bool:
        now_ns = self._clock.now_ns()
        if self._options.duration_s is None or not self._is_ready or now_ns is None:
            return False
        if self._started_ns is None:
            self._started_ns = now_ns
        return now_ns - self._started_ns >= seconds_to_ns(self._options.duration_s)
