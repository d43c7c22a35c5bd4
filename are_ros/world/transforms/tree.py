"""The tree of frames over time, in place of tf2 (section 3.1, Frames)."""

import math
from typing import Final, NamedTuple, NoReturn

import numpy as np

from are_ros.conventions import NS_PER_S
from are_ros.errors import (
    DisconnectedFramesError,
    ExtrapolationToFutureError,
    ExtrapolationToPastError,
    FrameError,
    UnknownFrameError,
)
from are_ros.world.rigid_transform import Pose, RigidTransform, Values, composed, inverted
from are_ros.world.transforms.edges import Edge, TransformSource
from are_ros.world.transforms.sources import Claim, Notices, Precedence, checked_pose

__all__ = ["STATIC", "FrameTree", "TransformSource"]

STATIC: Final = 2**63 - 1
"""The latest common time of a chain of static edges: the largest int64, valid as a stamp there."""

_UNMOVED: Final[Pose] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def in_seconds(stamp_ns: int) -> str:
    """Return a stamp as text with all its digits."""
    return f"{stamp_ns // NS_PER_S}.{stamp_ns % NS_PER_S:09d} s"


class _Climb(NamedTuple):
    """The way up from a frame at a stamp: the frames passed, the end included, and the edges.

    Each edge comes with its sample in force. `beyond` is the edge that has none at that stamp and
    ends the way, None at a root.
    """

    frames: list[str]
    steps: list[tuple[Edge, int]]
    beyond: Edge | None


