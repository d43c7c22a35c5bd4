"""The recent poses of all agents, one frame per sub-step; histories of artefacts are views."""

import math
from bisect import bisect_right
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.population.artefact import GroundPose, PoseHistory, between, rates_between

_Floats = npt.NDArray[np.float64]
_Ints = npt.NDArray[np.int64]


class TrajectoryBuffer:
    """One frame per sub-step: the agents alive, their poses at its beginning, and at its end.

    Frame k is valid from `times_ns[k]` until frame k + 1 begins. The agents `ids` int64 (N,),
    ascending, move straight from the poses `starts` to the poses `ends`, which they reach at
    `until_ns[k]`, and stay there. Poses are float64 (N, 4), x, y, z, yaw in the map frame. The
    arrays are kept, not copied, and not written into later. A frame is recorded when it begins, and
    never changes: an agent with another pose at the beginning of the next frame has jumped.

    Frames that end more than `history_ns` before the newest one are dropped. `first` is the number
    of the oldest frame, `end` that of the next one. After `still_since_ns` no agent moves, as far
    as it is known.
    """

    def __init__(self, history_ns: int = 2 * NS_PER_S) -> None:
        self.history_ns = history_ns
        self.still_since_ns = 0
        self.first = 0
        self.times_ns: list[int] = []
        self.until_ns: list[int] = []
        self.ids: list[_Ints] = []
        self.starts: list[_Floats] = []
        self.ends: list[_Floats] = []

    @property
    def end(self) -> int:
        """The number of the next frame."""
        return self.first + len(self.times_ns)

    def begin(
        self,
        artefact_id: int,
        t_ns: int,
        pose: GroundPose,
        goes_to: tuple[int, GroundPose] | None = None,
    ) -> "BufferedHistory":
        """Return the history of an artefact that arrives at `t_ns`; it is in all later frames.

        Until the first of these it stands, or moves straight to a pose, `goes_to`: (instant, pose).
        """
        first = (t_ns, pose, *(goes_to or (t_ns, pose)))
        if first[3] != pose:
            self.still_since_ns = max(self.still_since_ns, first[2])
        return BufferedHistory(self, artefact_id, first)

    def record(self, t_ns: int, until_ns: int, ids: _Ints, starts: _Floats, ends: _Floats) -> None:
        """Add the frame of a sub-step that begins at `t_ns`; `until_ns` is when it will end."""
        if ends is not starts:
            self.still_since_ns = until_ns
        elif not self.ends or self.ends[-1] is not starts:
            self.still_since_ns = max(self.still_since_ns, t_ns)
        self.times_ns.append(t_ns)
        self.until_ns.append(until_ns)
        self.ids.append(ids)
        self.starts.append(starts)
        self.ends.append(ends)
        while len(self.times_ns) > 1 and self.times_ns[1] <= t_ns - self.history_ns:
            for kept in (self.times_ns, self.until_ns, self.ids, self.starts, self.ends):
                del kept[0]
            self.first += 1

    def clear(self) -> None:
        """Drop all frames: the clock jumped. Call it when no artefact is alive."""
        self.first, self.still_since_ns = self.end, 0
        for kept in (self.times_ns, self.until_ns, self.ids, self.starts, self.ends):
            kept.clear()


