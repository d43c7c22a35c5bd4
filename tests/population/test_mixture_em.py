"""The kernels of EM against slow twins: one sample at a time, and scipy's Poisson law."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import gammaln
from scipy.stats import poisson

from are_ros.population.mixture_fit import (
    climb,
    em_step,
    rate_limits,
    rate_of_mean,
    truncated_mean,
)

Floats = npt.NDArray[np.float64]
ROWS = 42
LIMITS = rate_limits(ROWS)
LOG_FACTORIALS = gammaln(np.arange(ROWS) + 1.0)
RATES = st.floats(1e-9, 42.0)


def mean_by_summing(rate: float, last: int) -> float:
    """Compute the conditional mean term by term."""
    masses = poisson.pmf(np.arange(last + 1), rate)
    return float(masses @ np.arange(last + 1) / masses.sum())


def rates_by_halving(means: Floats, rows: int) -> Floats:
    """Solve for the rates of conditional means by bisection alone."""
    k, log_factorials = np.arange(rows), gammaln(np.arange(rows) + 1.0)
    low, high = (np.full(len(means), limit) for limit in rate_limits(rows))
    for _ in range(70):
        middle = 0.5 * (low + high)
        masses = np.exp(np.outer(np.log(middle), k) - log_factorials)
        is_low = masses @ k / masses.sum(axis=1) < means
        low, high = np.where(is_low, middle, low), np.where(is_low, high, middle)
    return np.asarray(0.5 * (low + high))


def em_by_sample(
    samples: npt.NDArray[np.int64], weights: Floats, rates: Floats, rows: int
) -> tuple[Floats, Floats, float]:
    """Take one step of EM with a responsibility for each sample; also its log-likelihood."""
    log_masses = poisson.logpmf(np.arange(rows), rates[:, np.newaxis])
    laws = np.exp(log_masses) / np.exp(log_masses).sum(axis=1, keepdims=True)
    joint = weights[:, np.newaxis] * laws[:, samples]
    mixed = joint.sum(axis=0)
    shares = joint / mixed
    means = shares @ samples / shares.sum(axis=1)
    return shares.mean(axis=1), rates_by_halving(means, rows), float(np.log(mixed).sum())


def drawn(count: int, seed: int) -> npt.NDArray[np.int64]:
    """Return samples of the paper's rates, and none beyond the rows."""
    generator = np.random.default_rng(seed)
    rates = generator.choice([15.0, 7.0, 3.0, 21.0, 5.0], count, p=[0.7, 0.12, 0.08, 0.02, 0.08])
    samples = generator.poisson(rates)
    return np.asarray(samples[samples < ROWS])


def point_of(weights: Floats, rates: Floats) -> Floats:
    """Return a point of the search."""
    return np.concatenate((np.log(weights), np.log(rates)))


@given(RATES, st.integers(1, 200))
def test_mean_is_that_of_the_terms(rate: float, last: int) -> None:
    """Erlang's recursion gives the mean that summing gives, for small and large rates."""
    assert truncated_mean(rate, last)[0] == pytest.approx(mean_by_summing(rate, last), rel=1e-9)


@given(st.floats(0.1, 42.0), st.integers(1, 80))
def test_slope_is_that_of_differences(rate: float, last: int) -> None:
    """The slope of the mean is what two near means give."""
    step = 1e-4 * rate
    means = [mean_by_summing(rate + sign * step, last) for sign in (1.0, -1.0)]
    slope = (means[0] - means[1]) / (2.0 * step)
    assert truncated_mean(rate, last)[1] == pytest.approx(slope, rel=1e-4, abs=1e-7)


@given(RATES, RATES)
def test_a_rate_is_found_from_its_mean(rate: float, guess: float) -> None:
    """Wherever Newton's method begins, it ends at the rate, or at the limit of the domain."""
    rate = min(max(rate, LIMITS[0]), LIMITS[1])
    mean = truncated_mean(rate, ROWS - 1)[0]
    assert rate_of_mean(mean, ROWS - 1, guess, *LIMITS) == pytest.approx(rate, rel=1e-9)


