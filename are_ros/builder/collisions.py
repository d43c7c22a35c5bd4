"""Collisions (section 3.3): the paper's two remedies, so that no two artefacts ever overlap."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from are_ros.builder import _collision_kernels
from are_ros.builder.ring_search import RingSearch
from are_ros.builder.robot_contact import ContactPolicy, RobotContact, contacts_of, depths_m
from are_ros.world.environment import Environment
from are_ros.world.footprint import Footprint
from are_ros.world.oriented_boxes import TOUCH_TOLERANCE_M, OrientedBoxes, any_overlap

_NO_INDICES = np.empty(0, dtype=np.int64)


class Outcome(IntEnum):
    """What the resolver decided for one artefact."""

    KEPT = _collision_kernels.KEPT
    MOVED_BACK = _collision_kernels.MOVED_BACK
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
        adjacency = _collision_kernels.neighbours(self._proposed.packed, self._safe.packed)
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
        return _collision_kernels.walk(
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
