"""Navigation: from the intent of an agent to a motion command for the local planner.

The values of the decision process (MDP) give the next move, with one step of lookahead among the
other agents; the best policy gives the way from there. The sub-goal is the goal if a straight line
leads there, else the farthest point of the way with a straight line to it.
"""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.situation import Intent, Neighbour, Point, RobotView
from are_ros.agents.local_planner.body import MotionCommand
from are_ros.agents.mdp.coarse_map import CoarseMaps
from are_ros.agents.mdp.model import TravelModel
from are_ros.agents.mdp.value_tables import ValueTables
from are_ros.agents.navigation.destinations import Destinations, ReachableDestinations
from are_ros.agents.navigation.profile import NavigationProfile
from are_ros.agents.navigation.step_kernels import (
    NO_WAY,
    STRAIGHT,
    STRAIGHT_M,
    WAITS,
    GoalArrays,
    route_step,
)
from are_ros.agents.navigation.terrain import Terrain, Terrains
from are_ros.agents.snapshot import AgentSnapshot
from are_ros.parameters.model import BehaviourParameters
from are_ros.world.environment import Environment

if TYPE_CHECKING:
    from are_ros.agents.decision import AgentState

_MOST_POINTS = 128
"""A sub-goal is at most this many coarse cells along the way."""

_NO_ENVIRONMENT = "there is no environment yet, so no way can be found"
_NO_WAY = np.empty((0, 2))
_NOWHERE = Destinations(np.empty((0, 2)), np.empty((0, 2)))


class NavigationRequest(NamedTuple):
    """The intent of an agent at a decision, and the rest of its life [s] if that is known.

    A patient agent gives way to others; else the local planner has to pass them.
    """

    state: "AgentState"
    me: Neighbour
    intent: Intent
    left_s: float | None = None
    is_patient: bool = True


class ActiveGoal(NamedTuple):
    """The goal of an agent since an earlier decision, its speed, and the value table for it.

    It is valid in one environment. `arrays` are what kernels take: the fields of `Ground` and
    `ValueArrays`, and `GoalSpec`.
    """

    goal_m: Point
    speed_mps: float
    environment: Environment
    arrays: GoalArrays


