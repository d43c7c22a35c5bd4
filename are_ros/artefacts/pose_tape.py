"""The poses of all the living, sub-step by sub-step, kept once: their histories are views of it."""

import math
import struct
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.artefact import GroundPose, PoseHistory, between, rates_between
from are_ros.conventions import NS_PER_S

_Floats = npt.NDArray[np.float64]
_Ints = npt.NDArray[np.int64]
_Entry = tuple[int, GroundPose]
_POSE = struct.Struct("4d")


class PoseTape:
    """Frames, one a sub-step: an instant, who lived then and where.

    `times_ns` ascends; `ids` are int64 (N,), ascending, and `poses` float64 (N, 4), x, y, z, yaw in
    the map frame; nobody writes into them later, so a frame costs the same however many live.
    Frames older than `history_ns` before the newest are forgotten, but for the one that is needed
    to interpolate there. `first` is the number of the oldest kept, `end` that of the next to come.
    """

    def __init__(self, history_ns: int = 2 * NS_PER_S) -> None:
        self.history_ns = history_ns
        self.first = 0
        self.times_ns: list[int] = []
        self.ids: list[_Ints] = []
        self.poses: list[_Floats] = []
        self._open: dict[int, TapeHistory] = {}

    @property
    def end(self) -> int:
        """The number of the next frame."""
        return self.first + len(self.times_ns)

    def begin(self, artefact_id: int, t_ns: int, pose: GroundPose) -> "TapeHistory":
        """Return the history of one who has come at `t_ns`; all frames from now on are its own."""
        history = self._open[artefact_id] = TapeHistory(self, artefact_id, t_ns, pose)
        return history

    def stop(self, artefact_id: int) -> None:
        """Let one, known or not, be in no later frame; its history stays what it is."""
        history = self._open.pop(artefact_id, None)
        if history is not None:
            history.close()

    def record(self, since_ns: int, t_ns: int, ids: _Ints, before: _Floats, poses: _Floats) -> None:
        """Add the sub-step in which those of `ids` went from poses `before` to `poses`.

        It lasted from `since_ns` to `t_ns`; where nothing was recorded for longer, all had stood.
        """
        if not self.times_ns or self.times_ns[-1] < since_ns:
            self._add(since_ns, ids, before)
        self._add(t_ns, ids, poses)
        while len(self.times_ns) > 1 and self.times_ns[1] <= t_ns - self.history_ns:
            del self.times_ns[0], self.ids[0], self.poses[0]
            self.first += 1

    def clear(self) -> None:
        """Forget all frames: the clock jumped; histories that are open keep their last poses."""
        for artefact_id in list(self._open):
            self.stop(artefact_id)
        self.first = self.end
        for kept in (self.times_ns, self.ids, self.poses):
            kept.clear()

    def _add(self, t_ns: int, ids: _Ints, poses: _Floats) -> None:
        self.times_ns.append(t_ns)
        self.ids.append(ids)
        self.poses.append(poses)


