"""A run that was saved as a scenario is repeated: who, when, what, and the way."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from are_ros.bag.decoded import ARRIVED, DEPARTED, Event, Scene
from are_ros.bag.recording import Recording, find_recording
from are_ros.checks.result import Outcome
from are_ros.checks.run import check_recording
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import read_ros_parameters
from are_ros.replay.command import write_results
from are_ros.replay.progress import Say
from are_ros.replay.session import Outcome as ReplayOutcome
from are_ros.replay.session import run_replay
from are_ros.replay.timeline import ReplayOptions

BAGS = Path(__file__).parents[2] / "bags"
EVENTS, TRUTH = "/ar_builder/events", "/ar_builder/artefacts"


def replay(
    out: Path,
    values: Mapping[str, Any],
    duration_s: float,
    save: Path | None,
    say: Say = lambda _: None,
) -> ReplayOutcome:
    """Replay the beginning of the sample by its own parameters and these."""
    own = read_ros_parameters(BAGS / "sample_office.yaml")
    parameters = with_values(with_values(Parameters(), own), values)
    bags = (BAGS / "sample_office.mcap",)
    options = ReplayOptions(
        bags, parameters, out, duration_s=duration_s, save_scenario=save, with_inputs=True
    )
    return run_replay(options, say, lambda *_: lambda _: None)


def values_of(folder: Path, topic: str) -> list[Any]:
    """Return the decoded messages of a topic."""
    with Recording(find_recording(folder)) as recording:
        return [recording.decode(message) for message in recording.in_log_order([topic])]


def comings(folder: Path) -> list[tuple[Any, ...]]:
    """Return who arrived and left, when, and why."""
    events: list[Event] = values_of(folder, EVENTS)
    return sorted(
        (one.stamp_ns, one.kind, one.artefact_id, one.label, one.detail)
        for one in events
        if one.kind in {ARRIVED, DEPARTED}
    )


@pytest.mark.parametrize(
    ("values", "duration_s"),
    [
        # artefact 5 turns away and back within a tick at 30.8 s, when it has arrived
        pytest.param({}, 32.0, id="as shipped", marks=pytest.mark.long),
        pytest.param(
            {"population.arrival_rate": 0.02, "seed": 5}, 12.0, id="a crowd", marks=pytest.mark.long
        ),
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
    scenes: tuple[list[Scene], list[Scene]] = (values_of(run, TRUTH), values_of(again, TRUTH))
    for wanted, found in zip(*scenes, strict=True):
        assert found.stamp_ns == wanted.stamp_ns
        for name in ("ids", "rows", "origins", "arrivals_ns"):
            np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))
        np.testing.assert_allclose(found.ground_poses[:, :3], wanted.ground_poses[:, :3], atol=0.01)
        turns = np.abs(np.remainder(found.yaws_rad - wanted.yaws_rad + np.pi, 2 * np.pi) - np.pi)
        assert turns.max(initial=0.0) < 0.01
    failed = [one.sentence() for one in check_recording(again) if one.outcome is Outcome.FAILED]
    assert failed == []


def test_the_advice_for_a_run_with_a_catalogue_of_its_own_repeats_it(tmp_path: Path) -> None:
    """A catalogue alone would not do: its few rows want a mixture of their own."""
    rows = "classes: {box: {shape: crate}}\nrows: [{label: crate, class: box, size_m: [1, 1, 1]}]\n"
    catalogue, saved, said = tmp_path / "rows.yaml", tmp_path / "saved.yaml", list[str]()
    catalogue.write_text(rows, encoding="utf-8")
    run, again = tmp_path / "run", tmp_path / "again"
    mixture = {"mixture.rates": [0.1], "mixture.weights": [1.0], "population.arrival_rate": 0.01}
    outcome = replay(run, {"catalogue": str(catalogue), **mixture}, 4.0, saved, said.append)
    write_results(outcome, run)
    advice = next(line for line in said if str(catalogue) in line)
    parameters = read_ros_parameters(Path(advice.partition("--params ")[2]))
    replay(again, {**parameters, "population.scenario": str(saved)}, 4.0, None)
    assert comings(again) == comings(run) != []
