"""Recordings of ROS 1 and ROS 2: their topics, and their messages in order of time."""

import heapq
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from struct import error as StructError  # noqa: N812
from types import TracebackType
from typing import Any, NamedTuple

from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError, InputError
from are_ros.messages.odometry import OdometryNumbers, read_odometry_numbers
from are_ros.messages.transform_decoding import (
    decode_transforms_cdr,
    decode_transforms_ros1,
    is_plain_cdr,
)
from are_ros.messages.transforms import StampedTransform, read_transforms
from are_ros.replay._bag_errors import as_bag_errors, sentence_of
from are_ros.replay._bag_files import check_paths, open_reader
from are_ros.replay._bag_types import BagTypes

_REORDER_NS = NS_PER_S
"""Parts of a split recording overlap by less than this."""


@dataclass(frozen=True)
class BagTopic:
    """A topic of a recording: `type_name` as "sensor_msgs/msg/LaserScan", in ROS 1 too.

    `is_latched`: a late subscriber gets the last message (transient local, latched).
    `is_reliable`: some publisher of it was, as all are in ROS 1.
    A topic that was recorded with two types appears twice.
    """

    name: str
    type_name: str
    count: int
    is_latched: bool
    is_reliable: bool = True


class BagMessage(NamedTuple):
    """One message as it was recorded; `BagReader.deserialize` makes an object of its bytes."""

    topic: str
    log_time_ns: int
    data: bytes
    connection: Any


