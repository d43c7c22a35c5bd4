"""What one artefact knows when it decides: itself, the others, the robot and the places."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from are_ros.population.catalogue import CatalogueRow

if TYPE_CHECKING:
    from are_ros.agents.navigation.destinations import Destinations


# What an artefact wants until its next decision, and the interface of whatever decides it.


Point = tuple[float, float]
"""x and y in the map frame [m]."""


ARRIVE_WITHIN_M: Final = 0.4
"""How near a goal one has arrived, unless an intent says otherwise."""


@dataclass(frozen=True, slots=True)
class Intent:
    """Where an artefact wants to be, map frame; a goal of None means that it stands.

    It goes at `speed_mps` at most, and has arrived within `arrive_within_m` of the goal. While it
    stands it turns to face `face_m`, if given. `activity` says in a word or two what it is doing,
    for the ground truth and the pictures. With `is_moving_goal` no whole way is planned: it goes
    straight on while the goal is seen; a goal that is new in each decision should be such a one.
    `robot_comfort_m` is the distance kept from the robot where possible, None: the usual one.
    """

    goal_m: Point | None
    speed_mps: float
    arrive_within_m: float = ARRIVE_WITHIN_M
    face_m: Point | None = None
    activity: str = ""
    is_moving_goal: bool = False
    robot_comfort_m: float | None = None


class Behaviour(Protocol):
    """Decides for one artefact; each artefact has an instance of its own, which may keep state.

    The class is made without arguments. Its choices depend on nothing but the situations: random
    numbers come from `situation.random`, the time from `situation.now_ns`.
    """

    name: ClassVar[str]

    def decide(self, situation: "Situation") -> Intent:
        """Return what the artefact wants now; called once in each decision period (1 s)."""


def stand(activity: str, face_m: Point | None = None) -> Intent:
    """Return the intent to stand, facing a point or as it is."""
    return Intent(None, 0.0, face_m=face_m, activity=activity)


class Neighbour(NamedTuple):
    """An artefact as others see it: pose and velocity on the ground, map frame.

    `radius_m` is that of the circle about (x, y) that holds its body. `behaviour` names what it
    does in its life, `activity` what its last intent said.
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
        """Where it is."""
        return self.x_m, self.y_m

    @property
    def speed_mps(self) -> float:
        """How fast it is."""
        return math.hypot(self.vx_mps, self.vy_mps)


@dataclass(frozen=True, eq=False)
class RobotView:
    """The robot as artefacts see it: pose and velocity of its base, map frame.

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
        """Where it is."""
        return self.x_m, self.y_m

    @property
    def speed_mps(self) -> float:
        """How fast it is."""
        return math.hypot(self.vx_mps, self.vy_mps)


class View(Protocol):
    """Everybody and the walls, as of one instant, asked by each artefact that decides then."""

    def neighbour(self, artefact_id: int) -> Neighbour | None:
        """Return an artefact that is alive, None if it is not."""

    def within(
        self,
        x_m: float,
        y_m: float,
        radius_m: float,
        behaviour: str = "",
        activities: Collection[str] = (),
    ) -> Sequence[Neighbour]:
        """Return those whose (x, y) is at most this far from a point, the nearest first.

        Of one behaviour, if it is given, and at one of these activities, if any are.
        """

    def points_within(
        self,
        x_m: float,
        y_m: float,
        radius_m: float,
        behaviour: str,
        activities: Collection[str],
        but_id: int,
    ) -> npt.NDArray[np.float64]:
        """Return where those are, float64 (M, 2), whom `within` returns, but for one."""

    def sees(self, me: Neighbour, x_m: float, y_m: float) -> bool:
        """Say whether this artefact could go straight on to a point, were nobody in its way."""


class Situation(NamedTuple):
    """What one artefact knows at one decision epoch.

    `left_s` is what is left of its life, None if that is not known. `random` is its own stream.
    `last` is its last intent, None at the first decision, and the four after it are about that:
    whether its goal is reached, how long [s] and by what ("a wall", "artefact 12", "the robot"; ""
    where it shunts and gets nowhere) it has been kept from going on, and whether no way leads
    there.
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
        """Where the artefact is."""
        return self.me.x_m, self.me.y_m

    def neighbour(self, artefact_id: int) -> Neighbour | None:
        """Return another artefact, None if it lives no more."""
        return self.view.neighbour(artefact_id)

    def fellows_within(
        self, radius_m: float, behaviour: str = "", activities: Collection[str] = ()
    ) -> list[Neighbour]:
        """Return the others whose (x, y) is at most this far away, the nearest first.

        Of one behaviour, and at one of these activities, if they are given: in a crowd that is
        much faster than to look at everybody.
        """
        me = self.me
        found = self.view.within(me.x_m, me.y_m, radius_m, behaviour, activities)
        return [neighbour for neighbour in found if neighbour.id != me.id]

    def points_within(
        self, radius_m: float, behaviour: str, activities: Collection[str] = ()
    ) -> npt.NDArray[np.float64]:
        """Return where the others of one behaviour are, float64 (M, 2), as `fellows_within`.

        That is much faster than to look at each.
        """
        me = self.me
        return self.view.points_within(me.x_m, me.y_m, radius_m, behaviour, activities, me.id)

    def sees(self, x_m: float, y_m: float) -> bool:
        """Say whether no wall is in the straight way to a point."""
        return self.view.sees(self.me, x_m, y_m)

    def wanted(self, goal_m: Point | None) -> bool:
        """Say whether this was the goal of the last intent; None was not."""
        return self.last is not None and goal_m is not None and self.last.goal_m == goal_m

    def has_reached(self, goal_m: Point | None) -> bool:
        """Say whether this was the goal of the last intent, and it has arrived there."""
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
        """Return how far away a point is."""
        return math.hypot(point_m[0] - self.me.x_m, point_m[1] - self.me.y_m)
