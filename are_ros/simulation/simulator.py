"""A robot in a building, on one clock: the world that a recording or a planner runs against."""

from typing import Final

import numpy as np

from are_ros.builder.occlusion.rays import VoxelField
from are_ros.conventions import NS_PER_S
from are_ros.simulation.building import Building
from are_ros.simulation.frames import SCAN_FRAME
from are_ros.simulation.mounts import BASE_FROM_SCAN
from are_ros.simulation.odometry import OdometryErrors, WheelOdometry, correction
from are_ros.simulation.robot import Command, DriveLimits, RobotState, drive
from are_ros.simulation.sensors import Lidar, LidarModel
from are_ros.world.laser_scan import LaserScan
from are_ros.world.rigid_transform import RigidTransform

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
