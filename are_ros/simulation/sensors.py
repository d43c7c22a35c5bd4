"""A spinning laser that measures a building by ray casting."""

import math
from dataclasses import dataclass

import numpy as np

from are_ros.builder.occlusion.rays import VoxelField
from are_ros.world.laser_scan import LaserScan
from are_ros.world.rigid_transform import RigidTransform


@dataclass(frozen=True)
class LidarModel:
    """A laser like the small ones of the LDS family; all beams of a scan at one instant.

    `noise_m` is the standard deviation of a range. Farther than `range_max_m` nothing returns.
    """

    beams: int = 360
    scan_time_s: float = 0.1
    range_min_m: float = 0.12
    range_max_m: float = 8.0
    noise_m: float = 0.01


class Lidar:
    """Scans a field of voxels; the noise comes from `generator`, scan by scan."""

    def __init__(
        self, model: LidarModel, field: VoxelField, frame_id: str, generator: np.random.Generator
    ) -> None:
        self._model = model
        self._field = field
        self._frame_id = frame_id
        self._generator = generator

    def scan(self, map_from_laser: RigidTransform, stamp_ns: int) -> LaserScan:
        """Return the scan from a level pose in the map: beams once around, the first ahead.

        A range beyond the model's reach is inf, one too short for it -inf (REP 117).
        """
        blank = self._blank(stamp_ns)
        directions = blank.directions() @ map_from_laser.rotation_matrix().T
        reach_m = self._model.range_max_m + 10 * self._model.noise_m
        hits_m = self._field.first_hits(map_from_laser.translation_m, directions, reach_m)
        noise_m = self._model.noise_m * self._generator.standard_normal(self._model.beams)
        ranges_m = hits_m + noise_m
        ranges_m[ranges_m > self._model.range_max_m] = np.inf
        ranges_m[ranges_m < self._model.range_min_m] = -np.inf
        return blank.with_ranges(ranges_m.astype(np.float32), blank.intensities)

    def _blank(self, stamp_ns: int) -> LaserScan:
        """Return a scan in which nothing returned."""
        model = self._model
        increment_rad = 2 * math.pi / model.beams
        return LaserScan(
            frame_id=self._frame_id,
            stamp_ns=stamp_ns,
            angle_min_rad=0.0,
            angle_max_rad=(model.beams - 1) * increment_rad,
            angle_increment_rad=increment_rad,
            time_increment_s=0.0,
            scan_time_s=model.scan_time_s,
            range_min_m=model.range_min_m,
            range_max_m=model.range_max_m,
            ranges=np.full(model.beams, np.inf, dtype=np.float32),
            intensities=np.empty(0, dtype=np.float32),
        )