def test_a_mean_outside_gives_the_limit() -> None:
    """A mean that no rate of the domain has gives the nearest rate."""
    assert rate_of_mean(0.0, ROWS - 1, 3.0, *LIMITS) == LIMITS[0]
    assert rate_of_mean(41.0, ROWS - 1, 3.0, *LIMITS) == LIMITS[1]


def test_a_step_equals_that_on_samples() -> None:
    """Steps on the histogram are those with a responsibility for each sample."""
    samples = drawn(3_000, 4)
    counts = np.bincount(samples, minlength=ROWS).astype(np.float64)
    weights, rates = np.full(4, 0.25), np.array([2.0, 6.0, 13.0, 24.0])
    point, following = point_of(weights, rates), np.empty(8)
    for _ in range(30):
        weights, rates, expected = em_by_sample(samples, weights, rates, ROWS)
        found = em_step(counts, LOG_FACTORIALS, LIMITS, point, following)
        point = following.copy()
        assert found == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(np.exp(point), [*weights, *rates], rtol=1e-9)


def test_a_step_survives_rows_that_no_component_expects() -> None:
    """Where every law underflows, the logarithms still tell who is the least unlikely."""
    rows = 1_200
    counts = np.zeros(rows)
    counts[[0, 1, 1_100]] = 5.0
    limits, log_factorials = rate_limits(rows), gammaln(np.arange(rows) + 1.0)
    point, following = point_of(np.array([0.5, 0.5]), np.array([1.0, 2.0])), np.empty(4)
    value = em_step(counts, log_factorials, limits, point, following)
    assert math.isfinite(value)
    assert value < -20_000.0
    np.testing.assert_allclose(np.exp(following[:2]).sum(), 1.0)


def test_a_component_without_samples_stays_where_it_is() -> None:
    """A component that gets nothing keeps its rate, and a weight of next to nothing."""
    counts = np.zeros(ROWS)
    counts[[1, 2]] = 5.0
    point, following = point_of(np.array([1.0, 1e-300]), np.array([1.5, 30.0])), np.empty(4)
    em_step(counts, LOG_FACTORIALS, LIMITS, point, following)
    assert following[1] < -600.0
    assert np.exp(following[2]) == pytest.approx(1.5, rel=1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_the_climb_never_falls(seed: int) -> None:
    """The trace rises to within a rounding, and ends at the point that is left."""
    counts = np.bincount(drawn(5_000, seed), minlength=ROWS).astype(np.float64)
    generator = np.random.default_rng(seed)
    point = point_of(generator.dirichlet(np.ones(5)), generator.uniform(0.5, 30.0, 5))
    trace = np.empty(20_000)
    points = climb(counts, LOG_FACTORIALS, LIMITS, point, trace, 5e-9)
    assert points <= len(trace)
    assert np.diff(trace[:points]).min() >= -1e-8
    np.testing.assert_allclose(np.exp(point[:5]).sum(), 1.0, rtol=1e-12)
    assert em_step(counts, LOG_FACTORIALS, LIMITS, point, np.empty(10)) == trace[points - 1]


def test_a_climb_stops_where_it_is_told_to() -> None:
    """With room for three points it takes two steps of EM, and ends at the third point."""
    counts = np.bincount(drawn(500, 3), minlength=ROWS).astype(np.float64)
    start = point_of(np.array([0.4, 0.6]), np.array([3.0, 20.0]))
    point, expected, following = start.copy(), start.copy(), np.empty(4)
    assert climb(counts, LOG_FACTORIALS, LIMITS, point, np.empty(3), 0.0) == 3
    for _ in range(2):
        em_step(counts, LOG_FACTORIALS, LIMITS, expected, following)
        expected = following.copy()
    np.testing.assert_array_equal(point, expected)
