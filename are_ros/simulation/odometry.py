"""Wheel odometry that drifts, and the correction by which a localiser makes up for it."""

import math
from dataclasses import dataclass

import numpy as np

from are_ros.simulation.robot import RobotState
from are_ros.world.rigid_transform import RigidTransform


@dataclass(frozen=True)
class OdometryErrors:
    """Systematic scale errors, and random ones that grow with the square root of the way."""

    distance_scale: float = 1.01
    angle_scale: float = 0.99
    distance_noise_m: float = 0.01
    """Standard deviation after one metre."""
    angle_noise_rad: float = 0.02
    """Standard deviation after one metre, and after one radian."""


class WheelOdometry:
    """Counts the way of the base from where it started; its frame is the base's at the start."""

    def __init__(self, errors: OdometryErrors, generator: np.random.Generator) -> None:
        self._errors = errors
        self._generator = generator
        self._estimate = RobotState(0.0, 0.0, 0.0)

    @property
    def odom_from_base(self) -> RigidTransform:
        """Where the odometry believes the base to stand."""
        return self._estimate.pose()

    def advance(self, speed_m_s: float, turn_rate_rad_s: float, step_s: float) -> None:
        """Count one step of constant velocity, with its errors."""
        errors = self._errors
        distance_m, angle_rad = speed_m_s * step_s, turn_rate_rad_s * step_s
        first, second = self._generator.standard_normal(2)
        slip_m = errors.distance_noise_m * math.sqrt(abs(distance_m)) * float(first)
        way = abs(distance_m) + abs(angle_rad)
        slip_rad = errors.angle_noise_rad * math.sqrt(way) * float(second)
        self._estimate = self._estimate.moved(
            errors.distance_scale * distance_m + slip_m,
            errors.angle_scale * angle_rad + slip_rad,
        )


def correction(map_from_base: RigidTransform, odom_from_base: RigidTransform) -> RigidTransform:
    """Return map_from_odom: what a localiser publishes that knows where the base stands."""
    return map_from_base @ odom_from_base.inverse()
