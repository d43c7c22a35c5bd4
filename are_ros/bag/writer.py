"""Writes recordings: MCAP files that ROS 2, Foxglove and rosbags open."""

import fcntl
import os
from collections import deque
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from io import BufferedWriter
from pathlib import Path
from typing import Any, Final

from mcap.writer import CompressionType, Writer

from are_ros._version import __version__
from are_ros.bag.types import jazzy_typestore
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError

# The quality of service of publishers, as rosbag2 writes it beside a recorded topic.


FOREVER_NS: Final = 2**63 - 1
"""A deadline, lifespan or lease that never ends, in the middleware and in recordings."""

_PROFILE = """\
- history: {of.history}
  depth: {of.depth}
  reliability: {of.reliability}
  durability: {of.durability}
  deadline: {deadline}
  lifespan: {lifespan}
  liveliness: {of.liveliness}
  liveliness_lease_duration: {lease}
  avoid_ros_namespace_conventions: false
"""


@dataclass(frozen=True)
class OfferedQos:
    """The profile of one publisher, in the words of rosbag2; times in nanoseconds.

    DDS announces neither history nor depth: these are "unknown" and 0 for live publishers.
    """

    reliability: str = "reliable"
    durability: str = "volatile"
    history: str = "keep_last"
    depth: int = 10
    deadline_ns: int = FOREVER_NS
    lifespan_ns: int = FOREVER_NS
    liveliness: str = "automatic"
    lease_ns: int = FOREVER_NS


def qos_text(profiles: Sequence[OfferedQos]) -> str:
    """Return the YAML list of profiles, one for each publisher."""
    return "".join(
        _PROFILE.format(
            of=profile,
            deadline=_duration_text(profile.deadline_ns),
            lifespan=_duration_text(profile.lifespan_ns),
            lease=_duration_text(profile.lease_ns),
        )
        for profile in profiles
    )


def _duration_text(duration_ns: int) -> str:
    seconds, rest_ns = divmod(duration_ns, NS_PER_S)
    return f"{{sec: {seconds}, nsec: {rest_ns}}}"


NOTES: Final = "are_ros"
"""The name of the metadata record with the notes."""

_CHUNK_BYTES = 4 * 1024 * 1024
"""A chunk holds several maps, which are alike and compress well together."""

_BATCH_BYTES = 2 * 1024 * 1024
"""Messages are handed over to the thread that compresses and writes when they are so many."""

_MOST_BATCHES = 4
"""So many batches may wait for the thread: large maps come at once, and then few for a while."""

_Message = tuple[int, int, bytes | memoryview, int, int]
"""Its channel, log time, data, publish time, and number in the channel."""


@dataclass(eq=False)
class _Channel:
    identifier: int
    type_name: str
    count: int = 0


