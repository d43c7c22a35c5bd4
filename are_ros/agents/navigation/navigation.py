"""Navigation: from the intent of an agent to a motion command for the local planner.

The values of the decision process (MDP) tell what each action is worth, with two epochs of
lookahead among the other agents. Once one is chosen, the cheapest way leads on from there. The
sub-goal is the goal if a straight line leads there, else the farthest point of the way with a
straight line to it.
"""

import math
from collections.abc import Sequence
from enum import Enum, auto
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.situation import Intent, Neighbour, Point, RobotView
from are_ros.agents.body import MotionCommand
from are_ros.agents.mdp.coarse_map import CoarseMaps
from are_ros.agents.mdp.model import TravelModel
from are_ros.agents.mdp.routes import AHEAD, best_action
from are_ros.agents.mdp.value_tables import ValueTable, ValueTables, swept
from are_ros.agents.navigation.destinations import Destinations, ReachableDestinations
from are_ros.agents.navigation.profile import NavigationProfile
from are_ros.agents.navigation.step_kernels import (
    CHOOSES,
    NO_WAY,
    STRAIGHT,
    STRAIGHT_M,
    UNKNOWN,
    GoalArrays,
    Robot,
    prospect_of,
    slipped_along,
    way_along,
)
from are_ros.agents.navigation.terrain import Terrain, Terrains
from are_ros.agents.snapshot import AgentSnapshot
from are_ros.parameters.model import BehaviourParameters
from are_ros.world.environment import Environment

if TYPE_CHECKING:
    from are_ros.agents.decision import AgentState

_MOST_POINTS = 128
"""A sub-goal is at most this many coarse cells along the way."""

_GOALS_KEPT = 3
"""So many goals of an agent are known: of its journey, of its behaviour, and its way out."""

_NO_ENVIRONMENT = "there is no environment yet, so no way can be found"

_NO_WAY = np.empty((0, 2))
_NO_VALUES = np.empty((0, 5))
_NO_ROBOT = np.zeros((AHEAD, 2)), -1.0
_NOWHERE = Destinations(np.empty((0, 2)), np.empty((0, 2)))


class Prospects(Enum):
    """What there is to choose for an agent.

    It stands without a goal, has arrived, has no way to the goal, goes straight to a goal that is
    near or moving, or chooses by the values of its actions.
    """

    STANDS = auto()
    ARRIVED = auto()
    NO_WAY = auto()
    STRAIGHT = auto()
    CHOOSES = auto()


class NavigationRequest(NamedTuple):
    """The intent of an agent at a decision, its paces, and the rest of its life if it is known.

    `speeds_mps` (P,) is the speed of each pace, of which the first counts for turns; `left_s` the
    rest of the life [s]. A patient agent minds others; else the local planner has to pass them.
    """

    state: "AgentState"
    me: Neighbour
    intent: Intent
    speeds_mps: tuple[float, ...]
    left_s: float | None = None
    is_patient: bool = True


class ActiveGoal(NamedTuple):
    """A goal of an agent, and the values of going there.

    They are valid in one environment. `arrays` are what kernels take: the fields of `Ground` and
    `ValueArrays`, and `GoalSpec`.
    """

    environment: Environment
    table: ValueTable
    arrays: GoalArrays

    def with_table(self, table: ValueTable) -> "ActiveGoal":
        """Return the same with the planes of other epochs."""
        ground, _, ends = self.arrays
        return self._replace(table=table, arrays=(ground, tuple(table.value_arrays), ends))


class Prospect(NamedTuple):
    """What the actions of an agent are worth at a decision.

    `values` float64 (P, 5) are Q of each pace and move: stay, east, north, west, south of the grid,
    among the others; -inf is a move that is not made. An agent that stays on its way gives way and
    does not rest; with a rest, staying is worth `rest` more. `value` is V of the state, `later`
    with an epoch less, both without the others; `heading` is its heading, 0 east to 3 south. All
    are there if it `CHOOSES`.
    """

    kind: Prospects
    values: npt.NDArray[np.float64] = _NO_VALUES
    value: float = 0.0
    later: float = 0.0
    heading: int = 0
    rest: float = 0.0
    active: ActiveGoal | None = None

    @property
    def best(self) -> tuple[int, int]:
        """The pace and the move of the highest value; of equal ones, going straight on."""
        if self.kind is not Prospects.CHOOSES:
            return 0, 0
        pace, move = best_action(self.values, self.heading)
        return pace, move


class NavigationResult(NamedTuple):
    """The motion command for one decision period, and the state of the goal.

    If `waits` is true, the agent stays though it has a goal. `way_m` float64 (K, 2) is the way
    found.
    """

    command: MotionCommand
    arrived: bool = False
    no_way: bool = False
    waits: bool = False
    way_m: npt.NDArray[np.float64] = _NO_WAY


