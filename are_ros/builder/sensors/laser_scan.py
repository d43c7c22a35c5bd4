"""A planar laser scan (sensor_msgs/LaserScan), and its augmentation with artefacts.

REP 117 defines the meaning of its ranges.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder.occlusion.meshes import Tree, cast, enters
from are_ros.builder.occlusion.rays import VoxelField, inverse
from are_ros.builder.sensors.sensor_path import Obstacles
from are_ros.errors import InputError
from are_ros.world.rigid_transform import RigidTransform

_TURN: Final = 2.0 * math.pi


@dataclass(frozen=True, eq=False)
class LaserScan:
    """N ranges in the x-y plane of the laser's frame, at angles counted from x towards y [rad].

    Beam i looks along angle_min + i * angle_increment (the increment may be negative). `ranges` is
    float32 (N,) [m]: -inf too close, +inf or NaN or beyond range_max no return. `intensities` is
    float32, (N,) or empty. Both become read-only. Times: `stamp_ns` of the first beam [ns],
    `time_increment_s` between beams, `scan_time_s` between scans. Numbers from outside
    must pass `checked`.
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

    @classmethod
    def miniature(cls, frame_id: str, stamp_ns: int) -> "LaserScan":
        """Return a small scan with returns and without, for `warm_up`."""
        ranges = np.full(36, 2.5, dtype=np.float32)
        ranges[::2] = np.inf
        none = np.empty(0, dtype=np.float32)
        return cls(frame_id, stamp_ns, -3.1, 3.1, 6.2 / 35, 0.0, 0.1, 0.05, 8.0, ranges, none)

    def directions(self) -> npt.NDArray[np.float64]:
        """Return the beams' unit vectors in the laser's frame, float64 (N, 3)."""
        angles = self.angle_min_rad + np.arange(len(self.ranges)) * self.angle_increment_rad
        return np.stack((np.cos(angles), np.sin(angles), np.zeros_like(angles)), axis=1)

    def augmented(self, map_from_sensor: RigidTransform, obstacles: Obstacles) -> "LaserScan":
        """Return the scan with virtual returns where an artefact is nearer than what was measured.

        The scan is `checked`. The laser's plane may have any orientation. Per beam, with the first
        hit on any artefact, Euclidean [m]:

        - within [range_min, range_max] it replaces a farther real return, whatever walls the
          environment has: the return proves that the beam is free up to there;
        - it replaces +inf, NaN, a range above range_max or below range_min (many drivers write 0.0
          where nothing came back) where the environment's surface is not in front of it;
        - nearer than range_min it becomes -inf (REP 117: too close), unless the return is nearer;
        - beyond range_max, or not nearer than a valid return, it changes nothing, and -inf stays.

        A beam that starts inside a box hits it at 0; a mesh has only its surface. Other beams keep
        their bits; replaced ones have intensity 0. If nothing is replaced, the same object is
        returned.
        """
        angles = self.angle_min_rad, self.angle_increment_rad, len(self.ranges)
        hits = first_hits(map_from_sensor, angles, self.range_max_m, obstacles)
        if hits.min() == np.inf:
            return self
        ranges, replaced = _merged(
            self, hits.astype(np.float32), map_from_sensor, obstacles.surface
        )
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


def first_hits(
    map_from_laser: RigidTransform,
    angles: tuple[float, float, int],
    range_max_m: float,
    obstacles: Obstacles,
) -> npt.NDArray[np.float64]:
    """Return the distance [m] to the first artefact along each beam of a fan, float64 (N,), or inf.

    The beams lie in the x-y plane of the laser's frame; `angles` are the first one [rad], the
    increment [rad] and N. Hits beyond the range may be left out.
    """
    first, increment, count = angles
    hits = np.full(count, np.inf)
    _first_hits(
        map_from_laser.translation_m,
        map_from_laser.rotation_matrix(),
        (first, increment),
        range_max_m,
        obstacles.boxes.packed,
        obstacles.shapes.indices,
        obstacles.shapes.pool.tree,
        hits,
    )
    return hits