class BufferedHistory(PoseHistory):
    """The history of one artefact: its motion at arrival, and the frames since.

    Its frames begin with number `first`, and end before number `end` once it has departed.
    """

    def __init__(
        self,
        buffer: TrajectoryBuffer,
        artefact_id: int,
        first: tuple[int, GroundPose, int, GroundPose],
    ) -> None:
        """Take its motion before its first frame: start time [ns], pose, end time [ns], pose."""
        super().__init__(first[0], first[1])
        self.buffer = buffer
        self.artefact_id = artefact_id
        self._arrival = first
        self.first = buffer.end
        self.end: int | None = None
        self._last = first[3]

    @property
    def latest_ns(self) -> int:
        """The time of the newest known pose, which may be in the future [ns]."""
        low, high = self._frames()
        return self.buffer.until_ns[high - 1] if low < high else self._arrival[2]

    @property
    def latest(self) -> GroundPose:
        """The newest pose, that of `latest_ns`."""
        low, high = self._frames()
        return self._read(self.buffer.ends, high - 1) if low < high else self._last

    def close(self) -> None:
        """End the history: later frames belong to others."""
        self._last = self.latest
        self.end = self.buffer.end

    def pose_at(self, t_ns: int) -> GroundPose:
        """Return the pose at `t_ns`: yaw by the shorter arc, in [-pi, pi] where interpolated."""
        start_ns, start, until_ns, end = self._motion_at(t_ns)
        if t_ns >= until_ns:
            return end
        if t_ns <= start_ns or start == end:
            return start
        return between(start, end, (t_ns - start_ns) / (until_ns - start_ns))

    def velocity_at(self, t_ns: int) -> tuple[float, float, float]:
        """Return the rates of x, y [m/s] and yaw [rad/s] in the map frame from `t_ns` on.

        Between two motions it is the rate of the later one. The rates of a jump, and outside the
        known poses, are 0.
        """
        start_ns, start, until_ns, end = self._motion_at(t_ns)
        if not start_ns <= t_ns < until_ns:
            return 0.0, 0.0, 0.0
        return rates_between(start_ns, start, until_ns, end)

    def _frames(self) -> tuple[int, int]:
        """Return the indices [low, high) of its frames among those kept."""
        buffer = self.buffer
        high = len(buffer.times_ns) if self.end is None else max(self.end - buffer.first, 0)
        return min(max(self.first - buffer.first, 0), high), high

    def _motion_at(self, t_ns: int) -> tuple[int, GroundPose, int, GroundPose]:
        """Return its motion at `t_ns`: start time [ns], pose, end time [ns], pose.

        Before the first frame kept, if earlier ones are dropped, it stands.
        """
        buffer, (low, high) = self.buffer, self._frames()
        frame = bisect_right(buffer.times_ns, t_ns, low, high) - 1
        if frame >= low:
            times_ns = buffer.times_ns[frame], buffer.until_ns[frame]
            start = self._read(buffer.starts, frame)
            return times_ns[0], start, times_ns[1], self._read(buffer.ends, frame)
        if self.first >= buffer.first:
            return self._arrival
        pose = self._read(buffer.starts, low) if low < high else self._last
        return t_ns, pose, t_ns, pose

    def _read(self, poses: list[_Floats], index: int) -> GroundPose:
        row = self.buffer.ids[index].searchsorted(self.artefact_id)
        return GroundPose._make(poses[index][row].tolist())


def motions_at(histories: Sequence[PoseHistory], t_ns: int) -> tuple[_Floats, _Floats]:
    """Return the poses (N, 4) at `t_ns`, and the rates (N, 3) of x, y [m/s] and yaw [rad/s] then.

    They equal `pose_at` and `velocity_at` of each history; those in one frame are read at once.
    """
    poses, rates = np.empty((len(histories), 4)), np.zeros((len(histories), 3))
    buffer = next((one.buffer for one in histories if isinstance(one, BufferedHistory)), None)
    frame = -1 if buffer is None else bisect_right(buffer.times_ns, t_ns) - 1
    inside, ids = list[int](), list[int]()
    for k, one in enumerate(histories):
        if isinstance(one, BufferedHistory) and one.buffer is buffer and frame >= 0:
            number = buffer.first + frame
            if one.first <= number and (one.end is None or number < one.end):
                inside.append(k)
                ids.append(one.artefact_id)
                continue
        poses[k], rates[k] = one.pose_at(t_ns), one.velocity_at(t_ns)
    if buffer is not None and inside:
        poses[inside], rates[inside] = _frame_at(buffer, frame, np.array(ids), t_ns)
    return poses, rates


def _frame_at(
    buffer: TrajectoryBuffer, frame: int, ids: _Ints, t_ns: int
) -> tuple[_Floats, _Floats]:
    """Return the poses (M, 4) and rates (M, 3) at `t_ns` of some ids of the frame valid then."""
    rows, starts, ends = (
        buffer.ids[frame].searchsorted(ids),
        buffer.starts[frame],
        buffer.ends[frame],
    )
    start_ns, until_ns = buffer.times_ns[frame], buffer.until_ns[frame]
    poses = (starts if t_ns == start_ns else ends)[rows]
    if starts is ends or t_ns >= until_ns:
        return poses, np.zeros((len(rows), 3))
    steps = ends[rows] - starts[rows]
    steps[:, 3] = _wrapped(steps[:, 3])
    if t_ns != start_ns:
        poses = starts[rows] + (t_ns - start_ns) / (until_ns - start_ns) * steps
        poses[:, 3] = _wrapped(poses[:, 3])
        stands = (starts[rows] == ends[rows]).all(axis=1)
        poses[stands] = starts[rows[stands]]
    return poses, steps[:, [0, 1, 3]] * (NS_PER_S / (until_ns - start_ns))


def _wrapped(angles_rad: _Floats) -> _Floats:
    """Return `math.remainder(angle, math.tau)` of each angle, exact to the bit."""
    wrapped: _Floats = angles_rad.copy()
    wrapped[angles_rad > math.pi] -= math.tau
    wrapped[angles_rad < -math.pi] += math.tau
    for i in np.flatnonzero(np.abs(angles_rad) >= math.tau):
        wrapped[i] = math.remainder(angles_rad[i], math.tau)
    return wrapped
