"""Fitting the Poisson mixture of Eq. 1 to observed rows: EM on their histogram (section 3.2).

The law is that of `TruncatedPoissonMixture`: each component is conditioned on the rows separately.
The cost depends on the size of the histogram, not on the number of samples.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.special import gammainccinv, gammaln

from are_ros._compiled import compiled
from are_ros.errors import InputError, ParameterError
from are_ros.population.mixture import TruncatedPoissonMixture
from are_ros.wording import counted

Floats = npt.NDArray[np.float64]

LOWEST_LOG_WEIGHT: Final = -700.0
"""A weight of this logarithm does not underflow; EM cannot raise a weight of 0 again."""

_NEWTON_STEPS: Final = 100
_RELATIVE_STEP: Final = 1e-15
_LEAST_WEIGHT: Final = 1e-6
_LEAST_EIGENVALUE: Final = 1e-9


@compiled
def truncated_mean(rate: float, last: int) -> tuple[float, float]:
    """Return the mean of Poisson(rate) given 0 <= k <= last, and its slope over the rate.

    The mean is rate * (1 - B), B the share of k = last: Erlang's B, by its stable recursion.
    """
    inverse, reciprocal = 1.0, 1.0 / rate
    for j in range(1, last + 1):
        inverse = 1.0 + j * reciprocal * inverse
    blocked = 1.0 / inverse
    mean = rate * (1.0 - blocked)
    return mean, 1.0 - blocked * (1.0 + last - mean)


@compiled
def rate_of_mean(mean: float, last: int, guess: float, low: float, high: float) -> float:
    """Return the rate in [low, high] whose `truncated_mean` is `mean`, or else comes nearest.

    Newton's method, kept inside a bracket that halves where a step would leave it.
    """
    if mean <= truncated_mean(low, last)[0]:
        return low
    if mean >= truncated_mean(high, last)[0]:
        return high
    rate = min(max(guess, low), high)
    for _ in range(_NEWTON_STEPS):
        found, slope = truncated_mean(rate, last)
        if found < mean:
            low = rate
        else:
            high = rate
        following = rate + (mean - found) / slope
        if abs(following - rate) <= _RELATIVE_STEP * rate:
            break
        rate = following if low < following < high else 0.5 * (low + high)
    return rate


@compiled
def em_step(
    counts: Floats,
    log_factorials: Floats,
    limits: tuple[float, float],
    point: Floats,
    following: Floats,
) -> float:
    """Write the point after one step of EM; return the log-likelihood of the point before it.

    `counts` and `log_factorials` are (rows,), `limits` those of the rates. A truncated Poisson law
    is an exponential family: the new rate is the one whose mean is the weighted mean of the rows.
    All laws are in logarithms, so a row that every component makes next to impossible still counts.
    """
    n, rows = len(point) // 2, len(counts)
    heads, terms = np.empty(n), np.empty(n)
    shares, moments = np.zeros(n), np.zeros(n)
    for i in range(n):
        rate, mass = math.exp(point[n + i]), 0.0
        for k in range(rows):
            mass += math.exp(k * point[n + i] - rate - log_factorials[k])
        heads[i] = point[i] - rate - math.log(mass)
    log_likelihood, total = 0.0, 0.0
    for k in range(rows):
        if counts[k] == 0.0:
            continue
        top, mixed = -math.inf, 0.0
        for i in range(n):
            terms[i] = heads[i] + k * point[n + i]
            top = max(top, terms[i])
        for i in range(n):
            terms[i] = math.exp(terms[i] - top)
            mixed += terms[i]
        log_likelihood += counts[k] * (top + math.log(mixed) - log_factorials[k])
        total += counts[k]
        for i in range(n):
            share = terms[i] * (counts[k] / mixed)
            shares[i] += share
            moments[i] += k * share
    for i in range(n):
        following[i], following[n + i] = LOWEST_LOG_WEIGHT, point[n + i]
        if shares[i] > 0.0:
            following[i] = max(math.log(shares[i] / total), LOWEST_LOG_WEIGHT)
            mean, guess = moments[i] / shares[i], math.exp(point[n + i])
            rate = rate_of_mean(mean, rows - 1, guess, limits[0], limits[1])
            following[n + i] = math.log(rate)
    return log_likelihood


def climb(
    counts: Floats,
    log_factorials: Floats,
    limits: tuple[float, float],
    point: Floats,
    trace: Floats,
    tolerance: float,
) -> int:
    """Take steps of EM, which move `point`; return how many points there were, the first included.

    `trace` gets the log-likelihood of each of them; it never falls. The climb ends with the first
    step that gains no more than `tolerance`, or when `trace` is full.
    """
    following = np.empty(len(point))
    for step in range(len(trace)):
        trace[step] = em_step(counts, log_factorials, limits, point, following)
        if step > 0 and trace[step] - trace[step - 1] <= tolerance:
            return step + 1
        if step + 1 < len(trace):
            point[:] = following
    return len(trace)


@dataclass(frozen=True, eq=False)
class Precision:
    """Standard errors of the parameters, float64 (n,), nan where there is none."""

    weight_errors: Floats
    rate_errors: Floats


def precision(
    counts: Floats, weights: Floats, rates: Floats, is_at_limit: npt.NDArray[np.bool_]
) -> Precision:
    """Return the standard errors for `counts` (rows,), by the observed information.

    Components without weight, and rates at the limit of their domain, count as known.
    """
    _, hessian = derivatives(counts, weights, rates)
    basis = _free_directions(weights, is_at_limit)
    information = -basis.T @ hessian @ basis
    errors = np.full(2 * len(rates), np.nan)
    covariance = _inverse(information)
    if covariance is not None:
        is_free = np.any(basis != 0.0, axis=1)
        variances = np.einsum("ij,jk,ik->i", basis, covariance, basis)
        errors[is_free] = np.sqrt(variances[is_free])
    return Precision(errors[: len(rates)], errors[len(rates) :])


def derivatives(counts: Floats, weights: Floats, rates: Floats) -> tuple[Floats, Floats]:
    """Return gradient (2n,) and Hessian (2n, 2n) of the log-likelihood over weights, then rates.

    The weights are taken as free of each other here.
    """
    n, used = len(rates), np.flatnonzero(counts)
    means, slopes = np.array([truncated_mean(rate, len(counts) - 1) for rate in rates]).T
    laws = log_laws(rates, len(counts))[:, used]
    ratios = np.exp(laws - log_mixed(weights, laws))
    scores = (used - means[:, np.newaxis]) / rates[:, np.newaxis]
    curves = scores**2 - (scores + slopes[:, np.newaxis]) / rates[:, np.newaxis]
    firsts = np.vstack((ratios, weights[:, np.newaxis] * ratios * scores))
    seen = counts[used]
    hessian = -(firsts * seen) @ firsts.T
    each = np.arange(n)
    crossed = (ratios * scores) @ seen
    hessian[each, n + each] += crossed
    hessian[n + each, each] += crossed
    hessian[n + each, n + each] += weights * ((ratios * curves) @ seen)
    return firsts @ seen, hessian


def log_laws(rates: Floats, rows: int) -> Floats:
    """Return the log of Poisson(rate | 0 <= k < rows), float64 (rates, rows)."""
    k = np.arange(rows)
    log_masses = k * np.log(rates)[:, np.newaxis] - rates[:, np.newaxis] - gammaln(k + 1.0)
    top = log_masses.max(axis=1, keepdims=True)
    log_kept = top + np.log(np.exp(log_masses - top).sum(axis=1, keepdims=True))
    laws: Floats = log_masses - log_kept
    return laws


def log_mixed(weights: Floats, laws: Floats) -> Floats:
    """Return the log of the mixture of laws given by their logs, without underflow."""
    positive = weights > 0.0
    mixed: Floats = np.logaddexp.reduce(
        np.log(weights[positive])[:, np.newaxis] + laws[positive], axis=0
    )
    return mixed


def _free_directions(weights: Floats, is_at_limit: npt.NDArray[np.bool_]) -> Floats:
    """Return the directions (2n, m) in which the parameters may move; the weights sum to 1."""
    n, pivot = len(weights), int(np.argmax(weights))
    is_used = weights >= _LEAST_WEIGHT
    columns = []
    for i in np.flatnonzero(is_used):
        if i != pivot:
            column = np.zeros(2 * n)
            column[i], column[pivot] = 1.0, -1.0
            columns.append(column)
    columns += list(np.eye(2 * n)[n:][is_used & ~is_at_limit])
    directions: Floats = np.array(columns).reshape(len(columns), 2 * n).T
    return directions


def _inverse(information: Floats) -> Floats | None:
    """Return the inverse; None if the data do not determine some direction."""
    scale = np.diag(information)
    if not np.all(scale > 0.0):
        return None
    roots = np.sqrt(scale)
    values, vectors = np.linalg.eigh(information / np.outer(roots, roots))
    if len(values) and values[0] < _LEAST_EIGENVALUE:
        return None
    inverse: Floats = (vectors / values) @ vectors.T / np.outer(roots, roots)
    return inverse


Counts = npt.NDArray[np.int64]
Progress = Callable[[int, int], None]
"""Called with the number of finished searches, and of all."""

LOWEST_RATE: Final = 1e-9
_FIRST_STEPS: Final = 1_500
_STEPS: Final = 100_000
_FINALISTS: Final = 3
_RANDOM_STARTS: Final = 8
_TOLERANCE: Final = 1e-11
"""Of the log-likelihood per sample."""
_AT_LIMIT: Final = 1e-6
_LARGEST_LOG: Final = 700.0


class Stop(Enum):
    """Why a search ended."""

    CONVERGED = "a step of EM gained less than the tolerance"
    LIMIT = "the limit of steps was reached"


@dataclass(frozen=True)
class Search:
    """One search: where it began, its steps of EM, its log-likelihood per sample at the end."""

    start: str
    steps: int
    log_likelihood: float
    stop: Stop


@dataclass(frozen=True, eq=False)
class MixtureFit:
    """A mixture of most likely weights and rates, its components in the order of their rates.

    `log_likelihood` is the sum over `samples` samples. `trace` (float64) has the log-likelihood
    per sample at each point of the best search; it never falls. `precision` has the standard
    errors. `at_lowest` and `at_highest` (bool (n,)) say which rates lie at the limit of their
    domain. `searches` are those from all starts, the best first.
    """

    law: TruncatedPoissonMixture
    samples: int
    log_likelihood: float
    trace: Floats
    precision: Precision
    at_lowest: npt.NDArray[np.bool_]
    at_highest: npt.NDArray[np.bool_]
    searches: tuple[Search, ...]

    @property
    def components(self) -> int:
        """The number n of components."""
        return len(self.law.rates)

    @property
    def log_likelihood_per_sample(self) -> float:
        """The mean log-likelihood of a sample."""
        return self.log_likelihood / self.samples

    @property
    def bic(self) -> float:
        """Schwarz's criterion, (2n - 1) log N - 2 log L: the lower the better."""
        return (2 * self.components - 1) * math.log(self.samples) - 2.0 * self.log_likelihood


