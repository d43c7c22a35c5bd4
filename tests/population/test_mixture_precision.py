"""Derivatives of the likelihood against differences, and the standard errors."""

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import poisson

from are_ros.population.mixture_fit import derivatives, log_laws, precision

Floats = npt.NDArray[np.float64]
ROWS = 30
COUNTS = np.bincount(
    np.random.default_rng(8).poisson([2.0] * 300 + [9.0] * 700), minlength=ROWS
).astype(np.float64)
NOWHERE = np.zeros(2, dtype=np.bool_)


def log_likelihood(parameters: Floats, counts: Floats = COUNTS) -> float:
    """Compute the log-likelihood of weights, then rates, with scipy's law."""
    n = len(parameters) // 2
    masses = poisson.pmf(np.arange(len(counts)), parameters[n:, np.newaxis])
    laws = masses / masses.sum(axis=1, keepdims=True)
    return float(counts @ np.log(parameters[:n] @ laws))


def test_laws_are_conditioned_each_on_its_own() -> None:
    """Each law sums to 1 over the rows, and is scipy's where its tail is short."""
    laws = np.exp(log_laws(np.array([0.5, 9.0, 29.0]), ROWS))
    np.testing.assert_allclose(laws.sum(axis=1), 1.0, rtol=1e-13)
    np.testing.assert_allclose(laws[0], poisson.pmf(np.arange(ROWS), 0.5), rtol=1e-12)


def test_derivatives_are_those_of_differences() -> None:
    """Gradient and Hessian agree with differences of the likelihood, also near the upper limit."""
    at = np.array([0.2, 0.5, 0.3, 2.5, 8.0, 27.0])
    counts = COUNTS + 1.0
    gradient, hessian = derivatives(counts, at[:3], at[3:])
    steps = 1e-4 * np.eye(6)
    for i in range(6):
        ends = [log_likelihood(at + sign * steps[i], counts) for sign in (1.0, -1.0)]
        assert gradient[i] == pytest.approx((ends[0] - ends[1]) / 2e-4, rel=1e-5)
        slopes = [derivatives(counts, *np.split(at + s * steps[i], 2))[0] for s in (1.0, -1.0)]
        np.testing.assert_allclose(hessian[i], (slopes[0] - slopes[1]) / 2e-4, rtol=1e-4, atol=0.1)


def test_standard_errors_of_one_component_are_the_textbook_s() -> None:
    """For one Poisson law far from the last row the error of the rate is sqrt(rate / N)."""
    counts = np.bincount(np.random.default_rng(2).poisson(4.0, 4_000), minlength=60)
    mean = float(counts @ np.arange(60) / counts.sum())
    at_limit = np.zeros(1, dtype=np.bool_)
    found = precision(counts.astype(np.float64), np.ones(1), np.array([mean]), at_limit)
    assert found.rate_errors[0] == pytest.approx(np.sqrt(mean / 4_000), rel=1e-6)
    assert np.isnan(found.weight_errors[0])


def test_weights_of_two_components_are_known_equally_well() -> None:
    """They sum to 1, so that an error of the one is an error of the other."""
    found = precision(COUNTS, np.array([0.3, 0.7]), np.array([2.0, 9.0]), NOWHERE)
    assert found.weight_errors[0] == pytest.approx(found.weight_errors[1], rel=1e-12)


def test_coinciding_components_have_no_standard_errors() -> None:
    """Where the data leave a direction open, no error is made up."""
    found = precision(COUNTS, np.array([0.4, 0.6]), np.array([6.9, 6.9]), NOWHERE)
    assert np.isnan(found.rate_errors).all()


def test_a_component_without_weight_is_taken_as_given() -> None:
    """It has no standard errors, the others have those that they have without it."""
    alone = precision(COUNTS, np.array([0.3, 0.7]), np.array([2.0, 9.0]), NOWHERE)
    weights, rates = np.array([0.3, 0.7, 0.0]), np.array([2.0, 9.0, 20.0])
    found = precision(COUNTS, weights, rates, np.zeros(3, dtype=np.bool_))
    np.testing.assert_allclose(found.rate_errors[:2], alone.rate_errors, rtol=1e-9)
    assert np.isnan(found.rate_errors[2])
