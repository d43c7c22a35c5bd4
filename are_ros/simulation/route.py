"""A driver that follows waypoints and looks around at some of them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from are_ros.simulation.robot import Command, DriveLimits, RobotState

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
