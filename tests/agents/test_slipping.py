"""Slips as they are seen: which way artefacts have really gone at the end of an epoch."""

import math
from collections import Counter

import numpy as np
import pytest
from scipy import stats

from are_ros.agents import decision
from are_ros.agents.local_planner.state import NEVER
from are_ros.agents.mdp.policy import slipped
from are_ros.agents.navigation.terrain import Terrains
from are_ros.agents.simulate import CrowdSimulator
from are_ros.builder import assembly
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.world.regions import SpawnRegion, Zones
from tests.agents.behaviours.diary import EASTBOUND
from tests.agents.test_simulate import environment_of
from tests.builder.town import STEP_NS, TYPES, WALKER, hall

SLIP, LANES, EPOCH = 0.4, 16, 20
EAST, STRAIGHT, LEFT, RIGHT, FAILED = 1, 0, 1, 3, -1
LEVEL = 1e-3
NO_PLAN = np.empty((0, 2))


class Lanes:
    """A hall of lanes, 6 m apart; in each a walker goes east from x = 10 m, 30 m at most."""

    def __init__(self, **values: float) -> None:
        parameters = with_values(Parameters(), {"seed": 3, **values})
        resolver = assembly.collision_resolver(parameters)
        self._crowd = CrowdSimulator(parameters, "robot", resolver, Terrains(), lambda *_: None)
        self._environment = environment_of(hall(50.0, 6.0 * (LANES + 1)))
        free = self._environment.classes.free
        region = SpawnRegion(free, free.astype(np.float32), 1.0)
        self._crowd.enter(self._environment, region, Zones())
        self._home = [GroundPose(10.0, 6.0 * (k + 1), 0.0, 0.0) for k in range(LANES)]
        for k, pose in enumerate(self._home):
            row, history = TYPES.rows[WALKER], PoseHistory(0, pose)
            one = Artefact(k, row, Origin.RANDOM, 0, history, behaviour=EASTBOUND)
            self._crowd.begin(one, None)
        self._index = EPOCH

    def go_home(self) -> None:
        """Let all stand where they set out."""
        table, poses = self._crowd.table, np.array(self._home)
        table.move(poses, table.boxes_at(poses))
        for row, pose in enumerate(self._home):
            table.stand(row, pose)
        table.arrays.memory["passed_at"] = NEVER

    def epoch(self) -> tuple[list[int], list[int]]:
        """Run an epoch; return which way each walker has moved, and goes at its end.

        By quarter turns from the east; FAILED if it is within 0.1 m, or slower than 0.1 m/s.
        """
        before = self._crowd.planner.motion
        for _ in range(EPOCH):
            self._crowd.step(self._index * STEP_NS, self._environment, None, NO_PLAN)
            self._index += 1
        after = self._crowd.planner.motion
        moved_m, velocities = after[:, :2] - before[:, :2], after[:, 5:] * after[:, 3:5]
        return [quarter(*one) for one in moved_m], [quarter(*one) for one in velocities]


def quarter(x: float, y: float) -> int:
    """Return how many quarter turns a vector is from the east, FAILED if it is short."""
    return round(2.0 * math.atan2(y, x) / math.pi) % 4 if math.hypot(x, y) > 0.1 else FAILED


@pytest.mark.parametrize("epochs_on_end", [1, 8])
def test_walkers_really_slip_by_the_law(
    epochs_on_end: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of those that choose to go east: straight on, nowhere, left and right (chi-square).

    From a stand by where they are after the epoch, and while they walk by their velocity then.
    """
    chosen, found = list[int](), Counter[int]()
    lanes = Lanes(**{"behaviour.slip": SLIP, "behaviour.temperature": 0.0})

    def note_chosen(move: int, slip: float, uniform: float) -> int:
        chosen.append(move)
        return slipped(move, slip, uniform)

    monkeypatch.setattr(decision, "slipped", note_chosen)
    for epoch in range(120):
        if epoch % epochs_on_end == 0:
            lanes.go_home()
        chosen.clear()
        moved, going = lanes.epoch()
        ways = moved if epochs_on_end == 1 else going
        found.update(way for move, way in zip(chosen, ways, strict=True) if move == EAST)
    total = found.total()
    assert total > 0.95 * 120 * LANES
    law = {STRAIGHT: 1.0 - SLIP, FAILED: 0.5 * SLIP, LEFT: 0.25 * SLIP, RIGHT: 0.25 * SLIP}
    assert set(found) == set(law)
    expected = [total * share for share in law.values()]
    assert stats.chisquare([found[way] for way in law], expected).pvalue > LEVEL


def test_who_has_the_way_to_itself_hardly_ever_stops() -> None:
    """At the temperature that is shipped, alone in its lane: giving way to nobody saves nothing."""
    lanes, stood = Lanes(**{"behaviour.slip": 0.0}), 0
    for epoch in range(60):
        if epoch % 12 == 0:
            lanes.go_home()
            lanes.epoch()
        _, going = lanes.epoch()
        stood += going.count(FAILED)
    assert stood < 0.03 * 60 * LANES
