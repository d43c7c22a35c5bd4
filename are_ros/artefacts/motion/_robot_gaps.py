"""Where the robot will be, for the kernels, and how near a path comes to it."""

from typing import Any

import numpy as np

from are_ros.artefacts.motion._borrowing import borrowing, owning
from are_ros.artefacts.motion._gaps import TOUCH, leap
from are_ros.artefacts.motion._state import NEVER, Floats, RobotPath
from are_ros.artefacts.motion._walls import lay_box
from are_ros.artefacts.motion.robot import PREDICTION_S, RobotMotion
from are_ros.world.footprint import signed_distances

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

    Twice: where it is predicted to be, and where it is now. Who is too near already comes no nearer
    to where it is now, and as to where it will be, nothing can be asked.
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
