"""Reads a live recording: a record for each loop of the clock, then the grids of each."""

import heapq
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Final

from are_ros.bag.recording import PREFIX, RecordingFiles
from are_ros.conventions import NS_PER_S
from are_ros.errors import AreError
from are_ros.parameters.model import Parameters
from are_ros.replay._bag_errors import sentence_of
from are_ros.replay._check_chronology import Chronology, Moment, stamp_of
from are_ros.replay._check_intake import ARTEFACTS, GRID_TOPICS, MARKERS, Intake
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import Tally, at_s
from are_ros.replay._check_runs import part_farewells, runs_of
from are_ros.replay._check_scene import time_ns
from are_ros.replay._check_stream import LiveStream, StreamMessage

_LATCHED: Final = ("/map", "/tf_static")
_PAST_NS: Final = 2 * NS_PER_S

_REORDER_NS: Final = NS_PER_S


class LiveReading:
    """A context manager, open inside `with`; what is wrong with the file is counted in `tally`."""

    def __init__(
        self, files: RecordingFiles, parameters: Parameters | None, progress: Callable[[], None]
    ) -> None:
        self.tally = Tally("rosbags reader", "message")
        self.records: list[Record] = []
        self._stream = LiveStream(files)
        self._parameters = parameters
        self._progress = progress
        self._chronology = Chronology()
        self._intakes: list[Intake] = []
        self.is_open = False

    def __enter__(self) -> "LiveReading":  # noqa: PYI034 (Self came with Python 3.11)
        """Open the recording; one that cannot be opened holds no messages."""
        with self._faults():
            self._stream.__enter__()
            self.is_open = True
            self._chronology = self._stream.chronology()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stream.__exit__(kind, error, trace)

    @property
    def topics(self) -> set[str]:
        """The topics that matter."""
        return set(self._stream.types)

    def read_all_but_grids(self) -> None:
        """Fill `records`, one for each loop, and at least one."""
        for _ in range(self._chronology.loops):
            self._begin()
        for message in self._messages():
            if message.topic not in GRID_TOPICS:
                self._read(message)
        for record in self.records:
            _settle(record)

    def grids(self, loop: int) -> Iterator[tuple[str, int, Any]]:
        """Yield topic, time and message of the grids that went out in a loop, in their order."""
        waiting: list[tuple[int, int, str, Any]] = []
        for message in self._messages():
            if message.topic not in GRID_TOPICS:
                continue
            moment = self._moment(message)
            content = self._deserialized(message) if moment.loop == loop else None
            if content is None:
                continue
            at_ns = _own_time(stamp_of(message.type_name, message.data), moment)
            heapq.heappush(waiting, (at_ns, message.place, message.topic, content))
            while waiting[0][0] < at_ns - _REORDER_NS:
                yield _popped(waiting)
        while waiting:
            yield _popped(waiting)

    def _messages(self) -> Iterator[StreamMessage]:
        """Yield the messages; a fault of the file ends it."""
        with self._faults():
            if self.is_open:
                yield from self._stream.messages()

    def _begin(self) -> None:
        """Begin the record of a loop."""
        record = Record(self._parameters, is_live=True)
        record.topics |= self.topics
        self.records.append(record)
        self._intakes.append(Intake(record, self.tally))

    def _read(self, message: StreamMessage) -> None:
        moment = self._moment(message)
        content = self._content(message, moment)
        self._progress()
        if content is None:
            return
        first = moment.loop  # what is latched is known from the beginning of each later loop, too
        last = len(self.records) - 1 if message.topic in _LATCHED else first
        for number in range(first, last + 1):
            tick_ns = moment.tick_ns if number == first else 0
            self._take(self._intakes[number], message, tick_ns, content)

    def _take(self, intake: Intake, message: StreamMessage, tick_ns: int, content: Any) -> None:
        at_ns = tick_ns
        if message.topic.startswith(PREFIX) and message.type_name.startswith("are_msgs/"):
            at_ns = time_ns(content.header.stamp)
            # Once the clock has jumped back, log times stand still: they tell nothing then.
            if message.topic == ARTEFACTS and intake is self._intakes[0]:
                intake.record.lags_ns.append(message.log_ns - at_ns)
        intake.take(message.topic, message.type_name, at_ns, content)

    def _moment(self, message: StreamMessage) -> Moment:
        is_latched = message.topic in _LATCHED
        stamp_ns = None if is_latched else stamp_of(message.type_name, message.data)
        return self._chronology.moment(message.place, stamp_ns)

    def _content(self, message: StreamMessage, moment: Moment) -> Any:
        if message.topic != MARKERS:
            return self._deserialized(message)
        at_ns = _own_time(stamp_of(message.type_name, message.data), moment)
        try:
            if self._intakes[moment.loop].take_markers(at_ns, message.data):
                return self._deserialized(message)
        except ValueError as cause:
            self.tally.fail(f"{message.topic} {at_s(at_ns)}: {cause}")
        self.tally.look()
        return None

    def _deserialized(self, message: StreamMessage) -> Any:
        self.tally.look()
        try:
            return self._stream.deserialize(message)
        except Exception as cause:  # noqa: BLE001 - the codecs raise all kinds on bad bytes
            where = f"{message.topic} logged {at_s(message.log_ns)}"
            self.tally.fail(f"{where}: {sentence_of(cause)}")
            return None

    @contextmanager
    def _faults(self) -> Iterator[None]:
        """Count what the reader raises as a fault of the file."""
        try:
            yield
        except AreError as cause:
            self.tally.look()
            self.tally.fail(str(cause))
        except Exception as cause:  # noqa: BLE001 - the reader raises all kinds on bad bytes
            self.tally.look()
            self.tally.fail(sentence_of(cause))


def _own_time(stamp_ns: int | None, moment: Moment) -> int:
    """Return a stamp; where it is long past, as a relayed map's, the time of the tick before."""
    if stamp_ns is None or stamp_ns < moment.tick_ns - _PAST_NS:
        return moment.tick_ns
    return stamp_ns


def _popped(waiting: list[tuple[int, int, str, Any]]) -> tuple[str, int, Any]:
    at_ns, _, topic, content = heapq.heappop(waiting)
    return topic, at_ns, content


def _settle(record: Record) -> None:
    """Part the ticks from farewells, and find the runs of them."""
    record.events.sort(key=lambda entry: entry[0])
    record.shows.sort(key=lambda show: show.log_ns)
    period_ns = record.period_ns
    record.scenes, record.farewells_ns = part_farewells(record.scenes, period_ns)
    stamps = [scene.stamp_ns for scene in record.scenes]
    record.runs = runs_of(stamps, period_ns, record.farewells_ns)
    ticks = frozenset(stamps)
    for messages in (record.perceived, record.metrics):
        kept, last = _part_last(messages, ticks, record.farewells_ns)
        record.last_words += last
        messages[:] = kept


def _part_last(
    messages: list[tuple[int, Any]], ticks: frozenset[int], farewells_ns: list[int]
) -> tuple[list[tuple[int, Any]], list[tuple[int, Any]]]:
    """Part what ticks gave out from what farewells did, also at the time of the tick before."""
    kept: list[tuple[int, Any]] = []
    last: list[tuple[int, Any]] = []
    for at_ns, message in messages:
        is_again = bool(kept) and kept[-1][0] == at_ns
        is_last = at_ns in farewells_ns and (is_again or at_ns not in ticks)
        (last if is_last else kept).append((at_ns, message))
    return kept, last
