"""A planar laser scan (sensor_msgs/LaserScan), and its augmentation with artefacts.

REP 117 defines the meaning of its ranges.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from are_ros.builder.sensors.obstacles import Obstacles
from are_ros.errors import InputError
from are_ros.world.rigid_transform import RigidTransform

_RETURN_SHARE = 0.995
"""Gazebo and many drivers write range_max, or a little less, where nothing is."""


@dataclass(frozen=True, eq=False)
class LaserScan:
    """N ranges in the x-y plane of the laser's frame, at angles counted from x towards y [rad].

    Beam i looks along angle_min + i * angle_increment (the increment may be negative; of a single
    beam it may be anything, as 0, or NaN in Gazebo). `ranges` is float32 (N,) [m]: -inf too close,
    +inf, NaN, 0 or beyond range_max no return. `intensities` is float32, (N,) or empty. Both become
    read-only. Times: `stamp_ns` of the first beam [ns], `time_increment_s` between beams,
    `scan_time_s` between scans. Numbers from outside must pass `checked`.
    """

    frame_id: str
    stamp_ns: int
    angle_min_rad: float
    angle_max_rad: float
    angle_increment_rad: float
    time_increment_s: float
    scan_time_s: float
    range_min_m: float
    range_max_m: float
    ranges: npt.NDArray[np.float32]
    intensities: npt.NDArray[np.float32]

    def __post_init__(self) -> None:
        for name in ("ranges", "intensities"):
            values = np.ascontiguousarray(getattr(self, name), dtype=np.float32).view()
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    def checked(self, source: str = "scan") -> "LaserScan":
        """Return this scan, or raise InputError with `source`, field and reason.

        Refused: an empty frame, an angle, a time or a range_min that is not finite, an increment of
        0 between several beams, a negative range_min or one above range_max (which may be
        infinite), no beam, ranges of several dimensions, and intensities of another length. An
        angle_max that does not fit is not: see `misfit`.
        """
        reason = self._why_refused()
        if reason is not None:
            raise InputError(f"{source}: {reason}")
        return self

    @property
    def misfit(self) -> str:
        """How the count of ranges differs from what the angles say, in words; empty if it fits.

        Drivers disagree whether angle_max is the last beam or one past it, and some round: a beam
        more or less fits. Nothing depends on it, as laser_geometry and AMCL do not use angle_max.
        """
        first, last, step = self.angle_min_rad, self.angle_max_rad, self._step_rad
        count, expected = len(self.ranges), (last - first) / step + 1.0 if step else 1.0
        if abs(expected - count) <= 1.5:
            return ""
        angles = f"{first:.6g} to {last:.6g} by {step:.6g}"
        return f"ranges has {count} values, and {angles} gives {expected:.1f}"

    @classmethod
    def miniature(cls, frame_id: str, stamp_ns: int) -> "LaserScan":
        """Return a small scan with returns and without, for `warm_up`."""
        ranges = np.full(36, 2.5, dtype=np.float32)
        ranges[::2] = np.inf
        none = np.empty(0, dtype=np.float32)
        return cls(frame_id, stamp_ns, -3.1, 3.1, 6.2 / 35, 0.0, 0.1, 0.05, 8.0, ranges, none)

    def directions(self) -> npt.NDArray[np.float64]:
        """Return the beams' unit vectors in the laser's frame, float64 (N, 3), read-only."""
        return _directions(self.angle_min_rad, self._step_rad, len(self.ranges))

    def returns(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
        """Return where beams ended, float64 (M, 3) in the laser's frame [m], and which, bool (N,).

        Those within [range_min, range_max], but for its last half per cent, and above 0.
        """
        returned = np.isfinite(self.ranges) & (self.ranges > 0.0)
        returned &= self.ranges >= self.range_min_m
        returned &= self.ranges < self.range_max_m * _RETURN_SHARE
        lengths_m = self.ranges[returned].astype(np.float64)[:, np.newaxis]
        return self.directions()[returned] * lengths_m, returned

    def augmented(self, map_from_sensor: RigidTransform, obstacles: Obstacles) -> "LaserScan":
        """Return the scan with virtual returns where an artefact is nearer than what was measured.

        The scan is `checked`. The laser's plane may have any orientation. Per beam, with the first
        hit on any artefact, Euclidean [m]:

        - within [range_min, range_max] it replaces a farther real return, whatever walls the
          environment has: the return proves that the beam is free up to there;
        - it replaces +inf, NaN, 0 (many drivers write it where nothing came back, whatever their
          range_min), a range above range_max or below range_min where the environment's surface is
          not in front of it;
        - nearer than range_min it becomes -inf (REP 117: too close), unless the return is nearer;
        - beyond range_max, or not nearer than a valid return, it changes nothing, and -inf stays.

        Other beams keep their bits; replaced ones have intensity 0. If nothing is replaced, the
        same object is returned.
        """
        hits = obstacles.first_hits(map_from_sensor, self.directions(), self.range_max_m)
        if hits.min() == np.inf:
            return self
        ranges, replaced = _merged(self, hits.astype(np.float32), map_from_sensor, obstacles)
        if not replaced.any():
            return self
        if not len(self.intensities):
            return self.with_ranges(ranges, self.intensities)
        return self.with_ranges(ranges, np.where(replaced, np.float32(0.0), self.intensities))

    def with_ranges(
        self, ranges: npt.NDArray[np.float32], intensities: npt.NDArray[np.float32]
    ) -> "LaserScan":
        """Return the scan with other ranges (N,) and intensities."""
        return replace(self, ranges=ranges, intensities=intensities)

    @property
    def _step_rad(self) -> float:
        """The angle from each beam to the next; 0 of a single one, which has none after it."""
        return self.angle_increment_rad if len(self.ranges) > 1 else 0.0

    def _why_refused(self) -> str | None:
        numbers = {
            "angle_min": self.angle_min_rad,
            "angle_max": self.angle_max_rad,
            "angle_increment": self._step_rad,
            "time_increment": self.time_increment_s,
            "scan_time": self.scan_time_s,
            "range_min": self.range_min_m,
        }
        for name, number in numbers.items():
            if not math.isfinite(number):
                return f"{name} is {number}"
        if not self.frame_id:
            return "header.frame_id is empty"
        if not 0.0 <= self.range_min_m <= self.range_max_m:
            return f"range_min is {self.range_min_m} and range_max {self.range_max_m}"
        return self._why_beams_refused()

    def _why_beams_refused(self) -> str | None:
        count, extra = len(self.ranges), len(self.intensities)
        if self._step_rad == 0.0 and count > 1:
            return "angle_increment is 0"
        if count == 0:
            return "ranges is empty"
        if self.ranges.ndim != 1:
            return f"ranges has the shape {self.ranges.shape}, not (N,)"
        if extra not in {0, count}:
            return f"intensities has {extra} values, and ranges {count}"
        return None


@lru_cache(maxsize=16)
def _directions(first_rad: float, increment_rad: float, count: int) -> npt.NDArray[np.float64]:
    """Return the unit vectors (N, 3) of N beams; each axis is contiguous, as kernels take rays."""
    angles = first_rad + np.arange(count) * increment_rad
    directions: npt.NDArray[np.float64]
    directions = np.stack((np.cos(angles), np.sin(angles), np.zeros_like(angles))).T
    directions.flags.writeable = False
    return directions


def _merged(
    scan: LaserScan,
    hits: npt.NDArray[np.float32],
    map_from_laser: RigidTransform,
    obstacles: Obstacles,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    """Return the ranges with the hits merged by the rules above, and which were replaced."""
    real = scan.ranges
    nearest = np.float32(scan.range_min_m)
    farthest = np.float32(min(scan.range_max_m, float(np.finfo(np.float32).max)))
    returned = (real > 0.0) & (real >= nearest) & (real <= farthest)
    too_close = np.isneginf(real)
    nearer = np.where(returned, hits < real, hits <= farthest)
    replaced = nearer & ~too_close
    doubtful = np.flatnonzero(replaced & ~returned)
    rays = scan.directions()[doubtful]
    replaced[doubtful] = ~obstacles.are_hidden(map_from_laser, rays, hits[doubtful])
    virtual = np.where(hits < nearest, np.float32(-np.inf), hits)
    return np.where(replaced, virtual, real), replaced