class FrameTree:
    """Time-stamped transforms between named frames; answers as tf2's BufferCore does.

    Between two samples of an edge translation is linear and rotation slerp by the shorter arc; at
    a sample's stamp it is the sample; outside the first and last stamp nothing is extrapolated.
    Every sample keeps its own parent, and where two neighbours differ the older one holds.
    A single sample holds at its stamp only; a static transform at all times. Samples may come out
    of order; more than `history_ns` before a frame's newest sample they are dropped. At a stamp
    that is taken the first sample stays, unless the newcomer names another parent. A static
    transform and a stamped one of a frame, from one source, replace each other (as in Jazzy).

    Names lose leading slashes. Stamps are int nanoseconds; 0 is a stamp like any other, not tf2's
    "latest". Several sources for one edge, pairs given in both directions and loops are resolved by
    `_precedence`; each case is said once through `drain_notices`. A transform that is refused
    raises InvalidTransformError and leaves the tree as it was. Not safe for use by several threads.
    `changes` grows whenever an answer may have become another one.
    """

    def __init__(self, history_ns: int = 10 * NS_PER_S) -> None:
        self._history_ns = history_ns
        self._notices = Notices()
        self.changes = 0
        self.clear()

    def clear(self) -> None:
        """Forget all frames and transforms, the static ones too."""
        self.changes += 1
        self._edges: dict[str, Edge] = {}
        self._names: set[str] = set()
        self._precedence = Precedence(self._edges, self._notices)

    def forget_after(self, now_ns: int) -> None:
        """Forget the samples stamped after `now_ns` (the clock jumped back to there).

        Static transforms stay, names too; an edge that is left without samples is gone.
        """
        self.changes += 1
        for edge in [edge for edge in self._edges.values() if not edge.is_static]:
            edge.forget_after(now_ns)
            if not edge.stamps_ns:
                del self._edges[edge.child]

    def drain_notices(self) -> list[str]:
        """Return what was overruled, turned round, re-parented or dropped since the last call.

        Each sentence comes once in the life of the tree.
        """
        return self._notices.drain()

    def set_transform(
        self,
        parent: str,
        child: str,
        stamp_ns: int,
        translation_m: Values,
        rotation_xyzw: Values,
        *,
        source: TransformSource = TransformSource.TF,
    ) -> None:
        """Take parent_from_child at a stamp: translation (3,) [m], quaternion (4,) x y z w.

        The quaternion is normalised; InvalidTransformError if its squared norm is further than 0.01
        from 1, a number is not finite, a coordinate exceeds 1e7 m, a name is empty or both names
        are the same.
        """
        pose = checked_pose(parent, child, translation_m, rotation_xyzw)
        claim = self._admitted(parent, child, stamp_ns, pose, source, is_static=False)
        if claim is None:
            return
        edge = self._edges.get(claim.child)
        if edge is None or edge.is_static or edge.source != source:
            self._open(claim)
        elif stamp_ns > edge.newest_ns:
            edge.append(claim.parent, stamp_ns, claim.pose, self._history_ns)
        elif stamp_ns >= edge.newest_ns - self._history_ns:
            edge.insert(claim.parent, stamp_ns, claim.pose)
        else:
            self._notices.say(
                f"transforms of {claim.child} older than the history of "
                f"{self._history_ns / NS_PER_S:g} s are dropped"
            )

    def set_static(
        self,
        parent: str,
        child: str,
        translation_m: Values,
        rotation_xyzw: Values,
        *,
        source: TransformSource = TransformSource.TF,
    ) -> None:
        """Take parent_from_child for all times; arguments and errors as in `set_transform`."""
        pose = checked_pose(parent, child, translation_m, rotation_xyzw)
        claim = self._admitted(parent, child, 0, pose, source, is_static=True)
        if claim is not None:
            self._open(claim)

    def lookup(self, target: str, source: str, stamp_ns: int) -> RigidTransform:
        """Return target_from_source at the stamp: it takes points of `source` into `target`.

        UnknownFrameError, DisconnectedFramesError, ExtrapolationToPastError or
        ExtrapolationToFutureError, as tf2 would fail. Equal frames give the identity, at any time,
        if the frame is known (tf2 asks no such thing: the one departure).
        """
        down, up = self._chain(target, source, stamp_ns)
        pose = _along(up, stamp_ns)
        if down:
            pose = composed(inverted(_along(down, stamp_ns)), pose)
        x, y, z, i, j, k, w = pose
        scale = 1.0 / math.sqrt(i * i + j * j + k * k + w * w)
        return RigidTransform(np.array((x, y, z)), scale * np.array((i, j, k, w)))

    def try_lookup(self, target: str, source: str, stamp_ns: int) -> RigidTransform | None:
        """Return what `lookup` does, or None where it would raise, for callers that can wait."""
        try:
            return self.lookup(target, source, stamp_ns)
        except FrameError:
            return None

    def lookup_held(self, target: str, fixed: str, source: str, stamp_ns: int) -> RigidTransform:
        """Return target_from_source by way of `fixed`: the first part held, the second exact.

        target_from_fixed is taken at its latest not after the stamp (a slow correction, map->odom),
        fixed_from_source interpolated at the stamp itself (odometry). Errors as in `lookup`.
        """
        held_ns = self.latest_before(target, fixed, stamp_ns)
        target_from_fixed = self.lookup(target, fixed, held_ns)
        try:
            return target_from_fixed @ self.lookup(fixed, source, stamp_ns)
        except FrameError:
            # In tf2's order an edge above `fixed` would be named, which is held: look from below.
            self.lookup(source, fixed, stamp_ns)
            raise

    def lookup_latest(self, target: str, source: str) -> RigidTransform:
        """Return target_from_source at the newest stamp at which the whole chain is known.

        Equal frames give the identity, known or not. Errors as in `latest_before`.
        """
        if target == source:
            return RigidTransform.identity()
        return self.lookup(target, source, self.latest_common_time(target, source))

    def latest_common_time(self, target: str, source: str) -> int:
        """Return the newest stamp [ns] at which the whole chain is known; `STATIC` if all static.

        It is the least of the newest stamps of the chain's edges. Errors as in `latest_before`.
        """
        return self.latest_before(target, source, STATIC)

    def latest_before(self, target: str, source: str, now_ns: int) -> int:
        """Return the latest stamp t <= `now_ns` [ns] at which every edge of the chain is known.

        A dynamic edge with a sample at or after `now_ns` allows `now_ns` itself, else its newest
        stamp; t is the least over the edges; a static chain (or equal frames) gives `now_ns`. Where
        frames change parents the chain is that in force at t. `lookup` at t succeeds.
        UnknownFrameError; DisconnectedFramesError; ExtrapolationToPastError where some edge begins
        after t.
        """
        limit_ns = now_ns
        while True:
            down, up = self._chain(target, source, limit_ns, holds=True)
            newest_ns = [edge.newest_ns for edge, _ in (*up, *down) if not edge.is_static]
            lowered_ns = min(newest_ns, default=limit_ns)
            if lowered_ns >= limit_ns:
                return limit_ns
            limit_ns = lowered_ns

    def has_frame(self, name: str) -> bool:
        """Tell whether a transform ever named this frame, as parent or as child."""
        return name.lstrip("/") in self._names

    def edges(self) -> list[Edge]:
        """Return the edges that hold now, sorted by parent and child; nobody writes to them."""
        return sorted(self._edges.values(), key=lambda edge: (edge.parent, edge.child))

    def _admitted(
        self,
        parent: str,
        child: str,
        stamp_ns: int,
        pose: Pose,
        source: TransformSource,
        *,
        is_static: bool,
    ) -> Claim | None:
        """Return what is to be stored of a transform, None where it is ignored."""
        self.changes += 1
        above, below = parent.lstrip("/"), child.lstrip("/")
        self._names |= {above, below}
        return self._precedence.admit(Claim(above, below, stamp_ns, pose, source, is_static))

    def _open(self, claim: Claim) -> None:
        """Make a new edge of a claim, in place of the child's old one."""
        stamps_ns, parents, poses = [claim.stamp_ns], [claim.parent], [claim.pose]
        self._edges[claim.child] = Edge(
            claim.child, claim.source, claim.is_static, stamps_ns, parents, poses
        )

    def _chain(
        self, target: str, source: str, stamp_ns: int, *, holds: bool = False
    ) -> tuple[list[tuple[Edge, int]], list[tuple[Edge, int]]]:
        """Return the edges up from target and from source, to the first frame that both have.

        With `holds` the newest sample of an edge stands for what comes after it. Where the ways do
        not meet, the target's failure is raised first, as in tf2.
        """
        down = self._climbed(self._known(target), stamp_ns, holds=holds)
        up = self._climbed(self._known(source), stamp_ns, holds=holds)
        if down and up:
            for j, frame in enumerate(down.frames):
                if frame in up.frames:
                    return down.steps[:j], up.steps[: up.frames.index(frame)]
        when = "the latest time" if stamp_ns == STATIC else in_seconds(stamp_ns)
        asked = f"{target} from {source} at {when}"
        if not (down and up):
            raise DisconnectedFramesError(f"{asked}: the transforms at that time close a loop")
        if edge := down.beyond or up.beyond:
            _refuse_extrapolation(asked, edge, stamp_ns)
        raise DisconnectedFramesError(f"{asked}: no chain of transforms joins these frames")

    def _climbed(self, frame: str, stamp_ns: int, *, holds: bool) -> _Climb | None:
        """Follow the parents at the stamp up from a frame; None where they close a loop."""
        frames, steps = [frame], list[tuple[Edge, int]]()
        while (edge := self._edges.get(frame)) is not None:
            row = edge.row_at(stamp_ns)
            is_after = not edge.is_static and stamp_ns > edge.newest_ns
            if row < 0 or (is_after and not holds):
                return _Climb(frames, steps, edge)
            frame = edge.parents[row]
            if frame in frames:
                return None
            frames.append(frame)
            steps.append((edge, row))
        return _Climb(frames, steps, None)

    def _known(self, name: str) -> str:
        """Return a frame's name without leading slashes, or raise UnknownFrameError."""
        plain = name.lstrip("/")
        if plain not in self._names:
            known = ", ".join(sorted(self._names)) or "none"
            raise UnknownFrameError(f"frame {name!r} was never seen; known frames: {known}")
        return plain


def _along(steps: list[tuple[Edge, int]], stamp_ns: int) -> Pose:
    """Return the composed pose of edges: top_from_start."""
    pose = _UNMOVED
    for edge, row in steps:
        pose = composed(edge.pose_at(row, stamp_ns), pose)
    return pose


def _refuse_extrapolation(asked: str, edge: Edge, stamp_ns: int) -> NoReturn:
    name = f"{edge.parent} -> {edge.child}"
    if stamp_ns > edge.newest_ns:
        end = in_seconds(edge.newest_ns)
        raise ExtrapolationToFutureError(f"{asked}: {name} ends at {end}")
    begin = in_seconds(edge.stamps_ns[0])
    raise ExtrapolationToPastError(f"{asked}: {name} begins at {begin}")
