"""`are soak`: a long simulation whose motion is judged."""

import sys
from pathlib import Path
from typing import Any, Final, NoReturn

import click

from are_ros.cli.options import FILE, IMPERFECT, Amount, parameter_options, say

_LAYOUT: Final = "soak {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} min [{elapsed}<{remaining}]"
_LOGGED_EVERY_S: Final = 60.0
"""Where stderr is no terminal (a file, CI), the bar is written this seldom."""


@click.command(short_help="Let artefacts live for hours, and judge how they move.")
@click.option("--map", "map_file", metavar="FILE.yaml", type=FILE, required=True, help="The map.")
@click.option(
    "--minutes",
    type=Amount("minutes"),
    default=100.0,
    show_default=True,
    help="Artefact-minutes to judge, all lives together.",
)
@click.option(
    "--out", type=FILE, default=Path("soak"), show_default=True, help="Folder of the results."
)
@parameter_options
def soak(**options: Any) -> None:
    """Let artefacts live on a map, beside a robot that drives about, and judge each sub-step.

    A program of its own looks for overlaps, broken limits of motion, stands without a cause and
    deadlocks. It prints the verdict; the output folder gets soak.json and soak.png, a picture of
    all ways. The exit status is 3 if anything was found that must not be.
    """
    from tqdm import tqdm

    from are_ros.builder.assembly import catalogue_of
    from are_ros.lab.soak import soak as run
    from are_ros.lab.soak_picture import write_soak
    from are_ros.replay.command import effective_parameters
    from are_ros.world.map_io import read_map_file

    parameters = effective_parameters(
        options["parameter_files"], options["assignments"], options["seed"]
    )
    grid = read_map_file(options["map_file"], parameters.frames.map)
    minutes = options["minutes"]
    interval_s = 0.1 if sys.stderr.isatty() else _LOGGED_EVERY_S
    bar: tqdm[NoReturn] = tqdm(total=minutes, bar_format=_LAYOUT, mininterval=interval_s, delay=1.0)

    def move(done_min: float) -> None:
        bar.update(min(done_min, minutes) - bar.n)

    with bar:
        result = run(
            grid, parameters, catalogue_of(parameters), artefact_minutes=minutes, progress=move
        )
    write_soak(result, grid, options["out"])
    for line in result.table():
        click.echo(line)
    say(f"results in {options['out']}")
    if not result.is_clean:
        sys.exit(IMPERFECT)


COMMANDS = (soak,)
