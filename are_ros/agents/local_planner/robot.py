"""What the planner expects of the robot: to go on as it does for a moment, then to stand."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros._compiled import owning
from are_ros.agents.local_planner.gaps import TOUCH, leap
from are_ros.agents.local_planner.state import NEVER, Floats, RobotPath, X, Y
from are_ros.agents.local_planner.walls import lay_box
from are_ros.world.footprint import Footprint, signed_distances

PREDICTION_S = 1.5


@dataclass(frozen=True)
class RobotMotion:
    """The robot's outline where it is, and how it moves: pose and velocities in the map frame.

    `footprint` is the one at the pose (x, y, yaw); m, rad, m/s and rad/s.
    """

    footprint: Footprint
    x_m: float
    y_m: float
    yaw_rad: float
    vx_mps: float
    vy_mps: float
    yaw_rate: float

    @property
    def speed_mps(self) -> float:
        """The speed of the base [m/s]."""
        return float(np.hypot(self.vx_mps, self.vy_mps))

    @property
    def is_moving(self) -> bool:
        """Whether it drives, or turns on the spot."""
        return self.speed_mps > 0.0 or self.yaw_rate != 0.0

    @property
    def radius_m(self) -> float:
        """The radius of the disc about the base that holds the footprint [m]."""
        corners = self.footprint.vertices_m - (self.x_m, self.y_m)
        return float(np.hypot(corners[:, 0], corners[:, 1]).max()) + self.footprint.radius_m

    def outlines_m(self, step_s: float, count: int) -> npt.NDArray[np.float64]:
        """Return the footprint's vertices (count + 1, V, 2) now and at the next sub-steps.

        The velocity turns with the robot for `PREDICTION_S`, and then it stands.
        """
        times_s = np.minimum(step_s * np.arange(count + 1), PREDICTION_S)
        turns_rad = self.yaw_rate * times_s
        cos, sin = np.cos(turns_rad)[:, None], np.sin(turns_rad)[:, None]
        corners = self.footprint.vertices_m - (self.x_m, self.y_m)
        centres_m = self._centres_m(times_s)
        x = centres_m[:, :1] + cos * corners[:, 0] - sin * corners[:, 1]
        y = centres_m[:, 1:] + sin * corners[:, 0] + cos * corners[:, 1]
        return np.stack((x, y), axis=-1)

    @property
    def swept(self) -> Footprint:
        """The convex hull of where it will be until `PREDICTION_S`; where it is if it stands."""
        if not self.is_moving:
            return self.footprint
        outlines_m = self.outlines_m(0.25 * PREDICTION_S, 4)
        return Footprint(outlines_m.reshape(-1, 2), self.footprint.radius_m)

    def _centres_m(self, times_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the base's places (K, 2) on its arc."""
        half = 0.5 * self.yaw_rate * times_s
        chord_s = times_s * np.sinc(half / np.pi)
        cos, sin = np.cos(half), np.sin(half)
        return np.column_stack(
            (
                self.x_m + chord_s * (cos * self.vx_mps - sin * self.vy_mps),
                self.y_m + chord_s * (sin * self.vx_mps + cos * self.vy_mps),
            )
        )


# Where the robot will be, for the kernels, and how near a path comes to it.


_CLEARANCE = 0.01
_NEAR_ROBOT = 0.6
_INTO_ROBOT = 6.0  # for entering where the robot is predicted to be, the less the later
_LATER = 0.05


def robot_path(robot: RobotMotion | None, step_s: float) -> RobotPath:
    """Return where the robot will be, for the kernels."""
    if robot is None:
        return RobotPath(np.empty((0, 1, 2)), 0.0, 0.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0, 0.0))
    outlines = robot.outlines_m(step_s, round(PREDICTION_S / step_s))
    points = outlines.reshape(-1, 2)
    x, y = (0.5 * (points.min(axis=0) + points.max(axis=0))).tolist()
    radius = robot.footprint.radius_m
    reach = float(np.hypot(points[:, 0] - x, points[:, 1] - y).max()) + radius
    corners = robot.footprint.vertices_m - (robot.x_m, robot.y_m)
    sweep = abs(robot.yaw_rate) * float(np.hypot(corners[:, 0], corners[:, 1]).max())
    pace = (robot.speed_mps + sweep) * step_s
    middle = (outlines[0] / len(corners)).sum(axis=0)
    velocity = ((outlines[1] - outlines[0]) / len(corners)).sum(axis=0) / step_s
    away = outlines[0] - middle
    farthest = float(np.sqrt(away[:, 0] ** 2 + away[:, 1] ** 2).max())
    disc = (*middle.tolist(), *velocity.tolist(), farthest + radius)
    return RobotPath(outlines, radius, x, y, reach, pace, disc)


@owning
def robot_cost(
    path: Floats,
    start: int,
    end: int,
    body: Any,
    comfort: float,
    robot: RobotPath,
    pace: float,
    box: Floats,
) -> tuple[float, bool]:
    """Return what a path costs for its nearness to the robot, and whether it runs into it.

    The path is at index `start` now and ends at `end`; `pace` is its highest speed per sub-step.
    Both places of the robot count, where it is predicted to be, and where it is now; nothing may
    enter the latter, so that costs infinitely. A path that starts too near to it comes no nearer.
    """
    last = robot.outlines.shape[0] - 1
    far = np.hypot(path[start, X] - robot.x, path[start, Y] - robot.y)
    if last < 0 or far > robot.reach + (end - start) * pace + body.radius + comfort:
        return 0.0, False
    least, allowed, predicted, k = comfort, 0.0, NEVER, 0
    while k <= max(end - start, last):
        lay_box(path[min(start + k, end)], body, 0.0, box)
        still = signed_distances(robot.outlines[0], robot.radius, box)[0]
        ahead = signed_distances(robot.outlines[min(k, last)], robot.radius, box)[0]
        near = min(still, ahead)
        least = min(least, max(near, 0.0))
        if k == 0:
            allowed = min(near, _CLEARANCE) - TOUCH
        elif still < allowed:
            return np.inf, True
        if predicted == NEVER and ahead < allowed:
            predicted = k
        k += leap(max(near - comfort, 0.0), pace + robot.pace) if k > 0 else 1
    cost = _NEAR_ROBOT * (1.0 - least / comfort) if least < comfort else 0.0
    if predicted == NEVER:
        return cost, False
    return cost + _INTO_ROBOT - _LATER * min(predicted, 60), True
