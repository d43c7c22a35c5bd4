"""Artefacts on tracks: they are where their tracks say, whatever happens around them."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros.population.artefact import Artefact, GroundPose
from are_ros.population.scenario import Track


@dataclass(eq=False, slots=True)
class FollowedTrack:
    """The track of one artefact, which counts from `start_ns`; instants are nanoseconds.

    The artefact is where its track is at the sub-steps, `period_ns` apart, and between these on the
    straight line: the leg that it is on, since `since_ns`. Where the track jumps the artefact does
    so at the next sub-step: until then it goes on if the jump is at its very instant, else it
    stands.
    """

    track: Track
    start_ns: int
    period_ns: int
    since_ns: int = 0

    def begin(self, artefact: Artefact) -> tuple[int, GroundPose]:
        """Begin with the arrival; return the next sub-step's instant, and the pose then."""
        arrival_ns = self.since_ns = artefact.arrival_ns
        step_ns = -(-arrival_ns // self.period_ns) * self.period_ns
        return step_ns, self._bound_for(artefact.ground_pose_at(arrival_ns), step_ns)

    def postpone(self, by_ns: int) -> None:
        """Let all that is still to come be so much later: time stood still."""
        self.start_ns += by_ns
        self.since_ns += by_ns

    def jump(self, step_ns: int) -> GroundPose | None:
        """Return where it has jumped by the sub-step at `step_ns`, None if it has not."""
        now_ns = step_ns - self.start_ns
        if self.track.jump_within(self.since_ns - self.start_ns, now_ns) is None:
            return None
        return self.track.pose_at(now_ns)

    def set_out(self, step_ns: int, pose: GroundPose) -> GroundPose:
        """Begin the next leg, from a pose at `step_ns`; return where the next sub-step has it."""
        self.since_ns = step_ns
        return self._bound_for(pose, step_ns + self.period_ns)

    def ahead(self, step_ns: int, count: int) -> npt.NDArray[np.float64]:
        """Return where it will be in the `count` sub-steps after `step_ns`, float64 (count, 3).

        The columns are x, y, yaw. Good to plan by; the poses to be are those of `set_out`.
        """
        steps = np.arange(1, count + 1, dtype=np.int64)
        return self.track.poses_at(step_ns - self.start_ns + self.period_ns * steps)

    def _bound_for(self, pose: GroundPose, until_ns: int) -> GroundPose:
        """Return where one that is at a pose goes until an instant, before it jumps there."""
        until_ns -= self.start_ns
        jump = self.track.jump_within(self.since_ns - self.start_ns, until_ns)
        if jump is None:
            return self.track.pose_at(until_ns)
        return self.track.pose(jump - 1) if self.track.times_ns[jump] == until_ns else pose
