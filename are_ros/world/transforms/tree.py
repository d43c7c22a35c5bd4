"""The tree of frames over time, in place of tf2 (section 3.1, Frames)."""

from dataclasses import dataclass
from typing import Final, NoReturn

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.errors import (
    DisconnectedFramesError,
    ExtrapolationToFutureError,
    ExtrapolationToPastError,
    FrameError,
)
from are_ros.world.rigid_transform import RigidTransform, Values
from are_ros.world.transforms.lookup import (
    FUTURE,
    LOOP,
    NO_LIMIT,
    PAST,
    STATUSES,
    latest_not_after,
    look_up,
)
from are_ros.world.transforms.sources import Claim, Notices, Precedence, checked_pose
from are_ros.world.transforms.table import Edge, EdgeTable, FrameNames, TransformSource

__all__ = ["STATIC", "FrameEdge", "FrameTree", "TransformSource"]


@dataclass(frozen=True)
class FrameEdge:
    """An edge as `are inspect` shows it; a static one has stamps 0 and a count of 1.

    `parent` is that of the newest sample; stamps are those of the first and last sample kept [ns].
    """

    parent: str
    child: str
    source: TransformSource
    is_static: bool
    first_ns: int
    last_ns: int
    count: int


def in_seconds(stamp_ns: int) -> str:
    """Return a stamp as text with all its digits."""
    return f"{stamp_ns // NS_PER_S}.{stamp_ns % NS_PER_S:09d} s"


Floats = npt.NDArray[np.float64]

