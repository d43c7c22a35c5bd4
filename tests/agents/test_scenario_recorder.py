"""A run that is recorded is a scenario: who, when, what, and the way."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from are_ros.agents.scenario_recorder import ScenarioRecorder
from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.builder.files.scenario_file import read_scenario, write_scenario
from are_ros.conventions import NS_PER_S
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.departures import Cause

CATALOGUE = read_catalogue()
PERIOD_NS = 50_000_000
START_NS = 1_700_000_000 * NS_PER_S
POSE = (1.0, 2.0, 0.0, 0.5)


def _artefact(artefact_id: int, t_ns: int, end_ns: int | None = None) -> Artefact:
    history = PoseHistory(t_ns, GroundPose(*POSE))
    row = CATALOGUE.rows[15]
    return Artefact(artefact_id, row, Origin.RANDOM, t_ns, history, end_ns, "walking")


def _keeper(*artefacts: Artefact) -> ScenarioRecorder:
    keeper = ScenarioRecorder(PERIOD_NS)
    keeper.start(START_NS)
    for artefact in artefacts:
        keeper.arrived(artefact)
    return keeper


@pytest.mark.parametrize("seed", range(20))
def test_the_way_is_that_of_the_run(tmp_path: Path, seed: int) -> None:
    """Standing, going and jumping, read from the files: within 1 mm at any time."""
    random = np.random.default_rng(seed)
    arrival_ns = START_NS + int(random.integers(PERIOD_NS))
    keeper = _keeper(_artefact(7, arrival_ns))
    truth: list[tuple[int, Any, Any]] = [(arrival_ns, np.array(POSE), np.array(POSE))]
    here = np.array([POSE])
    for k in range(1, 60):
        t_ns, what = START_NS + k * PERIOD_NS, random.random()
        start = here + random.normal(size=4) if what > 0.9 else here
        end = start + 0.1 * random.normal(size=4) if what > 0.3 else start
        keeper.step(t_ns, np.array([7]), start, end)
        truth.append((t_ns, start[0], end[0]))
        here = end
    write_scenario(keeper.scenario(), tmp_path / "s.yaml")
    (one,) = read_scenario(tmp_path / "s.yaml", CATALOGUE).artefacts
    assert one.track is not None
    for t_ns, start, end in truth[1:]:
        for share in (0.0, 0.4):
            at_ns = t_ns - START_NS + round(share * PERIOD_NS)
            expected = start + share * (end - start)
            assert np.abs(np.array(one.track.pose_at(at_ns)) - expected)[:3].max() < 1e-3
    jumps = [b[0] - START_NS for a, b in pairwise(truth) if np.any(a[2] != b[1])]
    found = [one.track.jump_within(t_ns - PERIOD_NS, t_ns) for t_ns in jumps]
    assert None not in found


def test_a_life_has_its_times_origin_and_cause() -> None:
    """Times count from the start of the run; a life that is not over keeps its end as planned."""
    first, second = _artefact(2, START_NS + 50), _artefact(1, START_NS + 50, START_NS + 90)
    keeper = _keeper(first, second, _artefact(3, START_NS + 10))
    keeper.departed(2, START_NS + 70, Cause.DISPLACED)
    scenario = keeper.scenario("seen")
    assert (scenario.name, scenario.random) == ("seen", False)
    found = [(one.artefact_id, one.arrives_ns, one.stays_ns) for one in scenario.artefacts]
    assert found == [(3, 10, None), (1, 50, 40), (2, 50, 20)]
    last = scenario.artefacts[2]
    assert (last.row, last.origin, last.behaviour) == (CATALOGUE.rows[15], Origin.RANDOM, "walking")
    assert last.cause is Cause.DISPLACED


def test_who_stands_takes_one_pose() -> None:
    """A thousand sub-steps of an artefact that stands add nothing to the pose of its arrival."""
    keeper, poses = _keeper(_artefact(7, START_NS)), np.array([POSE])
    for k in range(1, 1001):
        keeper.step(START_NS + k * PERIOD_NS, np.array([7]), poses.copy(), poses.copy())
    (one,) = keeper.scenario().artefacts
    assert one.track is not None
    assert len(one.track) == 1


def test_a_gap_is_left_out() -> None:
    """A scenario goes on after a gap of the recording as if there were none."""
    keeper = _keeper(_artefact(1, START_NS + 10))
    keeper.departed(1, START_NS + 20, Cause.RECORDING_GAP)
    keeper.postpone(1000)
    keeper.arrived(_artefact(2, START_NS + 1030))
    found = [(one.arrives_ns, one.stays_ns) for one in keeper.scenario().artefacts]
    assert found == [(10, 10), (30, None)]


def test_a_new_start_forgets_what_was() -> None:
    """After the clock has jumped, times count from there, and nobody is known."""
    keeper = _keeper(_artefact(1, START_NS))
    keeper.start(START_NS + 1000)
    assert not keeper.scenario().artefacts
    keeper.arrived(_artefact(2, START_NS + 1250))
    (one,) = keeper.scenario().artefacts
    assert (one.artefact_id, one.arrives_ns) == (2, 250)


def test_a_displacement_on_arrival_moves_the_arrival() -> None:
    """An artefact that is displaced in the sub-step of its arrival arrives where it was put."""
    keeper = _keeper(_artefact(1, START_NS))
    there = np.array([[3.0, 2.0, 0.0, 0.5]])
    keeper.step(START_NS, np.array([1]), there, there)
    (one,) = keeper.scenario().artefacts
    assert one.pose.x_m == 3.0
    assert one.track is not None
    assert len(one.track) == 1