def count_rows(samples: npt.ArrayLike, rows: int) -> Counts:
    """Return how often each of `rows` rows occurs among samples (N,), int64 (rows,).

    InputError, naming the first sample at fault, unless all are whole numbers in [0, rows).
    """
    values = np.asarray(samples)
    if values.ndim != 1 or values.dtype.kind not in "iuf":
        raise InputError("the samples are no list of numbers")
    is_row = (values >= 0) & (values < rows)
    if values.dtype.kind == "f":
        is_row &= values == np.floor(values)
    if not is_row.all():
        first = int(np.argmin(is_row))
        reason = why_no_row(float(values[first]), rows)
        raise InputError(f"sample {first} is {values[first]:g}, {reason}")
    return np.bincount(values.astype(np.int64, copy=False), minlength=rows).astype(np.int64)


def why_no_row(value: float, rows: int) -> str:
    """Return why a number is no row: the end of a sentence that names it. Empty if it is one."""
    if math.isnan(value):
        return "not a number"
    if value < 0.0:
        return "negative, but rows are counted from 0"
    if value >= rows:
        return f"beyond the {counted(rows, 'row')} of the catalogue (0 to {rows - 1})"
    return "" if value == math.floor(value) else "a fraction, but rows are whole numbers"


def most_components(counts: Counts) -> int:
    """Return how many components a histogram can tell apart.

    No more than rows that occur (Lindsay 1983), nor more parameters than rows less one.
    """
    return max(1, min(int(np.count_nonzero(counts)), len(counts) // 2))


def fit_mixture(
    counts: Counts, components: int, *, seed: int = 0, progress: Progress | None = None
) -> MixtureFit:
    """Return the most likely mixture of so many components for a histogram, int64 (rows,).

    Raises InputError for a histogram that tells nothing (empty, or one row only, or negative
    counts), ParameterError where it cannot tell so many components apart. The same histogram and
    seed give the same fit.
    """
    return _fits(counts, components, seed, progress)[-1]


def fit_by_bic(
    counts: Counts, most: int, *, seed: int = 0, progress: Progress | None = None
) -> tuple[MixtureFit, ...]:
    """Return the fits of 1 to `most` components, or as many as the histogram can tell apart.

    The one of least `bic` is the choice (`best_by_bic`). Raises as `fit_mixture`.
    """
    if most < 1:
        raise ParameterError(f"{most} components at most, but a mixture has at least one")
    return _fits(counts, min(most, most_components(counts)), seed, progress)


def best_by_bic(fits: Sequence[MixtureFit]) -> MixtureFit:
    """Return the fit of least BIC; of equals that with the fewest components."""
    return min(fits, key=lambda fit: (fit.bic, fit.components))


def rate_limits(rows: int) -> tuple[float, float]:
    """Return the rates that a component may have: at the upper one it keeps half of its mass."""
    return LOWEST_RATE, float(gammainccinv(rows, 0.5)) * (1.0 - 1e-9)


def _fits(
    counts: Counts, components: int, seed: int, progress: Progress | None
) -> tuple[MixtureFit, ...]:
    """Fit 1, 2, ... components, each beginning also where the fit before could grow best."""
    _check_counts(counts)
    _check_components(counts, components)
    fits: list[MixtureFit] = []
    for n in range(1, components + 1):
        fits.append(_fit(counts.astype(np.float64), n, seed, fits[-1] if fits else None))
        if progress is not None:
            progress(n, components)
    return tuple(fits)


def _fit(counts: Floats, components: int, seed: int, smaller: MixtureFit | None) -> MixtureFit:
    """Climb a little from every start, and then from the best of them until nothing is gained."""
    limits = rate_limits(len(counts))
    # The number of components is part of the seed: a fit does not depend on what else is fitted.
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence((seed, components))))
    climbs = [_Climb(counts, limits, *start) for start in _starts(counts, components, generator)]
    if smaller is not None:
        climbs.append(_Climb(counts, limits, "grown", *_grown(counts, smaller.law)))
    for each in climbs:
        each.go_on(_FIRST_STEPS)
    # Sorting is stable: of equals the one that began first is kept.
    climbs.sort(key=lambda each: -each.trace[-1])
    for each in climbs[:_FINALISTS]:
        each.go_on(_STEPS)
    climbs.sort(key=lambda each: -each.trace[-1])
    return _result(counts, limits, climbs)


