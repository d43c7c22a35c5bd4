"""Tests of what `are describe` says."""

import re
from dataclasses import replace
from typing import Any

import pytest

from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.describe.configuration import describe_lines
from are_ros.describe.site import Site
from are_ros.errors import ParameterError
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import GroundPose
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.population.mixture import TruncatedPoissonMixture
from are_ros.population.scenario import Scenario, ScriptedArtefact
from are_ros.replay.command import describe_command


def _row(index: int, class_name: str, *, forever: bool = False) -> CatalogueRow:
    label, size_m = f"{class_name}_{index}", (0.5, 0.5, 1.0)
    return CatalogueRow(
        index, label, class_name, size_m, (0.0, 0.0, 0.0), Shape.WALL, forever=forever
    )


CATALOGUE = Catalogue(tuple(_row(i, "cat" if i < 4 else "dog") for i in range(9)))
SMALL = {"mixture.weights": [0.5, 0.5], "mixture.rates": [1.0, 6.0]}


def _text(
    area_m2: float | None = None,
    catalogue: Catalogue = CATALOGUE,
    *,
    everything: bool = False,
    **values: Any,
) -> str:
    paths = {name.replace("__", "."): value for name, value in values.items()}
    parameters = with_values(Parameters(), {**SMALL, **paths})
    site = None if area_m2 is None else Site(area_m2)
    return "\n".join(describe_lines(parameters, catalogue, site, everything=everything))


def test_arrivals_per_minute_and_expected_population() -> None:
    """On 200 m^2 the defaults mean 6 arrivals a minute, and 6 alive."""
    text = _text(200.0)
    assert "6 artefacts per minute, one every 10 s" in text
    assert "0.03 artefacts per minute, one every 33.3 min" in _text(1.0)
    assert "6 expected, 2 to 10 in nine tenths of the time" in text
    assert "Poisson(6), cut at the bound" in text
    assert "so for lives of any law" in text


def test_a_scenario_is_named_and_may_be_all() -> None:
    """With random: false nobody arrives beside it; a scenario of nobody is not worth a word."""

    def lines(scenario: Scenario | None) -> list[str]:
        return describe_lines(parameters, CATALOGUE, Site(200.0), scenario)

    parameters = with_values(Parameters(), SMALL)
    one = ScriptedArtefact(CATALOGUE.rows[0], GroundPose(0.0, 0.0, 0.0, 0.0), 0)
    beside, alone = lines(Scenario((one,))), lines(Scenario((one,), random=False))
    assert "  scenario       1 artefact, beside random arrivals and the law below" in beside
    assert "  arrivals       6 artefacts per minute, one every 10 s" in beside
    assert "  scenario       1 artefact; it has random: false, so nobody else arrives" in alone
    assert "  arrivals       none" in alone
    assert any("0 expected, 0 to 0" in line for line in alone)
    assert lines(Scenario()) == lines(None)


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
    assert "at most 2 alive (population.max_alive) blocks 72.0 % of the arrivals" in text


def test_constant_rate() -> None:
    """The paper's matrix: geometric below balance, at the bound above it."""
    calm = _text(20.0, population__departures="constant_rate")
    assert "geometric, ratio 0.6" in calm
    assert "1.5 expected" in calm
    assert "until it is drawn, uniformly among those alive: mean 2.5 min" in calm
    crowded = _text(200.0, population__departures="constant_rate")
    assert "6 arrive for one that leaves, so the bound is reached" in crowded


def test_groups() -> None:
    """Groups multiply who comes, and the expected population."""
    text = _text(200.0, population__group_size=2.0)
    assert "6 groups of 2 on average" in text
    assert "12 expected" in text
    assert "of groups, wider than Poisson: deviation 4.58, mean 12" in text
    assert "groups  all within 2 m of the first" in text
    constant = _text(20.0, population__group_size=2.0, population__departures="constant_rate")
    assert "of groups, wider than geometric; 1.2 arrive for one that leaves, so" in constant


def test_no_arrivals() -> None:
    """A rate of 0 is described without a division by it."""
    text = _text(population__arrival_rate=0.0)
    assert "arrivals       none" in text
    assert "0 expected, 0 to 0" in text


def test_rows_that_live_for_ever() -> None:
    """Rows that never leave are said to accumulate."""
    catalogue = Catalogue(tuple(_row(i, "wall", forever=i == 0) for i in range(9)))
    text = _text(catalogue=catalogue, mixture__rates=[1.0, 1.0])
    assert "36.8 % of arrivals never leave: 66.2 more per hour, beside the law above" in text
    assert "the bound in about 3.02 h" in text
    assert "Poisson(1.9)" in text
    assert "never leave" not in _text()


def test_class_probabilities_sum_to_one() -> None:
    """The classes are listed from the likeliest on, and sum to 100 %."""
    lines = _text().split("\n")
    first = lines.index("Classes, of 9 rows in the catalogue") + 2
    shares = [float(line.split()[1]) for line in lines[first : first + 2]]
    assert sum(shares) == pytest.approx(100.0, abs=0.11)
    assert shares == sorted(shares, reverse=True)


def test_a_class_is_summed_up_in_a_line() -> None:
    """Its rows by their numbers, from the shortest to the longest, and the likeliest by name."""
    kinds = ["cat", "cat", "cat", "dog", "bird", "bird"]
    rows = [_row(i, kind) for i, kind in enumerate(kinds)]
    rows[1] = replace(rows[1], size_m=(0.75, 0.5, 1.0))
    text = _text(catalogue=Catalogue(tuple(rows)), mixture__rates=[1.0, 1.0])
    share = 100.0 * TruncatedPoissonMixture((0.5, 0.5), (1.0, 1.0), 6).probabilities()
    cats, dog = f"{share[:3].sum():.1f}", f"{share[3]:.1f}"
    assert re.search(rf"cat +{cats} % +0 to 2 +0\.50 to 0\.75 +0 +cat_0 \(", text)
    assert re.search(rf"dog +{dog} % +3 +0\.50 +0 +dog_3 \({dog} %\)", text)
    assert re.search(r"bird +\d+\.\d % +4 to 5 +0\.50 +0 +bird_4 \(", text)