class NavigationResult(NamedTuple):
    """The motion command for one decision period, and the state of the goal.

    If `waits` is true, the agent gives way to others. `way_m` float64 (K, 2) is the way found.
    """

    command: MotionCommand
    arrived: bool = False
    no_way: bool = False
    waits: bool = False
    way_m: npt.NDArray[np.float64] = _NO_WAY


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
        self._known_terrains: dict[float, Terrain] = {}
        epochs = max(1, round(settings.max_horizon / settings.decision_period))
        self.horizon = epochs
        self._coarse_maps = CoarseMaps(settings.cell_size)
        self._tables = ValueTables(epochs)

    def enter(self, environment: Environment, places: Destinations) -> None:
        """Use another environment, or other destinations in it; forget values of the last one."""
        if environment is not self._environment:
            self._tables.clear()
            self._known_terrains.clear()
        self._environment, self.places = environment, places
        self._reach = ReachableDestinations(places)

    def places_from(self, profile: NavigationProfile, point_m: Point) -> Destinations:
        """Return the destinations that a type can reach from a point; all if it can reach none."""
        if self._environment is None:
            return self.places
        coarse = self._coarse_maps.of(self._terrain(profile), profile.narrow_m)
        spare_m = max(0.0, profile.radius_m - coarse.radius_m)
        return self._reach.places_from(coarse, point_m, spare_m)

    def sees(self, profile: NavigationProfile, from_m: Point, to_m: Point) -> bool:
        """Return whether walls leave a type a straight way from one point to another."""
        return self._terrain(profile).sees(from_m, to_m, profile.radius_m)

    def results(
        self, requests: Sequence[NavigationRequest], view: AgentSnapshot, robot: RobotView | None
    ) -> list[NavigationResult]:
        """Return the result of each request, for the time until the next decision."""
        active_goals = [self._present_goal(request) for request in requests]
        at_once = map(self._result_at_once, requests, active_goals)
        results = {k: result for k, result in enumerate(at_once) if result is not None}
        going = {k: active for k, active in enumerate(active_goals) if active and k not in results}
        results |= self._results_by_values(requests, going, view, robot)
        # The others have a new goal, or have left the part of the map with known values.
        new_goals = {
            k: self._new_goal(request) for k, request in enumerate(requests) if k not in results
        }
        going = {k: active for k, active in new_goals.items() if active}
        results |= self._results_by_values(requests, going, view, robot)
        return [
            results.get(k) or NavigationResult(_command(request, None), no_way=True)
            for k, request in enumerate(requests)
        ]

    def _result_at_once(
        self, request: NavigationRequest, active: ActiveGoal | None
    ) -> NavigationResult | None:
        """Return the result for an agent that stands, has arrived, or moves straight; else None."""
        me, intent = request.me, request.intent
        goal_m = intent.goal_m
        if goal_m is None:
            return NavigationResult(_command(request, None))
        away_m = math.dist((me.x_m, me.y_m), goal_m)
        if away_m <= intent.arrive_within_m:
            return NavigationResult(_command(request, None), arrived=True)
        is_near = intent.is_moving_goal or away_m <= STRAIGHT_M
        if active is None and is_near and self.sees(request.state.profile, me.point_m, goal_m):
            return NavigationResult(_command(request, goal_m))
        return None

    def _results_by_values(
        self,
        requests: Sequence[NavigationRequest],
        active_goals: Mapping[int, ActiveGoal],
        view: AgentSnapshot,
        robot: RobotView | None,
    ) -> dict[int, NavigationResult]:
        """Return the results of some requests by the values of the decision process.

        Requests without a known way are left out.
        """
        if not active_goals:
            return {}
        around, crowd, results = self._around(robot), view.crowd, dict[int, NavigationResult]()
        ways_m = np.empty((len(active_goals), _MOST_POINTS, 2))
        indices = view.indices_of([requests[k].me.id for k in active_goals])
        for (k, active), way_m, index in zip(active_goals.items(), ways_m, indices, strict=True):
            request = requests[k]
            agent = (index, request.is_patient, self._epochs(request.left_s))
            is_moving_goal = request.intent.is_moving_goal
            step = route_step(*active.arrays, crowd, around, agent, is_moving_goal, way_m)
            if step[0] != NO_WAY:
                results[k] = _result(request, step, way_m)
        return results

    def _around(self, robot: RobotView | None) -> tuple[float, float, float, float]:
        """Return the lookahead [s], the robot's position then [m], and its radius [m].

        The radius is negative if there is no robot.
        """
        ahead_s = self._settings.decision_period
        if robot is None:
            return ahead_s, 0.0, 0.0, -1.0
        x_m, y_m = robot.x_m + ahead_s * robot.vx_mps, robot.y_m + ahead_s * robot.vy_mps
        return ahead_s, x_m, y_m, robot.radius_m

    def _present_goal(self, request: NavigationRequest) -> ActiveGoal | None:
        """Return the active goal if it is that of the request, at the same speed."""
        active, intent = request.state.active, request.intent
        if active is None or active.environment is not self._environment:
            return None
        is_the_same = active.goal_m == intent.goal_m and active.speed_mps == intent.speed_mps
        return active if is_the_same else None

    def _new_goal(self, request: NavigationRequest) -> ActiveGoal | None:
        """Start towards the goal of a request; None if no way leads there."""
        profile, me, intent = request.state.profile, request.me, request.intent
        goal_m, speed_mps, environment = intent.goal_m, intent.speed_mps, self._environment
        if goal_m is None:
            return None
        if environment is None:
            raise RuntimeError(_NO_ENVIRONMENT)
        for radius_m in dict.fromkeys((profile.radius_m, profile.narrow_m)):
            coarse = self._coarse_maps.of(self._terrain(profile), radius_m)
            model = TravelModel.of(
                profile.row, speed_mps, coarse.cell_size_m, self._settings.decision_period, 0.0
            )
            start = coarse.cell_of(me.x_m, me.y_m)
            table = self._tables.value(coarse, model, goal_m, start)
            if table is not None and start is not None and table.reaches(start):
                goal_spec = (
                    min(profile.radius_m, coarse.radius_m),
                    goal_m,
                    table.goal_m,
                    profile.others_price,
                    profile.robot_price,
                )
                arrays = (tuple(coarse.ground), tuple(table.value_arrays), goal_spec)
                active = ActiveGoal(goal_m, speed_mps, environment, arrays)
                request.state.active = active
                return active
        return None

    def _terrain(self, profile: NavigationProfile) -> Terrain:
        if self._environment is None:
            raise RuntimeError(_NO_ENVIRONMENT)
        terrain = self._known_terrains.get(profile.height_m)
        if terrain is None:
            terrain = self._terrains.of(self._environment, profile.height_m)
            self._known_terrains[profile.height_m] = terrain
        return terrain

    def _epochs(self, left_s: float | None) -> int:
        """Return the horizon: the rest of the life, at most the longest [decision periods]."""
        if left_s is None:
            return self.horizon
        return max(1, min(self.horizon, math.ceil(left_s / self._settings.decision_period)))


def _result(
    request: NavigationRequest, step: Sequence[float], way_m: npt.NDArray[np.float64]
) -> NavigationResult:
    """Return the result for a step of `route_step`."""
    what, count, x_m, y_m, is_end = step
    if what == STRAIGHT:
        return NavigationResult(_command(request, request.intent.goal_m))
    way_m = way_m[: int(count)]
    if what == WAITS:
        return NavigationResult(_command(request, None), waits=True, way_m=way_m)
    return NavigationResult(_command(request, (x_m, y_m), stop_there=is_end != 0.0), way_m=way_m)


def _command(
    request: NavigationRequest, sub_goal_m: Point | None, *, stop_there: bool = True
) -> MotionCommand:
    """Return the command to move to a point or to stand, facing what the intent says."""
    intent, clearances, face_rad = request.intent, request.state.profile.clearances, None
    if intent.face_m is not None and stop_there:
        face_rad = math.atan2(intent.face_m[1] - request.me.y_m, intent.face_m[0] - request.me.x_m)
    robot_m = clearances.robot_m if intent.robot_comfort_m is None else intent.robot_comfort_m
    speed_mps = 0.0 if sub_goal_m is None else intent.speed_mps
    return MotionCommand(
        sub_goal_m,
        speed_mps,
        stop_there,
        face_rad,
        clearances.others_m,
        robot_m,
        clearances.walls_m,
    )
