"""Decisions: when each is due, with which random numbers, and what is said of it."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from are_ros.agents.behaviours.repertoire import Repertoire
from are_ros.agents.behaviours.situation import Intent, Situation
from are_ros.agents.body import MotionCommand
from are_ros.agents.decision import AgentState, DecisionLayer
from are_ros.agents.local_planner.planner import Obstruction
from are_ros.agents.navigation.destinations import Destinations
from are_ros.agents.navigation.navigation import (
    Navigation,
    NavigationRequest,
    NavigationResult,
    Prospect,
    Prospects,
)
from are_ros.agents.navigation.terrain import Terrains
from are_ros.agents.table import AgentTable
from are_ros.conventions import NS_PER_S
from are_ros.errors import BehaviourError
from are_ros.parameters.model import BehaviourParameters
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import CatalogueRow, MotionLimits
from are_ros.population.meshes.shapes import Shape
from are_ros.population.randomness import Purpose, generator
from tests.agents.behaviours.diary import DIARY, ENTRIES, MARCHER
from tests.agents.behaviours.failing import MODULE

STEP_NS = NS_PER_S // 20
WALK = MotionLimits(1.3, 1.5, 3.0, 0.0, 1.8)
ROW = CatalogueRow(0, "one", "person", (0.3, 0.5, 1.7), (0, 0, 0), Shape.PERSON, motion=WALK)


class Ways(Navigation):
    """Every way is straight, unless the goals are shut; what was asked is kept."""

    def __init__(self) -> None:
        super().__init__(BehaviourParameters(), Terrains())
        self.places = Destinations(np.array([[5.0, 5.0], [9.0, 1.0]]), np.array([[0.0, 0.0]]))
        self.is_shut = self.is_crowded = False
        self.values: np.ndarray[tuple[int, ...], np.dtype[np.float64]] | None = None
        self.value = self.later = 0.0
        self.actions: list[tuple[int, int]] = []
        self.patience: list[bool] = []

    def prospects(self, requests: Sequence[NavigationRequest], *_: Any) -> list[Prospect]:
        """Return that all go straight on, or choose by the values that the test gives."""
        self.patience += [request.is_patient for request in requests]
        if self.values is None:
            return [Prospect(Prospects.STRAIGHT) for _ in requests]
        return [
            Prospect(Prospects.STANDS)
            if request.intent.goal_m is None
            else Prospect(
                Prospects.CHOOSES, self.values[: len(request.speeds_mps)], self.value, self.later
            )
            for request in requests
        ]

    def result(
        self, request: NavigationRequest, prospect: Prospect, pace: int = 0, move: int = 0
    ) -> NavigationResult:
        """Return an order to go straight on, or to wait; what was chosen is kept."""
        if prospect.kind is Prospects.CHOOSES:
            self.actions.append((pace, move))
        waits = self.is_crowded and request.is_patient
        subgoal_m = None if waits else request.intent.goal_m
        command = MotionCommand(subgoal_m, request.speeds_mps[pace])
        return NavigationResult(command, no_way=self.is_shut, waits=waits)

    def slipped(
        self, request: NavigationRequest, prospect: Prospect, pace: int, move: int
    ) -> NavigationResult:
        """Do the same: it says where to go in the same way."""
        return self.result(request, prospect, pace, move)

    def sees(self, *_: Any) -> bool:
        """See everything."""
        return True


class Road:
    """A traffic that takes orders, and is in the way if the test says so."""

    def __init__(self, table: AgentTable) -> None:
        self.table = table
        self.commands: dict[int, MotionCommand] = {}
        self.way = (Obstruction.NONE, -1, 0.0)
        self.manoeuvring = set[int]()
        self.speed_mps = 0.0

    def give_commands(self, rows: Sequence[int], commands: Sequence[MotionCommand]) -> None:
        """Keep the orders."""
        self.commands |= dict(zip(self.table.ids[list(rows)].tolist(), commands, strict=True))

    def obstructions(self, rows: Sequence[int]) -> list[tuple[Obstruction, int, float]]:
        """Say what is in the way."""
        return [self.way for _ in rows]

    def are_manoeuvring(self, rows: Sequence[int]) -> list[bool]:
        """Say who turns round."""
        return [agent_id in self.manoeuvring for agent_id in self.table.ids[list(rows)].tolist()]

    @property
    def motion(self) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        """All are as fast."""
        return np.full((len(self.table), 6), self.speed_mps)


class Town:
    """The decision layer, and those who decide, at (0, 0) or `x_m` east of it."""

    def __init__(self, period_s: float = 1.0, seed: int = 4, **settings: float) -> None:
        self.table, self.ways = AgentTable(0.05), Ways()
        self.road = Road(self.table)
        road: Any = self.road
        parameters = BehaviourParameters(decision_period=period_s, **{"slip": 0.0, **settings})
        self.layer = DecisionLayer(seed, parameters, self.table, self.ways, road)
        self.x_m = 0.0

    def admit(
        self,
        artefact_id: int,
        arrival_ns: int,
        behaviour: str = DIARY,
        row: CatalogueRow = ROW,
        *,
        may_change: bool = False,
    ) -> Artefact:
        """Let one live."""
        history = PoseHistory(arrival_ns, GroundPose(0.0, 0.0, 0.0, 0.0))
        one = Artefact(artefact_id, row, Origin.RANDOM, arrival_ns, history, behaviour=behaviour)
        one.may_change = may_change
        self.table.add(one)
        self.layer.admit(one)
        return one

    def state(self, artefact_id: int) -> AgentState:
        """Return how one decides."""
        state = self.table.state_of(artefact_id)
        assert state is not None
        return state

    def decide(self, index: int, speed_mps: float = 0.0) -> list[int]:
        """Run a sub-step, all being so fast; return who is out."""
        poses = np.zeros((len(self.table), 4))
        poses[:, 0] = self.x_m
        self.table.move(poses, self.table.boxes_at(poses))
        self.road.speed_mps = speed_mps
        return self.layer.decide(index, index * STEP_NS, None)


@pytest.fixture(autouse=True)
def _entries() -> Iterator[None]:
    """Begin and end with an empty diary."""
    ENTRIES.clear()
    yield
    ENTRIES.clear()


def times_of(artefact_id: int) -> list[int]:
    """Return the sub-steps in which one has decided."""
    return [t_ns // STEP_NS for t_ns, i, _ in ENTRIES if i == artefact_id]


def draws_of(artefact_id: int) -> list[float]:
    """Return the numbers that one has drawn."""
    return [number for _, i, number in ENTRIES if i == artefact_id]


# --- epochs


@pytest.mark.parametrize(
    ("arrival_ns", "first"),
    [(100 * STEP_NS, 100), (100 * STEP_NS + 1, 101), (101 * STEP_NS - 1, 101)],
)
@pytest.mark.parametrize(("period_s", "steps"), [(1.0, 20), (0.35, 7), (0.05, 1), (0.01, 1)])
def test_epochs_are_a_period_apart_from_the_arrival(
    arrival_ns: int, first: int, period_s: float, steps: int
) -> None:
    """From the first sub-step not before it; a period shorter than a sub-step is one."""
    town = Town(period_s)
    town.admit(1, arrival_ns)
    for index in range(100 if first == 100 else 101, 180):
        town.decide(index)
    assert times_of(1) == list(range(first, 180, steps))


def test_those_who_are_due_decide_in_the_order_of_ids() -> None:
    """Whoever came first."""
    town = Town()
    for artefact_id in (8, 3, 5):
        town.admit(artefact_id, 40 * STEP_NS)
    town.decide(40)
    assert [i for _, i, _ in ENTRIES] == [3, 5, 8]


# --- random numbers


def test_each_draws_from_a_stream_of_its_own() -> None:
    """That of the seed, the purpose and the id, whoever else is there, comes or goes."""
    town = Town(seed=9)
    for artefact_id in (2, 4, 6):
        town.admit(artefact_id, 0)
    for index in range(200):
        if index == 90:
            town.table.remove(4)
        if index == 130:
            town.admit(3, 130 * STEP_NS)
        town.decide(index)
    for artefact_id, count in ((2, 10), (6, 10), (4, 5), (3, 4)):
        stream = generator(9, Purpose.GOAL, artefact_id)
        assert draws_of(artefact_id) == [float(stream.random()) for _ in range(count)]


def test_a_new_seed_is_for_those_who_come_later() -> None:
    """The living go on with their own."""
    town = Town(seed=9)
    town.admit(1, 0)
    town.decide(0)
    town.layer.reseed(10)
    town.admit(2, STEP_NS)
    for index in range(1, 21):
        town.decide(index)
    old, new = generator(9, Purpose.GOAL, 1), generator(10, Purpose.GOAL, 2)
    assert draws_of(1) == [float(old.random()), float(old.random())]
    assert draws_of(2) == [float(new.random())]


# --- who decides


def test_what_cannot_move_does_not_decide() -> None:
    """It is never asked, and can be removed."""
    town = Town()
    post = CatalogueRow(0, "post", "thing", (0.3, 0.5, 1.7), (0, 0, 0), Shape.CRATE)
    town.admit(1, 0, row=post)
    assert town.table.state_of(1) is None
    assert town.decide(0) == []
    town.table.remove(1)
    assert ENTRIES == []


def test_who_is_removed_decides_no_more() -> None:
    """Others of the same phase go on."""
    town = Town()
    town.admit(1, 0)
    town.admit(2, 0)
    town.table.remove(1)
    town.decide(0)
    assert [i for _, i, _ in ENTRIES] == [2]


# --- what is said


def test_an_activity_that_says_no_more_than_the_behaviour_is_empty() -> None:
    """Walking while walking says nothing; pausing does."""
    town = Town()
    one = town.admit(1, 0, "walking")
    town.decide(0)
    assert one.activity == ""
    other = town.admit(2, 0)
    town.decide(0)
    assert other.activity == "writing"
    assert town.road.commands[1].subgoal_m is not None
    assert town.road.commands[2].subgoal_m is None


@pytest.mark.parametrize(
    ("way", "words"),
    [
        ((Obstruction.ARTEFACT, 7, 3.0), "waiting for artefact 7"),
        ((Obstruction.ROBOT, -1, 1.0), "waiting for the robot"),
        ((Obstruction.WALL, -1, 30.0), "blocked by a wall"),
        ((Obstruction.ARTEFACT, 7, 0.9), ""),
        ((Obstruction.NONE, -1, 5.0), ""),
    ],
)
def test_who_is_stuck_says_why(way: tuple[Obstruction, int, float], words: str) -> None:
    """From a second on, with the number of whom it waits for."""
    town = Town()
    one = town.admit(1, 0, "walking")
    town.decide(0)
    town.road.way = way
    town.decide(20)
    assert one.activity == words


def test_what_others_do_is_known_from_the_sub_step_before() -> None:
    """Who decides later in a sub-step does not see what an earlier one has just begun."""
    town, seen = Town(), list[str]()
    town.admit(1, 0)
    town.admit(2, 0)
    state = town.state(2)
    behaviour = state.behaviour

    def decide(situation: Situation) -> Intent:
        seen.extend(neighbour.activity for neighbour in situation.neighbours_within(1.0))
        return behaviour.decide(situation)

    state.repertoire = Repertoire.only(SimpleNamespace(name="spy", decide=decide))  # type: ignore[arg-type]
    town.decide(0)
    town.decide(20)
    assert seen == ["", "writing"]


def test_who_only_stands_waits_for_nobody() -> None:
    """A hindrance means nothing to whom has no goal."""
    town = Town()
    one = town.admit(1, 0)
    town.road.way = (Obstruction.ARTEFACT, 7, 30.0)
    town.decide(0)
    assert one.activity == "writing"


def test_who_has_no_way_says_so() -> None:
    """Whatever is in its way besides."""
    town = Town()
    one = town.admit(1, 0, "walking")
    town.ways.is_shut = True
    town.decide(0)
    assert one.activity == "no way"


def test_patience_is_for_two_decisions() -> None:
    """One that has waited twice asks for ways past the others, until it gets on."""
    town = Town()
    town.admit(1, 0, "walking")
    town.ways.is_crowded = True
    for k, speed_mps in enumerate((1.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0)):
        town.decide(20 * k, speed_mps)
    assert town.ways.patience == [True, True, False, False, False, False, True]


def test_who_waits_of_itself_says_so() -> None:
    """It gives way; who is kept from going on names who keeps it."""
    town = Town()
    one = town.admit(1, 0, "walking")
    town.ways.is_crowded = True
    town.decide(0)
    assert one.activity == "giving way"


# --- leaving


def test_who_is_sent_out_goes_to_the_exit_and_is_out_there() -> None:
    """It is leaving from its next decision on, and told of once it stands there."""
    town = Town()
    one = town.admit(1, 0)
    town.decide(0)
    town.layer.send_out(town.table.row_of(1), 0)
    assert one.behaviour == "leaving"
    assert [town.decide(index) for index in (20, 40, 60)] == [[], [], [1]]
    assert town.road.commands[1].subgoal_m is None


def test_the_rest_of_a_life_is_known_to_who_decides() -> None:
    """As seconds; None where the end is not known."""
    town, told = Town(), []
    one = town.admit(1, 0)
    spy = SimpleNamespace(name="spy", decide=lambda s: told.append(s.left_s))
    town.state(1).repertoire = Repertoire.only(spy)  # type: ignore[arg-type]
    for index, end_ns in ((0, None), (20, 3 * NS_PER_S)):
        one.departure_ns = end_ns
        with pytest.raises(BehaviourError):
            town.decide(index)
    assert told == [None, 2.0]


def test_who_shunts_about_a_spot_is_said_to_manoeuvre() -> None:
    """After three seconds, though the traffic knows of nothing in its way; not who gets on."""
    town = Town()
    marcher = town.admit(1, 0, MARCHER)
    said = {}
    for second in range(14):
        town.decide(20 * second)
        said[second] = marcher.activity
    shunting = {second for second, words in said.items() if words == "manoeuvring"}
    assert shunting == set(range(5, 14))
    town.x_m = 0.31
    town.decide(20 * 14)
    assert marcher.activity == "marching"


def test_who_shunts_and_gives_way_by_turns_manoeuvres_too() -> None:
    """To give way is to want to go on: the time at the spot counts on."""
    town = Town()
    marcher = town.admit(1, 0, MARCHER)
    said = []
    for second in range(9):
        town.ways.is_crowded = second in {3, 7}
        town.decide(20 * second)
        said.append(marcher.activity)
    assert said[3] == said[7] == "giving way"
    assert said[5] == said[6] == said[8] == "manoeuvring"


def test_a_vehicle_that_turns_round_in_legs_manoeuvres_and_has_longer_for_it() -> None:
    """It counts as blocked once the value of its state has not grown for 24 s, not for 8 s."""
    town, told = Town(), list[float]()

    def decide(situation: Situation) -> Intent:
        told.append(situation.blocked_s)
        return Intent((8.0, 4.0), 1.3)

    turning = town.admit(1, 100 * STEP_NS)
    spy = SimpleNamespace(name="spy", decide=decide)
    town.state(1).repertoire = Repertoire.only(spy)  # type: ignore[arg-type]
    town.ways.values, town.road.manoeuvring = np.zeros((2, 5)), {1}
    for second in range(27):
        town.x_m = float(second % 2)
        town.decide(100 + 20 * second)
        assert turning.activity == ("manoeuvring" if town.road.manoeuvring else "")
        if second == 25:
            town.road.manoeuvring = set()
    assert told[:25] == [0.0] * 25
    assert told[25:] == [25.0, 26.0]


def test_who_stands_of_its_own_will_does_not_manoeuvre() -> None:
    """However long."""
    town = Town()
    writer = town.admit(1, 0)
    for second in range(14):
        town.decide(20 * second)
        assert writer.activity == "writing"


@pytest.mark.parametrize("gains", [False, True])
def test_who_paces_to_and_fro_counts_as_blocked(gains: bool) -> None:
    """After eight seconds in which the value of its state has not grown, though it moves."""
    town, told = Town(), list[float]()

    def decide(situation: Situation) -> Intent:
        told.append(situation.blocked_s)
        return Intent((8.0, 4.0), 1.3)

    town.admit(1, 100 * STEP_NS)
    spy = SimpleNamespace(name="spy", decide=decide)
    town.state(1).repertoire = Repertoire.only(spy)  # type: ignore[arg-type]
    town.ways.values = np.zeros((2, 5))
    for second in range(14):
        town.x_m, town.ways.value = float(second % 2), float(second if gains else 0)
        town.decide(100 + 20 * second)
    assert told[:9] == [0.0] * 9
    assert told[9:] == ([0.0] * 5 if gains else [9.0, 10.0, 11.0, 12.0, 13.0])


# --- where one is at the end of its life


PLACES_M = {
    "here": (5.0, 0.0),
    "beside": (6.0, 0.0),
    "exit": (0.0, 0.0),
    "west": (0.5, 0.0),
    "east": (30.0, 0.0),
}


def _town_of_one_who_leaves(left_s: float) -> Town:
    """Return a town in which artefact 1, at "here", has to be at an exit after this time."""
    town = Town()
    town.x_m = PLACES_M["here"][0]
    destinations_m = np.array([PLACES_M["west"], PLACES_M["east"]])
    town.ways.places = Destinations(destinations_m, np.array([PLACES_M["exit"]]))
    town.layer.by_exit = True
    one = town.admit(1, 0, "walking", PERSON, may_change=True)
    one.departure_ns = int(left_s * NS_PER_S)
    return town


def _watched(town: Town, seen: Sequence[str]) -> None:
    """Let cameras see some of the places."""
    seen_m = np.array([PLACES_M[name] for name in seen]).reshape(-1, 1, 2)
    town.layer.hides = lambda points_m: ~(points_m == seen_m).all(axis=2).any(axis=0)


def _exit_of_one(town: Town) -> tuple[float, float] | None:
    way_out = town.state(1).repertoire.way_out
    assert way_out is not None
    return way_out.exit_m


@pytest.mark.parametrize(
    ("left_s", "seen", "has_walls", "place"),
    [
        (30.0, (), False, "exit"),  # a long time, and nothing is seen
        (30.0, ("exit",), False, "here"),  # no exit, and nobody sees it
        (6.0, (), False, "here"),  # too late for any exit
        (6.0, ("here",), False, "beside"),  # seen where it is: a step aside
        (6.0, ("here",), True, "west"),  # no straight way to anywhere: to what is nearest, if late
        (6.0, ("here", "west"), True, "exit"),
        (6.0, ("here", "exit", "west"), True, "east"),
        (6.0, ("here", "exit", "west", "east"), True, None),
    ],
)
def test_one_ends_its_life_at_an_exit_in_time_or_where_nobody_sees_it(
    left_s: float,
    seen: tuple[str, ...],
    has_walls: bool,
    place: str | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whatever the cameras see."""
    if has_walls:
        monkeypatch.setattr(Ways, "sees", lambda *_: False)
    town = _town_of_one_who_leaves(left_s)
    _watched(town, seen)
    town.decide(0)
    assert _exit_of_one(town) == (None if place is None else PLACES_M[place])


