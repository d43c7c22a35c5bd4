"""Options that several commands of `are` have, and how commands speak."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

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
