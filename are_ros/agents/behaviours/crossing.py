"""The behaviour crossing: an artefact repeatedly crosses the robot's path in front of it."""

import math
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.situation import (
    WORTH,
    ExpectedPath,
    Intent,
    Point,
    RobotView,
    Situation,
    stand,
)
from are_ros.agents.behaviours.walking import Walking, any_destination, end_of_pause, least
from are_ros.conventions import NS_PER_S

_NEAR_M = 12.0
_AHEAD_M = (1.5, 2.5, 4.0, 6.0, 8.0)
"""Distances in front of the robot at which to cross: the first that is reached in time."""
_MARGIN_S = 1.0
_BEYOND_M = (2.0, 1.2)
_BLOCKED_S = 3.0
_LONGEST_S = 12.0
_OFF_PATH_M = 1.0
_STANDS_MPS = 0.05
_ROBOT_COMFORT_M = 0.2
_APPROACH_NS = 5 * NS_PER_S
_ASIDE_NS = 6 * NS_PER_S


class Crossing:
    """Crosses the path of the robot in front of it, pauses on the other side, and comes back.

    The path is an `ExpectedPath`. The artefact crosses as near in front of the robot as it can
    while it gets there a second earlier. If the robot is far away (12 m) or walls are in between,
    it walks to the destination nearest to a point ahead of the robot; without a robot to any.
    """

    name: ClassVar[str] = "crossing"

    def __init__(self) -> None:
        self._walk = Walking(self._destination)
        self._goal_m: Point | None = None
        self._middle_m: Point = (0.0, 0.0)
        self._begun_ns = 0
        self._approach_ns = 0
        self._aside_ns = 0
        self._paused_until_ns = 0

    def reward(self, situation: Situation) -> float:
        """Return what crossing is worth: something while the robot is near, most on the way."""
        robot = situation.robot
        if robot is None or situation.distance_m(robot.point_m) > _NEAR_M:
            return -WORTH
        return WORTH if self._goal_m is None else 2.0 * WORTH

    def decide(self, situation: Situation) -> Intent:
        """Return the intent to cross, to pause after crossing, or to approach."""
        robot = situation.robot
        if robot is None:
            self._goal_m = None
            return self._walk.decide(situation)
        if situation.has_reached(self._goal_m):
            self._goal_m = None
            self._paused_until_ns = end_of_pause(situation)
        if situation.now_ns < self._paused_until_ns:
            return stand("pausing", robot.point_m)
        path = robot.path
        if self._goal_m is not None and self._is_over(robot, situation):
            self._goal_m = None
        if self._goal_m is None and situation.now_ns >= self._aside_ns:
            self._choose_goal(path, robot, situation)
        if self._goal_m is None:
            return self._approach(situation)
        return self._cross(self._goal_m, situation)

    def _cross(self, goal_m: Point, situation: Situation) -> Intent:
        return Intent(
            goal_m,
            situation.row.motion.speed_mps,
            activity="crossing",
            is_moving_goal=True,
            robot_comfort_m=_ROBOT_COMFORT_M,
        )

    def _is_over(self, robot: RobotView, situation: Situation) -> bool:
        """Return whether the crossing is over: the robot has passed or turned, or it is blocked.

        Before a robot that stands it goes on: one that turned on the spot would be circled.
        """
        drives = robot.speed_mps > _STANDS_MPS
        is_off = drives and robot.path.distance_m(self._middle_m, _NEAR_M) > _OFF_PATH_M
        under_way_s = (situation.now_ns - self._begun_ns) / NS_PER_S
        is_stuck = min(situation.blocked_s, under_way_s) > _BLOCKED_S
        is_stuck |= situation.no_way or under_way_s > _LONGEST_S
        if is_stuck:  # walk elsewhere for a while, or the same attempt would repeat
            self._aside_ns = situation.now_ns + _ASIDE_NS
            self._walk.change_destination()
        return is_stuck or is_off

    def _choose_goal(self, path: ExpectedPath, robot: RobotView, situation: Situation) -> None:
        """Set the goal to a visible point across the path, or to None."""
        self._goal_m = None
        if situation.distance_m(robot.point_m) > _NEAR_M:
            return
        bodies_m = robot.radius_m + situation.me.radius_m
        for ahead_m in _AHEAD_M:
            middle_m, along = path.at(ahead_m + bodies_m)
            way_s = situation.distance_m(middle_m) / situation.row.motion.speed_mps + _MARGIN_S
            if ahead_m < robot.speed_mps * way_s and ahead_m < _AHEAD_M[-1]:
                continue
            goal_m = _across(middle_m, along, bodies_m, situation)
            if goal_m is not None:
                self._goal_m, self._middle_m = goal_m, middle_m
                self._begun_ns = situation.now_ns
                return

    def _approach(self, situation: Situation) -> Intent:
        """Walk to the robot's path; choose the destination anew every 5 s."""
        if situation.now_ns >= self._approach_ns + _APPROACH_NS:
            self._approach_ns = situation.now_ns
            self._walk.forget_destination()
        return self._walk.decide(situation)

    @staticmethod
    def _destination(situation: Situation, is_shut: npt.NDArray[np.bool_]) -> int | None:
        """Return the destination nearest to a point some metres ahead of the robot."""
        if situation.robot is None:
            return any_destination(situation, is_shut)
        ahead_m, _ = situation.robot.path.at(_AHEAD_M[2])
        offsets_m = situation.places.destinations_m - np.array(ahead_m)
        return least(np.where(is_shut, np.inf, (offsets_m**2).sum(axis=1)))


def _across(middle_m: Point, along: Point, bodies_m: float, situation: Situation) -> Point | None:
    """Return a visible point on the other side of the path, None if there is none."""
    left = (-along[1], along[0])
    offset_m = (situation.me.x_m - middle_m[0]) * left[0]
    offset_m += (situation.me.y_m - middle_m[1]) * left[1]
    side = -math.copysign(1.0, offset_m)
    for beyond_m in _BEYOND_M:
        reach_m = side * (beyond_m + bodies_m)
        goal_m = (middle_m[0] + reach_m * left[0], middle_m[1] + reach_m * left[1])
        if situation.sees(*goal_m):
            return goal_m
    return None
