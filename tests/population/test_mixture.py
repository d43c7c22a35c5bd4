"""The law that picks a row, against scipy and against its own samples."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest, chi2, chisquare, poisson

from are_ros.errors import ParameterError
from are_ros.population.mixture import GoodnessOfFit, TruncatedPoissonMixture
from are_ros.population.mixture_fit import fit_mixture

PAPER_RATES = (15.0, 7.0, 3.0, 21.0, 5.0)
WEIGHTS = (0.7, 0.12, 0.08, 0.02, 0.08)


def oracle(weights: Sequence[float], rates: Sequence[float], rows: int) -> list[float]:
    """Compute Eq. 1 term by term, each component conditioned on its own."""
    laws = []
    for rate in rates:
        masses = [float(poisson.pmf(k, rate)) for k in range(rows)]
        laws.append([mass / sum(masses) for mass in masses])
    return [sum(w * law[k] for w, law in zip(weights, laws, strict=True)) for k in range(rows)]


@pytest.mark.parametrize("rows", [22, 25, 42, 400])
def test_probabilities_are_those_of_scipy(rows: int) -> None:
    """The law equals the paper's mixture, computed with scipy, whatever the number of rows."""
    mixture = TruncatedPoissonMixture(WEIGHTS, PAPER_RATES, rows)
    np.testing.assert_allclose(
        mixture.probabilities(), oracle(WEIGHTS, PAPER_RATES, rows), rtol=1e-10, atol=1e-300
    )
    assert mixture.probabilities().sum() == pytest.approx(1.0, abs=1e-12)


def test_each_component_keeps_its_weight_when_the_catalogue_is_short() -> None:
    """Conditioning acts on each component alone, so that a short catalogue leaves pi alone."""
    mixture = TruncatedPoissonMixture((0.5, 0.5), (0.01, 21.0), 22)
    assert mixture.probabilities()[2:].sum() == pytest.approx(0.5, abs=1e-4)
    np.testing.assert_allclose(mixture.component_probabilities().sum(axis=1), 1.0, rtol=1e-12)


@given(
    st.lists(st.tuples(st.floats(0.01, 1.0), st.floats(0.1, 30.0)), min_size=1, max_size=5),
    st.integers(60, 100),
)
def test_any_mixture_is_the_oracles(parts: list[tuple[float, float]], rows: int) -> None:
    """Weights and rates of any size give scipy's law."""
    total = math.fsum(weight for weight, _ in parts)
    weights = [weight / total for weight, _ in parts]
    rates = [rate for _, rate in parts]
    mixture = TruncatedPoissonMixture(weights, rates, rows)
    expected = oracle(weights, rates, rows)
    np.testing.assert_allclose(mixture.probabilities(), expected, rtol=1e-9, atol=1e-300)


def test_samples_follow_the_law() -> None:
    """20,000 samples pass a chi-square test; the false-alarm level is 0.001 (fixed seed)."""
    mixture = TruncatedPoissonMixture(WEIGHTS, PAPER_RATES, 42)
    rng = np.random.default_rng(20)
    counts = np.bincount([mixture.sample(rng) for _ in range(20_000)], minlength=42)
    expected = 20_000 * mixture.probabilities()
    often = expected >= 5.0
    observed = [*counts[often], counts[~often].sum()]
    assert chisquare(observed, [*expected[often], expected[~often].sum()]).pvalue > 0.001


def test_a_sample_takes_exactly_one_uniform_number() -> None:
    """Drawing a row advances the generator by one uniform number, whatever comes out."""
    mixture = TruncatedPoissonMixture(WEIGHTS, PAPER_RATES, 42)
    drawn, twin = np.random.default_rng(5), np.random.default_rng(5)
    for _ in range(20):
        mixture.sample(drawn)
        twin.random()
    assert drawn.random() == twin.random()


class _AlmostOne(np.random.Generator):
    """A generator that only gives the largest number below 1."""

    def random(self, *_: object, **__: object) -> float:  # type: ignore[override]
        """Return the largest float64 below 1."""
        return math.nextafter(1.0, 0.0)


def test_the_last_uniform_number_still_gives_a_row() -> None:
    """No rounding of the cumulative sum leads outside the catalogue."""
    for rows in (22, 42, 400):
        mixture = TruncatedPoissonMixture((0.1,) * 10, (1.0, *range(2, 11)), rows)
        assert 0 <= mixture.sample(_AlmostOne(np.random.PCG64(0))) < rows


