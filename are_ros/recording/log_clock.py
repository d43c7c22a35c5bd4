"""When a message was recorded: by the wall clock, or by the simulated time of /clock."""

import struct
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Final, Protocol

from are_ros.conventions import NS_PER_S
from are_ros.recording.live_messages import Received, Stamped

CLOCK_TOPIC: Final = "/clock"
CLOCK_TYPE: Final = "rosgraph_msgs/msg/Clock"

_MOST_WAITING_BYTES = 256 * 1024 * 1024
"""What waits for the first /clock at most."""


class LogClock(Protocol):
    """What gives messages their log time; `dropped` are those that waited for it in vain."""

    dropped: Counter[str]

    def now_ns(self) -> int | None:
        """Return a time by which to measure the length of a recording; None before it runs."""

    def stamp(self, messages: Sequence[Received]) -> Iterator[Stamped]:
        """Yield messages that came in this order with their log times, some of them later."""

    def rest(self) -> Iterator[Stamped]:
        """Yield what still waits when the recording ends."""


class WallClock:
    """Log time is when the middleware received a message, publish time when it was sent."""

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()

    def now_ns(self) -> int:
        """Return a time that never jumps."""
        return time.monotonic_ns()

    def stamp(self, messages: Sequence[Received]) -> Iterator[Stamped]:
        """Yield all messages at once."""
        for message in messages:
            yield Stamped(message.topic, message.received_ns, message.published_ns, message.data)

    def rest(self) -> Iterator[Stamped]:
        """Yield nothing: nothing waits."""
        return iter(())


class SimulatedClock:
    """Log time is the last /clock before a message, and never decreases.

    What comes before the first /clock waits in memory and then counts as then. If the clock jumps
    back, log times stay where they are until it has caught up, so that a reader gets the messages
    in the order in which they came; that is said once.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._now_ns: int | None = None
        self._last_ns = 0
        self._waiting: list[Received] = []
        self._waiting_bytes = 0
        self._has_jumped = False
        self.dropped: Counter[str] = Counter()

    def now_ns(self) -> int | None:
        """Return the log time reached, None before the first /clock."""
        return self._now_ns

    def stamp(self, messages: Sequence[Received]) -> Iterator[Stamped]:
        """Yield the messages from the first /clock on; those before it just then."""
        for message in messages:
            if message.topic == CLOCK_TOPIC:
                self._move(_clock_of(message.data))
            if self._now_ns is None:
                self._wait(message)
                continue
            if self._waiting:
                yield from self._release(self._now_ns)
            yield _at(self._now_ns, message)

    def rest(self) -> Iterator[Stamped]:
        """Yield at time 0 what waits for a clock that never came, which is said."""
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

    def _wait(self, message: Received) -> None:
        if self._waiting_bytes + len(message.data) > _MOST_WAITING_BYTES:
            self.dropped[message.topic] += 1
            return
        self._waiting.append(message)
        self._waiting_bytes += len(message.data)

    def _release(self, log_time_ns: int) -> Iterator[Stamped]:
        waiting, self._waiting, self._waiting_bytes = self._waiting, [], 0
        return (_at(log_time_ns, message) for message in waiting)


def _at(log_time_ns: int, message: Received) -> Stamped:
    """Stamp with simulated time; the wall clock's time of sending would be of another kind."""
    return Stamped(message.topic, log_time_ns, log_time_ns, message.data)


def _clock_of(data: bytes) -> int:
    """Return the time [ns] in a serialised rosgraph_msgs/Clock."""
    is_little = data[1] & 1
    seconds, nanoseconds = struct.unpack_from("<iI" if is_little else ">iI", data, 4)
    return int(seconds) * NS_PER_S + int(nanoseconds)
