"""What the artefacts have in mind: once a period each decides what to do, and how to get there.

An artefact's decision epochs are a decision period apart, from the first sub-step after its arrival
on. All that are due in a sub-step decide by what the sub-step before has left, in the order of
their ids; each draws from a stream of its own.
"""

import math
from bisect import insort
from dataclasses import dataclass

import numpy as np

from are_ros.artefacts.artefact import Artefact
from are_ros.artefacts.behaviours.intent import Behaviour, Intent, Point
from are_ros.artefacts.behaviours.leaving import Leaving
from are_ros.artefacts.behaviours.registry import make_behaviour
from are_ros.artefacts.behaviours.situation import Fellow, RobotView, Situation
from are_ros.artefacts.motion.body import Body
from are_ros.artefacts.motion.hindrance import Hindrance
from are_ros.artefacts.motion.traffic import Traffic
from are_ros.artefacts.navigation import Leg, Navigation
from are_ros.artefacts.onlookers import Onlookers
from are_ros.artefacts.randomness import Purpose, generator
from are_ros.artefacts.traveller import Traveller
from are_ros.conventions import NS_PER_S, seconds_to_ns

_PATIENCE = 2
"""So many decisions one waits for others; then it is the traffic's to get past them, until it gets
on: who waited again at once would never count as blocked, and never choose another way."""

_GETS_ON_MPS = 0.1

_SPOT_M, _SHUNTS_S, _LINGERS_S = 0.3, 3.0, 8.0
"""Who wants to go, and has stayed within a spot for so long, manoeuvres, and then is blocked,
whatever by: a car that shunts in clutter makes some progress each time, and none in all."""


@dataclass(eq=False, slots=True)
class Mind:
    """One artefact's behaviour, and what became of its last intent."""

    artefact: Artefact
    traveller: Traveller
    behaviour: Behaviour
    random: np.random.Generator
    phase: int
    intent: Intent | None = None
    leg: Leg | None = None
    waits: int = 0
    spot_m: Point | None = None
    spot_since_ns: int = 0
    lingered_s: float = 0.0

    @property
    def is_out(self) -> bool:
        """Whether it has left by an exit."""
        return isinstance(self.behaviour, Leaving) and self.behaviour.has_left

    def look_about(self, me: Fellow, now_ns: int) -> None:
        """See for how long it has wanted to go and stayed within a spot."""
        is_going = self.leg is not None and self.leg.order.subgoal_m is not None
        spot_m = self.spot_m
        if not is_going or spot_m is None or math.dist(spot_m, me.point_m) > _SPOT_M:
            self.spot_m, self.spot_since_ns = me.point_m if is_going else None, now_ns
        self.lingered_s = (now_ns - self.spot_since_ns) / NS_PER_S


