"""How an artefact gets where it wants: the values of the decision process, and the way they give.

The process decides the next move among the others (one step of lookahead); its best policy gives
the way from there, of which the farthest point that can be gone to straight is the sub-goal.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.artefacts._step_kernels import (
    NO_WAY,
    WAITS,
    GroundArrays,
    WorthArrays,
    route_step,
)
from are_ros.artefacts.behaviours.intent import Intent, Point
from are_ros.artefacts.behaviours.situation import Fellow, RobotView
from are_ros.artefacts.coarse_map import CoarseMaps
from are_ros.artefacts.mdp import TravelModel
from are_ros.artefacts.motion.order import Order
from are_ros.artefacts.onlookers import Onlookers
from are_ros.artefacts.places import Places
from are_ros.artefacts.terrain import Terrain, Terrains
from are_ros.artefacts.traveller import Traveller
from are_ros.artefacts.value_tables import ValueTables
from are_ros.parameters.model import BehaviourParameters
from are_ros.world.environment import Environment

_STRAIGHT_M = 3.0
"""A goal that is seen and no farther than this is gone to without asking for values."""

_MOST_POINTS = 16
"""So many coarse cells of the way are looked along for a sub-goal."""

_Minded = tuple[int, float, float, float, float, float, float]
"""The fields of `_step_kernels.Minded`."""

_NO_WAY = np.empty((0, 2))
_NOWHERE = Places(np.empty((0, 2)), np.empty((0, 2)))
_NOBODY: _Minded = (-1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Leg(NamedTuple):
    """What an intent means for one decision period: the order, and how the goal stands.

    With `waits` it stays for others who are in its way. `way_m` float64 (K, 2).
    """

    order: Order
    arrived: bool = False
    no_way: bool = False
    waits: bool = False
    way_m: npt.NDArray[np.float64] = _NO_WAY


class _Step(NamedTuple):
    """What `route_step` returns: what to do, the way, where to go on it, if that is its end."""

    what: int
    way_m: npt.NDArray[np.float64]
    aim_m: Point = (0.0, 0.0)
    is_end: bool = False


_NO_STEP = _Step(NO_WAY, _NO_WAY)


class _Course(NamedTuple):
    """Where one was going at its last decision, how fast, and what that is worth."""

    traveller: Traveller
    goal_m: Point
    speed_mps: float
    end_m: Point
    ground: GroundArrays
    worth: WorthArrays

    def step(self, me: Fellow, epochs_left: int, view: Onlookers, minded: _Minded) -> _Step:
        """Return the best action from where one is now, and the way that follows it."""
        way_m = np.empty((_MOST_POINTS, 2))
        pose_and_radius = (me.x_m, me.y_m, me.yaw_rad, self.traveller.radius_m)
        what, count, x_m, y_m, is_end = route_step(
            self.ground,
            self.worth,
            view.crowd,
            minded,
            pose_and_radius,
            epochs_left,
            self.end_m,
            way_m,
        )
        return _Step(what, way_m[:count], (x_m, y_m), is_end)


class Navigation:
    """Finds ways in the present environment; what was found in the last one is forgotten."""

    def __init__(self, settings: BehaviourParameters, terrains: Terrains) -> None:
        self.places = _NOWHERE
        self._settings = settings
        self._terrains = terrains
        self._environment: Environment | None = None
        epochs = max(1, round(settings.max_horizon / settings.decision_period))
        self._horizon = epochs
        self._coarse_maps = CoarseMaps(settings.cell_size)
        self._tables = ValueTables(epochs)
        self._courses: dict[int, _Course] = {}

    def enter(self, environment: Environment, places: Places) -> None:
        """Go on in another environment, or with other places in it."""
        if environment is not self._environment:
            self._tables.clear()
            self._courses.clear()
        self._environment, self.places = environment, places

    def forget(self, artefact_id: int) -> None:
        """Forget where somebody was going, known or not."""
        self._courses.pop(artefact_id, None)

    def sees(self, traveller: Traveller, from_m: Point, to_m: Point) -> bool:
        """Say whether a type can go straight from one point to another, walls alone considered."""
        return self._terrain(traveller).sees(from_m, to_m, traveller.radius_m)

    def leg(
        self,
        traveller: Traveller,
        me: Fellow,
        intent: Intent,
        left_s: float | None,
        view: Onlookers,
        robot: RobotView | None,
        *,
        is_patient: bool = True,
    ) -> Leg:
        """Return what to do for an intent until the next decision.

        Who is not patient does not wait for others, but leaves it to the traffic to get past them.
        """
        goal_m = intent.goal_m
        if goal_m is None:
            return Leg(_order(traveller, me, intent, None))
        distance_m = math.dist((me.x_m, me.y_m), goal_m)
        if distance_m <= intent.arrive_within_m:
            return Leg(_order(traveller, me, intent, None), arrived=True)
        is_near = intent.is_moving_goal or distance_m <= _STRAIGHT_M
        if is_near and self.sees(traveller, me.point_m, goal_m):
            return Leg(_order(traveller, me, intent, goal_m))
        minded = self._minded(traveller, me, view, robot) if is_patient else _NOBODY
        return self._leg_by_values(traveller, me, intent, goal_m, left_s, view, minded)

    def _leg_by_values(
        self,
        traveller: Traveller,
        me: Fellow,
        intent: Intent,
        goal_m: Point,
        left_s: float | None,
        view: Onlookers,
        minded: _Minded,
    ) -> Leg:
        """Take the best action among those around, and the way that follows it."""
        course, epochs = self._courses.get(me.id), self._epochs(left_s)
        step = _NO_STEP
        if course is not None and course[:3] == (traveller, goal_m, intent.speed_mps):
            step = course.step(me, epochs, view, minded)
        if step.what == NO_WAY:  # it sets out, or has left the old values' part of the map
            course = self._course(traveller, me, goal_m, intent.speed_mps)
            step = course.step(me, epochs, view, minded) if course else _NO_STEP
        if step.what == NO_WAY:
            return Leg(_order(traveller, me, intent, None), no_way=True)
        if step.what == WAITS:
            return Leg(_order(traveller, me, intent, None), waits=True, way_m=step.way_m)
        order = _order(traveller, me, intent, step.aim_m, stop_there=step.is_end)
        return Leg(order, way_m=step.way_m)

    def _terrain(self, traveller: Traveller) -> Terrain:
        if self._environment is None:
            raise RuntimeError("nobody finds a way before there is an environment")
        return self._terrains.of(self._environment, traveller.height_m)

    def _course(
        self, traveller: Traveller, me: Fellow, goal_m: Point, speed_mps: float
    ) -> _Course | None:
        """Set out to a goal, and return what that is worth; None where no way is known."""
        coarse = self._coarse_maps.of(self._terrain(traveller), traveller.radius_m)
        model = TravelModel.of(
            traveller.row, speed_mps, coarse.cell_size_m, self._settings.decision_period, 0.0
        )
        table = self._tables.value(coarse, model, goal_m, coarse.cell_of(me.x_m, me.y_m))
        if table is None:
            return None
        found = _Course(
            traveller, goal_m, speed_mps, table.goal_m, tuple(coarse.ground), tuple(table.worth)
        )
        self._courses[me.id] = found
        return found

    def _epochs(self, left_s: float | None) -> int:
        """Return the horizon: what is left of the life, at most the longest."""
        if left_s is None:
            return self._horizon
        return max(1, min(self._horizon, math.ceil(left_s / self._settings.decision_period)))

    def _minded(
        self, traveller: Traveller, me: Fellow, view: Onlookers, robot: RobotView | None
    ) -> _Minded:
        """Return the others, and where the robot will be next, with what they cost."""
        ahead_s, index = self._settings.decision_period, view.index_of(me.id)
        if robot is None:
            return index, ahead_s, traveller.others_price, 0.0, 0.0, 0.0, 0.0
        return (
            index,
            ahead_s,
            traveller.others_price,
            robot.x_m + ahead_s * robot.vx_mps,
            robot.y_m + ahead_s * robot.vy_mps,
            robot.radius_m + traveller.radius_m,
            traveller.robot_price,
        )


def _order(
    traveller: Traveller,
    me: Fellow,
    intent: Intent,
    sub_goal_m: Point | None,
    *,
    stop_there: bool = True,
) -> Order:
    """Return the order to go to a point, or to stand; at the end to look where the intent says."""
    comfort, face_rad = traveller.comfort, None
    if intent.face_m is not None and stop_there:
        face_rad = math.atan2(intent.face_m[1] - me.y_m, intent.face_m[0] - me.x_m)
    robot_m = comfort.robot_m if intent.robot_comfort_m is None else intent.robot_comfort_m
    speed_mps = 0.0 if sub_goal_m is None else intent.speed_mps
    return Order(
        sub_goal_m, speed_mps, stop_there, face_rad, comfort.others_m, robot_m, comfort.walls_m
    )
