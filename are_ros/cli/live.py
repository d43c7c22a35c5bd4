"""The commands of `are` that need ROS 2: node, guard, play, record and demo."""

import sys
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click

from are_ros.cli.options import (
    FILE,
    IMPERFECT,
    ROS_NAME,
    Amount,
    Command,
    animate_option,
    duration_option,
    parameter_options,
    params_option,
    say,
    set_option,
    start_option,
)
from are_ros.errors import NodeError
from are_ros.wording import why_refused

_PASSED_ON = {"ignore_unknown_options": True, "allow_extra_args": True}
_RATE = Amount("factor", 0.001, 1e6)


@click.command(cls=Command, short_help="Run the live node.", context_settings=_PASSED_ON)
@params_option
@set_option
@click.option(
    "--namespace", metavar="NAME", type=ROS_NAME, help="Namespace of the node and of its topics."
)
@click.option("--use-sim-time", is_flag=True, help="Go by /clock.")
@click.argument("ros_args", metavar="[ROS ARGUMENTS]", nargs=-1, type=click.UNPROCESSED)
def node(
    parameter_files: tuple[Path, ...],
    assignments: tuple[str, ...],
    namespace: str | None,
    use_sim_time: bool,
    ros_args: tuple[str, ...],
) -> None:
    """Run the live node `ar_builder`, beside a robot's navigation stack.

    What follows `--ros-args` goes to ROS as it is: -p, -r, --params-file, --log-level.
    """
    require_ros()
    from are_ros.node.startup import main as run_node
    from are_ros.parameters.ros_yaml import assignments_for_ros, parameter_file_for_ros

    _check_ros_args(ros_args)
    home = _namespace(namespace, ros_args, "ar_builder")
    last = assignments_for_ros(assignments) if assignments else ""
    first = parameter_file_for_ros(parameter_files, home) if parameter_files else ""
    with ExitStack() as files:
        # The last one counts: a single value goes before all files, those of ROS's own, too.
        before, after = (_params_file(files, text) for text in (first, last))
        given = _ros_words(namespace, use_sim_time=use_sim_time)
        sys.exit(run_node(["--ros-args", *before, "--", *ros_args, "--ros-args", *after, *given]))


def _params_file(files: ExitStack, text: str) -> list[str]:
    """Write a parameter file that ends with `files`, and return the words that name it to ROS.

    There are none for no text. Raises NodeError where nothing can be written.
    """
    if not text:
        return []
    try:
        path = Path(files.enter_context(TemporaryDirectory(prefix="ar_builder_")), "values.yaml")
        path.write_text(text, encoding="utf-8")
    except OSError as cause:
        raise NodeError(
            f"the parameters cannot be handed to ROS in a temporary file: {why_refused(cause)}; "
            "set TMPDIR to a folder that can be written"
        ) from cause
    return ["--params-file", str(path)]


def _check_ros_args(ros_args: tuple[str, ...]) -> None:
    if ros_args and ros_args[0] != "--ros-args":
        message = f"'{ros_args[0]}' is no option of it; what is for ROS follows --ros-args"
        raise click.UsageError(message)


def _namespace(namespace: str | None, ros_args: tuple[str, ...], node_name: str) -> str:
    """Return the namespace of a node: that of the option, or that to which ROS is to remap it.

    A usage error where both are given.
    """
    rules = [word.partition("__ns:=") for word in ros_args]
    own = ("", f"{node_name}:")
    remapped = [home for whose, mark, home in rules if mark and whose in own]
    if namespace and remapped:
        raise click.UsageError("--namespace and __ns:= are both given: one of them is enough")
    return namespace or (remapped[0] if remapped else "")


def _ros_words(namespace: str | None, *, use_sim_time: bool) -> list[str]:
    """Return the options as ROS takes them, behind --ros-args."""
    given = ["-r", f"__ns:=/{namespace.strip('/')}"] if namespace else []
    given += ["-p", "use_sim_time:=true"] if use_sim_time else []
    return given


@click.command(
    cls=Command,
    short_help="Give the real map back if the node is killed.",
    context_settings=_PASSED_ON,
)
@click.option("--namespace", metavar="NAME", type=ROS_NAME, help="That of the node.")
@click.argument("ros_args", metavar="[ROS ARGUMENTS]", nargs=-1, type=click.UNPROCESSED)
def guard(namespace: str | None, ros_args: tuple[str, ...]) -> None:
    """Watch the node `ar_builder`, and publish the real map if it is killed.

    A node that ends in order leaves the real map behind. After a kill -9 or a crash its last map
    would stay in Nav2's costmaps: within a second the guard publishes the real map in its place,
    and an empty artefact map. What follows `--ros-args` goes to ROS as it is; remap `map` as for
    the node.
    """
    require_ros()
    from are_ros.node.guard import main as run_guard

    _check_ros_args(ros_args)
    _namespace(namespace, ros_args, "ar_guard")
    given = _ros_words(namespace, use_sim_time=False)
    sys.exit(run_guard(["--ros-args", *given, "--", *ros_args]))


