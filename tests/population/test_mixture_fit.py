"""EM against independent programs, and the laws of its estimates at stated levels."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.optimize import minimize
from scipy.special import gammaln
from scipy.stats import binom, poisson

from are_ros.errors import InputError, ParameterError
from are_ros.population.mixture import TruncatedPoissonMixture
from are_ros.population.mixture_fit import (
    MixtureFit,
    Stop,
    best_by_bic,
    count_rows,
    fit_by_bic,
    fit_mixture,
    most_components,
    rate_limits,
)

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
PAPER = ((0.7, 0.12, 0.08, 0.02, 0.08), (15.0, 7.0, 3.0, 21.0, 5.0))
ROWS = 42


def samples_of(law: tuple[Sequence[float], Sequence[float]], count: int, seed: int) -> Ints:
    """Draw rows of a mixture over 42 rows, by another way than that of the product."""
    generator = np.random.default_rng(seed)
    masses = poisson.pmf(np.arange(ROWS), np.array(law[1])[:, np.newaxis])
    laws = masses / masses.sum(axis=1, keepdims=True)
    return np.asarray(generator.choice(ROWS, count, p=np.array(law[0]) @ laws))


def long_em(samples: Ints, rates: Floats, steps: int) -> float:
    """Run EM with a responsibility for each sample, and return the log-likelihood per sample."""
    weights, k = np.full(len(rates), 1.0 / len(rates)), np.arange(ROWS)
    for _ in range(steps):
        masses = np.exp(np.outer(np.log(rates), k) - gammaln(k + 1.0))
        laws = masses / masses.sum(axis=1, keepdims=True)
        joint = weights[:, np.newaxis] * laws[:, samples]
        shares = joint / joint.sum(axis=0)
        weights, means = shares.mean(axis=1), shares @ samples / shares.sum(axis=1)
        low, high = np.full(len(rates), 1e-9), np.full(len(rates), 60.0)
        for _ in range(45):
            middle = 0.5 * (low + high)
            masses = np.exp(np.outer(np.log(middle), k) - gammaln(k + 1.0))
            is_low = masses @ k / masses.sum(axis=1) < means
            low, high = np.where(is_low, middle, low), np.where(is_low, high, middle)
        rates = 0.5 * (low + high)
    return float(np.log(joint.sum(axis=0)).mean())


def optimum(counts: Ints, starts: Sequence[Sequence[float]]) -> float:
    """Maximise the log-likelihood per sample with scipy's optimiser from several starts."""
    k, total = np.arange(len(counts)), counts.sum()
    high = np.log(rate_limits(len(counts))[1])

    def loss(at: Floats) -> float:
        n = len(at) // 2
        weights = np.exp(at[:n] - at[:n].max())
        masses = np.exp(np.outer(at[n:], k) - gammaln(k + 1.0))
        laws = masses / masses.sum(axis=1, keepdims=True)
        return -float(counts @ np.log(weights / weights.sum() @ laws)) / float(total)

    best = []
    options = {"maxiter": 20_000, "maxfun": 1_000_000, "ftol": 1e-15, "gtol": 1e-10}
    for rates in starts:
        n = len(rates)
        begin = np.concatenate((np.zeros(n), np.log(rates)))
        bounds = [(-40.0, 40.0)] * n + [(-20.0, high)] * n
        found: Any = minimize(loss, begin, method="L-BFGS-B", bounds=bounds, options=options)
        best.append(-float(found.fun))
    return max(best)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_paper_s_example_reaches_the_optimiser_s_maximum(seed: int) -> None:
    """On 100,000 samples of the paper's mixture EM is at most 1e-6 per sample below scipy's."""
    counts = count_rows(samples_of(PAPER, 100_000, seed), ROWS)
    fit = fit_mixture(counts, 5)
    found = optimum(
        counts, [sorted(PAPER[1]), (1.0, 4.0, 8.0, 15.0, 25.0), (2.0, 5.0, 6.0, 14.0, 17.0)]
    )
    assert fit.log_likelihood_per_sample >= found - 1e-6
    assert fit.log_likelihood_per_sample <= found + 1e-4
    assert fit.searches[0].stop is Stop.CONVERGED


def test_the_paper_s_example_reaches_a_long_em_on_samples() -> None:
    """It is at most 1e-6 per sample below 2,500 steps of EM on 2,000 samples, from the truth."""
    samples = samples_of(PAPER, 2_000, 3)
    reached = long_em(samples, np.array(PAPER[1]), 2_500)
    fit = fit_mixture(count_rows(samples, ROWS), 5)
    assert fit.log_likelihood_per_sample >= reached - 1e-6


@pytest.mark.long
def test_the_paper_s_example_reaches_a_longer_em_on_more_samples() -> None:
    """Nor is it below 1,500 steps of EM on 100,000 samples."""
    samples = samples_of(PAPER, 100_000, 1)
    reached = long_em(samples, np.array(PAPER[1]), 1_500)
    fit = fit_mixture(count_rows(samples, ROWS), 5)
    assert fit.log_likelihood_per_sample >= reached - 1e-6


