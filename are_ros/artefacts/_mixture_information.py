"""What a histogram tells of a mixture: standard errors, and what could still be gained."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln

from are_ros.artefacts._mixture_kernels import truncated_mean

Floats = npt.NDArray[np.float64]

_LEAST_WEIGHT: Final = 1e-6
_LEAST_EIGENVALUE: Final = 1e-9
_LARGEST_LOG: Final = 700.0
_GRID_STEP: Final = 0.02
"""Of the square root of the rate, in which every Poisson law is about 1/2 wide."""


@dataclass(frozen=True, eq=False)
class Precision:
    """How well the parameters are known: standard errors, float64 (n,), nan where there is none.

    `remaining` is what is left to gain, per sample, up to the top of the parabola through the end
    of the climb; nan where the information is singular.
    """

    weight_errors: Floats
    rate_errors: Floats
    remaining: float


def log_laws(rates: Floats, rows: int) -> Floats:
    """Return the log of Poisson(rate | 0 <= k < rows), float64 (rates, rows)."""
    k = np.arange(rows)
    log_masses = k * np.log(rates)[:, np.newaxis] - rates[:, np.newaxis] - gammaln(k + 1.0)
    top = log_masses.max(axis=1, keepdims=True)
    log_kept = top + np.log(np.exp(log_masses - top).sum(axis=1, keepdims=True))
    laws: Floats = log_masses - log_kept
    return laws


def headroom(
    counts: Floats, weights: Floats, rates: Floats, limits: tuple[float, float]
) -> tuple[float, float]:
    """Return the most that any mixture could gain per sample, and the rate that gains fastest.

    The log-likelihood is concave in the mixing law, so no mixture of whatever number of components
    with rates in `limits` is better than this one by more than the largest slope towards one more
    component (Lindsay 1983), which is looked for on a fine grid; nor is anything better than the
    observed frequencies themselves.
    """
    rows, total = len(counts), counts.sum()
    used = counts > 0.0
    log_mixed = _log_mixed(weights, log_laws(rates, rows)[:, used])
    low, high = math.sqrt(limits[0]), math.sqrt(limits[1])
    grid = np.linspace(low, high, min(1000, 2 + int((high - low) / _GRID_STEP))) ** 2
    ratios = np.exp(np.minimum(log_laws(grid, rows)[:, used] - log_mixed, _LARGEST_LOG))
    slopes = ratios @ counts[used] / total - 1.0
    best = int(np.argmax(slopes))
    shares = counts[used] / total
    frequencies = float(shares @ (np.log(shares) - log_mixed))
    return max(min(float(slopes[best]), frequencies), 0.0), float(grid[best])


def precision(
    counts: Floats, weights: Floats, rates: Floats, is_at_limit: npt.NDArray[np.bool_]
) -> Precision:
    """Return how well `counts` (rows,) tell the parameters, by the observed information.

    Components without weight, and rates at the limit of their domain, are taken as given.
    """
    gradient, hessian = derivatives(counts, weights, rates)
    basis = _free_directions(weights, is_at_limit)
    information = -basis.T @ hessian @ basis
    slope = basis.T @ gradient
    errors = np.full(2 * len(rates), np.nan)
    covariance = _inverse(information)
    if covariance is None:
        return Precision(errors[: len(rates)], errors[len(rates) :], math.nan)
    is_free = np.any(basis != 0.0, axis=1)
    variances = np.einsum("ij,jk,ik->i", basis, covariance, basis)
    errors[is_free] = np.sqrt(variances[is_free])
    remaining = 0.5 * float(slope @ covariance @ slope) / float(counts.sum())
    return Precision(errors[: len(rates)], errors[len(rates) :], remaining)


def derivatives(counts: Floats, weights: Floats, rates: Floats) -> tuple[Floats, Floats]:
    """Return gradient (2n,) and Hessian (2n, 2n) of the log-likelihood over weights, then rates.

    The weights are taken as free of each other here.
    """
    n, used = len(rates), np.flatnonzero(counts)
    means, slopes = np.array([truncated_mean(rate, len(counts) - 1) for rate in rates]).T
    laws = log_laws(rates, len(counts))[:, used]
    ratios = np.exp(laws - _log_mixed(weights, laws))
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


def _log_mixed(weights: Floats, laws: Floats) -> Floats:
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