@click.command(cls=Command, short_help="Play a recording to live topics.")
@click.argument("bags", metavar="BAG...", nargs=-1, required=True, type=FILE)
@click.option("--rate", type=_RATE, default=1.0, show_default=True, help="Times real time.")
@click.option("--loop", is_flag=True, help="Play again and again.")
@start_option
@duration_option
@click.option("--topics", metavar="/TOPIC", multiple=True, help="Play these only. Repeatable.")
@click.option("--exclude", metavar="/TOPIC", multiple=True, help="Leave out. Repeatable.")
@click.option("--remap", "remaps", metavar="/FROM:=/TO", multiple=True, help="Repeatable.")
@click.option(
    "--clock",
    "clock_hz",
    type=Amount("hz", 0.0, 1000.0),
    default=100.0,
    show_default=True,
    help="How often /clock tells the time, up to 1000; 0: not at all.",
)
@click.option(
    "--lockstep",
    metavar="NODE",
    type=ROS_NAME,
    multiple=True,
    help="As fast as this node can: the time goes on when it has taken everything earlier. "
    "Repeatable: the slowest sets the pace.",
)
@click.option(
    "--wait-for",
    metavar="NODE",
    type=ROS_NAME,
    multiple=True,
    help="Begin when this node listens; wait ten minutes at most. Repeatable.",
)
def play(**options: Any) -> None:
    """Play a recording to live topics, with /clock, as `ros2 bag play --clock` does.

    Quality of service is as recorded, but maps and static transforms are latched in any case. ROS 1
    recordings are played as ROS 2.
    """
    require_ros()
    from are_ros.record.commands import play_command

    if not play_command(say, **options):
        sys.exit(IMPERFECT)


@click.command(cls=Command, short_help="Record live topics.")
@click.argument("path", metavar="OUT", type=FILE)
@click.option(
    "--topics",
    metavar="/TOPIC",
    multiple=True,
    help="Record these only; * and ? stand for anything. Repeatable.",
)
@click.option("--exclude", metavar="/TOPIC", multiple=True, help="Leave out. Repeatable.")
@duration_option
@click.option(
    "--wait-for",
    metavar="/TOPIC",
    type=ROS_NAME,
    multiple=True,
    help="Ready when it has a publisher.",
)
@click.option("--use-sim-time", is_flag=True, help="Log times are those of /clock.")
@click.option("--overwrite", is_flag=True, help="Replace a recording that is there.")
def record(**options: Any) -> None:
    """Record live topics, until Ctrl-C, into OUT, an .mcap file."""
    require_ros()
    from are_ros.record.commands import record_command

    if not record_command(say, **options):
        sys.exit(IMPERFECT)


@click.command(cls=Command, short_help="Show the live node at work on a recording.")
@click.argument("bag", metavar="[BAG]", type=FILE, default=Path("bags/sample_office.mcap"))
@click.option("--rate", type=_RATE, default=2.0, show_default=True, help="Times real time.")
@duration_option
@click.option("--lockstep", is_flag=True, help="As fast as the node can, repeatable to the byte.")
@click.option("--out", type=FILE, default=Path("out/demo"), show_default=True, help="Folder.")
@animate_option
@parameter_options
def demo(**options: Any) -> None:
    """Run the live node over DDS, on this machine only, fed with a recording; record and draw it.

    The folder gets augmented.mcap (inputs and outputs as they were on the wire), view.html (a page
    to look around in), overview.png (who went where), effective.yaml and the node's log.
    """
    require_ros()
    from are_ros.record.commands import demo_command

    if not demo_command(say, **options):
        sys.exit(IMPERFECT)


def require_ros() -> None:
    """Raise NodeError, with the remedy, where rclpy is not installed."""
    if find_spec("rclpy") is None:
        raise NodeError(
            "rclpy is not installed: source /opt/ros/jazzy/setup.bash on a robot, or run "
            "'make demo' in the project; `are replay` works without"
        )


COMMANDS = (node, guard, play, record, demo)
