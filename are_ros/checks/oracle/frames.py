"""Transforms over time for the checks, with what was known when: plain chains, no tree of ARE."""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

Floats = NDArray[np.float64]

ODOMETRY, TF, PREFERRED_ODOMETRY, PARAMETER = 0, 1, 2, 3
"""If an edge has several sources, the highest number wins."""

_OF_ODOMETRY: Final = (ODOMETRY, PREFERRED_ODOMETRY)

EVER: Final = 2**63 - 1
"""As a time of knowledge: everything in the recording."""


class Pose(NamedTuple):
    """target_from_source: rotation (3, 3) and translation (3,) in metres."""

    rotation: Floats
    translation_m: Floats

    def after(self, inner: "Pose") -> "Pose":
        """Return the composition: first `inner`, then this."""
        rotation: Floats = self.rotation @ inner.rotation
        return Pose(rotation, self.rotation @ inner.translation_m + self.translation_m)

    def inverse(self) -> "Pose":
        """Return source_from_target."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation_m)


@dataclass(eq=False)
class _Edge:
    """One source's samples of one child frame, in order of stamp; of a static one as they came."""

    parent: str
    is_static: bool
    stamps_ns: list[int] = field(default_factory=list)
    logs_ns: list[int] = field(default_factory=list)
    reached_ns: list[int] = field(default_factory=list)
    """From when on a sample as new as this one, or newer, was known."""
    numbers: list[tuple[float, ...]] = field(default_factory=list)

    def add(self, stamp_ns: int, log_ns: int, numbers: tuple[float, ...]) -> None:
        """Take a sample; at a stamp that is taken the first stays."""
        place = bisect_left(self.stamps_ns, stamp_ns)
        if place < len(self.stamps_ns) and self.stamps_ns[place] == stamp_ns:
            return
        later_ns = self.reached_ns[place] if place < len(self.reached_ns) else log_ns
        self.stamps_ns.insert(place, stamp_ns)
        self.logs_ns.insert(place, log_ns)
        self.reached_ns.insert(place, min(log_ns, later_ns))
        self.numbers.insert(place, numbers)

    def newest_ns(self, known_by_ns: int) -> int | None:
        """Return the newest stamp known by then, None if there is none."""
        if self.is_static:
            return EVER
        count = bisect_right(self.reached_ns, known_by_ns)
        return self.stamps_ns[count - 1] if count else None

    def at(self, stamp_ns: int, known_by_ns: int) -> Pose | None:
        """Return parent_from_child, interpolated; None outside of what was known."""
        if self.is_static:
            return _pose(self.numbers[max(0, bisect_right(self.logs_ns, known_by_ns) - 1)])
        count = bisect_right(self.reached_ns, known_by_ns)
        after = bisect_left(self.stamps_ns, stamp_ns, 0, count)
        before = after - 1
        while after < count and self.logs_ns[after] > known_by_ns:  # it came late
            after += 1
        while before >= 0 and self.logs_ns[before] > known_by_ns:
            before -= 1
        if after == count:
            return None
        if self.stamps_ns[after] == stamp_ns:
            return _pose(self.numbers[after])
        if before < 0:
            return None
        span = self.stamps_ns[after] - self.stamps_ns[before]
        share = (stamp_ns - self.stamps_ns[before]) / span
        return _pose(_between(self.numbers[before], self.numbers[after], share))


