"""The command of `are` that lets artefacts live for hours, and judges how they move."""

import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import click

from are_ros.cli.options import FILE, Amount, parameter_options, say
from are_ros.cli.status import IMPERFECT


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
    from are_ros.builder.assembly import catalogue_of
    from are_ros.cli.soak_progress import SoakProgress
    from are_ros.experiments.soak import soak as run
    from are_ros.experiments.soak_report import write_soak
    from are_ros.replay.command import effective_parameters
    from are_ros.world.map_file import read_map_file

    parameters = effective_parameters(
        options["parameter_files"], options["assignments"], options["seed"]
    )
    grid = read_map_file(options["map_file"], parameters.frames.map)
    minutes = options["minutes"]
    with closing(SoakProgress(minutes, say)) as progress:
        result = run(
            grid,
            parameters,
            catalogue_of(parameters),
            artefact_minutes=minutes,
            progress=progress.move,
        )
    write_soak(result, grid, options["out"])
    for line in result.table():
        click.echo(line)
    say(f"results in {options['out']}")
    if not result.is_clean:
        sys.exit(IMPERFECT)


COMMANDS = (soak,)
