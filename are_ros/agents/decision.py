"""The decision layer: once per decision period, each agent chooses an action (section 3.2).

An action is a behaviour, a planner and a move. The behaviour gives an intent: a goal and a speed.
The move is one of the decision process of going to that goal; it may slip. The first decision epoch
of an agent is the first sub-step after its arrival. The agents that are due in a sub-step decide in
the order of their ids. All see the state at the end of the last sub-step, and each draws from its
own random streams.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.calls import BehaviourCall, Failed, intent_of
from are_ros.agents.behaviours.leaving import Hides, Leaving, WalkingOut, choose_exits, early_s
from are_ros.agents.behaviours.repertoire import Repertoire
from are_ros.agents.behaviours.situation import (
    Behaviour,
    Intent,
    Neighbour,
    Point,
    RobotView,
    Situation,
)
from are_ros.agents.behaviours.walking import arrival_m
from are_ros.agents.body import Body
from are_ros.agents.local_planner.planner import LocalPlanner, Obstruction
from are_ros.agents.mdp.policy import (
    STAY,
    boltzmann,
    drawn,
    persistence_of,
    prior_of,
    slipped,
    surely_drawn,
)
from are_ros.agents.mdp.routes import AHEAD
from are_ros.agents.navigation.destinations import Destinations
from are_ros.agents.navigation.navigation import (
    ActiveGoal,
    GoalKey,
    Navigation,
    NavigationRequest,
    NavigationResult,
    Prospect,
    Prospects,
)
from are_ros.agents.navigation.profile import NavigationProfile
from are_ros.agents.snapshot import AgentSnapshot
from are_ros.agents.table import AgentTable
from are_ros.conventions import NS_PER_S, seconds_to_ns
from are_ros.errors import BehaviourError
from are_ros.parameters.model import BehaviourParameters
from are_ros.population.artefact import Artefact
from are_ros.population.randomness import Purpose, generator

PATIENCE: Final = 2
"""After so many decisions in which an agent gives way, the local planner has to pass the others,
until the agent moves again: an agent that always gives way would never count as blocked."""

MOVING_MPS: Final = 0.1
"""An agent that is faster than this has got past those for which it waited."""

BLOCKED_S: Final = 1.0
"""After this time without progress, the activity of an agent names the obstruction."""

SPOT_M, MANOEUVRING_S, STUCK_S, TURNS_S = 0.3, 3.0, 8.0, 24.0
"""An agent with a goal that stays within `SPOT_M` is said to manoeuvre after `MANOEUVRING_S`, as is
a vehicle that turns round in legs, and counts as blocked after `STUCK_S`: a car that shunts in
clutter moves, and makes no progress. So does one whose value of the goal has not grown for that
time: it paces to and fro. A vehicle in a manoeuvre has `TURNS_S`: its value grows
only after the manoeuvre."""

_MOVES: Final = 5
_NO_LOSS, _NEAR_EXIT_S = 0.1, 2.0
"""Less than this share of the price of time is no loss; one sets out at least so early [s]."""

_GAIN: Final = 1e-6
"""A value that has grown by less than this has not grown."""

_WALL = "a wall"
_Floats = npt.NDArray[np.float64]
_Mask = npt.NDArray[np.bool_]


@dataclass(eq=False, slots=True)
class AgentState:
    """How one agent decides: its behaviours, and the outcome of its last intent.

    `waits` counts the decisions in a row in which it gave way to others. `best_value` is the
    highest value that it has had on the way to `gained_m`, since `gained_ns`. `places` are the
    destinations that it can reach, among those of the map, `map_places`.
    """

    profile: NavigationProfile
    repertoire: Repertoire
    random: np.random.Generator
    policy_random: np.random.Generator
    slip: float = 0.0
    active: dict[GoalKey, ActiveGoal] = field(default_factory=dict)
    intent: Intent | None = None
    is_going: bool = False
    arrived: bool = False
    no_way: bool = False
    waits: int = 0
    spot_m: Point | None = None
    spot_since_ns: int = 0
    lingered_s: float = 0.0
    gained_m: Point | None = None
    best_value: float = -math.inf
    gained_ns: int = 0
    map_places: Destinations | None = None
    places: Destinations | None = None

    def note_place(self, point_m: Point, now_ns: int) -> None:
        """Update how long the agent has wanted to go on and stayed within one spot."""
        if not self.is_going or self.spot_m is None or math.dist(self.spot_m, point_m) > SPOT_M:
            self.spot_m, self.spot_since_ns = point_m if self.is_going else None, now_ns
        self.lingered_s = (now_ns - self.spot_since_ns) / NS_PER_S

    def note_gain(self, goal_m: Point | None, value: float | None, now_ns: int) -> None:
        """Update since when the agent has come no nearer to its goal, by the value of its state.

        With no value it has no choice of ways: it stands, or goes straight.
        """
        if value is None or goal_m != self.gained_m or value > self.best_value + _GAIN:
            self.gained_m, self.gained_ns = goal_m, now_ns
            self.best_value = -math.inf if value is None else value

    def note_result(self, request: NavigationRequest, result: NavigationResult) -> None:
        """Store the intent, and what navigation has made of it."""
        # one that gives way wants to go on: it may try and give way by turns
        self.is_going = result.waits or result.command.subgoal_m is not None
        self.intent = request.intent
        self.arrived, self.no_way = result.arrived, result.no_way
        if result.waits:
            self.waits += 1
        elif self.waits and request.me.speed_mps > MOVING_MPS:
            self.waits = 0

    def postpone(self, by_ns: int) -> None:
        """Let a time pass in which the agent could not come nearer to its goal."""
        self.spot_since_ns += by_ns
        self.gained_ns += by_ns

    @property
    def behaviour(self) -> Behaviour:
        """The behaviour in force."""
        return self.repertoire.behaviour

    def keep_to(self, behaviour: Behaviour) -> None:
        """Have only this behaviour from the next decision on."""
        self.repertoire = Repertoire.only(behaviour)
        self.intent, self.is_going, self.arrived, self.no_way = None, False, False, False


Report = Callable[
    [NavigationRequest, Prospect, NavigationResult, AgentSnapshot, RobotView | None], None
]
"""Is told of a decision: what was asked, what the actions were worth, and what was chosen."""


class DecisionLayer:
    """Decides for the agents of a table that have a state: those that can move, without a track."""

    def __init__(
        self,
        seed: int,
        settings: BehaviourParameters,
        table: AgentTable,
        navigation: Navigation,
        planner: LocalPlanner,
    ) -> None:
        """Take the seed, the parameters of the decision process, and the parts that it uses."""
        self._seed = seed
        self._settings = settings
        self._step_ns = seconds_to_ns(table.timing.step_s)
        self._period = max(1, round(settings.decision_period / table.timing.step_s))
        self._stays = persistence_of(settings.decision_period, settings.persistence)
        self._table = table
        self._navigation = navigation
        self._planner = planner
        self.report_fault: Callable[[BehaviourError], None] | None = None
        """Called for each user-defined behaviour or planner that fails; its agent stands then.
        With None, the error is raised."""
        self.report_change: Callable[[int, Artefact, str], None] = _ignored
        """Called with the time [ns], an artefact whose behaviour has changed, and the last one."""
        self.report: Report | None = None
        """Called for each decision; None: decisions are not reported."""
        self.by_exit = False
        """Whether artefacts that arrive from now on are at an exit at the end of their lives."""
        self.hides: Hides = _all_hidden
        """Tells which points (N, 2), map frame [m], no camera sees: bool (N,)."""

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
        policy_random = generator(self._seed, Purpose.DECISION, artefact.id)
        row, slip = self._table.row_of(artefact.id), artefact.row.slip
        self._table.states[row] = AgentState(
            profile,
            self._new_repertoire(artefact),
            random,
            policy_random,
            self._settings.slip if slip is None else slip,
            gained_ns=artefact.arrival_ns,
        )
        artefact.planner = _drawn_planner(artefact, policy_random)
        self._table.phases[row] = -(-artefact.arrival_ns // self._step_ns) % self._period

    def decide(self, index: int, now_ns: int, robot: RobotView | None) -> list[int]:
        """Decide for all agents that are due in sub-step `index`; return those at an exit.

        The policy chooses a behaviour, which states an intent; then a move towards its goal.
        Navigation finds the way, and the local planner gets the motion command. Others see the new
        activities in the next sub-step.
        """
        rows: list[int] = np.flatnonzero(self._table.phases == index % self._period).tolist()
        if not rows:
            return []
        view = self._snapshot()
        left, deciding = self._deciding(rows)
        situations = self._situations(deciding, now_ns, view, robot)
        known = self._choose_behaviours(dict(zip(deciding, situations, strict=True)), view, robot)
        requests = [
            _request(state, situation, self._intent(row, state, situation))
            for (row, state), situation in zip(deciding.items(), situations, strict=True)
        ]
        prospects = self._prospects(dict(zip(deciding, requests, strict=True)), known, view, robot)
        results = [self._act(*one) for one in zip(requests, prospects, strict=True)]
        if self.report is not None:
            for decision in zip(requests, prospects, results, strict=True):
                self.report(*decision, view, robot)
        self._command(list(deciding), results)
        turning = self._planner.are_manoeuvring(list(deciding))
        for decided in zip(
            deciding, requests, prospects, results, situations, turning, strict=True
        ):
            self._note(*decided)
        return left

    def _snapshot(self) -> AgentSnapshot:
        """Return all agents as those that decide see them."""
        table = self._table
        epochs = range(self._period, (AHEAD + 1) * self._period, self._period)
        ahead_m = np.stack([table.committed(steps)[:, :2] for steps in epochs], axis=1)
        columns = (table.ids, table.poses, self._planner.motion[:, 5], ahead_m, table.radii_m)
        return AgentSnapshot(table.artefacts.copy(), columns, self.sees, table.doing_now())

    def _deciding(self, rows: Sequence[int]) -> tuple[list[int], dict[int, AgentState]]:
        """Return the ids of agents that have left by an exit, and the states of the others."""
        left, deciding = list[int](), dict[int, AgentState]()
        for row in rows:
            state = self._table.states[row]
            if state is None:
                continue
            if isinstance(state.behaviour, Leaving) and state.behaviour.has_left:
                left.append(self._table.artefacts[row].id)
            else:
                deciding[row] = state
        return left, deciding

    def _command(self, rows: Sequence[int], results: Sequence[NavigationResult]) -> None:
        """Give the local planner the motion commands of agents, each with the planner chosen."""
        artefacts = self._table.artefacts
        commands = [
            result.command._replace(planner=artefacts[row].planner)
            for row, result in zip(rows, results, strict=True)
        ]
        self._planner.give_commands(rows, commands)

    def _note(
        self,
        row: int,
        request: NavigationRequest,
        prospect: Prospect,
        result: NavigationResult,
        situation: Situation,
        is_turning: bool,
    ) -> None:
        """Keep what an agent has decided, and name what it does now."""
        request.state.note_result(request, result)
        value = prospect.value if prospect.kind is Prospects.CHOOSES else None
        request.state.note_gain(request.intent.goal_m, value, situation.now_ns)
        agent = self._table.artefacts[row]
        activity = _activity(request, result, situation, is_turning)
        agent.activity = "" if activity == agent.behaviour else activity

    def _choose_behaviours(
        self, situations: Mapping[int, Situation], view: AgentSnapshot, robot: RobotView | None
    ) -> Mapping[int, tuple[Point, Prospect]]:
        """Choose the behaviours of the agents that have several, given their situations by row.

        Returns the destinations of journeys, and the prospects of going there.

        pi(b' | s) is proportional to prior(b' | b) exp((r(b') + A(b')) / T): r is what an epoch of
        the behaviour is worth by itself, A by how much its best move is worse than the best one of
        the journey. A behaviour with a goal of its own gets no further on it, as by staying.
        """
        several = {
            row: state
            for row in situations
            if (state := self._table.states[row]) is not None and len(state.repertoire) > 1
        }
        self._find_exits(situations, view, robot)
        travelling = {
            row: _request(state, situations[row], intent)
            for row, state in several.items()
            if (intent := _intent_of_journey(state, situations[row])) is not None
        }
        prospects = self._navigation.prospects(list(travelling.values()), view, robot)
        known = dict(zip(travelling, prospects, strict=True))
        for row, state in several.items():
            situation, repertoire = situations[row], state.repertoire
            prospect, advantages = known.get(row), [0.0] * len(repertoire)
            if prospect is not None and prospect.kind is Prospects.CHOOSES:
                advantages = repertoire.advantages(prospect.values, prospect.rest)
            try:
                chosen = self._drawn_behaviour(state, situation, advantages)
            except BehaviourError as fault:
                self._stop(row, fault, situation.now_ns)
                continue
            if chosen != repertoire.in_force:
                self._change(row, state, chosen, situation.now_ns)
        return {
            row: (request.intent.goal_m, known[row])
            for row, request in travelling.items()
            if request.intent.goal_m is not None
        }

    def _drawn_behaviour(
        self, state: AgentState, situation: Situation, advantages: Sequence[float]
    ) -> int:
        """Draw the index of a behaviour, given the advantages (B,) of their best moves.

        Rewards take long to find in a crowd, and hardly ever matter: most draws keep the behaviour
        in force, or are those of a much better one. So at first only their bounds are looked at.
        """
        repertoire, settings = state.repertoire, self._settings
        if repertoire.way_out is not None and repertoire.way_out.is_time:
            return repertoire.names.index(WalkingOut.name)
        prior = prior_of(repertoire.shares, repertoire.in_force, self._stays)
        period_s, temperature = settings.decision_period, settings.temperature
        ranges = repertoire.reward_bounds(situation)
        uniform = state.policy_random.random()
        if temperature > 0.0:
            index = surely_drawn(prior, ranges, advantages, period_s, temperature, uniform)
            if index is not None:
                return index
        values = [
            period_s * reward + advantage
            for reward, advantage in zip(repertoire.rewards(situation), advantages, strict=True)
        ]
        return drawn(boltzmann(prior, values, temperature), uniform)

    def _prospects(
        self,
        requests: Mapping[int, NavigationRequest],
        known: Mapping[int, tuple[Point, Prospect]],
        view: AgentSnapshot,
        robot: RobotView | None,
    ) -> list[Prospect]:
        """Return the prospects of requests by row; those of journeys that go on are known."""
        new = {
            row: request
            for row, request in requests.items()
            if row not in known or known[row][0] != request.intent.goal_m
        }
        found = self._navigation.prospects(list(new.values()), view, robot)
        by_row = dict(zip(new, found, strict=True))
        return [by_row.get(row) or known[row][1] for row in requests]

    def _find_exits(
        self, situations: Mapping[int, Situation], view: AgentSnapshot, robot: RobotView | None
    ) -> None:
        """Find exits for agents that walk out, or have to be at one soon, when their life ends.

        It is time to go if an epoch spent otherwise makes the way too long to be walked, or the
        value of going there less by more than a share of the price of time.
        """
        settings, leaving = self._settings, list[tuple[AgentState, WalkingOut, Situation]]()
        for row, situation in situations.items():
            state = self._table.states[row]
            if state is None or (way_out := state.repertoire.way_out) is None:
                continue
            if state.behaviour is way_out or early_s(situation) <= settings.max_horizon:
                leaving.append((state, way_out, situation))
        choose_exits([(way_out, situation) for _, way_out, situation in leaving], self.hides)
        waiting = [
            (state, way_out, situation)
            for state, way_out, situation in leaving
            if early_s(situation) <= settings.max_horizon
            and way_out.exit_m is not None
            and not way_out.is_time
        ]
        requests = [
            _request(state, situation, way_out.intent(situation))._replace(
                left_s=early_s(situation)
            )
            for state, way_out, situation in waiting
        ]
        prospects = self._navigation.prospects(requests, view, robot)
        for (_, way_out, situation), request, prospect in zip(
            waiting, requests, prospects, strict=True
        ):
            is_late = way_out.is_late_after(situation, settings.decision_period)
            way_out.is_time = is_late or self._is_time(request, prospect)
            if prospect.kind is Prospects.NO_WAY:
                way_out.give_up()

    def _is_time(self, request: NavigationRequest, prospect: Prospect) -> bool:
        """Return whether an agent has to set out for its exit now."""
        if prospect.kind is Prospects.CHOOSES:
            price = request.state.profile.row.rewards.time
            return prospect.value - prospect.later > _NO_LOSS * price
        return (request.left_s or 0.0) <= self._settings.decision_period + _NEAR_EXIT_S

    def _change(self, row: int, state: AgentState, chosen: int, now_ns: int) -> None:
        """Put another behaviour of an agent's repertoire in force."""
        artefact = self._table.artefacts[row]
        was, state.repertoire.in_force = artefact.behaviour, chosen
        artefact.planner = _drawn_planner(artefact, state.policy_random)
        self._table.set_behaviour(row, state.repertoire.names[chosen])
        self.report_change(now_ns, artefact, was)

    def _act(self, request: NavigationRequest, prospect: Prospect) -> NavigationResult:
        """Draw a move by Boltzmann's law, let it slip, and return what follows from it."""
        if prospect.kind is not Prospects.CHOOSES:
            return self._navigation.result(request, prospect, 0, STAY)
        state, paces = request.state, request.state.repertoire.paces
        values = prospect.values[paces].ravel().tolist()
        # at any pace to stay is the same action
        prior = [float(at < _MOVES or at % _MOVES != STAY) for at in range(len(values))]
        weights = boltzmann(prior, values, self._settings.temperature)
        pace, move = divmod(drawn(weights, state.policy_random.random()), _MOVES)
        pace += paces.indices(len(prospect.values))[0]
        becomes = slipped(move, state.slip, state.policy_random.random())
        if becomes not in {STAY, move}:
            return self._navigation.slipped(request, prospect, pace, becomes)
        result = self._navigation.result(request, prospect, pace, move)
        # a move that fails: the agent turns there, and does not go
        return result if becomes == move else _hesitating(request, result)

    def send_out(self, row: int, now_ns: int) -> None:
        """Send an agent whose life is over to an exit, from its next decision on."""
        self._keep_to(row, Leaving(), now_ns)

    def stop(self, agent_id: int, fault: BehaviourError, now_ns: int) -> None:
        """Let an agent whose planner has failed stand, and report the error."""
        self._report_fault(fault)
        self._keep_to(self._table.row_of(agent_id), Failed("its planner failed"), now_ns)

    def sees(self, me: Neighbour, x_m: float, y_m: float) -> bool:
        """Return whether walls leave an agent a straight way to a point."""
        state = self._table.states[self._table.row_of(me.id)]
        if state is None:
            return False
        # whole numbers, too, or the kernel would be compiled once more
        return self._navigation.sees(state.profile, me.point_m, (float(x_m), float(y_m)))

    def _situations(
        self,
        deciding: Mapping[int, AgentState],
        now_ns: int,
        view: AgentSnapshot,
        robot: RobotView | None,
    ) -> list[Situation]:
        """Return what each of these agents, given by row, knows at its decision."""
        rows, situations = list(deciding), list[Situation]()
        for (row, state), me, (kind, other_id, since_s), is_turning in zip(
            deciding.items(),
            map(view.neighbour_at, rows),
            self._planner.obstructions(rows),
            self._planner.are_manoeuvring(rows),
            strict=True,
        ):
            agent = self._table.artefacts[row]
            state.note_place(me.point_m, now_ns)
            blocked_s = 0.0 if kind is Obstruction.NONE else since_s
            stuck_s = TURNS_S if is_turning else STUCK_S
            for without_s in (state.lingered_s, (now_ns - state.gained_ns) / NS_PER_S):
                if without_s > stuck_s:
                    blocked_s = max(blocked_s, without_s)
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

    def _new_repertoire(self, artefact: Artefact) -> Repertoire:
        """Return the repertoire of an artefact; it stands if a user-defined class fails."""
        call = BehaviourCall(artefact.id, artefact.row.label, artefact.arrival_ns)
        try:
            return Repertoire.of(artefact, call, by_exit=self.by_exit and artefact.may_change)
        except BehaviourError as fault:
            self._report_fault(fault)
        self._table.set_behaviour(self._table.row_of(artefact.id), Failed.name)
        return Repertoire.only(Failed())

    def _intent(self, row: int, state: AgentState, situation: Situation) -> Intent:
        """Return the intent of an agent; if its behaviour fails, stop it and report the error."""
        try:
            return intent_of(state.behaviour, situation)
        except BehaviourError as fault:
            self._stop(row, fault, situation.now_ns)
        return state.behaviour.decide(situation)

    def _stop(self, row: int, fault: BehaviourError, now_ns: int) -> None:
        """Report the error of an agent's behaviour, and let it stand from now on."""
        self._report_fault(fault)
        self._keep_to(row, Failed(), now_ns)

    def _keep_to(self, row: int, behaviour: Behaviour, now_ns: int) -> None:
        """Let an agent have only this behaviour from now on."""
        state, artefact = self._table.states[row], self._table.artefacts[row]
        if state is not None:
            was = artefact.behaviour
            self._table.set_behaviour(row, behaviour.name)
            state.keep_to(behaviour)
            if artefact.behaviour != was:
                self.report_change(now_ns, artefact, was)

    def _report_fault(self, fault: BehaviourError) -> None:
        if self.report_fault is None:
            raise fault
        self.report_fault(fault)


