"""Where the robot is going, as artefacts guess it."""

import math

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.behaviours.intent import Point
from are_ros.artefacts.behaviours.situation import RobotView

_OFF_PLAN_M = 1.5
_IS_MOVING_MPS = 0.05
_FOR_EVER_M = 1000.0
_SAMPLE_M = 0.25


class RobotPath:
    """The robot's way from where it is: along its plan, then straight on for ever.

    A plan that passes more than 1.5 m from the robot is an old one: then, and with none, the way is
    straight on, in the direction of its motion, or of its heading while it stands.
    """

    def __init__(self, robot: RobotView) -> None:
        here_m = np.array(robot.point_m)
        points_m = np.vstack((here_m, _rest_of(robot.plan_m, here_m)))
        end_m = points_m[-1] + _FOR_EVER_M * _last_direction(points_m, robot)
        self._points_m = np.vstack((points_m, end_m))
        steps_m = np.diff(self._points_m, axis=0)
        self._lengths_m = np.concatenate(([0.0], np.cumsum(np.hypot(*steps_m.T))))

    def at(self, length_m: float) -> tuple[Point, Point]:
        """Return the point at this length (>= 0) from the robot, and the unit direction there."""
        k = int(np.searchsorted(self._lengths_m, length_m, side="right")) - 1
        k = min(k, len(self._lengths_m) - 2)
        step_m = self._points_m[k + 1] - self._points_m[k]
        along = step_m / np.hypot(*step_m)
        x_m, y_m = (self._points_m[k] + (length_m - self._lengths_m[k]) * along).tolist()
        return (x_m, y_m), (float(along[0]), float(along[1]))

    def distance_m(self, point_m: Point, within_m: float) -> float:
        """Return how far a point is from the first `within_m` of the way, to some centimetres."""
        lengths_m = np.arange(0.0, within_m, _SAMPLE_M)
        x_m = np.interp(lengths_m, self._lengths_m, self._points_m[:, 0])
        y_m = np.interp(lengths_m, self._lengths_m, self._points_m[:, 1])
        return float(np.hypot(x_m - point_m[0], y_m - point_m[1]).min())


def _last_direction(points_m: npt.NDArray[np.float64], robot: RobotView) -> npt.NDArray[np.float64]:
    """Return the unit direction in which the way goes on at its end."""
    if len(points_m) > 1:
        step_m = points_m[-1] - points_m[-2]
        return np.asarray(step_m / np.hypot(*step_m))
    heading_rad = robot.yaw_rad
    if robot.speed_mps > _IS_MOVING_MPS:
        heading_rad = math.atan2(robot.vy_mps, robot.vx_mps)
    return np.array((math.cos(heading_rad), math.sin(heading_rad)))


def _rest_of(
    plan_m: npt.NDArray[np.float64], here_m: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the points (N, 2) of the plan that are still to come, no two in one place."""
    if not len(plan_m):
        return np.empty((0, 2))
    apart_m = np.hypot(*(plan_m - here_m).T)
    nearest = int(apart_m.argmin())
    if apart_m[nearest] > _OFF_PLAN_M:
        return np.empty((0, 2))
    rest_m = plan_m[nearest + 1 :]
    before_m = np.vstack((here_m, rest_m[:-1]))
    return rest_m[np.hypot(*(rest_m - before_m).T) > 1e-3] if len(rest_m) else rest_m
