"""The birth-death chain of a configuration (section 3.2): its law, memory and lives."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros.parameters.choices import Departures
from are_ros.parameters.model import PopulationParameters
from are_ros.population.randomness import inverted

Numbers = npt.NDArray[np.float64]

_RESCALE_ABOVE = 1e200
_NEGLIGIBLE_TAIL = 1e-16


def group_tail(mean_group_size: float, share: float) -> Numbers:
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


def tagged_survival(
    jumps: Any, deaths_per_s: Numbers, levels: npt.NDArray[np.int64], met: Numbers, times_s: Numbers
) -> Numbers:
    """Return Pr(life > t) of one of n >= 1 artefacts, which leaves with chance 1/n per departure.

    `met` is the law of the level at its beginning, `times_s` are equally spaced from 0 on.
    """
    from scipy.sparse.linalg import expm_multiply

    drawn = deaths_per_s / levels
    falls = np.append(0.0, (deaths_per_s - drawn)[1:])
    rests = _diagonal(jumps.sum(axis=1) + falls + drawn)
    forward = (jumps - rests + _one_down(falls)).T
    paths = expm_multiply(forward.tocsc(), met, times_s[0], times_s[-1], len(times_s))
    survival: Numbers = np.asarray(paths).sum(axis=1)
    return survival


def _diagonal(rates_per_s: Numbers) -> Any:
    """Return a sparse matrix with these on its diagonal; scipy 1.11 has no `diags_array`."""
    from scipy.sparse import dia_array

    return dia_array((rates_per_s[None], [0]), shape=(len(rates_per_s),) * 2)


def _one_down(falls_per_s: Numbers) -> Any:
    """Return the sparse rates of falls from each level to the one below."""
    from scipy.sparse import csr_array

    levels = np.arange(1, len(falls_per_s))
    return csr_array((falls_per_s[1:], (levels, levels - 1)), shape=(len(falls_per_s),) * 2)


_NEGLIGIBLE = 1e-12
_CORRELATION_TIMES = 3.0
"""After so many, 95 % of the expected number are there."""


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
        """The stationary Pr(N = n), float64 (max_alive + 1,), summing to 1.

        By balance across each level: what leaves n + 1 is what jumps over n. Alone (g = 1) it is
        the Poisson or the geometric law, truncated. Obstacles to placement are left out.
        """
        weights = np.zeros(self.max_alive + 1)
        weights[0] = 1.0
        beyond_per_s = self._beyond_per_s
        deaths_per_s = self._deaths_per_s(np.arange(self.max_alive + 1))
        for n in range(self.max_alive):
            reach = min(n + 1, len(beyond_per_s))
            upwards = float(weights[n + 1 - reach : n + 1] @ beyond_per_s[:reach][::-1])
            weights[n + 1] = upwards / deaths_per_s[n + 1]
            if weights[n + 1] > _RESCALE_ABOVE:
                weights /= weights[n + 1]
        law: Numbers = weights / weights.sum()
        return law

    def drawn(self, random: np.random.Generator) -> int:
        """Draw N by its stationary law, with one uniform number."""
        return inverted(np.cumsum(self.law), random)

    @property
    def mean(self) -> float:
        """The stationary mean of N."""
        return float(self.law @ np.arange(len(self.law)))

    @property
    def settles_s(self) -> float:
        """About how long [s] it takes from nobody to 95 % of the stationary mean.

        Three correlation times; longer where the bound, which shortens these, is far away: the mean
        without it grows as load (1 - exp(-t / mean life)), or, at a constant rate of departures, by
        the difference of the rates, or as a random walk spreads.
        """
        wanted, growth_per_s = 0.95 * self.mean, self.members_per_s - 1.0 / self.mean_life_s
        fills_s = 0.0
        if self.departures is Departures.INDEPENDENT:
            fills_s = -self.mean_life_s * math.log1p(-min(wanted / self.load, 0.95))
        elif growth_per_s > 0.0:
            fills_s = min(wanted / growth_per_s, wanted * wanted / self.members_per_s)
        return max(_CORRELATION_TIMES * self.correlation_s, fills_s)

    @property
    def deviation(self) -> float:
        """The stationary standard deviation of N."""
        squares = (np.arange(len(self.law)) - self.mean) ** 2
        return float(np.sqrt(self.law @ squares))

    def band(self) -> tuple[int, int]:
        """Return between which levels N is in nine tenths of the time, as often below as above."""
        low, high = np.searchsorted(np.cumsum(self.law), (0.05, 0.95)).tolist()
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
        from scipy.sparse.linalg import spsolve

        levels = self._levels(0)
        law = self.law[levels] / self.law[levels].sum()
        deviations = levels - law @ levels
        variance = float(law @ deviations**2)
        if variance <= 0.0:
            return 0.0
        falls_per_s = np.append(0.0, self._deaths_per_s(levels)[1:])
        jumps = self._jumps(levels)
        generator = jumps - _diagonal(jumps.sum(axis=1) + falls_per_s) + _one_down(falls_per_s)
        # Q is singular: its equation at the likeliest level follows from the others.
        kept = np.flatnonzero(np.arange(len(law)) != np.argmax(law))
        h = np.zeros(len(law))
        h[kept] = spsolve(generator.tocsr()[kept][:, kept].tocsc(), -deviations[kept])
        return float(law @ (deviations * (h - law @ h))) / variance

    def survival(self, end_s: float, steps: int) -> Numbers:
        """Return Pr(life > t) at `steps` times from 0 to `end_s`, float64 (steps,).

        Exponential where lives are independent. At a constant rate it is the law of the time until
        an artefact is drawn that came, with its group, in the stationary state.
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

    @cached_property
    def _beyond_per_s(self) -> Numbers:
        """The rates [1/s] at which more than 0, 1, ... members come at once."""
        return self.groups_per_s * group_tail(self.mean_group_size, self.share)

    def _levels(self, least: int) -> npt.NDArray[np.int64]:
        """Return the contiguous levels from `least` up that are not negligible."""
        kept = np.flatnonzero(self.law > _NEGLIGIBLE)
        low = max(int(kept[0]), least)
        return np.arange(low, max(int(kept[-1]), low) + 1)

    def _jumps(self, levels: npt.NDArray[np.int64]) -> Any:
        """Return the sparse rates [1/s] of jumps up between these levels.

        What would leave the stretch ends at its last level.
        """
        from scipy.sparse import csr_array, dia_array, hstack

        count = len(levels)
        if count == 1:
            return csr_array((1, 1))
        reach = min(len(self._beyond_per_s), count - 1)
        by_exactly = -np.diff(np.append(self._beyond_per_s, 0.0))
        offsets = np.arange(1, reach + 1)
        bands = np.repeat(by_exactly[:reach, None], count, axis=1)
        inner = dia_array((bands, offsets), shape=(count, count))
        last = np.zeros((count, 1))
        last[count - 1 - reach : count - 1, 0] = self._beyond_per_s[:reach][::-1]
        return csr_array(hstack((inner.tocsc()[:, :-1], last)))

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
