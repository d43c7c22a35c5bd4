"""A replay: the inputs of a recording through the builder, tick by tick."""

from collections.abc import Iterator, Sequence
from contextlib import suppress

from are_ros.bag.reader import BagMessage, BagReader
from are_ros.bag.stretches import Span
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.sensors.sensor_path import ReleasedReading
from are_ros.builder.tick import Tick, TickSchedule
from are_ros.errors import InputError
from are_ros.messages.feed import Feed
from are_ros.replay.progress import Progress, Stopwatch
from are_ros.replay.timeline import FED_BEFORE_START, ReplayOptions, Timeline


class Listener:
    """Takes the outputs of a replay, in their order; this base class ignores them."""

    def take_tick(self, tick: Tick) -> None:
        """Take a tick."""

    def take_readings(self, readings: Sequence[ReleasedReading]) -> None:
        """Take readings that the sensor path has released."""

    def take_input(self, message: BagMessage, received_ns: int) -> None:
        """Take an input, after the builder did."""


class Replay:
    """Runs one builder over the spans of a recording's timeline, by its `clock`.

    Ticks run at the multiples of the tick period since the epoch, each with the messages received
    before it. Maps and transforms from before a span count as received at its beginning, and so do
    static transforms that come for the first time later: they hold for the whole recording. Gaps
    between spans are skipped; all artefacts depart before each gap.
    """

    def __init__(
        self,
        reader: BagReader,
        builder: ArBuilder,
        options: ReplayOptions,
        timeline: Timeline,
        stopwatch: Stopwatch,
    ) -> None:
        self.role_of_topic = timeline.role_of_topic
        self.clock = timeline.clock
        self._spans = timeline.stretches.spans
        self.start_ns = self.clock.at(self._spans[0][0])
        self.end_ns = self.clock.at(self._spans[-1][1])
        self.feed = Feed(reader, builder, self.role_of_topic)
        self.ticks = 0
        self._listeners: tuple[Listener, ...] = ()
        self._skipped_ns = 0
        self._reader = reader
        self._builder = builder
        self._stopwatch = stopwatch
        self._tick_rate_hz = options.parameters.builder.tick_rate
        self._schedule = TickSchedule.of(self._tick_rate_hz, self.start_ns)

    @property
    def length_ns(self) -> int:
        """The length by the clock, without the gaps."""
        return sum(self.clock.at(stop) - self.clock.at(start) for start, stop in self._spans)

    def run(self, listeners: Sequence[Listener], progress: Progress) -> None:
        """Run to the end; the listeners are called in their order.

        `progress` gets the time reached, without the gaps.
        """
        self._listeners = tuple(listeners)
        before_ns = self._reader.start_ns
        for index, span in enumerate(self._spans):
            if index:
                self._skip_gap(self.clock.at(before_ns), self.clock.at(span[0]))
            self._run_span(before_ns, span, progress)
            before_ns = span[1]
        progress(self.end_ns - self._skipped_ns)

    def _skip_gap(self, from_ns: int, to_ns: int) -> None:
        """Continue after a gap as with a new recording."""
        self._builder.interrupt(from_ns, to_ns)
        self._schedule = TickSchedule.of(self._tick_rate_hz, to_ns)
        self._skipped_ns += to_ns - from_ns

    def _run_span(self, before_ns: int, span: Span, progress: Progress) -> None:
        start_ns, end_ns = self.clock.at(span[0]), self.clock.at(span[1])
        for message in self._messages(before_ns, span):
            received_ns = max(self.clock.at(message.log_time_ns), start_ns)
            self._run_ticks(received_ns)
            self.feed.take(message, received_ns)
            for listener in self._listeners:
                listener.take_input(message, received_ns)
            self._hand_over_readings()
            progress(received_ns - self._skipped_ns)
        self._run_ticks(end_ns - 1)
        self._builder.finish(end_ns)
        self._hand_over_readings()

    def _messages(self, before_ns: int, span: Span) -> Iterator[BagMessage]:
        """Yield late static transforms, what came before the span, then the span's messages."""
        if span == self._spans[0]:
            yield from self._late_static(span[0])
        if span[0] > before_ns:
            early = [t for t, role in self.role_of_topic.items() if role in FED_BEFORE_START]
            yield from self._reader.messages(early, before_ns, span[0])
        yield from self._reader.messages(list(self.role_of_topic), *span)

    def _late_static(self, start_ns: int) -> list[BagMessage]:
        """Return the messages after a time that first place a frame for good, the last one first.

        So where several place one frame, the first stands at the end.
        """
        topics = [topic for topic, role in self.role_of_topic.items() if role == "tf_static"]
        known: set[str] = set()
        late: list[BagMessage] = []
        for message in self._reader.messages(topics) if topics else ():
            with suppress(InputError):  # the feed counts it when its time comes
                children = {one.child for one in self._reader.transforms(message)}
                if message.log_time_ns > start_ns and children - known:
                    late.append(message._replace(log_time_ns=start_ns))
                known |= children
        return late[::-1]

    def _run_ticks(self, until_ns: int) -> None:
        while (tick_ns := self._schedule.pop(until_ns)) is not None:
            with self._stopwatch.tick():
                tick = self._builder.step(tick_ns)
            for listener in self._listeners:
                listener.take_tick(tick)
            self._hand_over_readings()
            self.ticks += 1

    def _hand_over_readings(self) -> None:
        if readings := self._builder.take_readings():
            for listener in self._listeners:
                listener.take_readings(readings)
