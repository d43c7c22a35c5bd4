"""Departures: the two readings of the paper's leaving rate mu (section 3.2), and ends of lives."""

from abc import ABC, abstractmethod
from bisect import bisect_left, insort
from enum import Enum
from typing import Final, NamedTuple

from are_ros.conventions import NS_PER_S
from are_ros.errors import ParameterError
from are_ros.parameters.choices import Departures
from are_ros.population.arrivals import ArrivalProcess, due_ns
from are_ros.population.randomness import Purpose, generator


class Cause(Enum):
    """Why an artefact departed or was blocked."""

    LIFE_OVER = "life_over"
    DISPLACED = "displaced"
    REMOVED = "removed"
    ROBOT_CONTACT = "robot_contact"
    CLOCK_JUMPED_BACK = "clock_jumped_back"
    CLOCK_LEAPT = "clock_leapt"
    RECORDING_GAP = "recording_gap"
    MAX_ALIVE = "max_alive"
    NO_PLACE = "no_place"
    REFUSED = "refused"
    NO_HIDDEN_PLACE = "no_hidden_place"
    """There is a place, but a camera sees each (population.appear: out_of_view)."""


class Departure(NamedTuple):
    """An artefact leaves at `time_ns`; it is not there at that instant any more."""

    time_ns: int
    artefact_id: int


class DepartureLaw(ABC):
    """Decides which artefact departs next, and when; times are integer nanoseconds."""

    def __init__(self, seed: int, mean_life_s: float) -> None:
        self._seed = seed
        self._rate_per_s = leaving_rate_per_s(mean_life_s)

    @abstractmethod
    def arrived(self, artefact_id: int, now_ns: int) -> None:
        """Begin a life at `now_ns`; ids are never reused."""

    @abstractmethod
    def removed(self, artefact_id: int, now_ns: int) -> None:
        """Censor a life: the artefact goes for another reason. Unknown ids are ignored."""

    @abstractmethod
    def set_mean_life(self, mean_life_s: float, now_ns: int) -> None:
        """Set the mean 1/mu from `now_ns` on, also for the rest of present lives."""

    @abstractmethod
    def next(self) -> Departure | None:
        """Return the next departure as things stand, None if there is none."""

    def pop(self) -> Departure:
        """Take the next departure; `ParameterError` if there is none."""
        departure = self.next()
        if departure is None:
            raise ParameterError("no artefact is due to leave")
        self._advance()
        self.removed(departure.artefact_id, departure.time_ns)
        return departure

    def _advance(self) -> None:  # noqa: B027 - only a law with a process of its own overrides it
        """Go on to the departure after the one that is being taken."""

    def departure_of(self, artefact_id: int) -> int | None:  # noqa: ARG002 - some laws use it
        """Return when this artefact leaves [ns], None if that is not known in advance."""
        return None

    @abstractmethod
    def restart(self, now_ns: int) -> None:
        """Forget all lives and go on at `now_ns`, earlier or later."""

    def reseed(self, seed: int, now_ns: int) -> None:  # noqa: ARG002 - some laws use it
        """Draw from another seed from `now_ns` on; lives that are drawn already stay."""
        self._seed = seed


def departure_law(kind: Departures, seed: int, mean_life_s: float) -> DepartureLaw:
    """Return the law of `population.departures`, without artefacts."""
    if kind is Departures.INDEPENDENT:
        return IndependentLives(seed, mean_life_s)
    return ConstantRateDepartures(seed, mean_life_s)


_Life = tuple[int, float, int | None]
"""An instant [ns], what is left then of the unit exponential, and when mu has consumed it [ns]."""

_NO_LIFE: Final[_Life] = (0, 0.0, None)