GoalKey = tuple[Point, tuple[float, ...]]
"""A goal, and the speeds at which it is gone to."""


_KINDS: Final = {
    NO_WAY: Prospects.NO_WAY,
    STRAIGHT: Prospects.STRAIGHT,
    CHOOSES: Prospects.CHOOSES,
}


class Navigation:
    """Finds ways in the present environment.

    `places` are its destinations; `horizon` is the longest horizon [decision periods].
    """

    def __init__(self, settings: BehaviourParameters, terrains: Terrains) -> None:
        self.places = _NOWHERE
        self._reach = ReachableDestinations(_NOWHERE)
        self._settings = settings
        self._terrains = terrains
        self._environment: Environment | None = None
        epochs = max(1, round(settings.max_horizon / settings.decision_period))
        self.horizon = epochs
        self._coarse_maps = CoarseMaps(settings.cell_size)
        self._tables = ValueTables(max(0, epochs - AHEAD))

    def enter(self, environment: Environment, places: Destinations) -> None:
        """Use another environment, or other destinations in it; forget all of the last one."""
        if environment is not self._environment:
            self._tables.clear()
            self._coarse_maps.clear()
        self._environment, self.places = environment, places
        self._reach = ReachableDestinations(places)

    def places_from(self, profile: NavigationProfile, point_m: Point) -> Destinations:
        """Return the destinations that a type can reach from a point of the map."""
        if self._environment is None:
            return self.places
        coarse = self._coarse_maps.of(self._terrain(profile), profile.narrow_m)
        spare_m = max(0.0, profile.radius_m - coarse.radius_m)
        return self._reach.places_from(coarse, point_m, spare_m)

    def sees(self, profile: NavigationProfile, from_m: Point, to_m: Point) -> bool:
        """Return whether walls leave a type a straight way from one point to another."""
        return self._terrain(profile).sees(from_m, to_m, profile.radius_m)

    def prospects(
        self, requests: Sequence[NavigationRequest], view: AgentSnapshot, robot: RobotView | None
    ) -> list[Prospect]:
        """Return what the actions of each request are worth; an agent's last goals are known."""
        if not requests:
            return []
        around = self._around(robot)
        indices = view.indices_of([request.me.id for request in requests])
        return [
            self._prospect(request, view, around, index)
            for request, index in zip(requests, indices, strict=True)
        ]

    def _prospect(
        self,
        request: NavigationRequest,
        view: AgentSnapshot,
        around: Robot,
        index: int,
    ) -> Prospect:
        known = request.state.active
        intent, goal_m = request.intent, request.intent.goal_m
        if goal_m is None:
            return Prospect(Prospects.STANDS)
        key = (goal_m, request.speeds_mps)
        away_m = math.dist(request.me.point_m, goal_m)
        if away_m <= intent.arrive_within_m:
            return Prospect(Prospects.ARRIVED)
        active = known.get(key)
        if active is not None and active.environment is self._environment:
            known[key] = known.pop(key)  # the last to be dropped
            prospect = self._prospect_by(request, key, view, around, index)
            if prospect.kind is not Prospects.NO_WAY:
                return prospect
        elif (intent.is_moving_goal or away_m <= STRAIGHT_M) and self.sees(
            request.state.profile, request.me.point_m, goal_m
        ):
            return Prospect(Prospects.STRAIGHT)
        # The goal is new, or the agent has left the part of the map with known values.
        active = self._new_goal(request, key)
        if active is None:
            return Prospect(Prospects.NO_WAY)
        for other, goal in list(known.items()):
            if other == key or goal.environment is not self._environment:
                del known[other]
        known[key] = active
        if len(known) > _GOALS_KEPT:
            del known[next(iter(known))]
        return self._prospect_by(request, key, view, around, index)

    def _prospect_by(
        self,
        request: NavigationRequest,
        key: GoalKey,
        view: AgentSnapshot,
        around: Robot,
        index: int,
    ) -> Prospect:
        """Return the prospect by the values of the decision process."""
        active = request.state.active[key]
        values, epochs = np.empty((len(request.speeds_mps), 5)), self._epochs(request.left_s)
        crowd, agent = view.crowd, (index, request.is_patient, epochs)
        is_moving_goal = request.intent.is_moving_goal
        known = prospect_of(crowd, around, agent, is_moving_goal, values, *active.arrays)
        if known[0] == UNKNOWN:
            table = swept(active.table, max(0, epochs - AHEAD))
            active = request.state.active[key] = active.with_table(table)
            known = prospect_of(crowd, around, agent, is_moving_goal, values, *active.arrays)
        what, heading, value, later = known
        rest = active.table.model.rest
        return Prospect(_KINDS[what], values, value, later, heading, rest, active)

    def result(
        self, request: NavigationRequest, prospect: Prospect, pace: int = 0, move: int = 0
    ) -> NavigationResult:
        """Return the motion command until the next decision, for an action of a prospect.

        Pace and move count if there is a choice. The agent goes to the goal if that is seen, else
        to the farthest point that is seen of the way along the move and then the cheapest way.
        """
        kind, speed_mps = prospect.kind, request.speeds_mps[pace] if request.speeds_mps else 0.0
        if kind is Prospects.STRAIGHT:
            return NavigationResult(_command(request, request.intent.goal_m, speed_mps))
        if kind is not Prospects.CHOOSES or prospect.active is None:
            is_there, is_lost = kind is Prospects.ARRIVED, kind is Prospects.NO_WAY
            return NavigationResult(_command(request, None), arrived=is_there, no_way=is_lost)
        pose, way_m = request.me.pose, np.empty((_MOST_POINTS, 2))
        arrays, action = prospect.active.arrays, (pace, move)
        count, subgoal_m, stops, beyond_m = way_along(*arrays, pose, action, way_m)
        way_m = way_m[:count]
        if move == 0 or count == 0:
            return NavigationResult(_command(request, None), waits=move == 0, way_m=way_m)
        command = _command(request, subgoal_m, speed_mps, stop_there=stops)
        if not math.isnan(beyond_m[0]):
            command = command._replace(beyond_m=beyond_m)
        return NavigationResult(command, way_m=way_m)

    def slipped(
        self, request: NavigationRequest, prospect: Prospect, pace: int, move: int
    ) -> NavigationResult:
        """Return the motion command for a move that has slipped aside; without room it stands."""
        if prospect.active is not None:
            arrays, pose = prospect.active.arrays, request.me.pose
            has_room, x_m, y_m = slipped_along(*arrays, pose, (pace, move))
            if has_room:
                command = _command(request, (x_m, y_m), request.speeds_mps[pace], stop_there=False)
                return NavigationResult(command, way_m=np.array([(x_m, y_m)]))
        return NavigationResult(_command(request, None))

    def _around(self, robot: RobotView | None) -> Robot:
        """Return the robot as kernels take it, at its present speed along its expected path."""
        if robot is None:
            return _NO_ROBOT
        way_m = robot.speed_mps * self._settings.decision_period
        ahead_m = [robot.path.at((k + 1) * way_m)[0] for k in range(AHEAD)]
        return np.array(ahead_m), robot.radius_m

    def _new_goal(self, request: NavigationRequest, key: GoalKey) -> ActiveGoal | None:
        """Return the values of going to a goal; None if no way leads there."""
        goal_m, speeds_mps = key
        profile, me, environment = request.state.profile, request.me, self._environment
        if environment is None:
            raise RuntimeError(_NO_ENVIRONMENT)
        for radius_m in dict.fromkeys((profile.radius_m, profile.narrow_m)):
            coarse = self._coarse_maps.of(self._terrain(profile), radius_m)
            model = TravelModel.of(
                profile.row,
                speeds_mps,
                coarse.cell_size_m,
                self._settings.decision_period,
                request.state.slip,
            )
            start = coarse.cell_of(me.x_m, me.y_m)
            left = max(0, self._epochs(request.left_s) - AHEAD)
            table = self._tables.value(coarse, model, goal_m, start, left)
            if table is not None and start is not None and table.reaches(start):
                goal_spec = (
                    min(profile.radius_m, coarse.radius_m),
                    goal_m,
                    table.goal_m,
                    profile.others_price,
                    profile.robot_price,
                    profile.row.motion.turn_radius_m > 0.0,
                )
                arrays = (tuple(coarse.ground), tuple(table.value_arrays), goal_spec)
                return ActiveGoal(environment, table, arrays)
        return None

    def _terrain(self, profile: NavigationProfile) -> Terrain:
        if self._environment is None:
            raise RuntimeError(_NO_ENVIRONMENT)
        return self._terrains.of(self._environment, profile.height_m)

    def _epochs(self, left_s: float | None) -> int:
        """Return the horizon: the rest of the life, at most the longest [decision periods]."""
        if left_s is None:
            return self.horizon
        return max(1, min(self.horizon, math.ceil(left_s / self._settings.decision_period)))


def _command(
    request: NavigationRequest,
    sub_goal_m: Point | None,
    speed_mps: float = 0.0,
    *,
    stop_there: bool = True,
) -> MotionCommand:
    """Return the command to move to a point or to stand, facing what the intent says."""
    intent, clearances, face_rad = request.intent, request.state.profile.clearances, None
    if intent.face_m is not None and stop_there:
        face_rad = math.atan2(intent.face_m[1] - request.me.y_m, intent.face_m[0] - request.me.x_m)
    robot_m = clearances.robot_m if intent.robot_comfort_m is None else intent.robot_comfort_m
    return MotionCommand(
        sub_goal_m,
        speed_mps,
        stop_there,
        face_rad,
        clearances.others_m,
        robot_m,
        clearances.walls_m,
    )
