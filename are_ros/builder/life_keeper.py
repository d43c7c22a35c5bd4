"""What really happened to the artefacts, kept sub-step by sub-step, to be had as a scenario.

Kept are the poses that changed, and of whom, not who stood where: an hour of twenty artefacts that
walk all the time takes 70 MB. The scenario's tracks are the histories that the run had, so that a
replay of it has them again, bit by bit. Only who left with a sub-step, not before it, has a pose at
that very instant.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.artefact import Artefact, GroundPose, Origin
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.population_events import Cause
from are_ros.artefacts.scenario import NOWHERE, Doing, Scenario, ScriptedArtefact, Track
from are_ros.conventions import NS_PER_S

_Floats = npt.NDArray[np.float64]
_Ints = npt.NDArray[np.int64]
_Mask = npt.NDArray[np.bool_]

MOST_POSES: Final = 10_000_000
"""What is kept at most by default: half a gigabyte."""

_CHANGE: Final = np.dtype(
    [("t_ns", np.int64), ("id", np.int64), ("pose", np.float64, 4), ("jumped", np.bool_)]
)


@dataclass(eq=False, slots=True)
class _Kept:
    """One artefact as it arrived, and what became of it but for its poses."""

    row: CatalogueRow
    origin: Origin
    arrival_ns: int
    pose: GroundPose
    doings: list[Doing] = field(default_factory=list)
    departed_ns: int | None = None
    left_with_step: bool = False
    cause: Cause = Cause.LIFE_OVER


class LifeKeeper:
    """Is told what happens in a run, in the order of time, and gives it as a `Scenario`.

    All instants are nanoseconds since the epoch. What comes after `most_poses` changes of a pose
    or a doing is not kept any more, and `notice` says so.
    """

    def __init__(self, period_ns: int, most_poses: int = MOST_POSES) -> None:
        """Take the length of a sub-step."""
        self._period_ns = period_ns
        self._most = most_poses
        self.start(0)

    def start(self, now_ns: int) -> None:
        """Begin at `now_ns`, the start of the population; what was before is forgotten."""
        self._start_ns = now_ns
        self._changes = bytearray()
        self._doings = 0
        self._full_ns: int | None = None
        self._stepped_ns: int | None = None
        self._kept: dict[int, _Kept] = {}
        self._refused: dict[int, ScriptedArtefact] = {}
        self._ids: _Ints = np.empty(0, np.int64)
        self._poses: _Floats = np.empty((0, 4))

    def postpone(self, by_ns: int) -> None:
        """Let all that was kept count as so much later: the scenario leaves a time out.

        To be called when nobody lives.
        """
        self._start_ns += by_ns
        changes = np.frombuffer(self._changes, _CHANGE)
        changes["t_ns"] += by_ns
        for kept in self._kept.values():
            kept.arrival_ns += by_ns
            kept.departed_ns = None if kept.departed_ns is None else kept.departed_ns + by_ns
        if self._full_ns is not None:
            self._full_ns += by_ns

    def __len__(self) -> int:
        """Count the changes kept."""
        return len(self._changes) // _CHANGE.itemsize + self._doings + len(self._refused)

    @property
    def notice(self) -> str:
        """What is to be said of a scenario that is not the whole run; else empty."""
        if self._full_ns is None:
            return ""
        until_s = (self._full_ns - self._start_ns) / NS_PER_S
        return (
            f"the scenario ends after {until_s:.3f} s, where all go: more than {self._most} "
            "changes of a pose or of what an artefact does are not kept"
        )

    def arrived(self, artefact: Artefact) -> None:
        """Keep one who has just come to live."""
        if self._is_full(artefact.arrival_ns):
            return
        row, arrival_ns, end = artefact.row, artefact.arrival_ns, artefact.history.latest
        pose = artefact.ground_pose_at(arrival_ns)
        self._kept[artefact.id] = _Kept(row, artefact.origin, arrival_ns, pose)
        self._note(arrival_ns, artefact)
        at = int(np.searchsorted(self._ids, artefact.id))
        self._ids = np.insert(self._ids, at, artefact.id)
        self._poses = np.insert(self._poses, at, end, axis=0)
        if end is not pose:
            self._add(artefact.history.latest_ns, self._ids[[at]], np.array([end]), jumped=False)

    def refused(self, artefact_id: int, row: CatalogueRow, t_ns: int, why: str) -> None:
        """Keep one who could not come."""
        if self._is_full(t_ns):
            return
        arrives_ns = t_ns - self._start_ns
        self._refused[artefact_id] = ScriptedArtefact(
            row, NOWHERE, arrives_ns, artefact_id=artefact_id, blocked=why
        )

    def departed(self, artefact_id: int, t_ns: int, cause: Cause) -> None:
        """Keep when and why one left."""
        if self._is_full(t_ns):
            return
        kept = self._kept[artefact_id]
        kept.departed_ns, kept.cause = t_ns, cause
        kept.left_with_step = t_ns == self._stepped_ns
        at = int(np.searchsorted(self._ids, artefact_id))
        self._ids = np.delete(self._ids, at)
        self._poses = np.delete(self._poses, at, axis=0)

    def begin_step(self, t_ns: int) -> None:
        """Say that a sub-step begins at `t_ns`: who departs at this instant leaves with it."""
        self._stepped_ns = t_ns

    def step(self, t_ns: int, ids: _Ints, starts: _Floats, ends: _Floats) -> None:
        """Keep the sub-step that began at `t_ns`.

        `ids` (N,) are all who live, ascending; `starts` (N, 4) are x, y, z, yaw then, and `ends`
        (N, 4) where they will be when the next one begins; nobody writes into them later. Who was
        bound for somewhere else than where it starts has jumped. Raises ValueError where `ids` are
        not those who arrived and have not departed.
        """
        if (starts is self._poses and ends is starts) or self._is_full(t_ns):
            return
        if not np.array_equal(ids, self._ids):
            raise ValueError("the ids are not those who arrived and have not departed")
        jumped, goes = _differ(self._poses, starts), _differ(starts, ends)
        self._add(t_ns, ids[jumped], starts[jumped], jumped=True)
        self._add(t_ns + self._period_ns, ids[goes], ends[goes], jumped=False)
        self._poses = ends

    def look(self, t_ns: int, living: Mapping[int, Artefact]) -> None:
        """Keep what each does from `t_ns` on, where that is something else than before.

        To be called after each sub-step, and after whatever else may have changed it in between.
        """
        if self._is_full(t_ns):
            return
        for artefact in living.values():
            self._note(t_ns, artefact)

    def scenario(self, name: str = "") -> Scenario:
        """Return what happened so far, with nobody who comes at random beside it."""
        changes = np.frombuffer(bytes(self._changes), _CHANGE)
        changes = changes[np.argsort(changes["id"], kind="stable")]
        found = dict(self._refused)
        for artefact_id, kept in self._kept.items():
            first, end = np.searchsorted(changes["id"], [artefact_id, artefact_id + 1]).tolist()
            found[artefact_id] = self._life(artefact_id, kept, changes[first:end])
        in_order = [found[artefact_id] for artefact_id in sorted(found)]
        in_order.sort(key=lambda one: one.arrives_ns)
        return Scenario(tuple(in_order), random=False, name=name)

    def _add(self, t_ns: int, ids: _Ints, poses: _Floats, *, jumped: bool) -> None:
        changes = np.empty(len(ids), _CHANGE)
        changes["t_ns"], changes["id"], changes["pose"] = t_ns, ids, poses
        changes["jumped"] = jumped
        self._changes += changes.tobytes()

    def _is_full(self, t_ns: int) -> bool:
        if self._full_ns is None and len(self) >= self._most:
            self._full_ns = t_ns
        return self._full_ns is not None

    def _note(self, t_ns: int, artefact: Artefact) -> None:
        """Keep a doing, if it is another one than the last."""
        doings, ends_ns = self._kept[artefact.id].doings, artefact.departure_ns
        departs_ns = None if ends_ns is None else ends_ns - self._start_ns
        now = (artefact.behaviour, artefact.activity, departs_ns)
        last = doings[-1] if doings else None
        if last is None or (last.behaviour, last.activity, last.departs_ns) != now:
            doings.append(Doing(t_ns - self._start_ns, *now))
            self._doings += 1

    def _life(
        self, artefact_id: int, kept: _Kept, changes: npt.NDArray[np.void]
    ) -> ScriptedArtefact:
        ends_ns, arrives_ns = self._end_ns(kept), kept.arrival_ns - self._start_ns
        times_ns, poses = _history(kept.arrival_ns, kept.pose, changes, self._period_ns)
        if not kept.left_with_step:
            times_ns = times_ns - (times_ns == kept.departed_ns)
        elif times_ns[-1] != kept.departed_ns:
            times_ns = np.append(times_ns, kept.departed_ns or 0)
            poses = np.concatenate((poses, poses[-1:]))
        doings = _worth_saying(kept.doings, ends_ns)
        track = Track(times_ns - self._start_ns, poses, doings)
        return ScriptedArtefact(
            row=kept.row,
            pose=track.pose_at(arrives_ns),
            arrives_ns=arrives_ns,
            stays_ns=None if ends_ns is None else ends_ns - arrives_ns,
            behaviour=kept.doings[0].behaviour,
            track=track,
            artefact_id=artefact_id,
            origin=kept.origin,
            cause=kept.cause,
        )

    def _end_ns(self, kept: _Kept) -> int | None:
        """Return when, since the start, a life ended, or will by what was known last."""
        if kept.departed_ns is not None:
            return kept.departed_ns - self._start_ns
        if self._full_ns is not None:
            return self._full_ns - self._start_ns
        return kept.doings[-1].departs_ns


def _worth_saying(doings: list[Doing], ends_ns: int | None) -> tuple[Doing, ...]:
    """Return the doings before the end; none where the one there is says no more than that."""
    first, *later = doings
    doings = [first, *(one for one in later if ends_ns is None or one.t_ns < ends_ns)]
    is_plain = len(doings) == 1 and not first.activity and first.departs_ns == ends_ns
    return () if is_plain else tuple(doings)


def _history(
    arrival_ns: int, pose: GroundPose, changes: npt.NDArray[np.void], period_ns: int
) -> tuple[_Ints, _Floats]:
    """Return instants (K,) and poses (K, 4) as the artefact's history had them.

    Who set off stood until a sub-step before, who jumped was until a nanosecond before where it had
    been bound for. Of two poses at one instant the later counts.
    """
    times_ns = np.concatenate(([arrival_ns], changes["t_ns"]))
    poses = np.concatenate(([pose], changes["pose"]))
    stood_until_ns = changes["t_ns"] - np.where(changes["jumped"], 1, period_ns)
    times_ns[1:-1] -= changes["jumped"][1:] & (changes["t_ns"][1:] == changes["t_ns"][:-1])
    stood = stood_until_ns > times_ns[:-1]
    times_ns = np.concatenate((times_ns, stood_until_ns[stood]))
    poses = np.concatenate((poses, poses[:-1][stood]))
    order = np.argsort(times_ns, kind="stable")
    times_ns, poses = times_ns[order], poses[order]
    is_last = np.append(times_ns[1:] != times_ns[:-1], np.True_)
    return times_ns[is_last], poses[is_last]


def _differ(poses: _Floats, others: _Floats) -> _Mask:
    """Tell whose poses differ, by their bits: -0.0 is not 0.0 in the bytes of a message."""
    if poses is others:
        return np.zeros(len(poses), np.bool_)
    different: _Mask = (poses.view(np.int64) != others.view(np.int64)).any(axis=1)
    return different
