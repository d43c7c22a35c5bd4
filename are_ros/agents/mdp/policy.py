"""The policy of the decision process (section 3.2): a prior, Boltzmann's law, and slips.

An action is a behaviour, a planner and a move, and the policy chooses them in this order:
pi(b' | s) is proportional to prior(b' | b) exp(Q(s, b') / T), where Q(s, b') is the value of the
best move of b'; then pi(m | s, b') is proportional to exp(Q(s, b', m) / T). So a behaviour is not
chosen more often because it has more moves: for T to infinity the shares are those of the prior.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate, compress
from typing import Final

STAY: Final = 0
"""The move of staying; 1 to 4 go east, north, west and south."""

_TIE: Final = 1e-9
_ROUNDING: Final = 1e-9


def persistence_of(period_s: float, mean_time_s: float) -> float:
    """Return the probability that an epoch passes without a new draw of the behaviour.

    `mean_time_s` is the mean time from one draw to the next when nothing else speaks.
    """
    return math.exp(-period_s / mean_time_s) if mean_time_s > 0.0 else 0.0


def prior_of(shares: Sequence[float], in_force: int, stays: float) -> list[float]:
    """Return the prior (B,) of the behaviours, given the index of the one in force.

    It stays in force with probability `stays`; else one is drawn by `shares` (B,), which sum to 1.
    With no other influence the stationary law is `shares`.
    """
    prior = [(1.0 - stays) * share for share in shares]
    prior[in_force] += stays
    return prior


def boltzmann(prior: Sequence[float], values: Sequence[float], temperature: float) -> list[float]:
    """Return weights (A,), proportional to prior * exp(values / temperature); `drawn` takes them.

    At a temperature of 0 these are 0 but for those with the best value that the prior allows, which
    keep the proportion of the prior.
    """
    best, pairs = max(compress(values, prior)), zip(prior, values, strict=True)
    if temperature > 0.0:
        exp = math.exp
        return [
            share * exp((value - best) / temperature) if value < best else share
            for share, value in pairs
        ]
    return [share if value >= best - _TIE else 0.0 for share, value in pairs]


def drawn(weights: Sequence[float], uniform: float) -> int:
    """Return the index that a uniform number from [0, 1) draws by weights (A,), not all 0."""
    sums = list(accumulate(weights))
    return bisect_right(sums, uniform * sums[-1])


def surely_drawn(
    prior: Sequence[float],
    ranges: Sequence[tuple[float, float]],
    advantages: Sequence[float],
    period_s: float,
    temperature: float,
    uniform: float,
) -> int | None:
    """Return what `drawn` returns by `boltzmann`'s weights, if rewards between bounds all agree.

    `ranges` (A,) are the least and the greatest reward of a second, `advantages` (A,) are added to
    that of an epoch. The temperature is above 0. The result is None if the rewards matter, or if
    rounding might.
    """
    exp, lows, highs = math.exp, list[float](), list[float]()
    top = period_s * max(high for _, high in ranges) + max(advantages)
    for share, (low, high), advantage in zip(prior, ranges, advantages, strict=True):
        weight = share * exp((period_s * low + advantage - top) / temperature)
        lows.append(weight)
        if high != low:
            weight = share * exp((period_s * high + advantage - top) / temperature)
        highs.append(weight)
    index = drawn(lows, uniform)
    if index == len(lows):  # all are 0, by rounding
        return None
    own, rest, keeps = lows[index], 1.0 - uniform, 1.0 - _ROUNDING
    above, below = sum(lows[index:]), sum(lows[:index]) + own
    is_sure = (
        sum(highs[:index]) * rest <= keeps * uniform * above
        and sum(highs[index + 1 :]) * uniform < keeps * rest * below
    )
    return index if is_sure else None


def slipped(move: int, slip: float, uniform: float) -> int:
    """Return what becomes of a move: itself, STAY if it fails, or the one to its left or right.

    It fails with probability slip / 2, and goes to either side with slip / 4. Staying never slips.
    """
    if move == STAY or uniform >= slip:
        return move
    if uniform < 0.5 * slip:
        return STAY
    turn = 1 if uniform < 0.75 * slip else 3
    return 1 + (move - 1 + turn) % 4
