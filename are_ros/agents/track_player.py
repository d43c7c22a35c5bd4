"""Artefacts on tracks: their poses are prescribed, whatever is in their way."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros.population.artefact import Artefact, GroundPose
from are_ros.population.scenario import Track


@dataclass(eq=False, slots=True)
class FollowedTrack:
    """The track of one artefact, whose times count from `start_ns`; instants are nanoseconds.

    At sub-steps, `period_ns` apart, the artefact is at the pose of its track; between them, since
    `since_ns`, it moves on the straight line. If the track jumps between two sub-steps, the
    artefact stands until the next one, and jumps then; if the jump is exactly at the next one, it
    moves until then.
    """

    track: Track
    start_ns: int
    period_ns: int
    since_ns: int = 0

    def begin(self, artefact: Artefact) -> tuple[int, GroundPose]:
        """Begin at the arrival; return the instant of the next sub-step, and the pose then."""
        arrival_ns = self.since_ns = artefact.arrival_ns
        step_ns = -(-arrival_ns // self.period_ns) * self.period_ns
        return step_ns, self._next_pose(artefact.ground_pose_at(arrival_ns), step_ns)

    def postpone(self, by_ns: int) -> None:
        """Postpone the rest of the track, after a pause."""
        self.start_ns += by_ns
        self.since_ns += by_ns

    def jump(self, step_ns: int) -> GroundPose | None:
        """Return the pose after a jump since the last sub-step, None if there was none."""
        now_ns = step_ns - self.start_ns
        if self.track.jump_within(self.since_ns - self.start_ns, now_ns) is None:
            return None
        return self.track.pose_at(now_ns)

    def advance(self, step_ns: int, pose: GroundPose) -> GroundPose:
        """Go on from a pose at `step_ns`; return the pose at the next sub-step."""
        self.since_ns = step_ns
        return self._next_pose(pose, step_ns + self.period_ns)

    def ahead(self, step_ns: int, count: int) -> npt.NDArray[np.float64]:
        """Return x, y, yaw in the `count` sub-steps after `step_ns`, float64 (count, 3).

        They are for planning, within rounding; `advance` returns the exact poses.
        """
        steps = np.arange(1, count + 1, dtype=np.int64)
        return self.track.poses_at(step_ns - self.start_ns + self.period_ns * steps)

    def _next_pose(self, pose: GroundPose, until_ns: int) -> GroundPose:
        """Return the pose at an instant, from a pose now, before a jump at that instant."""
        until_ns -= self.start_ns
        jump = self.track.jump_within(self.since_ns - self.start_ns, until_ns)
        if jump is None:
            return self.track.pose_at(until_ns)
        return self.track.pose(jump - 1) if self.track.times_ns[jump] == until_ns else pose
