"""What the artefacts have in mind: once a period each decides what to do, and how to get there.

An artefact's decision epochs are a decision period apart, from the first sub-step after its arrival
on. All that are due in a sub-step decide by what the sub-step before has left, in the order of
their ids; each draws from a stream of its own. Who wants the same as before for sure goes on
without being asked (`SteadyMinds`).
"""

from bisect import insort
from collections.abc import Callable, Sequence

from are_ros.artefacts.artefact import Artefact
from are_ros.artefacts.behaviours.asking import Asked, Failed, intent_of
from are_ros.artefacts.behaviours.intent import Behaviour, Intent
from are_ros.artefacts.behaviours.leaving import Leaving
from are_ros.artefacts.behaviours.registry import make_behaviour
from are_ros.artefacts.behaviours.situation import Fellow, RobotView, Situation
from are_ros.artefacts.doers import Doers
from are_ros.artefacts.mind import LINGERS_S, PATIENCE, Mind, name_of_hindrance
from are_ros.artefacts.motion.body import Body
from are_ros.artefacts.motion.hindrance import Hindrance
from are_ros.artefacts.motion.traffic import Traffic
from are_ros.artefacts.navigation import Leg, Navigation, Wish
from are_ros.artefacts.onlookers import Onlookers
from are_ros.artefacts.places import Destinations
from are_ros.artefacts.randomness import Purpose, generator
from are_ros.artefacts.steady_minds import SteadyMinds
from are_ros.artefacts.traveller import Traveller
from are_ros.conventions import NS_PER_S, seconds_to_ns
from are_ros.errors import BehaviourError


