"""Compiled steps of many at once: of all who decide in a sub-step, each by its own values."""

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from numba.typed import List

from are_ros._compiled import compiled
from are_ros.artefacts._ground_kernels import Ground
from are_ros.artefacts._step_kernels import (
    CrowdArrays,
    Floats,
    GroundArrays,
    Minded,
    Worth,
    WorthArrays,
    crowd_of,
    find_step,
    scratch_for,
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
def drop(courses: Any, index: int) -> None:
    """Put item 0, which is no course, in the place of a course, or it would keep its arrays."""
    courses[index] = courses[0]


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
    everybody = crowd_of(crowd)
    scratch = scratch_for(everybody.poses.shape[0])
    for k in range(asked.shape[0]):
        me, minds, is_moving_goal = asked[k, 0], asked[k, 3], asked[k, 4]
        ground_arrays, worth_arrays, numbers = courses[asked[k, 1]]
        ground, worth, ends = Ground(*ground_arrays), Worth(*worth_arrays), Ends(*numbers)
        x_m, y_m = everybody.poses[me, 0], everybody.poses[me, 1]
        yaw_rad = everybody.poses[me, 3]
        away_m = np.hypot(ends.goal_m[0] - x_m, ends.goal_m[1] - y_m)
        if (is_moving_goal or away_m <= STRAIGHT_M) and rolls(
            ground.clearance_m, ground.lattice, (x_m, y_m), ends.goal_m, ends.radius_m
        ):
            found[k, 0] = STRAIGHT
            continue
        robot_price = ends.robot_price if minds and robot[3] >= 0.0 else 0.0
        minded = Minded(
            me if minds else -1,
            robot[0],
            ends.others_price,
            robot[1],
            robot[2],
            robot[3] + ends.radius_m,
            robot_price,
        )
        pose = (x_m, y_m, yaw_rad, ends.radius_m)
        step = find_step(
            ground, worth, everybody, minded, pose, asked[k, 2], ends.end_m, ways_m[k], scratch
        )
        found[k, 0], found[k, 1], found[k, 2], found[k, 3], found[k, 4] = step
