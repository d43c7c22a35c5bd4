"""The behaviour leaving: an artefact walks to an exit, at or after the end of its life."""

import math
from typing import ClassVar

import numpy as np

from are_ros.agents.behaviours.situation import WORTH, Intent, Point, Situation, stand
from are_ros.agents.behaviours.walking import arrival_m
from are_ros.conventions import NS_PER_S

_BLOCKED_S = 12.0
_MUCH = 20.0 * WORTH


class Leaving:
    """Walks to the nearest exit, to the next one when it is blocked; `has_left` at any exit.

    Where the map has no exits, destinations take their place: first the one farthest from the
    robot, or from the artefact itself if the robot is unknown.
    """

    name: ClassVar[str] = "leaving"

    def __init__(self) -> None:
        self.has_left = False
        self._goal_m: Point | None = None
        self._tried_m: Point | None = None
        self._unreachable_m: set[Point] = set()
        self._begun_ns = 0

    def decide(self, situation: Situation) -> Intent:
        """Return the intent to walk to an exit, or to stand if it is there or there is no way."""
        self._update(situation)
        if self.has_left:
            return stand("left")
        if self._goal_m is None:
            self._goal_m = self._next_exit(situation)
            self._begun_ns = situation.now_ns
        if self._goal_m is None:
            return stand("no way out")
        speed_mps = situation.row.motion.speed_mps
        return Intent(self._goal_m, speed_mps, arrival_m(situation), activity=self.name)

    def _update(self, situation: Situation) -> None:
        """Evaluate the outcome of the last intent."""
        goal_m = self._goal_m
        if goal_m is None or not situation.wanted(goal_m):
            return
        under_way_s = (situation.now_ns - self._begun_ns) / NS_PER_S
        if situation.has_reached(goal_m) or _is_at_exit(situation):
            self.has_left = True
        elif situation.no_way:
            self._unreachable_m.add(goal_m)
            self._goal_m = None
        elif min(situation.blocked_s, under_way_s) > _BLOCKED_S:
            self._tried_m, self._goal_m = goal_m, None

    def _next_exit(self, situation: Situation) -> Point | None:
        """Return the best reachable exit, except the last one if there is another."""
        open_m = [point for point in _exits(situation) if point not in self._unreachable_m]
        others_m = [point for point in open_m if point != self._tried_m]
        return next(iter(others_m or open_m), None)


class WalkingOut:
    """Walks to an exit out of the robot's sight, and waits there for the end of its life.

    `exit_m` is that exit, None while none is needed. It `is_time` when an epoch spent otherwise
    would make the artefact late; then the behaviour takes the place of others, for good.
    """

    name: ClassVar[str] = Leaving.name

    def __init__(self) -> None:
        self.exit_m: Point | None = None
        self.is_time = False

    def reward(self, situation: Situation) -> float:  # noqa: ARG002 - `is_time` says it
        """Return what walking out is worth: much when it is time, else much less than nothing."""
        return _MUCH if self.is_time else -_MUCH

    def decide(self, situation: Situation) -> Intent:
        """Return the intent to walk to the exit, or to wait there."""
        if self.exit_m is None:
            return stand("no way out")
        if situation.distance_m(self.exit_m) <= arrival_m(situation):
            return stand("at the exit")
        return self.intent(situation)

    def intent(self, situation: Situation) -> Intent:
        """Return the intent to walk to the exit."""
        motion, within_m = situation.row.motion, arrival_m(situation)
        return Intent(self.exit_m, motion.speed_mps, within_m, activity=self.name)


def _is_at_exit(situation: Situation) -> bool:
    """Return whether the artefact is at any exit: others may stand at the one it chose."""
    offsets_m = situation.places.exits_m - np.array(situation.point_m)
    return bool((np.hypot(offsets_m[:, 0], offsets_m[:, 1]) <= arrival_m(situation)).any())


def _exits(situation: Situation) -> list[Point]:
    """Return exits, the nearest first; without any, destinations, the farthest first."""
    exits_m = _points(situation.places.exits_m.tolist())
    if exits_m:
        return sorted(exits_m, key=situation.distance_m)
    origin_m = situation.robot.point_m if situation.robot else situation.point_m
    destinations_m = _points(situation.places.destinations_m.tolist())
    return sorted(destinations_m, key=lambda point: -math.dist(point, origin_m))


def _points(rows: list[list[float]]) -> list[Point]:
    return [(x_m, y_m) for x_m, y_m in rows]