def test_the_whole_catalogue_is_listed_where_it_is_asked_for() -> None:
    """Each row with its class and its size; else it is said how to get at them."""
    text, short = _text(everything=True), _text()
    assert "Catalogue (9 rows)" in text
    assert all(row.label in text for row in CATALOGUE.rows)
    assert "--all" in short
    assert "--all" not in text
    assert not all(row.label in short for row in CATALOGUE.rows)


def test_the_shipped_catalogue_fits_on_a_screen() -> None:
    """With all that it takes to know what will happen; everything is some fifty lines more."""
    catalogue = read_catalogue()
    lines = describe_lines(Parameters(), catalogue)
    text = "\n".join(lines)
    assert len(lines) <= 55
    for words in ("3 artefacts per minute", "expected", "weight pi", "42 rows", "walking 22.0 %"):
        assert words in text
    assert len(describe_lines(Parameters(), catalogue, everything=True)) > len(lines) + 42


def test_a_catalogue_of_one_row_has_one_row() -> None:
    """Not `the 1 rows`: in a table's title, and in a refusal."""
    alone = Catalogue((_row(0, "cat"),))
    assert "Classes, of 1 row in the catalogue" in _text(catalogue=alone, mixture__rates=[0.1, 0.2])
    with pytest.raises(ParameterError, match="the 1 row of the catalogue"):
        _text(catalogue=alone, mixture__rates=[9.0, 9.0])


def test_behaviours_of_classes_and_of_rows_that_differ() -> None:
    """Each class has its behaviours, weighted by its rows; rows are told where they differ."""
    calm, lively = {"standing": 1.0}, {"standing": 0.25, "walking": 0.75}
    rows = [replace(row, behaviours=lively if row.index == 1 else calm) for row in CATALOGUE.rows]
    kinds = Catalogue(tuple(rows))
    text = _text(catalogue=kinds, everything=True, mixture__rates=[1.0, 1.0])
    share = TruncatedPoissonMixture((0.5, 0.5), (1.0, 1.0), 9).probabilities()
    of_cats = 75.0 * share[1] / share[:4].sum()
    assert f"standing {100.0 - of_cats:.1f} %, walking {of_cats:.1f} %" in text
    assert re.search(r"row 1 +36\.\d %  walking 75\.0 %, standing 25\.0 %", text)
    assert re.search(r"rows 2 to 3 +\d+\.\d %  standing 100\.0 %", text)
    assert re.search(r"dog +\d+\.\d %  standing 100\.0 %", text)
    assert "rows 4 to 8" not in text
    assert "rows 2 to 3" not in _text(catalogue=kinds, mixture__rates=[1.0, 1.0])


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({}, "anywhere in the region where there is room"),
        ({}, "they vanish where they are"),
        ({"population__appear": "out_of_view"}, "where no camera of the robot sees them"),
        ({"population__appear": "zones"}, "in the entrances that population.zones lists"),
        (
            {"population__leave": "walk_to_exit", "population__exit_patience": 30.0},
            "those who can walk to an exit vanish there, after at most 30 s",
        ),
        ({"population__leave": "walk_to_exit"}, "the law above with the way out added to the life"),
        (
            {"population__leave": "walk_to_exit", "population__departures": "constant_rate"},
            "more than the law above, by arrivals times way out",
        ),
    ],
)
def test_coming_and_going(values: dict[str, Any], expected: str) -> None:
    """Where artefacts appear, how they leave, and what walking out adds to the law."""
    assert expected in _text(**values)


def test_how_long_a_run_takes_to_fill_is_said() -> None:
    """Three mean lives, as runs begin empty and `alive` is of those that have gone on for long."""
    assert "a run begins empty: fewer in its first 6 min" in _text(100.0, population__mean_life=120)
    assert "a run begins empty" not in _text(100.0, population__arrival_rate=0.0)
    assert "a run begins with as many" in _text(100.0, population__initial="stationary")


def test_nothing_is_wider_than_a_page() -> None:
    """However long the words, no line is longer than 120 characters."""
    for values in (
        {"population__group_size": 3.5, "population__departures": "constant_rate"},
        {"population__group_size": 3.5, "population__max_alive": 7},
        {"population__leave": "walk_to_exit", "population__arrival_rate": 0.123},
    ):
        text = _text(123.456, **values)
        assert max(len(line) for line in text.splitlines()) <= 120


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


def test_a_detector_is_described_where_there_is_one() -> None:
    """Without certainty there is no word of it."""
    assert "detector" not in _text(everything=False)
    text = _text(certainty__enabled=True, certainty__false_alarm_rate=0.5)
    assert "detects 97 % at best, half of that at 15 m; 30 false alarms a minute" in text


@pytest.mark.parametrize(
    ("assignment", "reason"),
    [
        ("robot.footprint:=abc", "robot.footprint: 'abc'"),
        ("frames.static:=[1 2]", "form X Y Z YAW"),
    ],
)
def test_what_is_not_described_is_refused_all_the_same(assignment: str, reason: str) -> None:
    """Robot and frames say nothing about the population, but the file that has them is checked."""
    with pytest.raises(ParameterError, match=reason):
        describe_command(print, None, (), (assignment,), None)
