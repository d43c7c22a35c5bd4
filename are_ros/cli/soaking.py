"""The command of `are` that lets artefacts live for hours, and judges how they move."""

import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import click

from are_ros.cli.options import FILE, IMPERFECT, Amount, parameter_options, say


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
    from are_ros.lab.soak import soak as run
    from are_ros.lab.soak_picture import write_soak
    from are_ros.replay.command import effective_parameters
    from are_ros.world.map_io import read_map_file

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


# How far a soak has come: a bar on a terminal, a line a minute in a log.


_LAYOUT = "soak {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} min [{elapsed}<{remaining}]"
_EVERY_S = 60.0


class SoakProgress:
    """Shows on stderr how many artefact-minutes are done; close it at the end.

    On a terminal as a bar. Elsewhere (a file, CI) in a line after each minute of the wall clock,
    with an estimate of what is left; a soak that is shorter says nothing.
    """

    def __init__(
        self,
        total_min: float,
        say: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._total_min = total_min
        self._say, self._clock = say, clock
        self._began_s = self._said_s = clock()
        self._bar: Any = None
        if sys.stderr.isatty():
            from tqdm import tqdm

            self._bar = tqdm(total=total_min, bar_format=_LAYOUT)

    def close(self) -> None:
        """End the bar, so that later output begins on a new line."""
        if self._bar is not None:
            self._bar.close()

    def move(self, done_min: float) -> None:
        """Take the artefact-minutes that are done."""
        done_min = min(done_min, self._total_min)
        if self._bar is not None:
            self._bar.update(done_min - self._bar.n)
            return
        now_s = self._clock()
        if now_s - self._said_s >= _EVERY_S and done_min < self._total_min:
            self._said_s = now_s
            self._say(self._sentence(done_min, now_s - self._began_s))

    def _sentence(self, done_min: float, passed_s: float) -> str:
        done = f"soak: {done_min:.0f} of {self._total_min:.0f} artefact-minutes"
        if done_min <= 0.0:
            return f"{done} after {passed_s / 60.0:.0f} min: nobody lives yet"
        left_min = passed_s / 60.0 * (self._total_min / done_min - 1.0)
        left = "less than a minute" if left_min < 1.0 else f"about {left_min:.0f} min"
        return f"{done} after {passed_s / 60.0:.0f} min, {left} to go"