class _Climb:
    """EM from one start, which can be taken up again where it ended."""

    def __init__(
        self,
        counts: Floats,
        limits: tuple[float, float],
        start: str,
        weights: Floats,
        rates: Floats,
    ) -> None:
        with np.errstate(divide="ignore"):
            log_weights = np.maximum(np.log(weights), LOWEST_LOG_WEIGHT)
        self.point = np.concatenate((log_weights, np.log(np.clip(rates, *limits))))
        self.trace = np.empty(0)
        self._start = start
        self._is_over = False
        self._counts, self._limits = counts, limits
        self._log_factorials = gammaln(np.arange(len(counts)) + 1.0)

    def go_on(self, steps: int) -> None:
        """Take so many more steps of EM at most; none if the search is over."""
        if self._is_over:
            return
        trace = np.empty(steps)
        tolerance = _TOLERANCE * float(self._counts.sum())
        points = climb(
            self._counts, self._log_factorials, self._limits, self.point, trace, tolerance
        )
        self._is_over = points < steps
        # The last point of the part before is the first of this one.
        self.trace = np.concatenate((self.trace[:-1], trace[:points]))

    def summary(self, samples: float) -> Search:
        """Return the record of the search."""
        stop = Stop.CONVERGED if self._is_over else Stop.LIMIT
        return Search(self._start, len(self.trace), float(self.trace[-1]) / samples, stop)


