"""Collisions (section 3.3): the paper's two remedies, so that no two artefacts ever overlap.

The policies of robot contacts, and the log of contacts, stand here too (section 3.3).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Protocol

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
    """Robot number `observer` overlaps an artefact, by this penetration depth."""

    observer: int
    artefact_id: int
    penetration_m: float


def depths_m(robots: Sequence[Footprint], boxes: OrientedBoxes) -> NDArray[np.float64]:
    """Return the penetration depths (N, R) of R robots into N boxes, 0 where apart."""
    if not robots:
        return np.zeros((len(boxes), 0))
    return np.column_stack([penetration_m(robot, boxes) for robot in robots])


def contacts_of(ids: NDArray[np.int64], depths: NDArray[np.float64]) -> tuple[RobotContact, ...]:
    """Return the contacts among depths (N, R) of R robots into the N artefacts `ids`.

    The order is that of the artefacts, then of the robots. Touching is no contact.
    """
    if not depths.any():
        return ()
    return tuple(
        RobotContact(int(observer), int(ids[i]), float(depths[i, observer]))
        for i, observer in np.argwhere(depths > TOUCH_TOLERANCE_M)
    )


class ContactPolicy(Protocol):
    """What happens to artefacts that a robot has moved into."""

    def tolerated_m(self, depths: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the depths (N, R) up to which robots are tolerated, given the present ones."""
        ...

    def leaves(self, in_contact: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which artefacts (N,) leave, given which are in contact."""
        ...


class Hold:
    """The artefact stays, and may back out, but never goes deeper, while the overlap lasts."""

    def tolerated_m(self, depths: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the present depths: an overlap may last, but not grow."""
        return depths

    def leaves(self, in_contact: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return False for all: no artefact leaves."""
        return np.zeros_like(in_contact)


class Displace:
    """The artefact makes way: its pose is no longer safe, so that the remedies apply."""

    def tolerated_m(self, depths: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return zeros: no overlap is tolerated."""
        return np.zeros_like(depths)

    def leaves(self, in_contact: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return False for all: no artefact leaves."""
        return np.zeros_like(in_contact)


class Remove:
    """The artefact leaves at once."""

    def tolerated_m(self, depths: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return zeros: no overlap is tolerated."""
        return np.zeros_like(depths)

    def leaves(self, in_contact: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return the artefacts in contact: they leave."""
        return in_contact


class ContactLog:
    """Remembers the pairs in contact, and counts the contacts that begin."""

    def __init__(self, observer: str) -> None:
        self.count = 0
        self._observer = observer
        self._touching: set[tuple[int, int]] = set()

    def begun(
        self, now_ns: int, contacts: Sequence[RobotContact], living: Mapping[int, Artefact]
    ) -> list[ArtefactEvent]:
        """Return an event for each contact of now that was none before; the value is its depth."""
        touching = {(contact.observer, contact.artefact_id): contact for contact in contacts}
        new = [contact for key, contact in touching.items() if key not in self._touching]
        self._touching = set(touching)
        self.count += len(new)
        return [self._event(now_ns, contact, living) for contact in new]

    def forget(self) -> None:
        """Forget the pairs in contact: the clock jumped back."""
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


@compiled
def _neighbours(proposed: _FloatArray, safe: _FloatArray) -> tuple[_IndexArray, _IndexArray]:
    """Return starts (N + 1,) and indices of those that each may meet at either of its poses."""
    rectangles, others = bounds(proposed), bounds(safe)
    for i in range(rectangles.shape[0]):
        for axis in range(2):
            rectangles[i, axis] = min(rectangles[i, axis], others[i, axis])
            rectangles[i, 2 + axis] = max(rectangles[i, 2 + axis], others[i, 2 + axis])
    pairs = candidate_pairs(rectangles)
    starts = np.zeros(rectangles.shape[0] + 1, np.int64)
    for k in range(pairs.shape[0]):
        starts[pairs[k, 0]] += 1
        starts[pairs[k, 1]] += 1
    starts = np.cumsum(starts)
    indices = np.empty(2 * pairs.shape[0], np.int64)
    for k in range(pairs.shape[0]):
        a, b = pairs[k, 0], pairs[k, 1]
        starts[a] -= 1
        indices[starts[a]] = b
        starts[b] -= 1
        indices[starts[b]] = a
    return starts, indices


@compiled
def _is_clear(
    pose: _FloatArray,
    i: int,
    current: _FloatArray,
    present: _Mask,
    candidates: _IndexArray,
    tolerance_m: float,
) -> bool:
    """Tell whether box i of `pose` overlaps none of the candidates where they now are."""
    for k in range(candidates.shape[0]):
        j = candidates[k]
        if j != i and present[j] and boxes_overlap(pose, i, current, j, tolerance_m):
            return False
    return True


@compiled
def _walk(
    start: int,
    proposed: _FloatArray,
    safe: _FloatArray,
    allowed: _Mask,
    current: _FloatArray,
    present: _Mask,
    adjacency: tuple[_IndexArray, _IndexArray],
    strays: _IndexArray,
    outcomes: NDArray[np.int8],
    tolerance_m: float,
) -> int:
    """Keep or move back one after the other from `start`; return the first that can do neither.

    `allowed` (N, 2): whether proposed and last safe pose are clear of walls and robots. `strays`:
    those that a search has put out of their neighbourhood, so that all must heed them. `current`
    and `outcomes` are written. Returns N at the end.
    """
    starts, indices = adjacency
    for i in range(start, proposed.shape[0]):
        if not present[i]:
            continue
        near = indices[starts[i] : starts[i + 1]]
        resolved = False
        for choice in range(2):
            pose = proposed if choice == 0 else safe
            if (
                allowed[i, choice]
                and _is_clear(pose, i, current, present, near, tolerance_m)
                and _is_clear(pose, i, current, present, strays, tolerance_m)
            ):
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
    """Tries rings of growing radius, 0.1 m apart up to `radius_m`, at 32 fixed angles each.

    The order is fixed: nearest ring first, on a ring counter-clockwise from the map's +x. The
    heading is kept. Places at least `robot_clearance_m` from the robots are tried first, so that
    who makes way for a robot is not in its way again at once.
    """

    def __init__(self, radius_m: float, robot_clearance_m: float = 0.0) -> None:
        """Prepare the offsets; a radius below the step leaves none."""
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
        robots: Sequence[Footprint],
        environment: Environment,
    ) -> tuple[NDArray[np.float64], OrientedBoxes] | None:
        """Return the offset (2,) in metres and the box there, on the ground; None if none is safe.

        `box` is of length one. A new pose is safe if it is placeable (free cells only: nobody is
        pushed into the unknown), overlaps none of the others and no robot.
        """
        wider = [robot.padded(self._robot_clearance_m) for robot in robots]
        found = self._nearest(box, others, wider, environment)
        if found is None and robots and self._robot_clearance_m > 0.0:
            found = self._nearest(box, others, robots, environment)
        return found

    def _nearest(
        self,
        box: OrientedBoxes,
        others: OrientedBoxes,
        robots: Sequence[Footprint],
        environment: Environment,
    ) -> tuple[NDArray[np.float64], OrientedBoxes] | None:
        for offsets_m in self._chunks:
            candidates = _standing_at(box, offsets_m, environment)
            placeable = np.flatnonzero(environment.is_placeable(candidates))
            safe = placeable[~_is_taken(candidates.take(placeable), others, robots)]
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
    boxes: OrientedBoxes, others: OrientedBoxes, robots: Sequence[Footprint]
) -> NDArray[np.bool_]:
    """Tell which boxes overlap any other box or any robot."""
    taken = overlaps_any(boxes, others)
    for robot in robots:
        taken |= penetration_m(robot, boxes) > TOUCH_TOLERANCE_M
    return taken


_NO_INDICES = np.empty(0, dtype=np.int64)


class Outcome(IntEnum):
    """What the resolver decided for one artefact."""

    KEPT = _KEPT
    MOVED_BACK = _MOVED_BACK
    DISPLACED_TO_SAFE = 2
    LEAVES = 3
    LEAVES_ON_CONTACT = 4


@dataclass(frozen=True, eq=False)
class Resolution:
    """Where N artefacts are at the end of a sub-step.

    `outcomes` int8 (N,) of `Outcome`. KEPT: the proposed pose. MOVED_BACK: the last safe one.
    DISPLACED_TO_SAFE: the last safe one moved by `shifts_m` float64 (N, 2; 0 for the others) in
    the map frame, heading kept, on the ground there. The others leave. `boxes` are the resolved
    ones (of who leaves, the last safe ones). `contacts` are those at the last safe poses.
    """

    outcomes: NDArray[np.int8]
    shifts_m: NDArray[np.float64]
    boxes: OrientedBoxes
    contacts: tuple[RobotContact, ...]

    @property
    def is_all_kept(self) -> bool:
        """Whether every artefact has its proposed pose."""
        return not self.outcomes.any()

    def letting_pass(self, tracked: NDArray[np.intp]) -> "Resolution":
        """Return the same, but that those who go by a track are where it says.

        Unless they leave for a contact with the robot. `tracked` (M,) are their indices.
        """
        outcomes, shifts_m = self.outcomes.copy(), self.shifts_m.copy()
        stay = tracked[outcomes[tracked] != Outcome.LEAVES_ON_CONTACT]
        outcomes[stay], shifts_m[stay] = Outcome.KEPT, 0.0
        return replace(self, outcomes=outcomes, shifts_m=shifts_m)


class CollisionResolver:
    """Decides, in id order, which pose each artefact has at the end of a sub-step.

    The poses proposed where they are safe all together. Else, for each, the one proposed if it is
    safe; else the last safe pose if still safe; else the nearest safe
    one within the search radius; else the artefact leaves. Safe means: hits no wall, overlaps no
    other artefact (earlier ones at their new pose, later ones at their last safe pose: these do
    not overlap, and each decision keeps it so) and no robot, but as the policy tolerates. An
    overlap among the last safe poses is resolved like any other.

    The last scene found safe is remembered, so that standing artefacts cost a comparison.
    """

    def __init__(
        self, policy: ContactPolicy, search_radius_m: float, robot_clearance_m: float = 0.0
    ) -> None:
        self._policy = policy
        self._search = RingSearch(search_radius_m, robot_clearance_m)
        self._scene: tuple[Environment, NDArray[np.float64]] | None = None

    def resolve(
        self,
        ids: NDArray[np.int64],
        proposed: OrientedBoxes,
        last_safe: OrientedBoxes,
        environment: Environment,
        robots: Sequence[Footprint],
    ) -> Resolution:
        """Return the poses of artefacts `ids` (N,), strictly ascending.

        `proposed` and `last_safe` are the boxes (N) at the two poses, on the ground, in the map
        frame; `last_safe` is where each was at the end of the sub-step before, or was placed.
        `robots` are the footprints at their poses in the map frame. Raises ValueError where ids
        do not ascend or lengths differ.
        """
        _check(ids, proposed, last_safe)
        depths = depths_m(robots, last_safe)
        contacts = contacts_of(ids, depths)
        if not contacts and self._is_known(environment, proposed, last_safe):
            return _all_kept(proposed)
        if not contacts and _is_safe(proposed, environment, robots):
            self._scene = (environment, proposed.packed)
            return _all_kept(proposed)
        scene = _Scene(proposed, last_safe, environment, tuple(robots))
        scene.judge(self._policy, depths)
        scene.settle(self._search)
        self._scene = (environment, scene.current[scene.present])
        return Resolution(scene.outcomes, scene.shifts_m, scene.resolved(), contacts)

    def _is_known(
        self, environment: Environment, proposed: OrientedBoxes, last_safe: OrientedBoxes
    ) -> bool:
        """Tell whether this very scene was found safe, robots apart."""
        if self._scene is None or self._scene[0] is not environment:
            return False
        return np.array_equal(self._scene[1], proposed.packed) and (
            proposed is last_safe or np.array_equal(proposed.packed, last_safe.packed)
        )


class _Scene:
    """The arrays of one resolution: N artefacts that may be at either of two poses."""

    def __init__(
        self,
        proposed: OrientedBoxes,
        last_safe: OrientedBoxes,
        environment: Environment,
        robots: tuple[Footprint, ...],
    ) -> None:
        count = len(proposed)
        self.outcomes = np.zeros(count, dtype=np.int8)
        self.shifts_m = np.zeros((count, 2))
        self.current = last_safe.packed.copy()
        self.present = np.ones(count, dtype=np.bool_)
        self._yaws_rad = np.array(last_safe.yaws_rad)
        self._proposed = proposed
        self._safe = last_safe
        self._environment = environment
        self._robots = robots
        self._allowed = np.ones((count, 2), dtype=np.bool_)
        self._limits = np.zeros((count, len(robots)))

    def judge(self, policy: ContactPolicy, depths: NDArray[np.float64]) -> None:
        """Decide which of the poses proposed walls and robots allow, and who leaves for a contact.

        `depths` (N, R) are those of the robots into the boxes at the last safe poses.
        """
        self._limits = policy.tolerated_m(depths) + TOUCH_TOLERANCE_M
        self._allowed[:, 0] = self._are_allowed(self._proposed)
        in_contact: NDArray[np.bool_] = np.any(depths > TOUCH_TOLERANCE_M, axis=1)
        self.present &= ~policy.leaves(in_contact)
        self.outcomes[~self.present] = Outcome.LEAVES_ON_CONTACT

    def settle(self, search: RingSearch) -> None:
        """Walk in id order; who can neither be kept nor moved back is searched a place for.

        Poses that are safe all together are taken as they are: those behind one another move on.
        """
        if self._are_safe_together():
            self.current[:] = self._proposed.packed
            return
        self._allowed[:, 1] = self._are_allowed(self._safe)
        adjacency = _neighbours(self._proposed.packed, self._safe.packed)
        strays = _NO_INDICES
        i = self._walk(0, adjacency, strays)
        while i < len(self.outcomes):
            if self._displace(i, search):
                strays = np.append(strays, i)
            i = self._walk(i + 1, adjacency, strays)

    def _are_safe_together(self) -> bool:
        """Tell whether everybody may have the pose proposed, and no two of them overlap."""
        allowed = self._allowed[:, 0].all() and self.present.all()
        return bool(allowed) and not any_overlap(self._proposed)

    def _are_allowed(self, boxes: OrientedBoxes) -> NDArray[np.bool_]:
        """Tell which boxes (N) hit no wall, and no robot deeper than it tolerates."""
        walls = self._environment.hits_wall(boxes)
        return ~walls & (depths_m(self._robots, boxes) <= self._limits).all(axis=1)

    def resolved(self) -> OrientedBoxes:
        """Return the boxes where they now are."""
        kept = self.outcomes == Outcome.KEPT
        yaws_rad = np.where(kept, self._proposed.yaws_rad, self._safe.yaws_rad)
        return OrientedBoxes(self.current[:, :3], yaws_rad, self._safe.half_sizes_m)

    def _walk(
        self,
        start: int,
        adjacency: tuple[NDArray[np.int64], NDArray[np.int64]],
        strays: NDArray[np.int64],
    ) -> int:
        return _walk(
            start,
            self._proposed.packed,
            self._safe.packed,
            self._allowed,
            self.current,
            self.present,
            adjacency,
            strays,
            self.outcomes,
            TOUCH_TOLERANCE_M,
        )

    def _displace(self, i: int, search: RingSearch) -> bool:
        """Put artefact i to the nearest safe place; tell whether there was one."""
        others = self._standing_near(i, search.radius_m)
        found = search.nearest(self._safe.at(i), others, self._robots, self._environment)
        self.present[i] = found is not None
        self.outcomes[i] = Outcome.LEAVES if found is None else Outcome.DISPLACED_TO_SAFE
        if found is not None:
            self.shifts_m[i] = found[0]
            self.current[i] = found[1].packed[0]
        return found is not None

    def _standing_near(self, i: int, radius_m: float) -> OrientedBoxes:
        """Return the other boxes, where they now are, that a search about box i may meet."""
        reaches_m = self.current[:, 5] + self.current[:, 6]
        offsets_m = np.abs(self.current[:, :2] - self.current[i, :2])
        near = self.present & (offsets_m.max(axis=1) < radius_m + reaches_m + reaches_m[i])
        near[i] = False
        yaws_rad = np.arctan2(self.current[near, 4], self.current[near, 3])
        return OrientedBoxes(self.current[near, :3], yaws_rad, self.current[near, 5:])


def _is_safe(boxes: OrientedBoxes, environment: Environment, robots: Sequence[Footprint]) -> bool:
    """Tell whether no box hits a wall, a robot or another box: safe by any policy."""
    if environment.hits_wall(boxes).any() or any_overlap(boxes):
        return False
    return not (depths_m(robots, boxes) > TOUCH_TOLERANCE_M).any()


def _all_kept(proposed: OrientedBoxes) -> Resolution:
    """Return the resolution of a scene in which nothing is to do."""
    count = len(proposed)
    return Resolution(np.zeros(count, dtype=np.int8), np.zeros((count, 2)), proposed, ())


def _check(ids: NDArray[np.int64], proposed: OrientedBoxes, last_safe: OrientedBoxes) -> None:
    """Raise ValueError where ids do not ascend or lengths differ."""
    if not len(ids) == len(proposed) == len(last_safe):
        raise ValueError("ids, proposed and last safe boxes differ in length")
    if not (ids[1:] > ids[:-1]).all():
        raise ValueError("ids do not ascend strictly")
