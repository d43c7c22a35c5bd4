"""Options that several commands of `are` have, and how commands speak."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from are_ros.replay.film_path import ANIMATION, why_no_film

_Command = TypeVar("_Command", bound=Callable[..., Any])
FILE = click.Path(path_type=Path)


class Seconds(click.FloatRange):
    """A length of time in a recording: a number, neither endless nor undefined."""

    def __init__(self) -> None:
        super().__init__(min=0.0, max=1e9)

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the seconds; a range alone lets nan through."""
        seconds = float(super().convert(value, param, ctx))
        if math.isnan(seconds):
            self.fail(f"{value!r} is not a number.", param, ctx)
        return seconds


class Film(click.Path):
    """The file of an animation; a recording that was taken for one is told so."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path, if its name tells of a format that can be written."""
        path = Path(value)
        if reason := why_no_film(path):
            self.fail(f"{reason}; where none is meant, --animate goes last", param, ctx)
        return path


def animate_option(command: _Command) -> _Command:
    """Add --animate, with or without the name of a file."""
    option = click.option(
        "--animate",
        metavar="[FILE]",
        type=Film(),
        is_flag=False,
        flag_value=ANIMATION,
        help=f"Animate it, as .gif, .webp or .mp4; a bare name goes into the folder. [{ANIMATION}]",
    )
    return option(command)


def parameter_options(command: _Command) -> _Command:
    """Add the options that make up the effective parameters."""
    for option in (
        click.option("--seed", type=click.IntRange(min=0), help="Seed of every random draw."),
        click.option(
            "--set",
            "assignments",
            metavar="NAME:=VALUE",
            multiple=True,
            help="Set one parameter, as population.arrival_rate:=0.001. Repeatable.",
        ),
        click.option(
            "--params",
            "parameter_files",
            metavar="FILE",
            type=FILE,
            multiple=True,
            help="A ros__parameters file; later ones win. Repeatable.",
        ),
    ):
        command = option(command)
    return command


def say(sentence: str) -> None:
    """Tell the user something that is no result."""
    click.echo(sentence, err=True)
