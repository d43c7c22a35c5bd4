"""Artefacts that go by a track: their poses and doings as given, whatever happens around them."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.artefact import Artefact, GroundPose
from are_ros.artefacts.scenario import Doing, Track


@dataclass(eq=False, slots=True)
class _Part:
    """One artefact on its track, since when it is on the leg that it is on; its next doing."""

    artefact: Artefact
    track: Track
    start_ns: int
    since_ns: int
    next_doing: int = 0

    def doing_ns(self) -> int | None:
        """Return when it does something else."""
        if self.next_doing == len(self.track.doings):
            return None
        return self.start_ns + self.track.doings[self.next_doing].t_ns


class TrackPlayer:
    """Takes artefacts along their tracks, in the order of their ids; instants are nanoseconds.

    They are where their tracks are at the sub-steps, and between these on the straight line: the
    leg that they are on. Where a track jumps they do so at the next sub-step: until then they go on
    if the jump is at its very instant, else they stand.
    """

    def __init__(self, period_ns: int) -> None:
        """Take the length of a sub-step."""
        self._period_ns = period_ns
        self._parts: dict[int, _Part] = {}

    def __contains__(self, artefact_id: object) -> bool:
        return artefact_id in self._parts

    @property
    def ids(self) -> tuple[int, ...]:
        """Who goes by a track, ascending."""
        return tuple(self._parts)

    def add(self, artefact: Artefact, track: Track, start_ns: int) -> tuple[int, GroundPose]:
        """Let an artefact that has just arrived go by a track that counts from `start_ns`.

        Returns the instant of the next sub-step, and where it will be then.
        """
        arrival_ns = artefact.arrival_ns
        part = self._parts[artefact.id] = _Part(artefact, track, start_ns, arrival_ns)
        self._parts = dict(sorted(self._parts.items()))
        self.tell(arrival_ns)
        step_ns = -(-arrival_ns // self._period_ns) * self._period_ns
        return step_ns, _bound_for(part, artefact.ground_pose_at(arrival_ns), step_ns)

    def ends_with_step(self, artefact_id: int, end_ns: int) -> bool:
        """Say whether one, known or not, whose life is over at `end_ns` lives through the sub-step.

        It does if its track has a pose at that very instant, at which a sub-step ends: in the run
        that it was saved from, it moved and was met in it before it left.
        """
        part = self._parts.get(artefact_id)
        if part is None or end_ns % self._period_ns:
            return False
        return bool(end_ns - part.start_ns in part.track.times_ns)

    @property
    def leaving(self) -> tuple[int, ...]:
        """Whose lives are over, but for the sub-step, ascending."""
        return tuple(key for key, part in self._parts.items() if part.artefact.is_leaving)

    def remove(self, artefact_id: int) -> None:
        """Forget an artefact, known or not."""
        self._parts.pop(artefact_id, None)

    def clear(self) -> None:
        """Forget all."""
        self._parts.clear()

    def postpone(self, by_ns: int) -> None:
        """Let all that is still to come be so much later: time stood still."""
        for part in self._parts.values():
            part.start_ns += by_ns
            part.since_ns += by_ns

    def next_ns(self) -> int | None:
        """Return when somebody does something else next, None if never."""
        times_ns = (part.doing_ns() for part in self._parts.values())
        return min((t_ns for t_ns in times_ns if t_ns is not None), default=None)

    def tell(self, now_ns: int) -> None:
        """Let all do what they do at `now_ns`."""
        for part in self._parts.values():
            while (t_ns := part.doing_ns()) is not None and t_ns <= now_ns:
                _do(part.artefact, part.track.doings[part.next_doing], part.start_ns)
                part.next_doing += 1

    def jumps(self, step_ns: int) -> dict[int, GroundPose]:
        """Return who has jumped by the sub-step at `step_ns`, ascending, and where each is then."""
        return {
            artefact_id: part.track.pose_at(step_ns - part.start_ns)
            for artefact_id, part in self._parts.items()
            if part.track.jump_within(part.since_ns - part.start_ns, step_ns - part.start_ns)
            is not None
        }

    def set_out(self, step_ns: int, poses: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Let all be on their next leg, from `poses` (M, 4), in the order of `ids`, at `step_ns`.

        Returns where they will be when the next sub-step begins, float64 (M, 4).
        """
        ends = np.empty((len(self._parts), 4))
        for k, part in enumerate(self._parts.values()):
            part.since_ns = step_ns
            pose = GroundPose(*poses[k].tolist())
            ends[k] = _bound_for(part, pose, step_ns + self._period_ns)
        return ends

    def ahead(self, artefact_id: int, step_ns: int, count: int) -> npt.NDArray[np.float64]:
        """Return where one will be in the `count` sub-steps after `step_ns`, float64 (count, 3).

        The columns are x, y, yaw. Good to plan by; the poses to be are those of `set_out`.
        """
        part = self._parts[artefact_id]
        steps = np.arange(1, count + 1, dtype=np.int64)
        return part.track.poses_at(step_ns - part.start_ns + self._period_ns * steps)


def _do(artefact: Artefact, doing: Doing, start_ns: int) -> None:
    artefact.behaviour, artefact.activity = doing.behaviour, doing.activity
    ends_ns = doing.departs_ns
    artefact.departure_ns = None if ends_ns is None else start_ns + ends_ns


def _bound_for(part: _Part, pose: GroundPose, until_ns: int) -> GroundPose:
    """Return where one that is at a pose goes until an instant, before it jumps there."""
    until_ns -= part.start_ns
    jump = part.track.jump_within(part.since_ns - part.start_ns, until_ns)
    if jump is None:
        return part.track.pose_at(until_ns)
    return part.track.pose(jump - 1) if part.track.times_ns[jump] == until_ns else pose
