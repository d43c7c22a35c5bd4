"""How an artefact gets where it wants: the values of the decision process, and the way they give.

The process decides the next move among the others (one step of lookahead); its best policy gives
the way from there, of which the farthest point that can be gone to straight is the sub-goal.
"""

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from are_ros.artefacts import routes
from are_ros.artefacts.behaviours.intent import Intent, Point
from are_ros.artefacts.behaviours.situation import Fellow, RobotView
from are_ros.artefacts.catalogue import CatalogueRow, RewardWeights
from are_ros.artefacts.coarse_map import Cell, CoarseMap, CoarseMaps
from are_ros.artefacts.mdp import Action, TravelModel
from are_ros.artefacts.motion.body import Body
from are_ros.artefacts.motion.order import Order
from are_ros.artefacts.onlookers import Onlookers
from are_ros.artefacts.places import Places
from are_ros.artefacts.terrain import Terrain, Terrains
from are_ros.artefacts.value_tables import ValueTable, ValueTables
from are_ros.parameters.model import BehaviourParameters
from are_ros.world.environment import Environment

_STRAIGHT_M = 3.0
"""A goal that is seen and no farther than this is gone to without asking for values."""

_TURNING_ROOM = 0.1
"""What a body needs beside its half width to get round corners, as a share of its length."""

_MINDED_M = 3.0
_NO_WAY = np.empty((0, 2))
_NOWHERE = Places(np.empty((0, 2)), np.empty((0, 2)))
_Others = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]
_NOBODY: _Others = (np.empty((0, 2)), np.empty(0), np.empty(0))
_PERSONAL_SPACE, _ROBOT = 0.3, 0.6
"""What a whole unit of these reward weights costs per epoch, beside the price of time."""


@dataclass(frozen=True)
class Comfort:
    """Distances [m] that an artefact keeps where it can, by its type's reward weights."""

    others_m: float
    robot_m: float
    walls_m: float

    @classmethod
    def of(cls, rewards: RewardWeights) -> "Comfort":
        """Return what a type likes: a person about 0.3 m from others, half a metre from robots."""
        return cls(0.4 * rewards.personal_space, 0.6 * rewards.robot, 0.3 * rewards.clearance)


@dataclass(frozen=True, eq=False)
class Traveller:
    """What finding a way needs to know of an artefact's type."""

    row: CatalogueRow
    body: Body
    radius_m: float
    comfort: Comfort

    @classmethod
    def of(cls, row: CatalogueRow, body: Body) -> "Traveller":
        """Return the traveller of a row; one much longer than wide needs some room to turn."""
        narrow_m = 0.5 * row.size_m[1] + _TURNING_ROOM * row.size_m[0]
        return cls(row, body, min(body.radius_m, narrow_m), Comfort.of(row.rewards))

    @property
    def height_m(self) -> float:
        """How high it is."""
        return self.row.size_m[2]


@dataclass(frozen=True, slots=True)
class Leg:
    """What an intent means for one decision period: the order, and how the goal stands.

    With `waits` it stays for others who are in its way.
    """

    order: Order
    arrived: bool = False
    no_way: bool = False
    waits: bool = False
    way_m: npt.NDArray[np.float64] = field(default_factory=lambda: _NO_WAY)