class TapeHistory(PoseHistory):
    """The history of one artefact on a tape: what was appended to it, and its frames in between.

    Appended are its arrival, and where it was before it jumped. Of two poses at one instant, that
    of the frame counts.
    """

    def __init__(self, tape: PoseTape, artefact_id: int, t_ns: int, pose: GroundPose) -> None:
        super().__init__(t_ns, pose, tape.history_ns)
        self._tape = tape
        self.artefact_id = artefact_id
        self._arrival_ns = t_ns
        self._first = tape.end
        self._end: int | None = None
        self._seen: _Floats | None = None
        self._raw = _POSE.pack(*pose)
        self._latest = pose

    @property
    def latest_ns(self) -> int:
        """Time of the newest pose, be it the one before again."""
        low, high = self._frames()
        return self._tape.times_ns[high - 1] if low < high else self._times_ns[-1]

    @property
    def latest(self) -> GroundPose:
        """The newest pose; the same object until there is another one."""
        low, high = self._frames()
        if low < high and self._tape.poses[high - 1] is not self._seen:
            self._seen = self._tape.poses[high - 1]
            self.see(self._raw_at(high - 1), is_newest=True)
        return self._latest

    def see(self, raw: bytes, *, is_newest: bool) -> GroundPose:
        """Return the pose of these bytes, four float64; the same object as the newest if equal."""
        if raw == self._raw:  # by their bits: -0.0 is not 0.0 in the bytes of a message
            return self._latest
        pose = GroundPose._make(_POSE.unpack(raw))
        if is_newest:
            self._raw, self._latest = raw, pose
        return pose

    @property
    def tape(self) -> PoseTape:
        """Where its frames are."""
        return self._tape

    def close(self) -> None:
        """Have no frames but those of now."""
        _ = self.latest
        self._end = self._tape.end

    def has_only_frames_from(self, index: int) -> bool:
        """Say whether frame `index` of those kept and all later ones, and they alone, are its."""
        tape = self._tape
        is_in = self._end is None and self._first - tape.first <= index
        return is_in and self._times_ns[-1] <= tape.times_ns[index]

    def pose_at(self, t_ns: int) -> GroundPose:
        """Return the pose at `t_ns`: yaw by the shorter arc, in [-pi, pi] where interpolated."""
        start, end = self._around(t_ns)
        if end is None:
            return self.latest
        if start is None:
            return end[1]
        fraction = (t_ns - start[0]) / (end[0] - start[0])
        if fraction == 0.0 or start[1] == end[1]:
            return start[1]
        return between(start[1], end[1], fraction)

    def velocity_at(self, t_ns: int) -> tuple[float, float, float]:
        """Return the rates of x, y [m/s] and yaw [rad/s] in the map frame as of `t_ns`.

        At an instant where two motions meet it is that of the earlier one. A jump (two poses
        within a millisecond) is no motion, and outside the poses there is none.
        """
        start, end = self._around(t_ns - 1)
        if start is None or end is None:
            return 0.0, 0.0, 0.0
        return rates_between(*start, *end)

    def _frames(self) -> tuple[int, int]:
        """Return the bounds [low, high) of its frames on the tape."""
        tape = self._tape
        high = len(tape.times_ns) if self._end is None else max(self._end - tape.first, 0)
        low = min(max(self._first - tape.first, 0), high)
        # One who came after a pause is not in the frame that says how long the others stood.
        return bisect_left(tape.times_ns, self._arrival_ns, low, high), high

    def _around(self, t_ns: int) -> tuple[_Entry | None, _Entry | None]:
        """Return the last pose up to `t_ns` and the first one after it, None where there is none.

        Where earlier frames are forgotten, there is none before the first.
        """
        times_ns, own_ns = self._tape.times_ns, self._times_ns
        low, high = self._frames()
        frame, own = bisect_right(times_ns, t_ns, low, high), bisect_right(own_ns, t_ns)
        before = after = None
        if frame > low and (own == 0 or times_ns[frame - 1] >= own_ns[own - 1]):
            before = times_ns[frame - 1], self._pose_in(frame - 1)
        elif own > 0 and (frame > low or self._first >= self._tape.first):
            before = own_ns[own - 1], self._poses[own - 1]
        if frame < high and (own == len(own_ns) or times_ns[frame] <= own_ns[own]):
            after = times_ns[frame], self._pose_in(frame)
        elif own < len(own_ns):
            after = own_ns[own], self._poses[own]
        return before, after

    def _raw_at(self, index: int) -> bytes:
        row = self._tape.ids[index].searchsorted(self.artefact_id)
        raw: bytes = self._tape.poses[index][row].tobytes()
        return raw

    def _pose_in(self, index: int) -> GroundPose:
        return self.see(self._raw_at(index), is_newest=False)


def poses_at(histories: Sequence[PoseHistory], t_ns: int) -> list[GroundPose]:
    """Return the poses of many at `t_ns` at once, each as its `pose_at` gives it."""
    tape = next((one.tape for one in histories if isinstance(one, TapeHistory)), None)
    start = -1 if tape is None else bisect_right(tape.times_ns, t_ns) - 1
    if tape is None or start < 0:
        return [one.pose_at(t_ns) for one in histories]
    together = [
        one
        for one in histories
        if isinstance(one, TapeHistory) and one.tape is tape and one.has_only_frames_from(start)
    ]
    poses = dict(zip(map(id, together), _read(tape, start, together, t_ns), strict=True))
    return [poses.get(id(one)) or one.pose_at(t_ns) for one in histories]


def _read(
    tape: PoseTape, start: int, histories: Sequence[TapeHistory], t_ns: int
) -> Iterator[GroundPose]:
    """Yield the poses of those who are in all frames from `start`, the last up to `t_ns`, on."""
    wanted = np.array([one.artefact_id for one in histories], np.int64)
    poses, is_newest = tape.poses[start][tape.ids[start].searchsorted(wanted)], True
    if start + 1 < len(tape.times_ns):
        start_ns, end_ns = tape.times_ns[start : start + 2]
        ends = tape.poses[start + 1][tape.ids[start + 1].searchsorted(wanted)]
        if t_ns > start_ns:
            poses = _all_between(poses, ends, (t_ns - start_ns) / (end_ns - start_ns))
        is_newest = False
    raw = poses.tobytes()
    for k, one in enumerate(histories):
        yield one.see(raw[32 * k : 32 * k + 32], is_newest=is_newest)


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
