"""One search for the most likely mixture, which can be taken up again where it ended."""

from dataclasses import dataclass
from enum import Enum
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln

from are_ros.artefacts._mixture_kernels import LOWEST_LOG_WEIGHT, climb
from are_ros.artefacts._mixture_starts import Start

Floats = npt.NDArray[np.float64]

_TOLERANCE: Final = 1e-12
"""Of the log-likelihood per sample."""


class Stop(Enum):
    """Why a search ended."""

    CONVERGED = "three cycles in a row gained less than the tolerance"
    LIMIT = "the limit of evaluations was reached"


@dataclass(frozen=True)
class Search:
    """One climb: where it began, the steps of EM it took, log-likelihood per sample at its end."""

    start: str
    evaluations: int
    log_likelihood: float
    stop: Stop


class Climb:
    """A search that can be taken up again where it ended."""

    def __init__(self, counts: Floats, limits: tuple[float, float], start: Start) -> None:
        self.name = start.name
        with np.errstate(divide="ignore"):
            log_weights = np.maximum(np.log(start.weights), LOWEST_LOG_WEIGHT)
        self.point = np.concatenate((log_weights, np.log(np.clip(start.rates, *limits))))
        self.trace = np.empty(0)
        self.evaluations = 0
        self.is_over = False
        self._counts, self._limits = counts, limits
        self._log_factorials = gammaln(np.arange(len(counts)) + 1.0)

    @property
    def log_likelihood(self) -> float:
        """The log-likelihood where it stands now."""
        return float(self.trace[-1])

    def go_on(self, evaluations: int) -> None:
        """Climb on, by so many evaluations at most."""
        if self.is_over:
            return
        trace = np.empty(evaluations)
        tolerance = _TOLERANCE * float(self._counts.sum())
        used, kept, self.is_over = climb(
            self._counts, self._log_factorials, self._limits, self.point, trace, tolerance
        )
        # The last point of the part before is the first of this one.
        self.trace = np.concatenate((self.trace[:-1], trace[:kept]))
        self.evaluations += used

    def summary(self, samples: float) -> Search:
        """Return what is to be told of it."""
        stop = Stop.CONVERGED if self.is_over else Stop.LIMIT
        return Search(self.name, self.evaluations, self.log_likelihood / samples, stop)
