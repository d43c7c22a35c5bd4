"""Tests of population.png: it is drawn for every law, and the same again for the same input."""

import errno
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from are_ros.describe import population_trial
from are_ros.describe.population_trial import Trial, run_trial
from are_ros.describe.site import Site, surveyed
from are_ros.draw.plots import appeared_text, draw_trial
from are_ros.errors import InputError, ParameterError
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.replay.command import describe_command
from are_ros.replay.pictures import POPULATION, plot_population
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

MIXTURE = {"mixture.weights": [1.0], "mixture.rates": [1.0], "population.mean_life": 10.0}


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(population_trial, "MOST_MEMBERS", 400)


def _catalogue() -> Catalogue:
    def row(index: int) -> CatalogueRow:
        size_m, class_name = (0.3, 0.3, 1.0), "cat" if index < 2 else "dog"
        return CatalogueRow(
            index, f"{class_name} {index}", class_name, size_m, (0.0, 0.0, 0.0), Shape.WALL
        )

    return Catalogue(tuple(row(index) for index in range(4)))


def _on_a_map(parameters: Parameters) -> Site:
    cells = np.zeros((20, 60), np.int8)
    cells[:, 30] = cells[3] = 100
    origin = RigidTransform.from_xyz_ypr(3.0, -2.0, 0.0, 0.7, 0.0, 0.0)
    return surveyed(OccupancyGrid(cells, 0.2, origin, "map"), parameters, _catalogue())


def _figure(trial: Trial, parameters: Parameters, site: Site) -> Figure:
    figure = Figure(figsize=(16.0, 9.0))
    draw_trial(figure, trial, parameters, _catalogue(), site)
    return figure


def _in_the_open(_: Parameters) -> Site:
    return Site()


@pytest.mark.parametrize(
    ("site_of", "values"),
    [
        (_in_the_open, {"population.group_size": 3.0, "population.max_alive": 5}),
        (_in_the_open, {"population.departures": "constant_rate", "population.max_alive": 1}),
        (_in_the_open, {"population.mean_life": 1e7, "population.max_alive": 100_000}),
        (
            _on_a_map,
            {"population.departures": "constant_rate", "population.arrival_rate": 0.0008},
        ),
    ],
)
def test_every_law_has_its_picture(
    site_of: Callable[[Parameters], Site], values: dict[str, float | str], tmp_path: Path
) -> None:
    """The picture is written into a new folder, with a map and without, and is no empty sheet."""
    parameters = with_values(Parameters(), {**MIXTURE, **values})
    folder = tmp_path / "new" / "folder"
    path = plot_population(parameters, _catalogue(), site_of(parameters), folder)
    image = cv2.imread(str(path))
    assert path == folder / POPULATION
    assert image is not None
    assert image.std() > 20.0


def test_every_axis_says_what_it_is() -> None:
    """Times with their unit, and so densities; only the axis shared with N(t) is bare."""
    parameters = with_values(Parameters(), MIXTURE)
    trial = run_trial(parameters, _catalogue(), Site())
    path, shares, _, waits, lives, rows, *_ = _figure(trial, parameters, Site()).axes
    assert (path.get_xlabel()[:6], path.get_ylabel()) == ("time [", "alive")
    assert shares.get_xlabel() == "share"
    assert (rows.get_xlabel(), rows.get_ylabel()) == ("row", "share")
    for axes in (waits, lives):
        unit = axes.get_xlabel().removeprefix("time ")
        assert unit[0] == "["
        assert axes.get_ylabel() == f"density [1/{unit[1:]}"


@pytest.mark.parametrize("count", [2, 7, 12])
def test_the_names_of_the_classes_are_on_no_bar(count: int) -> None:
    """However few rows there are, and so however wide their bars."""
    rows = tuple(
        CatalogueRow(k, f"row {k}", f"structure {k}", (0.3, 0.3, 1.0), (0.0, 0.0, 0.0), Shape.WALL)
        for k in range(count)
    )
    catalogue = Catalogue(rows)
    parameters = with_values(Parameters(), {**MIXTURE, "mixture.rates": [0.5]})
    figure = Figure(figsize=(16.0, 9.0))
    draw_trial(figure, run_trial(parameters, catalogue, Site()), parameters, catalogue, Site())
    figure.canvas.draw()
    axes = figure.axes[5]
    named, (text,) = axes.get_legend(), axes.texts
    assert named is not None
    legend = named.get_window_extent()
    assert not legend.overlaps(text.get_window_extent())
    assert legend.x0 >= axes.bbox.x0 - 2.0
    for bar in axes.patches:
        assert bar.get_window_extent().y1 <= legend.y0


