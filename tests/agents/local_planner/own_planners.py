"""Planners of a user's own, named as `module:Class`."""

import math
from collections.abc import Sequence
from typing import Any, ClassVar

from are_ros.agents.local_planner.user_planners import PlanningScene, Wish

MODULE = "tests.agents.local_planner.own_planners"


class Rammer:
    """Drives into the nearest other at full speed, or into the robot, or the goal."""

    name: ClassVar[str] = "rammer"

    def propose(self, scene: PlanningScene) -> Sequence[Wish]:
        """Propose nothing else."""
        prey = (scene.robot, *scene.others)
        x_m, y_m = next(((one.x_m, one.y_m) for one in prey if one), scene.goal_m)
        return [(math.atan2(y_m - scene.me.y_m, x_m - scene.me.x_m), 9.0)]


class Sideways:
    """Goes to the goal, but to the left first; reverses where it cannot."""

    name: ClassVar[str] = "sideways"

    def __init__(self) -> None:
        self.asked = 0

    def propose(self, scene: PlanningScene) -> Sequence[Wish]:
        """Prefer the left for its first three seconds."""
        self.asked += 1
        x_m, y_m = scene.goal_m
        ahead = math.atan2(y_m - scene.me.y_m, x_m - scene.me.x_m)
        left = ahead + 0.5 * math.pi if self.asked <= 6 else ahead
        return ((left, scene.speed_mps), (ahead, scene.speed_mps), (scene.yaw_rad, -0.5))


class Late:
    """Raises when it is asked for the third time."""

    name: ClassVar[str] = "late"

    def __init__(self) -> None:
        self._asked = 0

    def propose(self, scene: PlanningScene) -> Sequence[Wish]:
        """Go ahead."""
        self._asked += 1
        if self._asked == 3:
            raise ValueError("late boom")
        return [(scene.yaw_rad, scene.speed_mps)]


class Returns:
    """Returns what its class says."""

    name: ClassVar[str] = "returns"
    what: ClassVar[Any] = None

    def propose(self, scene: PlanningScene) -> Any:  # noqa: ARG002 - it never changes its mind
        """Return that."""
        return self.what


class Looks:
    """Keeps what it saw last, and proposes nothing."""

    name: ClassVar[str] = "looks"
    seen: ClassVar[PlanningScene]

    def propose(self, scene: PlanningScene) -> Sequence[Wish]:
        """Look."""
        type(self).seen = scene
        return ()


class NoMethod:
    """Is no planner."""

    name: ClassVar[str] = "none"
