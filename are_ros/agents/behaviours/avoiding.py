"""The behaviour avoiding: an artefact keeps away from the robot."""

import math
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.situation import WORTH, Intent, Point, RobotView, Situation, stand
from are_ros.agents.behaviours.walking import Walking, any_destination
from are_ros.world.rigid_transform import product

_NEAR_M, _FAR_M = 4.0, 6.0
"""The artefact moves away from a robot nearer than the first, until it is at the second."""
_STEP_M = 2.5
_TURNS_RAD = tuple(math.radians(turn) for turn in (0.0, 30.0, -30.0, 60.0, -60.0, 85.0, -85.0))
_ROBOT_COMFORT_M = 1.5
_HURRY = 1.3
_AVOIDING, _CORNERED = "avoiding", "cornered"

_Points = npt.NDArray[np.float64]


class Avoiding:
    """Walks to destinations away from the robot, and retreats when the robot is nearer than 4 m.

    It retreats on a straight line, at most 85 degrees off the direction away from the robot, so it
    never comes nearer. Where walls leave no such line, it stands, and avoiding is worth nothing.
    """

    name: ClassVar[str] = "avoiding"

    def __init__(self) -> None:
        self._walk = Walking(_far_from_robot)

    def reward(self, situation: Situation) -> float:
        """Return what avoiding is worth: much while the robot is near."""
        robot = situation.robot
        if robot is None or _was(situation, _CORNERED) or not _is_near(robot, situation):
            return 0.0
        return 3.0 * WORTH

    def decide(self, situation: Situation) -> Intent:
        """Return the intent to retreat from the robot, or to walk on."""
        robot = situation.robot
        if robot is None:
            return self._walk.decide(situation)
        if _is_near(robot, situation):
            return self._retreat(robot, situation)
        if _was(situation, _AVOIDING, _CORNERED):
            self._walk.change_destination()
        return self._walk.decide(situation)

    @staticmethod
    def _retreat(robot: RobotView, situation: Situation) -> Intent:
        motion = situation.row.motion
        goal_m = _retreat_point(robot, situation)
        if goal_m is None:
            return stand(_CORNERED, robot.point_m)
        return Intent(
            goal_m,
            min(_HURRY * motion.speed_mps, motion.top_speed_mps),
            activity=_AVOIDING,
            is_moving_goal=True,
            robot_comfort_m=_ROBOT_COMFORT_M,
        )


def _was(situation: Situation, *activities: str) -> bool:
    """Return whether the last intent had one of these activities."""
    return situation.last is not None and situation.last.activity in activities


def _is_near(robot: RobotView, situation: Situation) -> bool:
    """Return whether the robot is too near; one that retreats goes on to the greater distance."""
    limit_m = _FAR_M if _was(situation, _AVOIDING, _CORNERED) else _NEAR_M
    return situation.distance_m(robot.point_m) < limit_m


def _retreat_point(robot: RobotView, situation: Situation) -> Point | None:
    """Return a point with a straight way to it, away from the robot; None if walls leave none."""
    away_rad = math.atan2(situation.me.y_m - robot.y_m, situation.me.x_m - robot.x_m)
    for step_m in (_STEP_M, 0.4 * _STEP_M):
        for turn_rad in _TURNS_RAD:
            heading_rad = away_rad + turn_rad
            x_m = situation.me.x_m + step_m * math.cos(heading_rad)
            y_m = situation.me.y_m + step_m * math.sin(heading_rad)
            if situation.sees(x_m, y_m):
                return x_m, y_m
    return None


def _far_from_robot(situation: Situation, is_shut: npt.NDArray[np.bool_]) -> int | None:
    """Draw a destination whose straight line passes the robot at a distance, or leads away."""
    if situation.robot is None:
        return any_destination(situation, is_shut)
    robot_m = np.array(situation.robot.point_m)
    apart_m = situation.distance_m(situation.robot.point_m)
    passing_m = _distances_from_ways(
        robot_m, np.array(situation.point_m), situation.places.destinations_m
    )
    is_near = passing_m < min(_NEAR_M + 1.0, apart_m - 0.1)
    return any_destination(situation, is_shut | is_near)


def _distances_from_ways(point_m: _Points, start_m: _Points, ends_m: _Points) -> _Points:
    """Return the distances (K,) [m] of a point from the segments from a start to ends (K, 2)."""
    ways_m = ends_m - start_m
    squares = np.maximum((ways_m**2).sum(axis=1), 1e-12)
    shares = np.clip(product(ways_m, point_m - start_m) / squares, 0.0, 1.0)
    apart_m = start_m + shares[:, None] * ways_m - point_m
    return np.asarray(np.hypot(apart_m[:, 0], apart_m[:, 1]))
