"""The policy of the decision process (section 3.2): a prior, Boltzmann's law, and slips.

An action is a behaviour, a planner and a move, and the policy chooses them in this order:
pi(b' | s) is proportional to prior(b' | b) exp(Q(s, b') / T), where Q(s, b') is the value of the
best move of b'; then pi(m | s, b') is proportional to exp(Q(s, b', m) / T). So a behaviour is not
chosen more often because it has more moves: for T to infinity the shares are those of the prior.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

_Floats = npt.NDArray[np.float64]

STAY: Final = 0
"""The move of staying; 1 to 4 go east, north, west and south."""

_TIE: Final = 1e-9


def persistence_of(period_s: float, mean_time_s: float) -> float:
    """Return the probability that an epoch passes without a new draw of the behaviour.

    `mean_time_s` is the mean time from one draw to the next when nothing else speaks.
    """
    return math.exp(-period_s / mean_time_s) if mean_time_s > 0.0 else 0.0


def prior_of(shares: _Floats, in_force: int, stays: float) -> _Floats:
    """Return the prior (B,) of the behaviours, given the index of the one in force.

    It stays in force with probability `stays`; else one is drawn by `shares` (B,), which sum to 1.
    With no other influence the stationary law is `shares`.
    """
    prior = (1.0 - stays) * shares
    prior[in_force] += stays
    return prior


def boltzmann(prior: _Floats, values: _Floats, temperature: float) -> _Floats:
    """Return probabilities (A,), proportional to prior * exp(values / temperature).

    At a temperature of 0 these are all with the best value among those that the prior allows, in
    the proportion of the prior.
    """
    behind = np.minimum(values - values[prior > 0.0].max(), 0.0)
    if temperature > 0.0:
        weights = prior * np.exp(behind / temperature)
    else:
        weights = np.where(behind >= -_TIE, prior, 0.0)
    chances: _Floats = weights / weights.sum()
    return chances


def drawn(chances: Sequence[float] | _Floats, uniform: float) -> int:
    """Return the index that a uniform number from [0, 1) draws from probabilities (A,)."""
    sums = np.cumsum(chances)
    return int(np.searchsorted(sums, uniform * sums[-1], side="right"))


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
