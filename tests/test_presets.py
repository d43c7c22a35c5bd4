"""The presets in config/: each describes itself, fits its map, and lives cleanly for a while."""

from dataclasses import replace
from pathlib import Path

import pytest

from are_ros.builder.assembly import catalogue_of
from are_ros.describe.configuration import describe_lines
from are_ros.describe.site import surveyed
from are_ros.lab.soak import soak
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import with_file
from are_ros.population.mixture import mixture_of
from are_ros.replay.command import effective_parameters
from are_ros.world.map_io import read_map_file

PROJECT = Path(__file__).resolve().parents[1]
FOLDER = PROJECT / "config" / "presets"
PRESETS = {
    "office": {"path_following", "dynamic_window", "social_force"},
    "warehouse": {"path_following", "dynamic_window"},
    "crowd": {"social_force"},
}
DETECTORS = ("perfect", "good", "poor")
OFFICE_MAP = PROJECT / "bags" / "sample_office_map.yaml"


def test_all_presets_are_tested() -> None:
    """A preset is a parameter file with a catalogue beside it, or one of a detector."""
    files = {path.stem for path in FOLDER.glob("*.yaml")}
    sites = set(PRESETS) | {f"{name}_catalogue" for name in PRESETS}
    assert files == sites | {f"certainty_{name}" for name in DETECTORS}


def test_the_good_detector_is_the_default_one_switched_on() -> None:
    """So `certainty.enabled` alone is enough; the others differ."""
    on = with_values(Parameters(), {"certainty.enabled": True})
    found = {name: with_file(Parameters(), FOLDER / f"certainty_{name}.yaml") for name in DETECTORS}
    assert found["good"] == on
    assert all(one.certainty.enabled for one in found.values())
    assert replace(found["poor"], certainty=on.certainty) == on, "nothing else is set"
    assert replace(found["perfect"], certainty=on.certainty) == on
    assert len({one.certainty for one in found.values()}) == 3


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_lives(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From any folder: described, and 20 s in the sample office without a fault, with many."""
    monkeypatch.chdir(tmp_path)
    parameters = effective_parameters([FOLDER / f"{name}.yaml"], [], None)
    catalogue = catalogue_of(parameters)
    moving = [row for row in catalogue.rows if row.motion.speed_mps > 0.0]
    assert {planner for row in moving for planner in row.planners} == PRESETS[name]
    grid = read_map_file(OFFICE_MAP)
    site = surveyed(grid, parameters, catalogue)
    assert not site.misfits
    assert any("expected" in line for line in describe_lines(parameters, catalogue, site))
    probabilities = mixture_of(parameters, catalogue).probabilities()
    assert probabilities.min() > 0.02, "each row occurs"
    many = with_values(parameters, {"population.arrival_rate": 0.01})
    result = soak(grid, many, catalogue, longest_s=20.0)
    assert result.is_clean, result.table()
    assert len(result.ways) > 8
