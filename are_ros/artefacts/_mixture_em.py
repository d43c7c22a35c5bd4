"""EM for the mixture of Eq. 1 on a histogram of rows, and the standard errors of its result.

A point of the search is float64 (2n,): the logarithms of the n weights, then of the n rates.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln

from are_ros._compiled import compiled

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


@compiled
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
    """How well the parameters are known: standard errors, float64 (n,), nan where there is none."""

    weight_errors: Floats
    rate_errors: Floats


def precision(
    counts: Floats, weights: Floats, rates: Floats, is_at_limit: npt.NDArray[np.bool_]
) -> Precision:
    """Return how well `counts` (rows,) tell the parameters, by the observed information.

    Components without weight, and rates at the limit of their domain, are taken as given.
    """
    _, hessian = derivatives(counts, weights, rates)
    basis = _free_directions(weights, is_at_limit)
    information = -basis.T @ hessian @ basis
    errors = np.full(2 * len(rates), np.nan)
    covariance = _inverse(information)
    if covariance is None:
        return Precision(errors[: len(rates)], errors[len(rates) :])
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
    """Return the inverse; None where the data leave some direction open."""
    scale = np.diag(information)
    if not np.all(scale > 0.0):
        return None
    roots = np.sqrt(scale)
    values, vectors = np.linalg.eigh(information / np.outer(roots, roots))
    if len(values) and values[0] < _LEAST_EIGENVALUE:
        return None
    inverse: Floats = (vectors / values) @ vectors.T / np.outer(roots, roots)
    return inverse
