"""The decision layer: once a period each agent decides what to do, and how to get there.

An agent's decision epochs are a decision period apart, from the first sub-step after its arrival
on. All that are due in a sub-step decide by what the sub-step before has left, in the order of
their ids; each draws from a stream of its own.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from are_ros.agents.behaviours.asking import Asked, Failed, intent_of
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
from are_ros.agents.local_planner.body import Body
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
"""An agent waits for others in so many decisions. Then the local planner has to get it past them,
until it gets on: one that waited again at once would never count as blocked, and never choose
another way."""

GETS_ON_MPS: Final = 0.1
BLOCKED_S: Final = 1.0
"""An agent that is kept from going on for so long says by whom."""

SPOT_M, SHUNTS_S, LINGERS_S = 0.3, 3.0, 8.0
"""An agent that wants to go, and has stayed within a spot for so long, manoeuvres, and then counts
as blocked: a car that shunts in clutter makes some progress each time, and none in all."""

_WALL = "a wall"
_Asked = tuple[int, Artefact, "AgentState"]
"""The row of one that is asked, what it is, and how it decides."""


@dataclass(eq=False, slots=True)
class AgentState:
    """The behaviour of one agent that decides, and what became of its last intent."""

    profile: NavigationProfile
    behaviour: Behaviour
    random: np.random.Generator
    active: ActiveGoal | None = None
    intent: Intent | None = None
    is_going: bool = False
    arrived: bool = False
    no_way: bool = False
    waits: int = 0
    spot_m: Point | None = None
    spot_since_ns: int = 0
    lingered_s: float = 0.0
    known_places: Destinations | None = None
    places: Destinations | None = None

    def note_place(self, point_m: Point, now_ns: int) -> None:
        """See for how long it has wanted to go and stayed within a spot."""
        if not self.is_going or self.spot_m is None or math.dist(self.spot_m, point_m) > SPOT_M:
            self.spot_m, self.spot_since_ns = point_m if self.is_going else None, now_ns
        self.lingered_s = (now_ns - self.spot_since_ns) / NS_PER_S

    def note_result(self, request: NavigationRequest, result: NavigationResult) -> None:
        """Keep what it has decided, and what that means."""
        self.intent, self.is_going = request.intent, result.command.subgoal_m is not None
        self.arrived, self.no_way = result.arrived, result.no_way
        if result.waits:
            self.waits += 1
        elif self.waits and request.me.speed_mps > GETS_ON_MPS:
            self.waits = 0

    def begin_anew(self, behaviour: Behaviour) -> None:
        """Do something else from the next decision on."""
        self.behaviour = behaviour
        self.intent, self.is_going, self.arrived, self.no_way = None, False, False, False


class DecisionLayer:
    """Lets those agents of a table decide that have a state: that can move, and have no track."""

    def __init__(
        self,
        seed: int,
        period_s: float,
        table: AgentTable,
        navigation: Navigation,
        planner: LocalPlanner,
    ) -> None:
        """Take the length of a decision period."""
        self._seed = seed
        self._step_ns = seconds_to_ns(table.timing.step_s)
        self._period = max(1, round(period_s / table.timing.step_s))
        self._table = table
        self._navigation = navigation
        self._planner = planner
        self.tell_fault: Callable[[BehaviourError], None] | None = None
        """Told of each behaviour of the user's own that fails, whose agent stands from then on;
        with None that is raised."""

    def reseed(self, seed: int) -> None:
        """Let those who arrive later draw from another seed."""
        self._seed = seed

    def admit(self, artefact: Artefact) -> None:
        """Give an agent that has just arrived a behaviour, where it can move."""
        body = Body.of(artefact.row)
        if body.speed_mps <= 0.0:
            return
        profile = NavigationProfile.of(artefact.row, body)
        random = generator(self._seed, Purpose.GOAL, artefact.id)
        row = self._table.row_of(artefact.id)
        self._table.states[row] = AgentState(profile, self._made(artefact), random)
        self._table.phases[row] = -(-artefact.arrival_ns // self._step_ns) % self._period

    def decide(self, index: int, now_ns: int, robot: RobotView | None) -> list[int]:
        """Let all decide who are due in sub-step `index`; return who has left by an exit.

        Each is asked what it wants, finds the way there, and tells the traffic where to go. What
        it says then is seen by the others in the next sub-step.
        """
        table, speeds_mps = self._table, self._planner.motion[:, 5]
        view = AgentSnapshot(
            table.artefacts.copy(),
            (table.ids, table.poses, speeds_mps, table.radii_m),
            self.sees,
            table.doing,
        )
        out, asked = list[int](), list[_Asked]()
        for row in np.flatnonzero(table.phases == index % self._period).tolist():
            agent, state = table.artefacts[row], table.states[row]
            if state is None:
                continue
            if isinstance(state.behaviour, Leaving) and state.behaviour.has_left:
                out.append(agent.id)
            else:
                asked.append((row, agent, state))
        requests, situations = self._requests(asked, now_ns, view, robot)
        results = self._navigation.results(requests, view, robot)
        self._planner.give_commands(
            [row for row, _, _ in asked], [result.command for result in results]
        )
        for (_, agent, state), request, result, situation in zip(
            asked, requests, results, situations, strict=True
        ):
            state.note_result(request, result)
            activity = _activity(request.intent, result, situation, state.lingered_s)
            behaviour = agent.behaviour
            agent.activity = "" if activity == behaviour else activity
        return out

    def send_out(self, row: int) -> None:
        """Let an agent walk to an exit from its next decision on; its life is over."""
        self._begin_anew(row, Leaving())

    def sees(self, me: Neighbour, x_m: float, y_m: float) -> bool:
        """Say whether an agent could go straight to a point, were nobody in its way."""
        state = self._table.states[self._table.row_of(me.id)]
        if state is None:
            return False
        return self._navigation.sees(state.profile, me.point_m, (x_m, y_m))

    def _requests(
        self, asked: Sequence[_Asked], now_ns: int, view: AgentSnapshot, robot: RobotView | None
    ) -> tuple[list[NavigationRequest], list[Situation]]:
        """Return what each of those who are asked wants, and what it knows."""
        rows = [row for row, _, _ in asked]
        known = zip(asked, view.neighbours(rows), self._planner.obstructions(rows), strict=True)
        situations = [
            self._situation(agent, state, me, obstruction, now_ns, view, robot)
            for (_, agent, state), me, obstruction in known
        ]
        return [
            NavigationRequest(
                state,
                situation.me,
                self._intent(row, state, situation),
                situation.left_s,
                state.waits < PATIENCE,
            )
            for (row, _, state), situation in zip(asked, situations, strict=True)
        ], situations

    def _situation(
        self,
        agent: Artefact,
        state: AgentState,
        me: Neighbour,
        obstruction: tuple[Obstruction, int, float],
        now_ns: int,
        view: AgentSnapshot,
        robot: RobotView | None,
    ) -> Situation:
        """Return what an agent knows when it decides."""
        state.note_place(me.point_m, now_ns)
        what, who, since_s = obstruction
        blocked_s = 0.0 if what is Obstruction.NONE else since_s
        if state.lingered_s > LINGERS_S:
            blocked_s = max(blocked_s, state.lingered_s)
        departure_ns = agent.departure_ns
        return Situation(
            now_ns,
            me,
            agent.row,
            self._places_of(state, me),
            state.random,
            view,
            robot,
            None if departure_ns is None else (departure_ns - now_ns) / NS_PER_S,
            state.intent,
            state.arrived,
            blocked_s,
            _name_of(what, who),
            state.no_way,
        )

    def _places_of(self, state: AgentState, me: Neighbour) -> Destinations:
        """Return the places that one can get to, looked for anew where it has found no way."""
        known = self._navigation.places
        if state.places is None or state.known_places is not known or state.no_way:
            state.places = self._navigation.places_from(state.profile, me.point_m)
            state.known_places = known
        return state.places

    def _made(self, artefact: Artefact) -> Behaviour:
        """Return a new behaviour for an artefact."""
        asked = Asked(artefact.id, artefact.row.label, artefact.arrival_ns)
        try:
            return make_behaviour(artefact.behaviour, artefact.options, asked)
        except BehaviourError as fault:
            self._tell(fault)
        self._table.set_behaviour(self._table.row_of(artefact.id), Failed.name)
        return Failed()

    def _intent(self, row: int, state: AgentState, situation: Situation) -> Intent:
        """Return what an agent wants: nothing any more, once its behaviour has failed."""
        try:
            return intent_of(state.behaviour, situation)
        except BehaviourError as fault:
            self._tell(fault)
        self._begin_anew(row, Failed())
        return state.behaviour.decide(situation)

    def _begin_anew(self, row: int, behaviour: Behaviour) -> None:
        state = self._table.states[row]
        if state is not None:
            self._table.set_behaviour(row, behaviour.name)
            state.begin_anew(behaviour)

    def _tell(self, fault: BehaviourError) -> None:
        if self.tell_fault is None:
            raise fault
        self.tell_fault(fault)


def _name_of(what: Obstruction, who: int) -> str:
    """Return what is in the way, in words; none if nothing is."""
    if what is Obstruction.NONE:
        return ""
    if what is Obstruction.ARTEFACT:
        return f"artefact {who}"
    return "the robot" if what is Obstruction.ROBOT else _WALL


def _activity(
    intent: Intent, result: NavigationResult, situation: Situation, lingered_s: float
) -> str:
    """Return what an agent does just now; what it waits for, where it cannot go on."""
    if result.no_way:
        return "no way"
    wants_to_go = intent.goal_m is not None
    name = situation.blocked_by
    if wants_to_go and situation.blocked_s >= BLOCKED_S and name:
        return f"{'blocked by' if name == _WALL else 'waiting for'} {name}"
    if result.waits:
        return "giving way"
    if wants_to_go and lingered_s > SHUNTS_S:
        return "manoeuvring"
    return intent.activity