@dataclass(frozen=True, eq=False, slots=True)
class _Course:
    """Where one was going at its last decision, how fast, and what that is worth."""

    coarse: CoarseMap
    goal_m: Point
    speed_mps: float
    table: ValueTable

    def serves(
        self, coarse: CoarseMap, goal_m: Point, speed_mps: float, start: Cell | None
    ) -> bool:
        """Say whether the same is wanted again, from a cell with a way."""
        is_same = goal_m == self.goal_m and speed_mps == self.speed_mps and coarse is self.coarse
        return is_same and start is not None and self.table.reaches(start)


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
        distance_m = math.dist(me.point_m, goal_m)
        if distance_m <= intent.arrive_within_m:
            return Leg(_order(traveller, me, intent, None), arrived=True)
        is_near = intent.is_moving_goal or distance_m <= _STRAIGHT_M
        if is_near and self.sees(traveller, me.point_m, goal_m):
            return Leg(_order(traveller, me, intent, goal_m))
        others = self._others(traveller, me, view, robot) if is_patient else _NOBODY
        return self._leg_by_values(traveller, me, intent, goal_m, left_s, others)

    def _leg_by_values(
        self,
        traveller: Traveller,
        me: Fellow,
        intent: Intent,
        goal_m: Point,
        left_s: float | None,
        others: _Others,
    ) -> Leg:
        """Take the best action among those around, and the way that follows it."""
        terrain = self._terrain(traveller)
        coarse = self._coarse_maps.of(terrain, traveller.radius_m)
        table = self._table(coarse, traveller, me, goal_m, intent.speed_mps)
        if table is None:
            return Leg(_order(traveller, me, intent, None), no_way=True)
        epochs_left = self._epochs(left_s)
        action = routes.choose(table, coarse, me.x_m, me.y_m, me.yaw_rad, epochs_left, *others)
        heading = coarse.heading_of(me.yaw_rad)
        way_m, epochs = routes.way(table, coarse, me.x_m, me.y_m, heading, action)
        if not len(way_m):
            return Leg(_order(traveller, me, intent, None), no_way=True)
        if action is Action.STAY and epochs > 0.0:
            return Leg(_order(traveller, me, intent, None), waits=True, way_m=way_m)
        aim = terrain.farthest_seen(me.point_m, way_m, traveller.radius_m)
        sub_goal_m = (float(way_m[aim, 0]), float(way_m[aim, 1]))
        is_end = aim == len(way_m) - 1 and sub_goal_m == table.goal_m
        return Leg(_order(traveller, me, intent, sub_goal_m, stop_there=is_end), way_m=way_m)

    def _terrain(self, traveller: Traveller) -> Terrain:
        if self._environment is None:
            raise RuntimeError("nobody finds a way before there is an environment")
        return self._terrains.of(self._environment, traveller.height_m)

    def _table(
        self, coarse: CoarseMap, traveller: Traveller, me: Fellow, goal_m: Point, speed_mps: float
    ) -> ValueTable | None:
        """Return the values of going to a goal; those of the last decision while they serve."""
        course, start = self._courses.get(me.id), coarse.cell_of(me.x_m, me.y_m)
        if course is not None and course.serves(coarse, goal_m, speed_mps, start):
            return course.table
        settings = self._settings
        model = TravelModel.of(
            traveller.row, speed_mps, coarse.cell_size_m, settings.decision_period, 0.0
        )
        table = self._tables.value(coarse, model, goal_m, start)
        if table is not None:
            self._courses[me.id] = _Course(coarse, goal_m, speed_mps, table)
        return table

    def _epochs(self, left_s: float | None) -> int:
        """Return the horizon: what is left of the life, at most the longest."""
        if left_s is None:
            return self._horizon
        return max(1, min(self._horizon, math.ceil(left_s / self._settings.decision_period)))

    def _others(
        self, traveller: Traveller, me: Fellow, view: Onlookers, robot: RobotView | None
    ) -> _Others:
        """Return where others will be at the next decision, how near is near, and its price."""
        ahead_s, rewards = self._settings.decision_period, traveller.row.rewards
        points_m, radii_m = view.expected(me, _MINDED_M, ahead_s)
        near_m = radii_m + traveller.radius_m
        prices = np.full(len(points_m), _PERSONAL_SPACE * rewards.personal_space)
        if robot is None:
            return points_m, near_m, prices
        there = (robot.x_m + ahead_s * robot.vx_mps, robot.y_m + ahead_s * robot.vy_mps)
        return (
            np.vstack((points_m, there)),
            np.append(near_m, robot.radius_m + traveller.radius_m),
            np.append(prices, _ROBOT * rewards.robot),
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
