"""A run that is kept and played again is the same run: its ground truth, bit by bit."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from are_ros.artefacts.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.artefacts.catalogue_file import read_catalogue
from are_ros.artefacts.population_events import Cause
from are_ros.artefacts.pose_tape import PoseTape
from are_ros.artefacts.scenario import Scenario
from are_ros.artefacts.scenario_file import read_scenario, write_scenario
from are_ros.artefacts.scripted import ScriptedOffer, ScriptedSource
from are_ros.artefacts.track_player import TrackPlayer
from are_ros.builder.life_keeper import LifeKeeper
from are_ros.builder.states import artefact_state
from are_ros.conventions import NS_PER_S

CATALOGUE = read_catalogue()
PERIOD_NS = 50_000_000
START_NS = 1_700_000_000 * NS_PER_S + 17_000_003
FIRST_STEP_NS = -(-START_NS // PERIOD_NS) * PERIOD_NS
TICKS_NS = (100_000_000, 37_000_001)
"""Ticks at sub-steps, and ticks in between."""

Truth = tuple[object, ...]
Record = list[tuple[int, list[Truth]]]


def _truth(artefact: Artefact, now_ns: int) -> Truth:
    """Return all that a message of ground truth tells of an artefact, numbers as their bits."""
    state = artefact_state(artefact, now_ns)
    world = state.map_from_artefact
    numbers = (
        *state.ground_pose,
        *state.linear_velocity_m_s,
        *state.angular_velocity_rad_s,
        *world.translation_m.tolist(),
        *world.rotation_xyzw.tolist(),
    )
    said = (state.behaviour, tuple(state.features.items()), state.arrival_ns, state.departure_ns)
    return (state.artefact_id, state.row, state.origin, *said, struct.pack("17d", *numbers))


@dataclass
class Stage:
    """Who lives, and the record of ticks; what happens between them is for those who derive.

    `bound_for` is where each will be at the next sub-step.
    """

    tape: PoseTape = field(default_factory=PoseTape)
    living: dict[int, Artefact] = field(default_factory=dict)
    gone: list[Artefact] = field(default_factory=list)
    bound_for: dict[int, GroundPose] = field(default_factory=dict)
    record: Record = field(default_factory=list)
    past: Record = field(default_factory=list)

    def run(self, until_ns: int) -> None:
        """Run ticks and sub-steps in the order of time, a sub-step before a tick at its instant."""
        instants = [(t_ns, False) for t_ns in range(FIRST_STEP_NS, until_ns, PERIOD_NS)]
        for period_ns in TICKS_NS:
            first_ns = -(-START_NS // period_ns) * period_ns
            instants += [(t_ns, True) for t_ns in range(first_ns, until_ns, period_ns)]
        for t_ns, is_tick in sorted(set(instants)):
            self.happen_until(t_ns)
            if is_tick:
                self._tick(t_ns)
            else:
                self.sub_step(t_ns)

    def happen_until(self, now_ns: int) -> None:
        """Let the events happen that are due up to `now_ns`."""
        raise NotImplementedError

    def sub_step(self, step_ns: int) -> None:
        """Run a sub-step."""
        raise NotImplementedError

    def begin(self, artefact: Artefact) -> None:
        """Let an artefact live, all in the order of their ids."""
        self.living = dict(sorted({**self.living, artefact.id: artefact}.items()))

    def end(self, artefact_id: int, t_ns: int) -> None:
        """Let an artefact go."""
        artefact = self.living.pop(artefact_id)
        self.tape.stop(artefact_id)
        artefact.departure_ns = t_ns
        self.gone.append(artefact)

    def _tick(self, now_ns: int) -> None:
        present = [one for one in self.living.values() if one.is_present_at(now_ns)]
        self.record.append((now_ns, [_truth(one, now_ns) for one in present]))
        # A scan of a little while ago, and who was there at its stamp.
        for ago_ns in (13_000_007, 180_000_001):
            stamp_ns = now_ns - ago_ns
            was = [o for o in [*self.gone, *self.living.values()] if o.is_present_at(stamp_ns)]
            was.sort(key=lambda one: one.id)
            states = [(o.id, struct.pack("4d", *o.ground_pose_at(stamp_ns))) for o in was]
            self.past.append((stamp_ns, [*states]))


class Original(Stage):
    """A run with everything that can happen to an artefact, drawn from a generator."""

    def __init__(self, seed: int, until_ns: int) -> None:
        super().__init__()
        self.random = np.random.default_rng(seed)
        self.keeper = LifeKeeper(PERIOD_NS)
        self.keeper.start(START_NS)
        self._ids = [1, 2, 3, 1_000_000_000, 1_000_000_001]
        span_ns = until_ns - START_NS
        instants_ns = [START_NS + int(self.random.integers(span_ns)) for _ in self._ids]
        if seed % 3 == 0:
            instants_ns[0] = FIRST_STEP_NS  # with a sub-step, to the nanosecond
        self._arrivals = sorted(instants_ns)

    def happen_until(self, now_ns: int) -> None:
        """Let artefacts come and go, or begin to leave, at instants of their own."""
        while (event := min(self._events(), default=None)) is not None and event[0] <= now_ns:
            t_ns, artefact_id = event
            if artefact_id == 0:
                self._arrive(t_ns)
            elif self.random.random() < 0.5:
                artefact = self.living[artefact_id]
                artefact.is_leaving, artefact.departure_ns = True, None
                artefact.behaviour, artefact.activity = "leaving", "to the exit"
            else:
                self._depart(artefact_id, t_ns, Cause.LIFE_OVER)
            self.keeper.look(t_ns, self.living)

    def sub_step(self, step_ns: int) -> None:
        """Let some jump and some leave; then let everybody stand, or move and do something else."""
        self.keeper.begin_step(step_ns)
        starts = {i: self._start(step_ns, i) for i in self.living}
        for artefact_id in list(self.living):
            if self.random.random() < 0.03:
                self._depart(artefact_id, step_ns, Cause.DISPLACED)
        ids = np.array(list(self.living), np.int64)
        self.bound_for = {i: self._end(artefact, starts[i]) for i, artefact in self.living.items()}
        befores, afters = (
            _rows([poses[i] for i in self.living]) for poses in (starts, self.bound_for)
        )
        self.tape.record(step_ns, step_ns + PERIOD_NS, ids, befores, afters)
        self.keeper.step(step_ns, ids, befores, afters)
        self.keeper.look(step_ns, self.living)

    def _events(self) -> Iterator[tuple[int, int]]:
        yield from ((t_ns, 0) for t_ns in self._arrivals[:1])
        for artefact in self.living.values():
            if artefact.departure_ns is not None:
                yield artefact.departure_ns, artefact.id

    def _arrive(self, t_ns: int) -> None:
        self._arrivals.pop(0)
        artefact_id, row = self._ids.pop(), CATALOGUE.rows[int(self.random.integers(40))]
        pose = self.bound_for[artefact_id] = GroundPose(*self.random.normal(size=4).tolist())
        history = self.tape.begin(artefact_id, t_ns, pose)
        known = self.random.random() < 0.7
        end_ns = t_ns + int(self.random.integers(3 * NS_PER_S)) if known else None
        if end_ns is not None and self.random.random() < 0.3:
            end_ns = -(-end_ns // PERIOD_NS) * PERIOD_NS  # with a sub-step, and before it
        origin = Origin(int(self.random.integers(3)))
        artefact = Artefact(artefact_id, row, origin, t_ns, history, end_ns, "walking")
        self.begin(artefact)
        self.keeper.arrived(artefact)

    def _depart(self, artefact_id: int, t_ns: int, cause: Cause) -> None:
        self.end(artefact_id, t_ns)
        self.keeper.departed(artefact_id, t_ns, cause)

    def _start(self, step_ns: int, artefact_id: int) -> GroundPose:
        """Return where one is, that may have been moved back or to somewhere else."""
        pose, what = self.bound_for[artefact_id], self.random.random()
        if what < 0.05 and step_ns - self.living[artefact_id].arrival_ns > PERIOD_NS:
            return self.living[artefact_id].ground_pose_at(step_ns - PERIOD_NS)
        return self._near(pose) if what > 0.95 else pose

    def _end(self, artefact: Artefact, pose: GroundPose) -> GroundPose:
        """Return where one will be."""
        artefact.activity = ("", "pausing", "-", "--", 'waiting for "artefact 12", long')[
            int(self.random.choice(5, p=(0.8, 0.05, 0.05, 0.05, 0.05)))
        ]
        what = self.random.random()
        if what < 0.4:
            return pose
        return pose._replace(y_m=-0.0) if what > 0.9 else self._near(pose)

    def _near(self, pose: GroundPose) -> GroundPose:
        return GroundPose(*(np.array(pose) + 0.1 * self.random.normal(size=4)).tolist())


def _rows(poses: list[GroundPose]) -> npt.NDArray[np.float64]:
    return np.array(poses, np.float64).reshape(-1, 4)


class Repeated(Stage):
    """A plain stand-in for the builder: offers live where and as long as they say."""

    def __init__(self, scenario: Scenario, keeper: LifeKeeper | None = None) -> None:
        super().__init__()
        self._source = ScriptedSource(scenario)
        self._source.restart(START_NS)
        self._source.open(START_NS)
        self._player = TrackPlayer(PERIOD_NS)
        self._ends: dict[int, tuple[int, Cause]] = {}
        self._keeper = keeper
        if keeper is not None:
            keeper.start(START_NS)

    def happen_until(self, now_ns: int) -> None:
        """Let departures, arrivals and doings happen, in this order at one instant."""
        while (event := min(self._events())) is not None and event[0] <= now_ns:
            t_ns, kind, artefact_id = event
            if kind == 0 and self._player.ends_with_step(artefact_id, t_ns):
                self.living[artefact_id].is_leaving = True
                self._ends[artefact_id] = 2**63, self._ends[artefact_id][1]
            elif kind == 0:
                self._depart(artefact_id, t_ns)
            elif kind == 1:
                self._arrive(self._source.take())
            else:
                self._player.tell(t_ns)
            if self._keeper is not None:
                self._keeper.look(t_ns, self.living)

    def sub_step(self, step_ns: int) -> None:
        """Let the tracks go on."""
        if self._keeper is not None:
            self._keeper.begin_step(step_ns)
        starts = self.bound_for | self._player.jumps(step_ns)
        for artefact_id in self._player.leaving:
            self._depart(artefact_id, step_ns)
        ids = np.array(self._player.ids, np.int64)
        befores = _rows([starts[i] for i in ids.tolist()])
        afters = self._player.set_out(step_ns, befores)
        self.bound_for = {
            i: GroundPose(*pose) for i, pose in zip(self._player.ids, afters.tolist(), strict=True)
        }
        self.tape.record(step_ns, step_ns + PERIOD_NS, ids, befores, afters)
        if self._keeper is not None:
            self._keeper.step(step_ns, ids, befores, afters)
            self._keeper.look(step_ns, self.living)

    def _events(self) -> Iterator[tuple[int, int, int]]:
        yield 2**62, 3, 0
        yield from ((t_ns, 0, i) for i, (t_ns, _) in self._ends.items())
        for kind, t_ns in ((1, self._source.next_ns()), (2, self._player.next_ns())):
            if t_ns is not None:
                yield t_ns, kind, 0

    def _arrive(self, offer: ScriptedOffer) -> None:
        assert offer.track is not None
        assert offer.has_height
        artefact_id, t_ns = offer.artefact_id, offer.time_ns
        history = PoseHistory(t_ns, offer.pose)
        end_ns = None if offer.life_ns is None else t_ns + offer.life_ns
        artefact = Artefact(
            artefact_id, offer.row, offer.origin, t_ns, history, end_ns, offer.behaviour
        )
        if end_ns is not None:
            self._ends[artefact_id] = end_ns, offer.cause
        self.begin(artefact)
        leg = self._player.add(artefact, offer.track, offer.start_ns)
        self.bound_for[artefact_id] = leg[1]
        artefact.history = self.tape.begin(artefact_id, t_ns, offer.pose, leg)
        if self._keeper is not None:
            self._keeper.arrived(artefact)

    def _depart(self, artefact_id: int, t_ns: int) -> None:
        _, cause = self._ends.pop(artefact_id)
        self._player.remove(artefact_id)
        self.end(artefact_id, t_ns)
        if self._keeper is not None:
            self._keeper.departed(artefact_id, t_ns, cause)


def _content(scenario: Scenario) -> list[Truth]:
    """Return all of a scenario as values that compare, numbers as their bits."""
    return [
        (
            *(one.row.label, one.pose, one.arrives_ns, one.stays_ns, one.behaviour, one.name),
            *(one.way_m, one.loop, one.follows, one.speed_mps, one.artefact_id, one.origin),
            *(one.cause, one.blocked),
            one.track and (one.track.times_ns.tobytes(), one.track.poses.tobytes()),
            one.track and one.track.doings,
        )
        for one in scenario.artefacts
    ]


# A seed does not shrink to anything simpler.
@settings(max_examples=50, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(seed=st.integers(0, 10**6), seconds=st.floats(0.1, 4.0))
def test_a_kept_run_is_repeated_bit_by_bit(seed: int, seconds: float) -> None:
    """Ids, times, poses, twists, doings, ends at all ticks; poses at stamps between, through files.

    And the repeated run, when it is kept and repeated in turn, is still the same.
    """
    until_ns = START_NS + round(seconds * NS_PER_S)
    original = Original(seed, until_ns)
    original.run(until_ns)
    scenario = original.keeper.scenario("seen")
    with TemporaryDirectory() as folder:
        path = Path(folder, "kept.yaml")
        write_scenario(scenario, path)
        saved = read_scenario(path, CATALOGUE)
    assert _content(saved) == _content(scenario)
    again = LifeKeeper(PERIOD_NS)
    repeated = Repeated(saved, again)
    repeated.run(until_ns)
    assert repeated.record == original.record
    assert repeated.past == original.past
    assert any(truths for _, truths in original.record) or seconds < 2.0
    third = Repeated(again.scenario())
    third.run(until_ns)
    assert third.record == original.record


def test_a_scenario_of_a_run_has_nobody_at_random() -> None:
    """The replay of a kept run brings those who were there, and nobody beside them."""
    keeper = LifeKeeper(PERIOD_NS)
    assert not keeper.scenario().random
    assert keeper.scenario("quiet").name == "quiet"
    assert keeper.scenario().artefacts == ()


def _artefact(artefact_id: int, t_ns: int, end_ns: int | None = None) -> Artefact:
    history = PoseHistory(t_ns, GroundPose(1.0, 2.0, 0.0, 0.5))
    row = CATALOGUE.rows[15]
    return Artefact(artefact_id, row, Origin.RANDOM, t_ns, history, end_ns, "walking")


def _step(keeper: LifeKeeper, t_ns: int, ids: list[int], x_m: float) -> None:
    """Let all walk on a metre from x."""
    before, after = (np.tile((x_m + k, 2.0, 0.0, 0.5), (len(ids), 1)) for k in (0.0, 1.0))
    keeper.step(t_ns, np.array(ids, np.int64), before, after)


def test_who_could_not_come_is_kept_in_order() -> None:
    """With its reason, among those who came; ids tell who of one instant was first."""
    keeper = LifeKeeper(PERIOD_NS)
    keeper.start(100)
    keeper.refused(3, CATALOGUE.rows[1], 150, "max_alive")
    keeper.arrived(_artefact(2, 150))
    keeper.refused(1, CATALOGUE.rows[0], 160, "no_place")
    found = [(one.artefact_id, one.arrives_ns, one.blocked) for one in keeper.scenario().artefacts]
    assert found == [(2, 50, ""), (3, 50, "max_alive"), (1, 60, "no_place")]
    keeper.start(200)
    assert not keeper.scenario().artefacts


def test_who_stands_takes_one_pose() -> None:
    """A thousand sub-steps of somebody who stands add nothing to the one pose of the arrival."""
    keeper = LifeKeeper(PERIOD_NS)
    keeper.start(0)
    keeper.arrived(_artefact(7, 5))
    poses = np.array([[1.0, 2.0, 0.0, 0.5]])
    for k in range(1, 1001):
        keeper.step(k * PERIOD_NS, np.array([7]), poses.copy(), poses.copy())
    assert len(keeper) == 1
    (one,) = keeper.scenario().artefacts
    assert one.track is not None
    assert len(one.track) == 1


def test_a_run_that_is_too_long_ends_where_it_is_full() -> None:
    """No more is kept than the bound; all alive go there, and a sentence says so."""
    keeper = LifeKeeper(PERIOD_NS, most_poses=3)
    keeper.start(0)
    keeper.arrived(_artefact(1, 0, 10 * NS_PER_S))
    for k in range(1, 10):
        _step(keeper, k * PERIOD_NS, [1], float(k))
    keeper.arrived(_artefact(2, NS_PER_S))
    keeper.look(NS_PER_S, {})
    keeper.departed(1, 2 * NS_PER_S, Cause.REMOVED)
    (one,) = keeper.scenario().artefacts
    assert one.stays_ns == 3 * PERIOD_NS
    assert one.track is not None
    assert one.track.times_ns.tolist() == [k * PERIOD_NS for k in range(4)]
    assert keeper.notice.startswith("the scenario ends after 0.150 s, where all go: more than 3 ")


def test_a_new_start_forgets_what_was() -> None:
    """After the clock has jumped, times count from there, and nobody is known."""
    keeper = LifeKeeper(PERIOD_NS)
    keeper.start(0)
    keeper.arrived(_artefact(1, 10))
    keeper.start(1000)
    assert not keeper.scenario().artefacts
    keeper.arrived(_artefact(2, 1250))
    (one,) = keeper.scenario().artefacts
    assert (one.artefact_id, one.arrives_ns, one.stays_ns) == (2, 250, None)
    assert not keeper.notice


def test_ids_that_are_not_the_living_are_refused() -> None:
    """A sub-step must tell of all who live, and of nobody else."""
    keeper = LifeKeeper(PERIOD_NS)
    keeper.start(0)
    keeper.arrived(_artefact(1, 0))
    with pytest.raises(ValueError, match="the ids are not those who arrived"):
        _step(keeper, PERIOD_NS, [2], 1.0)
