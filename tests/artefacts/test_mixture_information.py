"""Derivatives of the likelihood against differences, and the bound on what could be gained."""

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import poisson

from are_ros.artefacts._mixture_information import derivatives, headroom, log_laws, precision
from are_ros.artefacts.mixture_fit import rate_limits

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
    assert found.remaining == pytest.approx(0.0, abs=1e-12)


def test_weights_of_two_components_are_known_equally_well() -> None:
    """They sum to 1, so that an error of the one is an error of the other."""
    found = precision(COUNTS, np.array([0.3, 0.7]), np.array([2.0, 9.0]), NOWHERE)
    assert found.weight_errors[0] == pytest.approx(found.weight_errors[1], rel=1e-12)


def test_what_remains_is_what_a_longer_search_gains() -> None:
    """A little below the top, the parabola tells how much is left to gain."""
    weights, rates = np.array([0.3, 0.7]), np.array([2.0, 9.0])
    for _ in range(60):
        gradient, hessian = derivatives(COUNTS, weights, rates)
        basis = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]).T
        step = basis @ np.linalg.solve(-basis.T @ hessian @ basis, basis.T @ gradient)
        weights, rates = weights + step[:2], rates + step[2:]
    top = log_likelihood(np.concatenate((weights, rates)))
    near = rates + np.array([0.02, 0.0])
    left = top - log_likelihood(np.concatenate((weights, near)))
    found = precision(COUNTS, weights, near, NOWHERE)
    assert found.remaining * COUNTS.sum() == pytest.approx(left, rel=0.05)


def test_coinciding_components_have_no_standard_errors() -> None:
    """Where the data leave a direction open, no error is made up."""
    found = precision(COUNTS, np.array([0.4, 0.6]), np.array([6.9, 6.9]), NOWHERE)
    assert np.isnan(found.rate_errors).all()
    assert np.isnan(found.remaining)


def test_a_component_without_weight_is_taken_as_given() -> None:
    """It has no standard errors, the others have those that they have without it."""
    alone = precision(COUNTS, np.array([0.3, 0.7]), np.array([2.0, 9.0]), NOWHERE)
    weights, rates = np.array([0.3, 0.7, 0.0]), np.array([2.0, 9.0, 20.0])
    found = precision(COUNTS, weights, rates, np.zeros(3, dtype=np.bool_))
    np.testing.assert_allclose(found.rate_errors[:2], alone.rate_errors, rtol=1e-9)
    assert np.isnan(found.rate_errors[2])


@pytest.mark.parametrize("seed", range(20))
def test_no_mixture_gains_more_than_the_headroom(seed: int) -> None:
    """Random mixtures of one to six components never beat the bound."""
    generator = np.random.default_rng(seed)
    weights, rates = np.array([0.3, 0.7]), np.array([2.1, 8.9])
    bound, rate = headroom(COUNTS, weights, rates, rate_limits(ROWS))
    assert rate_limits(ROWS)[0] <= rate <= rate_limits(ROWS)[1]
    here = log_likelihood(np.concatenate((weights, rates)))
    for n in range(1, 7):
        others = (generator.dirichlet(np.ones(n)), generator.uniform(0.1, 25.0, n))
        gain = log_likelihood(np.concatenate(others)) - here
        assert gain / COUNTS.sum() <= bound


def test_the_headroom_is_never_more_than_frequencies_give() -> None:
    """A hopeless mixture is still at most as far below as the frequencies themselves."""
    bound, _ = headroom(COUNTS, np.ones(1), np.array([25.0]), rate_limits(ROWS))
    shares = COUNTS[COUNTS > 0] / COUNTS.sum()
    here = log_likelihood(np.array([1.0, 25.0])) / COUNTS.sum()
    assert bound == pytest.approx(float(shares @ np.log(shares)) - here, rel=1e-9)
