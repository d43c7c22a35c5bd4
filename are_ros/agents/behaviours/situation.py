"""The interface of behaviours: what an artefact knows, and what it wants.

Once per decision period, a `Behaviour` turns a `Situation` into an `Intent`.
"""

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from are_ros.population.catalogue import CatalogueRow

if TYPE_CHECKING:
    from are_ros.agents.navigation.destinations import Destinations


Point = tuple[float, float]
"""x and y in the map frame [m]."""


WORTH: Final = 0.025
"""The reward per second of a behaviour that suits the situation."""

ARRIVE_WITHIN_M: Final = 0.4
"""Within this distance a goal counts as reached, unless the intent gives another."""


@dataclass(frozen=True, slots=True)
class Intent:
    """Where an artefact wants to be, in the map frame; with a goal of None it stands.

    Its speed is at most `speed_mps`; the goal is reached within `arrive_within_m`. While it stands
    it turns to face `face_m`, if given. `activity` names in a word or two what it does, for the
    ground truth and the pictures. With `is_moving_goal` it moves straight towards the goal while no
    wall is in between, and no way is planned; use it for goals that change at each decision.
    `robot_comfort_m` is the distance to the robot kept where possible (None: the type's own).
    """

    goal_m: Point | None
    speed_mps: float
    arrive_within_m: float = ARRIVE_WITHIN_M
    face_m: Point | None = None
    activity: str = ""
    is_moving_goal: bool = False
    robot_comfort_m: float | None = None


class Behaviour(Protocol):
    """Decides for one artefact; each artefact has its own instance, which may keep state.

    The class is constructed without arguments. Decisions may depend on the situations only: random
    numbers come from `situation.random`, the time from `situation.now_ns`.

    A behaviour may have a method `reward(situation) -> float`: what a second of it is worth now, in
    the unit of the reward weights (a second of a person's time is worth 0.2). Without it that is 0.
    It must not change the behaviour's state, and is asked whether the behaviour is in force or not.
    """

    name: ClassVar[str]

    def decide(self, situation: "Situation") -> Intent:
        """Return the intent of the artefact; called once per `decision_period`."""


def stand(activity: str, face_m: Point | None = None) -> Intent:
    """Return the intent to stand, facing a point if one is given."""
    return Intent(None, 0.0, face_m=face_m, activity=activity)


class Standing:
    """The behaviour standing: stays at its arrival pose."""

    name: ClassVar[str] = "standing"

    def decide(self, situation: "Situation") -> Intent:  # noqa: ARG002 - it always stands
        """Return the intent to stand."""
        return stand("standing")


class Neighbour(NamedTuple):
    """An artefact as others see it: pose and velocity on the ground, in the map frame.

    `radius_m` is the radius of a circle about (x, y) that contains its body. `activity` is that of
    its last intent.
    """

    id: int
    class_name: str
    label: str
    x_m: float
    y_m: float
    yaw_rad: float
    vx_mps: float
    vy_mps: float
    radius_m: float
    behaviour: str
    activity: str = ""

    @property
    def point_m(self) -> Point:
        """Its position (x, y) [m]."""
        return self.x_m, self.y_m

    @property
    def pose(self) -> tuple[float, float, float]:
        """Its position [m] and yaw [rad]."""
        return self.x_m, self.y_m, self.yaw_rad

    @property
    def speed_mps(self) -> float:
        """Its speed [m/s]."""
        return math.hypot(self.vx_mps, self.vy_mps)


