"""The file of a recording, written by a thread of its own, so that a slow disk delays nobody."""

import threading
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Final

from are_ros.recording.live_messages import Stamped
from are_ros.replay.bag_writer import BagWriter
from are_ros.replay.offered_qos import OfferedQos

MOST_QUEUED_BYTES: Final = 256 * 1024 * 1024
"""What waits for the disk at most."""

_FLUSH_S = 3.0
"""A killed recording lacks little more than this; shorter would spoil the compression of maps."""


@dataclass(frozen=True)
class Announcement:
    """A topic as it stands in the file: its type, and what its publishers offer."""

    type_name: str
    offered: tuple[OfferedQos, ...]


class FileWriter:
    """Hands messages to a `BagWriter` in a thread; a context manager, as that is.

    A topic enters the file with its first message, or at the end if none came; what its publishers
    were found to offer until then is written. What the disk cannot take in time is dropped beyond
    `most_bytes`, and counted.
    """

    def __init__(self, bag: BagWriter, most_bytes: int = MOST_QUEUED_BYTES) -> None:
        self._bag = bag
        self._most_bytes = most_bytes
        self._queue: SimpleQueue[Sequence[Stamped] | None] = SimpleQueue()
        self._announced: dict[str, Announcement] = {}
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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

    def announce(self, topic: str, announcement: Announcement) -> None:
        """Say what a topic is; again, while it has no message, if that has changed."""
        self._announced[topic] = announcement

    def put(self, messages: Sequence[Stamped]) -> None:
        """Give messages of announced topics to the file; AreError if it can take no more."""
        self.check()
        accepted = [message for message in messages if self._has_room(message)]
        if accepted:
            self._queue.put(accepted)

    def check(self) -> None:
        """Raise what went wrong in the thread."""
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
            announced = self._announced[topic]
            self._bag.add_topic(topic, announced.type_name, offered=announced.offered)
            self._added.add(topic)
