"""The commands of `are` that read recordings and configurations, and need no ROS."""

import sys
from functools import partial
from pathlib import Path
from typing import Any

import click

from are_ros.cli.options import FILE, SECONDS, TOPIC, animate_option, parameter_options, say
from are_ros.cli.status import IMPERFECT

_topic_option = partial(
    click.option, "--topic", "topics", metavar="ROLE:=/TOPIC", type=TOPIC, multiple=True
)
_SKIPPABLE = ("perception", "grids", "markers")


@click.command(short_help="Replay a recording with artefacts in it.")
@click.argument("bags", metavar="BAG...", nargs=-1, required=True, type=FILE)
@click.option("--map", "map_file", metavar="FILE.yaml", type=FILE, help="Map of map_server.")
@click.option("--map-frame", metavar="NAME", help="Frame of the map, the world frame. [map]")
@click.option("--octomap", "octomap_file", metavar="FILE.bt", type=FILE, help="OctoMap file.")
@click.option(
    "--static-tf",
    "static_transforms",
    metavar="TF",
    multiple=True,
    help='"X Y Z YAW PITCH ROLL PARENT CHILD", metres and radians. Repeatable.',
)
@_topic_option(
    help="Let a topic play a part: map, octomap_point_cloud_centers, odom, scan, "
    "camera/camera_info, tf, tf_static. Repeatable; several scans are all augmented.",
)
@click.option("--start", "start_s", type=SECONDS, default=0.0, help="Begin here.")
@click.option("--duration", "duration_s", type=SECONDS, help="Length to replay.")
@click.option("--out", type=FILE, default=Path("out"), show_default=True, help="Output folder.")
@click.option(
    "--scenario",
    "scenario_file",
    metavar="FILE.yaml",
    type=FILE,
    help="Scripted artefacts (population.scenario).",
)
@click.option(
    "--save-scenario",
    metavar="FILE.yaml",
    type=FILE,
    help="Write the lives of this run as a scenario, to be repeated.",
)
@click.option("--with-inputs", is_flag=True, help="Write the inputs beside the outputs.")
@click.option(
    "--skip",
    type=click.Choice(_SKIPPABLE),
    multiple=True,
    help="Leave out a part that nobody needs. Repeatable.",
)
@animate_option
@parameter_options
def replay(**options: Any) -> None:
    """Replay a recording as fast as it goes, with artefacts in it.

    BAG is a rosbag2 folder, an .mcap or .db3 file, or ROS 1 .bag files. The output folder gets
    augmented.mcap (the topics that the live node publishes), overview.png, metrics.json,
    timing.json and effective.yaml. The same recording, parameters and seed give the same bytes.
    """
    from are_ros.replay.command import replay_command

    if not replay_command(say, **options):
        sys.exit(IMPERFECT)


@click.command(short_help="Say what a recording holds, and what it lacks.")
@click.argument("bags", metavar="BAG...", nargs=-1, required=True, type=FILE)
@_topic_option(help="As in replay.")
@click.option("--map", "map_file", metavar="FILE.yaml", type=FILE, help="As in replay.")
@click.option("--map-frame", metavar="NAME", default="map", show_default=True, help="As in replay.")
@click.option("--static-tf", "static_transforms", metavar="TF", multiple=True, help="As in replay.")
def inspect(**options: Any) -> None:
    """Say what a recording holds: topics, the roles that they play, how its frames hang together.

    BAG is as in replay, or the folder of a result. What a replay would lack is said with the
    option that supplies it.
    """
    from are_ros.replay.command import inspect_command

    inspect_command(click.echo, **options)


