"""For how long the node did not answer: turns by what they were, and what no turn explains."""

import pytest

from are_ros.conventions import NS_PER_S
from are_ros.node.watches import CallbackTimer

MS = NS_PER_S // 1000


def test_of_each_sort_the_longest_turn_of_a_minute_is_told() -> None:
    """And after that minute nothing is."""
    watch = CallbackTimer()
    assert watch.figures(0) == {}
    for begin_ms, what, took_ms in ((0, "ticks", 9), (100, "ticks", 12), (200, "inputs", 70)):
        watch.begin(begin_ms * MS, what)
        watch.end((begin_ms + took_ms) * MS)
    watch.begin(30_000 * MS, "ticks")
    watch.end(30_005 * MS)
    assert watch.figures(59 * NS_PER_S) == {"inputs": 70.0, "ticks": 12.0}
    assert watch.figures(80 * NS_PER_S) == {"ticks": 5.0}
    assert watch.figures(100 * NS_PER_S) == {}


def test_a_turn_within_a_turn_is_a_part_of_it() -> None:
    """The whole has one name, that of what takes the most time of it."""
    watch = CallbackTimer()
    watch.begin(0, "inputs")
    watch.begin(10 * MS, "parameters")
    watch.call_it("maps")
    watch.end(30 * MS)
    turn = watch.turn
    assert turn is not None
    assert turn.began_ns == 0
    watch.end(45 * MS)
    assert watch.figures(NS_PER_S) == {"maps": 45.0}


def test_preparing_names_a_turn_that_was_asked_for_and_ticks_do_not() -> None:
    """As that of the diagnostics, in which a camera is made ready where no CameraInfo comes."""
    watch = CallbackTimer()
    for begin_ms, work in ((0, "ticks"), (100, "preparing")):
        watch.begin(begin_ms * MS, "diagnostics")
        watch.call_it(work)
        watch.end((begin_ms + 10) * MS)
    assert watch.figures(NS_PER_S) == {"diagnostics": 10.0, "preparing": 10.0}


@pytest.mark.parametrize(("ended_ms", "expected"), [(20, 90.0), (80, 40.0), (110, 10.0)])
def test_a_late_timer_is_the_machines_as_far_as_no_turn_explains_it(
    ended_ms: int, expected: float
) -> None:
    """It was due at 30 ms, and woke the node at 120 ms."""
    watch = CallbackTimer()
    watch.begin(10 * MS, "ticks")
    watch.end(ended_ms * MS)
    watch.woke(120 * MS, 30 * MS)
    assert watch.figures(NS_PER_S)["machine"] == expected