class BagReader:
    """One or several recordings as one stream; a context manager, open inside `with`.

    Takes rosbag2 folders, .mcap and .db3 files, or ROS 1 .bag files, not mixed. BagError, in a
    sentence, for whatever is wrong with one of them: on entering, or later while reading.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = tuple(paths)
        self._stack = ExitStack()
        self._readers: list[tuple[Path, Any]] = []
        self.is_ros1 = check_paths(self._paths)
        self._types = BagTypes(is_ros1=self.is_ros1)

    def __enter__(self) -> "BagReader":  # noqa: PYI034 (Self came with Python 3.11)
        """Open the recordings; BagError if one cannot be read or none holds a message."""
        with ExitStack() as stack:
            self._readers = [(path, stack.enter_context(open_reader(path))) for path in self._paths]
            if not any(reader.message_count for _, reader in self._readers):
                raise BagError(f"{_names(self._paths)}: the recording holds no message")
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._readers = []
        self._stack.close()

    @property
    def start_ns(self) -> int:
        """Log time of the first message."""
        return min(int(reader.start_time) for _, reader in self._readers)

    @property
    def end_ns(self) -> int:
        """Just after the log time of the last message: messages lie in [start_ns, end_ns)."""
        return max(int(reader.end_time) for _, reader in self._readers)

    @property
    def files(self) -> tuple[tuple[str, int, int], ...]:
        """The recordings by name, each with its [start, end) of log time, in order of time."""
        files = [(p.name, int(r.start_time), int(r.end_time)) for p, r in self._readers]
        return tuple(sorted(files, key=itemgetter(1)))

    @property
    def topics(self) -> tuple[BagTopic, ...]:
        """The topics, in order of name, counted over all recordings."""
        found: dict[tuple[str, str], BagTopic] = {}
        for connection in self._connections():
            key = (connection.topic, connection.msgtype)
            count, latched = connection.msgcount, _is_latched(connection)
            reliable = _is_reliable(connection)
            if key in found:
                count, latched = count + found[key].count, latched or found[key].is_latched
                reliable = reliable or found[key].is_reliable
            found[key] = BagTopic(*key, count, latched, reliable)
        return tuple(found[key] for key in sorted(found))

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        stop_ns: int | None = None,
    ) -> Iterator[BagMessage]:
        """Yield the messages of `topics` (None: all) with log times in [start_ns, stop_ns).

        In order of log time, whatever the number of recordings. BagError if one is damaged.
        """
        streams = [
            self._stream(path, reader, topics, start_ns, stop_ns) for path, reader in self._readers
        ]
        yield from heapq.merge(*streams, key=_log_time) if len(streams) > 1 else streams[0]

    def learn_types(self, topics: Collection[str]) -> None:
        """Make ready to deserialise the messages of some topics, which the first would else do.

        A type that cannot be understood is left to the first message.
        """
        for connection in self._connections():
            if connection.topic in topics:
                with suppress(BagError):
                    self._types.store_of(connection)

    def deserialize(self, message: BagMessage) -> Any:
        """Return the message object, its arrays numpy arrays.

        BagError if the recording does not say what the type is, InputError for malformed bytes.
        """
        connection = message.connection
        store = self._types.store_of(connection)
        try:
            if self.is_ros1:
                return store.deserialize_ros1(message.data, connection.msgtype)
            return store.deserialize_cdr(message.data, connection.msgtype)
        except Exception as cause:
            raise _malformed(message, cause) from cause

    def transforms(self, message: BagMessage) -> list[StampedTransform]:
        """Return the transforms of a TFMessage; as `deserialize` and `read_transforms`, quicker."""
        try:
            if self.is_ros1:
                return decode_transforms_ros1(message.data)
            if is_plain_cdr(message.data):
                return decode_transforms_cdr(message.data)
        except (StructError, UnicodeDecodeError) as cause:
            raise _malformed(message, cause) from cause
        return read_transforms(self.deserialize(message))

    def odometry(self, message: BagMessage) -> OdometryNumbers:
        """Return the numbers of an Odometry; errors as `deserialize`."""
        return read_odometry_numbers(self.deserialize(message))

    def _connections(self) -> Iterator[Any]:
        for _, reader in self._readers:
            yield from reader.connections

    def _stream(
        self,
        path: Path,
        reader: Any,
        topics: Collection[str] | None,
        start_ns: int | None,
        stop_ns: int | None,
    ) -> Iterator[BagMessage]:
        """Yield the messages of one recording."""
        wanted = [c for c in reader.connections if topics is None or c.topic in topics]
        if not wanted:
            return
        with as_bag_errors(str(path)):
            stream = (
                BagMessage(connection.topic, log_time_ns, data, connection)
                for connection, log_time_ns, data in reader.messages(
                    connections=wanted, start=start_ns, stop=stop_ns
                )
            )
            is_split = len(getattr(getattr(reader, "storage", None), "storages", ())) > 1
            yield from _in_order(stream, _REORDER_NS) if is_split else stream


def _in_order(messages: Iterator[BagMessage], window_ns: int) -> Iterator[BagMessage]:
    """Sort a stream that goes back in time by less than `window_ns`; ties keep their order."""
    waiting: list[tuple[int, int, BagMessage]] = []
    for number, message in enumerate(messages):
        heapq.heappush(waiting, (message.log_time_ns, number, message))
        while waiting[0][0] <= message.log_time_ns - window_ns:
            yield heapq.heappop(waiting)[2]
    while waiting:
        yield heapq.heappop(waiting)[2]


def _log_time(message: BagMessage) -> int:
    return message.log_time_ns


def _is_latched(connection: Any) -> bool:
    profiles = getattr(connection.ext, "offered_qos_profiles", None)
    if profiles is None:
        return bool(connection.ext.latching)
    return any(profile.durability.name == "TRANSIENT_LOCAL" for profile in profiles)


def _is_reliable(connection: Any) -> bool:
    profiles = getattr(connection.ext, "offered_qos_profiles", None)
    return not profiles or any(profile.reliability.name == "RELIABLE" for profile in profiles)


def _malformed(message: BagMessage, cause: Exception) -> InputError:
    kind = message.connection.msgtype
    text = f"{message.topic}: the message at {message.log_time_ns} ns is no {kind}"
    return InputError(f"{text}, {sentence_of(cause)}")


def _names(paths: Sequence[Path]) -> str:
    return ", ".join(path.name for path in paths)
