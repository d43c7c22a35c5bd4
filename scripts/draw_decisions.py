"""Draws the pictures of docs/decisions.md: `python scripts/draw_decisions.py [--out docs/images]`.

What the type person_adult would do on the map of the sample office: its values as life runs down,
its behaviours at several temperatures, and what slipping changes.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.describe.decisions import (
    JourneyValues,
    Lives,
    journey_of,
    row_named,
    simulate_lives,
)
from are_ros.describe.site import surveyed
from are_ros.draw.decisions import (
    draw_scale,
    draw_shares,
    draw_signs,
    draw_values,
    draw_ways,
    map_axes,
    name_map,
    value_range,
)
from are_ros.draw.map import known_part, map_image, window_of
from are_ros.draw.plots import name_axes, written_figure
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.world.map_io import read_map_file

PROJECT = Path(__file__).resolve().parents[1]
MAP = PROJECT / "bags" / "sample_office_map.yaml"
WIDTH_IN = 8.6
TOP_IN, TITLE_IN, FOOT_IN, LEFT_IN, GAP_IN = 0.35, 0.3, 0.35, 0.4, 0.4
TEMPERATURES = {"T = 0.01": 0.01, "T = 0.025": 0.025, "T = 0.25": 0.25, "T infinite": 1e9}
SLIPS = {"slip 0": 0.0, "slip 0.3": 0.3}


class Study:
    """A type on a map, under several settings."""

    def __init__(self, label: str) -> None:
        self._catalogue = read_catalogue()
        self._row = row_named(self._catalogue, label)
        grid = read_map_file(MAP)
        survey = surveyed(grid, Parameters(), self._catalogue).survey
        if survey is None:
            raise RuntimeError("a map has a survey")
        self._survey, self.grid = survey, grid

    def journey(self, shown_s: Sequence[float], **values: Any) -> JourneyValues:
        """Return the values at some remaining lives."""
        return journey_of(self._row, _with(values).behaviour, self._survey, shown_s)

    def lives(self, **values: Any) -> Lives:
        """Return what becomes of a crowd."""
        return simulate_lives(self._row, self._catalogue, _with(values), self._survey)


def _with(values: Mapping[str, Any]) -> Parameters:
    return with_values(Parameters(), {f"behaviour.{name}": one for name, one in values.items()})


class Maps:
    """A figure of maps in rows of two."""

    def __init__(self, figure: Any, grid: Any, rows: int) -> None:
        self._figure, self._rows = figure, rows
        self._window = window_of(grid, known_part(grid), np.empty((0, 2)))
        self._floor = map_image(grid, self._window, 480.0 / self._window.width_m)

    def axes(self, k: int, title: str) -> Any:
        """Return the axes of the k-th map."""
        row, column = divmod(k, 2)
        width_in, height_in = map_size_in(self._window.width_m / self._window.height_m)
        figure_in = self._figure.get_size_inches()
        left_in = LEFT_IN + column * (width_in + GAP_IN)
        bottom_in = figure_in[1] - TOP_IN - (row + 1) * (TITLE_IN + height_in) - row * FOOT_IN
        place = np.array((left_in, bottom_in, width_in, height_in)) / np.tile(figure_in, 2)
        axes = map_axes(self._figure, tuple(place.tolist()), self._window, self._floor)
        name_map(axes, title)
        return axes

    def scale(self, limits: tuple[float, float]) -> None:
        """Draw the scale of the values."""
        draw_scale(self._figure.add_axes((0.935, 0.12, 0.016, 0.74)), limits)


def map_size_in(shape: float) -> tuple[float, float]:
    """Return width and height of a map of two in a row."""
    width_in = (WIDTH_IN - LEFT_IN - 2.0 * GAP_IN - 0.45) / 2.0
    return width_in, width_in / shape


def figure_size_in(grid: Any, rows: int) -> tuple[float, float]:
    """Return the size of a figure of so many rows of maps."""
    window = window_of(grid, known_part(grid), np.empty((0, 2)))
    _, height_in = map_size_in(window.width_m / window.height_m)
    return WIDTH_IN, TOP_IN + rows * (TITLE_IN + height_in + FOOT_IN)


@contextmanager
def small_figure(path: Path, size_in: tuple[float, float]) -> Iterator[Any]:
    """Give a figure to draw on, and write it as PNG of at most 256 colours."""
    with written_figure(path, size_in) as figure:
        yield figure
    with Image.open(path) as picture:
        picture.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


def draw_horizons(study: Study, path: Path) -> None:
    """Draw the values at four remaining lives."""
    journey = study.journey((3.0, 5.0, 10.0))
    with small_figure(path, figure_size_in(study.grid, 2)) as figure:
        maps, limits = Maps(figure, study.grid, 2), value_range([journey])
        for k, best in enumerate(journey.horizons):
            axes = maps.axes(k, f"{best.left_s:g} s left")
            draw_values(axes, study.grid, journey, best, limits)
        maps.scale(limits)
        draw_signs(figure, runs=True)


def draw_temperatures(study: Study, path: Path) -> None:
    """Draw the shares of the behaviours over a life at several temperatures."""
    with small_figure(path, (WIDTH_IN + 0.8, 6.0)) as figure:
        for k, (title, temperature) in enumerate(TEMPERATURES.items()):
            row, column = divmod(k, 2)
            axes = figure.add_axes((0.055 + 0.5 * column, 0.575 - 0.49 * row, 0.235, 0.375))
            draw_shares(axes, study.lives(temperature=temperature))
            across = "time since the arrival [s]" if row else ""
            name_axes(axes, title, across, "" if column else "share")


def draw_slips(study: Study, path: Path) -> None:
    """Draw the values with ten seconds left, and the ways, without and with slipping."""
    journeys = {title: study.journey((10.0,), slip=slip) for title, slip in SLIPS.items()}
    with small_figure(path, figure_size_in(study.grid, 2)) as figure:
        maps, limits = Maps(figure, study.grid, 2), value_range([*journeys.values()])
        for k, (title, journey) in enumerate(journeys.items()):
            axes = maps.axes(k, f"{title}: values with 10 s left")
            draw_values(axes, study.grid, journey, journey.horizons[0], limits)
            below = maps.axes(2 + k, f"{title}: ways")
            draw_ways(below, study.lives(slip=SLIPS[title]))
        maps.scale(limits)
        draw_signs(figure, runs=True)


def main() -> None:
    """Draw all of them."""
    parser = argparse.ArgumentParser(description="Draw the pictures of docs/decisions.md.")
    parser.add_argument("--out", type=Path, default=PROJECT / "docs" / "images")
    out, study = parser.parse_args().out, Study("person_adult")
    draw_horizons(study, out / "decisions_horizon.png")
    draw_temperatures(study, out / "decisions_temperature.png")
    draw_slips(study, out / "decisions_slip.png")


if __name__ == "__main__":
    main()
