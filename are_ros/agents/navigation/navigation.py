"""How an artefact gets where it wants: the values of the decision process, and the way they give.

The process decides the next move among the others (one step of lookahead); its best policy gives
the way from there. The sub-goal is the goal if that is seen, else a far point of the way that is.
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
from are_ros.agents.neighbours import Neighbourhood, nearest_of
from are_ros.agents.snapshot import AgentSnapshot
from are_ros.parameters.model import BehaviourParameters
from are_ros.world.environment import Environment

if TYPE_CHECKING:
    from are_ros.agents.decision import AgentState

_MOST_POINTS = 128
"""So many coarse cells of the way are looked along for a sub-goal."""

_NO_ENVIRONMENT = "nobody finds a way before there is an environment"
_NO_WAY = np.empty((0, 2))
_NOWHERE = Destinations(np.empty((0, 2)), np.empty((0, 2)))


class NavigationRequest(NamedTuple):
    """What somebody wants at a decision, and what is left of its life [s], if that is known.

    Who is not patient does not wait for others, but leaves it to the traffic to get past them.
    """

    state: "AgentState"
    me: Neighbour
    intent: Intent
    left_s: float | None = None
    is_patient: bool = True


class ActiveGoal(NamedTuple):
    """Where an agent was going at its last decision, how fast, and what that is worth.

    It holds in one environment. `arrays` are what kernels take of it: the fields of `Ground` and
    `ValueArrays`, and `GoalSpec`.
    """

    goal_m: Point
    speed_mps: float
    environment: Environment
    arrays: GoalArrays


class NavigationResult(NamedTuple):
    """What an intent means for one decision period: the order, and how the goal stands.

    With `waits` it stays for others who are in its way. `way_m` float64 (K, 2).
    """

    command: MotionCommand
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
        """Go on in another environment, or with other places in it."""
        if environment is not self._environment:
            self._tables.clear()
            self._known_terrains.clear()
        nowhere_m = np.empty((0, 2))  # nothing, but that what gatherers ask for compiles early
        nearest_of(nowhere_m, places.destinations_m)
        Neighbourhood(nowhere_m).points_within(0.0, 0.0, 0.0, np.empty(0, np.int64), 0)
        self._environment, self.places = environment, places
        self._reach = ReachableDestinations(places)

    def places_from(self, profile: NavigationProfile, point_m: Point) -> Destinations:
        """Return the places that a type can get to from a point; all, where it is shut in."""
        if self._environment is None:
            return self.places
        coarse = self._coarse_maps.of(self._terrain(profile), profile.narrow_m)
        spare_m = max(0.0, profile.radius_m - coarse.radius_m)
        return self._reach.places_from(coarse, point_m, spare_m)

    def sees(self, profile: NavigationProfile, from_m: Point, to_m: Point) -> bool:
        """Say whether a type can go straight from one point to another, walls alone considered."""
        return self._terrain(profile).sees(from_m, to_m, profile.radius_m)

    def results(
        self, requests: Sequence[NavigationRequest], view: AgentSnapshot, robot: RobotView | None
    ) -> list[NavigationResult]:
        """Return what each has to do for what it wants until its next decision."""
        active_goals = [self._course(request) for request in requests]
        at_once = map(self._result_at_once, requests, active_goals)
        results = {k: result for k, result in enumerate(at_once) if result is not None}
        going = {k: active for k, active in enumerate(active_goals) if active and k not in results}
        results |= self._results_by_values(requests, going, view, robot)
        # The others set out, or have left the part of the map of which they know the values.
        anew = {k: self._set_out(request) for k, request in enumerate(requests) if k not in results}
        going = {k: active for k, active in anew.items() if active}
        results |= self._results_by_values(requests, going, view, robot)
        return [
            results.get(k) or NavigationResult(_command(request, None), no_way=True)
            for k, request in enumerate(requests)
        ]

    def _result_at_once(
        self, request: NavigationRequest, active: ActiveGoal | None
    ) -> NavigationResult | None:
        """Return the leg of who stands, has arrived, or goes straight; None if values decide."""
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
        """Return, of some wishes, the best action from where one is, and the way that follows it.

        Who knows no way is left out.
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
        """Return for how long ahead others are looked at [s], where the robot is then, its radius.

        The radius is negative where there is none.
        """
        ahead_s = self._settings.decision_period
        if robot is None:
            return ahead_s, 0.0, 0.0, -1.0
        x_m, y_m = robot.x_m + ahead_s * robot.vx_mps, robot.y_m + ahead_s * robot.vy_mps
        return ahead_s, x_m, y_m, robot.radius_m

    def _course(self, request: NavigationRequest) -> ActiveGoal | None:
        """Return the course of one who was going there already, as fast."""
        active, intent = request.state.active, request.intent
        if active is None or active.environment is not self._environment:
            return None
        is_the_same = active.goal_m == intent.goal_m and active.speed_mps == intent.speed_mps
        return active if is_the_same else None

    def _set_out(self, request: NavigationRequest) -> ActiveGoal | None:
        """Set out to a goal; None where no way is known."""
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
                ends = (
                    min(profile.radius_m, coarse.radius_m),
                    goal_m,
                    table.goal_m,
                    profile.others_price,
                    profile.robot_price,
                )
                arrays = (tuple(coarse.ground), tuple(table.value_arrays), ends)
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
        """Return the horizon: what is left of the life, at most the longest."""
        if left_s is None:
            return self.horizon
        return max(1, min(self.horizon, math.ceil(left_s / self._settings.decision_period)))


def _result(
    request: NavigationRequest, step: Sequence[float], way_m: npt.NDArray[np.float64]
) -> NavigationResult:
    """Return the leg of a step that `route_steps` has found."""
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
    """Return the order to go to a point, or to stand; at the end to look where the intent says."""
    intent, comfort, face_rad = request.intent, request.state.profile.comfort, None
    if intent.face_m is not None and stop_there:
        face_rad = math.atan2(intent.face_m[1] - request.me.y_m, intent.face_m[0] - request.me.x_m)
    robot_m = comfort.robot_m if intent.robot_comfort_m is None else intent.robot_comfort_m
    speed_mps = 0.0 if sub_goal_m is None else intent.speed_mps
    return MotionCommand(
        sub_goal_m, speed_mps, stop_there, face_rad, comfort.others_m, robot_m, comfort.walls_m
    )
