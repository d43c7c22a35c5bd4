"""The log times of a recording."""

import struct
from collections.abc import Iterable

import pytest

from are_ros.bag.clock import CLOCK_TOPIC
from are_ros.record import file as log_clock
from are_ros.record.file import SimulatedClock, WallClock
from are_ros.record.inbox import Stamped


def silent(_: str) -> None:
    """Take a sentence that the test does not look at."""


def text(data: bytes, received_ns: int = 5) -> Stamped:
    """Return a message that was sent two nanoseconds before it arrived."""
    return Stamped("/x", received_ns, received_ns - 2, data)


def clock(seconds: int, nanoseconds: int = 0, order: str = "<") -> Stamped:
    """Return a serialised /clock."""
    header = b"\x00\x01\x00\x00" if order == "<" else b"\x00\x00\x00\x00"
    return Stamped(CLOCK_TOPIC, 5, 3, header + struct.pack(f"{order}iI", seconds, nanoseconds))


def times(stamped: Iterable[Stamped]) -> list[tuple[bytes, int]]:
    """Return the log times in milliseconds of what is not the clock."""
    return [(m.data, m.log_time_ns // 10**6) for m in stamped if m.topic != CLOCK_TOPIC]


def test_the_wall_clock_keeps_arrival_and_sending_apart() -> None:
    """Log time is the arrival, publish time the sending."""
    assert list(WallClock().stamp([text(b"a", 7)])) == [("/x", 7, 5, b"a")]
    assert list(WallClock().rest()) == []


def test_messages_have_the_time_of_the_clock_before_them() -> None:
    """In either byte order; publish time is the log time, for the wall's is of another kind."""
    simulated = SimulatedClock(silent)
    batch = [clock(1), text(b"a"), clock(2, 5 * 10**8, ">"), text(b"b")]
    stamped = list(simulated.stamp(batch))
    assert times(stamped) == [(b"a", 1000), (b"b", 2500)]
    assert {m.publish_time_ns - m.log_time_ns for m in stamped} == {0}
    assert [m.log_time_ns for m in stamped if m.topic == CLOCK_TOPIC] == [10**9, 2_500_000_000]
    assert simulated.now_ns() == 2_500_000_000


def test_messages_before_the_first_clock_wait_for_it() -> None:
    """They count as of the first /clock, in their order, and before it."""
    simulated = SimulatedClock(silent)
    assert list(simulated.stamp([text(b"a"), text(b"b")])) == []
    assert simulated.now_ns() is None
    stamped = list(simulated.stamp([text(b"c"), clock(3), text(b"d")]))
    assert times(stamped) == [(b"a", 3000), (b"b", 3000), (b"c", 3000), (b"d", 3000)]
    assert stamped[3].topic == CLOCK_TOPIC
    assert list(simulated.rest()) == []


def test_log_times_never_decrease() -> None:
    """A clock that jumps back is said the first time."""
    sentences: list[str] = []
    simulated = SimulatedClock(sentences.append)
    batch = [clock(8), clock(2), text(b"a"), clock(9), text(b"b"), clock(1), text(b"c")]
    assert times(simulated.stamp(batch)) == [(b"a", 8000), (b"b", 9000), (b"c", 9000)]
    assert sentences == [
        "/clock went back by 6.000 s: log times stay at 8.000 s until it has caught up"
    ]


def test_a_clock_that_never_comes_is_said() -> None:
    """The messages are kept, at time 0."""
    sentences: list[str] = []
    simulated = SimulatedClock(sentences.append)
    assert list(simulated.stamp([text(b"a")])) == []
    assert times(simulated.rest()) == [(b"a", 0)]
    assert sentences == ["no /clock came: everything is recorded at time 0"]


def test_what_waits_for_the_clock_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond that it is dropped and counted."""
    monkeypatch.setattr(log_clock, "_MOST_WAITING_BYTES", 5)
    simulated = SimulatedClock(silent)
    assert list(simulated.stamp([text(b"123"), text(b"456"), text(b"78")])) == []
    assert times(simulated.stamp([clock(1)])) == [(b"123", 1000), (b"78", 1000)]
    assert simulated.dropped == {"/x": 1}
