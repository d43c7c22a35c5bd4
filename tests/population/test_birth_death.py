"""Tests of the birth-death chain: balance, blocking, memory and lives, against other ways."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.integrate import trapezoid
from scipy.linalg import expm

from are_ros.parameters.choices import Departures
from are_ros.parameters.model import Parameters
from are_ros.population.birth_death import BirthDeath, group_tail

INDEPENDENT, CONSTANT = Departures.INDEPENDENT, Departures.CONSTANT_RATE

chains = st.builds(
    BirthDeath,
    groups_per_s=st.floats(0.01, 2.0),
    mean_group_size=st.one_of(st.just(1.0), st.floats(1.0, 5.0)),
    mean_life_s=st.floats(0.2, 5.0),
    departures=st.sampled_from(Departures),
    max_alive=st.integers(1, 12),
    share=st.floats(0.1, 1.0),
)


def _dense_generator(chain: BirthDeath) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Write the rates down one by one, members drawn one by one from a binomial law."""
    bound = chain.max_alive
    rates = np.zeros((bound + 1, bound + 1))
    for extra, chance in enumerate(stats.poisson.pmf(range(40), chain.mean_group_size - 1.0)):
        counted = chance * stats.binom.pmf(range(extra + 2), extra + 1, chain.share)
        for n in range(bound + 1):
            ends = np.minimum(n + np.arange(extra + 2), bound)
            np.add.at(rates[n], ends, chain.groups_per_s * counted)
    for n in range(1, bound + 1):
        leavers = n if chain.departures is INDEPENDENT else 1
        rates[n, n - 1] += leavers / chain.mean_life_s
    np.fill_diagonal(rates, 0.0)
    return rates - np.diag(rates.sum(axis=1))


def test_the_parameters_make_the_chain() -> None:
    """The defaults on 200 m^2: an arrival in 10 s, six alive."""
    chain = BirthDeath.of(Parameters().population, 200.0)
    assert chain.groups_per_s == pytest.approx(0.1)
    assert (chain.load, chain.mean) == pytest.approx((6.0, 6.0))
    assert chain.deviation == pytest.approx(math.sqrt(6.0))
    assert chain.band() == (2, 10)


@settings(max_examples=60, deadline=None)
@given(chain=chains)
def test_nothing_flows_in_the_stationary_law(chain: BirthDeath) -> None:
    """The law is left alone by the generator, in which members count one by one."""
    assert chain.law @ _dense_generator(chain) == pytest.approx(0.0, abs=1e-9)


@given(chain=chains)
def test_as_many_are_admitted_as_leave(chain: BirthDeath) -> None:
    """What the bound does not block equals what leaves, level by level."""
    admitted_per_s = chain.members_per_s * (1.0 - chain.blocked_share)
    leavers = chain.mean if chain.departures is INDEPENDENT else 1.0 - chain.law[0]
    assert admitted_per_s == pytest.approx(leavers / chain.mean_life_s, rel=1e-9)


def test_blocking_of_single_arrivals_is_erlangs() -> None:
    """With a load of 4 and room for 5, Erlang's recursion gives the share that is blocked."""
    blocked = 1.0
    for n in range(1, 6):
        blocked = 4.0 * blocked / (n + 4.0 * blocked)
    assert BirthDeath(0.5, 1.0, 8.0, INDEPENDENT, 5).blocked_share == pytest.approx(blocked)


def test_groups_of_independent_lives_have_the_known_deviation() -> None:
    """Var N = rate * life * (E G + E G(G - 1) / 2), which for G = 1 + Poisson(a) is closed."""
    chain, a = BirthDeath(0.1, 3.5, 20.0, INDEPENDENT, 300), 2.5
    assert chain.mean == pytest.approx(7.0)
    assert chain.deviation**2 == pytest.approx(2.0 * (1.0 + 2.0 * a + 0.5 * a * a))


@settings(max_examples=30, deadline=None)
@given(chain=chains)
def test_correlation_time_is_the_integral_of_the_autocorrelation(chain: BirthDeath) -> None:
    """The same by the fundamental matrix of the dense generator."""
    ones = np.outer(np.ones(chain.max_alive + 1), chain.law)
    fundamental = np.linalg.inv(ones - _dense_generator(chain)) - ones
    off_mean = np.arange(chain.max_alive + 1) - chain.mean
    expected = (chain.law * off_mean) @ fundamental @ off_mean / chain.deviation**2
    assert chain.correlation_s == pytest.approx(expected, rel=1e-6)


def test_independent_lives_are_remembered_for_their_mean() -> None:
    """Without a bound in reach the autocorrelation is exp(-t/life), with groups and without."""
    assert BirthDeath(0.5, 1.0, 8.0, INDEPENDENT, 200).correlation_s == pytest.approx(8.0)
    assert BirthDeath(0.5, 3.0, 8.0, INDEPENDENT, 400).correlation_s == pytest.approx(8.0)


@pytest.mark.long
def test_lives_have_littles_mean() -> None:
    """Under either law the mean life is the mean number over the rate of admissions."""
    for chain in (
        BirthDeath(0.5, 1.0, 8.0, INDEPENDENT, 3),
        BirthDeath(0.6, 1.0, 1.0, CONSTANT, 200),
        BirthDeath(0.2, 3.0, 1.0, CONSTANT, 9),
        BirthDeath(2.0, 2.0, 1.0, CONSTANT, 7, share=0.6),
    ):
        little_s = chain.mean / (chain.members_per_s * (1.0 - chain.blocked_share))
        survival = chain.survival(60.0 * little_s, 6001)
        assert survival[0] == pytest.approx(1.0)
        assert trapezoid(survival, dx=0.01 * little_s) == pytest.approx(little_s, rel=1e-3)


def test_a_life_alone_is_exponential() -> None:
    """With room for one only, who came leaves at rate 1/mean: the drawing has no choice."""
    survival = BirthDeath(0.6, 1.0, 2.0, CONSTANT, 1).survival(6.0, 7)
    assert survival == pytest.approx(np.exp(-0.5 * np.arange(7.0)))


def test_a_life_among_two_is_that_of_the_tagged_chain() -> None:
    """With room for two: alone or with another one, written down as a matrix of 2 x 2."""
    rate, life_s = 0.7, 2.0
    chain = BirthDeath(rate, 1.0, life_s, CONSTANT, 2)
    tagged = np.array([[-rate - 1.0 / life_s, rate], [0.5 / life_s, -1.0 / life_s]])
    met = chain.law[:2] / chain.law[:2].sum()
    expected = [float(met @ expm(t * tagged) @ np.ones(2)) for t in range(5)]
    assert chain.survival(4.0, 5) == pytest.approx(expected)


def test_nobody_comes() -> None:
    """Without arrivals, or without room, nothing is blocked, correlated or divided by 0."""
    empty = BirthDeath(0.0, 1.0, 60.0, INDEPENDENT, 5)
    assert (empty.mean, empty.blocked_share, empty.correlation_s) == (0.0, 0.0, 0.0)
    shut = BirthDeath(1.0, 2.0, 60.0, INDEPENDENT, 0)
    assert (shut.mean, shut.correlation_s, shut.band()) == (0.0, 0.0, (0, 0))
    assert shut.blocked_share == pytest.approx(1.0)


@given(mean=st.floats(1.0, 30.0), share=st.floats(0.0, 1.0))
def test_members_that_count(mean: float, share: float) -> None:
    """The tail sums to the mean number of members that count."""
    assert group_tail(mean, share).sum() == pytest.approx(mean * share, abs=1e-9)
