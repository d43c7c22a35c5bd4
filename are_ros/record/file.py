"""The file of a recording, written by its own thread, so that a slow disk delays nothing."""

import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from queue import Empty, SimpleQueue
from typing import Final

from are_ros.bag.clock import CLOCK_TOPIC
from are_ros.bag.reader import stamp_in
from are_ros.bag.writer import BagWriter, OfferedQos
from are_ros.conventions import NS_PER_S
from are_ros.record.inbox import Stamped
from are_ros.replay.progress import Say

MOST_QUEUED_BYTES: Final = 256 * 1024 * 1024
"""The most bytes that may wait for the disk."""

_FLUSH_S = 3.0
"""A killed recording lacks little more than this; shorter would spoil the compression of maps."""


class FileWriter:
    """Hands messages to a `BagWriter` in a thread; a context manager, as that is.

    A topic enters the file with its first message, or at the end if none came, with the QoS that
    its publishers offered until then. When more than `most_bytes` wait for the disk, messages are
    dropped and counted.
    """

    def __init__(self, bag: BagWriter, most_bytes: int = MOST_QUEUED_BYTES) -> None:
        self._bag = bag
        self._most_bytes = most_bytes
        self._queue: SimpleQueue[Sequence[Stamped] | None] = SimpleQueue()
        self._announced: dict[str, tuple[str, tuple[OfferedQos, ...]]] = {}
        self._added: set[str] = set()
        self._queued_bytes = 0
        self._written_bytes = 0
        self._failure: Exception | None = None
        self._stack = ExitStack()
        self._thread = threading.Thread(target=self._run, name="are_recorder_file", daemon=True)
        self.dropped: Counter[str] = Counter()

    def __enter__(self) -> "FileWriter":  # noqa: PYI034 (Self came with Python 3.11)
        self._stack.enter_context(self._bag)
        self._thread.start()
        return self

    def __exit__(self, _: object, error: BaseException | None, *__: object) -> None:
        """Write all that was put, then end the file in order; after an error leave it as it is."""
        self._queue.put(None)
        self._thread.join()
        with self._stack:
            self.check()
            for topic in self._announced:
                self._add(topic)
            if error is not None:
                self._bag.flush()
                raise error

    def announce(self, topic: str, type_name: str, offered: tuple[OfferedQos, ...]) -> None:
        """Announce a topic, or change what its publishers offer until its first message."""
        self._announced[topic] = type_name, offered

    def put(self, messages: Sequence[Stamped]) -> None:
        """Give messages of announced topics to the file; AreError if it can take no more."""
        self.check()
        accepted = [message for message in messages if self._has_room(message)]
        if accepted:
            self._queue.put(accepted)

    def check(self) -> None:
        """Raise the error of the thread, if there was one."""
        if self._failure is not None:
            raise self._failure

    def counts(self) -> Mapping[str, int]:
        """Return how many messages were written, by topic."""
        return self._bag.counts()

    def _has_room(self, message: Stamped) -> bool:
        """Reserve the room of a message; the thread alone writes `_written_bytes`."""
        size = len(message.data)
        if self._queued_bytes - self._written_bytes + size > self._most_bytes:
            self.dropped[message.topic] += 1
            return False
        self._queued_bytes += size
        return True

    def _run(self) -> None:
        try:
            self._write_until_told()
        except Exception as failure:  # noqa: BLE001 - raised again in the caller's thread
            self._failure = failure

    def _write_until_told(self) -> None:
        flushed_s, is_dirty = time.monotonic(), False
        while True:
            try:
                messages = self._queue.get(timeout=_FLUSH_S / 3)
            except Empty:
                messages = ()
            if messages is None:
                return
            self._write(messages)
            is_dirty = is_dirty or bool(messages)
            if is_dirty and time.monotonic() - flushed_s > _FLUSH_S:
                self._bag.flush()
                flushed_s, is_dirty = time.monotonic(), False

    def _write(self, messages: Sequence[Stamped]) -> None:
        for message in messages:
            self._add(message.topic)
            self._bag.write_raw(
                message.topic, message.log_time_ns, message.data, message.publish_time_ns
            )
            self._written_bytes += len(message.data)

    def _add(self, topic: str) -> None:
        if topic not in self._added:
            type_name, offered = self._announced[topic]
            self._bag.add_topic(topic, type_name, offered=offered)
            self._added.add(topic)


