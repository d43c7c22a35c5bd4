"""The sub-step of all: counts, causes, histories, and what the resolver changes."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from are_ros.agents.collisions import CollisionResolver, Outcome, Resolution
from are_ros.agents.events import ArtefactEvent, EventKind
from are_ros.agents.navigation.terrain import Terrains
from are_ros.agents.simulate import CrowdSimulator
from are_ros.builder import assembly
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.departures import Cause
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.regions import SpawnRegion, Zones
from tests.builder.town import POST, STEP_NS, TYPES, WALKER, hall

NO_PLAN = np.empty((0, 2))


class Verdicts(CollisionResolver):
    """Keeps everybody but those that the test has a verdict for, by index."""

    def __init__(self) -> None:
        self.outcomes: dict[int, Outcome] = {}

    def resolve(
        self,
        ids: npt.NDArray[np.int64],
        proposed: OrientedBoxes,
        last_safe: OrientedBoxes,
        *_: Any,
    ) -> Resolution:
        """Return the verdicts; who is displaced is a metre farther along x."""
        outcomes, shifts = np.zeros(len(ids), np.int8), np.zeros((len(ids), 2))
        for i, outcome in self.outcomes.items():
            outcomes[i] = outcome
            shifts[i, 0] = outcome is Outcome.DISPLACED_TO_SAFE
        boxes = proposed if not outcomes.any() else last_safe
        return Resolution(outcomes, shifts, boxes, ())


def environment_of(grid: OccupancyGrid) -> Environment:
    """Return the environment of a map."""
    return Environment(grid, classify(grid, 65, 25), None, PlaneGround(0.0), 0.01)


class Stage:
    """A simulator, and those who are moved."""

    def __init__(self, resolver: CollisionResolver | None = None) -> None:
        parameters = Parameters()
        resolver = resolver or assembly.collision_resolver(parameters)
        self.crowd = CrowdSimulator(parameters, "robot", resolver, Terrains(), self.depart)
        self.living: dict[int, Artefact] = {}
        self.departed: list[tuple[int, Cause]] = []
        self.enter(hall(10.0, 8.0))

    def enter(self, grid: OccupancyGrid) -> None:
        """Be in a map, all of it the region."""
        self.environment = environment_of(grid)
        free = self.environment.classes.free
        region = SpawnRegion(free, free.astype(np.float32), 1.0)
        self.crowd.enter(self.environment, region, Zones())

    def add(self, artefact_id: int, kind: int, x_m: float, y_m: float) -> Artefact:
        """Let one be there from time 0 on."""
        history = PoseHistory(0, GroundPose(x_m, y_m, 0.0, 0.0))
        row = TYPES.rows[kind]
        (behaviour,) = row.behaviours
        one = Artefact(artefact_id, row, Origin.RANDOM, 0, history, behaviour=behaviour)
        self.living[artefact_id] = one
        self.living = dict(sorted(self.living.items()))
        self.crowd.begin(one, None)
        return one

    def step(self, index: int) -> list[ArtefactEvent]:
        """Run the sub-step of a number; return what happened."""
        self.crowd.step(index * STEP_NS, self.environment, None, NO_PLAN)
        return self.crowd.take_events()

    def depart(self, artefact_id: int, now_ns: int, cause: Cause) -> None:
        """Let one go."""
        self.departed.append((artefact_id, cause))
        del self.living[artefact_id]
        self.crowd.end(artefact_id, now_ns, cause)


def test_only_what_can_move_decides_and_all_are_in_the_table() -> None:
    """In the order of ids, whoever came first; who ends is nowhere."""
    stage = Stage()
    stage.add(5, POST, 2.0, 2.0)
    stage.add(3, WALKER, 5.0, 4.0)
    table = stage.crowd.table
    assert table.ids.tolist() == [3, 5]
    assert [table.state_of(i) is None for i in (3, 5)] == [False, True]
    stage.crowd.end(3, 0, Cause.REMOVED)
    assert table.ids.tolist() == [5]
    with pytest.raises(KeyError):
        table.state_of(3)


def test_sub_steps_are_counted_by_artefact() -> None:
    """All, and those of who moved; nothing is resolved where nothing collides."""
    stage = Stage()
    stage.add(1, POST, 2.0, 2.0)
    stage.add(2, WALKER, 5.0, 4.0)
    moved = 0
    for index in range(1, 61):
        stage.step(index)
        start = stage.living[2].ground_pose_at(index * STEP_NS)
        moved += index < 60 and stage.living[2].history.latest != start
    counts = stage.crowd.counts
    assert counts.artefact_steps == 120
    assert counts.moving_steps == moved > 20
    assert (counts.moved_back, counts.displaced) == (0, 0)


def test_decisions_see_where_committed_paths_lead() -> None:
    """At the end of each epoch ahead; where the path has ended, its last pose."""
    stage, seen = Stage(), list[npt.NDArray[np.float64]]()
    for k in range(4):
        stage.add(k, WALKER, 2.0 + 1.5 * k, 4.0)
    crowd, compared = stage.crowd, 0
    crowd.decisions.report = lambda *told: seen.append(told[3].crowd[9])
    for index in range(1, 101):
        paths = [crowd.planner.trajectory(row) for row in range(4)]
        stage.step(index)
        for ahead_m in seen:
            for row, path in enumerate(paths):
                expected = [path[min(k, len(path) - 1), :2] for k in (19, 39)]
                assert np.array_equal(ahead_m[row], expected)
                compared += len(path) > 20
        seen.clear()
    assert compared > 20


def test_poses_of_crowd_traffic_and_history_are_one() -> None:
    """When a sub-step begins, and as planned for the next one, to the bit."""
    stage = Stage()
    for k in range(5):
        stage.add(k, WALKER, 2.0 + k, 4.0)
    for index in range(1, 81):
        stage.step(index)
        crowd = stage.crowd.table
        assert np.array_equal(crowd.ends[:, [0, 1, 3]], stage.crowd.planner.motion[:, :3])
        for k, poses in ((0, crowd.poses), (1, crowd.ends)):
            now = [one.ground_pose_at((index + k) * STEP_NS) for one in stage.living.values()]
            assert np.array_equal(poses, np.array(now))


def test_it_is_known_when_one_sets_off_and_where_to() -> None:
    """Before that it is one pose: nobody drifts from the arrival on."""
    stage = Stage()
    one = stage.add(1, WALKER, 5.0, 4.0)
    start = one.history.latest
    for index in range(1, 100):
        stage.step(index)
        if one.history.latest != start:
            break
    now_ns = index * STEP_NS
    assert one.history.latest_ns == now_ns + STEP_NS
    assert one.ground_pose_at(now_ns) == start
    assert one.ground_pose_at(now_ns - 1) == start
    assert one.history.velocity_at(now_ns - 1) == (0.0, 0.0, 0.0)
    assert any(one.history.velocity_at(now_ns))
    assert one.ground_pose_at(now_ns + STEP_NS // 2) != start


def test_what_is_known_of_an_instant_does_not_change() -> None:
    """Where one will be until the next sub-step is where it was, whatever became of it there."""
    for outcome in (Outcome.KEPT, Outcome.MOVED_BACK, Outcome.DISPLACED_TO_SAFE, Outcome.LEAVES):
        verdicts = Verdicts()
        stage, index = walking(verdicts)
        instants = [index * STEP_NS + k * STEP_NS // 7 for k in range(7)]
        one = stage.living[1]
        known = [one.ground_pose_at(t_ns) for t_ns in instants]
        verdicts.outcomes = {0: outcome}
        stage.step(index + 1)
        assert [one.ground_pose_at(t_ns) for t_ns in instants] == known
        assert len(set(known)) == 7


def walking(verdicts: Verdicts) -> tuple[Stage, int]:
    """Return a stage where one walks, and the number of its last sub-step."""
    stage = Stage(verdicts)
    stage.add(1, WALKER, 5.0, 4.0)
    for index in range(1, 100):
        stage.step(index)
        if stage.crowd.planner.motion[0, 5] > 0.5:
            return stage, index
    raise AssertionError


def test_who_is_moved_back_stands_where_it_was() -> None:
    """A sub-step ago, from the instant on; the traffic lets it set off from a stand."""
    verdicts = Verdicts()
    stage, index = walking(verdicts)
    one, now_ns = stage.living[1], (index + 1) * STEP_NS
    before = one.ground_pose_at(now_ns - STEP_NS)
    verdicts.outcomes = {0: Outcome.MOVED_BACK}
    assert stage.step(index + 1) == []
    assert stage.departed == []
    assert stage.crowd.table.poses[0].tolist() == list(before)
    assert stage.crowd.counts.moved_back == 1
    after = one.ground_pose_at(now_ns + STEP_NS)
    assert one.ground_pose_at(now_ns) == before
    assert math.dist(before[:2], after[:2]) <= 1.5 * 0.05 * 0.05 + 1e-9


def test_nobody_runs_into_one_that_arrives_on_its_way() -> None:
    """It stands, instead of an overlap from which it would be moved back a sub-step later."""
    stage, index = walking(Verdicts())
    stage.crowd.resolver = assembly.collision_resolver(Parameters())
    one, now_ns = stage.living[1], (index + 1) * STEP_NS
    x_m, y_m, _, yaw_rad = committed = one.history.latest
    ahead = math.cos(yaw_rad), math.sin(yaw_rad)
    apart_m = 0.15 + 0.2 * (abs(ahead[0]) + abs(ahead[1])) + 0.001
    stage.add(2, POST, x_m + apart_m * ahead[0], y_m + apart_m * ahead[1])
    stage.step(index + 1)
    assert one.ground_pose_at(now_ns) == one.ground_pose_at(now_ns + STEP_NS) == committed
    assert stage.step(index + 2) == []
    assert stage.crowd.counts.moved_back == 1


def test_who_is_displaced_jumps_at_the_instant() -> None:
    """The event tells how far; until then it went where it was bound for."""
    verdicts = Verdicts()
    stage, index = walking(verdicts)
    one, now_ns = stage.living[1], (index + 1) * STEP_NS
    before, bound_for = one.ground_pose_at(now_ns - STEP_NS), one.history.latest
    verdicts.outcomes = {0: Outcome.DISPLACED_TO_SAFE}
    (event,) = stage.step(index + 1)
    assert stage.crowd.table.poses[0, 0] == before.x_m + 1.0
    assert (event.kind, event.artefact_id, event.stamp_ns) == (EventKind.DISPLACED, 1, now_ns)
    landed = before._replace(x_m=before.x_m + 1.0)
    assert event.value == math.dist(landed[:2], bound_for[:2])
    assert one.ground_pose_at(now_ns - 1)[:2] == pytest.approx(bound_for[:2], abs=1e-8)
    assert one.ground_pose_at(now_ns) == landed
    assert max(map(abs, one.history.velocity_at(now_ns)[:2])) <= 1.5 * 0.05 + 1e-9
    assert stage.crowd.counts.displaced == 1


@pytest.mark.parametrize(
    ("outcome", "cause"),
    [(Outcome.LEAVES, Cause.DISPLACED), (Outcome.LEAVES_ON_CONTACT, Cause.ROBOT_CONTACT)],
)
def test_who_has_to_leave_is_told_with_the_cause(outcome: Outcome, cause: Cause) -> None:
    """The caller lets it go before the others set out; then nothing more happens."""
    verdicts = Verdicts()
    stage, index = walking(verdicts)
    verdicts.outcomes = {0: outcome}
    assert stage.step(index + 1) == []
    assert stage.departed == [(1, cause)]
    verdicts.outcomes = {}
    assert stage.step(index + 2) == []
    assert stage.crowd.counts.displaced == (cause is Cause.DISPLACED)


def test_places_follow_the_map() -> None:
    """Another map has other places; the same one is not surveyed again."""
    stage = Stage()
    first = stage.crowd.navigation.places
    assert len(first.destinations_m) >= 4
    stage.crowd.enter(stage.environment, None, Zones())
    assert stage.crowd.navigation.places is first
    stage.enter(hall(10.0, 8.0, (4.0, 5.0, 2.0, 6.0), gap=(9.9, 10.0, 2.0, 6.0)))
    second = stage.crowd.navigation.places
    assert second is not first
    assert len(first.exits_m) == 0
    assert len(second.exits_m) >= 1


def test_an_empty_stage_steps() -> None:
    """Nobody moves, nothing happens."""
    assert Stage().step(1) == []
