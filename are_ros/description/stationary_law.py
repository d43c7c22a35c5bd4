"""The stationary law of the number of artefacts alive: the birth-death chain of section 3.2."""

import math

import numpy as np
import numpy.typing as npt

from are_ros.parameters.choices import Departures

Numbers = npt.NDArray[np.float64]

_RESCALE_ABOVE = 1e200
_NEGLIGIBLE = 1e-16


def stationary_law(
    groups_per_s: float,
    mean_group_size: float,
    mean_life_s: float,
    departures: Departures,
    max_alive: int,
    share: float = 1.0,
) -> Numbers:
    """Return Pr(N = n) for 0 <= n <= max_alive, float64 (max_alive + 1,), summing to 1.

    Groups of 1 + Poisson(g - 1) members come at a rate [1/s], of whom each counts with probability
    `share` on its own; members beyond the bound are blocked. One leaves at rate n/mean life
    (independent) or 1/mean life (constant_rate). Alone (g = 1) these are the Poisson and the
    geometric law, truncated. By balance across each level: what leaves n + 1 is what jumps over n.
    Obstacles to placement and lives without end are left out.
    """
    weights = np.zeros(max_alive + 1)
    weights[0] = 1.0
    beyond = group_tail(mean_group_size, share)
    is_independent = departures is Departures.INDEPENDENT
    for n in range(max_alive):
        reach = min(n + 1, len(beyond))
        upwards = float(weights[n + 1 - reach : n + 1] @ beyond[:reach][::-1])
        leavers = n + 1 if is_independent else 1
        weights[n + 1] = groups_per_s * mean_life_s * upwards / leavers
        if weights[n + 1] > _RESCALE_ABOVE:
            weights /= weights[n + 1]
    law: Numbers = weights / weights.sum()
    return law


def group_tail(mean_group_size: float, share: float = 1.0) -> Numbers:
    """Return Pr(M > j) for j = 0, 1, ... until it is negligible, M the members that count.

    The group has 1 + Poisson(g - 1) members, each counted with probability `share`: so M is a
    Bernoulli variable of that share plus Poisson(share (g - 1)), independent.
    """
    at_least = _poisson_tail(share * (mean_group_size - 1.0))
    one_more = np.append(at_least[1:], 0.0)
    tail: Numbers = share * at_least + (1.0 - share) * one_more
    return tail[tail > _NEGLIGIBLE] if tail[0] > _NEGLIGIBLE else np.zeros(1)


def _poisson_tail(rate: float) -> Numbers:
    """Return Pr(Poisson(rate) >= j), j = 0, 1, ..., summed from its far end: small terms first."""
    if rate <= 0.0:
        return np.ones(1)
    sizes = np.arange(math.ceil(rate + 12.0 * math.sqrt(rate) + 30.0))
    logs = sizes * math.log(rate) - rate - np.array([math.lgamma(k + 1.0) for k in sizes])
    tail: Numbers = np.minimum(np.cumsum(np.exp(logs)[::-1])[::-1], 1.0)
    return tail
