"""The map in bags/, and the program that takes it out of the recording."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from are_ros.bag.reader import BagReader
from are_ros.messages.maps import read_grid
from are_ros.world.map_io import read_map_file

BAGS = Path(__file__).resolve().parents[2] / "bags"
PROGRAM, SAMPLE = BAGS / "make_sample_map.py", BAGS / "sample_office.mcap"


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the map, made now."""
    path = tmp_path_factory.mktemp("map") / "fresh.yaml"
    command = [sys.executable, str(PROGRAM), "--out", str(path)]
    subprocess.run(command, check=True, capture_output=True, cwd=path.parent)
    return path


def test_the_map_is_that_of_the_recording(fresh: Path) -> None:
    """Shipped and made anew, cell by cell, and at the same place."""
    with BagReader([SAMPLE]) as reader:
        recorded = read_grid(reader.deserialize(next(iter(reader.messages(("/map",))))))
    for path in (BAGS / "sample_office_map.yaml", fresh):
        grid = read_map_file(path)
        assert np.array_equal(grid.cells, recorded.cells)
        assert grid.resolution_m == pytest.approx(recorded.resolution_m)
        assert grid.origin.translation_m == pytest.approx(recorded.origin.translation_m)
        assert grid.origin.yaw_rad() == pytest.approx(recorded.origin.yaw_rad())
        assert path.with_suffix(".png").stat().st_size < 10_000
