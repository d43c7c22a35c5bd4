"""The poses of all the living, sub-step by sub-step, kept once: their histories are views of it."""

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
    """Frames, one a sub-step: who lives from an instant on, where, and where each will be next.

    Frame k holds from `times_ns[k]` until frame k + 1 begins: those of `ids` int64 (N,), ascending,
    go straight from the poses `starts` to `ends`, where they are at `until_ns[k]`, and stay there.
    Poses are float64 (N, 4), x, y, z, yaw in the map frame. Nobody writes into the arrays later, so
    a frame costs the same however many live. A frame is recorded when it begins, and never changes:
    who is somewhere else when the next one begins has jumped at that instant.

    Frames older than `history_ns` before the newest are forgotten, but for the one that is needed
    there. `first` is the number of the oldest kept, `end` that of the next to come. From
    `still_since_ns` on, as far as it is known, nobody moves.
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
        """Return the history of one who has come at `t_ns`; all frames from now on are its own.

        Until the first of them it stands, or goes straight to a pose, at which it is at an instant.
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
        """Forget all frames: the clock jumped. To be called when nobody lives."""
        self.first = self.end
        for kept in (self.times_ns, self.until_ns, self.ids, self.starts, self.ends):
            kept.clear()


class BufferedHistory(PoseHistory):
    """The history of one artefact on a tape: how it came, and its frames since.

    These are `first` and those that follow, before `end` once it is closed.
    """

    def __init__(
        self,
        buffer: TrajectoryBuffer,
        artefact_id: int,
        first: tuple[int, GroundPose, int, GroundPose],
    ) -> None:
        """Take from when and where until when and whither it goes before its first frame."""
        super().__init__(first[0], first[1])
        self.buffer = buffer
        self.artefact_id = artefact_id
        self._came = first
        self.first = buffer.end
        self.end: int | None = None
        self._last = first[3]

    @property
    def latest_ns(self) -> int:
        """The time at which it is at the newest pose: as far as it is known where it will be."""
        low, high = self._frames()
        return self.buffer.until_ns[high - 1] if low < high else self._came[2]

    @property
    def latest(self) -> GroundPose:
        """The newest pose, that of `latest_ns`."""
        low, high = self._frames()
        return self._read(self.buffer.ends, high - 1) if low < high else self._last

    def close(self) -> None:
        """Have no frames but those of now."""
        self._last = self.latest
        self.end = self.buffer.end

    def pose_at(self, t_ns: int) -> GroundPose:
        """Return the pose at `t_ns`: yaw by the shorter arc, in [-pi, pi] where interpolated."""
        start_ns, start, until_ns, end = self._result(t_ns)
        if t_ns >= until_ns:
            return end
        if t_ns <= start_ns or start == end:
            return start
        return between(start, end, (t_ns - start_ns) / (until_ns - start_ns))

    def velocity_at(self, t_ns: int) -> tuple[float, float, float]:
        """Return the rates of x, y [m/s] and yaw [rad/s] in the map frame from `t_ns` on.

        At an instant where two motions meet it is that of the later one: where an artefact is
        bound for is known. A jump is no motion, and outside the poses there is none.
        """
        start_ns, start, until_ns, end = self._result(t_ns)
        if not start_ns <= t_ns < until_ns:
            return 0.0, 0.0, 0.0
        return rates_between(start_ns, start, until_ns, end)

    def _frames(self) -> tuple[int, int]:
        """Return the bounds [low, high) of its frames among those kept."""
        buffer = self.buffer
        high = len(buffer.times_ns) if self.end is None else max(self.end - buffer.first, 0)
        return min(max(self.first - buffer.first, 0), high), high

    def _result(self, t_ns: int) -> tuple[int, GroundPose, int, GroundPose]:
        """Return from when and where to when and where it goes as of `t_ns`.

        Where earlier frames are forgotten it stands before the first.
        """
        buffer, (low, high) = self.buffer, self._frames()
        frame = bisect_right(buffer.times_ns, t_ns, low, high) - 1
        if frame >= low:
            times_ns = buffer.times_ns[frame], buffer.until_ns[frame]
            start = self._read(buffer.starts, frame)
            return times_ns[0], start, times_ns[1], self._read(buffer.ends, frame)
        if self.first >= buffer.first:
            return self._came
        pose = self._read(buffer.starts, low) if low < high else self._last
        return t_ns, pose, t_ns, pose

    def _read(self, poses: list[_Floats], index: int) -> GroundPose:
        row = self.buffer.ids[index].searchsorted(self.artefact_id)
        return GroundPose._make(poses[index][row].tolist())


def motions_at(histories: Sequence[PoseHistory], t_ns: int) -> tuple[_Floats, _Floats]:
    """Return the poses (N, 4) of many at `t_ns`, and the rates (N, 3) of x, y, yaw from then on.

    Each is what its `pose_at` and `velocity_at` give; those in one frame of a tape at once.
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
    """Return the poses (M, 4) and rates (M, 3) at `t_ns` of some who are in a frame that holds."""
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
    """Return `math.remainder(angle, math.tau)` of each; by one turn at most it is exact so."""
    wrapped: _Floats = angles_rad.copy()
    wrapped[angles_rad > math.pi] -= math.tau
    wrapped[angles_rad < -math.pi] += math.tau
    for i in np.flatnonzero(np.abs(angles_rad) >= math.tau):
        wrapped[i] = math.remainder(angles_rad[i], math.tau)
    return wrapped