@dataclass(frozen=True, eq=False)
class RobotView:
    """The robot as artefacts see it: pose and velocity of its base, in the map frame.

    `plan_m` is float64 (N, 2), the path it last published, empty if there is none.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    vx_mps: float
    vy_mps: float
    radius_m: float
    plan_m: npt.NDArray[np.float64]

    @property
    def point_m(self) -> Point:
        """Its position (x, y) [m]."""
        return self.x_m, self.y_m

    @cached_property
    def path(self) -> "ExpectedPath":
        """Its expected path."""
        return ExpectedPath(self)

    @property
    def speed_mps(self) -> float:
        """Its speed [m/s]."""
        return math.hypot(self.vx_mps, self.vy_mps)


_OFF_PLAN_M = 1.5
_IS_MOVING_MPS = 0.05
_FAR_M = 1000.0
_SAMPLE_M = 0.25


class ExpectedPath:
    """The expected path of the robot from its position: along its plan, then straight on.

    A plan that passes more than 1.5 m from the robot is outdated. With an outdated plan or none,
    the path is straight on in the direction of motion, or of the heading while the robot stands.
    """

    def __init__(self, robot: RobotView) -> None:
        here_m = np.array(robot.point_m)
        points_m = np.vstack((here_m, _plan_ahead(robot.plan_m, here_m)))
        end_m = points_m[-1] + _FAR_M * _last_direction(points_m, robot)
        self._points_m = np.vstack((points_m, end_m))
        steps_m = np.diff(self._points_m, axis=0)
        self._lengths_m = np.concatenate(([0.0], np.cumsum(np.hypot(*steps_m.T))))

    def at(self, length_m: float) -> tuple[Point, Point]:
        """Return the point at this length (>= 0) from the robot, and the unit direction there."""
        k = int(np.searchsorted(self._lengths_m, length_m, side="right")) - 1
        k = min(k, len(self._lengths_m) - 2)
        step_m = self._points_m[k + 1] - self._points_m[k]
        along = step_m / np.hypot(*step_m)
        x_m, y_m = (self._points_m[k] + (length_m - self._lengths_m[k]) * along).tolist()
        return (x_m, y_m), (float(along[0]), float(along[1]))

    def distance_m(self, point_m: Point, within_m: float) -> float:
        """Return the distance of a point from the first `within_m` of the path, to some cm."""
        lengths_m = np.arange(0.0, within_m, _SAMPLE_M)
        x_m = np.interp(lengths_m, self._lengths_m, self._points_m[:, 0])
        y_m = np.interp(lengths_m, self._lengths_m, self._points_m[:, 1])
        return float(np.hypot(x_m - point_m[0], y_m - point_m[1]).min())


def _last_direction(points_m: npt.NDArray[np.float64], robot: RobotView) -> npt.NDArray[np.float64]:
    """Return the unit direction of the path at its end."""
    if len(points_m) > 1:
        step_m = points_m[-1] - points_m[-2]
        return np.asarray(step_m / np.hypot(*step_m))
    heading_rad = robot.yaw_rad
    if robot.speed_mps > _IS_MOVING_MPS:
        heading_rad = math.atan2(robot.vy_mps, robot.vx_mps)
    return np.array((math.cos(heading_rad), math.sin(heading_rad)))


def _plan_ahead(
    plan_m: npt.NDArray[np.float64], here_m: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the points (N, 2) of the plan still ahead, without repeated ones."""
    if not len(plan_m):
        return np.empty((0, 2))
    apart_m = np.hypot(*(plan_m - here_m).T)
    nearest = int(apart_m.argmin())
    if apart_m[nearest] > _OFF_PLAN_M:
        return np.empty((0, 2))
    rest_m = plan_m[nearest + 1 :]
    before_m = np.vstack((here_m, rest_m[:-1]))
    return rest_m[np.hypot(*(rest_m - before_m).T) > 1e-3] if len(rest_m) else rest_m


class View(Protocol):
    """All artefacts and the walls at one instant; the artefacts that decide then query it."""

    def neighbour(self, artefact_id: int) -> Neighbour | None:
        """Return an artefact that is alive, None if it is not."""

    def within(
        self,
        x_m: float,
        y_m: float,
        radius_m: float,
        behaviour: str = "",
        activities: Collection[str] = (),
    ) -> Iterable[Neighbour]:
        """Yield the artefacts whose (x, y) is within a radius of a point, the nearest first.

        With `behaviour` and `activities`, only those with that behaviour and one of the activities.
        """

    def places_within(
        self,
        me: Neighbour,
        radius_m: float,
        behaviour: str,
        activities: Collection[str],
        places: "Destinations",
    ) -> Sequence[int]:
        """Return the index of the destination nearest to each of the others within a radius.

        They come in the order of `within`; there is at least one destination.
        """

    def sees(self, me: Neighbour, x_m: float, y_m: float) -> bool:
        """Return whether walls leave this artefact a straight way to a point."""


