"""The Poisson mixture from which an arrival draws its row of the catalogue (Eq. 1)."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.errors import ParameterError
from are_ros.parameters.model import Parameters
from are_ros.population.catalogue import Catalogue
from are_ros.population.randomness import inverted
from are_ros.wording import counted
from are_ros.world.rigid_transform import product

Numbers = npt.NDArray[np.float64]

_LEAST_KEPT_MASS = 0.5
_LEAST_EXPECTED = 5.0


class TruncatedPoissonMixture:
    """The law of X, Pr(X = k) = sum_i pi_i Poisson(k; lambda_i | 0 <= k < rows) (Eq. 1).

    A catalogue has finitely many rows. Each component is conditioned on them separately, not the
    mixture as a whole, so pi_i is the probability of component i.
    """

    def __init__(self, weights: Sequence[float], rates: Sequence[float], rows: int) -> None:
        """Take pi, at least 0, and lambda of the same length, and the number of rows.

        The weights are normalised to 1. ParameterError if the lengths differ, a rate is not
        positive, or a component has less than half of its mass on the rows.
        """
        if len(weights) != len(rates):
            msg = f"mixture.weights has {len(weights)} numbers, mixture.rates has {len(rates)}"
            raise ParameterError(msg)
        for number, rate in enumerate(rates):
            if not rate > 0.0:
                raise ParameterError(f"mixture.rates[{number}] is {rate}, but a rate is positive")
        self.weights: Numbers = np.array(weights, dtype=np.float64) / math.fsum(weights)
        """The weights pi, float64 (n,), summing to 1."""
        self.rates: Numbers = np.array(rates, dtype=np.float64)
        """The rates lambda, float64 (n,)."""
        self._components: Numbers = np.exp([_log_masses(rate, rows) for rate in rates])
        kept = self._components.sum(axis=1)
        _check_kept(rates, kept, rows)
        self._components /= kept[:, np.newaxis]
        self._probabilities: Numbers = product(self.weights, self._components)
        self._cumulative = np.cumsum(self._probabilities)
        for array in (self.weights, self.rates, self._components, self._probabilities):
            array.flags.writeable = False

    def component_probabilities(self) -> Numbers:
        """Return the law of each component, float64 (n, rows), read-only."""
        return self._components

    def probabilities(self) -> Numbers:
        """Return Pr(X = k) for every row, float64 (rows,), read-only."""
        return self._probabilities

    def sample(self, generator: np.random.Generator) -> int:
        """Draw a row by inversion, with exactly one uniform number of the generator."""
        return inverted(self._cumulative, generator)


class MixtureAmong:
    """The law of X, given that it is one of some rows, `kept`, bool (rows,)."""

    def __init__(self, law: TruncatedPoissonMixture, kept: npt.NDArray[np.bool_]) -> None:
        self._cumulative = np.cumsum(np.where(kept, law.probabilities(), 0.0))
        self.share = min(float(self._cumulative[-1]), 1.0)
        """The probability of these rows; `sample` needs more than 0."""

    def sample(self, generator: np.random.Generator) -> int:
        """Draw a row by inversion, with exactly one uniform number of the generator."""
        return inverted(self._cumulative, generator)


class GoodnessOfFit(NamedTuple):
    """Pearson's chi-square of observed rows against a law fitted to them, in pooled cells.

    Its p-value lies between `least_p` and `most_p`: with numbers fitted to the rows themselves, not
    to the cells, the law of chi-square lies between those with `cells` - 1 degrees of freedom, and
    one less for each number (Chernoff and Lehmann, 1954).
    """

    chi_square: float
    cells: int
    least_p: float
    most_p: float

    @classmethod
    def of(cls, counts: npt.ArrayLike, law: TruncatedPoissonMixture) -> "GoodnessOfFit | None":
        """Compare counts (rows,) with a law fitted to them; None where there are too few.

        Neighbouring rows are pooled until each cell expects at least five.
        """
        from scipy.special import gammaincc

        observed = np.asarray(counts, np.float64)
        expected = observed.sum() * law.probabilities()
        starts, since = [0], 0.0
        for row, number in enumerate(expected.tolist()):
            if since >= _LEAST_EXPECTED and expected[row:].sum() >= _LEAST_EXPECTED:
                starts.append(row)
                since = 0.0
            since += number
        fitted = 2 * len(law.rates) - 1
        most = len(starts) - 1
        if most <= fitted:
            return None
        expected = np.add.reduceat(expected, starts)
        differences = np.add.reduceat(observed, starts) - expected
        chi_square = float((differences**2 / expected).sum())
        p_values = (
            float(gammaincc(0.5 * free, 0.5 * chi_square)) for free in (most - fitted, most)
        )
        return cls(chi_square, len(starts), *p_values)


def mixture_of(parameters: Parameters, catalogue: Catalogue) -> TruncatedPoissonMixture:
    """Return the law of the rows that the parameters give; ParameterError where it is bad."""
    mixture = parameters.mixture
    return TruncatedPoissonMixture(mixture.weights, mixture.rates, len(catalogue.rows))


def _log_masses(rate: float, rows: int) -> Numbers:
    """Return the log of the Poisson probabilities of 0 <= k < rows."""
    log_factorials = np.array([math.lgamma(k + 1.0) for k in range(rows)])
    log_masses: Numbers = np.arange(rows) * math.log(rate) - rate - log_factorials
    return log_masses


def _check_kept(rates: Sequence[float], kept: Numbers, rows: int) -> None:
    """Raise ParameterError for a component with most of its mass outside the catalogue."""
    for number, (rate, mass) in enumerate(zip(rates, kept, strict=True)):
        if mass < _LEAST_KEPT_MASS:
            msg = (
                f"mixture.rates[{number}] is {rate:g}, which leaves only {100.0 * mass:.3g} % "
                f"of its mass on the {counted(rows, 'row')} of the catalogue, "
                "but at least half is needed"
            )
            raise ParameterError(msg)