def _drawn_planner(artefact: Artefact, random: np.random.Generator) -> str:
    """Draw a planner by the shares of a row; nothing is drawn if there is only one."""
    names, shares = list(artefact.row.planners), list(artefact.row.planners.values())
    return names[0] if len(names) == 1 else names[drawn(shares, random.random())]


def _all_hidden(points_m: _Floats) -> _Mask:
    """Return that no camera sees any of the points."""
    return np.ones(len(points_m), np.bool_)


def _ignored(now_ns: int, artefact: Artefact, was: str) -> None:
    """Do nothing."""


def _intent_of_journey(state: AgentState, situation: Situation) -> Intent | None:
    """Return the intent of going on with a journey, None if there is no destination."""
    journey = state.repertoire.journey
    if journey is None or journey.goal_m is None:
        return None
    speeds_mps = state.repertoire.speeds_mps(situation)
    return Intent(journey.goal_m, speeds_mps[0], arrival_m(situation)) if speeds_mps else None


def _hesitating(request: NavigationRequest, result: NavigationResult) -> NavigationResult:
    """Return the result of a move that fails: the agent stands, and faces where it leads."""
    (x_m, y_m), subgoal_m = request.me.point_m, result.command.subgoal_m
    face_rad = None if subgoal_m is None else math.atan2(subgoal_m[1] - y_m, subgoal_m[0] - x_m)
    command = result.command._replace(subgoal_m=None, speed_mps=0.0, face_rad=face_rad)
    return result._replace(command=command)


