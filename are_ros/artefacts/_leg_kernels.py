"""Compiled steps of many at once: of all who decide in a sub-step, each by its own values."""

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from numba.typed import List

from are_ros._compiled import compiled
from are_ros.artefacts._step_kernels import (
    CrowdArrays,
    Floats,
    GroundArrays,
    WorthArrays,
    route_step,
)
from are_ros.artefacts.terrain import rolls

STRAIGHT: Final = 3
"""Straight to the goal, which is seen: what `route_steps` finds beside what `route_step` does."""

STRAIGHT_M: Final = 3.0
"""A goal that is seen and no farther than this is gone to without asking for values."""

FOUND: Final = 5
"""Columns of what is found: what `route_step` returns."""


class Ends(NamedTuple):
    """Of who goes where: its radius, the goal, and where the values end, which may be beside it.

    Then what it costs an epoch to be near others, and near the robot.
    """

    radius_m: float
    goal_m: tuple[float, float]
    end_m: tuple[float, float]
    others_price: float
    robot_price: float


CourseArrays = tuple[GroundArrays, WorthArrays, tuple[Any, ...]]
"""The fields of `Ground`, `Worth` and `Ends`."""


@compiled
def list_of(course: CourseArrays) -> Any:
    """Return a list of compiled code with one course in it; all others have arrays like these."""
    courses = List()
    courses.append(course)
    return courses


@compiled
def put(courses: Any, index: int, course: CourseArrays) -> None:
    """Put a course into a list, or at its end."""
    if index == len(courses):
        courses.append(course)
    else:
        courses[index] = course


@compiled
def route_steps(
    courses: Any,
    crowd: CrowdArrays,
    robot: tuple[float, float, float, float],
    asked: npt.NDArray[np.int64],
    found: Floats,
    ways_m: Floats,
) -> None:
    """Find the next step of each who asks: fill in `found` (M, FOUND) and the ways (M, K, 2).

    `asked` (M, 5) is the index of each in the crowd and the number of its course, the epochs left,
    whether it minds others, and whether it goes to a goal that is seen straight however far that
    is. `robot` is for how long ahead others are looked at [s], where the robot is then, and its
    radius; without a robot that is negative.
    """
    for k in range(asked.shape[0]):
        me, course, epochs_left, minds, is_moving_goal = asked[k]
        ground, worth, numbers = courses[course]
        ends = Ends(*numbers)
        x_m, y_m, yaw_rad = crowd[8][me, 0], crowd[8][me, 1], crowd[8][me, 3]
        away_m = np.hypot(ends.goal_m[0] - x_m, ends.goal_m[1] - y_m)
        if (is_moving_goal or away_m <= STRAIGHT_M) and rolls(
            ground[1], ground[2], (x_m, y_m), ends.goal_m, ends.radius_m
        ):
            found[k, 0] = STRAIGHT
            continue
        robot_price = ends.robot_price if minds and robot[3] >= 0.0 else 0.0
        minded = (
            me if minds else -1,
            robot[0],
            ends.others_price,
            robot[1],
            robot[2],
            robot[3] + ends.radius_m,
            robot_price,
        )
        pose = (x_m, y_m, yaw_rad, ends.radius_m)
        found[k, 0], found[k, 1], found[k, 2], found[k, 3], found[k, 4] = route_step(
            ground, worth, crowd, minded, pose, epochs_left, ends.end_m, ways_m[k]
        )
