"""The edges of a frame tree: where they come from, and their samples in the order of time."""

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from are_ros.world.rigid_transform import Pose

_SERIES_REACH: Final = 0.005
"""1 - cos(angle) up to which five terms of the series are exact to rounding (a turn of 11 deg)."""


class TransformSource(IntEnum):
    """Where a transform comes from; the higher one wins where two speak of the same edge.

    Odometry messages are below tf or, where the user prefers them, above it.
    """

    ODOMETRY = 0
    TF = 1
    PREFERRED_ODOMETRY = 2
    PARAMETER = 3


@dataclass(slots=True)
class Edge:
    """One frame's edge to its parent: at least one sample, ascending in stamp [ns].

    Every sample has its own parent, and the pose parent_from_child. A static edge has one sample,
    of stamp 0.
    """

    child: str
    source: TransformSource
    is_static: bool
    stamps_ns: list[int]
    parents: list[str]
    poses: list[Pose]

    @property
    def parent(self) -> str:
        """The parent of the newest sample."""
        return self.parents[-1]

    @property
    def newest_ns(self) -> int:
        """The stamp of the newest sample."""
        return self.stamps_ns[-1]

    def row_at(self, stamp_ns: int) -> int:
        """Return the sample in force at a stamp: the newest not after it, -1 if there is none."""
        return 0 if self.is_static else bisect_right(self.stamps_ns, stamp_ns) - 1

    def pose_at(self, row: int, stamp_ns: int) -> Pose:
        """Return the pose at a stamp at which sample `row` is in force, and another one follows.

        Between two samples the translation is linear, the rotation a slerp along the shorter arc.
        Where the next sample has another parent, the pose is held.
        """
        start_ns, pose = self.stamps_ns[row], self.poses[row]
        if self.is_static or stamp_ns == start_ns or self.parents[row] != self.parents[row + 1]:
            return pose
        share = (stamp_ns - start_ns) / (self.stamps_ns[row + 1] - start_ns)
        return _between(pose, self.poses[row + 1], share)

    def append(self, parent: str, stamp_ns: int, pose: Pose, history_ns: int) -> None:
        """Add a sample newer than all others; what is older than the history falls off."""
        self._insert(len(self.stamps_ns), parent, stamp_ns, pose)
        self._keep(bisect_left(self.stamps_ns, stamp_ns - history_ns), len(self.stamps_ns))

    def insert(self, parent: str, stamp_ns: int, pose: Pose) -> None:
        """Add a sample not newer than all others.

        At a stamp that is taken the first sample stays, unless the newcomer names another parent.
        """
        at = bisect_left(self.stamps_ns, stamp_ns)
        if self.stamps_ns[at] != stamp_ns:
            self._insert(at, parent, stamp_ns, pose)
        elif self.parents[at] != parent:
            self.parents[at], self.poses[at] = parent, pose

    def forget_after(self, now_ns: int) -> None:
        """Drop the samples stamped after `now_ns`; the edge may be left without any."""
        self._keep(0, bisect_right(self.stamps_ns, now_ns))

    def _insert(self, at: int, parent: str, stamp_ns: int, pose: Pose) -> None:
        self.stamps_ns.insert(at, stamp_ns)
        self.parents.insert(at, parent)
        self.poses.insert(at, pose)

    def _keep(self, first: int, end: int) -> None:
        for column in (self.stamps_ns, self.parents, self.poses):
            del column[end:], column[:first]


def _between(a: Pose, b: Pose, t: float) -> Pose:
    """Return the pose at a share of the way from a (0) to b (1)."""
    x0, y0, z0, i0, j0, k0, w0 = a
    x1, y1, z1, i1, j1, k1, w1 = b
    s = 1.0 - t
    cosine = i0 * i1 + j0 * j1 + k0 * k1 + w0 * w1
    gap = 1.0 - abs(cosine)
    if gap < _SERIES_REACH:
        of_a, of_b = _weight_by_series(s, gap), _weight_by_series(t, gap)
    else:
        angle = math.acos(abs(cosine))
        scale = 1.0 / math.sin(angle)
        of_a, of_b = math.sin(s * angle) * scale, math.sin(t * angle) * scale
    if cosine < 0.0:
        of_b = -of_b
    return (
        s * x0 + t * x1,
        s * y0 + t * y1,
        s * z0 + t * z1,
        of_a * i0 + of_b * i1,
        of_a * j0 + of_b * j1,
        of_a * k0 + of_b * k1,
        of_a * w0 + of_b * w1,
    )


def _weight_by_series(t: float, gap: float) -> float:
    """Return sin(t angle) / sin(angle) for 1 - cos(angle) = gap, without trigonometry.

    The factors are gap (i / (2i + 1) - t^2 / (i (2i + 1))), i = 1..5 (Eberly's slerp).
    """
    u = t * t
    total = 1.0 + gap * (5.0 / 11.0 - u * (1.0 / 55.0))
    total = 1.0 + gap * (4.0 / 9.0 - u * (1.0 / 36.0)) * total
    total = 1.0 + gap * (3.0 / 7.0 - u * (1.0 / 21.0)) * total
    total = 1.0 + gap * (2.0 / 5.0 - u * (1.0 / 10.0)) * total
    total = 1.0 + gap * (1.0 / 3.0 - u * (1.0 / 3.0)) * total
    return t * total
