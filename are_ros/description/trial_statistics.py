"""How well a trial agrees with its laws: p-values of Kolmogorov-Smirnov and of chi-square."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.description.population_trial import Trial
from are_ros.parameters.choices import Departures

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_LEAST_EXPECTED: Final = 5.0
_LEAST_SHARE: Final = 0.2
_MOST_UNFINISHED: Final = 0.002
_BATCHES: Final = 40
_CORRELATIONS_PER_BATCH: Final = 5.0
_QUADRATS: Final = 5


def waits_p_value(trial: Trial) -> float:
    """Return that of the times between offers against the exponential law (KS)."""
    return _exponential_p_value(trial.waits_s, 1.0 / trial.chain.groups_per_s)


def lives_p_value(trial: Trial) -> float:
    """Return that of what is exponential of mean 1/mu in either reading of mu (KS).

    Independent lives themselves; at a constant rate, where lives depend on each other, the times
    between departures while anyone is alive. nan where the long lives are not over.
    """
    is_independent = trial.chain.departures is Departures.INDEPENDENT
    if is_independent and trial.unfinished > _MOST_UNFINISHED * len(trial.lives_s):
        return math.nan
    times_s = trial.lives_s if is_independent else trial.departure_gaps_s
    return _exponential_p_value(times_s, trial.chain.mean_life_s)


def rows_p_value(trial: Trial, probabilities: Floats) -> float:
    """Return that of the rows drawn against Eq. 1 (chi-square, rare rows taken together)."""
    counted = np.bincount(trial.rows, minlength=len(probabilities))
    return counts_p_value(counted, probabilities)


def square_p_value(points_m: Floats, side_m: float) -> float:
    """Return that of points (N, 2) in a square from (0, 0) being uniform (chi-square, 5 x 5)."""
    cells = np.minimum((points_m / side_m * _QUADRATS).astype(np.int64), _QUADRATS - 1)
    numbers = cells[:, 0] * _QUADRATS + cells[:, 1]
    count = _QUADRATS * _QUADRATS
    return counts_p_value(np.bincount(numbers, minlength=count), np.full(count, 1.0 / count))


def counts_p_value(counted: Integers, probabilities: Floats) -> float:
    """Return that of counts (K,) under a law (chi-square); nan where they are too few.

    The likeliest classes stand alone as long as five are expected; the others are one.
    """
    from scipy.stats import chisquare

    expected = counted.sum() * probabilities / probabilities.sum()
    alone = expected >= _LEAST_EXPECTED
    if not alone.all() and alone.any() and expected[~alone].sum() < _LEAST_EXPECTED:
        alone[np.argmin(np.where(alone, expected, np.inf))] = False
    pooled = _with_rest(counted, alone), _with_rest(expected, alone)
    return float(chisquare(*pooled).pvalue) if len(pooled[0]) > 1 else math.nan


def time_shares(changes_s: Floats, alive: Integers, end_s: float, count: int) -> Floats:
    """Return the shares of time (count,) that a path spends at the levels 0, 1, ..., count - 1."""
    lasted_s = np.diff(np.append(changes_s, end_s))
    spent_s = np.bincount(alive, weights=lasted_s, minlength=count)[:count]
    shares: Floats = spent_s / float(lasted_s.sum())
    return shares


def path_p_value(
    changes_s: Floats, alive: Integers, end_s: float, law: Floats, correlation_s: float
) -> float:
    """Return that of the time which a path spent at its levels, under its stationary law.

    Time-weighted, by batch means: from the first visit to the likeliest level on the path is cut
    into 40 batches, long against the correlation time, so that they are nearly independent. The
    mean of their shares of time, in the metric of their covariance, is compared with its law
    (Hotelling's T^2). Levels are taken together until each class holds a fifth of the time. nan
    where the path is shorter than 200 correlation times.
    """
    from scipy.stats import f as fisher

    classes = _classes(law)
    size = int(classes.max())
    visits = np.flatnonzero(alive == np.argmax(law))
    begin_s = float(changes_s[visits[0]]) if len(visits) else end_s
    if size < 1 or end_s - begin_s < _BATCHES * _CORRELATIONS_PER_BATCH * correlation_s:
        return math.nan
    edges_s = np.linspace(begin_s, end_s, _BATCHES + 1)
    shares = _shares_between(edges_s, changes_s, classes[alive], size + 1)
    excess = (shares - np.bincount(classes, weights=law))[:, :-1]
    mean, covariance = excess.mean(axis=0), np.cov(excess, rowvar=False).reshape(size, size)
    squared = _BATCHES * float(mean @ np.linalg.pinv(covariance) @ mean)
    scaled = squared * (_BATCHES - size) / (size * (_BATCHES - 1))
    return float(fisher.sf(scaled, size, _BATCHES - size))


def _shares_between(edges_s: Floats, changes_s: Floats, classes: Integers, count: int) -> Floats:
    """Return the shares of time (B, count) of each class between B + 1 edges of a path."""
    cuts_s = np.sort(np.concatenate((edges_s, changes_s)))
    cuts_s = cuts_s[(cuts_s >= edges_s[0]) & (cuts_s <= edges_s[-1])]
    middles_s, lasted_s = 0.5 * (cuts_s[:-1] + cuts_s[1:]), np.diff(cuts_s)
    batch = np.clip(np.searchsorted(edges_s, middles_s) - 1, 0, len(edges_s) - 2)
    spent_s = np.zeros((len(edges_s) - 1, count))
    np.add.at(spent_s, (batch, classes[np.searchsorted(changes_s, middles_s) - 1]), lasted_s)
    shares: Floats = spent_s / np.diff(edges_s)[:, np.newaxis]
    return shares


def _exponential_p_value(times_s: Floats, mean_s: float) -> float:
    from scipy.stats import kstest

    return float(kstest(times_s, "expon", args=(0.0, mean_s)).pvalue) if len(times_s) else math.nan


def _with_rest(values: npt.NDArray[np.number], alone: npt.NDArray[np.bool_]) -> Floats:
    """Return the values that stand alone, and the sum of the others where there are any."""
    kept: Floats = values[alone].astype(np.float64)
    return np.append(kept, values[~alone].sum()) if (~alone).any() else kept


def _classes(law: Floats) -> Integers:
    """Return the number of each level's class: neighbours of a fifth or more together."""
    groups, number, mass = np.zeros(len(law), np.int64), 0, 0.0
    above = np.append(np.cumsum(law[::-1])[::-1][1:], 0.0)
    for level, chance in enumerate(law.tolist()):
        groups[level] = number
        mass += chance
        if mass >= _LEAST_SHARE and above[level] >= _LEAST_SHARE:
            number, mass = number + 1, 0.0
    return groups
