"""The presets in config/: each describes itself, fits its map, and lives cleanly for a while."""

from pathlib import Path

import pytest

from are_ros.builder.assembly import catalogue_of
from are_ros.describe.configuration import describe_lines
from are_ros.describe.site import surveyed
from are_ros.lab.soak import soak
from are_ros.parameters.declaration import with_values
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
OFFICE_MAP = PROJECT / "bags" / "sample_office_map.yaml"


def test_all_presets_are_tested() -> None:
    """A preset is a parameter file with a catalogue beside it."""
    files = {path.stem for path in FOLDER.glob("*.yaml")}
    assert files == set(PRESETS) | {f"{name}_catalogue" for name in PRESETS}


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
