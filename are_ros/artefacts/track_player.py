"""Artefacts that go by a track: their poses and doings as given, whatever happens around them."""

import struct
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.artefact import Artefact, GroundPose
from are_ros.artefacts.scenario import Doing, Track


@dataclass(eq=False, slots=True)
class _Part:
    """One artefact on its track; the next of its doings."""

    artefact: Artefact
    track: Track
    start_ns: int
    next_doing: int = 0

    def doing_ns(self) -> int | None:
        """Return when it does something else."""
        if self.next_doing == len(self.track.doings):
            return None
        return self.start_ns + self.track.doings[self.next_doing].t_ns


class TrackPlayer:
    """Takes artefacts along their tracks, in the order of their ids; instants are nanoseconds.

    They are where their tracks are at the sub-steps, and between these on the straight line, but
    where a track jumps.
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

    def add(self, artefact: Artefact, track: Track, start_ns: int) -> None:
        """Let an artefact that has just arrived go by a track that counts from `start_ns`."""
        self._parts[artefact.id] = _Part(artefact, track, start_ns)
        self._parts = dict(sorted(self._parts.items()))
        self.tell(artefact.arrival_ns)

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

    def move(self, step_ns: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
        """Take all to where they are in the sub-step that ends at `step_ns`.

        Returns, in the order of `ids`, the poses, float64 (M, 4), and bool (M,) who has moved
        there; another whose pose is a new one has jumped.
        """
        parts = list(self._parts.values())
        moved = np.array([_move(part, step_ns, self._period_ns) for part in parts], dtype=np.bool_)
        poses = np.array([part.artefact.history.latest for part in parts], dtype=np.float64)
        return poses.reshape(-1, 4), moved

    def ahead(self, artefact_id: int, step_ns: int, count: int) -> npt.NDArray[np.float64]:
        """Return where one will be in the `count` sub-steps after `step_ns`, float64 (count, 3).

        The columns are x, y, yaw. Good to plan by; the poses to be are those of `move`.
        """
        part = self._parts[artefact_id]
        steps = np.arange(1, count + 1, dtype=np.int64)
        return part.track.poses_at(step_ns - part.start_ns + self._period_ns * steps)


def _do(artefact: Artefact, doing: Doing, start_ns: int) -> None:
    artefact.behaviour, artefact.activity = doing.behaviour, doing.activity
    ends_ns = doing.departs_ns
    artefact.departure_ns = None if ends_ns is None else start_ns + ends_ns


def _move(part: _Part, step_ns: int, period_ns: int) -> bool:
    """Write the pose of a sub-step into the history; return whether the artefact moved there.

    A history is written here as it is for those who move by themselves, so that a track that was
    saved from histories gives the same ones.
    """
    history, since_ns = part.artefact.history, step_ns - part.start_ns
    pose, was = part.track.pose_at(since_ns), history.latest
    if _bits(pose) == _bits(was):
        return False
    jumps = part.track.jumps_within(since_ns - period_ns, since_ns)
    stood_until_ns = step_ns - (1 if jumps else period_ns)
    if jumps or history.latest_ns < stood_until_ns:
        history.append(stood_until_ns, was)
    history.append(step_ns, pose)
    return not jumps


def _bits(pose: GroundPose) -> bytes:
    """Return what tells poses apart: -0.0 is not 0.0 in the bytes of a message."""
    return struct.pack("4d", *pose)
