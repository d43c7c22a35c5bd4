"""A range reading (sensor_msgs/Range): one distance within a cone, of sonar or infrared."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.sensors.laser_scan import first_hits
from are_ros.builder.sensors.sensor_path import Obstacles
from are_ros.errors import InputError
from are_ros.world.rigid_transform import RigidTransform

_STEP_RAD: Final = 0.01
"""Neighbouring rays of a cone are at most this far apart: 4 cm at 4 m."""


@dataclass(frozen=True)
class RangeReading:
    """The distance to the nearest surface within a cone around the x-axis of the sensor's frame.

    `field_of_view_rad` is the cone's full angle. `range_m` is float32 [m]: -inf too close, +inf or
    NaN or beyond max_range no return (REP 117). A sensor with min_range = max_range detects only:
    -inf within that distance, else +inf. `radiation_type` and `variance_m2` are passed on.
    """

    frame_id: str
    stamp_ns: int
    radiation_type: int
    field_of_view_rad: float
    min_range_m: float
    max_range_m: float
    range_m: float
    variance_m2: float

    def checked(self, source: str = "range") -> "RangeReading":
        """Return this reading, or raise InputError with `source`, field and reason.

        Refused: an empty frame, a field of view beyond [0, 2 pi], a min_range that is negative, not
        finite or above max_range (which may be infinite).
        """
        reason = ""
        if not self.frame_id:
            reason = "header.frame_id is empty"
        elif not 0.0 <= self.field_of_view_rad <= float(np.float32(2.0 * math.pi)):
            reason = f"field_of_view is {self.field_of_view_rad}"
        elif not (math.isfinite(self.min_range_m) and 0.0 <= self.min_range_m <= self.max_range_m):
            reason = f"min_range is {self.min_range_m} and max_range {self.max_range_m}"
        if reason:
            raise InputError(f"{source}: {reason}")
        return self

    @classmethod
    def miniature(cls, frame_id: str, stamp_ns: int) -> "RangeReading":
        """Return a reading without a return, for `warm_up`."""
        return cls(frame_id, stamp_ns, 0, 0.5, 0.05, 8.0, math.inf, 0.0)

    def augmented(self, map_from_sensor: RigidTransform, obstacles: Obstacles) -> "RangeReading":
        """Return the reading with the nearest artefact within the cone, if that is nearer.

        The reading is `checked`. The rules are those of a laser beam: a return within [min_range,
        max_range] proves that the cone is free up to it, so a nearer artefact replaces it, whatever
        walls the environment has. Without a return, an artefact counts only if the environment does
        not hide it. Nearer than min_range it becomes -inf; -inf stays.
        """
        is_return = self.min_range_m <= self.range_m <= self.max_range_m
        if self.range_m == -math.inf:
            return self
        nearest_m = np.float32(np.inf)
        for map_from_fan, angles in self._fans(map_from_sensor):
            hits = first_hits(map_from_fan, angles, self.max_range_m, obstacles).astype(np.float32)
            hits[hits >= nearest_m] = np.inf
            hits[(hits >= self.range_m) if is_return else (hits > self.max_range_m)] = np.inf
            seen = np.flatnonzero(hits < np.inf)
            if len(seen) and obstacles.surface is not None and not is_return:
                rays = _directions(map_from_fan, angles)[seen]
                farthest_m = float(hits[seen].max())
                walls = obstacles.surface.first_hits(map_from_fan.translation_m, rays, farthest_m)
                seen = seen[walls >= hits[seen]]
            nearest_m = min(nearest_m, hits[seen].min(initial=np.inf))
        if nearest_m == np.inf:
            return self
        return replace(
            self, range_m=-math.inf if nearest_m < self.min_range_m else float(nearest_m)
        )

    def _fans(
        self, map_from_sensor: RigidTransform
    ) -> Iterator[tuple[RigidTransform, tuple[float, float, int]]]:
        """Yield the cone as fans of rays (pose, angles as `first_hits` takes them) about its axis.

        The fans are turned about the x-axis, over half a turn; each has a ray along the axis.
        """
        half = 0.5 * self.field_of_view_rad
        rays_per_side = math.ceil(half / _STEP_RAD)
        step = half / rays_per_side if rays_per_side else 1.0
        count = math.ceil(math.pi * math.sin(min(half, 0.5 * math.pi)) / _STEP_RAD) or 1
        for fan in range(count):
            turn = RigidTransform.from_xyz_ypr(0.0, 0.0, 0.0, 0.0, 0.0, math.pi * fan / count)
            yield map_from_sensor @ turn, (-half, step, 2 * rays_per_side + 1)


def _directions(
    map_from_fan: RigidTransform, angles: tuple[float, float, int]
) -> npt.NDArray[np.float64]:
    """Return the unit vectors of a fan's rays in the map frame, float64 (N, 3)."""
    first, step, count = angles
    turns = first + step * np.arange(count)
    planar = np.stack((np.cos(turns), np.sin(turns)), axis=1)
    rays: npt.NDArray[np.float64] = planar @ map_from_fan.rotation_matrix()[:, :2].T
    return rays