class Minds:
    """Lets those decide who can move; the others stand, and have no mind."""

    def __init__(self, seed: int, step_s: float, period_s: float, navigation: Navigation) -> None:
        """Take the lengths of a sub-step and of a decision period."""
        self._seed = seed
        self._step_ns = seconds_to_ns(step_s)
        self._period = max(1, round(period_s / step_s))
        self._navigation = navigation
        self._minds: dict[int, Mind] = {}
        self._due: list[list[Mind]] = [[] for _ in range(self._period)]
        self._steady = SteadyMinds(navigation)
        self.doers = Doers()
        self.tell_fault: Callable[[BehaviourError], None] | None = None
        """Told of each behaviour of the user's own that fails, whose artefact stands from then on;
        with None that is raised."""

    def reseed(self, seed: int) -> None:
        """Let those who arrive later draw from another seed."""
        self._seed = seed

    def admit(self, artefact: Artefact, body: Body) -> None:
        """Give an artefact that has just arrived a mind, where it can move."""
        self.doers.set(artefact.id, artefact.behaviour)
        if body.speed_mps <= 0.0:
            return
        phase = -(-artefact.arrival_ns // self._step_ns) % self._period
        behaviour = self._made(artefact)
        random = generator(self._seed, Purpose.GOAL, artefact.id)
        traveller = Traveller.of(artefact.row, body)
        mind = Mind(artefact, traveller, behaviour, random, phase)
        self._minds[artefact.id] = mind
        self._steady.admit(mind)
        insort(self._due[phase], mind, key=_id_of)

    def dismiss(self, artefact_id: int) -> None:
        """Forget an artefact, known or not."""
        self.doers.remove(artefact_id)
        self._navigation.forget(artefact_id)
        mind = self._minds.pop(artefact_id, None)
        if mind is not None:
            self._due[mind.phase].remove(mind)
            self._steady.dismiss(mind)

    def send_out(self, artefact_id: int) -> None:
        """Let an artefact walk to an exit from its next decision on; its life is over."""
        mind = self._minds[artefact_id]
        self._steady.drop(mind)
        mind.begin_anew(Leaving())
        self.doers.set(artefact_id, Leaving.name)

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
        minds = self._due_in(index, view)
        minds = self._steady.carry_on(minds, now_ns, view, traffic, robot)
        out = [mind.artefact.id for mind in minds if mind.is_out]
        deciding = [mind for mind in minds if not mind.is_out]
        ids = [mind.artefact.id for mind in deciding]
        situations = self._situations(deciding, ids, now_ns, view, traffic, robot)
        intents = [
            self._asked(mind, situation)
            for mind, situation in zip(deciding, situations, strict=True)
        ]
        legs = self._legs(deciding, situations, intents, view, robot)
        traffic.give_orders(ids, [leg.order for leg in legs])
        for k, mind in enumerate(deciding):  # not before: others see what the step before has left
            mind.settle(intents[k], legs[k], situations[k])
            self._note(mind, legs[k], now_ns)
        return out

    def _made(self, artefact: Artefact) -> Behaviour:
        """Return a new behaviour for an artefact."""
        asked = Asked(artefact.id, artefact.row.label, artefact.arrival_ns)
        try:
            return make_behaviour(artefact.behaviour, artefact.options, asked)
        except BehaviourError as fault:
            self._tell(fault)
        artefact.behaviour = Failed.name
        self.doers.set(artefact.id, Failed.name)
        return Failed()

    def _asked(self, mind: Mind, situation: Situation) -> Intent:
        """Return what one wants: nothing any more, once its behaviour has failed."""
        try:
            return intent_of(mind.behaviour, situation)
        except BehaviourError as fault:
            self._give_up(mind, fault)
        return mind.behaviour.decide(situation)

    def _note(self, mind: Mind, leg: Leg, now_ns: int) -> None:
        """See whether one that has just decided goes on like that."""
        try:
            self._steady.note(mind, leg, now_ns)
        except BehaviourError as fault:
            self._give_up(mind, fault)

    def _give_up(self, mind: Mind, fault: BehaviourError) -> None:
        """Let one stand for the rest of its life."""
        self._tell(fault)
        mind.begin_anew(Failed())
        self.doers.set(mind.artefact.id, Failed.name)

    def _tell(self, fault: BehaviourError) -> None:
        if self.tell_fault is None:
            raise fault
        self.tell_fault(fault)

    def sees(self, me: Fellow, x_m: float, y_m: float) -> bool:
        """Say whether an artefact could go straight to a point, were nobody in its way."""
        return self._navigation.sees(self._minds[me.id].traveller, me.point_m, (x_m, y_m))

    def _due_in(self, index: int, view: Onlookers) -> list[Mind]:
        """Return who is due in a sub-step, and there, in the order of their ids."""
        due = self._due[index % self._period]
        is_there = view.has([mind.artefact.id for mind in due])
        return [mind for mind, is_here in zip(due, is_there, strict=True) if is_here]

    def _situations(
        self,
        minds: Sequence[Mind],
        ids: Sequence[int],
        now_ns: int,
        view: Onlookers,
        traffic: Traffic,
        robot: RobotView | None,
    ) -> list[Situation]:
        """Return what each knows when it decides."""
        fellows = view.fellows([mind.artefact for mind in minds])
        hindrances = traffic.hindrances(ids)
        situations = []
        for mind, me, (what, who, since_s) in zip(minds, fellows, hindrances, strict=True):
            mind.look_about(me, now_ns)
            artefact, is_kept = mind.artefact, what is not Hindrance.NONE
            blocked_s = since_s if is_kept else 0.0
            if mind.lingered_s > LINGERS_S:
                blocked_s = max(blocked_s, mind.lingered_s)
            departure_ns = artefact.departure_ns
            situations.append(
                Situation(
                    now_ns,
                    me,
                    artefact.row,
                    self._places_of(mind, me),
                    mind.random,
                    view,
                    robot,
                    None if departure_ns is None else (departure_ns - now_ns) / NS_PER_S,
                    mind.intent,
                    mind.arrived,
                    blocked_s,
                    name_of_hindrance(what, who) if is_kept else "",
                    mind.no_way,
                )
            )
        return situations

    def _places_of(self, mind: Mind, me: Fellow) -> Destinations:
        """Return the places that one can get to, looked for anew where it has found no way."""
        known = self._navigation.places
        if mind.places is None or mind.known_places is not known or mind.no_way:
            mind.places = self._navigation.places_from(mind.traveller, me.point_m)
            mind.known_places = known
        return mind.places

    def _legs(
        self,
        minds: Sequence[Mind],
        situations: Sequence[Situation],
        intents: Sequence[Intent],
        view: Onlookers,
        robot: RobotView | None,
    ) -> list[Leg]:
        """Return what each is to do for its intent until its next decision."""
        wishes = [
            Wish(mind.traveller, situation.me, intent, situation.left_s, mind.waits < PATIENCE)
            for mind, situation, intent in zip(minds, situations, intents, strict=True)
        ]
        return self._navigation.legs(wishes, view, robot)


def _id_of(mind: Mind) -> int:
    return mind.artefact.id
