"""Scenarios: artefacts whose arrivals, poses, behaviours, lives and tracks are given.

`Scenario` is what a file says; `ScriptedSource` offers its artefacts to the population in time.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import ParameterError, ScenarioError
from are_ros.population.arrivals import FIRST_ID
from are_ros.population.artefact import GroundPose, Origin, between
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.departures import Cause

FIRST_ADMITTED_ID: Final = 1_000_000_000
"""Ids of scripted and requested artefacts begin here, so the draws of random ones do not shift."""

LAST_ID: Final = 999_999_999_999
"""False alarms of the perception have the ids behind it."""

_JUMP_NS: Final = 1000


@dataclass(frozen=True, eq=False)
class Track:
    """Poses in time: linear between two, held outside; two within a microsecond are a jump.

    `times_ns` is int64 (K >= 1,), nanoseconds since the start of the run, ascending strictly;
    `poses` is float64 (K, 4): x, y, z, yaw on the ground in the map's frame. Both become
    read-only. Raises ScenarioError where the poses are not of this kind.
    """

    times_ns: npt.NDArray[np.int64]
    poses: npt.NDArray[np.float64]

    def __post_init__(self) -> None:
        if not len(self.times_ns):
            raise ScenarioError("it has no pose")
        if not np.isfinite(self.poses).all():
            raise ScenarioError("a number in it is not finite")
        late = np.flatnonzero(np.diff(self.times_ns) <= 0)
        if len(late):
            raise ScenarioError(f"pose {late[0] + 1} is not later than the one before it")
        self.times_ns.flags.writeable = self.poses.flags.writeable = False

    def __len__(self) -> int:
        """Count the poses."""
        return len(self.times_ns)

    def pose(self, k: int) -> GroundPose:
        """Return pose `k` of those given."""
        return GroundPose(*self.poses[k].tolist())

    def pose_at(self, t_ns: int) -> GroundPose:
        """Return the pose at `t_ns`: linear between two, the first and the last outside."""
        after = int(np.searchsorted(self.times_ns, t_ns, side="right"))
        if after in {0, len(self)} or self.times_ns[after - 1] == t_ns:
            return self.pose(max(after - 1, 0))
        start, end = self.pose(after - 1), self.pose(after)
        start_ns, end_ns = self.times_ns[after - 1 : after + 1].tolist()
        return (
            start if start == end else between(start, end, (t_ns - start_ns) / (end_ns - start_ns))
        )

    def jump_within(self, after_ns: int, until_ns: int) -> int | None:
        """Return the index of the first pose in (after, until] that is a jump, None if none is.

        A jump is a pose within a microsecond of the one before it.
        """
        first, end = np.searchsorted(self.times_ns, (after_ns, until_ns), side="right").tolist()
        first = max(first, 1)
        jumps = np.flatnonzero(np.diff(self.times_ns[first - 1 : end]) < _JUMP_NS)
        return first + int(jumps[0]) if len(jumps) else None

    def poses_at(self, times_ns: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
        """Return x, y, yaw at many instants: float64 (N, 3), within rounding as `pose_at`."""
        after = np.searchsorted(self.times_ns, times_ns, side="right")
        low, high = np.maximum(after - 1, 0), np.minimum(after, len(self) - 1)
        span_ns = np.maximum(self.times_ns[high] - self.times_ns[low], 1)
        share = np.where(high > low, (times_ns - self.times_ns[low]) / span_ns, 0.0)
        planar = self.poses[:, (0, 1, 3)]
        change = planar[high] - planar[low]
        change[:, 2] -= math.tau * np.rint(change[:, 2] / math.tau)
        poses: npt.NDArray[np.float64] = planar[low] + share[:, None] * change
        return poses


@dataclass(frozen=True, eq=False)
class ScriptedArtefact:
    """One artefact of a scenario; times are nanoseconds since the start of the run.

    `row` is a row of the catalogue, with the speed and the planner that the scenario gives. The
    artefact arrives at `pose`, on the ground, or at the pose of its `track` with its z. A
    `stays_ns` of None means for ever. At most one of these is given: `way_m`, points (x, y) to walk
    along, again and again with `loop`; `follows`, the name of a leader; `track`. Else its behaviour
    decides. With an `artefact_id` of None the run assigns one. `speed_mps` [m/s] and `planner` are
    those that the scenario gives, None and empty if it gives none. `origin` and `cause` (of the
    departure) are those of the run from which the scenario was saved.
    """

    row: CatalogueRow
    pose: GroundPose
    arrives_ns: int
    stays_ns: int | None = None
    behaviour: str = "standing"
    way_m: tuple[tuple[float, float], ...] = ()
    loop: bool = False
    follows: str = ""
    track: Track | None = None
    artefact_id: int | None = None
    name: str = ""
    speed_mps: float | None = None
    planner: str = ""
    origin: Origin = Origin.SCRIPTED
    cause: Cause = Cause.LIFE_OVER


@dataclass(frozen=True, eq=False)
class Scenario:
    """Scripted artefacts; `random` tells whether artefacts also arrive at random.

    Raises ScenarioError, which names the artefact by its index and name, where names or ids are not
    unique, an id is in the range of random arrivals, or a leader is unknown.
    """

    artefacts: tuple[ScriptedArtefact, ...] = ()
    random: bool = True
    name: str = ""

    def __post_init__(self) -> None:
        names = Counter(artefact.name for artefact in self.artefacts if artefact.name)
        ids = Counter(artefact.artefact_id for artefact in self.artefacts)
        for index, artefact in enumerate(self.artefacts):
            reason = self._fault_of_id(artefact.artefact_id, ids) or self._fault_of_names(
                artefact, names
            )
            if reason:
                raise ScenarioError(f"{self.place(index)}: {reason}")

    def place(self, index: int) -> str:
        """Return the name of an artefact in error messages."""
        artefact = self.artefacts[index]
        return f"artefact {index} ({artefact.name or artefact.row.label})"

    def _fault_of_id(self, artefact_id: int | None, ids: Counter[int | None]) -> str:
        if artefact_id is None:
            return ""
        if not FIRST_ID <= artefact_id <= LAST_ID:
            return f"id is {artefact_id}, but ids are from {FIRST_ID} to {LAST_ID}"
        if ids[artefact_id] > 1:
            return f"id is {artefact_id}, which another artefact has too"
        if self.random and artefact_id < FIRST_ADMITTED_ID:
            low = f"below {FIRST_ADMITTED_ID}"
            return f"id is {artefact_id}, but ids {low} are those of random arrivals"
        return ""

    def _fault_of_names(self, artefact: ScriptedArtefact, names: Counter[str]) -> str:
        if names[artefact.name] > 1:
            return f"name is {artefact.name!r}, which another artefact has too"
        if artefact.follows and artefact.follows not in names:
            return f"follows {artefact.follows!r}, but no artefact has this name"
        if artefact.name and artefact.name in self._leaders_of(artefact):
            return f"follows {artefact.follows!r}, which follows it in turn: that is a circle"
        return ""

    def _leaders_of(self, artefact: ScriptedArtefact) -> Iterator[str]:
        """Yield the leader of an artefact, the leader of that one, and so on, each once."""
        leader_of = {one.name: one.follows for one in self.artefacts if one.name}
        leader, seen = artefact.follows, set[str]()
        while leader and leader not in seen:
            seen.add(leader)
            yield leader
            leader = leader_of.get(leader, "")


@dataclass(frozen=True, eq=False)
class ScriptedOffer:
    """The arrival of a scripted artefact at `time_ns`, if it can stand at `pose`.

    The track of the artefact (if any) counts from `start_ns`. `options` are those of its behaviour:
    waypoints and repeat of along_way, leader (an id) of following. `place` names the artefact in
    error messages.
    """

    time_ns: int
    artefact_id: int
    artefact: ScriptedArtefact
    pose: GroundPose
    start_ns: int
    options: Mapping[str, Any]
    place: str


class ScriptedSource:
    """Offers the artefacts of a scenario in the order of time; at one instant, of the file.

    Times are integer nanoseconds. Those of the scenario count from the start of the run, which
    `restart` sets. Nothing is offered before `open`; artefacts that are due earlier arrive then.

    The source assigns all ids but those of random arrivals. A scenario's own ids are used the first
    time; when it runs again (the clock jumped back), its artefacts get new ids. `new_id` never
    returns an id of the scenario.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self._artefacts = scenario.artefacts
        self._given = frozenset(one.artefact_id for one in self._artefacts)
        self._next_id = FIRST_ADMITTED_ID
        self._ids = [
            self.new_id() if one.artefact_id is None else one.artefact_id for one in self._artefacts
        ]
        by_time = sorted(enumerate(self._artefacts), key=lambda item: item[1].arrives_ns)
        self._order = [index for index, _ in by_time]
        self._taken = 0
        self._start_ns: int | None = None
        self._opens_ns: int | None = None

    def new_id(self) -> int:
        """Return a new id, for an artefact that is admitted on request."""
        while self._next_id in self._given:
            self._next_id += 1
        self._next_id += 1
        return self._next_id - 1

    def next_ns(self) -> int | None:
        """Return the instant of the next offer [ns], None if no artefact is to come."""
        if self._start_ns is None or self._opens_ns is None or self._taken == len(self._order):
            return None
        due_ns = self._start_ns + self._artefacts[self._order[self._taken]].arrives_ns
        return max(due_ns, self._opens_ns)

    def take(self) -> ScriptedOffer:
        """Take the next offer; `ParameterError` if no artefact is to come."""
        time_ns, start_ns = self.next_ns(), self._start_ns
        if time_ns is None or start_ns is None:
            raise ParameterError("no artefact of the scenario is due")
        index = self._order[self._taken]
        self._taken += 1
        artefact = self._artefacts[index]
        track = artefact.track
        return ScriptedOffer(
            time_ns=time_ns,
            artefact_id=self._ids[index],
            artefact=artefact,
            pose=artefact.pose if track is None else track.pose_at(time_ns - start_ns),
            start_ns=start_ns,
            options=self._options_of(artefact),
            place=self.scenario.place(index),
        )

    def restart(self, now_ns: int) -> None:
        """Begin the scenario again at `now_ns`, earlier or later."""
        for index in self._order[: self._taken]:
            self._ids[index] = self.new_id()
        self._taken = 0
        self._start_ns = now_ns
        if self._opens_ns is not None:
            self._opens_ns = now_ns

    def open(self, now_ns: int) -> None:
        """Allow arrivals from `now_ns` on, when there is a map. A second call changes nothing."""
        if self._opens_ns is None:
            self._opens_ns = now_ns

    def postpone(self, by_ns: int) -> None:
        """Postpone the arrivals still to come, after a pause."""
        if self._start_ns is not None:
            self._start_ns += by_ns

    def _options_of(self, artefact: ScriptedArtefact) -> dict[str, Any]:
        if artefact.way_m:
            return {"waypoints_m": artefact.way_m, "repeat": artefact.loop}
        if artefact.follows:
            names = [one.name for one in self._artefacts]
            return {"leader_id": self._ids[names.index(artefact.follows)]}
        return {}