class Frames:
    """The edges by child frame; a lookup uses only what was received by `known_by_ns`."""

    def __init__(self) -> None:
        self._edges: dict[str, dict[int, _Edge]] = {}

    def add(
        self,
        parent: str,
        child: str,
        stamp_ns: int,
        log_ns: int,
        numbers: tuple[float, ...],
        source: int,
        *,
        is_static: bool,
    ) -> None:
        """Take parent_from_child: x y z, then the quaternion x y z w; others are left out."""
        parent, child = parent.lstrip("/"), child.lstrip("/")
        is_turn = abs(sum(n * n for n in numbers[3:]) - 1.0) <= 0.01
        if not (parent and child and is_turn and np.isfinite(numbers).all()):
            return
        if source != PARAMETER and self._is_given_turned(parent, child):
            return
        if source in _OF_ODOMETRY:
            child, numbers = self._moved_by(parent, child, numbers)
        elif is_static:
            self._forget_odometry(parent, child)
        pair = self._along_the_pair(parent, child, numbers, source)
        if pair is None:
            return
        parent, child, numbers = pair
        edges = self._edges.setdefault(child, {})
        edge = edges.get(source)
        if edge is None or edge.parent != parent or edge.is_static != is_static:
            edge = edges[source] = _Edge(parent, is_static)
        if is_static:
            edge.logs_ns.append(log_ns)
            edge.numbers.append(numbers)
        else:
            edge.add(stamp_ns, log_ns, numbers)

    def add_given(self, text: str) -> None:
        """Take a static transform of the parameters, "X Y Z YAW PITCH ROLL PARENT CHILD"."""
        *numbers, parent, child = text.split()
        x, y, z, yaw, pitch, roll = map(float, numbers)
        turn = Rotation.from_euler("ZYX", (yaw, pitch, roll)).as_quat().tolist()
        self.add(parent, child, 0, 0, (x, y, z, *turn), PARAMETER, is_static=True)

    def _moved_by(
        self, parent: str, part: str, numbers: tuple[float, ...]
    ) -> tuple[str, tuple[float, ...]]:
        """Return what odometry of a part moves, and its pose: what static transforms fix it to."""
        pose, whole, above = _pose(numbers), part, self._ancestors(parent)
        while (edges := self._edges.get(whole)) and edges[max(edges)].is_static:
            joint = edges[max(edges)]
            whole, pose = joint.parent, pose.after(_pose(joint.numbers[-1]).inverse())
            if whole in above or whole == part:
                return part, numbers
        if whole == part:
            return part, numbers
        turn = Rotation.from_matrix(pose.rotation).as_quat()
        return whole, (*pose.translation_m.tolist(), *turn.tolist())

    def _is_given_turned(self, parent: str, child: str) -> bool:
        """Tell whether an edge is given the other way round, so that the recorded one is left out.

        Where the recorded child has no other parent, the given edge turns, and its numbers hold. A
        replay also records what was given.
        """
        given = self._edges.get(parent, {}).get(PARAMETER)
        if given is None or given.parent != child:
            return False
        if child in self._edges:
            return True
        self._forget_turned(parent, child)
        self.add(parent, child, 0, 0, _turned(given.numbers[-1]), PARAMETER, is_static=True)
        return False

    def _along_the_pair(
        self, parent: str, child: str, numbers: tuple[float, ...], source: int
    ) -> tuple[str, str, tuple[float, ...]] | None:
        """Return an edge as it is to be taken where the pair is there the other way round.

        A weaker one is left out (None), a stronger one takes its place; it is turned where it is as
        strong, or its child has another parent.
        """
        edges = self._edges.get(parent, {})
        reverse = max(edges, default=PARAMETER)
        if source == PARAMETER or not edges or edges[reverse].parent != child:
            return parent, child, numbers
        if source < reverse:
            return None
        if source == reverse or child in self._edges:
            return child, parent, _turned(numbers)
        self._forget_turned(parent, child)
        return parent, child, numbers

    def _forget_odometry(self, parent: str, child: str) -> None:
        """Forget odometry of a frame that a static transform hangs below another parent."""
        edges = self._edges.pop(child, {})
        kept = {of: e for of, e in edges.items() if of not in _OF_ODOMETRY or e.parent == parent}
        if kept:
            self._edges[child] = kept

    def _forget_turned(self, parent: str, child: str) -> None:
        """Forget the edges of a pair that hang its parent below its child."""
        kept = {of: edge for of, edge in self._edges.pop(parent).items() if edge.parent != child}
        if kept:
            self._edges[parent] = kept

    def has(self, frame: str) -> bool:
        """Tell whether a transform names this frame."""
        parents = {edge.parent for edges in self._edges.values() for edge in edges.values()}
        return frame in self._edges or frame in parents

    def moves_in(self, frame: str) -> str:
        """Return the parent of the first edge above a frame that is not static; "" without any."""
        edges = self._ancestors(frame).values()
        return next((edge.parent for edge in edges if edge and not edge.is_static), "")

    def lookup(self, target: str, source: str, stamp_ns: int, known_by_ns: int) -> Pose | None:
        """Return target_from_source at a stamp, None where the chain is not known there."""
        up, down = self._chains(target, source)
        identity = Pose(np.eye(3), np.zeros(3))
        from_source = _composed(identity, up, stamp_ns, known_by_ns)
        from_target = _composed(identity, down, stamp_ns, known_by_ns)
        if from_source is None or from_target is None:
            return None
        return from_target.inverse().after(from_source)

    def latest_ns(self, target: str, source: str, now_ns: int, known_by_ns: int) -> int | None:
        """Return the newest stamp, not after now, at which the chain was known."""
        up, down = self._chains(target, source)
        latest = now_ns
        for edge in (*up, *down):
            newest = None if edge is None else edge.newest_ns(known_by_ns)
            if newest is None:
                return None
            latest = min(latest, newest)
        return latest

    def lookup_held(
        self, target: str, fixed: str, source: str, stamp_ns: int, known_by_ns: int
    ) -> Pose | None:
        """Return the last target_from_fixed with fixed_from_source at the stamp."""
        held_ns = self.latest_ns(target, fixed, stamp_ns, known_by_ns)
        if held_ns is None:
            return None
        outer = self.lookup(target, fixed, held_ns, known_by_ns)
        inner = self.lookup(fixed, source, stamp_ns, known_by_ns)
        return None if outer is None or inner is None else outer.after(inner)

    def _chains(self, target: str, source: str) -> tuple[list[_Edge | None], list[_Edge | None]]:
        """Return the edges from source and from target up to where they meet; [None] if never."""
        ups, downs = self._ancestors(source), self._ancestors(target)
        meeting = next((frame for frame in ups if frame in downs), None)
        if meeting is None:
            return [None], [None]
        return _until(ups, meeting), _until(downs, meeting)

    def _ancestors(self, frame: str) -> dict[str, _Edge | None]:
        """Return the frames from this one to the root, each with the edge above it."""
        found: dict[str, _Edge | None] = {}
        while frame not in found:
            edges = self._edges.get(frame)
            found[frame] = None if edges is None else edges[max(edges)]
            if edges is None:
                break
            frame = edges[max(edges)].parent
        return found