def _starts(
    counts: Floats, components: int, generator: np.random.Generator
) -> Iterator[tuple[str, Floats, Floats]]:
    """Yield names, weights and rates to start from: quantiles first, then random ones."""
    weights = np.full(components, 1.0 / components)
    yield "quantiles", weights, _quantile_means(counts, components)
    for number in range(_RANDOM_STARTS if components > 1 else 0):
        rates = _spread_rows(counts, components, generator)
        yield f"random {number + 1}", generator.dirichlet(np.full(components, 2.0)), rates


def _grown(counts: Floats, law: TruncatedPoissonMixture) -> tuple[Floats, Floats]:
    """Return a mixture with one component more, at the rate where the likelihood rises fastest.

    The slope towards a component is the mean of its law over the mixture's (Lindsay 1983).
    """
    rows, used = len(counts), counts > 0.0
    rates: Floats = np.arange(rows, dtype=np.float64) + 0.5
    rates = rates[rates <= rate_limits(rows)[1]]
    log_masses = log_mixed(law.weights, log_laws(law.rates, rows)[:, used])
    ratios = np.exp(np.minimum(log_laws(rates, rows)[:, used] - log_masses, _LARGEST_LOG))
    rate, share = rates[np.argmax(ratios @ counts[used])], 1.0 / (len(law.rates) + 1)
    return np.append(law.weights * (1.0 - share), share), np.append(law.rates, rate)


