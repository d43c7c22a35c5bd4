"""The messages of a live recording that matter to the checks, in the order of the file."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from mcap.reader import make_reader

from are_ros.bag.recording import RecordingFiles
from are_ros.replay._bag_files import open_reader
from are_ros.replay._bag_types import BagTypes
from are_ros.replay._check_chronology import Chronology, stamp_of
from are_ros.replay._check_file import OUTPUT_TYPES, PREFIX
from are_ros.replay._check_intake import ARTEFACTS, INPUT_TYPES


class StreamMessage(NamedTuple):
    """A message with its place in the recording: the how manieth of those that matter."""

    place: int
    topic: str
    type_name: str
    log_ns: int
    data: bytes


class LiveStream:
    """Reads a recording any number of times; a context manager, open inside `with`.

    Raises whatever the readers raise on damaged files.
    """

    def __init__(self, files: RecordingFiles) -> None:
        self._files = files
        self._stack = ExitStack()
        self._reader: Any = None
        self._stores = BagTypes(is_ros1=False)
        self._connections: dict[str, Any] = {}
        self.types: dict[str, str] = {}

    def __enter__(self) -> "LiveStream":  # noqa: PYI034 (Self came with Python 3.11)
        self._reader = self._stack.enter_context(open_reader(self._files.path))
        wanted = (c for c in self._reader.connections if _matters(c.topic, c.msgtype))
        self._connections = {connection.topic: connection for connection in wanted}
        self.types = {topic: each.msgtype for topic, each in self._connections.items()}
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.close()

    def messages(self) -> Iterator[StreamMessage]:
        """Yield all that matter; databases in the order of log time."""
        raw = self._of_mcap() if self._files.files[0].suffix == ".mcap" else self._of_database()
        for place, (topic, log_ns, data) in enumerate(raw):
            yield StreamMessage(place, topic, self.types[topic], log_ns, data)

    def chronology(self) -> Chronology:
        """Read the ticks."""
        chronology = Chronology()
        for message in self.messages():
            if message.topic == ARTEFACTS:
                stamp_ns = stamp_of(message.type_name, message.data)
                if stamp_ns is not None:
                    chronology.add_tick(message.place, stamp_ns)
        return chronology

    def deserialize(self, message: StreamMessage) -> Any:
        """Return the message object; an odd type of another topic does no harm."""
        store = self._stores.store_of(self._connections[message.topic])
        return store.deserialize_cdr(message.data, message.type_name)

    def _of_mcap(self) -> Iterator[tuple[str, int, bytes]]:
        for file in self._files.files:
            yield from _of_file(file, [*self.types])

    def _of_database(self) -> Iterator[tuple[str, int, bytes]]:
        wanted = [c for c in self._reader.connections if c.topic in self.types]
        if wanted:  # rosbags would take none as all
            for connection, log_ns, data in self._reader.messages(connections=wanted):
                yield connection.topic, log_ns, data


def _of_file(file: Path, topics: list[str]) -> Iterator[tuple[str, int, bytes]]:
    with file.open("rb") as stream:
        reader = make_reader(stream)
        for _, channel, message in reader.iter_messages(topics, log_time_order=False):
            yield channel.topic, message.log_time, message.data


def _matters(topic: str, type_name: str) -> bool:
    if topic.startswith(PREFIX):
        name = topic.removeprefix(PREFIX)
        return OUTPUT_TYPES.get(name, "sensor_msgs/msg/LaserScan") == type_name
    return type_name in INPUT_TYPES
