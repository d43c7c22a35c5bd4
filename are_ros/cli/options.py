"""Options that several commands of `are` share, notices, and exit statuses."""

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

import click
from click.types import FloatParamType

from are_ros.replay.output_folder import ANIMATION, why_no_animation

_Command = TypeVar("_Command", bound=Callable[..., Any])
FILE = click.Path(path_type=Path)


class Command(click.Command):
    """A command that takes each option once, but for those that are repeatable."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments; a usage error where an option would silently replace another."""
        _, _, given = self.make_parser(ctx).parse_args(list(args))
        for option in given:
            is_once = isinstance(option, click.Option) and not (option.multiple or option.is_flag)
            if is_once and given.count(option) > 1:
                raise click.UsageError(f"{option.opts[0]} can be given only once", ctx)
        return super().parse_args(ctx, args)


class Amount(FloatParamType):
    """A finite number with bounds; its unit stands in the help."""

    def __init__(self, unit: str, least: float = 0.0, most: float = 1e9) -> None:
        self.name = unit
        self._least, self._most = least, most

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number; a usage error where it is none, too small or too large."""
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if math.isnan(number):
            self.fail(f"{value!r} is not a number", param, ctx)
        if number < self._least:
            self.fail(f"{value} is less than {self._least:g}", param, ctx)
        if number > self._most:
            self.fail(f"{value} is more than {self._most:g}", param, ctx)
        return number


class WholeNumber(click.IntRange):
    """A whole number with bounds; click's own says that 'x' is no "integer range"."""

    name = "integer"


SECONDS: Final = Amount("seconds")
"""A time in a recording, or a length of time."""


class Assignment(click.types.StringParamType):
    """A text NAME:=VALUE, unchanged; a usage error for another form."""

    name = "assignment"

    def __init__(self, form: str, example: str) -> None:
        self._form, self._example = form, example

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the text."""
        text = str(super().convert(value, param, ctx))
        name, separator, _ = text.partition(":=")
        if not (separator and name.strip()):
            self.fail(f"'{text}' must be {self._form}, as {self._example}", param, ctx)
        return text


TOPIC: Final = Assignment("ROLE:=/TOPIC", "scan:=/front/scan")
"""A topic for a role."""

PARAMETER: Final = Assignment("NAME:=VALUE", "population.arrival_rate:=0.001")
"""A value for a parameter."""


class RosName(click.types.StringParamType):
    """A name in the graph of ROS 2, with its namespace or without."""

    name = "name"
    _FORM: Final = re.compile(r"/?([a-z_]\w*(/[a-z_]\w*)*/?)?", re.ASCII | re.IGNORECASE)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name; a usage error where ROS takes no such name."""
        if not self._FORM.fullmatch(value):
            form = "letters, digits and _, none beginning with a digit, with / between"
            self.fail(f"'{value}' is no name in ROS 2, which takes {form}", param, ctx)
        return str(value)


ROS_NAME: Final = RosName()
"""A node, a topic or a namespace."""


class Film(click.Path):
    """The file of an animation; another suffix is refused with a hint."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path; a usage error for another suffix than .gif."""
        path = Path(value)
        if reason := why_no_animation(path):
            self.fail(f"{reason}; where none is meant, --animate goes last", param, ctx)
        return path


def _all_of(*options: Callable[[_Command], _Command]) -> Callable[[_Command], _Command]:
    """Return a decorator that adds some options, in the order of the help."""

    def add(command: _Command) -> _Command:
        for option in reversed(options):
            command = option(command)
        return command

    return add


animate_option = click.option(
    "--animate",
    metavar="[FILE]",
    type=Film(),
    is_flag=False,
    flag_value=ANIMATION,
    help=f"Animate it, as a GIF; a bare name goes into the folder. [{ANIMATION}]",
)
start_option = click.option("--start", "start_s", type=SECONDS, default=0.0, help="Begin here.")
duration_option = click.option("--duration", "duration_s", type=SECONDS, help="Stop after so long.")
octomap_option = click.option(
    "--octomap",
    "octomap_file",
    metavar="FILE",
    type=FILE,
    help="Occupied space: OctoMap (.bt, .ot), or a point cloud (.pcd, .ply) or a mesh (.ply), "
    "whose voxels are world.voxel_size wide.",
)
recording_options = _all_of(
    click.argument("bags", metavar="BAG...", nargs=-1, required=True, type=FILE),
    click.option("--map", "map_file", metavar="FILE.yaml", type=FILE, help="Map of map_server."),
    click.option("--map-frame", metavar="NAME", help="Frame of the map, the world frame. [map]"),
    click.option(
        "--static-tf",
        "static_transforms",
        metavar="TF",
        multiple=True,
        help='"X Y Z YAW PITCH ROLL PARENT CHILD", metres and radians. Repeatable.',
    ),
    click.option(
        "--topic",
        "topics",
        metavar="ROLE:=/TOPIC",
        type=TOPIC,
        multiple=True,
        help="Let a topic play a part: map, octomap_point_cloud_centers, odom, scan, range, "
        "points, depth, image, camera/camera_info, tf, tf_static, plan. Repeatable; several "
        "topics of one sensor's role are all augmented.",
    ),
)
params_option = click.option(
    "--params",
    "parameter_files",
    metavar="FILE",
    type=FILE,
    multiple=True,
    help="A ros__parameters file; later ones win. Repeatable.",
)
set_option = click.option(
    "--set",
    "assignments",
    metavar="NAME:=VALUE",
    type=PARAMETER,
    multiple=True,
    help="Set one parameter, as population.arrival_rate:=0.001. Repeatable.",
)
parameter_options = _all_of(
    params_option,
    set_option,
    click.option("--seed", type=WholeNumber(min=0), help="Seed of every random draw."),
)


def say(sentence: str) -> None:
    """Print a notice on stderr: not part of the result."""
    click.echo(sentence, err=True)


# The exit statuses of `are`; 0 is success, 2 a usage error.


FAILED: Final = 1
IMPERFECT: Final = 3
INTERRUPTED: Final = 130
