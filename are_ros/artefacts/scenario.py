"""A scenario: who arrives when and where, doing what, for how long, along which way."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.arrivals import FIRST_ID
from are_ros.artefacts.artefact import GroundPose, Origin, between
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.population_events import Cause
from are_ros.errors import ScenarioError

FIRST_ADMITTED_ID: Final = 1_000_000_000
"""Scripted and requested artefacts count from here, so that they shift no random one's draws."""

_LAST_ID: Final = 2**62
_JUMP_NS: Final = 1000


@dataclass(frozen=True, eq=False)
class Track:
    """Poses in time: linear between them, held outside; two within a microsecond are a jump.

    `times_ns` is int64 (K >= 1,), nanoseconds since the start of the run, ascending strictly;
    `poses` is float64 (K, 4): x, y, z, yaw on the ground in the map's frame. Both become
    read-only. Raises ScenarioError where the poses are not of this kind.
    """

    times_ns: npt.NDArray[np.int64]
    poses: npt.NDArray[np.float64]

    def __post_init__(self) -> None:
        if not len(self.times_ns):
            raise ScenarioError("there is no pose in it")
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
        """Return the number of the first pose in (after, until] to which it jumps, None if none.

        A jump is two poses within a microsecond.
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


"""The pose of one that does not arrive; nobody looks at it."""


@dataclass(frozen=True, eq=False)
class ScriptedArtefact:
    """One artefact of a scenario; times are nanoseconds, since the start of the run.

    `pose` is where it arrives, on the ground there, whatever its z; with a track, the track's pose
    then, z and all. `stays_ns` of None means for ever, `speed_mps` of None the row's own. It walks
    along `way_m` (x, y), follows the artefact named `follows`, or has a track, of which at most
    one is given; else its behaviour decides. `artefact_id` of None lets the run give one. `origin`
    and `cause` (of the departure) are those of the run that a scenario was saved from.
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
    speed_mps: float | None = None
    artefact_id: int | None = None
    name: str = ""
    origin: Origin = Origin.SCRIPTED
    cause: Cause = Cause.LIFE_OVER


@dataclass(frozen=True, eq=False)
class Scenario:
    """Scripted artefacts; `random` tells whether artefacts arrive at random beside them.

    Raises ScenarioError, a sentence that names the artefact by its index and name, where names or
    ids are not unique, an id is one that random arrivals have, or somebody follows in vain.
    """

    artefacts: tuple[ScriptedArtefact, ...] = ()
    random: bool = True
    name: str = ""

    def __post_init__(self) -> None:
        names = Counter(artefact.name for artefact in self.artefacts if artefact.name)
        ids = Counter(artefact.artefact_id for artefact in self.artefacts)
        for index, artefact in enumerate(self.artefacts):
            reason = (
                self._fault_of_id(artefact.artefact_id, ids)
                or self._fault_of_name(artefact, names)
                or self._fault_of_leader(artefact, names)
            )
            if reason:
                raise ScenarioError(f"{self.place(index)}: {reason}")

    def place(self, index: int) -> str:
        """Return how an artefact is named in a sentence."""
        artefact = self.artefacts[index]
        return f"artefact {index} ({artefact.name or artefact.row.label})"

    def _fault_of_id(self, artefact_id: int | None, ids: Counter[int | None]) -> str:
        if artefact_id is None:
            return ""
        if not FIRST_ID <= artefact_id <= _LAST_ID:
            return f"id is {artefact_id}, but ids are from {FIRST_ID} to {_LAST_ID}"
        if ids[artefact_id] > 1:
            return f"id is {artefact_id}, which another artefact has too"
        if self.random and artefact_id < FIRST_ADMITTED_ID:
            low = f"below {FIRST_ADMITTED_ID}"
            return f"id is {artefact_id}, but {low} count those who arrive at random beside it"
        return ""

    def _fault_of_name(self, artefact: ScriptedArtefact, names: Counter[str]) -> str:
        if names[artefact.name] > 1:
            return f"name is {artefact.name!r}, which another artefact has too"
        return ""

    def _fault_of_leader(self, artefact: ScriptedArtefact, names: Counter[str]) -> str:
        if artefact.follows and artefact.follows not in names:
            return f"follows {artefact.follows!r}, but no artefact has this name"
        if artefact.name and artefact.name in self._leaders_of(artefact):
            return f"follows {artefact.follows!r}, who follows it in turn: that is a circle"
        return ""

    def _leaders_of(self, artefact: ScriptedArtefact) -> Iterator[str]:
        """Yield whom an artefact follows, whom that one follows, and so on, each once."""
        leader_of = {one.name: one.follows for one in self.artefacts if one.name}
        leader, seen = artefact.follows, set[str]()
        while leader and leader not in seen:
            seen.add(leader)
            yield leader
            leader = leader_of.get(leader, "")
