"""Histories of poses that a test gives: what those of the agent table are compared with."""

from bisect import bisect_left, bisect_right

from are_ros.population.artefact import GroundPose, PoseHistory, between, rates_between


class GivenPoses(PoseHistory):
    """Linear between the poses given, held outside them."""

    def __init__(self, t_ns: int, pose: GroundPose) -> None:
        super().__init__(t_ns, pose)
        self._times_ns, self._poses = [t_ns], [pose]

    def append(self, t_ns: int, pose: GroundPose) -> None:
        """Say where the artefact is at `t_ns`, later than all before."""
        self._times_ns.append(t_ns)
        self._poses.append(pose)

    @property
    def latest_ns(self) -> int:
        """Time of the newest pose."""
        return self._times_ns[-1]

    @property
    def latest(self) -> GroundPose:
        """The newest pose."""
        return self._poses[-1]

    def pose_at(self, t_ns: int) -> GroundPose:
        """Return the pose at `t_ns`."""
        times, poses = self._times_ns, self._poses
        after = bisect_right(times, t_ns)
        if after in {0, len(times)}:
            return poses[max(after - 1, 0)]
        fraction = (t_ns - times[after - 1]) / (times[after] - times[after - 1])
        if fraction == 0.0 or poses[after - 1] == poses[after]:
            return poses[after - 1]
        return between(poses[after - 1], poses[after], fraction)

    def velocity_at(self, t_ns: int) -> tuple[float, float, float]:
        """Return the rates as of `t_ns`; where two motions meet, those of the earlier one."""
        times, poses = self._times_ns, self._poses
        end = bisect_left(times, t_ns)
        if not 0 < end < len(times):
            return 0.0, 0.0, 0.0
        return rates_between(times[end - 1], poses[end - 1], times[end], poses[end])
