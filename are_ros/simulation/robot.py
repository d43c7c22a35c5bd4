"""A robot with differential drive: where it stands, how fast it may change that."""

import math
from dataclasses import dataclass
from typing import Final

from are_ros.world.rigid_transform import RigidTransform

ROBOT_RADIUS_M: Final = 0.22
"""Of the round base."""


@dataclass(frozen=True)
class Command:
    """What the drive is asked for: forward speed [m/s] and turn rate [rad/s], left positive."""

    speed_m_s: float = 0.0
    turn_rate_rad_s: float = 0.0


@dataclass(frozen=True)
class DriveLimits:
    """The largest speed, turn rate and their changes; all positive."""

    speed_m_s: float = 0.6
    turn_rate_rad_s: float = 1.2
    acceleration_m_s2: float = 0.6
    turn_acceleration_rad_s2: float = 2.5


@dataclass(frozen=True)
class RobotState:
    """Pose of the base in a fixed frame, heading not wrapped, and its velocity."""

    x_m: float
    y_m: float
    yaw_rad: float
    speed_m_s: float = 0.0
    turn_rate_rad_s: float = 0.0

    def pose(self) -> RigidTransform:
        """Return the base in the fixed frame, on its floor."""
        return RigidTransform.planar(self.x_m, self.y_m, self.yaw_rad)

    def moved(self, distance_m: float, angle_rad: float) -> "RobotState":
        """Return the state after an arc of a length that turns by an angle; same velocity."""
        half = 0.5 * angle_rad
        chord_m = distance_m * (math.sin(half) / half if half else 1.0)
        return RobotState(
            self.x_m + chord_m * math.cos(self.yaw_rad + half),
            self.y_m + chord_m * math.sin(self.yaw_rad + half),
            self.yaw_rad + angle_rad,
            self.speed_m_s,
            self.turn_rate_rad_s,
        )


def drive(state: RobotState, command: Command, limits: DriveLimits, step_s: float) -> RobotState:
    """Return the state one step later: the velocity nears the command, then the base moves.

    Commands beyond the limits are cut, reverse speed too. Over the step the velocity is constant.
    """
    speed = _approach(
        state.speed_m_s, command.speed_m_s, limits.speed_m_s, limits.acceleration_m_s2 * step_s
    )
    turn_rate = _approach(
        state.turn_rate_rad_s,
        command.turn_rate_rad_s,
        limits.turn_rate_rad_s,
        limits.turn_acceleration_rad_s2 * step_s,
    )
    faster = RobotState(state.x_m, state.y_m, state.yaw_rad, speed, turn_rate)
    return faster.moved(speed * step_s, turn_rate * step_s)


def _approach(value: float, target: float, bound: float, change: float) -> float:
    """Return the value moved towards the target, cut to [-bound, bound], by at most `change`."""
    wanted = min(max(target, -bound), bound)
    return min(max(wanted, value - change), value + change)
