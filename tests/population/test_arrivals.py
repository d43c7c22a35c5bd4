"""The arrival process: its law, its exactness, and what a changed rate does."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from are_ros.conventions import NS_PER_S
from are_ros.errors import ParameterError
from are_ros.population.arrivals import ArrivalProcess, due_ns
from are_ros.population.randomness import Purpose, generator

EPOCH_NS = 1_700_000_000 * NS_PER_S


def _take(process: ArrivalProcess, count: int) -> list[int]:
    times = []
    for _ in range(count):
        instant_ns = process.next_ns()
        assert instant_ns is not None
        times.append(instant_ns)
        process.pop()
    return times


def _exponential(seed: int, index: int) -> Fraction:
    stream = generator(seed, Purpose.ARRIVAL, index)
    return Fraction(float(stream.standard_exponential()))


def test_times_between_arrivals_are_exponential() -> None:
    """Kolmogorov-Smirnov on 3,000 gaps at rate 0.5/s, false alarms in 1 of 1,000 seeds."""
    process = ArrivalProcess(11, rate_per_s=0.5, now_ns=EPOCH_NS)
    gaps_s = np.diff([EPOCH_NS, *_take(process, 3000)]) / NS_PER_S
    assert stats.kstest(gaps_s, "expon", args=(0.0, 2.0)).pvalue > 1e-3
    assert abs(np.corrcoef(gaps_s[1:], gaps_s[:-1])[0, 1]) < 3.3 / math.sqrt(3000)


def test_times_are_the_exact_sums_rounded_up() -> None:
    """Over 2,000 events the times stay within 2 ns of exact rational arithmetic: no drift."""
    process = ArrivalProcess(3, rate_per_s=7.0, now_ns=EPOCH_NS)
    total = Fraction(0)
    for index, instant_ns in enumerate(_take(process, 2000)):
        total += _exponential(3, index)
        exact_ns = EPOCH_NS + total / 7 * NS_PER_S
        assert -1 < instant_ns - exact_ns < 2


def test_first_arrival_is_rounded_up() -> None:
    """The first event is the ceiling of its exponential over the rate."""
    process = ArrivalProcess(5, rate_per_s=0.3, now_ns=0)
    exact_ns = float(_exponential(5, 0)) / 0.3 * NS_PER_S
    assert process.next_ns() == math.ceil(exact_ns)


def test_a_changed_rate_acts_at_once_on_what_is_left() -> None:
    """Half of the wait at rate 1/s, the rest at 4/s: the rest takes a quarter of its time."""
    process = ArrivalProcess(8, rate_per_s=1.0, now_ns=EPOCH_NS)
    before_ns = process.next_ns()
    assert before_ns is not None
    half_ns = (before_ns - EPOCH_NS) // 2
    process.set_rate(4.0, EPOCH_NS + half_ns)
    expected_ns = EPOCH_NS + half_ns + (before_ns - EPOCH_NS - half_ns) / 4
    assert process.next_ns() == pytest.approx(expected_ns, abs=2)


def test_setting_the_same_rate_changes_nothing_bit_for_bit() -> None:
    """A rate set again 1,000 times between events leaves every time as it was."""
    plain = ArrivalProcess(21, rate_per_s=0.7, now_ns=EPOCH_NS)
    pestered = ArrivalProcess(21, rate_per_s=0.7, now_ns=EPOCH_NS)
    times = []
    for expected_ns in (expected := _take(plain, 20)):
        for step in range(50):
            pestered.set_rate(0.7, expected_ns - 1000 + step)
        times += _take(pestered, 1)
    assert times == expected


def test_the_integrated_rate_consumes_the_exponentials() -> None:
    """Under a rate that changes every 10 s, events come where the integral reaches sum E_k."""
    process = ArrivalProcess(13, rate_per_s=0.0, now_ns=0)
    rates = [0.3, 0.0, 2.0, 0.5, 0.0, 1.0]
    times: list[int] = []
    for step, rate in enumerate(rates):
        process.set_rate(rate, step * 10 * NS_PER_S)
        while (at_ns := process.next_ns()) is not None and at_ns < (step + 1) * 10 * NS_PER_S:
            times += _take(process, 1)
    levels = np.cumsum([float(_exponential(13, k)) for k in range(len(times))])
    knots_s = np.arange(len(rates) + 1) * 10.0
    integral = np.concatenate(([0.0], np.cumsum(rates) * 10.0))
    reached = np.interp(np.array(times) / NS_PER_S, knots_s, integral)
    assert len(times) > 20
    np.testing.assert_allclose(reached, levels, atol=1e-7)


def test_at_rate_zero_nothing_ever_comes() -> None:
    """A rate of 0 means never, and taking an event is refused."""
    process = ArrivalProcess(1, rate_per_s=0.0, now_ns=0)
    assert process.next_ns() is None
    with pytest.raises(ParameterError, match="no event comes"):
        process.pop()


def test_an_instant_beyond_the_clock_never_comes() -> None:
    """A rate so small that 63 bits of nanoseconds do not reach the event means never."""
    assert due_ns(0, 1.0, 1e-300) is None
    assert due_ns(2**63 - 2, 1.0, 1.0) is None
    assert due_ns(0, 1.0, 1.0) == NS_PER_S


def test_a_change_before_the_last_one_counts_from_that() -> None:
    """Time never runs backwards for the process."""
    late, early = (ArrivalProcess(1, rate_per_s=1.0, now_ns=EPOCH_NS) for _ in range(2))
    late.set_rate(2.0, EPOCH_NS)
    early.set_rate(2.0, EPOCH_NS - 5 * NS_PER_S)
    assert early.next_ns() == late.next_ns()


def test_restart_goes_on_at_another_instant() -> None:
    """After a jump back the wait that was left is waited from there."""
    process = ArrivalProcess(4, rate_per_s=1.0, now_ns=EPOCH_NS)
    first_ns = process.next_ns()
    process.restart(5)
    assert first_ns is not None
    assert process.next_ns() == first_ns - EPOCH_NS + 5


@pytest.mark.parametrize("waited_s", [0, 3])
def test_who_has_waited_waits_no_longer_after_a_jump(waited_s: int) -> None:
    """The law knows no past: after a wait of any length the rest is exponential, mean 1 s."""
    rests = []
    for seed in range(2000):
        process = ArrivalProcess(seed, rate_per_s=1.0, now_ns=EPOCH_NS)
        until_ns = EPOCH_NS + waited_s * NS_PER_S
        while (next_ns := process.next_ns()) is not None and next_ns <= until_ns:
            process.pop()
        process.set_rate(0.0, until_ns)
        process.restart(5)
        process.set_rate(1.0, 5)
        rests.append(((process.next_ns() or 0) - 5) / NS_PER_S)
    assert stats.kstest(rests, "expon").pvalue > 0.001


@pytest.mark.parametrize("rate", [-1.0, math.nan, math.inf])
def test_no_other_rate_is_accepted(rate: float) -> None:
    """Negative, infinite and undefined rates are refused and change nothing."""
    process = ArrivalProcess(1, rate_per_s=1.0, now_ns=0)
    with pytest.raises(ParameterError, match="events per second"):
        process.set_rate(rate, 10)
    assert process.rate_per_s == 1.0


@given(
    rates=st.lists(st.floats(0.0, 1e9), min_size=1, max_size=8),
    gaps_ns=st.lists(st.integers(0, 10**10), min_size=8, max_size=8),
)
def test_times_never_decrease(rates: list[float], gaps_ns: list[int]) -> None:
    """Whatever the rates, up to one per nanosecond, times are in order and not in the past."""
    process = ArrivalProcess(2, rate_per_s=1.0, now_ns=0)
    now_ns = 0
    last_ns = 0
    for rate, gap_ns in zip(rates, gaps_ns, strict=False):
        while (at_ns := process.next_ns()) is not None and at_ns <= now_ns + min(gap_ns, 20):
            assert at_ns >= last_ns
            last_ns = at_ns
            process.pop()
        now_ns += min(gap_ns, 20)
        process.set_rate(rate, now_ns)
