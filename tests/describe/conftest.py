"""A small map and a small catalogue for the tests of descriptions."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform


def _row(index: int, class_name: str, side_m: float) -> CatalogueRow:
    size_m = (side_m, side_m, 1.0)
    label = f"{class_name}_{index}"
    return CatalogueRow(index, label, class_name, size_m, (0.0, 0.0, 0.0), Shape.WALL)


@pytest.fixture
def catalogue() -> Catalogue:
    """Three rows of two classes, the last 5 m wide."""
    return Catalogue((_row(0, "cat", 0.3), _row(1, "cat", 0.4), _row(2, "van", 5.0)))


@pytest.fixture
def grid_of() -> Callable[[str], OccupancyGrid]:
    """Return what makes a grid of 0.5 m cells: `.` free, `#` occupied, a blank unknown."""

    def made(text: str) -> OccupancyGrid:
        values = {".": 0, "#": 100, " ": -1}
        lines = [line for line in text.splitlines() if line]
        cells = np.array([[values[c] for c in line] for line in reversed(lines)], np.int8)
        return OccupancyGrid(cells, 0.5, RigidTransform.identity(), "map")

    return made


@pytest.fixture
def parameters_of() -> Callable[..., Parameters]:
    """Return what makes parameters of `section__name=value`, with a mixture for three rows."""

    def made(**values: Any) -> Parameters:
        mixture = {"mixture.weights": [0.5, 0.5], "mixture.rates": [0.5, 1.5]}
        given = {name.replace("__", "."): value for name, value in values.items()}
        return with_values(Parameters(), {**mixture, **given})

    return made
