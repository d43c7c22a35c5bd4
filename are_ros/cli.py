"""`are`: the command line, a thin shell over replay, inspection, checks and description.

Exit status: 0 all well; 1 an error, said in a sentence; 2 wrong usage; 3 finished, but some input
was refused, or a check failed; 130 interrupted.
"""

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import click

from are_ros._version import __version__
from are_ros.errors import AreError

FAILED, IMPERFECT, INTERRUPTED = 1, 3, 130

_Command = TypeVar("_Command", bound=Callable[..., Any])
_FILE = click.Path(path_type=Path)
_SKIPPABLE = ("perception", "grids", "markers")


class _Seconds(click.FloatRange):
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


@click.group(
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.pass_context
@click.version_option(__version__, prog_name="are")
def are(context: click.Context) -> None:
    """ARE: an Augmented Reality Environment for mobile robots.

    Virtual people, cars and pallets in a real robot's place; what its camera could see of
    them reaches its navigation stack.
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def _parameter_options(command: _Command) -> _Command:
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
            type=_FILE,
            multiple=True,
            help="A ros__parameters file; later ones win. Repeatable.",
        ),
    ):
        command = option(command)
    return command


@are.command(short_help="Replay a recording with artefacts in it.")
@click.argument("bags", metavar="BAG...", nargs=-1, required=True, type=_FILE)
@click.option("--map", "map_file", metavar="FILE.yaml", type=_FILE, help="Map of map_server.")
@click.option("--map-frame", metavar="NAME", help="Frame of the map, the world frame. [map]")
@click.option("--octomap", "octomap_file", metavar="FILE.bt", type=_FILE, help="OctoMap file.")
@click.option(
    "--static-tf",
    "static_transforms",
    metavar="TF",
    multiple=True,
    help='"X Y Z YAW PITCH ROLL PARENT CHILD", metres and radians. Repeatable.',
)
@click.option(
    "--topic",
    "topics",
    metavar="ROLE:=/TOPIC",
    multiple=True,
    help="Let a topic play a part: map, octomap_point_cloud_centers, odom, scan, "
    "camera/camera_info, tf, tf_static. Repeatable.",
)
@click.option("--start", "start_s", type=_Seconds(), default=0.0, help="Begin here [s].")
@click.option("--duration", "duration_s", type=_Seconds(), help="Length to replay [s].")
@click.option("--out", type=_FILE, default=Path("out"), show_default=True, help="Output folder.")
@click.option("--with-inputs", is_flag=True, help="Write the inputs beside the outputs.")
@click.option(
    "--skip",
    type=click.Choice(_SKIPPABLE),
    multiple=True,
    help="Leave out a part that nobody needs. Repeatable.",
)
@_parameter_options
def replay(**options: Any) -> None:
    """Replay a recording as fast as it goes, with artefacts in it.

    BAG is a rosbag2 folder, an .mcap or .db3 file, or ROS 1 .bag files. The output folder gets
    augmented.mcap (the topics that the live node publishes), overview.png, metrics.json,
    timing.json and effective.yaml. The same recording, parameters and seed give the same bytes.
    """
    from are_ros.replay.command import replay_command

    if not replay_command(_say, **options):
        sys.exit(IMPERFECT)


@are.command(short_help="Say what a recording holds, and what it lacks.")
@click.argument("bags", metavar="BAG...", nargs=-1, required=True, type=_FILE)
@click.option("--topic", "topics", metavar="ROLE:=/TOPIC", multiple=True, help="As in replay.")
@click.option("--map", "map_file", metavar="FILE.yaml", type=_FILE, help="As in replay.")
@click.option("--map-frame", metavar="NAME", default="map", show_default=True, help="As in replay.")
@click.option("--static-tf", "static_transforms", metavar="TF", multiple=True, help="As in replay.")
def inspect(**options: Any) -> None:
    """Say what a recording holds: topics, the roles that they play, how its frames hang together.

    What a replay would lack is said with the option that supplies it.
    """
    from are_ros.replay.command import inspect_command

    inspect_command(click.echo, **options)


@are.command(short_help="Say what a configuration means.")
@click.option("--map", "map_file", metavar="FILE.yaml", type=_FILE, help="Map, for its free area.")
@_parameter_options
def describe(**options: Any) -> None:
    """Say what a configuration means: arrivals per minute, expected population, types, gates."""
    from are_ros.replay.command import describe_command

    describe_command(click.echo, **options)


@are.command(short_help="Check a replay's output against the invariants.")
@click.argument("folder", metavar="OUT", type=_FILE)
@click.option("--map", "map_file", metavar="FILE.yaml", type=_FILE, help="The real map.")
def check(folder: Path, map_file: Path | None) -> None:
    """Check the output folder of a replay, by a program of its own.

    It reads only the written recording and the map; what cannot be checked is said. Replays with
    --with-inputs can be checked further.
    """
    from are_ros.replay.command import check_command

    if not check_command(click.echo, folder, map_file):
        sys.exit(IMPERFECT)


def main() -> None:
    """Run `are`; an error is one sentence, with exit status 1, or 2 for wrong usage."""
    try:
        sys.exit(are(standalone_mode=False))
    except AreError as error:
        _fail(str(error), FAILED)
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx else "are"
        _fail(f"{error.format_message().rstrip('.')} (see `{command} --help`)", error.exit_code)
    except (KeyboardInterrupt, click.Abort):
        _fail("interrupted", INTERRUPTED)


def _fail(sentence: str, status: int) -> NoReturn:
    click.secho(f"are: {sentence}", err=True, fg="red")
    sys.exit(status)


def _say(sentence: str) -> None:
    click.echo(sentence, err=True)
