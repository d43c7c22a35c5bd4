"""A range reading (sensor_msgs/Range): one distance within a cone, of sonar or infrared."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.sensors.obstacles import Obstacles
from are_ros.errors import InputError
from are_ros.world.rigid_transform import RigidTransform

_STEP_RAD: Final = 0.01
"""Neighbouring rays of a cone are at most this far apart: 4 cm at 4 m."""


@dataclass(frozen=True)
class RangeReading:
    """The distance to the nearest surface within a cone around the x-axis of the sensor's frame.

    `field_of_view_rad` is the cone's full angle. `range_m` is float32 [m]: -inf (REP 117), or above
    0 and below min_range, too close; +inf, NaN, beyond max_range, 0 or less no return. A sensor
    with min_range = max_range detects only: -inf within that distance, else +inf. `radiation_type`
    and `variance_m2` are passed on.
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
        not hide it. Nearer than min_range it becomes -inf. What was too close stays.
        """
        if self.range_m == -math.inf or 0.0 < self.range_m < self.min_range_m:
            return self
        is_measured = self.min_range_m <= self.range_m <= self.max_range_m
        is_return = is_measured and 0.0 < self.range_m < math.inf
        rays = _rays_in_cone(self.field_of_view_rad)
        hits = obstacles.first_hits(map_from_sensor, rays, self.max_range_m).astype(np.float32)
        seen = np.flatnonzero(hits < (self.range_m if is_return else np.inf))
        if not is_return:
            seen = seen[~obstacles.are_hidden(map_from_sensor, rays[seen], hits[seen])]
        nearest_m = hits[seen].min(initial=np.inf)
        if nearest_m == np.inf:
            return self
        return replace(
            self, range_m=-math.inf if nearest_m < self.min_range_m else float(nearest_m)
        )


@lru_cache(maxsize=16)
def _rays_in_cone(field_of_view_rad: float) -> npt.NDArray[np.float64]:
    """Return unit vectors (N, 3), in fans that are turned about the cone's axis, over half a turn.

    Each axis is contiguous, as kernels take rays.
    """
    half = 0.5 * field_of_view_rad
    fans = math.ceil(math.pi * math.sin(min(half, 0.5 * math.pi)) / _STEP_RAD) or 1
    turns = np.arange(fans)[:, np.newaxis] * math.pi / fans
    angles = np.linspace(-half, half, 2 * math.ceil(half / _STEP_RAD) + 1)
    x, across = np.cos(angles), np.sin(angles)
    axes = np.broadcast_arrays(x, np.cos(turns) * across, np.sin(turns) * across)
    rays: npt.NDArray[np.float64] = np.stack([axis.ravel() for axis in axes]).T
    return rays
