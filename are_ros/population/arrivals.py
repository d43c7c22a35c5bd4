"""Random arrivals: a marked Poisson process (section 3.2).

Each event is a group of artefacts, each with its row of the catalogue. The process consumes unit
exponentials by the integrated rate, so the rate may change at any time.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from are_ros.conventions import NS_PER_S
from are_ros.errors import ParameterError
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.randomness import Purpose, generator

LAST_NS: Final = 2**63 - 1
"""The last instant of a signed 64-bit clock; an event after it never comes."""


def due_ns(start_ns: int, hazard: float, rate_per_s: float) -> int | None:
    """Return when `rate_per_s`, in force from `start_ns` on, has consumed `hazard` >= 0.

    The instant is rounded up to a whole nanosecond; None if it never comes.
    """
    if rate_per_s <= 0.0:
        return None
    wait_ns = hazard / rate_per_s * NS_PER_S
    if not wait_ns < LAST_NS:
        return None
    instant_ns = start_ns + math.ceil(wait_ns)
    return instant_ns if instant_ns <= LAST_NS else None


def checked_rate(rate_per_s: float) -> float:
    """Return the rate [1/s] as a float; `ParameterError` unless it is finite and >= 0."""
    if not (math.isfinite(rate_per_s) and rate_per_s >= 0.0):
        raise ParameterError(f"a rate of {rate_per_s} events per second is not finite and >= 0")
    return float(rate_per_s)


class ArrivalProcess:
    """Events k = 0, 1, ... of a Poisson process with a rate that may change (section 3.2).

    Event k comes when the rate, integrated since event k - 1, reaches the unit exponential E_k,
    the first draw of `generator(seed, purpose, k)`. So no draw depends on how often or when the
    rate is set, and a changed rate acts at once on the rest of E_k. Times are integer nanoseconds,
    rounded up and never decreasing; the next exponential makes up for the rounding, so the error
    does not accumulate.
    """

    def __init__(
        self, seed: int, purpose: Purpose = Purpose.ARRIVAL, *, rate_per_s: float, now_ns: int
    ) -> None:
        self._seed = seed
        self._purpose = purpose
        self.rate_per_s = checked_rate(rate_per_s)
        self.index = 0
        """Number k of the next event."""
        self._anchor_ns = now_ns
        self._consumed = 0.0
        self._exponential = self._draw()

    def next_ns(self) -> int | None:
        """Return the time of event `index`, None if it never comes at the present rate."""
        hazard = max(self._exponential - self._consumed, 0.0)
        return due_ns(self._anchor_ns, hazard, self.rate_per_s)

    def pop(self) -> int:
        """Take the next event and return its number k; `ParameterError` if it never comes."""
        instant_ns = self.next_ns()
        if instant_ns is None:
            raise ParameterError(f"no event comes at a rate of {self.rate_per_s} per second")
        self._consume_until(instant_ns)
        self._consumed = max(self._consumed - self._exponential, 0.0)
        self.index += 1
        self._exponential = self._draw()
        return self.index - 1

    def set_rate(self, rate_per_s: float, now_ns: int) -> None:
        """Set the rate [1/s] from `now_ns` on; the same rate again changes nothing.

        All events before `now_ns` are taken. A `now_ns` before the last change or event counts as
        that instant.
        """
        rate_per_s = checked_rate(rate_per_s)
        if rate_per_s != self.rate_per_s:
            self._consume_until(max(now_ns, self._anchor_ns))
            self.rate_per_s = rate_per_s

    def restart(self, now_ns: int) -> None:
        """Go on at `now_ns`, earlier or later, with the rest of the present exponential.

        Called when the clock jumps. Set the rate to 0 before, by the clock before the jump: what is
        not consumed then is waited for once more.
        """
        self._anchor_ns = now_ns

    def _consume_until(self, instant_ns: int) -> None:
        self._consumed += self.rate_per_s * ((instant_ns - self._anchor_ns) / NS_PER_S)
        self._anchor_ns = instant_ns

    def _draw(self) -> float:
        stream = generator(self._seed, self._purpose, self.index)
        return float(stream.standard_exponential())


FIRST_ID: Final = 1
"""Ids begin here; 0 is what an unset message field holds."""


@dataclass(frozen=True, eq=False)
class Offer:
    """The arrival of one group at `time_ns`: the id and the row of each member."""

    time_ns: int
    members: tuple[tuple[int, CatalogueRow], ...]


class RowLaw(Protocol):
    """The law of the row's index, such as the Poisson mixture (Eq. 1)."""

    def sample(self, generator: np.random.Generator) -> int:
        """Draw an index."""


class RandomSource:
    """The marked Poisson process of section 3.2.

    Arrival k is a group of 1 + Poisson(g - 1) members, drawn from
    `generator(seed, Purpose.GROUP, k)`. Each member takes the next id, even if there is no place
    for it, and its row from `generator(seed, Purpose.ROW, id)`. The rate is 0 until it is set.
    """

    def __init__(
        self, seed: int, rows: Sequence[CatalogueRow], law: RowLaw, mean_group_size: float
    ) -> None:
        self._seed = seed
        self._arrivals = ArrivalProcess(seed, rate_per_s=0.0, now_ns=0)
        self._next_id = FIRST_ID
        self.set_marks(rows, law, mean_group_size)

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
        return Offer(
            time_ns or 0,
            tuple(
                (member, self._rows[self._law.sample(generator(self._seed, Purpose.ROW, member))])
                for member in ids
            ),
        )

    def take_beside(self, now_ns: int, law: RowLaw) -> Offer:
        """Return one artefact that comes beside the process, its row by a law of its own."""
        artefact_id = self._next_id
        self._next_id += 1
        row = self._rows[law.sample(generator(self._seed, Purpose.ROW, artefact_id))]
        return Offer(now_ns, ((artefact_id, row),))

    def set_rate(self, rate_per_s: float, now_ns: int) -> None:
        """Set the rate of groups [1/s] from `now_ns` on."""
        self._arrivals.set_rate(rate_per_s, now_ns)

    def set_marks(self, rows: Sequence[CatalogueRow], law: RowLaw, mean_group_size: float) -> None:
        """Draw later groups from another catalogue, by another law, of another mean size.

        `ParameterError` unless the mean size is >= 1.
        """
        if not 1.0 <= mean_group_size < float("inf"):
            message = f"population.group_size is {mean_group_size}, but a group has at least one"
            raise ParameterError(message)
        self._rows = tuple(rows)
        self._law = law
        self._mean_group_size = float(mean_group_size)

    def restart(self, now_ns: int) -> None:
        """Wait for the next arrival from `now_ns` on, earlier or later; ids go on."""
        self._arrivals.restart(now_ns)

    def reseed(self, seed: int, now_ns: int) -> None:
        """Begin again at arrival 0 of another seed, at the same rate; ids go on."""
        rate_per_s = self._arrivals.rate_per_s
        self._seed = seed
        self._arrivals = ArrivalProcess(seed, rate_per_s=rate_per_s, now_ns=now_ns)