# Log times: by the wall clock, or by the simulated time of /clock.


CLOCK_TYPE: Final = "rosgraph_msgs/msg/Clock"

_MOST_WAITING_BYTES = 256 * 1024 * 1024
"""The most bytes that may wait for the first /clock."""


class WallClock:
    """Log time is when the middleware received a message, publish time when it was sent.

    `dropped` counts the messages that got no log time.
    """

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()

    def now_ns(self) -> int | None:
        """Return a time that measures the length of a recording; None before it runs."""
        return time.monotonic_ns()

    def stamp(self, messages: Sequence[Stamped]) -> Iterator[Stamped]:
        """Yield messages in their order of arrival, with log times; some may come later."""
        yield from messages

    def rest(self) -> Iterator[Stamped]:
        """Yield the messages that still wait when the recording ends."""
        return iter(())


class SimulatedClock(WallClock):
    """Log time is the last /clock before a message, and never decreases.

    Messages before the first /clock wait in memory and get its time. If the clock jumps back, log
    times stand still until it has caught up: a reader then gets the messages in their order of
    arrival. One notice is given.
    """

    def __init__(self, say: Say) -> None:
        super().__init__()
        self._say = say
        self._now_ns: int | None = None
        self._last_ns = 0
        self._waiting: list[Stamped] = []
        self._waiting_bytes = 0
        self._has_jumped = False

    def now_ns(self) -> int | None:
        """Return the log time reached, None before the first /clock."""
        return self._now_ns

    def stamp(self, messages: Sequence[Stamped]) -> Iterator[Stamped]:
        """Yield the messages from the first /clock on; those before it just then."""
        for message in messages:
            if message.topic == CLOCK_TOPIC and (clock_ns := stamp_in(message.data)) is not None:
                self._move(clock_ns)
            if self._now_ns is None:
                self._wait(message)
                continue
            if self._waiting:
                yield from self._release(self._now_ns)
            yield _at(self._now_ns, message)

    def rest(self) -> Iterator[Stamped]:
        """Yield the messages that wait for a /clock that never came, at time 0, with a notice."""
        if self._waiting:
            self._say("no /clock came: everything is recorded at time 0")
            yield from self._release(0)

    def _move(self, clock_ns: int) -> None:
        if self._now_ns is not None and clock_ns < self._last_ns:
            self._say_jump(self._last_ns - clock_ns, self._now_ns)
        self._last_ns = clock_ns
        self._now_ns = max(clock_ns, self._now_ns or 0)

    def _say_jump(self, back_ns: int, now_ns: int) -> None:
        if not self._has_jumped:
            self._has_jumped = True
            self._say(
                f"/clock went back by {back_ns / NS_PER_S:.3f} s: log times stay at"
                f" {now_ns / NS_PER_S:.3f} s until it has caught up"
            )

    def _wait(self, message: Stamped) -> None:
        if self._waiting_bytes + len(message.data) > _MOST_WAITING_BYTES:
            self.dropped[message.topic] += 1
            return
        self._waiting.append(message)
        self._waiting_bytes += len(message.data)

    def _release(self, log_time_ns: int) -> Iterator[Stamped]:
        waiting, self._waiting, self._waiting_bytes = self._waiting, [], 0
        return (_at(log_time_ns, message) for message in waiting)


def _at(log_time_ns: int, message: Stamped) -> Stamped:
    """Stamp with simulated time; the wall clock's time of sending would be of another kind."""
    return message._replace(log_time_ns=log_time_ns, publish_time_ns=log_time_ns)
