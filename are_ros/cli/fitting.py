"""The command of `are` that fits the mixture of Eq. 1 to observed rows."""

from pathlib import Path
from typing import Any

import click

from are_ros.cli.options import FILE, say

_MOST_ROWS = 10_000
_MOST_COMPONENTS = 32


@click.command(short_help="Fit the Poisson mixture to observed rows.")
@click.argument("source", metavar="INPUT", type=FILE)
@click.option(
    "--rows",
    type=click.IntRange(2, _MOST_ROWS),
    help="Rows that can occur, where there is no catalogue.",
)
@click.option("--catalogue", "catalogue_file", metavar="FILE", type=FILE, help="Its rows occur.")
@click.option(
    "--components",
    type=click.IntRange(1, _MOST_COMPONENTS),
    help="Number n of components. [by BIC]",
)
@click.option(
    "--max-components",
    type=click.IntRange(1, _MOST_COMPONENTS),
    default=8,
    show_default=True,
    help="Most components that BIC may choose.",
)
@click.option(
    "--out", type=FILE, default=Path("fit"), show_default=True, help="Folder of the results."
)
@click.option(
    "--params",
    "parameter_files",
    metavar="FILE",
    type=FILE,
    multiple=True,
    help="A ros__parameters file that names the catalogue. Repeatable.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of the random starts.",
)
def fit(**options: Any) -> None:
    """Find the Poisson mixture (pi, lambda) that makes observed rows of the catalogue most likely.

    INPUT is a .csv or .txt table (one row number per line, or columns named row or label, and
    count), a .json list, or a recording of the node or of a replay, whose random arrivals count,
    those that were blocked too. The output folder gets fitted.yaml, which node and replay take
    with --params, fit.png and fit.json.
    """
    from are_ros.replay.fit_command import FitOptions, fit_command

    if options["rows"] is not None and options["catalogue_file"] is not None:
        raise click.UsageError("--rows is for where there is no --catalogue: give one of them.")
    fit_command(click.echo, say, FitOptions(**options))


