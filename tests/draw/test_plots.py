"""Plots: how far the axes of fit.png go, and what is written on axes."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from are_ros.draw.decisions import name_map
from are_ros.draw.plots import bic_ticks, climb_length, plain, write_head, written_figure


def test_a_map_has_its_unit() -> None:
    """What stands at its ticks are metres."""
    axes = Figure().add_subplot()
    name_map(axes, "ways")
    assert axes.get_xlabel() == "[m]"


@pytest.mark.parametrize("name", ["a$b_$c", "$", "$$", r"5 \$", "under_score ^ {"])
def test_names_with_signs_of_formulas_are_written_as_they_are(tmp_path: Path, name: str) -> None:
    """As that of a file: it was a traceback, after the fit."""
    text: Any = Text()
    assert text._preprocess_math(plain(name)) == (name, False)
    with written_figure(tmp_path / "a.png", (4.0, 2.0)) as figure:
        write_head(figure, 0.5, name, [name, "", name])
    assert (tmp_path / "a.png").is_file()


@pytest.mark.parametrize(
    ("climbing", "flat", "shown"), [(6, 9, 8), (6, 1, 7), (0, 5, 2), (1, 0, 1), (200, 90, 220)]
)
def test_a_climb_is_shown_to_where_it_has_converged(climbing: int, flat: int, shown: int) -> None:
    """All that gained something, and a few points of the rest, if there are any."""
    below = np.concatenate((np.geomspace(1.0, 1e-11, climbing), np.full(flat, 1e-12)))
    assert climb_length(below) == shown


def test_a_rest_after_which_it_goes_on_is_no_end() -> None:
    """Only what is flat up to the end is cut."""
    assert climb_length(np.array([1.0, 1e-12, 1e-12, 1e-12, 1e-6, 1e-12, 1e-12, 1e-12])) == 7


@pytest.mark.parametrize("most", [10.1, 13.5, 39.1, 99.0, 720.0, 5e3, 3e4, 2e6])
def test_the_ticks_of_bic_are_readable(most: float) -> None:
    """From three to seven whole numbers from 0 on, the last not far below the end."""
    ticks = bic_ticks(most)
    assert ticks[0] == 0
    assert 3 <= len(ticks) <= 7
    assert all(low < high for low, high in pairwise(ticks))
    assert 0.1 * most <= ticks[-1] <= most
