"""The population: arrivals, lives and departures of artefacts (section 3.2).

Random arrivals are a marked Poisson process, ends of lives follow a law of departures; together
they are the birth-death chain of the paper. Scripted artefacts come from a scenario, others by
request. The caller asks when the next event is due, and has it processed.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import islice
from operator import attrgetter
from types import MappingProxyType

import numpy as np

from are_ros.conventions import NS_PER_S
from are_ros.errors import InputError, PlacementError
from are_ros.population.arrivals import Offer, RandomSource, RowLaw, checked_rate
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.departures import (
    Cause,
    Departure,
    DepartureLaw,
    leaving_rate_per_s,
)
from are_ros.population.randomness import Purpose, generator, inverted
from are_ros.population.scenario import Scenario, ScriptedOffer, ScriptedSource


class EventKind(Enum):
    """What happened to an artefact."""

    ARRIVED = "arrived"
    DEPARTED = "departed"
    BLOCKED = "blocked"
    LEAVING = "leaving"
    """Its life is over. It walks to an exit and departs there."""


@dataclass(frozen=True, eq=False)
class PopulationEvent:
    """One artefact arrived, departed, or was refused a place, at `time_ns` [ns].

    An arrival has no cause. `reason` says in words why a scripted artefact is refused.
    """

    time_ns: int
    kind: EventKind
    artefact_id: int
    row: CatalogueRow
    cause: Cause | None
    reason: str


@dataclass(frozen=True)
class Counts:
    """Totals so far: arrived + blocked were offered, arrived - departed are alive."""

    arrived: int = 0
    blocked: int = 0
    departed: int = 0

    def after(self, kind: EventKind) -> "Counts":
        """Return the counts with one more event."""
        return Counts(
            arrived=self.arrived + (kind is EventKind.ARRIVED),
            blocked=self.blocked + (kind is EventKind.BLOCKED),
            departed=self.departed + (kind is EventKind.DEPARTED),
        )


Place = Callable[
    [CatalogueRow, np.random.Generator, tuple[float, float] | None], GroundPose | Cause
]
"""(row, generator, (x, y) of the group's first member) -> a free pose, or why there is none."""


Admit = Callable[[ScriptedOffer], GroundPose | str]
"""A scripted artefact that is to arrive -> where it stands, or why it cannot stand there."""


class Population:
    """The artefacts alive, and the events that change them, one at a time and in order.

    Of two events at one instant, a departure comes before an arrival. The bound `max_alive`
    counts all artefacts alive. The law of departures does not apply to artefacts of rows that
    live for ever, nor to those with a given end.

    If `stays_on` is true, the artefact outlives its end until it is removed: it is leaving, and
    still counts as alive, but the law of departures no longer applies to it.
    """

    def __init__(
        self,
        seed: int,
        source: RandomSource,
        departures: DepartureLaw,
        *,
        max_alive: int,
        history_ns: int = 2 * NS_PER_S,
        stays_on: Callable[[Artefact], bool] = lambda _: False,
        begun: Callable[[Artefact, ScriptedOffer | None], object] = lambda *_: None,
        scripted: ScriptedSource | None = None,
    ) -> None:
        """Take the parts; `begun(artefact, offer)` is called for each arrival.

        Departed artefacts stay known to `present_at` for `history_ns`.
        """
        self.scripted = scripted or ScriptedSource(Scenario())
        self.max_alive = max_alive
        self._begun = begun
        self._stays_on = stays_on
        self._seed = seed
        self._source = source
        self._law = departures
        self._is_given: set[int] = set()
        """The ids of the artefacts alive whose ends are given, and not drawn by the law."""
        self._history_ns = history_ns
        self._living: dict[int, Artefact] = {}
        self._departed: deque[Artefact] = deque()
        self._causes: dict[int, Cause] = {}
        self.counts = Counts()

    @property
    def living(self) -> Mapping[int, Artefact]:
        """The artefacts alive by id, in the order of their ids: a view, always up to date."""
        return MappingProxyType(self._living)

    def start(self, now_ns: int) -> None:
        """Begin at `now_ns`, or again after a clock jump, without artefacts; ids go on.

        Present artefacts are dropped without an event. `halt` before a jump.
        """
        self._living.clear()
        self._departed.clear()
        self._causes.clear()
        self._source.restart(now_ns)
        self.scripted.restart(now_ns)
        self._restart_lives(now_ns)

    def interrupt(self, from_ns: int, until_ns: int) -> None:
        """Go on at `until_ns`, after all artefacts have departed at `from_ns`, where it halted.

        The wait for the next random arrival goes on after the gap; the scenario is postponed by it.
        """
        self._source.restart(until_ns)
        self._restart_lives(until_ns)
        self.scripted.postpone(until_ns - from_ns)

    def reseed(self, seed: int, now_ns: int) -> None:
        """Draw from another seed from `now_ns` on; artefacts alive stay, ids go on."""
        self._seed = seed
        self._source.reseed(seed, now_ns)
        self._law.reseed(seed, now_ns)

    def halt(self, now_ns: int) -> None:
        """Let no random event come nearer from `now_ns` on, until `set_rates`.

        What has been waited for is kept, so that a jump of the clock lengthens no wait.
        """
        self.set_rates(0.0, 0.0, math.inf, now_ns)

    def set_rates(
        self, arrival_rate: float, area_m2: float, mean_life_s: float, now_ns: int
    ) -> None:
        """Set lambda [1/(m^2 s)], nu(M2D) [m^2] and 1/mu [s] from `now_ns` on.

        Values that are already in force change nothing, bit for bit. Raises `ParameterError`, and
        changes nothing, where one is out of its domain.
        """
        rate_per_s = checked_rate(arrival_rate * area_m2)
        leaving_rate_per_s(mean_life_s)
        self._source.set_rate(rate_per_s, now_ns)
        self._law.set_mean_life(mean_life_s, now_ns)
        for artefact in self._living.values():
            if artefact.id not in self._is_given:
                artefact.departure_ns = self._law.departure_of(artefact.id)

    def set_marks(self, rows: Sequence[CatalogueRow], law: RowLaw, mean_group_size: float) -> None:
        """Set rows, law and mean group size of later arrivals."""
        self._source.set_marks(rows, law, mean_group_size)

    def postpone(self, from_ns: int, until_ns: int) -> None:
        """Postpone given ends of lives, and scripted arrivals still to come, by a pause.

        Of the pause counts, for each artefact, what was left of it at its arrival.
        """
        self.scripted.postpone(until_ns - from_ns)
        for artefact_id in self._is_given:
            artefact = self._living[artefact_id]
            if artefact.departure_ns is not None:
                artefact.departure_ns += until_ns - max(from_ns, artefact.arrival_ns)

    def next_event_ns(self) -> int | None:
        """Return when `handle_next` has something to do [ns], None if never as things stand."""
        departure = self._next_departure()
        instants = (
            departure.time_ns if departure else None,
            self.scripted.next_ns(),
            self._source.next_ns(),
        )
        return min((t_ns for t_ns in instants if t_ns is not None), default=None)

    def handle_next(self, place: Place, admit: Admit = attrgetter("pose")) -> list[PopulationEvent]:
        """Process the next event: one departure, a scripted arrival, or the arrival of one group.

        At one instant they come in this order. `place` finds a pose for each member of a group in
        turn; the members before it are alive already. `admit` returns where a scripted artefact
        stands, or why it cannot. Returns one event per artefact; `ParameterError` if no event
        is due.
        """
        departure, next_ns = self._next_departure(), self.next_event_ns()
        if departure and departure.time_ns == next_ns:
            if departure.artefact_id not in self._is_given:
                self._law.pop()
            return [self._end(departure)]
        if next_ns is not None and self.scripted.next_ns() == next_ns:
            return [self._arrive_by_script(admit)]
        return self._arrive(self._source.take(), place)

    def populate(self, count: int, now_ns: int, place: Place, law: RowLaw) -> list[PopulationEvent]:
        """Have so many artefacts arrive at `now_ns`, beside the process, of rows by this law.

        What is left of their lives has the law of whole lives, which have no memory.
        """
        offers = (self._source.take_beside(now_ns, law) for _ in range(count))
        return [event for offer in offers for event in self._arrive(offer, place)]

    def remove(self, artefact_id: int, now_ns: int, cause: Cause) -> PopulationEvent:
        """Remove an artefact at `now_ns`; `InputError` if the id is unknown.

        It stays known to `present_at` for the history's length.
        """
        artefact = self._living.pop(artefact_id, None)
        if artefact is None:
            raise InputError(f"no artefact with id {artefact_id} is alive")
        self._end_life(artefact_id, now_ns)
        artefact.departure_ns = now_ns
        self._causes.pop(artefact_id, None)
        self._departed.append(artefact)
        self._forget_before(now_ns - self._history_ns)
        return self._event(now_ns, EventKind.DEPARTED, artefact_id, artefact.row, cause)

    def admit(
        self,
        row: CatalogueRow,
        pose: GroundPose,
        now_ns: int,
        *,
        life_ns: int | None = None,
        behaviour: str = "",
    ) -> PopulationEvent:
        """Add a requested artefact at a pose that the caller found free.

        `life_ns` [ns] gives the length of its life; with None the law of departures draws it, or it
        has no end if its row lives for ever. A behaviour that is not given is drawn from the row's.
        Raises `PlacementError` at the bound.
        """
        if self._is_full():
            msg = (
                f"{row.label} is refused: {len(self._living)} artefacts live, population.max_alive"
            )
            raise PlacementError(msg)
        artefact_id = self.scripted.new_id()
        end_ns = None if life_ns is None else now_ns + life_ns
        return self._begin(artefact_id, row, pose, now_ns, Origin.SERVICE, end_ns, behaviour)

    def present_at(self, t_ns: int) -> list[Artefact]:
        """Return the artefacts present at `t_ns` (arrival <= t < departure), by id.

        Complete as far back as the history reaches before the last departure.
        """
        everyone = [*self._departed, *self._living.values()]
        present = [
            artefact
            for artefact in everyone
            if artefact.arrival_ns <= t_ns
            and (artefact.departure_ns is None or t_ns < artefact.departure_ns)
        ]
        return sorted(present, key=attrgetter("id"))

    def _end(self, departure: Departure) -> PopulationEvent:
        """End a life: the artefact departs, or starts to walk to an exit."""
        time_ns, artefact_id = departure
        artefact = self._living[artefact_id]
        if not self._stays_on(artefact):
            cause = self._causes.get(artefact_id, Cause.LIFE_OVER)
            return self.remove(artefact_id, time_ns, cause)
        self._end_life(artefact_id, time_ns)
        artefact.departure_ns = None
        return self._event(time_ns, EventKind.LEAVING, artefact_id, artefact.row, Cause.LIFE_OVER)

    def _next_departure(self) -> Departure | None:
        """Return the next end of a life, drawn or given, of two at one instant the lower id."""
        ends = [(self._living[i].departure_ns, i) for i in self._is_given]
        next_ones = [Departure(end_ns, i) for end_ns, i in ends if end_ns is not None]
        drawn = self._law.next()
        return min([*next_ones, drawn] if drawn else next_ones, default=None)

    def _end_life(self, artefact_id: int, now_ns: int) -> None:
        """Forget a life that is over, or that is cut short."""
        if artefact_id in self._is_given:
            self._is_given.remove(artefact_id)
        else:
            self._law.removed(artefact_id, now_ns)

    def _restart_lives(self, now_ns: int) -> None:
        self._is_given.clear()
        self._law.restart(now_ns)

    def _arrive_by_script(self, admit: Admit) -> PopulationEvent:
        offer = self.scripted.take()
        now_ns, artefact_id, scripted = offer.time_ns, offer.artefact_id, offer.artefact
        pose = admit(offer)
        if isinstance(pose, str) or self._is_full():
            cause = Cause.REFUSED if isinstance(pose, str) else Cause.MAX_ALIVE
            reason = f"{offer.place}: {pose}" if isinstance(pose, str) else ""
            blocked = EventKind.BLOCKED
            return self._event(now_ns, blocked, artefact_id, scripted.row, cause, reason=reason)
        self._causes[artefact_id] = scripted.cause
        end_ns = None if scripted.stays_ns is None else now_ns + scripted.stays_ns
        return self._begin(
            artefact_id,
            scripted.row,
            pose,
            now_ns,
            scripted.origin,
            end_ns,
            scripted.behaviour,
            offer,
        )

    def _arrive(self, offer: Offer, place: Place) -> list[PopulationEvent]:
        events: list[PopulationEvent] = []
        near: tuple[float, float] | None = None
        for artefact_id, row in offer.members:
            pose: GroundPose | Cause = Cause.MAX_ALIVE
            if not self._is_full():
                stream = generator(self._seed, Purpose.PLACE, artefact_id)
                pose = place(row, stream, near)
            if isinstance(pose, Cause):
                blocked = EventKind.BLOCKED
                events.append(self._event(offer.time_ns, blocked, artefact_id, row, pose))
                continue
            near = near or (pose.x_m, pose.y_m)
            events.append(self._begin(artefact_id, row, pose, offer.time_ns, Origin.RANDOM, None))
        return events

    def _begin(
        self,
        artefact_id: int,
        row: CatalogueRow,
        pose: GroundPose,
        now_ns: int,
        origin: Origin,
        end_ns: int | None,
        behaviour: str = "",
        offer: ScriptedOffer | None = None,
    ) -> PopulationEvent:
        may_change = not behaviour
        behaviour = behaviour or self._drawn_behaviour(artefact_id, row)
        if end_ns is not None or row.forever or offer is not None:
            self._is_given.add(artefact_id)
        else:
            self._law.arrived(artefact_id, now_ns)
            end_ns = self._law.departure_of(artefact_id)
        history = PoseHistory(now_ns, pose)
        artefact = Artefact(artefact_id, row, origin, now_ns, history, end_ns, behaviour)
        artefact.options, artefact.may_change = offer.options if offer else None, may_change
        self._living[artefact_id] = artefact
        self._sort_living()
        self._begun(artefact, offer)
        return self._event(now_ns, EventKind.ARRIVED, artefact_id, row, None)

    def _drawn_behaviour(self, artefact_id: int, row: CatalogueRow) -> str:
        """Draw one of the row's behaviours by their probabilities, with one uniform number."""
        stream = generator(self._seed, Purpose.BEHAVIOUR, artefact_id)
        cumulative = np.cumsum(list(row.behaviours.values()))
        return list(row.behaviours)[inverted(cumulative, stream)]

    def _sort_living(self) -> None:
        """Move the new artefact, last in the dict, to where its id belongs."""
        newest_two = list(islice(reversed(self._living), 2))
        if newest_two != sorted(newest_two, reverse=True):
            in_order = sorted(self._living.items())
            self._living.clear()
            self._living.update(in_order)

    def _event(
        self,
        now_ns: int,
        kind: EventKind,
        artefact_id: int,
        row: CatalogueRow,
        cause: Cause | None,
        *,
        reason: str = "",
    ) -> PopulationEvent:
        self.counts = self.counts.after(kind)
        return PopulationEvent(now_ns, kind, artefact_id, row, cause, reason)

    def _is_full(self) -> bool:
        return len(self._living) >= self.max_alive

    def _forget_before(self, t_ns: int) -> None:
        """Drop artefacts departed up to then; they are in the order of departures."""
        departed = self._departed
        while departed and (departed[0].departure_ns or 0) <= t_ns:
            departed.popleft()