class Situation(NamedTuple):
    """What one artefact knows at one decision epoch.

    `places` are the destinations that it can reach. `random` is its own stream. `left_s` is the
    rest of its life [s], None if that is not known. `last` is its last intent, None at the first
    decision. The fields after it are the outcome of that intent: whether its goal is reached, for
    how long [s] and by what the artefact is blocked ("a wall", "artefact 12", "the robot"; "" if it
    manoeuvres without progress), and whether no way leads to the goal.
    """

    now_ns: int
    me: Neighbour
    row: CatalogueRow
    places: "Destinations"
    random: np.random.Generator
    view: View
    robot: RobotView | None = None
    left_s: float | None = None
    last: Intent | None = None
    arrived: bool = False
    blocked_s: float = 0.0
    blocked_by: str = ""
    no_way: bool = False

    @property
    def point_m(self) -> Point:
        """The position (x, y) of the artefact [m]."""
        return self.me.x_m, self.me.y_m

    def neighbour(self, artefact_id: int) -> Neighbour | None:
        """Return another artefact, None if it is not alive."""
        return self.view.neighbour(artefact_id)

    def neighbours_within(
        self, radius_m: float, behaviour: str = "", activities: Collection[str] = ()
    ) -> list[Neighbour]:
        """Return the others whose (x, y) is within a radius, the nearest first.

        With `behaviour` and `activities`, only those with that behaviour and one of the activities
        (a text is one of them): in a crowd that is much faster than to look at all.
        """
        me = self.me
        found = self.view.within(me.x_m, me.y_m, radius_m, behaviour, _several(activities))
        return [neighbour for neighbour in found if neighbour.id != me.id]

    def nearest(self, radius_m: float, suits: Callable[[Neighbour], bool]) -> Neighbour | None:
        """Return the nearest of the others within a radius that suits, None if none does.

        In a crowd that is much faster than to look at all.
        """
        me = self.me
        near = self.view.within(me.x_m, me.y_m, radius_m)
        return next((one for one in near if one.id != me.id and suits(one)), None)

    def places_within(
        self, radius_m: float, behaviour: str, activities: Collection[str]
    ) -> Sequence[int]:
        """Return, for each of `neighbours_within`, the index of the destination nearest to it."""
        places = self.places
        if not len(places.destinations_m):
            return ()
        chosen = _several(activities)
        return self.view.places_within(self.me, radius_m, behaviour, chosen, places)

    def sees(self, x_m: float, y_m: float) -> bool:
        """Return whether no wall is in the straight way to a point."""
        return self.view.sees(self.me, x_m, y_m)

    def wanted(self, goal_m: Point | None) -> bool:
        """Return whether this was the goal of the last intent; never true for None."""
        return self.last is not None and goal_m is not None and self.last.goal_m == goal_m

    def has_reached(self, goal_m: Point | None) -> bool:
        """Return whether this was the goal of the last intent, and it is reached."""
        if self.last is None or goal_m is None or self.last.goal_m != goal_m:
            return False
        return self.arrived or self.distance_m(goal_m) <= self.last.arrive_within_m

    def drawn_between(self, low: float, high: float) -> float:
        """Draw a number from [low, high), from the artefact's own stream."""
        stream = self.random
        return float(stream.uniform(low, high))

    def drawn_from(self, indices: npt.NDArray[np.integer]) -> int:
        """Draw one of some indices (N > 0), from the artefact's own stream."""
        stream = self.random
        return int(indices[stream.integers(len(indices))])

    def distance_m(self, point_m: Point) -> float:
        """Return the distance of a point [m]."""
        return math.hypot(point_m[0] - self.me.x_m, point_m[1] - self.me.y_m)


def _several(activities: Collection[str]) -> Collection[str]:
    """Return activities; a text alone is one, and no collection of its parts."""
    return (activities,) if isinstance(activities, str) else activities