def _request(state: AgentState, situation: Situation, intent: Intent) -> NavigationRequest:
    """Return what navigation is asked: the journey or the way out at all speeds, a goal at one."""
    repertoire = state.repertoire
    speeds_mps: tuple[float, ...] = (intent.speed_mps,)
    journey, way_out = repertoire.journey, repertoire.way_out
    if way_out is not None and intent.goal_m is not None and intent.goal_m == way_out.exit_m:
        motion = situation.row.motion
        speeds_mps = tuple(sorted({motion.speed_mps, motion.speed_mps * motion.running_factor}))
    if journey is not None and intent.goal_m is not None and intent.goal_m == journey.goal_m:
        speeds_mps = repertoire.speeds_mps(situation)
    return NavigationRequest(
        state, situation.me, intent, speeds_mps, situation.left_s, state.waits < PATIENCE
    )


def _obstruction_name(kind: Obstruction, other_id: int) -> str:
    """Return what is in the way, in words; empty if nothing is."""
    if kind is Obstruction.NONE:
        return ""
    if kind is Obstruction.ARTEFACT:
        return f"artefact {other_id}"
    return "the robot" if kind is Obstruction.ROBOT else _WALL


def _activity(
    request: NavigationRequest, result: NavigationResult, situation: Situation, is_turning: bool
) -> str:
    """Return what an agent does at present, with the obstruction if it is blocked."""
    if result.no_way:
        return "no way"
    has_goal, name = request.intent.goal_m is not None, situation.blocked_by
    if has_goal and situation.blocked_s >= BLOCKED_S and name:
        return f"{'blocked by' if name == _WALL else 'waiting for'} {name}"
    if result.waits:
        return "giving way"
    if has_goal and (is_turning or request.state.lingered_s > MANOEUVRING_S):
        return "manoeuvring"
    return request.intent.activity
