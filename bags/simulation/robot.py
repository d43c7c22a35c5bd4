"""A robot with differential drive: where it stands, how fast it may change that."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

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


# Wheel odometry that drifts, and the correction by which a localiser makes up for it.


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


# A driver that follows waypoints and looks around at some of them.


_PASSED_M: Final = 0.25
_REACHED_M: Final = 0.03
_FACING_RAD: Final = 0.03
_TURN_FIRST_RAD: Final = 0.5
_HEADING_GAIN: Final = 2.5
_BRAKING: Final = 0.75
"""Part of the largest deceleration that is planned with; the rest is for errors."""


class Driver(Protocol):
    """What steers a robot."""

    def command(self, state: RobotState) -> Command:
        """Return what the drive is to do next."""


@dataclass(frozen=True)
class Waypoint:
    """A point to drive to in the map frame, then headings to turn to one after another there.

    Without headings the robot passes by within 0.25 m and does not stop.
    """

    x_m: float
    y_m: float
    looks_rad: tuple[float, ...] = ()


@dataclass(frozen=True)
class _Look:
    """A heading to turn to on the spot."""

    yaw_rad: float


class RouteFollower:
    """A `Driver` along waypoints, at the speed that the limits allow; at the end it stands."""

    def __init__(self, waypoints: Sequence[Waypoint], limits: DriveLimits) -> None:
        self._limits = limits
        self._tasks: list[Waypoint | _Look] = []
        for waypoint in waypoints:
            self._tasks += [waypoint, *map(_Look, waypoint.looks_rad)]
        self._next = 0

    @property
    def is_done(self) -> bool:
        """Tell whether the last waypoint and its headings are behind."""
        return self._next == len(self._tasks)

    def command(self, state: RobotState) -> Command:
        """Return what the drive is to do next."""
        while not self.is_done and self._is_reached(self._tasks[self._next], state):
            self._next += 1
        if self.is_done:
            return Command()
        task = self._tasks[self._next]
        if isinstance(task, _Look):
            return self._turn(_wrapped(task.yaw_rad - state.yaw_rad))
        return self._approach(task, state)

    def _is_reached(self, task: Waypoint | _Look, state: RobotState) -> bool:
        if isinstance(task, _Look):
            return abs(_wrapped(task.yaw_rad - state.yaw_rad)) < _FACING_RAD
        return _distance_m(task, state) < (_REACHED_M if self._stops_at(task) else _PASSED_M)

    def _stops_at(self, waypoint: Waypoint) -> bool:
        return bool(waypoint.looks_rad) or waypoint is self._tasks[-1]

    def _approach(self, waypoint: Waypoint, state: RobotState) -> Command:
        """Turn towards the waypoint on the spot, or drive and correct the heading on the way."""
        bearing = math.atan2(waypoint.y_m - state.y_m, waypoint.x_m - state.x_m)
        error = _wrapped(bearing - state.yaw_rad)
        if abs(error) > _TURN_FIRST_RAD:
            return self._turn(error)
        speed = self._limits.speed_m_s * math.cos(2 * error)
        if self._stops_at(waypoint):
            brake = _BRAKING * self._limits.acceleration_m_s2
            speed = min(speed, math.sqrt(2 * brake * _distance_m(waypoint, state)))
        return Command(speed, _HEADING_GAIN * error)

    def _turn(self, error_rad: float) -> Command:
        """Turn on the spot, as fast as still leaves room to brake."""
        brake = _BRAKING * self._limits.turn_acceleration_rad_s2
        rate = math.sqrt(2 * brake * abs(error_rad))
        rate = min(rate, self._limits.turn_rate_rad_s)
        return Command(0.0, math.copysign(rate, error_rad))


def _distance_m(waypoint: Waypoint, state: RobotState) -> float:
    return math.hypot(waypoint.x_m - state.x_m, waypoint.y_m - state.y_m)


def _wrapped(angle_rad: float) -> float:
    """Return the angle in [-pi, pi]."""
    return math.remainder(angle_rad, 2 * math.pi)
