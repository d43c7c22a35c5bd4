"""What leaves an artefact less room than the map does: others, robots, goals, a disc to be in."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from are_ros.world.footprint import Footprint, signed_distance_m
from are_ros.world.oriented_boxes import OrientedBoxes, overlaps_any


@dataclass(frozen=True, eq=False)
class KeepOut:
    """A shape on the ground, in the map frame, that stays `distance_m` away from artefacts.

    A robot is its footprint at its pose; a goal is a footprint of one vertex.
    """

    footprint: Footprint
    distance_m: float


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What moves: the boxes of the other artefacts, and what they keep away from.

    `allowed` may refuse more: it tells for N boxes which may stand there, bool (N,).
    """

    others: OrientedBoxes = field(default_factory=OrientedBoxes.empty)
    keep_out: tuple[KeepOut, ...] = ()
    allowed: Callable[[OrientedBoxes], npt.NDArray[np.bool_]] | None = None

    def leave_room_for(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Tell which boxes are clear of all that, each on its own: bool (N,)."""
        clear = self.are_clear(boxes)
        clear[clear] = self.are_allowed(boxes.take(clear))
        return clear

    def are_clear(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Tell which boxes keep away from the others, robots and goals: bool (N,)."""
        clear = ~overlaps_any(boxes, self.others)
        for keep in self.keep_out:
            left = boxes.take(clear)  # distances take the most time
            clear[clear] = signed_distance_m(keep.footprint, left) >= keep.distance_m
        return clear

    def are_allowed(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Tell which boxes `allowed` does not refuse: bool (N,)."""
        if self.allowed is None or not len(boxes):
            return np.ones(len(boxes), np.bool_)
        return self.allowed(boxes)


@dataclass(frozen=True)
class Disc:
    """The points within `radius_m` of (x, y) in the map frame."""

    x_m: float
    y_m: float
    radius_m: float

    def contains(self, points_m: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        """Tell which of the points (N, 2) lie in the closed disc: bool (N,)."""
        return np.hypot(points_m[:, 0] - self.x_m, points_m[:, 1] - self.y_m) <= self.radius_m