STATIC: Final = NO_LIMIT
"""The latest common time of a chain of static edges: the largest int64, valid as a stamp there."""


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
    `Precedence`; each case is said once through `drain_notices`. A transform that is refused
    raises InvalidTransformError and leaves the tree as it was. Not safe for use by several threads.
    """

    def __init__(self, history_ns: int = 10 * NS_PER_S) -> None:
        self._history_ns = history_ns
        self._notices = Notices()
        self.clear()

    def clear(self) -> None:
        """Forget all frames and transforms, the static ones too."""
        self._said_overruled: set[tuple[int, TransformSource]] = set()
        self._table = EdgeTable(self._history_ns)
        self._names = FrameNames()
        self._numbers = self._names.numbers
        self._precedence = Precedence(self._table, self._names, self._notices)

    def forget_after(self, now_ns: int) -> None:
        """Forget the samples stamped after `now_ns` (the clock jumped back to there).

        Static transforms stay, names too; an edge that is left without samples is gone.
        """
        self._table.forget_after(now_ns)

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
        now_ns: int | None = None,
    ) -> None:
        """Take parent_from_child at a stamp: translation (3,) [m], quaternion (4,) x y z w.

        With a clock, where samples of the frame are stamped more than the history ahead of
        `now_ns`, all that are later than it give way to one that is not: tf2 would drop all others
        until the clock is there.

        The quaternion is normalised; InvalidTransformError if its squared norm is further than 0.01
        from 1, a number is not finite, a coordinate exceeds 1e7 m, a name is empty or both names
        are the same.
        """
        pose = checked_pose(parent, child, translation_m, rotation_xyzw)
        numbers, table = self._numbers, self._table
        above, below = numbers.get(parent), numbers.get(child)
        if above is not None and below is not None:
            edge = table.edges.get(below)
            if edge is not None and edge.parent == above:
                if edge.source == source and not edge.is_static and stamp_ns >= edge.newest_ns:
                    if stamp_ns > edge.newest_ns:  # else the first sample stays
                        table.append(edge, above, stamp_ns, pose)
                    return
                if edge.source > source and (below, source) in self._said_overruled:
                    return
                if edge.source > source:
                    self._said_overruled.add((below, source))
        above, below = self._number_pair(parent, child)
        self._receive(Claim(above, below, stamp_ns, pose, source, is_static=False), now_ns)

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
        above, below = self._number_pair(parent, child)
        claim = Claim(above, below, 0, pose, source, is_static=True)
        admitted = self._precedence.admit(claim)
        if admitted is not None:
            self._table.hold(self._edge_for(admitted), admitted.parent, admitted.pose)

    def lookup(self, target: str, source: str, stamp_ns: int) -> RigidTransform:
        """Return target_from_source at the stamp: it takes points of `source` into `target`.

        UnknownFrameError, DisconnectedFramesError, ExtrapolationToPastError or
        ExtrapolationToFutureError, as tf2 would fail. Equal frames give the identity, at any time,
        if the frame is known (tf2 asks no such thing: the one departure).
        """
        values = np.empty(7)
        self.lookup_into(target, source, stamp_ns, values)
        return RigidTransform.adopt(values)

    def try_lookup(self, target: str, source: str, stamp_ns: int) -> RigidTransform | None:
        """Return what `lookup` does, or None where it would raise, for callers that can wait."""
        numbers = self._numbers
        to, of = numbers.get(target.lstrip("/")), numbers.get(source.lstrip("/"))
        if to is None or of is None:
            return None
        values = np.empty(7)
        status = look_up(self._table.samples, self._table.frames, to, of, stamp_ns, values)
        return None if status else RigidTransform.adopt(values)

    def lookup_into(self, target: str, source: str, stamp_ns: int, out: Floats) -> None:
        """Write what `lookup` returns into `out`, float64 (7,), C order: x y z, then x y z w.

        The quickest form, for callers that keep an array; `out` is as before where it raises.
        """
        table, numbers = self._table, self._numbers
        try:
            to, of = numbers[target], numbers[source]
        except KeyError:
            to, of = self._names.number(target), self._names.number(source)
        status = look_up(table.samples, table.frames, to, of, stamp_ns, out)
        if status:
            self._fail(status, target, source, stamp_ns)

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
        to, of = self._names.number(target), self._names.number(source)
        table = self._table
        status, stamp_ns = latest_not_after(table.samples, table.frames, to, of, now_ns)
        if status:
            name = self.ending_at(target, source, stamp_ns)
            self._fail(status, target, source, stamp_ns, f"{name} ends there, and " * bool(name))
        return int(stamp_ns)

    def ending_at(self, target: str, source: str, stamp_ns: int) -> str:
        """Return "a -> b", an edge above two known frames that has no newer sample; else ""."""
        edges = self._table.edges
        for frame in (target, source):
            above, passed = self._names.number(frame), set[int]()
            while above in edges and above not in passed:
                passed.add(above)
                edge = edges[above]
                if not edge.is_static and edge.newest_ns == stamp_ns:
                    return self._name_of(edge)
                above = edge.parent
        return ""

    def moves_in(self, frame: str) -> str:
        """Return the parent of the first edge above a frame that is not static; "" without any."""
        below, passed = self._numbers.get(frame.lstrip("/"), -1), set[int]()
        while (edge := self._table.edges.get(below)) is not None and below not in passed:
            if not edge.is_static:
                return self._names[edge.parent]
            passed.add(below)
            below = edge.parent
        return ""

    def _name_of(self, edge: Edge) -> str:
        return f"{self._names[edge.parent]} -> {self._names[edge.child]}"

    def has_frame(self, name: str) -> bool:
        """Tell whether a transform ever named this frame, as parent or as child."""
        return name in self._names

    def edges(self) -> list[FrameEdge]:
        """Return the edges that hold now, sorted by parent and child."""
        names, stamp_of = self._names, self._table.stamp_of
        listed = [
            FrameEdge(
                names[edge.parent],
                names[edge.child],
                edge.source,
                edge.is_static,
                stamp_of(edge.first),
                stamp_of(edge.end - 1),
                edge.end - edge.first,
            )
            for edge in self._table.edges.values()
        ]
        return sorted(listed, key=lambda edge: (edge.parent, edge.child))

    def _receive(self, claim: Claim, now_ns: int | None) -> None:
        """Store a stamped claim that is new in some way: edge, parent, source or order."""
        admitted = self._precedence.admit(claim)
        if admitted is None:
            return
        edge, stamp_ns = self._edge_for(admitted), admitted.stamp_ns
        if now_ns is not None and stamp_ns <= now_ns < edge.newest_ns - self._history_ns:
            self._table.forget_after(now_ns, [edge])
            edge = self._edge_for(admitted)
            self._notices.say(
                f"transforms of {self._names[edge.child]} stamped more than"
                f" {self._history_ns / NS_PER_S:g} s ahead of the clock are forgotten"
            )
        if edge.end == edge.first or stamp_ns > edge.newest_ns:
            self._table.append(edge, admitted.parent, stamp_ns, admitted.pose)
        elif not self._table.insert(edge, admitted.parent, stamp_ns, admitted.pose):
            self._notices.say(
                f"transforms of {self._names[edge.child]} older than the history of "
                f"{self._history_ns / NS_PER_S:g} s are dropped"
            )

    def _edge_for(self, claim: Claim) -> Edge:
        """Return the edge to write to; a fresh one where source or kind is another."""
        edge = self._table.edges.get(claim.child)
        if edge is None or (edge.source, edge.is_static) != (claim.source, claim.is_static):
            edge = self._table.open(
                claim.child, claim.parent, claim.source, is_static=claim.is_static
            )
        return edge

    def _number_pair(self, parent: str, child: str) -> tuple[int, int]:
        numbers = self._names.number_or_add(parent), self._names.number_or_add(child)
        self._table.reserve_frame(max(numbers))
        return numbers

    def _fail(
        self, status: int, target: str, source: str, stamp_ns: int, before: str = ""
    ) -> NoReturn:
        """Raise the error of a kernel's status; `before` says what precedes a late beginning."""
        when = "the latest time" if stamp_ns == STATIC else in_seconds(stamp_ns)
        asked = f"{target} from {source} at {when}"
        frame, reason = divmod(status, STATUSES)
        if reason == LOOP:
            raise DisconnectedFramesError(f"{asked}: the transforms at that time close a loop")
        if reason not in {PAST, FUTURE}:
            raise DisconnectedFramesError(f"{asked}: no chain of transforms joins these frames")
        edge = self._table.edges[frame]
        name = self._name_of(edge)
        if reason == FUTURE:
            end = in_seconds(edge.newest_ns)
            raise ExtrapolationToFutureError(f"{asked}: {name} ends at {end}")
        begin = in_seconds(self._table.stamp_of(edge.first))
        raise ExtrapolationToPastError(f"{asked}: {before}{name} begins at {begin}")