def test_one_who_is_late_stays_where_nobody_sees_it_on_its_way() -> None:
    """It gave up the exit that it cannot reach in time any more; while it can, it goes on."""
    town = _town_of_one_who_leaves(30.0)
    _watched(town, ())
    for second, place in ((0, "exit"), (10, "exit"), (24, "here")):
        town.decide(20 * second)
        assert _exit_of_one(town) == PLACES_M[place]


@pytest.mark.parametrize(("loss", "goes"), [(0.0, False), (0.1, True)])
def test_it_is_time_to_walk_out_when_the_value_falls_with_the_time(loss: float, goes: bool) -> None:
    """Not when it is dear to stay, as it is with somebody beside one."""
    town = _town_of_one_who_leaves(30.0)
    town.ways.values = np.array([[-9.0, 0.0, 0.0, 0.0, 0.0]] * 2)
    town.ways.value, town.ways.later = 1.0, 1.0 - loss
    town.decide(0)
    assert (town.table.artefacts[0].behaviour == "leaving") == goes


def test_one_sets_out_while_it_can_still_walk_to_its_exit() -> None:
    """However little running would cost: 5 m at 1.3 m/s, and 5 s to spare."""
    town = _town_of_one_who_leaves(30.0)
    _watched(town, ())
    town.ways.values = np.zeros((2, 5))
    one, seen = town.table.artefacts[0], list[str]()
    for second in range(29):
        town.decide(20 * second)
        seen.append(one.behaviour)
        assert _exit_of_one(town) == PLACES_M["exit"]
        if one.behaviour == "leaving":
            town.x_m -= min(town.x_m, 1.3)
    assert 29 - seen.count("leaving") == pytest.approx(30 - 5 - 5 / 1.3, abs=1.01)
    assert town.x_m == 0.0