class Minds:
    """Lets those decide who can move; the others stand, and have no mind."""

    def __init__(self, seed: int, step_s: float, period_s: float, navigation: Navigation) -> None:
        """Take the lengths of a sub-step and of a decision period."""
        self._seed = seed
        self._step_ns = seconds_to_ns(step_s)
        self._period = max(1, round(period_s / step_s))
        self._navigation = navigation
        self._minds: dict[int, Mind] = {}
        self._due: list[list[int]] = [[] for _ in range(self._period)]

    def reseed(self, seed: int) -> None:
        """Let those who arrive later draw from another seed."""
        self._seed = seed

    def admit(self, artefact: Artefact, body: Body) -> None:
        """Give an artefact that has just arrived a mind, where it can move."""
        if body.speed_mps <= 0.0:
            return
        phase = -(-artefact.arrival_ns // self._step_ns) % self._period
        behaviour = make_behaviour(artefact.behaviour, artefact.options)
        random = generator(self._seed, Purpose.GOAL, artefact.id)
        traveller = Traveller.of(artefact.row, body)
        self._minds[artefact.id] = Mind(artefact, traveller, behaviour, random, phase)
        insort(self._due[phase], artefact.id)

    def dismiss(self, artefact_id: int) -> None:
        """Forget an artefact, known or not."""
        self._navigation.forget(artefact_id)
        mind = self._minds.pop(artefact_id, None)
        if mind is not None:
            self._due[mind.phase].remove(artefact_id)

    def send_out(self, artefact_id: int) -> None:
        """Let an artefact walk to an exit from its next decision on; its life is over."""
        mind = self._minds[artefact_id]
        mind.artefact.behaviour = Leaving.name
        mind.behaviour, mind.intent, mind.leg = Leaving(), None, None

    def has(self, artefact_id: int) -> bool:
        """Say whether an artefact has a mind: whether it can move."""
        return artefact_id in self._minds

    def decide(
        self,
        index: int,
        now_ns: int,
        view: Onlookers,
        traffic: Traffic,
        robot: RobotView | None,
    ) -> list[int]:
        """Let all decide who are due in sub-step `index`; return who has left by an exit."""
        out, decided = [], []
        for artefact_id in self._due[index % self._period]:
            mind = self._minds[artefact_id]
            me = view.fellow(artefact_id)
            if me is None:
                continue
            if mind.is_out:
                out.append(artefact_id)
                continue
            decided.append((mind, self._decide(mind, me, now_ns, view, traffic, robot)))
        for mind, activity in decided:  # not before: the others' view is that of the step before
            mind.artefact.activity = activity
        return out

    def sees(self, me: Fellow, x_m: float, y_m: float) -> bool:
        """Say whether an artefact could go straight to a point, were nobody in its way."""
        return self._navigation.sees(self._minds[me.id].traveller, me.point_m, (x_m, y_m))

    def _decide(
        self,
        mind: Mind,
        me: Fellow,
        now_ns: int,
        view: Onlookers,
        traffic: Traffic,
        robot: RobotView | None,
    ) -> str:
        """Let one decide, give its order, and return what it does now."""
        situation = self._situation(mind, me, now_ns, view, traffic, robot)
        intent = mind.behaviour.decide(situation)
        is_patient = mind.waits < _PATIENCE
        mind.leg = self._navigation.leg(
            mind.traveller, me, intent, situation.left_s, view, robot, is_patient=is_patient
        )
        if mind.leg.waits:
            mind.waits += 1
        elif me.speed_mps > _GETS_ON_MPS:
            mind.waits = 0
        mind.intent = intent
        traffic.order(me.id, mind.leg.order)
        return _activity(mind, situation)

    def _situation(
        self,
        mind: Mind,
        me: Fellow,
        now_ns: int,
        view: Onlookers,
        traffic: Traffic,
        robot: RobotView | None,
    ) -> Situation:
        what, who, since_s = traffic.hindrance(me.id)
        is_kept, leg = what is not Hindrance.NONE, mind.leg
        mind.look_about(me, now_ns)
        blocked_s = since_s if is_kept else 0.0
        if mind.lingered_s > _LINGERS_S:
            blocked_s = max(blocked_s, mind.lingered_s)
        departure_ns = mind.artefact.departure_ns
        return Situation(
            now_ns,
            me,
            mind.artefact.row,
            self._navigation.places,
            mind.random,
            view,
            robot,
            None if departure_ns is None else (departure_ns - now_ns) / NS_PER_S,
            mind.intent,
            leg is not None and leg.arrived,
            blocked_s,
            _name_of(what, who) if is_kept else "",
            leg is not None and leg.no_way,
        )


def _name_of(what: Hindrance, who: int) -> str:
    """Return what is in the way, in words."""
    return f"artefact {who}" if what is Hindrance.ARTEFACT else what.name.lower()


def _activity(mind: Mind, situation: Situation) -> str:
    """Return what the artefact does just now; what it waits for, where it cannot go on."""
    if mind.leg is not None and mind.leg.no_way:
        return "no way"
    wants_to_go = mind.intent is not None and mind.intent.goal_m is not None
    if wants_to_go and situation.blocked_s >= 1.0 and situation.blocked_by:
        return f"waiting for {situation.blocked_by}"
    if mind.leg is not None and mind.leg.waits:
        return "giving way"
    if wants_to_go and mind.lingered_s > _SHUNTS_S:
        return "manoeuvring"
    activity = mind.intent.activity if mind.intent else ""
    return "" if activity == mind.artefact.behaviour else activity
