"""Both readings of the leaving rate: laws of the lives, censoring, and changed means."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from are_ros.conventions import NS_PER_S
from are_ros.errors import ParameterError
from are_ros.population.departures import (
    Cause,
    ConstantRateDepartures,
    Departure,
    DepartureLaw,
    IndependentLives,
    leaving_rate_per_s,
)
from are_ros.population.randomness import Purpose, generator

EPOCH_NS = 1_700_000_000 * NS_PER_S

both_laws = pytest.mark.parametrize("law_of", [IndependentLives, ConstantRateDepartures])


PAGE = Path(__file__).resolve().parents[2] / "docs" / "population.md"


@pytest.mark.parametrize("cause", list(Cause))
def test_the_page_tells_what_each_cause_means(cause: Cause) -> None:
    """A line of the table of what the events say names it."""
    table = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line[:1] == "|"]
    assert any(f"`{cause.value}`" in line for line in table)


def _life(seed: int, artefact_id: int) -> float:
    return float(generator(seed, Purpose.LIFE, artefact_id).standard_exponential())


def test_independent_lives_are_exponential() -> None:
    """Kolmogorov-Smirnov on 3,000 lives of mean 20 s, false alarms in 1 of 1,000 seeds."""
    law = IndependentLives(17, 20.0)
    for artefact_id in range(3000):
        law.arrived(artefact_id, EPOCH_NS + artefact_id * 1000)
    lives_s = []
    while law.next() is not None:
        departure = law.pop()
        arrival_ns = EPOCH_NS + departure.artefact_id * 1000
        lives_s.append((departure.time_ns - arrival_ns) / NS_PER_S)
    assert len(lives_s) == 3000
    assert stats.kstest(lives_s, "expon", args=(0.0, 20.0)).pvalue > 1e-3


def test_an_independent_life_is_known_in_advance() -> None:
    """The end is the ceiling of the unit exponential times the mean, whoever else is there."""
    law = IndependentLives(3, 60.0)
    for artefact_id in (5, 1, 9):
        law.arrived(artefact_id, EPOCH_NS)
        expected_ns = EPOCH_NS + math.ceil(_life(3, artefact_id) / (1 / 60.0) * NS_PER_S)
        assert law.departure_of(artefact_id) == expected_ns
    law.removed(5, EPOCH_NS + 1)
    assert law.departure_of(5) is None
    assert law.departure_of(77) is None


def test_departures_come_in_order_of_time() -> None:
    """Popping lives gives their ends in increasing order, as sorting them would."""
    law = IndependentLives(3, 60.0)
    for artefact_id in range(50):
        law.arrived(artefact_id, 0)
    ends = {artefact_id: law.departure_of(artefact_id) for artefact_id in range(50)}
    law.removed(13, 5)
    taken = [law.pop() for _ in range(49)]
    assert law.next() is None
    assert taken == sorted(taken)
    assert {d.artefact_id: d.time_ns for d in taken} == {
        artefact_id: end for artefact_id, end in ends.items() if artefact_id != 13
    }


def test_a_changed_mean_acts_at_once_on_what_is_left() -> None:
    """At 10 s the mean falls from 60 to 15 s: what is left of each life takes a quarter."""
    law = IndependentLives(3, 60.0)
    for artefact_id in range(20):
        law.arrived(artefact_id, 0)
    before = [law.departure_of(artefact_id) for artefact_id in range(20)]
    law.set_mean_life(15.0, 10 * NS_PER_S)
    for artefact_id, end_ns in enumerate(before):
        assert end_ns is not None
        rest_ns = end_ns - 10 * NS_PER_S
        expected_ns = 10 * NS_PER_S + rest_ns / 4 if rest_ns > 0 else end_ns
        assert law.departure_of(artefact_id) == pytest.approx(expected_ns, abs=2)


def test_an_infinite_mean_holds_everyone_until_it_is_finite_again() -> None:
    """A mean life without end stops the lives; the old mean lets them go on where they were."""
    law = IndependentLives(3, 60.0)
    law.arrived(1, 0)
    end_ns = law.departure_of(1)
    law.set_mean_life(math.inf, 5)
    assert law.next() is None
    assert law.departure_of(1) is None
    law.set_mean_life(60.0, 1005)
    assert end_ns is not None
    assert law.departure_of(1) == pytest.approx(end_ns + 1000, abs=2)


@both_laws
def test_setting_the_same_mean_changes_nothing(law_of: Callable[..., DepartureLaw]) -> None:
    """The same mean life set 1,000 times leaves the next departure bit for bit."""
    law = law_of(9, 60.0)
    law.arrived(1, EPOCH_NS)
    law.arrived(2, EPOCH_NS + 7)
    expected = law.next()
    for step in range(1000):
        law.set_mean_life(60.0, EPOCH_NS + 8 + step)
    assert law.next() == expected


def test_constant_rate_departures_are_a_poisson_process_while_someone_lives() -> None:
    """Gaps among 2,000 departures from a crowd: exponential of mean 1/mu, at level 1/1,000."""
    law = ConstantRateDepartures(5, 4.0)
    for artefact_id in range(2001):
        law.arrived(artefact_id, 0)
    times = [law.pop().time_ns for _ in range(2000)]
    gaps_s = np.diff([0, *times]) / NS_PER_S
    assert stats.kstest(gaps_s, "expon", args=(0.0, 4.0)).pvalue > 1e-3


def test_who_leaves_is_uniform_among_the_living() -> None:
    """Ranks of 2,000 leavers among ten living: chi-square at level 1/1,000."""
    law = ConstantRateDepartures(5, 4.0)
    for artefact_id in range(10):
        law.arrived(artefact_id, 0)
    alive = list(range(10))
    ranks = []
    for newcomer in range(10, 2010):
        departure = law.pop()
        ranks.append(alive.index(departure.artefact_id))
        alive.remove(departure.artefact_id)
        alive.append(newcomer)
        law.arrived(newcomer, departure.time_ns)
    assert stats.chisquare(np.bincount(ranks, minlength=10)).pvalue > 1e-3


def test_the_clock_of_constant_rate_stands_while_nobody_lives() -> None:
    """An empty hour between two lives is not consumed, and its exponential is not lost."""
    law = ConstantRateDepartures(5, 4.0)
    wait_ns = math.ceil(
        float(generator(5, Purpose.DEPARTURE, 0).standard_exponential()) / 0.25 * NS_PER_S
    )
    law.arrived(1, 100)
    assert law.next() == Departure(100 + wait_ns, 1)
    law.removed(1, 100 + wait_ns // 2)
    assert law.next() is None
    hour_ns = 3600 * NS_PER_S
    law.arrived(2, hour_ns)
    departure = law.next()
    assert departure is not None
    assert departure.artefact_id == 2
    assert departure.time_ns == pytest.approx(hour_ns + wait_ns - wait_ns // 2, abs=2)
    assert law.departure_of(2) is None


def test_constant_rate_mean_acts_at_once() -> None:
    """A mean half as long halves what is left until the next departure, also while empty."""
    law = ConstantRateDepartures(5, 4.0)
    law.set_mean_life(8.0, 0)
    law.arrived(1, 0)
    before = law.next()
    law.set_mean_life(4.0, 0)
    after = law.next()
    assert before is not None
    assert after is not None
    assert after.time_ns == pytest.approx(before.time_ns / 2, abs=2)


@pytest.mark.parametrize("change", ["mean life", "seed"])
def test_what_changes_while_nobody_lives_starts_no_wait(change: str) -> None:
    """The wait of another mean life, or of another seed, begins with the next who lives."""
    law, other = ConstantRateDepartures(1, 100.0), ConstantRateDepartures(1, 10.0)
    if change == "seed":
        law, other = ConstantRateDepartures(1, 10.0), ConstantRateDepartures(2, 10.0)
        law.reseed(2, 0)
    law.set_mean_life(10.0, 0)
    for one in (law, other):
        one.arrived(7, 1000 * NS_PER_S)
    assert law.next() == other.next()
    assert law.next() is not None


@both_laws
def test_restart_forgets_everyone(law_of: Callable[..., DepartureLaw]) -> None:
    """After a restart nobody is due, a new life begins, and an empty law gives nobody up."""
    law = law_of(9, 60.0)
    law.arrived(1, EPOCH_NS)
    law.restart(50)
    assert law.next() is None
    with pytest.raises(ParameterError, match="no artefact"):
        law.pop()
    law.arrived(2, 60)
    departure = law.next()
    assert departure is not None
    assert departure.artefact_id == 2
    assert 60 < departure.time_ns < EPOCH_NS


@both_laws
@given(steps=st.lists(st.tuples(st.integers(0, 3), st.integers(0, 10**11)), max_size=40))
def test_the_dead_never_leave(
    law_of: Callable[..., DepartureLaw], steps: list[tuple[int, int]]
) -> None:
    """Whatever comes and goes, only the living leave, each once, and time does not run back."""
    law, alive, now_ns, newcomer = law_of(1, 30.0), set[int](), 0, 0
    for action, gap_ns in steps:
        horizon_ns = now_ns + gap_ns
        while (due := law.next()) is not None and due.time_ns <= horizon_ns:
            assert law.pop() == due
            assert due.time_ns >= now_ns
            now_ns = due.time_ns
            alive.remove(due.artefact_id)
        now_ns = horizon_ns
        if action == 0 and alive:
            law.removed(alive.pop(), now_ns)
        elif action == 1:
            law.set_mean_life(1.0 + gap_ns % 50, now_ns)
        else:
            law.arrived(newcomer, now_ns)
            alive.add(newcomer)
            newcomer += 1


@pytest.mark.parametrize("mean_life_s", [0.0, -1.0, math.nan, 1e-320])
def test_no_other_mean_life_is_accepted(mean_life_s: float) -> None:
    """A mean life must be above 0, by enough for a finite rate."""
    with pytest.raises(ParameterError, match="mean life"):
        leaving_rate_per_s(mean_life_s)