def _merged(
    scan: LaserScan,
    hits: npt.NDArray[np.float32],
    map_from_laser: RigidTransform,
    surface: VoxelField | None,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    """Return the ranges with the hits merged by the rules above, and which were replaced."""
    real = scan.ranges
    nearest = np.float32(scan.range_min_m)
    farthest = np.float32(min(scan.range_max_m, float(np.finfo(np.float32).max)))
    returned = (real >= nearest) & (real <= farthest)
    too_close = np.isneginf(real)
    nearer = np.where(returned, hits < real, hits <= farthest)
    replaced = nearer & ~too_close
    if surface is not None:
        doubtful = np.flatnonzero(replaced & ~returned)
        replaced[doubtful] = ~_are_hidden(scan, doubtful, hits[doubtful], map_from_laser, surface)
    virtual = np.where(hits < nearest, np.float32(-np.inf), hits)
    return np.where(replaced, virtual, real), replaced


def _are_hidden(
    scan: LaserScan,
    beams: npt.NDArray[np.int64],
    hits_m: npt.NDArray[np.float32],
    map_from_laser: RigidTransform,
    surface: VoxelField,
) -> npt.NDArray[np.bool_]:
    """Return for which of some beams (K,) the environment is hit before the hit (K,): bool (K,)."""
    if not len(beams):
        return np.empty(0, np.bool_)
    angles = scan.angle_min_rad + beams * scan.angle_increment_rad
    planar = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    directions = planar @ map_from_laser.rotation_matrix()[:, :2].T
    origin_m, farthest_m = map_from_laser.translation_m, float(hits_m.max())
    hidden: npt.NDArray[np.bool_] = surface.first_hits(origin_m, directions, farthest_m) < hits_m
    return hidden


@compiled
def _first_hits(
    laser_m: npt.NDArray[np.float64],
    map_from_laser: npt.NDArray[np.float64],
    angles: tuple[float, float],
    range_max_m: float,
    boxes: npt.NDArray[np.float64],
    meshes: npt.NDArray[np.int64],
    tree: Tree,
    hits_m: npt.NDArray[np.float64],
) -> None:
    """Lower each beam's hit [m] to the first on any box or mesh; `boxes` as `OrientedBoxes.packed`.

    A ball around the box cuts the laser's plane in a disc; only beams within its angles are cast,
    in every turn that the scan makes.
    """
    first, step = angles
    normal = map_from_laser[:, 2]
    for box in range(boxes.shape[0]):
        apart = boxes[box, :3] - laser_m
        radius2 = boxes[box, 5] ** 2 + boxes[box, 6] ** 2 + boxes[box, 7] ** 2
        height = apart[0] * normal[0] + apart[1] * normal[1] + apart[2] * normal[2]
        if height * height > radius2:
            continue
        x = apart[0] * map_from_laser[0, 0] + apart[1] * map_from_laser[1, 0]
        y = apart[0] * map_from_laser[0, 1] + apart[1] * map_from_laser[1, 1]
        x, y = x + apart[2] * map_from_laser[2, 0], y + apart[2] * map_from_laser[2, 1]
        disc, range_m = math.sqrt(radius2 - height * height) + 1e-6, math.sqrt(x * x + y * y)
        if range_m - disc > range_max_m:
            continue
        half = math.asin(disc / range_m) if disc < range_m else math.pi
        middle, half = math.atan2(y, x), half + 1e-6
        cosine, sine, oz = boxes[box, 3], boxes[box, 4], -apart[2]
        ox = -cosine * apart[0] - sine * apart[1]
        oy = sine * apart[0] - cosine * apart[1]
        corners = np.array(
            (
                -boxes[box, 5],
                -boxes[box, 6],
                -boxes[box, 7],
                boxes[box, 5],
                boxes[box, 6],
                boxes[box, 7],
            )
        )
        last = first + step * (hits_m.size - 1)
        low, high = min(first, last), max(first, last)
        turn = math.ceil((low - middle - half) / _TURN)
        while middle + turn * _TURN - half <= high:
            a = (middle + turn * _TURN - half - first) / step
            b = (middle + turn * _TURN + half - first) / step
            begin = max(0, math.ceil(min(a, b)))
            end = min(hits_m.size - 1, math.floor(max(a, b)))
            for beam in range(begin, end + 1):
                angle = first + step * beam
                a, b = math.cos(angle), math.sin(angle)
                x = a * map_from_laser[0, 0] + b * map_from_laser[0, 1]
                y = a * map_from_laser[1, 0] + b * map_from_laser[1, 1]
                dz = a * map_from_laser[2, 0] + b * map_from_laser[2, 1]
                dx, dy = cosine * x + sine * y, cosine * y - sine * x
                if meshes[box] >= 0:
                    hit = cast(tree, meshes[box], ox, oy, oz, dx, dy, dz, range_max_m)[0]
                else:
                    hit = enters(corners, ox, oy, oz, inverse(dx), inverse(dy), inverse(dz))
                hits_m[beam] = min(hits_m[beam], hit)
            turn += 1
