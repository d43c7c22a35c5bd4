"""Sources of artefacts: the marked Poisson process offers groups with the rows that it drew."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from are_ros.artefacts.arrivals import ArrivalProcess
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.randomness import Purpose, generator
from are_ros.errors import ParameterError

FIRST_ID: Final = 1
"""Ids begin here; 0 is what an unset message field holds."""


@dataclass(frozen=True, eq=False)
class Offer:
    """One arrival: the group's members, each with an id of its own and its row, at `time_ns`."""

    time_ns: int
    members: tuple[tuple[int, CatalogueRow], ...]


class Source(Protocol):
    """Offers artefacts at instants of its own."""

    def next_ns(self) -> int | None:
        """Return the instant of the next offer [ns], None if none comes as things stand."""

    def take(self) -> Offer:
        """Take the next offer; `ParameterError` if none comes."""


class RowLaw(Protocol):
    """The law of the row's index, such as the Poisson mixture (Eq. 1)."""

    def sample(self, generator: np.random.Generator) -> int:
        """Draw an index."""


class RandomSource:
    """The marked Poisson process of section 3.2.

    Arrival k is a group of 1 + Poisson(g - 1) members, drawn from
    `generator(seed, Purpose.GROUP, k)`. Every member takes the next id, whatever becomes of it,
    and its row from `generator(seed, Purpose.ROW, id)`. Nothing comes before a rate is set.
    """

    def __init__(
        self, seed: int, rows: Sequence[CatalogueRow], law: RowLaw, mean_group_size: float = 1.0
    ) -> None:
        self._seed = seed
        self._arrivals = ArrivalProcess(seed, rate_per_s=0.0, now_ns=0)
        self._next_id = FIRST_ID
        self.set_rows(rows, law)
        self.set_mean_group_size(mean_group_size)

    @property
    def mean_group_size(self) -> float:
        """The mean g of a group's size."""
        return self._mean_group_size

    def next_ns(self) -> int | None:
        """Return the instant of the next arrival [ns], None if none comes at the present rate."""
        return self._arrivals.next_ns()

    def take(self) -> Offer:
        """Take the next arrival and draw its group and their rows."""
        time_ns = self._arrivals.next_ns()
        index = self._arrivals.pop()
        stream = generator(self._seed, Purpose.GROUP, index)
        size = 1 + int(stream.poisson(self._mean_group_size - 1.0))
        ids = range(self._next_id, self._next_id + size)
        self._next_id += size
        return Offer(time_ns or 0, tuple((member, self._row_of(member)) for member in ids))

    def set_rate(self, rate_per_s: float, now_ns: int) -> None:
        """Let groups arrive at another rate [1/s] from `now_ns` on."""
        self._arrivals.set_rate(rate_per_s, now_ns)

    def set_rows(self, rows: Sequence[CatalogueRow], law: RowLaw) -> None:
        """Draw later rows from another catalogue or by another law."""
        self._rows = tuple(rows)
        self._law = law

    def set_mean_group_size(self, mean: float) -> None:
        """Draw later groups of another mean size; `ParameterError` unless it is >= 1."""
        if not 1.0 <= mean < float("inf"):
            raise ParameterError(f"population.group_size is {mean}, but a group has at least one")
        self._mean_group_size = float(mean)

    def restart(self, now_ns: int) -> None:
        """Wait for the next arrival from `now_ns` on, earlier or later; ids go on."""
        self._arrivals.restart(now_ns)

    def reseed(self, seed: int, now_ns: int) -> None:
        """Begin again at arrival 0 of another seed, at the same rate; ids go on."""
        rate_per_s = self._arrivals.rate_per_s
        self._seed = seed
        self._arrivals = ArrivalProcess(seed, rate_per_s=rate_per_s, now_ns=now_ns)

    def _row_of(self, artefact_id: int) -> CatalogueRow:
        return self._rows[self._law.sample(generator(self._seed, Purpose.ROW, artefact_id))]
