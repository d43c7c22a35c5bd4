"""The behaviour along_way: an artefact walks along waypoints that a scenario gives."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from are_ros.agents.behaviours.situation import Intent, Point, Situation, stand
from are_ros.agents.behaviours.walking import arrival_m
from are_ros.conventions import NS_PER_S
from are_ros.errors import CatalogueError

_OPTIONS = ("waypoints", "repeat")
_BLOCKED_S = 12.0


class AlongWay:
    """Walks from waypoint to waypoint, once or repeatedly, and stands at the end.

    A waypoint that cannot be reached, or not within 12 s of being blocked, is skipped if another
    one follows.
    """

    name: ClassVar[str] = "along_way"

    def __init__(self, waypoints_m: tuple[Point, ...], *, repeat: bool = False) -> None:
        self._waypoints_m = waypoints_m
        self._repeat = repeat
        self._next = 0
        self._begun_ns: int | None = None

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> "AlongWay":
        """Return the behaviour of options `waypoints` ([[x, y], ...], m) and `repeat` (false).

        CatalogueError, one sentence, if they are not that.
        """
        unknown = sorted(str(key) for key in options if key not in _OPTIONS)
        if unknown:
            msg = f"{cls.name} has no option {unknown[0]!r}; it has {', '.join(_OPTIONS)}"
            raise CatalogueError(msg)
        repeat = options.get("repeat", False)
        if not isinstance(repeat, bool):
            raise CatalogueError(f"{cls.name}: repeat is {repeat!r}, not true or false")
        return cls(_waypoints(options.get("waypoints")), repeat=repeat)

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


def _waypoints(given: object) -> tuple[Point, ...]:
    if not isinstance(given, list | tuple) or not given:
        raise CatalogueError(f"{AlongWay.name} needs waypoints, a list of [x, y]")
    for number, point in enumerate(given):
        if not _is_point(point):
            msg = f"{AlongWay.name}: waypoints[{number}] is {point!r}, not two finite numbers"
            raise CatalogueError(msg)
    return tuple((float(x_m), float(y_m)) for x_m, y_m in given)


def _is_point(given: object) -> bool:
    return (
        isinstance(given, list | tuple)
        and len(given) == 2
        and all(isinstance(v, int | float) and not isinstance(v, bool) for v in given)
        and all(math.isfinite(v) for v in given)
    )