def test_well_separated_rates_are_recovered() -> None:
    """All six numbers lie within three standard errors; 1.6 % of correct programs fail (seed 5)."""
    truth = ((0.3, 0.5, 0.2), (2.0, 11.0, 26.0))
    fit = fit_mixture(count_rows(samples_of(truth, 20_000, 5), ROWS), 3)
    for found, true, error in (
        (fit.law.weights, truth[0], fit.precision.weight_errors),
        (fit.law.rates, truth[1], fit.precision.rate_errors),
    ):
        assert np.all(np.abs(found - true) <= 3.0 * error)
        assert np.all(error < 0.2)


def test_standard_errors_are_as_large_as_they_say() -> None:
    """Of 150 x 3 rates the share beyond two standard errors is normal's, at a level of 0.001."""
    truth = ((0.3, 0.5, 0.2), (2.0, 11.0, 26.0))
    beyond = 0
    for seed in range(150):
        fit = fit_mixture(count_rows(samples_of(truth, 4_000, 1_000 + seed), ROWS), 3)
        offsets = (fit.law.rates - truth[1]) / fit.precision.rate_errors
        beyond += int(np.count_nonzero(np.abs(offsets) > 2.0))
    assert binom.ppf(0.0005, 450, 0.0455) <= beyond <= binom.ppf(0.9995, 450, 0.0455)


@pytest.mark.long
@pytest.mark.parametrize("rates", [(12.0,), (3.0, 18.0), (2.0, 11.0, 26.0), (0.3, 5.0, 15.0, 33.0)])
def test_bic_finds_the_number_of_well_separated_components(rates: tuple[float, ...]) -> None:
    """One to four components of 10,000 samples are found, in each of three sets."""
    law = ([1.0 / len(rates)] * len(rates), rates)
    for seed in range(3):
        fits = fit_by_bic(count_rows(samples_of(law, 10_000, seed), ROWS), 6)
        assert [fit.components for fit in fits] == [1, 2, 3, 4, 5, 6]
        assert best_by_bic(fits).components == len(rates)


def test_more_components_never_fit_worse() -> None:
    """The likelihood rises with the number of components, to within the tolerance."""
    fits = fit_by_bic(count_rows(samples_of(PAPER, 5_000, 7), ROWS), 8)
    values = [fit.log_likelihood_per_sample for fit in fits]
    assert np.diff(values).min() >= -1e-7


@pytest.mark.parametrize("seed", range(4))
def test_the_trace_never_falls_and_ends_at_the_result(seed: int) -> None:
    """The record of convergence rises to the log-likelihood of the law that is returned."""
    counts = count_rows(samples_of(PAPER, 3_000, seed), ROWS)
    fit = fit_mixture(counts, 4, seed=seed)
    assert np.diff(fit.trace).min() >= -1e-12
    assert fit.trace[-1] == pytest.approx(fit.log_likelihood_per_sample, rel=1e-14)
    by_law = counts[counts > 0] @ np.log(fit.law.probabilities()[counts > 0])
    assert fit.log_likelihood == pytest.approx(by_law, rel=1e-11)
    ends = [search.log_likelihood for search in fit.searches]
    assert ends == sorted(ends, reverse=True)


def same(one: MixtureFit, other: MixtureFit) -> bool:
    """Tell whether two fits are equal, bit for bit."""
    pairs = ((one.law.weights, other.law.weights), (one.law.rates, other.law.rates))
    return all(np.array_equal(a, b) for a, b in pairs) and one.searches == other.searches


def test_the_order_of_samples_does_not_matter() -> None:
    """Sorted, turned round or shuffled, the same rows give the same bits."""
    samples = samples_of(PAPER, 2_000, 9)
    fit = fit_mixture(count_rows(samples, ROWS), 3)
    shuffled = np.random.default_rng(0).permutation(samples)
    for other in (np.sort(samples), samples[::-1], shuffled, samples.astype(np.float64)):
        assert same(fit, fit_mixture(count_rows(other, ROWS), 3))


def test_the_same_seed_gives_the_same_fit_whatever_else_is_fitted() -> None:
    """A fit of three components is the same alone, and among those of one to five."""
    counts = count_rows(samples_of(PAPER, 2_000, 9), ROWS)
    alone = fit_mixture(counts, 3, seed=4)
    assert same(alone, fit_by_bic(counts, 5, seed=4)[2])
    assert alone.searches != fit_mixture(counts, 3, seed=5).searches


def test_ten_times_the_samples_give_the_same_mixture() -> None:
    """Only the histogram's shape decides the rates; errors shrink by the root."""
    counts = count_rows(samples_of(((0.5, 0.5), (3.0, 18.0)), 2_000, 9), ROWS)
    one, ten = fit_mixture(counts, 2), fit_mixture(10 * counts, 2)
    np.testing.assert_allclose(ten.law.rates, one.law.rates, rtol=1e-6)
    np.testing.assert_allclose(
        ten.precision.rate_errors * np.sqrt(10.0), one.precision.rate_errors, rtol=1e-4
    )


def test_components_come_in_the_order_of_their_rates() -> None:
    """However they were found, the smallest rate is the first."""
    fit = fit_mixture(count_rows(samples_of(PAPER, 20_000, 2), ROWS), 4)
    assert np.all(np.diff(fit.law.rates) > 0.0)


