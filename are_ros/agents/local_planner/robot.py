"""What the planner expects of the robot: to go on as it does for a moment, then to stand."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, owning
from are_ros.agents.local_planner.gaps import TOUCH, leap
from are_ros.agents.local_planner.state import NEVER, Floats, PlannerTiming, RobotPath
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
        if self.speed_mps == 0.0:
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


def robot_path(robot: RobotMotion | None, step_s: float) -> RobotPath:
    """Return where the robot will be, for the kernels."""
    if robot is None:
        return RobotPath(np.empty((0, 1, 2)), 0.0, 0.0, 0.0, 0.0, 0.0)
    outlines = robot.outlines_m(step_s, round(PREDICTION_S / step_s))
    points = outlines.reshape(-1, 2)
    x, y = (0.5 * (points.min(axis=0) + points.max(axis=0))).tolist()
    radius = robot.footprint.radius_m
    reach = float(np.hypot(points[:, 0] - x, points[:, 1] - y).max()) + radius
    corners = robot.footprint.vertices_m - (robot.x_m, robot.y_m)
    sweep = abs(robot.yaw_rate) * float(np.hypot(corners[:, 0], corners[:, 1]).max())
    pace = (robot.speed_mps + sweep) * step_s
    return RobotPath(outlines, radius, x, y, reach, pace)


@borrowing
def robot_disc(robot: RobotPath, timing: PlannerTiming) -> tuple[float, float, float, float, float]:
    """Return the middle of the robot's corners (x, y), its velocity, and a radius about it."""
    later, corners = 1, robot.outlines.shape[1]
    x, y, ux, uy, radius = 0.0, 0.0, 0.0, 0.0, 0.0
    for v in range(corners):
        here, there = robot.outlines[0, v], robot.outlines[later, v]
        x, y = x + here[0] / corners, y + here[1] / corners
        ux, uy = ux + (there[0] - here[0]) / corners, uy + (there[1] - here[1]) / corners
    for v in range(corners):
        here = robot.outlines[0, v]
        radius = max(radius, np.sqrt((here[0] - x) ** 2 + (here[1] - y) ** 2))
    return x, y, ux / timing.step_s, uy / timing.step_s, radius + robot.radius


@owning
def robot_gap(pose: Floats, body: Any, robot: RobotPath, k: int, box: Floats) -> float:
    """Return the distance of a body at a pose from the robot at sub-step k; negative: overlap."""
    lay_box(pose, body, 0.0, box)
    outline = robot.outlines[min(k, robot.outlines.shape[0] - 1)]
    return float(signed_distances(outline, robot.radius, box)[0])


@borrowing
def robot_conflict(
    path: Floats,
    start: int,
    end: int,
    body: Any,
    robot: RobotPath,
    comfort: float,
    pace: float,
    box: Floats,
) -> tuple[float, int, int]:
    """Return the least gap from the robot, at most `comfort`, and when a path first meets it.

    Two times: where the robot is predicted to be, and where it is now. A path that starts too near
    to the robot comes no nearer to its present place.
    """
    first = robot_gap(path[start], body, robot, 0, box)
    least = max(min(first, comfort), 0.0)
    allowed = min(first, _CLEARANCE) - TOUCH
    until = max(end - start, robot.outlines.shape[0] - 1)
    predicted, present, k = NEVER, NEVER, 1
    while k <= until:
        pose = path[min(start + k, end)]
        still = robot_gap(pose, body, robot, 0, box)
        ahead = robot_gap(pose, body, robot, k, box)
        if present == NEVER and still < allowed:
            present = k
        if predicted == NEVER and ahead < allowed:
            predicted = k
        near = min(still, ahead)
        least = min(least, max(near, 0.0))
        k += leap(max(near - comfort, 0.0), pace)
    return least, predicted, present
