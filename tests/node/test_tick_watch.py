"""The durations of ticks, and those that were late or left out."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.conventions import NS_PER_S
from are_ros.node.watches import TickFigures, TickWatch

MS = NS_PER_S // 1000
PERIOD_NS = 100 * MS


def test_before_the_first_tick_there_is_only_the_period() -> None:
    """No durations, no age."""
    assert TickWatch(PERIOD_NS).figures(0) == TickFigures(period_s=0.1)


@given(durations_ms=st.lists(st.integers(0, 500), min_size=1, max_size=150))
def test_percentiles_are_nearest_ranks(durations_ms: list[int]) -> None:
    """Those of numpy that are always one of the values."""
    watch = TickWatch(PERIOD_NS)
    for index, duration_ms in enumerate(durations_ms):
        watch.ran(index * PERIOD_NS, duration_ms * MS)
    figures = watch.figures(len(durations_ms) * PERIOD_NS)
    expected = np.percentile(durations_ms, [50, 99, 100], method="inverted_cdf")
    assert [figures.p50_ms, figures.p99_ms, figures.max_ms] == list(expected)


def test_durations_are_those_of_the_last_minute() -> None:
    """The totals are since the start."""
    watch = TickWatch(PERIOD_NS)
    watch.ran(0, 900 * MS)
    watch.ran(30 * NS_PER_S, 10 * MS)
    soon, later = watch.figures(59 * NS_PER_S), watch.figures(60 * NS_PER_S)
    assert (soon.max_ms, later.max_ms) == (900.0, 10.0)
    end = watch.figures(200 * NS_PER_S)
    assert (end.count, end.max_ms, end.age_s) == (2, None, 170.0)


@pytest.mark.parametrize(("late_ms", "expected"), [(0, 0), (50, 0), (51, 1), (300, 1)])
def test_late_is_more_than_half_a_period(late_ms: int, expected: int) -> None:
    """After the tick's time."""
    watch = TickWatch(PERIOD_NS)
    watch.ran(0, MS, late_ms * MS)
    assert watch.figures(0).late == expected


def test_those_over_a_period_are_counted_for_a_minute() -> None:
    """One alone is no slow node: the first tick takes long."""
    watch = TickWatch(PERIOD_NS)
    for index, duration_ms in enumerate((300, 100, 101)):
        watch.ran(index * NS_PER_S, duration_ms * MS)
    assert [watch.figures(t_s * NS_PER_S).over for t_s in (3, 60, 70)] == [2, 1, 0]


def test_skipped_ticks_are_counted() -> None:
    """As many as there were."""
    watch = TickWatch(PERIOD_NS)
    watch.skipped(0, 1)
    watch.skipped(0, 0)
    watch.skipped(0, 41)
    assert watch.figures(0).skipped == 42


def test_ticks_are_left_out_where_some_are_skipped_at_several_times_of_a_minute() -> None:
    """Once, or twice, is no load: a map that comes may take seconds. None at a time is no time."""
    watch, seen = TickWatch(PERIOD_NS), list[int]()
    for at_s, ticks in ((0, 40), (10, 5), (20, 0), (30, 7), (59, 1)):
        watch.skipped(at_s * NS_PER_S, ticks)
        seen.append(watch.figures(at_s * NS_PER_S).left_out)
    assert seen == [0, 0, 0, 52, 53]
    assert [watch.figures(at_s * NS_PER_S).left_out for at_s in (60, 69, 70)] == [13, 13, 0]
    assert watch.figures(70 * NS_PER_S).skipped == 53