def test_weights_within_the_tolerance_are_normalised() -> None:
    """Weights that miss 1 by a rounding are taken and then sum to 1."""
    mixture = TruncatedPoissonMixture((0.3333333, 0.3333333, 0.3333333), (1.0, 2.0, 3.0), 30)
    assert mixture.weights.sum() == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_array_equal(mixture.rates, (1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    ("weights", "rates", "rows", "words"),
    [
        ((0.5, 0.5), (3.0, 0.0), 42, ["rates[1] is 0.0"]),
        ((0.9, 0.1), (3.0, 60.0), 42, ["rates[1] is 60", "% of its mass", "42 rows"]),
        ((0.9, 0.1), (3.0, 1e6), 42, ["rates[1] is 1e+06", "0 %"]),
    ],
)
def test_a_mixture_that_is_none_is_refused(
    weights: tuple[float, ...], rates: tuple[float, ...], rows: int, words: list[str]
) -> None:
    """The refusal names the parameter, its value and the figures."""
    with pytest.raises(ParameterError) as refusal:
        TruncatedPoissonMixture(weights, rates, rows)
    assert all(word in str(refusal.value) for word in words), refusal.value


def test_just_over_half_of_the_mass_is_enough() -> None:
    """The limit is half of a component's mass: 21 on 22 rows passes, on 21 rows it does not."""
    assert poisson.cdf(20, 21.0) < 0.5 < poisson.cdf(21, 21.0)
    TruncatedPoissonMixture((1.0,), (21.0,), 22)
    with pytest.raises(ParameterError, match=r"47\.1 %"):
        TruncatedPoissonMixture((1.0,), (21.0,), 21)


def test_goodness_of_fit_is_that_of_scipy() -> None:
    """Cells are pooled by hand here: rows 0 to 2, 3, ..., and the last ones together."""
    law = TruncatedPoissonMixture((1.0,), (6.0,), 30)
    counts = np.bincount(np.random.default_rng(3).poisson(6.0, 200), minlength=30)
    pooled = [range(3), *([row] for row in range(3, 11)), range(11, 30)]
    seen = [sum(int(counts[row]) for row in cell) for cell in pooled]
    expected = [sum(200.0 * float(law.probabilities()[row]) for row in cell) for cell in pooled]
    assert min(expected) >= 5.0
    assert 200.0 * law.probabilities()[:2].sum() < 5.0
    found = GoodnessOfFit.of(counts, law)
    assert found is not None
    assert found.cells == len(pooled)
    assert found.chi_square == pytest.approx(chisquare(seen, expected).statistic)
    bounds = (chi2.sf(found.chi_square, 8), chi2.sf(found.chi_square, 9))
    assert (found.least_p, found.most_p) == pytest.approx(bounds)


def test_the_p_values_of_right_fits_lie_about_uniform_ones() -> None:
    """Of 300 fits to samples of such a mixture; two-sided binomial tests at 0.001 (fixed seed)."""
    law, rng = TruncatedPoissonMixture((0.3, 0.7), (4.0, 18.0), 42), np.random.default_rng(5)
    found = []
    for _ in range(300):
        counts = rng.multinomial(1_000, law.probabilities())
        found.append(GoodnessOfFit.of(counts, fit_mixture(counts, 2).law))
    for level in (0.1, 0.5):
        fewest = sum(one is not None and one.most_p < level for one in found)
        most = sum(one is not None and one.least_p < level for one in found)
        assert fewest < most
        assert binomtest(fewest, 300, level, "greater").pvalue > 0.001
        assert binomtest(most, 300, level, "less").pvalue > 0.001


def test_rows_of_another_law_do_not_fit() -> None:
    """Even rows only: each is likely, and no mixture of one rate gives them."""
    counts = 40 * (1 - np.arange(42) % 2) * (np.abs(np.arange(42) - 12) < 8)
    found = GoodnessOfFit.of(counts, fit_mixture(counts, 1).law)
    assert found is not None
    assert found.most_p < 1e-9


def test_too_few_rows_tell_nothing_of_the_fit() -> None:
    """No cell is left beside the fitted numbers."""
    law = TruncatedPoissonMixture((0.5, 0.5), (4.0, 18.0), 42)
    counts = np.bincount([3, 4, 5, 17, 18, 19], minlength=42)
    assert GoodnessOfFit.of(counts, law) is None
