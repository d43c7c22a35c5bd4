"""Reads a replay's recording with rosbags: every message is deserialised, what matters is kept."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

from rosbags.highlevel import AnyReader

from are_ros.bag.reader import sentence_of
from are_ros.replay._check_intake import GRID_TOPICS, MARKERS, Intake
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import Tally, at_s


class Reading:
    """One pass over all but the grids, a second over these, both counted in `tally`.

    A context manager, open inside `with`.
    """

    def __init__(self, path: Path, record: Record, progress: Callable[[], None]) -> None:
        self.tally = Tally("rosbags reader", "message")
        self.record = record
        self._path = path
        self._progress = progress
        self._intake = Intake(record, self.tally)
        self._reader: AnyReader | None = None

    def __enter__(self) -> "Reading":  # noqa: PYI034 (Self came with Python 3.11)
        """Open the recording; one that cannot be opened is a fault, and holds no messages."""
        with self._faults():
            reader = AnyReader([self._path])
            reader.open()
            self._reader = reader
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._reader is not None:
            self._reader.close()

    def read_all_but_grids(self) -> None:
        """Fill the record."""
        for topic, type_name, log_ns, message in self._messages(wants_grids=False):
            self._intake.take(topic, type_name, log_ns, message)

    def grids(self) -> Iterator[tuple[str, int, Any]]:
        """Yield topic, log time and message of the grids that went out."""
        for topic, _, log_ns, message in self._messages(wants_grids=True):
            yield topic, log_ns, message

    def _messages(self, *, wants_grids: bool) -> Iterator[tuple[str, str, int, Any]]:
        """Yield what can be deserialised; a fault of the file ends it."""
        reader = self._reader
        if reader is None:
            return
        chosen = [c for c in reader.connections if (c.topic in GRID_TOPICS) == wants_grids]
        self.record.topics |= {connection.topic for connection in chosen}
        if not chosen:  # rosbags would take none as all
            return
        with self._faults():
            for connection, log_ns, data in reader.messages(connections=chosen):
                message = self._deserialized(reader, connection, log_ns, data)
                self._progress()
                if message is not None:
                    yield connection.topic, connection.msgtype, log_ns, message

    @contextmanager
    def _faults(self) -> Iterator[None]:
        """Count what the reader raises as a fault of the file."""
        try:
            yield
        except Exception as cause:  # noqa: BLE001 - the reader raises all kinds on bad bytes
            self.tally.look()
            self.tally.fail(sentence_of(cause))

    def _deserialized(self, reader: AnyReader, connection: Any, log_ns: int, data: bytes) -> Any:
        self.tally.look()
        try:
            if connection.topic == MARKERS and not self._intake.take_markers(log_ns, bytes(data)):
                return None
            return reader.deserialize(data, connection.msgtype)
        except Exception as cause:  # noqa: BLE001 - so do its codecs
            self.tally.fail(f"{connection.topic} {at_s(log_ns)}: {sentence_of(cause)}")
            return None