def _until(chain: dict[str, _Edge | None], meeting: str) -> list[_Edge | None]:
    frames = list(chain)
    return [chain[frame] for frame in frames[: frames.index(meeting)]]


def _composed(
    pose: Pose, edges: list[_Edge | None], stamp_ns: int, known_by_ns: int
) -> Pose | None:
    for edge in edges:
        step = None if edge is None else edge.at(stamp_ns, known_by_ns)
        if step is None:
            return None
        pose = step.after(pose)
    return pose


def _turned(numbers: tuple[float, ...]) -> tuple[float, ...]:
    """Return the inverse of a pose's seven numbers."""
    x, y, z, i, j, k, w = numbers
    place = -(_pose((0.0, 0.0, 0.0, -i, -j, -k, w)).rotation @ (x, y, z))
    return (*place.tolist(), -i, -j, -k, w)


def _pose(numbers: tuple[float, ...]) -> Pose:
    return Pose(Rotation.from_quat(numbers[3:]).as_matrix(), np.array(numbers[:3]))


def _between(a: tuple[float, ...], b: tuple[float, ...], share: float) -> tuple[float, ...]:
    """Interpolate: translation linearly, rotation on the shorter arc."""
    first, second = np.array(a), np.array(b)
    turn = Slerp((0.0, 1.0), Rotation.from_quat((a[3:], b[3:])))(share).as_quat()
    place = first[:3] + share * (second[:3] - first[:3])
    return tuple(np.concatenate((place, turn)).tolist())
