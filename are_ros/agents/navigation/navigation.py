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
from are_ros.agents.local_planner.body import MotionCommand
from are_ros.agents.mdp.coarse_map import CoarseMaps
from are_ros.agents.mdp.model import TravelModel
from are_ros.agents.mdp.policy import STAY
from are_ros.agents.mdp.routes import AHEAD, best_action
from are_ros.agents.mdp.value_tables import ValueTable, ValueTables
from are_ros.agents.navigation.destinations import Destinations, ReachableDestinations
from are_ros.agents.navigation.goal_records import (
    GoalSpec,
    goal_record,
    goals_of,
    record_with_plane,
)
from are_ros.agents.navigation.ground import Ground
from are_ros.agents.navigation.profile import NavigationProfile
from are_ros.agents.navigation.step_kernels import (
    CHOOSES,
    NO_WAY,
    STRAIGHT,
    STRAIGHT_M,
    UNKNOWN,
    Robot,
    moves_along,
    prospects_of,
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
_Filled = tuple[npt.NDArray[np.int64], npt.NDArray[np.float64], npt.NDArray[np.float64]]
"""Kinds and headings (M, 2), values (M,), and what the actions are worth (M, P, 5)."""

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


class ActiveGoal:
    """A goal of an agent, and the values of going there, valid in one environment.

    `record` is what kernels take, as in `goal_record`.
    """

    def __init__(
        self, environment: Environment, table: ValueTable, ground: Ground, spec: GoalSpec
    ) -> None:
        """Take the environment, the values, the coarse map that they are of, and the goal."""
        self.environment = environment
        self.table = table
        self.rest = table.model.rest
        self._arrays = ground, table.value_arrays
        self.record = goal_record(*self._arrays, spec)


class Prospect(NamedTuple):
    """What the actions of an agent are worth at a decision.

    `values` float64 (P, 5) are Q of each pace and move: stay, east, north, west, south of the grid,
    among the others. An agent that stays on its way gives way and does not rest; with a rest,
    staying is worth `rest` more. `value` is V of the state without the others, `heading` its
    heading, 0 east to 3 south. All are there if it `CHOOSES`.
    """

    kind: Prospects
    values: npt.NDArray[np.float64] = _NO_VALUES
    value: float = 0.0
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


_STANDS: Final = Prospect(Prospects.STANDS)


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


Action = tuple[int, int, int]
"""A pace, a move, and what becomes of the move: itself, `STAY` if it fails, or one to its side."""

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
        self._known_terrains: dict[float, Terrain] = {}
        epochs = max(1, round(settings.max_horizon / settings.decision_period))
        self.horizon = epochs
        self._coarse_maps = CoarseMaps(settings.cell_size)
        self._tables = ValueTables(max(0, epochs - AHEAD))

    def enter(self, environment: Environment, places: Destinations) -> None:
        """Use another environment, or other destinations in it; forget values of the last one."""
        if environment is not self._environment:
            self._tables.clear()
            self._known_terrains.clear()
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
        found = self._weighed(requests, [self._known(one) for one in requests], view, robot)
        # Some agents may have left the part of the map with known values.
        lost = [k for k, one in enumerate(found) if one.kind is Prospects.NO_WAY and one.active]
        again = [requests[k] for k in lost]
        renewed = self._weighed(again, [self._renewed(one) for one in again], view, robot)
        for k, prospect in zip(lost, renewed, strict=True):
            found[k] = prospect
        return found

    def _known(self, request: NavigationRequest) -> Prospect | ActiveGoal:
        """Return what there is for an agent without values, else the goal that has them."""
        intent, goal_m = request.intent, request.intent.goal_m
        if goal_m is None:
            return _STANDS
        away_m = math.dist(request.me.point_m, goal_m)
        if away_m <= intent.arrive_within_m:
            return Prospect(Prospects.ARRIVED)
        active = request.state.active.get((goal_m, request.speeds_mps))
        if active is not None and active.environment is self._environment:
            return active
        if (intent.is_moving_goal or away_m <= STRAIGHT_M) and self.sees(
            request.state.profile, request.me.point_m, goal_m
        ):
            return Prospect(Prospects.STRAIGHT)
        return self._renewed(request)

    def _renewed(self, request: NavigationRequest) -> Prospect | ActiveGoal:
        """Return the goal of a request with new values, and keep it; NO_WAY if none leads there."""
        goal_m, known = request.intent.goal_m, request.state.active
        key = None if goal_m is None else (goal_m, request.speeds_mps)
        active = None if key is None else self._new_goal(request, key)
        if key is None or active is None:
            return Prospect(Prospects.NO_WAY)
        for other, goal in list(known.items()):
            if other == key or goal.environment is not self._environment:
                del known[other]
        known[key] = active
        if len(known) > _GOALS_KEPT:
            del known[next(iter(known))]
        return active

    def _weighed(
        self,
        requests: Sequence[NavigationRequest],
        known: Sequence[Prospect | ActiveGoal],
        view: AgentSnapshot,
        robot: RobotView | None,
    ) -> list[Prospect]:
        """Return the prospects of requests; those with goals get them by their values."""
        goals = {k: one for k, one in enumerate(known) if isinstance(one, ActiveGoal)}
        found = [one if isinstance(one, Prospect) else _STANDS for one in known]
        if not goals:
            return found
        indices = view.indices_of([requests[k].me.id for k in goals])
        asked = np.array(
            [
                (
                    index,
                    requests[k].is_patient,
                    requests[k].intent.is_moving_goal,
                    self._epochs(requests[k].left_s),
                )
                for index, k in zip(indices, goals, strict=True)
            ],
            np.int64,
        )
        paces = max(len(requests[k].speeds_mps) for k in goals)
        kinds, values, brings = self._worth(list(goals.values()), asked, paces, view, robot)
        for at, (k, (kind, heading), value) in enumerate(
            zip(goals, kinds.tolist(), values.tolist(), strict=True)
        ):
            goal, of_paces = goals[k], brings[at, : len(requests[k].speeds_mps)]
            found[k] = Prospect(_KINDS[kind], of_paces, value, heading, goal.rest, goal)
        return found

    def _worth(
        self,
        goals: Sequence[ActiveGoal],
        asked: npt.NDArray[np.int64],
        paces: int,
        view: AgentSnapshot,
        robot: RobotView | None,
    ) -> _Filled:
        """Return what `prospects_of` fills in, with the planes of all epochs that are needed."""
        around = self._around(robot)

        def filled(asked: npt.NDArray[np.int64], records: list[bytes]) -> _Filled:
            brings = np.empty((len(asked), paces, 5))
            kinds, values = np.empty((len(asked), 2), np.int64), np.empty(len(asked))
            prospects_of(view.crowd, around, asked, goals_of(records), brings, kinds, values)
            return kinds, values, brings

        found = filled(asked, [goal.record for goal in goals])
        unknown = np.flatnonzero(found[0][:, 0] == UNKNOWN)
        if len(unknown):
            needs = [(goals[k], max(0, int(asked[k, 3]) - AHEAD)) for k in unknown.tolist()]
            planes = [self._tables.plane(goal.table, epochs) for goal, epochs in needs]
            records = [
                record_with_plane(goal.record, plane)
                for (goal, _), plane in zip(needs, planes, strict=True)
            ]
            for array, again in zip(found, filled(asked[unknown], records), strict=True):
                array[unknown] = again
        return found

    def results(
        self,
        requests: Sequence[NavigationRequest],
        prospects: Sequence[Prospect],
        actions: Sequence[Action],
    ) -> list[NavigationResult]:
        """Return the motion commands until the next decisions, for an action of each prospect.

        The actions count where there is a choice. An agent goes to its goal if that is seen, else
        to the farthest point that is seen of the way along the move and then the cheapest way. A
        move that fails turns it there; one that slips aside, without room, lets it stand.
        """
        results = list(map(_without_choice, requests, prospects))
        goals = {
            k: one.active
            for k, one in enumerate(prospects)
            if one.kind is Prospects.CHOOSES and one.active is not None
        }
        if not goals:
            return results
        ways_m, aims_m = np.empty((len(goals), _MOST_POINTS, 2)), np.empty((len(goals), 2))
        ends = np.empty((len(goals), 2), np.int64)
        poses = np.array([requests[k].me.pose for k in goals])
        chosen = np.array([actions[k] for k in goals], np.int64)
        records = goals_of([goal.record for goal in goals.values()])
        moves_along(records, poses, chosen, ways_m, aims_m, ends)
        for k, way_m, (x_m, y_m), (count, stops) in zip(
            goals, ways_m, aims_m.tolist(), ends.tolist(), strict=True
        ):
            results[k] = _along(requests[k], actions[k], way_m[:count], (x_m, y_m), stops=stops > 0)
        return results

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
            table = self._tables.value(coarse, model, goal_m, start)
            if table is not None and start is not None and table.reaches(start):
                spec = GoalSpec(
                    min(profile.radius_m, coarse.radius_m),
                    goal_m,
                    table.goal_m,
                    profile.others_price,
                    profile.robot_price,
                )
                return ActiveGoal(environment, table, coarse.ground, spec)
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


def _without_choice(request: NavigationRequest, prospect: Prospect) -> NavigationResult:
    """Return what follows where an agent stands, has no way, or goes straight to its goal."""
    if prospect.kind is Prospects.STRAIGHT:
        return NavigationResult(_command(request, request.intent.goal_m, request.speeds_mps[0]))
    is_there = prospect.kind is Prospects.ARRIVED
    is_lost = prospect.kind is Prospects.NO_WAY
    return NavigationResult(_command(request, None), arrived=is_there, no_way=is_lost)


def _along(
    request: NavigationRequest,
    action: Action,
    way_m: npt.NDArray[np.float64],
    aim_m: Point,
    *,
    stops: bool,
) -> NavigationResult:
    """Return what follows from an action, given where it leads; a way without points is none."""
    pace, move, becomes = action
    if move == STAY or not len(way_m):
        return NavigationResult(_command(request, None), waits=move == STAY, way_m=way_m)
    if becomes == STAY:  # a move that fails: the agent turns there, and does not go
        (x_m, y_m), here_m = aim_m, request.me.point_m
        face_rad = math.atan2(y_m - here_m[1], x_m - here_m[0])
        command = _command(request, None)._replace(stop_there=stops, face_rad=face_rad)
        return NavigationResult(command, way_m=way_m)
    command = _command(request, aim_m, request.speeds_mps[pace], stop_there=stops)
    return NavigationResult(command, way_m=way_m)


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