def test_a_rate_that_would_leave_the_domain_is_held_at_its_bound() -> None:
    """Rows piled up at the end ask for a rate that TruncatedPoissonMixture would refuse."""
    counts = np.zeros(20, dtype=np.int64)
    counts[[2, 3, 4, 18, 19]] = 10, 20, 10, 30, 300
    fit = fit_mixture(counts, 2)
    assert fit.at_highest.tolist() == [False, True]
    kept = poisson.cdf(19, fit.law.rates[1])
    assert kept == pytest.approx(0.5, abs=1e-6)
    TruncatedPoissonMixture(fit.law.weights.tolist(), fit.law.rates.tolist(), 20)
    with pytest.raises(ParameterError, match="at least half is needed"):
        TruncatedPoissonMixture([1.0], [fit.law.rates[1] * 1.001], 20)
    assert np.isnan(fit.precision.rate_errors[1])
    assert np.isfinite(fit.precision.rate_errors[0])


def test_too_many_zeros_are_a_component_at_the_lowest_rate() -> None:
    """Row 0 can have a component of its own, whose rate then lies at the lower bound."""
    counts = count_rows(
        np.concatenate((np.zeros(500), samples_of(((1.0,), (15.0,)), 500, 1))), ROWS
    )
    fit = fit_mixture(counts, 2)
    assert fit.at_lowest.tolist() == [True, False]
    np.testing.assert_allclose(fit.law.weights, (0.5, 0.5), atol=1e-3)


def test_progress_tells_each_number_of_components() -> None:
    """It is told how many searches of how many are done."""
    told: list[tuple[int, int]] = []
    counts = count_rows(samples_of(PAPER, 500, 9), ROWS)
    fit_by_bic(counts, 3, progress=lambda done, of: told.append((done, of)))
    assert told == [(1, 3), (2, 3), (3, 3)]


def test_bic_is_schwarz_s() -> None:
    """Of n components 2n - 1 numbers are free."""
    fit = fit_mixture(count_rows([1, 2, 2, 3, 9, 9, 8], 20), 2)
    assert fit.bic == pytest.approx(3.0 * np.log(7.0) - 2.0 * fit.log_likelihood)


def test_no_more_components_are_tried_than_can_be_told_apart() -> None:
    """Three different rows tell three apart; six rows in all tell three, too."""
    assert most_components(count_rows([1, 2, 2, 7], 42)) == 3
    assert most_components(count_rows([0, 1, 2, 3, 4, 5], 6)) == 3
    assert len(fit_by_bic(count_rows([1, 2, 2, 7], 42), 8)) == 3


@pytest.mark.parametrize(
    ("samples", "words"),
    [
        ([3, -1, 2], ["sample 1 is -1", "negative"]),
        ([3, 2, 42], ["sample 2 is 42", "beyond the 42 rows"]),
        ([3.0, 2.5], ["sample 1 is 2.5", "a fraction"]),
        ([float("nan"), 2.0], ["sample 0 is nan", "not a number"]),
        ([float("inf"), 2.0], ["sample 0 is inf", "beyond"]),
        ([[1, 2]], ["no list of numbers"]),
        (["a"], ["no list of numbers"]),
        ([True, False], ["no list of numbers"]),
    ],
)
def test_samples_that_are_no_rows_are_refused(samples: Any, words: list[str]) -> None:
    """The refusal names the sample, its value and the reason."""
    with pytest.raises(InputError) as refusal:
        count_rows(samples, ROWS)
    assert all(word in str(refusal.value) for word in words), refusal.value


@pytest.mark.parametrize(
    ("counts", "words"),
    [
        ([0] * 10, "there is no sample to fit"),
        ([0, 0, 7, 0], "all 7 samples are row 2: one value tells no rates"),
        ([0, 0, 1, 0], "the only sample is row 2"),
        ([3, -2, 1, 0], "row 1 was counted -2 times"),
        ([0.5, 1.0], "no list of whole numbers"),
        ([], "there is no sample"),
    ],
)
def test_a_histogram_that_tells_nothing_is_refused(counts: list[Any], words: str) -> None:
    """Empty and one-valued data are refused in a sentence, whatever is asked for."""
    array = np.array(counts) if counts else np.zeros(0, dtype=np.int64)
    for refused in (lambda: fit_mixture(array, 2), lambda: fit_by_bic(array, 4)):
        with pytest.raises(InputError, match=words):
            refused()


@pytest.mark.parametrize(("components", "words"), [(0, "at least one"), (4, "at most 3 apart")])
def test_components_that_nothing_tells_apart_are_refused(components: int, words: str) -> None:
    """The refusal says how many the rows would tell apart."""
    with pytest.raises(ParameterError, match=words):
        fit_mixture(count_rows([1, 2, 2, 7], 42), components)


def test_bic_over_no_components_is_refused() -> None:
    """There is no mixture of at most none."""
    with pytest.raises(ParameterError, match="at least one"):
        fit_by_bic(count_rows([1, 2, 2, 7], 42), 0)
