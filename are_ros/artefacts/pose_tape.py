"""The poses of all the living, sub-step by sub-step, kept once: their histories are views of it."""

import math
import struct
from bisect import bisect_right
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.artefact import GroundPose, PoseHistory, between, rates_between
from are_ros.conventions import NS_PER_S

_Floats = npt.NDArray[np.float64]
_Ints = npt.NDArray[np.int64]
_POSE = struct.Struct("4d")


class PoseTape:
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
    ) -> "TapeHistory":
        """Return the history of one who has come at `t_ns`; all frames from now on are its own.

        Until the first of them it stands, or goes straight to a pose, at which it is at an instant.
        """
        first = (t_ns, pose, *(goes_to or (t_ns, pose)))
        if first[3] != pose:
            self.still_since_ns = max(self.still_since_ns, first[2])
        return TapeHistory(self, artefact_id, first)

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


class TapeHistory(PoseHistory):
    """The history of one artefact on a tape: how it came, and its frames since."""

    def __init__(
        self, tape: PoseTape, artefact_id: int, first: tuple[int, GroundPose, int, GroundPose]
    ) -> None:
        """Take from when and where until when and whither it goes before its first frame."""
        super().__init__(first[0], first[1], tape.history_ns)
        self._tape = tape
        self.artefact_id = artefact_id
        self._came = first
        self._first = tape.end
        self._end: int | None = None
        self._last = self._kept = first[3]
        self._raw = _POSE.pack(*self._kept)

    @property
    def latest_ns(self) -> int:
        """The time at which it is at the newest pose: as far as it is known where it will be."""
        low, high = self._frames()
        return self._tape.until_ns[high - 1] if low < high else self._came[2]

    @property
    def latest(self) -> GroundPose:
        """The newest pose, that of `latest_ns`; the same object until there is another one."""
        low, high = self._frames()
        return self._seen(self._tape.ends, high - 1) if low < high else self._last

    def see(self, raw: bytes) -> GroundPose:
        """Return the pose of these bytes, four float64; the same object as the last if equal."""
        if raw != self._raw:  # by their bits: -0.0 is not 0.0 in the bytes of a message
            self._raw, self._kept = raw, GroundPose._make(_POSE.unpack(raw))
        return self._kept

    @property
    def tape(self) -> PoseTape:
        """Where its frames are."""
        return self._tape

    def close(self) -> None:
        """Have no frames but those of now."""
        self._last = self.latest
        self._end = self._tape.end

    def is_in(self, index: int) -> bool:
        """Say whether frame `index` of those kept is its own."""
        number = self._tape.first + index
        return self._first <= number and (self._end is None or number < self._end)

    def pose_at(self, t_ns: int) -> GroundPose:
        """Return the pose at `t_ns`: yaw by the shorter arc, in [-pi, pi] where interpolated."""
        start_ns, start, until_ns, end = self._leg(t_ns)
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
        start_ns, start, until_ns, end = self._leg(t_ns)
        if not start_ns <= t_ns < until_ns:
            return 0.0, 0.0, 0.0
        return rates_between(start_ns, start, until_ns, end)

    def _frames(self) -> tuple[int, int]:
        """Return the bounds [low, high) of its frames among those kept."""
        tape = self._tape
        high = len(tape.times_ns) if self._end is None else max(self._end - tape.first, 0)
        return min(max(self._first - tape.first, 0), high), high

    def _leg(self, t_ns: int) -> tuple[int, GroundPose, int, GroundPose]:
        """Return from when and where to when and where it goes as of `t_ns`.

        Where earlier frames are forgotten it stands before the first.
        """
        tape, (low, high) = self._tape, self._frames()
        frame = bisect_right(tape.times_ns, t_ns, low, high) - 1
        if frame >= low:
            times_ns = tape.times_ns[frame], tape.until_ns[frame]
            start = self._seen(tape.starts, frame)
            return times_ns[0], start, times_ns[1], self._seen(tape.ends, frame)
        if self._first >= tape.first:
            return self._came
        pose = self._seen(tape.starts, low) if low < high else self._last
        return t_ns, pose, t_ns, pose

    def _seen(self, poses: list[_Floats], index: int) -> GroundPose:
        row = self._tape.ids[index].searchsorted(self.artefact_id)
        return self.see(poses[index][row].tobytes())


def poses_at(histories: Sequence[PoseHistory], t_ns: int) -> list[GroundPose]:
    """Return the poses of many at `t_ns` at once, each as its `pose_at` gives it."""
    tape = next((one.tape for one in histories if isinstance(one, TapeHistory)), None)
    frame = -1 if tape is None else bisect_right(tape.times_ns, t_ns) - 1
    if tape is None or frame < 0:
        return [one.pose_at(t_ns) for one in histories]
    together = [
        one
        for one in histories
        if isinstance(one, TapeHistory) and one.tape is tape and one.is_in(frame)
    ]
    poses = dict(zip(map(id, together), _read(tape, frame, together, t_ns), strict=True))
    return [poses.get(id(one)) or one.pose_at(t_ns) for one in histories]


def _read(
    tape: PoseTape, frame: int, histories: Sequence[TapeHistory], t_ns: int
) -> Iterator[GroundPose]:
    """Yield the poses at `t_ns` of those who are in a frame that holds then."""
    wanted = np.array([one.artefact_id for one in histories], np.int64)
    rows = tape.ids[frame].searchsorted(wanted)
    start_ns, until_ns = tape.times_ns[frame], tape.until_ns[frame]
    starts, ends = tape.starts[frame], tape.ends[frame]
    if starts is ends or t_ns == start_ns or t_ns >= until_ns:
        poses = (starts if t_ns == start_ns else ends)[rows]
    else:
        poses = _all_between(starts[rows], ends[rows], (t_ns - start_ns) / (until_ns - start_ns))
    raw = poses.tobytes()
    for k, one in enumerate(histories):
        yield one.see(raw[32 * k : 32 * k + 32])


def _all_between(starts: _Floats, ends: _Floats, fraction: float) -> _Floats:
    """Interpolate from poses (N, 4) to others, to the bit as `between` does; who stands stays."""
    steps: _Floats = ends - starts
    steps[:, 3] = _wrapped(steps[:, 3])
    poses: _Floats = starts + fraction * steps
    poses[:, 3] = _wrapped(poses[:, 3])
    stands = (starts == ends).all(axis=1)
    poses[stands] = starts[stands]
    return poses


def _wrapped(angles_rad: _Floats) -> _Floats:
    """Return `math.remainder(angle, math.tau)` of each; by one turn at most it is exact so."""
    wrapped: _Floats = angles_rad.copy()
    wrapped[angles_rad > math.pi] -= math.tau
    wrapped[angles_rad < -math.pi] += math.tau
    for i in np.flatnonzero(np.abs(angles_rad) >= math.tau):
        wrapped[i] = math.remainder(angles_rad[i], math.tau)
    return wrapped
