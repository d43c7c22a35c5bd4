"""How an artefact gets where it wants: the values of the decision process, and the way they give.

The process decides the next move among the others (one step of lookahead); its best policy gives
the way from there. The sub-goal is the goal if that is seen, else a far point of the way that is.
"""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.situation import Fellow, Intent, Point, RobotView
from are_ros.agents.local_planner.body import Order
from are_ros.agents.mdp.coarse_map import CoarseMaps
from are_ros.agents.mdp.model import TravelModel
from are_ros.agents.mdp.value_tables import ValueTables
from are_ros.agents.navigation.destinations import Destinations, Reach
from are_ros.agents.navigation.profile import Traveller
from are_ros.agents.navigation.step_kernels import (
    NO_WAY,
    STRAIGHT,
    STRAIGHT_M,
    WAITS,
    CourseArrays,
    route_step,
)
from are_ros.agents.navigation.terrain import Terrain, Terrains
from are_ros.agents.neighbours import Neighbourhood, nearest_of
from are_ros.agents.snapshot import Onlookers
from are_ros.parameters.model import BehaviourParameters
from are_ros.world.environment import Environment

if TYPE_CHECKING:
    from are_ros.agents.decision import AgentState

_MOST_POINTS = 128
"""So many coarse cells of the way are looked along for a sub-goal."""

_NO_ENVIRONMENT = "nobody finds a way before there is an environment"
_NO_WAY = np.empty((0, 2))
_NOWHERE = Destinations(np.empty((0, 2)), np.empty((0, 2)))


class Wish(NamedTuple):
    """What somebody wants at a decision, and what is left of its life [s], if that is known.

    Who is not patient does not wait for others, but leaves it to the traffic to get past them.
    """

    state: "AgentState"
    me: Fellow
    intent: Intent
    left_s: float | None = None
    is_patient: bool = True


class Course(NamedTuple):
    """Where an agent was going at its last decision, how fast, and what that is worth.

    It holds in one environment. `arrays` are what kernels take of it: the fields of `Ground` and
    `Worth`, and `Ends`.
    """

    goal_m: Point
    speed_mps: float
    environment: Environment
    arrays: CourseArrays


class Leg(NamedTuple):
    """What an intent means for one decision period: the order, and how the goal stands.

    With `waits` it stays for others who are in its way. `way_m` float64 (K, 2).
    """

    order: Order
    arrived: bool = False
    no_way: bool = False
    waits: bool = False
    way_m: npt.NDArray[np.float64] = _NO_WAY