def _quantile_means(counts: Floats, parts: int) -> Floats:
    """Return the means of so many parts, equal in number, of the ordered samples."""
    edges = np.linspace(0.0, counts.sum(), parts + 1)
    below = np.concatenate(((0.0,), np.cumsum(counts)))
    moments = np.concatenate(((0.0,), np.cumsum(counts * np.arange(len(counts)))))
    # Samples of one row may belong to two parts: the sum of rows is then divided in proportion.
    reached = np.interp(edges, below, moments)
    # EM never separates components that coincide.
    apart = 1e-3 * np.arange(parts)
    means: Floats = np.maximum(np.diff(reached) / np.diff(edges), 0.1) + apart
    return means


def _spread_rows(counts: Floats, components: int, generator: np.random.Generator) -> Floats:
    """Draw rows far from each other, each by its share and its squared distance to the others.

    Distances are between square roots, where every Poisson law is equally wide (k-means++).
    """
    roots = np.sqrt(np.arange(len(counts)) + 0.25)
    odds, chosen = counts.copy(), []
    nearest = np.full(len(counts), np.inf)
    for _ in range(components):
        chosen.append(int(generator.choice(len(counts), p=odds / odds.sum())))
        nearest = np.minimum(nearest, (roots - roots[chosen[-1]]) ** 2)
        odds = counts * nearest
    return np.maximum(np.array(chosen, dtype=np.float64), 0.1)


def _result(counts: Floats, limits: tuple[float, float], climbs: Sequence[_Climb]) -> MixtureFit:
    """Return the fit of the best climb, which is the first."""
    best, n = climbs[0], len(climbs[0].point) // 2
    order = np.argsort(best.point[n:], kind="stable")
    rates = np.exp(best.point[n:][order])
    weights = np.exp(best.point[:n][order])
    weights /= weights.sum()
    at_lowest = rates <= limits[0] * (1.0 + _AT_LIMIT)
    at_highest = rates >= limits[1] * (1.0 - _AT_LIMIT)
    rates = np.clip(rates, *limits)
    samples = float(counts.sum())
    return MixtureFit(
        law=TruncatedPoissonMixture(weights.tolist(), rates.tolist(), len(counts)),
        samples=int(samples),
        log_likelihood=float(best.trace[-1]),
        trace=best.trace / samples,
        precision=precision(counts, weights, rates, at_lowest | at_highest),
        at_lowest=at_lowest,
        at_highest=at_highest,
        searches=tuple(each.summary(samples) for each in climbs),
    )


def _check_counts(counts: Counts) -> None:
    """Refuse an empty or degenerate histogram."""
    if counts.ndim != 1 or counts.dtype.kind not in "iu":
        raise InputError("the histogram is no list of whole numbers")
    if counts.size and counts.min() < 0:
        raise InputError(f"row {int(np.argmin(counts))} was counted {counts.min()} times")
    if not counts.any():
        raise InputError("there is no sample to fit")
    if np.count_nonzero(counts) == 1:
        row, count = int(np.argmax(counts)), int(counts.max())
        samples = "the only sample is" if count == 1 else f"all {count} samples are"
        raise InputError(f"{samples} row {row}: one value tells no rates")


def _check_components(counts: Counts, components: int) -> None:
    """Refuse a number of components that the histogram cannot tell apart."""
    most, distinct = most_components(counts), int(np.count_nonzero(counts))
    if components < 1:
        raise ParameterError(f"{components} components, but a mixture has at least one")
    if components > most:
        msg = (
            f"{components} components, but {distinct} different rows of {len(counts)} "
            f"tell at most {most} apart"
        )
        raise ParameterError(msg)