class BagWriter:
    """Writes one MCAP file of ROS 2 messages; a context manager.

    The file appears under its name only when the block ends without an exception; until then it
    is `<name>.part`, which a failed run removes unless it `keeps_partial`, and which one process
    writes at a time. The same calls give the
    same bytes: no clock, no path and no order but that of the calls enters the file. BagError if it
    cannot be written. A thread of its own compresses and writes, so an error may come some messages
    late.
    """

    def __init__(
        self,
        path: Path,
        typestore: Any = None,
        *,
        notes: Mapping[str, str] | None = None,
        keeps_partial: bool = False,
        outdates: Sequence[Path] = (),
    ) -> None:
        """Prepare to write `path`; types come from `typestore` (`jazzy_typestore()`).

        `notes` are written at the beginning, where also an unfinished file shows them. The files
        that it `outdates` are removed just before the recording appears, so that they are never
        beside one that they do not belong to, wherever the process is killed.
        """
        self._path = path
        self._partial = partial_path(path)
        self._notes = notes
        self._outdates = tuple(outdates)
        self._is_finished = False
        self._keeps_partial = keeps_partial
        self._store = jazzy_typestore() if typestore is None else typestore
        self._channels: dict[str, _Channel] = {}
        self._schemas: dict[str, int] = {}
        self._file: BufferedWriter
        self._locked: int
        self._writer: Writer
        self._batch: list[_Message] = []
        self._batch_bytes = 0
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="bag writer")
        self._handed_over: deque[Future[None]] = deque()

    def __enter__(self) -> "BagWriter":  # noqa: PYI034 (Self came with Python 3.11)
        try:
            self._file = _opened_alone(self._partial)
            self._locked = os.dup(self._file.fileno())  # until the file has its name, or is removed
        except BlockingIOError as cause:
            raise BagError(f"{self._path} cannot be written: another process writes it") from cause
        except OSError as cause:
            raise self._unwritable(cause) from cause
        self._writer = Writer(self._file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library=f"are_ros {__version__}")
        if self._notes:
            self._writer.add_metadata(NOTES, dict(self._notes))
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._finish()
        finally:
            self._close()

    def add_topic(
        self,
        topic: str,
        type_name: str,
        *,
        is_latched: bool = False,
        is_reliable: bool = True,
        depth: int = 10,
        offered: Sequence[OfferedQos] = (),
    ) -> None:
        """Announce a topic and the quality of service that a player is to offer.

        Topics stand in the file in the order of these calls, also those without a message.
        `is_latched`: transient local, late subscribers get the last `depth` messages. In place of
        these, `offered` are the profiles of the publishers that were found.
        """
        self._wait()
        profile = OfferedQos(
            reliability="reliable" if is_reliable else "best_effort",
            durability="transient_local" if is_latched else "volatile",
            depth=depth,
        )
        identifier = self._writer.register_channel(
            topic=topic,
            message_encoding="cdr",
            schema_id=self._schema(type_name),
            metadata={
                "offered_qos_profiles": qos_text(offered or [profile]),
                "topic_type_hash": self._store.hash_rihs01(type_name),
            },
        )
        self._channels[topic] = _Channel(identifier, type_name)

    def write(self, topic: str, log_time_ns: int, message: Any) -> None:
        """Append a rosbags message object to a topic that was added."""
        channel = self._channels[topic]
        self.write_raw(topic, log_time_ns, self._store.serialize_cdr(message, channel.type_name))

    def write_raw(
        self,
        topic: str,
        log_time_ns: int,
        data: bytes | memoryview,
        publish_time_ns: int | None = None,
    ) -> None:
        """Append a message that is serialised already: CDR with its encapsulation header.

        `publish_time_ns` is the log time unless given.
        """
        channel = self._channels[topic]
        published_ns = log_time_ns if publish_time_ns is None else publish_time_ns
        self._batch.append((channel.identifier, log_time_ns, data, published_ns, channel.count))
        self._batch_bytes += len(data)
        channel.count += 1
        if self._batch_bytes > _BATCH_BYTES:
            self._hand_over()

    def flush(self) -> None:
        """Flush all messages to the system, so that they survive a kill."""
        self._wait()
        try:
            self._writer.flush()
        except OSError as cause:
            raise self._unwritable(cause) from cause

    def counts(self) -> dict[str, int]:
        """Return how many messages were written, by topic."""
        return {topic: channel.count for topic, channel in self._channels.items()}

    def _schema(self, type_name: str) -> int:
        """Return the schema of a type, registered when it is first needed."""
        if type_name not in self._schemas:
            text, _ = self._store.generate_msgdef(type_name, ros_version=2)
            self._schemas[type_name] = self._writer.register_schema(
                name=type_name, encoding="ros2msg", data=text.encode()
            )
        return self._schemas[type_name]

    def _hand_over(self) -> None:
        """Have the batch written after those before it, of which `_MOST_BATCHES` may wait."""
        self._join(_MOST_BATCHES - 1)
        before = self._handed_over[-1] if self._handed_over else None
        self._handed_over.append(self._thread.submit(self._write_all, self._batch, before))
        self._batch, self._batch_bytes = [], 0

    def _wait(self) -> None:
        """Wait until all messages are with the writer."""
        if self._batch:
            self._hand_over()
        self._join(0)

    def _join(self, most: int) -> None:
        """Wait until at most so many batches wait; BagError if one could not be written."""
        try:
            while len(self._handed_over) > most:
                self._handed_over.popleft().result()
        except OSError as cause:
            raise self._unwritable(cause) from cause

    def _write_all(self, messages: Sequence[_Message], before: "Future[None] | None") -> None:
        """Write a batch; where the one before it failed, fail likewise, for nothing may lack."""
        if before is not None:
            before.result()
        for channel, log_time_ns, data, published_ns, count in messages:
            self._writer.add_message(channel, log_time_ns, data, published_ns, sequence=count)

    def _finish(self) -> None:
        """Write the index and give the file its name."""
        self._wait()
        try:
            self._writer.finish()
            self._file.close()
            for file in self._outdates:
                file.unlink(missing_ok=True)
            self._partial.replace(self._path)
            self._is_finished = True
        except OSError as cause:
            raise self._unwritable(cause) from cause

    def _close(self) -> None:
        """Close the file, also on a full disk; then others may write one of its name."""
        self._thread.shutdown(cancel_futures=True)
        with suppress(OSError):
            self._file.close()
        if not self._is_finished and not self._keeps_partial:
            with suppress(OSError):
                self._partial.unlink()
        os.close(self._locked)

    def _unwritable(self, cause: OSError) -> BagError:
        return BagError(f"{self._path} cannot be written: {cause.strerror}")


def _opened_alone(path: Path) -> BufferedWriter:
    """Open an empty file to write, and lock it; BlockingIOError if another process has.

    Another process may give the file its name between the opening and the lock: then anew.
    """
    while True:
        file = os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT, 0o666), "wb")
        try:
            lock(file.fileno())
            if _is_at(path, file):
                file.truncate(0)
                return file
        except BaseException:
            file.close()
            raise
        file.close()


def _is_at(path: Path, file: BufferedWriter) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False


def lock(descriptor: int) -> None:
    """Lock an open file or folder until it is closed; BlockingIOError if another process has.

    Where the file system has no locks, nothing happens.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:
        return


def partial_path(path: Path) -> Path:
    """Return the name of a recording that is still being written."""
    return path.with_name(path.name + ".part")
