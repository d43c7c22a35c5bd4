"""One artefact's mind: its behaviour, what it wants, and what became of that."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from are_ros.artefacts.artefact import Artefact
from are_ros.artefacts.behaviours.intent import Behaviour, Intent, Point
from are_ros.artefacts.behaviours.leaving import Leaving
from are_ros.artefacts.behaviours.situation import Fellow, Situation
from are_ros.artefacts.motion.hindrance import Hindrance
from are_ros.artefacts.navigation import Leg
from are_ros.artefacts.places import Destinations
from are_ros.artefacts.traveller import Traveller
from are_ros.conventions import NS_PER_S

PATIENCE: Final = 2
"""So many decisions one waits for others; then it is the traffic's to get past them, until it gets
on: who waited again at once would never count as blocked, and never choose another way."""

GETS_ON_MPS: Final = 0.1
BLOCKED_S: Final = 1.0
"""Kept from going on for so long, one says by whom."""

SPOT_M, SHUNTS_S, LINGERS_S = 0.3, 3.0, 8.0
"""Who wants to go, and has stayed within a spot for so long, manoeuvres, and then is blocked,
whatever by: a car that shunts in clutter makes some progress each time, and none in all."""

GIVING_WAY, MANOEUVRING = "giving way", "manoeuvring"
_WALL = "a wall"


@dataclass(eq=False, slots=True)
class Mind:
    """One artefact's behaviour, and what became of its last intent.

    While it `is_steady`, what it does, waits and lingers is in a table, at its `slot`, and holds
    for this `generation` of courses.
    """

    artefact: Artefact
    traveller: Traveller
    behaviour: Behaviour
    random: np.random.Generator
    phase: int
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
    slot: int = -1
    is_steady: bool = False
    generation: int = 0

    @property
    def is_out(self) -> bool:
        """Whether it has left by an exit."""
        return isinstance(self.behaviour, Leaving) and self.behaviour.has_left

    def look_about(self, me: Fellow, now_ns: int) -> None:
        """See for how long it has wanted to go and stayed within a spot."""
        is_going, spot_m = self.is_going, self.spot_m
        if not is_going or spot_m is None or math.dist(spot_m, (me.x_m, me.y_m)) > SPOT_M:
            self.spot_m, self.spot_since_ns = me.point_m if is_going else None, now_ns
        self.lingered_s = (now_ns - self.spot_since_ns) / NS_PER_S

    def settle(self, intent: Intent, leg: Leg, situation: Situation) -> None:
        """Keep what it has decided to do, and say what it does now."""
        self.intent, self.is_going = intent, leg.order.subgoal_m is not None
        self.arrived, self.no_way = leg.arrived, leg.no_way
        if leg.waits:
            self.waits += 1
        elif self.waits and situation.me.speed_mps > GETS_ON_MPS:
            self.waits = 0
        self.say(_activity(intent, leg, situation, self.lingered_s))

    def say(self, activity: str) -> None:
        """Let this be its activity."""
        self.artefact.activity = "" if activity == self.artefact.behaviour else activity

    def begin_anew(self, behaviour: Behaviour) -> None:
        """Do something else from the next decision on."""
        self.artefact.behaviour, self.behaviour = behaviour.name, behaviour
        self.intent, self.is_going, self.arrived, self.no_way = None, False, False, False


def name_of_hindrance(what: Hindrance, who: int) -> str:
    """Return what is in the way, in words."""
    if what is Hindrance.ARTEFACT:
        return f"artefact {who}"
    return "the robot" if what is Hindrance.ROBOT else _WALL


def words_of_hindrance(what: Hindrance, who: int) -> str:
    """Return what somebody does who is kept from going on."""
    return _waiting_for(name_of_hindrance(what, who))


def _waiting_for(name: str) -> str:
    return f"{'blocked by' if name == _WALL else 'waiting for'} {name}"


def _activity(intent: Intent, leg: Leg, situation: Situation, lingered_s: float) -> str:
    """Return what somebody does just now; what it waits for, where it cannot go on."""
    if leg.no_way:
        return "no way"
    wants_to_go = intent.goal_m is not None
    if wants_to_go and situation.blocked_s >= BLOCKED_S and situation.blocked_by:
        return _waiting_for(situation.blocked_by)
    if leg.waits:
        return GIVING_WAY
    if wants_to_go and lingered_s > SHUNTS_S:
        return MANOEUVRING
    return intent.activity
