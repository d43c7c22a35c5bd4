"""The behaviour along_way: an artefact walks along waypoints that a scenario gives."""

from typing import ClassVar

from are_ros.agents.behaviours.situation import Intent, Point, Situation, stand
from are_ros.agents.behaviours.walking import arrival_m
from are_ros.conventions import NS_PER_S

_BLOCKED_S = 12.0


class AlongWay:
    """Walks from waypoint to waypoint, once or repeatedly, and stands at the end.

    A waypoint that cannot be reached, or not within 12 s of being blocked, is skipped if another
    one follows.
    """

    name: ClassVar[str] = "along_way"

    def __init__(self, waypoints_m: tuple[Point, ...], *, repeat: bool = False) -> None:
        self._waypoints_m = tuple((float(x_m), float(y_m)) for x_m, y_m in waypoints_m)
        self._repeat = repeat
        self._next = 0
        self._begun_ns: int | None = None

    def decide(self, situation: Situation) -> Intent:
        """Return the intent to go to the next waypoint, or to stand at the end of the way."""
        if self._begun_ns is None:
            self._begun_ns = situation.now_ns
        if self._is_finished(situation):
            self._next += 1
            self._begun_ns = situation.now_ns
        if self._repeat:
            self._next %= len(self._waypoints_m)
        if self._next >= len(self._waypoints_m):
            return stand("at the end")
        goal_m, speed_mps = self._waypoints_m[self._next], situation.row.motion.speed_mps
        return Intent(goal_m, speed_mps, arrival_m(situation), activity="on its way")

    def _is_finished(self, situation: Situation) -> bool:
        """Return whether the present waypoint is reached, or to be skipped."""
        if self._next >= len(self._waypoints_m):
            return False
        goal_m = self._waypoints_m[self._next]
        if not situation.wanted(goal_m):
            return False
        under_way_s = (situation.now_ns - (self._begun_ns or 0)) / NS_PER_S
        is_stuck = situation.no_way or min(situation.blocked_s, under_way_s) > _BLOCKED_S
        is_last = not self._repeat and self._next == len(self._waypoints_m) - 1
        return situation.has_reached(goal_m) or (is_stuck and not is_last)
