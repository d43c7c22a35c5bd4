"""The birth-death chain of a configuration (section 3.2), and its stationary law."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from are_ros.parameters.choices import Departures
from are_ros.parameters.model import PopulationParameters

Numbers = npt.NDArray[np.float64]

_RESCALE_ABOVE = 1e200
_NEGLIGIBLE_TAIL = 1e-16


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
    return tail[tail > _NEGLIGIBLE_TAIL] if tail[0] > _NEGLIGIBLE_TAIL else np.zeros(1)


def _poisson_tail(rate: float) -> Numbers:
    """Return Pr(Poisson(rate) >= j), j = 0, 1, ..., summed from its far end: small terms first."""
    if rate <= 0.0:
        return np.ones(1)
    sizes = np.arange(math.ceil(rate + 12.0 * math.sqrt(rate) + 30.0))
    logs = sizes * math.log(rate) - rate - np.array([math.lgamma(k + 1.0) for k in sizes])
    tail: Numbers = np.minimum(np.cumsum(np.exp(logs)[::-1])[::-1], 1.0)
    return tail


@dataclass(frozen=True)
class BirthDeath:
    """N(t), the number alive: groups of 1 + Poisson(g - 1) come at a rate [1/s], one at a time go.

    Of the members each counts with probability `share` on its own: the others fit nowhere, or are
    of rows that never leave. What exceeds `max_alive` is blocked. With departures `independent`
    the death rate is n/mean life, with `constant_rate` 1/mean life.
    """

    groups_per_s: float
    mean_group_size: float
    mean_life_s: float
    departures: Departures
    max_alive: int
    share: float = 1.0

    @classmethod
    def of(cls, settings: PopulationParameters, area_m2: float, share: float = 1.0) -> "BirthDeath":
        """Return the chain of a configuration on an area [m^2]."""
        return cls(
            settings.arrival_rate * area_m2,
            settings.group_size,
            settings.mean_life,
            settings.departures,
            settings.max_alive,
            share,
        )

    @property
    def members_per_s(self) -> float:
        """Rate [1/s] at which members that count are offered."""
        return self.groups_per_s * self.mean_group_size * self.share

    @property
    def load(self) -> float:
        """Members offered in a mean life: lambda nu(M2D) g / mu."""
        return self.members_per_s * self.mean_life_s

    @property
    def is_grouped(self) -> bool:
        """Whether several may come at once."""
        return self.mean_group_size > 1.0

    @cached_property
    def law(self) -> Numbers:
        """The stationary Pr(N = n), float64 (max_alive + 1,)."""
        return stationary_law(
            self.groups_per_s,
            self.mean_group_size,
            self.mean_life_s,
            self.departures,
            self.max_alive,
            self.share,
        )

    @property
    def mean(self) -> float:
        """The stationary mean of N."""
        return float(self.law @ np.arange(len(self.law)))

    @property
    def deviation(self) -> float:
        """The stationary standard deviation of N."""
        squares = (np.arange(len(self.law)) - self.mean) ** 2
        return float(np.sqrt(self.law @ squares))

    def band(self, mass: float = 0.9) -> tuple[int, int]:
        """Return the least n that leave half of `1 - mass` below, and that much above."""
        tails = (0.5 * (1.0 - mass), 0.5 * (1.0 + mass))
        low, high = np.searchsorted(np.cumsum(self.law), tails).tolist()
        return low, min(high, self.max_alive)

    @property
    def blocked_share(self) -> float:
        """The share of the offered members that the bound blocks; 0 where none are offered.

        A group meets the stationary N (Poisson arrivals see time averages); of M members
        (M - (max_alive - N))+ find no room, and E(M - r)+ is the sum of Pr(M > j) over j >= r.
        """
        if self.members_per_s <= 0.0:
            return 0.0
        tail = group_tail(self.mean_group_size, self.share)
        excess = np.append(np.cumsum(tail[::-1])[::-1], 0.0)
        room = np.minimum(self.max_alive - np.arange(len(self.law)), len(tail))
        return float(self.law @ excess[room] / (self.mean_group_size * self.share))

    @property
    def mean_stay_s(self) -> float:
        """The mean life [s] by Little's law: how many are alive over how many are admitted."""
        admitted_per_s = self.members_per_s * (1.0 - self.blocked_share)
        return self.mean / admitted_per_s if admitted_per_s > 0.0 else 0.0
