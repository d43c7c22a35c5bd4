"""The behaviour leaving: an artefact walks to an exit, at or after the end of its life."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.situation import Intent, Point, Situation, stand
from are_ros.agents.behaviours.walking import arrival_m
from are_ros.conventions import NS_PER_S

if TYPE_CHECKING:
    from are_ros.agents.navigation.destinations import Destinations

EARLY_S: Final = 5.0
"""So long before the end of its life [s] an artefact wants to be at its exit."""

Hides = Callable[[npt.NDArray[np.float64]], npt.NDArray[np.bool_]]
"""Tells at which points (N, 2) [m], map frame, no camera would see a person: bool (N,)."""

_BLOCKED_S = 12.0

_DETOUR: Final = 1.5
"""The way to an exit is taken to be longer than the straight line by this factor."""

_BEARINGS_RAD: Final = np.arange(16) * (math.tau / 16.0)
_RING: Final = np.stack([np.cos(_BEARINGS_RAD), np.sin(_BEARINGS_RAD)], axis=1)
_RADII_M: Final = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0)
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
    would make the artefact late; then no other behaviour is drawn any more. No way was found to
    `unreachable_m`; they are tried again when no other place is left.
    """

    name: ClassVar[str] = Leaving.name

    def __init__(self) -> None:
        self.exit_m: Point | None = None
        self.unreachable_m: set[Point] = set()
        self.is_time = False

    def give_up(self) -> None:
        """Look for another exit, because no way leads to this one."""
        if self.exit_m is not None:
            self.unreachable_m.add(self.exit_m)
            self.exit_m = None

    def decide(self, situation: Situation) -> Intent:
        """Return the intent to walk to the exit, or to wait there."""
        if self.exit_m is None:
            return stand("no way out")
        if situation.distance_m(self.exit_m) <= arrival_m(situation):
            return stand("at the exit")
        return self.intent(situation)

    def is_late_after(self, situation: Situation, wait_s: float) -> bool:
        """Return whether the exit is too far to walk there after a while [s] spent otherwise."""
        motion = situation.row.motion
        speed_mps = motion.speed_mps * min(1.0, motion.running_factor / _DETOUR)
        left_s = early_s(situation) - wait_s
        return self.exit_m is not None and situation.distance_m(self.exit_m) > speed_mps * left_s

    def intent(self, situation: Situation) -> Intent:
        """Return the intent to walk to the exit."""
        motion, within_m = situation.row.motion, arrival_m(situation)
        return Intent(self.exit_m, motion.speed_mps, within_m, activity=self.name)


def early_s(situation: Situation) -> float:
    """Return how long it is until an artefact means to be at an exit [s]; inf if not known."""
    return math.inf if situation.left_s is None else situation.left_s - EARLY_S


def choose_exits(leaving: Sequence[tuple[WalkingOut, Situation]], hides: Hides) -> None:
    """Choose exits of artefacts if the last is in view, too far away, or no way leads there.

    No camera sees the exit now, and if possible walls are between it and the robot: else the robot
    sees it as soon as it turns. It is the first of these: an exit, if there is time to get there;
    where the artefact stands; a point near by to which it has a straight way; the last exit; the
    nearest exit or destination. If none is behind a wall, it is the first that no camera sees now.
    """
    for way_out, situation in leaving:
        if situation.no_way and situation.wanted(way_out.exit_m):
            way_out.give_up()
    known = [way_out for way_out, _ in leaving if way_out.exit_m is not None]
    lasts_m = np.array([way_out.exit_m for way_out in known]).reshape(-1, 2)
    for way_out, is_hidden in zip(known, hides(lasts_m), strict=True):
        if not is_hidden:
            way_out.exit_m = None
    hidden_m: dict[Destinations, tuple[list[Point], list[Point]]] = {}
    for way_out, situation in leaving:
        last_m, places = way_out.exit_m, situation.places
        spare_s = 0.0 if way_out.is_time else EARLY_S  # who has set out goes on while it may arrive
        if last_m is not None and situation.distance_m(last_m) <= _way_m(situation, spare_s):
            continue
        if places not in hidden_m:
            hidden_m[places] = (
                _hidden(places.exits_m, hides),
                _hidden(places.destinations_m, hides),
            )
        exits_m, destinations_m = (
            [point for point in points if point not in way_out.unreachable_m]
            for points in hidden_m[places]
        )
        for behind_wall in (True, False):
            found_m = _places_out_of_sight(
                situation, exits_m, destinations_m, last_m, hides, behind_wall=behind_wall
            )
            way_out.exit_m = next(found_m, None)
            if way_out.exit_m is not None:
                break
        else:
            way_out.unreachable_m.clear()


def _places_out_of_sight(
    situation: Situation,
    exits_m: Sequence[Point],
    destinations_m: Sequence[Point],
    last_m: Point | None,
    hides: Hides,
    *,
    behind_wall: bool,
) -> Iterator[Point]:
    """Yield what `choose_exits` says, given the hidden places of the map.

    Those behind a wall are near enough to get there in the rest of the life.
    """

    def suits(point_m: Point) -> bool:
        return not behind_wall or _is_behind_wall(situation, point_m)

    away_m, reach_m = situation.distance_m, _way_m(situation, EARLY_S)
    for point in sorted(exits_m, key=away_m):
        if away_m(point) <= reach_m and suits(point):
            yield point
    if suits(situation.point_m):
        yield from _hidden(np.array([situation.point_m]), hides)
    for radius_m in _RADII_M:
        if behind_wall and radius_m > _way_m(situation):
            break
        ring_m = _points((radius_m * _RING + situation.point_m).tolist())
        open_m = [point for point in ring_m if suits(point) and situation.sees(*point)]
        yield from _hidden(np.array(open_m).reshape(-1, 2), hides)
    others_m = sorted([*exits_m, *destinations_m], key=away_m)
    for known_m in (last_m, *others_m[:1]):
        if known_m is not None and suits(known_m):
            yield known_m


def _way_m(situation: Situation, spare_s: float = 0.0) -> float:
    """Return how far one gets in the rest of its life but `spare_s` [m]; inf if not known."""
    motion, left_s = situation.row.motion, situation.left_s
    speed_mps = motion.speed_mps * motion.running_factor / _DETOUR
    return math.inf if left_s is None else speed_mps * (left_s - spare_s)


def _is_behind_wall(situation: Situation, point_m: Point) -> bool:
    """Return whether walls are between the robot and a point; true if the robot is unknown."""
    robot, me = situation.robot, situation.me
    if robot is None:
        return True
    return not situation.view.sees(me._replace(x_m=robot.x_m, y_m=robot.y_m), *point_m)


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
