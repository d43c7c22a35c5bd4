"""Expectation and maximisation on a histogram of rows, and the accelerated climb made of them.

A point of the search is float64 (2n,): the logarithms of the n weights, then of the n rates.
"""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled

Floats = npt.NDArray[np.float64]

LOWEST_LOG_WEIGHT: Final = -700.0
"""Just above where a weight would underflow to 0, from which no step leads back."""

_TINY: Final = 1e-280
_NEWTON_STEPS: Final = 100
_RELATIVE_STEP: Final = 1e-15
_STALE_CYCLES: Final = 3
_SETTLING_STEPS: Final = 3
_WIDENING: Final = 4.0


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
def write_law(log_rate: float, log_factorials: Floats, law: Floats) -> float:
    """Write the Poisson masses of the rows (rows,) and return their sum.

    From the mode outwards, each by its neighbour: what underflows is the tails.
    """
    rate, rows = math.exp(log_rate), len(law)
    mode = min(int(rate), rows - 1)
    law[mode] = math.exp(mode * log_rate - rate - log_factorials[mode])
    mass = float(law[mode])
    for k in range(mode + 1, rows):
        law[k] = law[k - 1] * (rate / k)
        mass += law[k]
    for k in range(mode - 1, -1, -1):
        law[k] = law[k + 1] * ((k + 1) / rate)
        mass += law[k]
    return mass


@compiled
def far_terms(k: int, log_factorial: float, point: Floats, masses: Floats, terms: Floats) -> float:
    """Write weight times law of each component at a row where all of them underflow.

    They are divided by the largest, whose logarithm is returned.
    """
    n, top = len(terms), -math.inf
    for i in range(n):
        log_rate = point[n + i]
        log_law = k * log_rate - math.exp(log_rate) - log_factorial - math.log(masses[i])
        terms[i] = point[i] + log_law
        top = max(top, terms[i])
    for i in range(n):
        terms[i] = math.exp(terms[i] - top)
    return top


@compiled
def em_step(
    counts: Floats,
    log_factorials: Floats,
    limits: tuple[float, float],
    point: Floats,
    following: Floats,
) -> float:
    """Write the point after one step of EM; return the log-likelihood of the one before.

    `counts` and `log_factorials` are (rows,), `limits` those of the rates. The weighted mean of a
    component decides its rate, since a truncated Poisson law is an exponential family.
    """
    n, rows = len(point) // 2, len(counts)
    laws, terms = np.empty((n, rows)), np.empty(n)
    masses, scales = np.empty(n), np.empty(n)
    shares, moments = np.zeros(n), np.zeros(n)
    for i in range(n):
        masses[i] = write_law(point[n + i], log_factorials, laws[i])
        scales[i] = math.exp(point[i]) / masses[i]
    log_likelihood, total = 0.0, 0.0
    for k in range(rows):
        if counts[k] == 0.0:
            continue
        top, mixed = 0.0, 0.0
        for i in range(n):
            terms[i] = scales[i] * laws[i, k]
            mixed += terms[i]
        if mixed < _TINY:
            top = far_terms(k, log_factorials[k], point, masses, terms)
            mixed = terms.sum()
        log_likelihood += counts[k] * (top + math.log(mixed))
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
def leap(points: Floats, longest: float, limits: tuple[float, float], reached: Floats) -> float:
    """Write where two steps of EM point to (SQUAREM, scheme S3); return the step length.

    `points` are (3, 2n): a start, and where the first and the second step led. The length is at
    least 1 (which is the second step itself) and at most `longest`; weights sum to 1 again.
    """
    n = points.shape[1] // 2
    first = points[1] - points[0]
    bend = points[2] - points[1] - first
    bent = math.sqrt(np.dot(bend, bend))
    length = longest
    if bent > 0.0:
        length = min(max(math.sqrt(np.dot(first, first)) / bent, 1.0), longest)
    reached[:] = points[0] + 2.0 * length * first + length * length * bend
    top, mass = reached[:n].max(), 0.0
    for i in range(n):
        mass += math.exp(reached[i] - top)
    for i in range(n):
        reached[i] = max(reached[i] - top - math.log(mass), LOWEST_LOG_WEIGHT)
        log_rate = max(reached[n + i], math.log(limits[0]))
        reached[n + i] = min(log_rate, math.log(limits[1]))
    return length


@compiled
def climb(
    counts: Floats,
    log_factorials: Floats,
    limits: tuple[float, float],
    point: Floats,
    trace: Floats,
    tolerance: float,
) -> tuple[int, int, bool]:
    """Climb the likelihood by SQUAREM from `point`, which is moved to where it ends.

    Three steps of EM settle each leap. It counts only if it ends no lower than the second step
    that it rests on (the safeguard), so the log-likelihoods of the points that count, written to
    `trace`, never fall. Each evaluation is a step of EM; there are at most len(trace), of 8 or
    more. Ends when three cycles in a row gained no more than `tolerance` each. Returns how many
    evaluations there were, how many count, and whether it ended by itself.
    """
    points, reached, safe = np.empty((3, len(point))), np.empty(len(point)), point.copy()
    points[0] = point
    evaluations, kept, stale, longest, bar = 0, 0, 0, 1.0, -math.inf
    while evaluations + 7 <= len(trace) and stale < _STALE_CYCLES:
        begun = em_step(counts, log_factorials, limits, points[0], points[1])
        evaluations += 1
        if begun < bar:
            longest = max(longest / _WIDENING, _WIDENING)
            points[0] = safe
            begun = em_step(counts, log_factorials, limits, points[0], points[1])
            evaluations += 1
        ended = em_step(counts, log_factorials, limits, points[1], points[2])
        trace[kept], trace[kept + 1] = begun, ended
        evaluations, kept = evaluations + 1, kept + 2
        stale = stale + 1 if ended - bar <= tolerance else 0
        safe[:], bar = points[2], ended
        if leap(points, longest, limits, reached) == longest:
            longest *= _WIDENING
        for _ in range(_SETTLING_STEPS):
            em_step(counts, log_factorials, limits, reached, points[0])
            reached[:] = points[0]
        evaluations += _SETTLING_STEPS
    point[:] = safe
    trace[kept] = em_step(counts, log_factorials, limits, safe, reached)
    return evaluations + 1, kept + 1, stale >= _STALE_CYCLES


@compiled
def plain_climb(
    counts: Floats,
    log_factorials: Floats,
    limits: tuple[float, float],
    point: Floats,
    trace: Floats,
) -> None:
    """Take len(trace) steps of EM and no leap; `trace` gets the log-likelihood before each."""
    following = np.empty(len(point))
    for step in range(len(trace)):
        trace[step] = em_step(counts, log_factorials, limits, point, following)
        point[:] = following