class IndependentLives(DepartureLaw):
    """Each life is exponential on its own: death rate i*mu, stationary law Poisson(lambda/mu).

    The life of artefact a ends when mu, integrated since its arrival, reaches the first draw of
    `generator(seed, Purpose.LIFE, a)`.
    """

    def __init__(self, seed: int, mean_life_s: float) -> None:
        super().__init__(seed, mean_life_s)
        self._lives: dict[int, _Life] = {}
        self._queue: list[Departure] = []

    def arrived(self, artefact_id: int, now_ns: int) -> None:
        """Draw the life that begins at `now_ns`."""
        stream = generator(self._seed, Purpose.LIFE, artefact_id)
        life = self._life(now_ns, float(stream.standard_exponential()))
        self._lives[artefact_id] = life
        if life[2] is not None:
            insort(self._queue, Departure(life[2], artefact_id))

    def removed(self, artefact_id: int, now_ns: int) -> None:  # noqa: ARG002 - the law's interface
        """Censor a life; the other lives do not change."""
        _, _, end_ns = self._lives.pop(artefact_id, _NO_LIFE)
        if end_ns is not None:
            del self._queue[bisect_left(self._queue, Departure(end_ns, artefact_id))]

    def set_mean_life(self, mean_life_s: float, now_ns: int) -> None:
        """Stretch or shrink what is left at `now_ns` of each life; lives that are due stay."""
        before, rate_per_s = self._rate_per_s, leaving_rate_per_s(mean_life_s)
        if rate_per_s == before:
            return
        self._rate_per_s = rate_per_s
        for artefact_id, (start_ns, hazard, end_ns) in self._lives.items():
            if end_ns is None or end_ns > now_ns:
                change_ns = max(now_ns, start_ns)
                consumed = before * ((change_ns - start_ns) / NS_PER_S)
                self._lives[artefact_id] = self._life(change_ns, max(hazard - consumed, 0.0))
        ends = ((t_ns, i) for i, (_, _, t_ns) in self._lives.items() if t_ns is not None)
        self._queue = sorted(map(Departure._make, ends))

    def next(self) -> Departure | None:
        """Return the earliest end of a life, of two at one instant that of the lower id."""
        return self._queue[0] if self._queue else None

    def departure_of(self, artefact_id: int) -> int | None:
        """Return the end of a life [ns], which only another mean life changes."""
        life = self._lives.get(artefact_id)
        return life[2] if life else None

    def restart(self, now_ns: int) -> None:  # noqa: ARG002 - the law's interface
        """Forget all lives."""
        self._lives.clear()
        self._queue.clear()

    def _life(self, start_ns: int, hazard: float) -> _Life:
        return start_ns, hazard, due_ns(start_ns, hazard, self._rate_per_s)


class ConstantRateDepartures(DepartureLaw):
    """The paper's transition matrix: departures have rate mu while there is an artefact.

    The stationary law is geometric. The j-th departure has the unit exponential E_j, the first draw
    of `generator(seed, Purpose.DEPARTURE, j)`; mu consumes it only while the population is not
    empty. The second draw chooses the artefact, uniformly among those alive at that instant.
    """

    def __init__(self, seed: int, mean_life_s: float) -> None:
        super().__init__(seed, mean_life_s)
        self._process = ArrivalProcess(seed, Purpose.DEPARTURE, rate_per_s=0.0, now_ns=0)
        self._alive: list[int] = []

    def arrived(self, artefact_id: int, now_ns: int) -> None:
        """Add the artefact to those that can depart."""
        insort(self._alive, artefact_id)
        self._process.set_rate(self._rate_per_s, now_ns)

    def removed(self, artefact_id: int, now_ns: int) -> None:
        """Remove the artefact from those that can depart; without any the process stops."""
        place = bisect_left(self._alive, artefact_id)
        if self._alive[place : place + 1] == [artefact_id]:
            del self._alive[place]
        if not self._alive:
            self._process.set_rate(0.0, now_ns)

    def set_mean_life(self, mean_life_s: float, now_ns: int) -> None:
        """Change what is left until the next departure."""
        self._rate_per_s = leaving_rate_per_s(mean_life_s)
        if self._alive:
            self._process.set_rate(self._rate_per_s, now_ns)

    def next(self) -> Departure | None:
        """Return the next departure if no artefact arrives or departs before."""
        time_ns = self._process.next_ns() if self._alive else None
        if time_ns is None:
            return None
        stream = generator(self._seed, Purpose.DEPARTURE, self._process.index)
        stream.standard_exponential()  # the process has it
        chosen = self._alive[int(stream.random() * len(self._alive))]
        return Departure(time_ns, chosen)

    def restart(self, now_ns: int) -> None:
        """Forget all lives; the present exponential goes on with the next arrival."""
        self._alive.clear()
        self._process.restart(now_ns)
        self._process.set_rate(0.0, now_ns)

    def reseed(self, seed: int, now_ns: int) -> None:
        """Begin again at departure 0 of another seed, with the same artefacts alive."""
        rate_per_s = self._rate_per_s if self._alive else 0.0
        self._seed = seed
        self._process = ArrivalProcess(
            seed, Purpose.DEPARTURE, rate_per_s=rate_per_s, now_ns=now_ns
        )

    def _advance(self) -> None:
        self._process.pop()


def leaving_rate_per_s(mean_life_s: float) -> float:
    """Return mu = 1/mean life [1/s]; `ParameterError` unless the mean is > 0 (infinite: for ever).

    Means too short for a finite rate are refused too.
    """
    rate_per_s = 1.0 / mean_life_s if mean_life_s > 0.0 else float("inf")
    if not rate_per_s < float("inf"):
        raise ParameterError(f"a mean life of {mean_life_s} s is not a duration above 0")
    return rate_per_s
