"""The decision layer: once per decision period, each agent chooses a goal and finds the way there.

The first decision epoch of an agent is the first sub-step after its arrival. The agents that are
due in a sub-step decide in the order of their ids. All see the state at the end of the last
sub-step, and each draws from its own random stream.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from are_ros.agents.behaviours.calls import BehaviourCall, Failed, intent_of
from are_ros.agents.behaviours.leaving import Leaving
from are_ros.agents.behaviours.registry import make_behaviour
from are_ros.agents.behaviours.situation import (
    Behaviour,
    Intent,
    Neighbour,
    Point,
    RobotView,
    Situation,
)
from are_ros.agents.local_planner.body import PLANNERS, Body
from are_ros.agents.local_planner.planner import LocalPlanner, Obstruction
from are_ros.agents.navigation.destinations import Destinations
from are_ros.agents.navigation.navigation import (
    ActiveGoal,
    Navigation,
    NavigationRequest,
    NavigationResult,
)
from are_ros.agents.navigation.profile import NavigationProfile
from are_ros.agents.snapshot import AgentSnapshot
from are_ros.agents.table import AgentTable
from are_ros.conventions import NS_PER_S, seconds_to_ns
from are_ros.errors import BehaviourError
from are_ros.population.artefact import Artefact
from are_ros.population.randomness import Purpose, generator

PATIENCE: Final = 2
"""After so many decisions in which an agent gives way, the local planner has to pass the others,
until the agent moves again: an agent that always gives way would never count as blocked."""

MOVING_MPS: Final = 0.1
"""An agent that is faster than this has got past those for which it waited."""

BLOCKED_S: Final = 1.0
"""After this time without progress, the activity of an agent names the obstruction."""

SPOT_M, MANOEUVRING_S, STUCK_S = 0.3, 3.0, 8.0
"""An agent with a goal that stays within `SPOT_M` is said to manoeuvre after `MANOEUVRING_S`, and
counts as blocked after `STUCK_S`: a car that shunts in clutter moves, and makes no progress."""

_WALL = "a wall"


@dataclass(eq=False, slots=True)
class AgentState:
    """How one agent decides: its behaviour and planner, and the outcome of its last intent.

    `waits` counts the decisions in a row in which it gave way to others. `places` are the
    destinations that it can reach, among those of the map, `map_places`.
    """

    profile: NavigationProfile
    behaviour: Behaviour
    random: np.random.Generator
    planner: str = PLANNERS[0]
    active: ActiveGoal | None = None
    intent: Intent | None = None
    is_going: bool = False
    arrived: bool = False
    no_way: bool = False
    waits: int = 0
    spot_m: Point | None = None
    spot_since_ns: int = 0
    lingered_s: float = 0.0
    map_places: Destinations | None = None
    places: Destinations | None = None

    def note_place(self, point_m: Point, now_ns: int) -> None:
        """Update how long the agent has had a goal and stayed within one spot."""
        if not self.is_going or self.spot_m is None or math.dist(self.spot_m, point_m) > SPOT_M:
            self.spot_m, self.spot_since_ns = point_m if self.is_going else None, now_ns
        self.lingered_s = (now_ns - self.spot_since_ns) / NS_PER_S

    def note_result(self, request: NavigationRequest, result: NavigationResult) -> None:
        """Store the intent, and what navigation has made of it."""
        self.intent, self.is_going = request.intent, result.command.subgoal_m is not None
        self.arrived, self.no_way = result.arrived, result.no_way
        if result.waits:
            self.waits += 1
        elif self.waits and request.me.speed_mps > MOVING_MPS:
            self.waits = 0

    def change_behaviour(self, behaviour: Behaviour) -> None:
        """Use another behaviour from the next decision on."""
        self.behaviour = behaviour
        self.intent, self.is_going, self.arrived, self.no_way = None, False, False, False


class DecisionLayer:
    """Decides for the agents of a table that have a state: those that can move, without a track."""

    def __init__(
        self,
        seed: int,
        period_s: float,
        table: AgentTable,
        navigation: Navigation,
        planner: LocalPlanner,
    ) -> None:
        """Take the seed, the length of a decision period [s], and the parts that it uses."""
        self._seed = seed
        self._step_ns = seconds_to_ns(table.timing.step_s)
        self._period = max(1, round(period_s / table.timing.step_s))
        self._table = table
        self._navigation = navigation
        self._planner = planner
        self.report_fault: Callable[[BehaviourError], None] | None = None
        """Called for each user-defined behaviour or planner that fails; its agent stands then.
        With None, the error is raised."""

    def reseed(self, seed: int) -> None:
        """Draw from another seed for agents that arrive from now on."""
        self._seed = seed

    def admit(self, artefact: Artefact) -> None:
        """Give an agent that has just arrived a state, if it can move."""
        body = Body.of(artefact.row)
        if body.speed_mps <= 0.0:
            return
        profile = NavigationProfile.of(artefact.row, body)
        random = generator(self._seed, Purpose.GOAL, artefact.id)
        row = self._table.row_of(artefact.id)
        behaviour, planner = self._new_behaviour(artefact), self._drawn_planner(artefact)
        self._table.states[row] = AgentState(profile, behaviour, random, planner)
        self._table.phases[row] = -(-artefact.arrival_ns // self._step_ns) % self._period

    def decide(self, index: int, now_ns: int, robot: RobotView | None) -> list[int]:
        """Decide for all agents that are due in sub-step `index`; return those at an exit.

        Each agent states an intent, navigation finds the way, and the local planner gets the motion
        command. Others see the new activities in the next sub-step.
        """
        table = self._table
        columns = (table.ids, table.poses, self._planner.motion[:, 5], table.radii_m)
        view = AgentSnapshot(table.artefacts.copy(), columns, self.sees, table.doing)
        left, deciding = list[int](), dict[int, AgentState]()
        for row in np.flatnonzero(table.phases == index % self._period).tolist():
            state = table.states[row]
            if state is None:
                continue
            if isinstance(state.behaviour, Leaving) and state.behaviour.has_left:
                left.append(table.artefacts[row].id)
            else:
                deciding[row] = state
        situations = self._situations(deciding, now_ns, view, robot)
        requests = [
            NavigationRequest(
                state,
                situation.me,
                self._intent(row, state, situation),
                situation.left_s,
                state.waits < PATIENCE,
            )
            for (row, state), situation in zip(deciding.items(), situations, strict=True)
        ]
        results = self._navigation.results(requests, view, robot)
        commands = [
            result.command._replace(planner=state.planner)
            for state, result in zip(deciding.values(), results, strict=True)
        ]
        self._planner.give_commands(list(deciding), commands)
        for row, situation, request, result in zip(
            deciding, situations, requests, results, strict=True
        ):
            request.state.note_result(request, result)
            agent = table.artefacts[row]
            activity = _activity(request, result, situation)
            agent.activity = "" if activity == agent.behaviour else activity
        return left

    def send_out(self, row: int) -> None:
        """Send an agent whose life is over to an exit, from its next decision on."""
        self._change_behaviour(row, Leaving())

    def stop(self, agent_id: int, fault: BehaviourError) -> None:
        """Let an agent whose planner has failed stand, and report the error."""
        self._report(fault)
        self._change_behaviour(self._table.row_of(agent_id), Failed("its planner failed"))

    def sees(self, me: Neighbour, x_m: float, y_m: float) -> bool:
        """Return whether walls leave an agent a straight way to a point."""
        state = self._table.states[self._table.row_of(me.id)]
        if state is None:
            return False
        return self._navigation.sees(state.profile, me.point_m, (x_m, y_m))

    def _situations(
        self,
        deciding: Mapping[int, AgentState],
        now_ns: int,
        view: AgentSnapshot,
        robot: RobotView | None,
    ) -> list[Situation]:
        """Return what each of these agents, given by row, knows at its decision."""
        rows, situations = list(deciding), list[Situation]()
        for (row, state), me, (kind, other_id, since_s) in zip(
            deciding.items(), view.neighbours(rows), self._planner.obstructions(rows), strict=True
        ):
            agent = self._table.artefacts[row]
            state.note_place(me.point_m, now_ns)
            blocked_s = 0.0 if kind is Obstruction.NONE else since_s
            if state.lingered_s > STUCK_S:
                blocked_s = max(blocked_s, state.lingered_s)
            end_ns = agent.departure_ns
            situations.append(
                Situation(
                    now_ns,
                    me,
                    agent.row,
                    self._reachable(state, me),
                    state.random,
                    view,
                    robot,
                    None if end_ns is None else (end_ns - now_ns) / NS_PER_S,
                    state.intent,
                    state.arrived,
                    blocked_s,
                    _obstruction_name(kind, other_id),
                    state.no_way,
                )
            )
        return situations

    def _reachable(self, state: AgentState, me: Neighbour) -> Destinations:
        """Return the destinations that an agent can reach; they are found anew after no way."""
        map_places = self._navigation.places
        if state.places is None or state.map_places is not map_places or state.no_way:
            state.places = self._navigation.places_from(state.profile, me.point_m)
            state.map_places = map_places
        return state.places

    def _new_behaviour(self, artefact: Artefact) -> Behaviour:
        """Return a new behaviour for an artefact; `Failed` if the user's class fails."""
        call = BehaviourCall(artefact.id, artefact.row.label, artefact.arrival_ns)
        try:
            return make_behaviour(artefact.behaviour, artefact.options, call)
        except BehaviourError as fault:
            self._report(fault)
        self._table.set_behaviour(self._table.row_of(artefact.id), Failed.name)
        return Failed()

    def _drawn_planner(self, artefact: Artefact) -> str:
        """Draw the planner of an artefact for its life, by the weights of its row."""
        names, weights = zip(*artefact.row.planners.items(), strict=True)
        if len(names) == 1:
            return str(names[0])
        random = generator(self._seed, Purpose.PLANNER, artefact.id)
        return str(names[random.choice(len(names), p=weights)])

    def _intent(self, row: int, state: AgentState, situation: Situation) -> Intent:
        """Return the intent of an agent; if its behaviour fails, stop it and report the error."""
        try:
            return intent_of(state.behaviour, situation)
        except BehaviourError as fault:
            self._report(fault)
        self._change_behaviour(row, Failed())
        return state.behaviour.decide(situation)

    def _change_behaviour(self, row: int, behaviour: Behaviour) -> None:
        state = self._table.states[row]
        if state is not None:
            self._table.set_behaviour(row, behaviour.name)
            state.change_behaviour(behaviour)

    def _report(self, fault: BehaviourError) -> None:
        if self.report_fault is None:
            raise fault
        self.report_fault(fault)


def _obstruction_name(kind: Obstruction, other_id: int) -> str:
    """Return what is in the way, in words; empty if nothing is."""
    if kind is Obstruction.NONE:
        return ""
    if kind is Obstruction.ARTEFACT:
        return f"artefact {other_id}"
    return "the robot" if kind is Obstruction.ROBOT else _WALL


def _activity(request: NavigationRequest, result: NavigationResult, situation: Situation) -> str:
    """Return what an agent does at present, with the obstruction if it is blocked."""
    if result.no_way:
        return "no way"
    has_goal, name = request.intent.goal_m is not None, situation.blocked_by
    if has_goal and situation.blocked_s >= BLOCKED_S and name:
        return f"{'blocked by' if name == _WALL else 'waiting for'} {name}"
    if result.waits:
        return "giving way"
    if has_goal and request.state.lingered_s > MANOEUVRING_S:
        return "manoeuvring"
    return request.intent.activity
