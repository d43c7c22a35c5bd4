"""A planar laser scan, as sensor_msgs/LaserScan (REP 117 says what its ranges mean)."""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from are_ros.errors import InputError


@dataclass(frozen=True, eq=False)
class LaserScan:
    """N ranges in the x-y plane of the laser's frame, at angles counted from x towards y [rad].

    Beam i looks along angle_min + i * angle_increment (the increment may be negative). `ranges` is
    float32 (N,) [m]: -inf too close, +inf or NaN or beyond range_max no return. `intensities` is
    float32, (N,) or empty. Both become read-only. Times: `stamp_ns` of the first beam [ns],
    `time_increment_s` between beams, `scan_time_s` between scans. `checked` is the way in for
    numbers from outside.
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
        0, a negative range_min or one above range_max (which may be infinite), no beam, intensities
        of another length, and an angle_max that does not fit the count. Drivers disagree whether
        angle_max is the last beam or one past it, and some round: the count may be off by up to
        one beam either way from what the angles say.
        """
        reason = self._why_refused()
        if reason is not None:
            raise InputError(f"{source}: {reason}")
        return self

    def directions(self) -> npt.NDArray[np.float64]:
        """Return the beams' unit vectors in the laser's frame, float64 (N, 3)."""
        angles = self.angle_min_rad + np.arange(len(self.ranges)) * self.angle_increment_rad
        return np.stack((np.cos(angles), np.sin(angles), np.zeros_like(angles)), axis=1)

    def with_ranges(
        self, ranges: npt.NDArray[np.float32], intensities: npt.NDArray[np.float32]
    ) -> "LaserScan":
        """Return the scan with other ranges (N,) and intensities."""
        return replace(self, ranges=ranges, intensities=intensities)

    def _why_refused(self) -> str | None:
        numbers = {
            "angle_min": self.angle_min_rad,
            "angle_max": self.angle_max_rad,
            "angle_increment": self.angle_increment_rad,
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
        if self.angle_increment_rad == 0.0:
            return "angle_increment is 0"
        if count == 0:
            return "ranges is empty"
        if extra not in {0, count}:
            return f"intensities has {extra} values, and ranges {count}"
        span = self.angle_max_rad - self.angle_min_rad
        expected = span / self.angle_increment_rad + 1.0
        if abs(expected - count) > 1.5:
            angles = f"{self.angle_min_rad} to {self.angle_max_rad}"
            step = f"{self.angle_increment_rad}"
            return f"ranges has {count} values, and {angles} by {step} gives {expected:.1f}"
        return None
