"""Collisions (section 3.3): no two artefacts overlap, and none overlaps a wall.

An artefact whose new pose is not safe goes back to its last safe pose; if that is not safe any
more, it is displaced to the nearest safe place, or it leaves. What a contact with the robot means
is a `ContactPolicy`; `ContactLog` reports the contacts that begin.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from are_ros._compiled import compiled
from are_ros.agents.events import ArtefactEvent, EventKind
from are_ros.population.artefact import Artefact
from are_ros.world.boxes import (
    TOUCH_TOLERANCE_M,
    OrientedBoxes,
    any_overlap,
    bounds,
    boxes_overlap,
    candidate_pairs,
    overlaps_any,
)
from are_ros.world.environment import Environment
from are_ros.world.footprint import Footprint, penetration_m


@dataclass(frozen=True)
class RobotContact:
    """The robot overlaps an artefact, by this penetration depth."""

    artefact_id: int
    penetration_m: float


def depths_m(robot: Footprint | None, boxes: OrientedBoxes) -> NDArray[np.float64]:
    """Return the penetration depths (N,) of the robot into N boxes, 0 where apart."""
    return np.zeros(len(boxes)) if robot is None else penetration_m(robot, boxes)


def contacts_of(ids: NDArray[np.int64], depths: NDArray[np.float64]) -> tuple[RobotContact, ...]:
    """Return the contacts among depths (N,) into the N artefacts `ids`, in their order.

    Touching is no contact.
    """
    deep = np.flatnonzero(depths > TOUCH_TOLERANCE_M)
    return tuple(RobotContact(int(ids[i]), float(depths[i])) for i in deep)


class ContactPolicy:
    """What happens to an artefact that the robot has moved into; here nothing is tolerated."""

    def tolerated_m(self, depths: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the depths (N,) up to which overlaps are tolerated, given the present ones."""
        return np.zeros_like(depths)

    def leaves(self, in_contact: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which artefacts (N,) leave, given which are in contact."""
        return np.zeros_like(in_contact)


class Hold(ContactPolicy):
    """The artefact stays. It may back out, but an overlap that is there never gets deeper."""

    def tolerated_m(self, depths: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the present depths."""
        return depths


class Displace(ContactPolicy):
    """The artefact makes way: its last pose is no longer safe, so the remedies apply."""


class Remove(ContactPolicy):
    """The artefact leaves at once."""

    def leaves(self, in_contact: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return the artefacts in contact."""
        return in_contact


class ContactLog:
    """Keeps the artefacts in contact with the robot, and counts the contacts that begin."""

    def __init__(self, observer: str) -> None:
        """Take the robot's name, which the events give as their detail."""
        self.count = 0
        self._observer = observer
        self._touching: set[int] = set()

    def begun(
        self, now_ns: int, contacts: Sequence[RobotContact], living: Mapping[int, Artefact]
    ) -> list[ArtefactEvent]:
        """Return an event for each contact that was not there last time; its value is the depth.

        `living` has the artefacts in contact by their ids.
        """
        new = [contact for contact in contacts if contact.artefact_id not in self._touching]
        self._touching = {contact.artefact_id for contact in contacts}
        self.count += len(new)
        return [self._event(now_ns, contact, living) for contact in new]

    def forget(self) -> None:
        """Forget who is in contact: the clock jumped, or a recording has a gap."""
        self._touching = set()

    def _event(
        self, now_ns: int, contact: RobotContact, living: Mapping[int, Artefact]
    ) -> ArtefactEvent:
        artefact_id, depth_m = contact.artefact_id, contact.penetration_m
        label = living[artefact_id].row.label
        kind = EventKind.ROBOT_CONTACT
        return ArtefactEvent(now_ns, kind, artefact_id, label, self._observer, depth_m)


_FloatArray = NDArray[np.float64]
_IndexArray = NDArray[np.int64]
_Mask = NDArray[np.bool_]

_KEPT = 0
_MOVED_BACK = 1


def _neighbours(proposed: _FloatArray, safe: _FloatArray) -> tuple[_IndexArray, _IndexArray]:
    """Return for each box the others that it may overlap at either of its poses.

    The result is compressed: those of box i are `indices[starts[i]:starts[i + 1]]`; `starts` is
    (N + 1,). `proposed` and `safe` (N, 8) are packed boxes.
    """
    rectangles, others = bounds(proposed), bounds(safe)
    rectangles[:, :2] = np.minimum(rectangles[:, :2], others[:, :2])
    rectangles[:, 2:] = np.maximum(rectangles[:, 2:], others[:, 2:])
    first, second = candidate_pairs(rectangles).T
    boxes, neighbours = np.concatenate((first, second)), np.concatenate((second, first))
    order = np.argsort(boxes, kind="stable")
    starts = np.searchsorted(boxes[order], np.arange(len(rectangles) + 1))
    return starts, neighbours[order]


@compiled
def _keep_or_move_back(
    start: int,
    proposed: _FloatArray,
    safe: _FloatArray,
    allowed: _Mask,
    current: _FloatArray,
    present: _Mask,
    is_fixed: _Mask,
    adjacency: tuple[_IndexArray, _IndexArray],
    displaced: _IndexArray,
    outcomes: NDArray[np.int8],
    tolerance_m: float,
) -> int:
    """Give each box from `start` on its proposed or last safe pose; return the first with neither.

    Boxes are packed (N, 8). `allowed` (N, 2) tells whether the proposed and the last safe pose are
    clear of walls and robot, `adjacency` is the result of `_neighbours`. Boxes that are `is_fixed`
    (N,) are skipped, and stay as they are in `current`. All boxes are tested against the
    `displaced`, which are outside their neighbourhoods. The kernel writes into `current` (N, 8) and
    `outcomes` (N,). It returns N at the end.
    """
    starts, indices = adjacency
    for i in range(start, proposed.shape[0]):
        if is_fixed[i] or not present[i]:
            continue
        near = indices[starts[i] : starts[i + 1]]
        resolved = False
        for choice in range(2):
            pose = proposed if choice == 0 else safe
            is_clear = allowed[i, choice]
            for candidates in (near, displaced):
                for j in candidates:
                    if is_clear and j != i and present[j]:
                        is_clear = not boxes_overlap(pose, i, current, j, tolerance_m)
            if is_clear:
                for column in range(current.shape[1]):
                    current[i, column] = pose[i, column]
                outcomes[i] = _KEPT if choice == 0 else _MOVED_BACK
                resolved = True
                break
        if not resolved:
            return i
    return int(proposed.shape[0])


_STEP_M = 0.1
_ANGLES = 32
_RINGS_AT_ONCE = 4


class RingSearch:
    """Finds the nearest safe place on rings 0.1 m apart, at 32 angles each, within `radius_m`.

    The order is fixed: from the inner ring outwards, on a ring counter-clockwise from the map's +x.
    The heading is kept. Places at least `robot_clearance_m` away from where the robot is about to
    be come first, so that an artefact that makes way for it is not in its way again at once.
    """

    def __init__(self, radius_m: float, robot_clearance_m: float = 0.0) -> None:
        """Compute the offsets; there are none for a radius below 0.1 m."""
        self.radius_m = radius_m
        self._robot_clearance_m = robot_clearance_m
        rings = int(radius_m / _STEP_M + 1e-9)
        radii_m = _STEP_M * np.repeat(np.arange(1, rings + 1), _ANGLES)
        angles_rad = np.tile(np.arange(_ANGLES) * (2.0 * np.pi / _ANGLES), rings)
        offsets_m = radii_m[:, None] * np.column_stack((np.cos(angles_rad), np.sin(angles_rad)))
        chunk = _ANGLES * _RINGS_AT_ONCE
        self._chunks = [offsets_m[i : i + chunk] for i in range(0, len(offsets_m), chunk)]

    def nearest(
        self,
        box: OrientedBoxes,
        others: OrientedBoxes,
        robot: Footprint | None,
        environment: Environment,
        ahead: Footprint | None = None,
    ) -> tuple[NDArray[np.float64], OrientedBoxes] | None:
        """Return the offset (2,) in metres and the box there, on the ground; None if none is safe.

        `box` is of length one. A place is safe if the box covers free cells only, hits no wall, and
        overlaps neither the others nor the robot. `ahead` is the area that the robot will cover.
        """
        areas = [area for area in (robot, ahead) if area is not None]
        padded = [area.padded(self._robot_clearance_m) for area in areas]
        found = self._nearest(box, others, padded, environment)
        if found is None and robot is not None:
            found = self._nearest(box, others, [robot], environment)
        return found

    def _nearest(
        self,
        box: OrientedBoxes,
        others: OrientedBoxes,
        areas: Sequence[Footprint],
        environment: Environment,
    ) -> tuple[NDArray[np.float64], OrientedBoxes] | None:
        for offsets_m in self._chunks:
            candidates = _standing_at(box, offsets_m, environment)
            placeable = np.flatnonzero(environment.is_placeable(candidates))
            safe = placeable[~_is_taken(candidates.take(placeable), others, areas)]
            if len(safe):
                return offsets_m[safe[0]], candidates.at(safe[0])
        return None


def _standing_at(
    box: OrientedBoxes, offsets_m: NDArray[np.float64], environment: Environment
) -> OrientedBoxes:
    """Return the box moved by each of the offsets (M, 2), standing on the ground there."""
    count = len(offsets_m)
    centres_m = np.repeat(box.centres_m, count, axis=0)
    centres_m[:, :2] += offsets_m
    yaws_rad = np.repeat(box.yaws_rad, count)
    half_sizes_m = np.repeat(box.half_sizes_m, count, axis=0)
    heights_m = environment.ground_heights_m(OrientedBoxes(centres_m, yaws_rad, half_sizes_m))
    centres_m = np.column_stack((centres_m[:, :2], heights_m + half_sizes_m[:, 2]))
    return OrientedBoxes(centres_m, yaws_rad, half_sizes_m)


def _is_taken(
    boxes: OrientedBoxes, others: OrientedBoxes, areas: Sequence[Footprint]
) -> NDArray[np.bool_]:
    """Tell which boxes overlap any other box or any of the areas."""
    taken = overlaps_any(boxes, others)
    for area in areas:
        taken |= penetration_m(area, boxes) > TOUCH_TOLERANCE_M
    return taken


class Outcome(IntEnum):
    """What the resolver decided for one artefact."""

    KEPT = _KEPT
    MOVED_BACK = _MOVED_BACK
    DISPLACED_TO_SAFE = 2
    LEAVES = 3
    LEAVES_ON_CONTACT = 4


@dataclass(frozen=True, eq=False)
class Resolution:
    """The poses of N artefacts at the end of a sub-step.

    `outcomes` int8 (N,) of `Outcome`: KEPT has the proposed pose, MOVED_BACK the last safe one,
    DISPLACED_TO_SAFE the last safe one moved by `shifts_m` float64 (N, 2; 0 for the others) in the
    map frame, with its heading, on the ground there; the others leave. `boxes` (N) are at these
    poses; the box of an artefact that leaves is at its last safe one. `contacts` are those at the
    last safe poses, of fixed artefacts at their proposed ones.
    """

    outcomes: NDArray[np.int8]
    shifts_m: NDArray[np.float64]
    boxes: OrientedBoxes
    contacts: tuple[RobotContact, ...]

    @property
    def is_all_kept(self) -> bool:
        """Whether every artefact has its proposed pose."""
        return not self.outcomes.any()


class CollisionResolver:
    """Decides which pose each artefact has at the end of a sub-step.

    If the proposed poses are safe all together, all artefacts have them. Else the resolver goes
    through the artefacts in the order of their ids. Each has its proposed pose if that is safe;
    else its last safe pose if that still is; else the nearest safe place within the search radius;
    else it leaves. Fixed artefacts, which follow tracks, have their proposed poses whatever is
    there, and the others make way.

    A pose is safe if its box hits no wall, overlaps no other artefact, and overlaps the robot no
    deeper than the policy tolerates. The other artefacts are at their new poses (lower ids, fixed
    ones) or at their last safe ones (higher ids). These do not overlap, and no decision lets them
    overlap. An overlap among the last safe poses is resolved like any other.
    """

    def __init__(
        self, policy: ContactPolicy, search_radius_m: float, robot_clearance_m: float = 0.0
    ) -> None:
        self._policy = policy
        self._search = RingSearch(search_radius_m, robot_clearance_m)

    def resolve(
        self,
        ids: NDArray[np.int64],
        proposed: OrientedBoxes,
        last_safe: OrientedBoxes,
        environment: Environment,
        robot: Footprint | None,
        ahead: Callable[[], Footprint | None] = lambda: None,
        fixed: Sequence[int] = (),
    ) -> Resolution:
        """Return the poses of artefacts `ids` (N,), strictly ascending; `fixed` index tracks.

        `proposed` and `last_safe` are the boxes (N) at the two poses, on the ground, in the map
        frame; `last_safe` is where each was at the end of the last sub-step, or where it was
        placed. `robot` is the footprint at its pose in the map frame, `ahead` gives the area that
        it is about to cover: an artefact is displaced there only if there is no other place.
        `ahead` is called only for a displacement.
        """
        depths = depths_m(robot, _with_rows(last_safe, proposed, fixed))
        contacts = contacts_of(ids, depths)
        limits_m = self._policy.tolerated_m(depths) + TOUCH_TOLERANCE_M
        present = ~self._policy.leaves(depths > TOUCH_TOLERANCE_M)
        allowed = _are_allowed(proposed, environment, robot, limits_m)
        if allowed.all() and present.all() and not any_overlap(proposed):
            count = len(ids)
            return Resolution(np.zeros(count, np.int8), np.zeros((count, 2)), proposed, contacts)
        allowed_back = _are_allowed(last_safe, environment, robot, limits_m)
        remedies = _Remedies(proposed, last_safe, present, fixed)
        remedies.apply(
            np.column_stack((allowed, allowed_back)),
            lambda box, others: self._search.nearest(box, others, robot, environment, ahead()),
            self._search.radius_m,
        )
        return Resolution(remedies.outcomes, remedies.shifts_m, remedies.boxes(), contacts)

    def held_back(
        self, proposed: OrientedBoxes, last_safe: OrientedBoxes, fixed: Sequence[int] = ()
    ) -> NDArray[np.bool_]:
        """Return which artefacts (N,) have to keep their poses, where they overlap no other.

        `proposed` are the boxes (N) at the next sub-step, `last_safe` the present ones. Of two that
        would overlap, the one with the higher id stays, but none of the `fixed` (indices); walls
        and the robot do not count. An overlap that staying would not prevent is left to `resolve`.
        """
        held = np.zeros(len(proposed), np.bool_)
        if any_overlap(proposed):
            remedies = _Remedies(proposed, last_safe, ~held, fixed)
            remedies.apply(np.ones((len(proposed), 2), np.bool_), lambda _, __: None, 0.0)
            held = remedies.outcomes == Outcome.MOVED_BACK
        return held


def _with_rows(boxes: OrientedBoxes, others: OrientedBoxes, rows: Sequence[int]) -> OrientedBoxes:
    """Return boxes (N) with those of some rows taken from others (N)."""
    if not rows:
        return boxes
    is_other = np.zeros(len(boxes), np.bool_)
    is_other[list(rows)] = True
    packed = np.where(is_other[:, None], others.packed, boxes.packed)
    yaws_rad = np.where(is_other, others.yaws_rad, boxes.yaws_rad)
    return OrientedBoxes(packed[:, :3], yaws_rad, packed[:, 5:])


def _are_allowed(
    boxes: OrientedBoxes,
    environment: Environment,
    robot: Footprint | None,
    limits_m: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Tell which boxes (N) hit no wall, nor the robot deeper than their limits (N,)."""
    return ~environment.hits_wall(boxes) & (depths_m(robot, boxes) <= limits_m)


_Search = Callable[[OrientedBoxes, OrientedBoxes], tuple[NDArray[np.float64], OrientedBoxes] | None]
"""(box, other boxes) -> the offset (2,) [m] to a safe place and the box there, or None."""


class _Remedies:
    """The remedies for N artefacts; `present` (N,) tells which have not left for a contact.

    `fixed` are the indices of those that are at their proposed poses from the start.
    """

    def __init__(
        self,
        proposed: OrientedBoxes,
        last_safe: OrientedBoxes,
        present: NDArray[np.bool_],
        fixed: Sequence[int],
    ) -> None:
        self.outcomes = np.where(present, Outcome.KEPT, Outcome.LEAVES_ON_CONTACT).astype(np.int8)
        self.shifts_m = np.zeros((len(proposed), 2))
        self._proposed = proposed
        self._safe = last_safe
        self._present = present
        self._is_fixed = np.zeros(len(proposed), np.bool_)
        self._is_fixed[list(fixed)] = True
        self._current = np.where(self._is_fixed[:, None], proposed.packed, last_safe.packed)

    def apply(self, allowed: NDArray[np.bool_], search: _Search, radius_m: float) -> None:
        """Keep, move back or displace all artefacts in the order of their ids.

        `allowed` (N, 2) tells whether walls and robot allow the proposed and the last safe pose;
        `search` looks no farther than `radius_m`.
        """
        adjacency = _neighbours(self._proposed.packed, self._safe.packed)
        displaced, i = np.empty(0, np.int64), -1
        while True:
            i = _keep_or_move_back(
                i + 1,
                self._proposed.packed,
                self._safe.packed,
                allowed,
                self._current,
                self._present,
                self._is_fixed,
                adjacency,
                displaced,
                self.outcomes,
                TOUCH_TOLERANCE_M,
            )
            if i == len(self.outcomes):
                return
            if self._displace(i, search, radius_m):
                displaced = np.append(displaced, i)

    def boxes(self) -> OrientedBoxes:
        """Return the boxes (N) at the poses decided."""
        kept = self.outcomes == Outcome.KEPT
        yaws_rad = np.where(kept, self._proposed.yaws_rad, self._safe.yaws_rad)
        return OrientedBoxes(self._current[:, :3], yaws_rad, self._safe.half_sizes_m)

    def _displace(self, i: int, search: _Search, radius_m: float) -> bool:
        """Move artefact i to the nearest safe place, or let it leave; return whether it stays."""
        found = search(self._safe.at(i), self._others_near(i, radius_m))
        self._present[i] = found is not None
        self.outcomes[i] = Outcome.LEAVES if found is None else Outcome.DISPLACED_TO_SAFE
        if found is not None:
            self.shifts_m[i] = found[0]
            self._current[i] = found[1].packed[0]
        return found is not None

    def _others_near(self, i: int, radius_m: float) -> OrientedBoxes:
        """Return the other boxes, at their current poses, that a search about box i may meet."""
        reaches_m = self._current[:, 5] + self._current[:, 6]
        offsets_m = np.abs(self._current[:, :2] - self._current[i, :2])
        near = self._present & (offsets_m.max(axis=1) < radius_m + reaches_m + reaches_m[i])
        near[i] = False
        yaws_rad = np.arctan2(self._current[near, 4], self._current[near, 3])
        return OrientedBoxes(self._current[near, :3], yaws_rad, self._current[near, 5:])
