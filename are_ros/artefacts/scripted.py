"""The source of scripted artefacts: each of a scenario's is offered once, at its exact time."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from are_ros.artefacts.artefact import GroundPose, Origin
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.population_events import Cause
from are_ros.artefacts.scenario import FIRST_ADMITTED_ID, Scenario, ScriptedArtefact, Track
from are_ros.errors import ParameterError


@dataclass(frozen=True, eq=False)
class ScriptedOffer:
    """One artefact of a scenario that arrives at `time_ns`, if it can stand at `pose`.

    `has_height` tells whether z of the pose counts; else it stands on the ground. `life_ns` of None
    means for ever. `row` is that of the catalogue, with the speed that the scenario gives.
    `options` are those of the behaviour: waypoints and repeat of along_way, leader (an id) of
    following. A `track` (None: it moves by itself) counts from `start_ns`. `place` names it in
    sentences. `cause` is why it leaves at the end of its life.
    """

    time_ns: int
    artefact_id: int
    row: CatalogueRow
    pose: GroundPose
    place: str
    start_ns: int
    has_height: bool = False
    life_ns: int | None = None
    behaviour: str = "standing"
    options: Mapping[str, Any] = field(default_factory=dict)
    track: Track | None = None
    origin: Origin = Origin.SCRIPTED
    cause: Cause = Cause.LIFE_OVER


class ScriptedSource:
    """Offers the artefacts of a scenario, in the order of time, and of the file at one instant.

    All times are integer nanoseconds; those of the scenario count from the start of the run, which
    `restart` gives. Nobody is offered before `open`: who is due before comes then.

    It gives out all ids of those who do not come at random. A scenario's own ids come back exactly
    the first time; when it runs again (the clock jumped back), its artefacts are others, with ids
    of their own. `new_id` never gives one of the scenario's.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self._artefacts = scenario.artefacts
        given = [one.artefact_id for one in self._artefacts if one.artefact_id is not None]
        self._next_id = max([FIRST_ADMITTED_ID, *(artefact_id + 1 for artefact_id in given)])
        self._ids = [
            self.new_id() if one.artefact_id is None else one.artefact_id for one in self._artefacts
        ]
        by_time = sorted(enumerate(self._artefacts), key=lambda item: item[1].arrives_ns)
        self._order = [index for index, _ in by_time]
        self._taken = 0
        self._start_ns: int | None = None
        self._opens_ns: int | None = None

    def new_id(self) -> int:
        """Return an id that nobody had or will have: for who is admitted by request."""
        self._next_id += 1
        return self._next_id - 1

    def next_ns(self) -> int | None:
        """Return the instant of the next offer [ns], None if none comes as things stand."""
        if self._start_ns is None or self._opens_ns is None or self._taken == len(self._order):
            return None
        due_ns = self._start_ns + self._artefacts[self._order[self._taken]].arrives_ns
        return max(due_ns, self._opens_ns)

    def take(self) -> ScriptedOffer:
        """Take the next offer; `ParameterError` if none comes."""
        time_ns = self.next_ns()
        if time_ns is None or self._start_ns is None:
            raise ParameterError("no artefact of the scenario is due")
        index = self._order[self._taken]
        self._taken += 1
        return self._offer(index, time_ns, self._start_ns)

    def restart(self, now_ns: int) -> None:
        """Begin with the scenario at `now_ns`, earlier or later; who was offered is so again."""
        for index in self._order[: self._taken]:
            self._ids[index] = self.new_id()
        self._taken = 0
        self._start_ns = now_ns
        if self._opens_ns is not None:
            self._opens_ns = now_ns

    def open(self, now_ns: int) -> None:
        """Let them arrive from `now_ns` on: there is a map now. Again changes nothing."""
        if self._opens_ns is None:
            self._opens_ns = now_ns

    def postpone(self, by_ns: int) -> None:
        """Let those still to come arrive so much later: time stood still for them."""
        if self._start_ns is not None:
            self._start_ns += by_ns

    def _offer(self, index: int, time_ns: int, start_ns: int) -> ScriptedOffer:
        artefact = self._artefacts[index]
        track = artefact.track
        return ScriptedOffer(
            time_ns=time_ns,
            artefact_id=self._ids[index],
            row=_row_of(artefact),
            pose=artefact.pose if track is None else track.pose_at(time_ns - start_ns),
            place=self.scenario.place(index),
            start_ns=start_ns,
            has_height=track is not None,
            life_ns=artefact.stays_ns,
            behaviour=artefact.behaviour,
            options=self._options_of(artefact),
            track=track,
            origin=artefact.origin,
            cause=artefact.cause,
        )

    def _options_of(self, artefact: ScriptedArtefact) -> dict[str, Any]:
        if artefact.way_m:
            return {"waypoints": artefact.way_m, "repeat": artefact.loop}
        if artefact.follows:
            names = [one.name for one in self._artefacts]
            return {"leader": self._ids[names.index(artefact.follows)]}
        return {}


def _row_of(artefact: ScriptedArtefact) -> CatalogueRow:
    """Return the artefact's row, as slow as the scenario wants it."""
    row, speed_mps = artefact.row, artefact.speed_mps
    if speed_mps is None:
        return row
    return replace(row, motion=replace(row.motion, speed_mps=speed_mps))
