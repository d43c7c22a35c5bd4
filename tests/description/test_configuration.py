"""Tests of what `are describe` says."""

from typing import Any

import pytest

from are_ros.artefacts.catalogue import Catalogue, CatalogueRow
from are_ros.artefacts.shapes import Shape
from are_ros.description.configuration import describe_lines
from are_ros.errors import ParameterError
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters


def _row(index: int, class_name: str, *, forever: bool = False) -> CatalogueRow:
    label, size_m = f"{class_name}_{index}", (0.5, 0.5, 1.0)
    return CatalogueRow(
        index, label, class_name, size_m, (0.0, 0.0, 0.0), Shape.WALL, forever=forever
    )


CATALOGUE = Catalogue(tuple(_row(i, "cat" if i < 4 else "dog") for i in range(9)))
SMALL = {"mixture.weights": [0.5, 0.5], "mixture.rates": [1.0, 6.0]}


def _text(area_m2: float | None = None, catalogue: Catalogue = CATALOGUE, **values: Any) -> str:
    paths = {name.replace("__", "."): value for name, value in values.items()}
    parameters = with_values(Parameters(), {**SMALL, **paths})
    return "\n".join(describe_lines(parameters, catalogue, area_m2))


def test_arrivals_per_minute_and_expected_population() -> None:
    """On 200 m^2 the defaults mean 6 arrivals a minute, and 6 alive."""
    text = _text(200.0)
    assert "6 artefacts per minute, one every 10 s" in text
    assert "6 expected, 2 to 10 in nine tenths of the time" in text
    assert "unbounded: Poisson(6)" in text


def test_without_a_map_it_is_for_100_square_metres() -> None:
    """Without an area the figures are for 100 m^2, and say so."""
    text = _text()
    assert "on 100 m^2 (no map is given)" in text
    assert "3 artefacts per minute" in text


def test_bound_truncates_the_population() -> None:
    """A low bound lowers the expected population, and is said to be reached."""
    text = _text(200.0, population__max_alive=2)
    assert "1.68 expected" in text
    assert "at the bound 72.0 %" in text


def test_constant_rate() -> None:
    """The paper's matrix: geometric below balance, at the bound above it."""
    calm = _text(20.0, population__departures="constant_rate")
    assert "geometric, ratio 0.6" in calm
    assert "1.5 expected" in calm
    crowded = _text(200.0, population__departures="constant_rate")
    assert "6 arrive for one that leaves, so the bound is reached" in crowded


def test_groups() -> None:
    """Groups multiply who comes, and the expected population."""
    text = _text(200.0, population__group_size=2.0)
    assert "6 groups of 2 on average" in text
    assert "12 expected" in text


def test_no_arrivals() -> None:
    """A rate of 0 is described without a division by it."""
    text = _text(population__arrival_rate=0.0)
    assert "arrivals       none" in text
    assert "0 expected, 0 to 0" in text


def test_rows_that_live_for_ever() -> None:
    """Rows that never leave are said to accumulate."""
    catalogue = Catalogue(tuple(_row(i, "wall", forever=i == 0) for i in range(9)))
    assert "of arrivals never leave" in _text(catalogue=catalogue)
    assert "never leave" not in _text()


def test_class_probabilities_sum_to_one() -> None:
    """The classes are listed from the likeliest on, and sum to 100 %."""
    lines = _text().split("\n")
    first = lines.index("Classes") + 1
    shares = [float(line.split()[1]) for line in lines[first : first + 2]]
    assert sum(shares) == pytest.approx(100.0, abs=0.11)
    assert shares == sorted(shares, reverse=True)


def test_catalogue_is_listed() -> None:
    """Each row is listed with its class and its size."""
    text = _text()
    assert "Catalogue (9 rows)" in text
    assert all(row.label in text for row in CATALOGUE.rows)


def test_changed_parameters_with_their_units() -> None:
    """What differs from the defaults is listed, with unit and default."""
    lines = _text(population__mean_life=5.0).split("\n")
    changed = lines[lines.index("Parameters that differ from their defaults") :]
    assert any("population.mean_life" in line and "5 s" in line for line in changed)
    assert any("mixture.rates" in line and "[1, 6]" in line for line in changed)
    assert not any("seed" in line for line in changed)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({}, "that of CameraInfo (raw); where there is none: pinhole, 640 x 480 px, 90 degrees"),
        ({"camera__model": "pinhole", "camera__frame": "eye"}, "90 degrees wide, in eye"),
        ({"camera__model": "omnidirectional"}, "omnidirectional, 640 x 480 px, 90 degrees high"),
        ({"costmap__gate": "all"}, "all artefacts, inflated by 0.7 m"),
        ({"costmap__memory": 3.0}, "while perceived and for 3 s after"),
        ({"occlusion__mutual": False}, "walls only (mesh)"),
        ({"sensors__gate": "perceived"}, "scan; only perceived artefacts, as mesh"),
        ({"sensors__scans": []}, "none; whatever"),
    ],
)
def test_perception_and_outputs(values: dict[str, Any], expected: str) -> None:
    """Camera, gates and sensors are said in a line each."""
    assert expected in _text(**values)


def test_mixture_that_does_not_fit() -> None:
    """A mixture beyond the catalogue is refused as the builder refuses it."""
    with pytest.raises(ParameterError, match="at least half"):
        _text(mixture__rates=[1.0, 900.0])
