"""A run that was saved as a scenario is repeated: who, when, what, and the way."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from are_ros.builder.outputs import ArtefactState
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import read_ros_parameters
from are_ros.replay._recorded_messages import event_of, state_of
from are_ros.replay.bag_reader import BagReader
from are_ros.replay.checks import Outcome, check_replay
from are_ros.replay.options import ReplayOptions
from are_ros.replay.output_folder import AUGMENTED
from are_ros.replay.session import run_replay

BAGS = Path(__file__).parents[2] / "bags"
EVENTS, TRUTH = "/ar_builder/events", "/ar_builder/artefacts"

Tick = tuple[int, list[ArtefactState]]


def replay(out: Path, values: Mapping[str, Any], duration_s: float, save: Path | None) -> None:
    """Replay the beginning of the sample by its own parameters and these."""
    own = read_ros_parameters(BAGS / "sample_office.yaml")
    parameters = with_values(with_values(Parameters(), own), values)
    bags = (BAGS / "sample_office.mcap",)
    options = ReplayOptions(
        bags, parameters, out, duration_s=duration_s, save_scenario=save, with_inputs=True
    )
    run_replay(options, lambda _: None, lambda *_: lambda _: None)


def messages(folder: Path, topic: str) -> Iterator[tuple[int, Any]]:
    """Yield the time and the content of each message of a topic."""
    with BagReader([folder / AUGMENTED]) as reader:
        reader.learn_types([topic])
        for one in reader.messages([topic]):
            yield one.log_time_ns, reader.deserialize(one)


def ticks(folder: Path) -> list[Tick]:
    """Return the ground truth of each tick."""
    return [(t_ns, [state_of(one) for one in m.artefacts]) for t_ns, m in messages(folder, TRUTH)]


def comings(folder: Path) -> list[tuple[Any, ...]]:
    """Return who arrived and left, when, and why."""
    events = [event_of(message) for _, message in messages(folder, EVENTS)]
    return sorted(
        (one.stamp_ns, one.kind.value, one.artefact_id, one.label, one.detail)
        for one in events
        if one.kind.name in {"ARRIVED", "DEPARTED"}
    )


@pytest.mark.parametrize(
    ("values", "duration_s"),
    [
        # artefact 5 turns away and back within a tick at 30.8 s, when it has arrived
        pytest.param({}, 32.0, id="as shipped"),
        pytest.param({"population.arrival_rate": 0.02, "seed": 5}, 12.0, id="a crowd"),
        pytest.param(
            {
                "population.arrival_rate": 0.02,
                "population.mean_life": 3.0,
                "builder.tick_rate": 7.0,
            },
            12.0,
            id="short lives, odd ticks",
        ),
    ],
)
def test_a_saved_run_is_repeated_within_a_centimetre(
    tmp_path: Path, values: Mapping[str, Any], duration_s: float
) -> None:
    """Arrivals, departures, ids, rows, origins; poses at all ticks; and it passes the checks."""
    run, again, saved = tmp_path / "run", tmp_path / "again", tmp_path / "saved.yaml"
    replay(run, values, duration_s, saved)
    replay(again, {**values, "population.scenario": str(saved)}, duration_s, None)
    assert comings(again) == comings(run)
    assert len(comings(run)) > 3
    for (t_ns, wanted), (again_ns, found) in zip(ticks(run), ticks(again), strict=True):
        assert t_ns == again_ns
        assert [(one.artefact_id, one.row, one.origin, one.arrival_ns) for one in found] == [
            (one.artefact_id, one.row, one.origin, one.arrival_ns) for one in wanted
        ]
        for one, other in zip(wanted, found, strict=True):
            a, b = one.ground_pose, other.ground_pose
            assert math.dist(a[:3], b[:3]) < 0.01
            assert abs(math.remainder(a.yaw_rad - b.yaw_rad, math.tau)) < 0.01
    failed = [one.sentence() for one in check_replay(again) if one.outcome is Outcome.FAILED]
    assert failed == []
