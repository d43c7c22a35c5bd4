"""The birth-death chain that a configuration means (section 3.2), and what follows from it."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros.description._chain import jumps_per_s, poisson_solution, tagged_survival
from are_ros.description.stationary_law import Numbers, group_tail, stationary_law
from are_ros.parameters.choices import Departures
from are_ros.parameters.model import PopulationParameters

_NEGLIGIBLE = 1e-12


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

    @cached_property
    def correlation_s(self) -> float:
        """The correlation time of N [s]: the integral of its autocorrelation; 0 if N is constant.

        It is (f, h)/(f, f) under the stationary law, where f = n - E N and h solves Poisson's
        equation Q h = -f. For independent lives without a bound it is the mean life.
        """
        levels = self._levels(0)
        law = self.law[levels] / self.law[levels].sum()
        deviations = levels - law @ levels
        variance = float(law @ deviations**2)
        if variance <= 0.0:
            return 0.0
        h = poisson_solution(self._jumps(levels), self._deaths_per_s(levels), deviations, law)
        return float(law @ (deviations * h)) / variance

    def survival(self, end_s: float, steps: int) -> Numbers:
        """Return Pr(life > t) at `steps` times from 0 to `end_s`, float64 (steps,).

        Exponential where lives are independent. At a constant rate it is the law of the time until
        one is drawn who came, with its group, in the stationary state.
        """
        times_s = np.linspace(0.0, end_s, steps)
        if self.departures is Departures.INDEPENDENT:
            survival: Numbers = np.exp(-times_s / self.mean_life_s)
            return survival
        levels = self._levels(1)
        met = self._met()[levels]
        return tagged_survival(
            self._jumps(levels), self._deaths_per_s(levels), levels, met / met.sum(), times_s
        )

    def _levels(self, least: int) -> npt.NDArray[np.int64]:
        """Return the contiguous levels from `least` up that are not negligible."""
        kept = np.flatnonzero(self.law > _NEGLIGIBLE)
        low = max(int(kept[0]), least)
        return np.arange(low, max(int(kept[-1]), low) + 1)

    def _jumps(self, levels: npt.NDArray[np.int64]) -> Any:
        tail = group_tail(self.mean_group_size, self.share)
        return jumps_per_s(len(levels), self.groups_per_s * tail)

    def _deaths_per_s(self, levels: npt.NDArray[np.int64]) -> Numbers:
        is_independent = self.departures is Departures.INDEPENDENT
        deaths: Numbers = (levels if is_independent else np.minimum(levels, 1)) / self.mean_life_s
        return deaths

    def _met(self) -> Numbers:
        """Return, up to a factor, how likely a newcomer makes its group's level n on arrival."""
        tail = np.append(group_tail(self.mean_group_size, self.share), 0.0)
        met, levels = np.zeros(len(self.law)), np.arange(len(self.law))
        for size, chance in enumerate((tail[:-1] - tail[1:]).tolist(), start=1):
            admitted = np.minimum(size, self.max_alive - levels)
            np.add.at(met, levels + admitted, chance * self.law * admitted)
        return met
