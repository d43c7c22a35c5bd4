"""A robot that drives about on a map, as an experiment's stand-in for a real one."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.randomness import Purpose, generator
from are_ros.builder.outputs import ArtefactState
from are_ros.errors import MapError
from are_ros.world.environment import Environment

_ROBOT_MPS = 0.5
_LOOK_AHEAD_M = 0.9
_ROOM_M = 0.15
_PATIENCE_S = 8.0


class RovingRobot:
    """Drives straight from point to point that it sees; every other time it stops for artefacts.

    Raises MapError where it fits nowhere.
    """

    def __init__(self, environment: Environment, radius_m: float, seed: int) -> None:
        self._environment = environment
        self._radius_m = radius_m
        self._random = generator(seed, Purpose.REQUEST, 0)
        self._points_m = _open_points(environment, radius_m)
        self.x_m, self.y_m = self._points_m[0].tolist()
        self.yaw_rad = 0.0
        self._goal = (self.x_m, self.y_m)
        self._is_careful = True
        self._waited_s = 0.0

    def drive(self, dt_s: float, states: Sequence[ArtefactState]) -> None:
        """Go on for one sub-step."""
        if math.dist((self.x_m, self.y_m), self._goal) < 0.05 or self._waited_s > _PATIENCE_S:
            self._choose()
        heading = math.atan2(self._goal[1] - self.y_m, self._goal[0] - self.x_m)
        turn = math.remainder(heading - self.yaw_rad, math.tau)
        self.yaw_rad += max(-1.5 * dt_s, min(1.5 * dt_s, turn))
        if abs(turn) > 0.1:
            return
        if self._is_careful and self._is_blocked(states):
            self._waited_s += dt_s
            return
        way_m = min(_ROBOT_MPS * dt_s, math.dist((self.x_m, self.y_m), self._goal))
        self.x_m += way_m * math.cos(heading)
        self.y_m += way_m * math.sin(heading)

    def _choose(self) -> None:
        """Take another goal that is seen, if one is found; what it waited for is forgotten."""
        self._waited_s = 0.0
        here = np.array((self.x_m, self.y_m))
        for _ in range(30):
            goal = self._points_m[int(self._random.integers(len(self._points_m)))]
            count = max(2, int(math.dist(here, goal) / 0.05))
            way = here + np.linspace(0.0, 1.0, count)[:, None] * (goal - here)
            if (self._environment.lookup(way) > self._radius_m + 0.1).all():
                self._goal = (float(goal[0]), float(goal[1]))
                self._is_careful = not self._is_careful
                return

    def _is_blocked(self, states: Sequence[ArtefactState]) -> bool:
        ahead = (
            self.x_m + _LOOK_AHEAD_M * math.cos(self.yaw_rad),
            self.y_m + _LOOK_AHEAD_M * math.sin(self.yaw_rad),
        )
        return any(
            math.dist(ahead, (s.ground_pose.x_m, s.ground_pose.y_m)) < _LOOK_AHEAD_M for s in states
        )


def _open_points(environment: Environment, radius_m: float) -> npt.NDArray[np.float64]:
    """Return up to 500 points of the largest part of the map where the robot fits."""
    import cv2

    open_cells = environment.clearance_m > radius_m + _ROOM_M
    if not open_cells.any():
        raise MapError("the robot fits nowhere on the map")
    _, labels, stats, _ = cv2.connectedComponentsWithStats(open_cells.view(np.uint8))
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    cells = np.argwhere(labels == largest)
    chosen = cells[:: max(1, len(cells) // 500)]
    middle = chosen[np.argsort(np.abs(chosen - chosen.mean(axis=0)).sum(axis=1), kind="stable")]
    return environment.grid.cells_to_points(middle)