def test_one_gives_up_an_exit_without_a_way_before_it_sets_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The nearest one is behind a gap that it does not fit through: it still reaches the next."""
    shut_m = PLACES_M["beside"]

    def prospects(_: Ways, requests: Sequence[NavigationRequest], *__: Any) -> list[Prospect]:
        goals_m = [request.intent.goal_m for request in requests]
        return [Prospect(Prospects.NO_WAY if m == shut_m else Prospects.STRAIGHT) for m in goals_m]

    monkeypatch.setattr(Ways, "prospects", prospects)
    town = _town_of_one_who_leaves(30.0)
    town.ways.places = Destinations(town.ways.places.destinations_m, np.array([shut_m, (0.0, 0.0)]))
    _watched(town, ())
    for second in range(2):
        town.decide(20 * second)
        assert town.table.artefacts[0].behaviour == "walking"
    assert _exit_of_one(town) == PLACES_M["exit"]


def test_a_row_that_leaves_by_itself_walks_to_an_exit_at_once() -> None:
    """It waits there for the end of its life, which is long after."""
    town = Town()
    town.x_m = PLACES_M["here"][0]
    town.ways.places = Destinations(np.array([PLACES_M["east"]]), np.array([PLACES_M["exit"]]))
    town.layer.by_exit = True
    row = replace(ROW, behaviours={"leaving": 1.0})
    one = town.admit(1, 0, "leaving", row, may_change=True)
    one.departure_ns = 600 * NS_PER_S
    _watched(town, ())
    for second in range(3):
        town.decide(20 * second)
    assert _exit_of_one(town) == PLACES_M["exit"]


def test_who_walks_out_is_not_tempted_back() -> None:
    """By a destination that it could still reach: that would be worth much at the end of a life."""
    town = _town_of_one_who_leaves(30.0)
    town.ways.values = np.array([[0.0, 9.0, 0.0, 0.0, 0.0]] * 2)
    one = town.table.artefacts[0]
    seen = list[str]()
    for second in range(29):
        way_out = town.state(1).repertoire.way_out
        assert way_out is not None
        way_out.is_time = second >= 10
        town.decide(20 * second)
        seen.append(one.behaviour)
    assert "leaving" not in seen[:10]
    assert set(seen[10:]) == {"leaving"}


# ------------------------------------------------------------------- planners


def test_a_planner_is_drawn_for_life_by_the_weights_of_the_row() -> None:
    """Of 400, about a quarter has the one of weight 1 to 3; two deviations are 4 %."""
    row = replace(ROW, planners={"social_force": 0.25, "path_following": 0.75})
    town = Town()
    for artefact_id in range(400):
        town.admit(artefact_id, 0, row=row)
    town.decide(0)
    first = {one: command.planner for one, command in town.road.commands.items()}
    town.decide(20)
    assert first == {one: command.planner for one, command in town.road.commands.items()}
    assert set(first.values()) == {"social_force", "path_following"}
    assert list(first.values()).count("social_force") == pytest.approx(100, abs=26)


def test_one_planner_is_not_drawn() -> None:
    """The dynamic window unless the row says something else."""
    town = Town()
    town.admit(1, 0)
    town.admit(2, 0, row=replace(ROW, planners={"path_following": 1.0}))
    town.decide(0)
    assert town.road.commands[1].planner == "dynamic_window"
    assert town.road.commands[2].planner == "path_following"


def test_who_has_a_planner_that_fails_stands_and_says_so() -> None:
    """It is told once; the artefact gives no goal any more."""
    town, told = Town(), list[BehaviourError]()
    one = town.admit(5, 0)
    town.decide(0)
    with pytest.raises(BehaviourError, match="late boom"):
        town.layer.stop(5, BehaviourError("late boom", "mine:Late"), 0)
    town.layer.report_fault = told.append
    town.layer.stop(5, BehaviourError("late boom", "mine:Late"), 0)
    town.decide(20)
    assert len(told) == 1
    assert (one.behaviour, one.activity) == ("standing", "its planner failed")
    assert town.road.commands[5].subgoal_m is None


# ------------------------------------------------------------------- behaviours that fail


@pytest.mark.parametrize("name", ["Late", "Unmade", "Returns"])
def test_a_behaviour_that_fails_ends_the_run_unless_somebody_is_told(name: str) -> None:
    """Nothing goes on in silence."""
    town = Town()
    with pytest.raises(BehaviourError, match=f"{MODULE}:{name} of artefact 5"):
        _run_with(town, name)


@pytest.mark.parametrize("name", ["Late", "Unmade", "Returns"])
def test_who_has_a_behaviour_that_fails_stands_and_the_others_go_on(name: str) -> None:
    """It is told once, says so, and is sent out at the end of its life as anybody else."""
    alone = Town()
    told: list[BehaviourError] = []
    alone.admit(3, 0, "tests.agents.behaviours.diary:Stroller")
    _run(alone, 0, 200)
    undisturbed = draws_of(3)
    ENTRIES.clear()
    town = Town()
    town.layer.report_fault = told.append
    town.admit(3, 0, "tests.agents.behaviours.diary:Stroller")
    failed = _run_with(town, name)
    assert [fault.behaviour for fault in told] == [f"{MODULE}:{name}"]
    assert (failed.behaviour, failed.activity) == ("standing", "its behaviour failed")
    assert town.road.commands[5].subgoal_m is None
    assert draws_of(3) == undisturbed
    town.layer.send_out(town.table.row_of(5), 0)
    _run(town, 200, 220)
    assert failed.behaviour == "leaving"
    assert len(told) == 1


def _run_with(town: Town, name: str) -> Artefact:
    """Let one arrive with a behaviour that fails, and ten seconds go by."""
    one = town.admit(5, 0, f"{MODULE}:{name}")
    _run(town, 0, 200)
    return one


def _run(town: Town, start: int, end: int) -> None:
    for index in range(start, end):
        town.decide(index)


# --- behaviours in force

PERSON = replace(ROW, behaviours={"walking": 0.5, "running": 0.2, "stopping": 0.3})
LEVEL = 1e-3


def frozen(town: Town, epochs: int) -> list[str]:
    """Return the behaviour in each epoch of an artefact that may change, wherever it goes."""
    one = town.admit(1, 0, "walking", PERSON, may_change=True)
    said = []
    for epoch in range(epochs):
        town.decide(20 * epoch)
        said.append(one.behaviour)
    return said


def test_a_given_behaviour_never_changes() -> None:
    """Whatever the row says."""
    town = Town(persistence=0.0)
    one = town.admit(1, 0, "walking", PERSON)
    for epoch in range(50):
        town.decide(20 * epoch)
        assert one.behaviour == "walking"


def test_each_change_is_reported_once() -> None:
    """With the behaviour before, at the time of the epoch."""
    town, told = Town(persistence=0.0), list[tuple[int, str, str]]()
    town.layer.report_change = lambda now_ns, one, was: told.append((now_ns, was, one.behaviour))
    said = ["walking", *frozen(town, 200)]
    changes = [k for k in range(200) if said[k] != said[k + 1]]
    assert told == [(20 * k * STEP_NS, said[k], said[k + 1]) for k in changes]
    assert len(changes) > 50


def test_at_infinite_temperature_the_shares_are_those_of_the_row() -> None:
    """Though running is worth much (chi-square)."""
    town = Town(persistence=0.0, temperature=1e9)
    town.ways.values = np.array([[0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 5.0, 5.0, 5.0, 5.0]])
    counts = Counter(frozen(town, 4000))
    expected = {name: 4000 * share for name, share in PERSON.behaviours.items()}
    found = stats.chisquare([counts[name] for name in expected], list(expected.values()))
    assert found.pvalue > LEVEL


def test_in_a_frozen_scene_behaviours_and_moves_follow_boltzmanns_law() -> None:
    """pi(b' | s) by its best action, then pi(m | s, b') (chi-square of the pairs)."""
    temperature, epochs = 0.1, 6000
    town = Town(persistence=0.0, temperature=temperature)
    values = np.array([[-0.1, 0.0, -0.05, -0.2, -0.3], [-0.1, 0.05, -0.1, -0.2, -0.15]])
    town.ways.values = values
    said = frozen(town, epochs)
    best = {"walking": values[0].max(), "running": values[1].max(), "stopping": values[0, 0]}
    weights = {b: PERSON.behaviours[b] * np.exp(best[b] / temperature) for b in best}
    expected = {}
    for behaviour, pace in (("walking", 0), ("running", 1)):
        moves = np.exp(values[pace] / temperature)
        for move in range(5):
            share = weights[behaviour] / sum(weights.values()) * moves[move] / moves.sum()
            expected[pace, move] = epochs * share
    # the first decision is about no journey yet, and whoever stops takes no move
    counts = Counter(town.ways.actions)
    moving = len(town.ways.actions)
    stops = said.count("stopping")
    assert moving + stops == epochs
    observed = [*(counts[key] for key in expected), stops]
    wanted = [*expected.values(), epochs * weights["stopping"] / sum(weights.values())]
    assert stats.chisquare(observed, np.array(wanted) * epochs / sum(wanted)).pvalue > LEVEL


def test_moves_slip() -> None:
    """One that is intended to the east goes there, nowhere, or to a side (chi-square)."""
    town, failed = Town(temperature=0.0, slip=0.4), 0
    town.ways.values = np.array([[-1.0, 0.0, -1.0, -1.0, -1.0]])
    town.admit(1, 0, "walking", PERSON)
    for epoch in range(3000):
        town.decide(20 * epoch)
        command = town.road.commands[1]
        failed += command.subgoal_m is None
        assert (command.subgoal_m is None) == (command.face_rad is not None)
    counts = Counter(move for _, move in town.ways.actions)
    assert counts[0] == counts[3] == 0
    found = np.array([failed, counts[1] - failed, counts[2], counts[4]])
    expected = np.array([0.2, 0.6, 0.1, 0.1]) * 3000
    assert stats.chisquare(found, expected).pvalue > LEVEL