class Navigation:
    """Finds ways in the present environment; what was found in the last one is forgotten.

    `horizon` is the longest, in decision periods.
    """

    def __init__(self, settings: BehaviourParameters, terrains: Terrains) -> None:
        self.places = _NOWHERE
        self._reach = Reach(_NOWHERE)
        self._settings = settings
        self._terrains = terrains
        self._environment: Environment | None = None
        self._known_terrains: dict[float, Terrain] = {}
        epochs = max(1, round(settings.max_horizon / settings.decision_period))
        self.horizon = epochs
        self._coarse_maps = CoarseMaps(settings.cell_size)
        self._tables = ValueTables(epochs)

    def enter(self, environment: Environment, places: Destinations) -> None:
        """Go on in another environment, or with other places in it."""
        if environment is not self._environment:
            self._tables.clear()
            self._known_terrains.clear()
        nowhere_m = np.empty((0, 2))  # nothing, but that what gatherers ask for compiles early
        nearest_of(nowhere_m, places.destinations_m)
        Neighbourhood(nowhere_m).points_within(0.0, 0.0, 0.0, np.empty(0, np.int64), 0)
        self._environment, self.places = environment, places
        self._reach = Reach(places)

    def places_from(self, traveller: Traveller, point_m: Point) -> Destinations:
        """Return the places that a type can get to from a point; all, where it is shut in."""
        if self._environment is None:
            return self.places
        coarse = self._coarse_maps.of(self._terrain(traveller), traveller.narrow_m)
        spare_m = max(0.0, traveller.radius_m - coarse.radius_m)
        return self._reach.places_from(coarse, point_m, spare_m)

    def sees(self, traveller: Traveller, from_m: Point, to_m: Point) -> bool:
        """Say whether a type can go straight from one point to another, walls alone considered."""
        return self._terrain(traveller).sees(from_m, to_m, traveller.radius_m)

    def legs(self, wishes: Sequence[Wish], view: Onlookers, robot: RobotView | None) -> list[Leg]:
        """Return what each has to do for what it wants until its next decision."""
        courses = [self._course(wish) for wish in wishes]
        at_once = map(self._leg_at_once, wishes, courses)
        legs = {k: leg for k, leg in enumerate(at_once) if leg is not None}
        going = {k: course for k, course in enumerate(courses) if course and k not in legs}
        legs |= self._legs_by_values(wishes, going, view, robot)
        # The others set out, or have left the part of the map of which they know the values.
        anew = {k: self._set_out(wish) for k, wish in enumerate(wishes) if k not in legs}
        going = {k: course for k, course in anew.items() if course}
        legs |= self._legs_by_values(wishes, going, view, robot)
        return [
            legs.get(k) or Leg(_order(wish, None), no_way=True) for k, wish in enumerate(wishes)
        ]

    def _leg_at_once(self, wish: Wish, course: Course | None) -> Leg | None:
        """Return the leg of who stands, has arrived, or goes straight; None if values decide."""
        me, intent = wish.me, wish.intent
        goal_m = intent.goal_m
        if goal_m is None:
            return Leg(_order(wish, None))
        away_m = math.dist((me.x_m, me.y_m), goal_m)
        if away_m <= intent.arrive_within_m:
            return Leg(_order(wish, None), arrived=True)
        is_near = intent.is_moving_goal or away_m <= STRAIGHT_M
        if course is None and is_near and self.sees(wish.state.traveller, me.point_m, goal_m):
            return Leg(_order(wish, goal_m))
        return None

    def _legs_by_values(
        self,
        wishes: Sequence[Wish],
        courses: Mapping[int, Course],
        view: Onlookers,
        robot: RobotView | None,
    ) -> dict[int, Leg]:
        """Return, of some wishes, the best action from where one is, and the way that follows it.

        Who knows no way is left out.
        """
        if not courses:
            return {}
        around, crowd, legs = self._around(robot), view.crowd, dict[int, Leg]()
        ways_m = np.empty((len(courses), _MOST_POINTS, 2))
        indices = view.indices_of([wishes[k].me.id for k in courses])
        for (k, course), way_m, index in zip(courses.items(), ways_m, indices, strict=True):
            wish = wishes[k]
            minds = (index, wish.is_patient, self._epochs(wish.left_s))
            is_moving_goal = wish.intent.is_moving_goal
            step = route_step(*course.arrays, crowd, around, minds, is_moving_goal, way_m)
            if step[0] != NO_WAY:
                legs[k] = _leg(wish, step, way_m)
        return legs

    def _around(self, robot: RobotView | None) -> tuple[float, float, float, float]:
        """Return for how long ahead others are looked at [s], where the robot is then, its radius.

        The radius is negative where there is none.
        """
        ahead_s = self._settings.decision_period
        if robot is None:
            return ahead_s, 0.0, 0.0, -1.0
        x_m, y_m = robot.x_m + ahead_s * robot.vx_mps, robot.y_m + ahead_s * robot.vy_mps
        return ahead_s, x_m, y_m, robot.radius_m

    def _course(self, wish: Wish) -> Course | None:
        """Return the course of one who was going there already, as fast."""
        course, intent = wish.state.course, wish.intent
        if course is None or course.environment is not self._environment:
            return None
        is_the_same = course.goal_m == intent.goal_m and course.speed_mps == intent.speed_mps
        return course if is_the_same else None

    def _set_out(self, wish: Wish) -> Course | None:
        """Set out to a goal; None where no way is known."""
        traveller, me, intent = wish.state.traveller, wish.me, wish.intent
        goal_m, speed_mps, environment = intent.goal_m, intent.speed_mps, self._environment
        if goal_m is None:
            return None
        if environment is None:
            raise RuntimeError(_NO_ENVIRONMENT)
        for radius_m in dict.fromkeys((traveller.radius_m, traveller.narrow_m)):
            coarse = self._coarse_maps.of(self._terrain(traveller), radius_m)
            model = TravelModel.of(
                traveller.row, speed_mps, coarse.cell_size_m, self._settings.decision_period, 0.0
            )
            start = coarse.cell_of(me.x_m, me.y_m)
            table = self._tables.value(coarse, model, goal_m, start)
            if table is not None and start is not None and table.reaches(start):
                ends = (
                    min(traveller.radius_m, coarse.radius_m),
                    goal_m,
                    table.goal_m,
                    traveller.others_price,
                    traveller.robot_price,
                )
                arrays = (tuple(coarse.ground), tuple(table.worth), ends)
                course = Course(goal_m, speed_mps, environment, arrays)
                wish.state.course = course
                return course
        return None

    def _terrain(self, traveller: Traveller) -> Terrain:
        if self._environment is None:
            raise RuntimeError(_NO_ENVIRONMENT)
        terrain = self._known_terrains.get(traveller.height_m)
        if terrain is None:
            terrain = self._terrains.of(self._environment, traveller.height_m)
            self._known_terrains[traveller.height_m] = terrain
        return terrain

    def _epochs(self, left_s: float | None) -> int:
        """Return the horizon: what is left of the life, at most the longest."""
        if left_s is None:
            return self.horizon
        return max(1, min(self.horizon, math.ceil(left_s / self._settings.decision_period)))


def _leg(wish: Wish, step: Sequence[float], way_m: npt.NDArray[np.float64]) -> Leg:
    """Return the leg of a step that `route_steps` has found."""
    what, count, x_m, y_m, is_end = step
    if what == STRAIGHT:
        return Leg(_order(wish, wish.intent.goal_m))
    way_m = way_m[: int(count)]
    if what == WAITS:
        return Leg(_order(wish, None), waits=True, way_m=way_m)
    return Leg(_order(wish, (x_m, y_m), stop_there=is_end != 0.0), way_m=way_m)


def _order(wish: Wish, sub_goal_m: Point | None, *, stop_there: bool = True) -> Order:
    """Return the order to go to a point, or to stand; at the end to look where the intent says."""
    intent, comfort, face_rad = wish.intent, wish.state.traveller.comfort, None
    if intent.face_m is not None and stop_there:
        face_rad = math.atan2(intent.face_m[1] - wish.me.y_m, intent.face_m[0] - wish.me.x_m)
    robot_m = comfort.robot_m if intent.robot_comfort_m is None else intent.robot_comfort_m
    speed_mps = 0.0 if sub_goal_m is None else intent.speed_mps
    return Order(
        sub_goal_m, speed_mps, stop_there, face_rad, comfort.others_m, robot_m, comfort.walls_m
    )
