"""A robot in a building, on one clock: the world that a recording or a planner runs against."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.conventions import NS_PER_S
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.building import Building
from bags.simulation.frames import BASE_FROM_SCAN, SCAN_FRAME
from bags.simulation.robot import (
    Command,
    DriveLimits,
    OdometryErrors,
    RobotState,
    WheelOdometry,
    correction,
    drive,
)

# A spinning laser that measures a building by ray casting.


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


STEPS_PER_S: Final = 120
"""A multiple of the rates at which odometry (30 Hz) and sensors (10 Hz) speak."""

_ODOMETRY_STREAM, _LIDAR_STREAM = 0, 1


class Simulator:
    """Moves a robot by fixed steps of 1/120 s; the same seed and commands give the same world.

    The robot is kinematic and does not feel walls: its driver is to keep it clear of them. Poses
    are those of base_footprint in the map frame, whose floor is at height 0.
    """

    def __init__(
        self,
        building: Building,
        start: RobotState,
        *,
        limits: DriveLimits,
        start_ns: int = 0,
        seed: int = 0,
    ) -> None:
        """Put the robot at its start; odometry begins there."""
        self.building = building
        self.start_ns = start_ns
        self.steps = 0
        self.state = start
        self._limits = limits
        self._odometry = WheelOdometry(OdometryErrors(), _generator(seed, _ODOMETRY_STREAM))
        scan_height_m = float(BASE_FROM_SCAN.translation_m[2])
        field = VoxelField.of(building.slice_at(scan_height_m))
        self._lidar = Lidar(LidarModel(), field, SCAN_FRAME, _generator(seed, _LIDAR_STREAM))

    @property
    def now_ns(self) -> int:
        """The time of the present state."""
        return self.start_ns + self.steps * NS_PER_S // STEPS_PER_S

    @property
    def map_from_base(self) -> RigidTransform:
        """Where the base really stands."""
        return self.state.pose()

    @property
    def odom_from_base(self) -> RigidTransform:
        """Where the odometry believes it to stand."""
        return self._odometry.odom_from_base

    @property
    def map_from_odom(self) -> RigidTransform:
        """The correction that makes up for the odometry's drift so far."""
        return correction(self.map_from_base, self.odom_from_base)

    def step(self, command: Command) -> None:
        """Let one step pass under a command."""
        step_s = 1.0 / STEPS_PER_S
        self.state = drive(self.state, command, self._limits, step_s)
        self._odometry.advance(self.state.speed_m_s, self.state.turn_rate_rad_s, step_s)
        self.steps += 1

    def scan(self) -> LaserScan:
        """Return what the laser measures now; each call draws fresh noise."""
        return self._lidar.scan(self.map_from_base @ BASE_FROM_SCAN, self.now_ns)


def _generator(seed: int, stream: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(stream,)))
