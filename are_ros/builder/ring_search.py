"""The nearest place at which a box can stand, on rings about where it is."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from are_ros.world.environment import Environment
from are_ros.world.footprint import Footprint, penetration_m
from are_ros.world.oriented_boxes import TOUCH_TOLERANCE_M, OrientedBoxes, overlaps_any

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