@click.command(short_help="Find where a map lies, by the scans of a recording.")
@click.argument("bags", metavar="BAG...", nargs=-1, required=True, type=FILE)
@click.option("--map", "map_file", metavar="FILE.yaml", type=FILE, help="Map of map_server.")
@click.option("--map-frame", metavar="NAME", help="Frame of the map, as in replay. [map]")
@click.option("--static-tf", "static_transforms", metavar="TF", multiple=True, help="As in replay.")
@_topic_option(help="As in replay.")
@click.option("--start", "start_s", type=SECONDS, default=0.0, help="Begin here.")
@click.option("--duration", "duration_s", type=SECONDS, help="Length to read.")
@click.option(
    "--out",
    metavar="FILE.png",
    type=FILE,
    default=Path("align.png"),
    show_default=True,
    help="Picture.",
)
@parameter_options
def align(**options: Any) -> None:
    """Find the transform that a replay lacks between a map and the robot, by matching scans.

    BAG is as in replay. It prints the --static-tf that joins the map's frame to the root of the
    tree in which the laser hangs (odom, mostly), how well the scans fit there, and draws them.
    Where several places fit as well it says so. The exit status is 3 unless there is one good
    answer.
    """
    from are_ros.replay.align_command import align_command
    from are_ros.replay.command import options_of

    unused = {"octomap_file": None, "scenario_file": None, "save_scenario": None}
    wanted = options_of(skip=(), with_inputs=False, **unused, **options)
    if not align_command(click.echo, say, wanted):
        sys.exit(IMPERFECT)


@click.command(short_help="Say what a configuration means.")
@click.option("--map", "map_file", metavar="FILE.yaml", type=FILE, help="Map, for its region.")
@click.option(
    "--plot",
    "plot_path",
    metavar="FILE.png",
    type=FILE,
    help="Run the population alone, and draw it; into a folder as population.png.",
)
@click.option("--all", "everything", is_flag=True, help="Each row of the catalogue, too.")
@parameter_options
def describe(**options: Any) -> None:
    """Say what a configuration means: arrivals per minute, expected population, types, gates.

    Rows of the catalogue are summed up by class; --all lists each.

    With --plot also in a picture: the number alive over time, waiting times and lives against
    their laws, and where artefacts appear on the map.
    """
    from are_ros.replay.command import describe_command

    describe_command(click.echo, **options)


@click.command(short_help="Check a result or a live recording against the invariants.")
@click.argument("recording", metavar="RECORDING", type=FILE)
@click.option("--map", "map_file", metavar="FILE.yaml", type=FILE, help="The real map.")
@click.option("--params", "parameters_file", metavar="FILE", type=FILE, help="Its parameters.")
def check(recording: Path, map_file: Path | None, parameters_file: Path | None) -> None:
    """Check what the node or a replay gave out, by a program of its own.

    RECORDING is the folder of a replay or of the demo, a rosbag2 folder, an .mcap or .db3 file. It
    reads only the recording and the map; what cannot be checked is said. With the inputs in it
    (replay --with-inputs) more can be checked.
    """
    from are_ros.replay.command import check_command

    if not check_command(click.echo, recording, map_file, parameters_file):
        sys.exit(IMPERFECT)


@click.command(short_help="Draw what rviz would show of a recording.")
@click.argument("recording", metavar="RECORDING", type=FILE)
@click.option("--at", "at_s", type=SECONDS, help="Moment, from its beginning. [the fullest]")
@click.option("--out", type=FILE, help="Picture. [rviz.png beside the recording]")
@animate_option
def view(recording: Path, at_s: float | None, out: Path | None, animate: Path | None) -> None:
    """Draw what rviz would show of a recording: map, costmap, markers, scan, robot.

    RECORDING is a result of `are replay`, `are demo` or `are record`, or any recording of the
    node's topics. With --animate all of it, from above, instead of one moment.

    The picture goes into the recording's folder, as rviz.png or animation.gif; that of a file with
    a name of its own begins with it: run.mcap has run_rviz.png.
    """
    from are_ros.replay.output_folder import picture_beside

    if animate is not None:
        if at_s is not None or out is not None:
            message = "--animate shows all of a recording and names its file: no --at, no --out"
            raise click.UsageError(message)
        from are_ros.replay.film_command import animate_recording
        from are_ros.replay.film_path import ANIMATION, film_path

        usual = picture_beside(recording, ANIMATION)
        film = usual if str(animate) == ANIMATION else film_path(animate, usual.parent)
        animate_recording(recording, film, say)
        return
    from are_ros.replay.film_command import without_robot
    from are_ros.replay.rviz_picture import draw_rviz

    out = out or picture_beside(recording, "rviz.png")
    scene = draw_rviz(recording, out, at_s)
    say(f"picture: {out}")
    if scene.robot is None:
        say(without_robot(scene.robot_problem))


COMMANDS = (replay, inspect, align, describe, check, view)
