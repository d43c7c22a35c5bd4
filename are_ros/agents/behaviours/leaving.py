"""The behaviour leaving: an artefact walks to an exit, at or after the end of its life."""

import math
from collections.abc import Callable, Sequence
from typing import ClassVar, Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.situation import Intent, Point, Situation, stand
from are_ros.agents.behaviours.walking import arrival_m
from are_ros.agents.navigation.destinations import Destinations
from are_ros.conventions import NS_PER_S

EARLY_S: Final = 5.0
"""Artefacts that have to be at an exit at the end of their lives mean to be there by so much."""

Hides = Callable[[npt.NDArray[np.float64]], npt.NDArray[np.bool_]]
"""Tells at which points (N, 2) [m], map frame, no camera would see a person: bool (N,)."""

_BLOCKED_S = 12.0

_DETOUR: Final = 1.5
"""The way to an exit is taken to be longer than the straight line by this factor."""

_BEARINGS_RAD: Final = np.arange(16) * (math.tau / 16.0)
_RING: Final = np.stack([np.cos(_BEARINGS_RAD), np.sin(_BEARINGS_RAD)], axis=1)
_RINGS_M: Final = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0)
"""Where one whose time is short looks for a place out of sight: on rings around it."""


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
    would make the artefact late; then no other behaviour is drawn any more.
    """

    name: ClassVar[str] = Leaving.name

    def __init__(self) -> None:
        self.exit_m: Point | None = None
        self.is_time = False

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


def early_s(situation: Situation) -> float:
    """Return how long it is until an artefact means to be at an exit [s]; inf if not known."""
    return math.inf if situation.left_s is None else situation.left_s - EARLY_S


def choose_exits(leaving: Sequence[tuple[WalkingOut, Situation]], hides: Hides) -> None:
    """Choose exits of artefacts, given their situations, if the last is in view or too far away.

    The exit is the nearest one that no camera sees, if there is time to get there. Else it is where
    no camera sees the artefact: where it stands, or the nearest point to which it has a straight
    way, or the last one, or the nearest exit or destination.
    """
    known = [way_out for way_out, _ in leaving if way_out.exit_m is not None]
    lasts_m = np.array([way_out.exit_m for way_out in known]).reshape(-1, 2)
    for way_out, is_hidden in zip(known, hides(lasts_m), strict=True):
        if not is_hidden:
            way_out.exit_m = None
    hidden_m = dict[Destinations, tuple[list[Point], list[Point]]]()
    for way_out, situation in leaving:
        away_m, reach_m = situation.distance_m, _reach_m(situation)
        if way_out.exit_m is not None and away_m(way_out.exit_m) <= reach_m:
            continue
        places = situation.places
        if places not in hidden_m:
            hidden_m[places] = (
                _hidden(places.exits_m, hides),
                _hidden(places.destinations_m, hides),
            )
        exits_m, destinations_m = hidden_m[places]
        near_m = min(exits_m, key=away_m, default=None)
        if near_m is None or away_m(near_m) > reach_m:
            near_m = _refuge_m(situation, hides) or way_out.exit_m
        way_out.exit_m = near_m or min([*exits_m, *destinations_m], key=away_m, default=None)


def _reach_m(situation: Situation) -> float:
    """Return how far one gets until it means to be at an exit [m]; inf if that is not known."""
    motion = situation.row.motion
    return early_s(situation) * motion.speed_mps * motion.running_factor / _DETOUR


def _refuge_m(situation: Situation, hides: Hides) -> Point | None:
    """Return the nearest point with a straight way to it that no camera sees, None without any."""
    if hides(np.array([situation.point_m]))[0]:
        return situation.point_m
    for radius_m in _RINGS_M:
        ring_m = _points((radius_m * _RING + situation.point_m).tolist())
        seen_m = [point for point in ring_m if situation.sees(*point)]
        if hidden_m := _hidden(np.array(seen_m).reshape(-1, 2), hides):
            return hidden_m[0]
    return None


def _hidden(points_m: npt.NDArray[np.float64], hides: Hides) -> list[Point]:
    return _points(points_m[hides(points_m)].tolist())


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
