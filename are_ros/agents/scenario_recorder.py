"""Recording of a run, to save it as a scenario.

The recorder keeps, for each artefact, its row, origin and first behaviour, the times of arrival and
departure with the cause, and its track: a timed pose for each sub-step in which it moved. An hour
of twenty artefacts that always walk takes 58 MB.
"""

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from are_ros.population.artefact import Artefact
from are_ros.population.departures import Cause
from are_ros.population.scenario import Scenario, ScriptedArtefact, Track


@dataclass(eq=False, slots=True)
class _Life:
    """One artefact; instants are nanoseconds since the start of the run, poses x, y, z, yaw."""

    artefact: Artefact
    behaviour: str
    arrives_ns: int
    times_ns: "array[int]" = field(default_factory=lambda: array("q"))
    poses: "array[float]" = field(default_factory=lambda: array("d"))
    departs_ns: int | None = None
    cause: Cause = Cause.LIFE_OVER

    @property
    def pose(self) -> list[float]:
        """The last pose of the track."""
        return self.poses[-4:].tolist()

    def add(self, t_ns: int, pose: Sequence[float]) -> None:
        """Add a pose to the track."""
        self.times_ns.append(t_ns)
        self.poses.extend(pose)

    def stand_until(self, t_ns: int) -> None:
        """Keep the track at its last pose until `t_ns`."""
        if self.times_ns[-1] < t_ns:
            self.add(t_ns, self.pose)

    def jump(self, t_ns: int, pose: Sequence[float]) -> None:
        """Continue the track from `pose` at `t_ns`: two poses 1 ns apart are a jump."""
        if self.times_ns[-1] < t_ns:
            self.stand_until(t_ns - 1)
            self.add(t_ns, pose)
        elif t_ns == self.arrives_ns:
            self.poses[-4:] = array("d", pose)
        else:
            self.times_ns[-1] -= 1
            self.add(t_ns, pose)


class ScenarioRecorder:
    """Records the artefacts of a run, and returns them as a `Scenario`.

    The caller reports events in the order of time; instants are nanoseconds since the epoch.
    """

    def __init__(self, period_ns: int) -> None:
        """Take the length of a sub-step [ns]."""
        self._period_ns = period_ns
        self.start(0)

    def start(self, now_ns: int) -> None:
        """Forget all artefacts, and begin at `now_ns`, the start of the population."""
        self._start_ns = now_ns
        self._lives: dict[int, _Life] = {}

    def postpone(self, by_ns: int) -> None:
        """Leave the next `by_ns` out of the recorded time; call it when no artefact is alive."""
        self._start_ns += by_ns

    def arrived(self, artefact: Artefact) -> None:
        """Record an arrival; an artefact on a track may already move to its next pose."""
        arrives_ns, history = artefact.arrival_ns - self._start_ns, artefact.history
        life = self._lives[artefact.id] = _Life(artefact, artefact.behaviour, arrives_ns)
        life.add(arrives_ns, artefact.ground_pose_at(artefact.arrival_ns))
        if list(history.latest) != life.pose:
            life.add(history.latest_ns - self._start_ns, history.latest)

    def departed(self, artefact_id: int, t_ns: int, cause: Cause) -> None:
        """Record when and why an artefact left."""
        life = self._lives[artefact_id]
        life.departs_ns, life.cause = t_ns - self._start_ns, cause

    def step(
        self,
        t_ns: int,
        ids: npt.NDArray[np.int64],
        starts: npt.NDArray[np.float64],
        ends: npt.NDArray[np.float64],
    ) -> None:
        """Record the sub-step that begins at `t_ns`.

        `ids` (N,) are those of all artefacts alive; `starts` (N, 4) are their poses x, y, z, yaw at
        `t_ns`, `ends` (N, 4) those at the beginning of the next sub-step.
        """
        t_ns -= self._start_ns
        rows = zip(ids.tolist(), starts.tolist(), ends.tolist(), strict=True)
        for artefact_id, start, end in rows:
            life = self._lives[artefact_id]
            if start != life.pose:
                life.jump(t_ns, start)
            if end != start:
                life.stand_until(t_ns)
                life.add(t_ns + self._period_ns, end)

    def scenario(self, name: str = "") -> Scenario:
        """Return the artefacts so far as a scenario without random arrivals."""
        in_order = sorted(self._lives.values(), key=lambda one: (one.arrives_ns, one.artefact.id))
        return Scenario(tuple(map(self._scripted, in_order)), random=False, name=name)

    def _scripted(self, life: _Life) -> ScriptedArtefact:
        artefact, ends_ns = life.artefact, life.departs_ns
        if ends_ns is None and artefact.departure_ns is not None:
            ends_ns = artefact.departure_ns - self._start_ns
        track = Track(np.array(life.times_ns), np.array(life.poses).reshape(-1, 4))
        return ScriptedArtefact(
            row=artefact.row,
            pose=track.pose_at(life.arrives_ns),
            arrives_ns=life.arrives_ns,
            stays_ns=None if ends_ns is None else ends_ns - life.arrives_ns,
            behaviour=life.behaviour,
            track=track,
            artefact_id=artefact.id,
            origin=artefact.origin,
            cause=life.cause,
        )
