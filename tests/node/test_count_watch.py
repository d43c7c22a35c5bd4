"""The growth of a counter over a sliding window."""

from hypothesis import given
from hypothesis import strategies as st

from are_ros.node.watches import CountWatch


def test_no_count_no_growth() -> None:
    """At any time."""
    watch = CountWatch(10)
    assert watch.growth(0) == 0
    watch.update(5, 0)
    assert watch.growth(5) == 0


def test_growth_leaves_with_its_window() -> None:
    """The window (now - 10, now] is open at its begin."""
    watch = CountWatch(10)
    watch.update(100, 3)
    watch.update(104, 4)
    assert [watch.growth(now) for now in (104, 109, 110, 113, 114)] == [4, 4, 1, 1, 0]


def test_a_counter_set_to_zero_starts_anew() -> None:
    """As when the clock jumps back: its growth is never negative."""
    watch = CountWatch(10)
    watch.update(100, 7)
    watch.update(101, 2)
    assert watch.growth(101) == 2
    assert watch.growth(111) == 0


@given(
    steps=st.lists(st.tuples(st.integers(0, 5), st.integers(0, 3)), max_size=30),
    window=st.integers(1, 12),
)
def test_growth_is_the_sum_of_what_was_added_within(
    steps: list[tuple[int, int]], window: int
) -> None:
    """Against the sum over all that was ever added."""
    watch, now, total = CountWatch(window), 0, 0
    added = []
    for wait, more in steps:
        now, total = now + wait, total + more
        added.append((now, more))
        watch.update(now, total)
        assert watch.growth(now) == sum(n for time, n in added if now - window < time <= now)
