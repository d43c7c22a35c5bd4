"""Artefacts on tracks: they are where their tracks say, whatever happens around them."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.artefact import Artefact, GroundPose
from are_ros.artefacts.scenario import Track


@dataclass(eq=False, slots=True)
class _Part:
    """One artefact, its track, and the start of the sub-step or leg that it is in."""

    track: Track
    start_ns: int
    since_ns: int


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
        part = self._parts[artefact.id] = _Part(track, start_ns, arrival_ns)
        self._parts = dict(sorted(self._parts.items()))
        step_ns = -(-arrival_ns // self._period_ns) * self._period_ns
        return step_ns, _bound_for(part, artefact.ground_pose_at(arrival_ns), step_ns)

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


def _bound_for(part: _Part, pose: GroundPose, until_ns: int) -> GroundPose:
    """Return where one that is at a pose goes until an instant, before it jumps there."""
    until_ns -= part.start_ns
    jump = part.track.jump_within(part.since_ns - part.start_ns, until_ns)
    if jump is None:
        return part.track.pose_at(until_ns)
    return part.track.pose(jump - 1) if part.track.times_ns[jump] == until_ns else pose