def test_means_are_those_of_what_is_counted_beside_them() -> None:
    """Waits as lives: so many, with their own mean, not the law's."""
    parameters = with_values(Parameters(), MIXTURE)
    trial = run_trial(parameters, _catalogue(), Site())
    *_, waits, lives, _ = _figure(trial, parameters, Site()).axes[:6]
    for axes, sample_s, noun in ((waits, trial.waits_s, "arrivals"), (lives, trial.lives_s, "l")):
        (text,) = (one.get_text() for one in axes.texts)
        unit_s = 60.0 if "[min]" in axes.get_xlabel() else 1.0
        assert text.startswith(f"{len(sample_s)} {noun}")
        assert f"mean {sample_s.mean() / unit_s:.3g} " in text


def test_the_same_input_gives_the_same_bytes(tmp_path: Path) -> None:
    """Settings of matplotlib in force change nothing."""
    parameters = with_values(Parameters(), MIXTURE)
    site = _on_a_map(parameters)
    one = plot_population(parameters, _catalogue(), site, tmp_path / "one")
    with mpl.rc_context({"lines.linewidth": 9.0, "font.size": 30.0}):
        two = plot_population(parameters, _catalogue(), site, tmp_path / "two")
    assert one.read_bytes() == two.read_bytes()


def test_it_says_who_did_not_appear_and_why() -> None:
    """The counts in the second line account for all arrivals."""
    absent = {"found no place": 1, "fit nowhere": 2, "met a full population": 3}
    trial: Any = SimpleNamespace(rows=range(10), appeared=4, absent=absent)
    said = "4 of 10 arrivals appeared: 1 found no place, 2 fit nowhere, 3 met a full population"
    assert appeared_text(trial) == said
    whole: Any = SimpleNamespace(rows=range(10), appeared=10, absent={})
    assert appeared_text(whole) == "all 10 arrivals appeared"


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    """A file in the folder's place is refused in a sentence."""
    (tmp_path / "taken").write_text("")
    parameters = with_values(Parameters(), MIXTURE)
    reason = r"--plot .*taken.*population\.png cannot be written \(it is a file\)"
    with pytest.raises(InputError, match=reason):
        plot_population(parameters, _catalogue(), Site(), tmp_path / "taken")


def test_a_picture_that_cannot_be_written_leaves_no_empty_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a full disk."""

    def fail(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("are_ros.replay.pictures.draw_population", fail)
    with pytest.raises(InputError, match=r"cannot be written \(no space left on device\)"):
        plot_population(
            with_values(Parameters(), MIXTURE), _catalogue(), Site(), tmp_path / "a" / "b"
        )
    assert not (tmp_path / "a").exists()


def test_a_png_is_a_file(tmp_path: Path) -> None:
    """A name that ends in .png is the picture's own, unless a folder has it already."""
    parameters = with_values(Parameters(), MIXTURE)
    path = tmp_path / "new" / "mine.png"
    assert plot_population(parameters, _catalogue(), Site(), path) == path
    assert cv2.imread(str(path)) is not None
    (tmp_path / "folder.png").mkdir()
    inside = plot_population(parameters, _catalogue(), Site(), tmp_path / "folder.png")
    assert inside == tmp_path / "folder.png" / POPULATION


def test_describe_says_where_the_picture_is(tmp_path: Path) -> None:
    """`are describe --plot` describes and draws; without it nothing is drawn."""
    said: list[str] = []
    describe_command(said.append, None, (), (), 3, tmp_path / "plots")
    assert said[-1] == f"\npicture: {tmp_path / 'plots' / POPULATION}"
    said.clear()
    describe_command(said.append, None, (), (), 3)
    assert not any("picture" in line for line in said)


def test_arrivals_that_a_scenario_forbids_are_not_drawn(tmp_path: Path) -> None:
    """The description beside the picture has none, either."""
    path, said = tmp_path / "scenario.yaml", list[str]()
    path.write_text("scenario: {random: false}\nartefacts: []\n")
    wanted = [f"population.scenario:={path}"]
    with pytest.raises(ParameterError, match="has random: false: no random arrival is there"):
        describe_command(said.append, None, (), wanted, 3, tmp_path / "plots")
    assert "  arrivals       none" in said
    assert not (tmp_path / "plots").exists()
