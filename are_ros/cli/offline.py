"""The commands of `are` that read recordings and configurations, and need no ROS."""

import sys
from pathlib import Path
from typing import Any, Final, NoReturn

import click

from are_ros.cli.live import require_ros
from are_ros.cli.options import (
    FILE,
    IMPERFECT,
    ROS_NAME,
    SECONDS,
    Amount,
    Command,
    WholeNumber,
    animate_option,
    duration_option,
    octomap_option,
    parameter_options,
    params_option,
    recording_options,
    say,
    set_option,
    start_option,
)

_SKIPPABLE = ("perception", "grids", "markers")
_OPTIONAL = ("octomap",)
_PORT: Final = 8080


@click.command(cls=Command, short_help="Replay a recording with artefacts in it.")
@recording_options
@octomap_option
@start_option
@duration_option
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
@click.option(
    "--also",
    type=click.Choice(_OPTIONAL),
    multiple=True,
    help="Write a large part, too: the octomap with the artefacts' voxels. Repeatable.",
)
@animate_option
@parameter_options
def replay(**options: Any) -> None:
    """Replay a recording as fast as it goes, with artefacts in it.

    BAG is a rosbag2 folder, an .mcap or .db3 file, or ROS 1 .bag files. The output folder gets
    augmented.mcap (the topics that the live node publishes), overview.png, view.html,
    metrics.json, timing.json and effective.yaml. The same recording, parameters and seed give the
    same bytes.
    """
    from are_ros.replay.command import replay_command

    if not replay_command(say, **options):
        sys.exit(IMPERFECT)


@click.command(cls=Command, short_help="Say what a recording holds, and what it lacks.")
@recording_options
@params_option
@set_option
def inspect(**options: Any) -> None:
    """Say what a recording holds: topics, the roles that they play, how its frames hang together.

    BAG is as in replay, or the folder of a result. What a replay would lack is said with the
    option that supplies it.
    """
    from are_ros.replay.command import inspect_command

    inspect_command(click.echo, **options)


@click.command(cls=Command, short_help="Find where a map lies, by the scans of a recording.")
@recording_options
@start_option
@duration_option
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
    from are_ros.replay.command import options_of
    from are_ros.replay.survey.align import align_command

    unused = {"octomap_file": None, "scenario_file": None, "save_scenario": None}
    wanted = options_of(skip=(), also=(), with_inputs=False, **unused, **options)
    if not align_command(click.echo, say, wanted):
        sys.exit(IMPERFECT)


@click.command(cls=Command, short_help="Say what a configuration means.")
@click.option("--map", "map_file", metavar="FILE.yaml", type=FILE, help="Map, for its region.")
@click.option(
    "--plot",
    "plot_path",
    metavar="FILE.png",
    type=FILE,
    help="Run the population alone, and draw it; into a folder as population.png.",
)
@click.option(
    "--decisions",
    "row",
    metavar="ROW",
    help="Draw what this row of the catalogue (label or number) would do on the map. "
    "[decisions.png, or --plot]",
)
@click.option("--all", "everything", is_flag=True, help="Each row of the catalogue, too.")
@parameter_options
def describe(**options: Any) -> None:
    """Say what a configuration means: arrivals per minute, expected population, types, gates.

    Rows of the catalogue are summed up by class; --all lists each.

    With --plot also in a picture: the number alive over time, waiting times and lives against
    their laws, and where artefacts appear on the map.

    With --decisions only what one row would do on the map: what going to a destination is worth
    from everywhere, with the best moves, as its life runs out, and the ways and behaviours of 40
    artefacts that live there for a minute each.
    """
    from are_ros.replay.command import describe_command

    describe_command(click.echo, **options)


@click.command(cls=Command, short_help="Check a result or a live recording against the invariants.")
@click.argument("recording", metavar="RECORDING", type=FILE)
@click.option("--map", "map_file", metavar="FILE.yaml", type=FILE, help="The real map.")
@click.option(
    "--params",
    "parameters_file",
    metavar="FILE",
    type=FILE,
    help="Its parameters. [effective.yaml beside it, else what it tells itself]",
)
def check(recording: Path, map_file: Path | None, parameters_file: Path | None) -> None:
    """Check what the node or a replay gave out, by a program of its own.

    RECORDING is the folder of a replay or of the demo, a rosbag2 folder, an .mcap or .db3 file. It
    reads only the recording and the map; what cannot be checked is said. With the inputs in it
    (replay --with-inputs) more can be checked.
    """
    from are_ros.replay.command import check_command

    if not check_command(click.echo, recording, map_file, parameters_file):
        sys.exit(IMPERFECT)


@click.command(cls=Command, short_help="Look around in a recording, or in what the live node does.")
@click.argument("recording", metavar="[RECORDING]", type=FILE, required=False)
@click.option("--out", type=FILE, help="Page. [view.html beside the recording]")
@animate_option
@click.option("--live", is_flag=True, help="Serve the scene of the running node to a browser.")
@click.option("--port", type=WholeNumber(0, 65535), help="For --live. [8080]")
@click.option("--namespace", metavar="NAME", type=ROS_NAME, help="That of the node, for --live.")
def view(
    recording: Path | None,
    out: Path | None,
    animate: Path | None,
    live: bool,
    port: int | None,
    namespace: str | None,
) -> None:
    """Write a page to look around in: map, walls, robot, what its camera sees, artefacts, scans.

    RECORDING is a result of `are replay`, `are demo` or `are record`, or any recording of the
    node's topics; effective.yaml beside it, or the recording, has its parameters. The page plays in
    a browser, without a network; it needs viser to be written. With --animate an animation of all
    from above, instead.

    It goes into the recording's folder, as view.html or animation.gif; that of a file with a name
    of its own begins with it: run.mcap has run_view.html.

    With --live, and without RECORDING, a browser shows what the running node does, at
    http://localhost:PORT, with sliders for the parameters that may change, a pause, and a click
    that places an artefact.
    """
    if live:
        if recording is not None or out is not None or animate is not None:
            raise click.UsageError("--live shows the running node: no RECORDING, --out, --animate")
        require_ros()
        from are_ros.record.live_view import view_live_command

        view_live_command(say, namespace or "", _PORT if port is None else port)
        return
    if port is not None or namespace is not None:
        raise click.UsageError("--port and --namespace are for --live")
    if recording is None:
        raise click.UsageError("Missing argument 'RECORDING' (or --live for the running node)")
    from are_ros.replay.output_folder import VIEW, picture_beside

    if animate is not None:
        if out is not None:
            raise click.UsageError("--animate names its file: no --out")
        from are_ros.replay.output_folder import ANIMATION, animation_path
        from are_ros.replay.pictures import animate_recording

        usual = picture_beside(recording, ANIMATION)
        film = usual if str(animate) == ANIMATION else animation_path(animate, usual.parent)
        animate_recording(recording, film, say)
        return
    from are_ros.replay.pictures import view_recording

    view_recording(recording, out or picture_beside(recording, VIEW), say)


@click.command(cls=Command, short_help="Write the scene of a recording for other programs.")
@click.argument("recording", metavar="RECORDING", type=FILE)
@click.option(
    "--mesh",
    metavar="FILE",
    type=FILE,
    help="The place and the artefacts as a mesh: a .glb of named nodes, or a .ply.",
)
@click.option(
    "--at", "at_s", type=SECONDS, help="Time of the scene, from the first tick on. [last]"
)
@octomap_option
@click.option(
    "--tracks",
    metavar="FOLDER",
    type=FILE,
    help="The tracks of all artefacts and of the robot: tracks.csv, and TUM's format.",
)
@click.option(
    "--kitti",
    metavar="FOLDER",
    type=FILE,
    help="Augmented clouds with labelled boxes and calibration, as KITTI has them.",
)
@click.option(
    "--coco",
    metavar="FOLDER",
    type=FILE,
    help="Painted images with masks and boxes, as COCO has them.",
)
@click.option(
    "--image", default="", metavar="TOPIC", help="The image for --coco, if there are several."
)
@click.option(
    "--cloud", default="", metavar="TOPIC", help="The cloud for --kitti, if there are several."
)
def export(
    recording: Path,
    mesh: Path | None,
    at_s: float | None,
    octomap_file: Path | None,
    tracks: Path | None,
    kitti: Path | None,
    cloud: str,
    coco: Path | None,
    image: str,
) -> None:
    """Write what a recording holds into files of other programs.

    RECORDING is a result of `are replay`, `are demo` or `are record`, or any recording of the
    node's topics; effective.yaml beside it, or the recording, has its parameters.

    With --mesh the scene at one time: the surface of what stands in the place (the octomap, or the
    walls of the map), its floor, and the artefacts where they were, coloured by class. Lengths are
    metres. A PLY is one mesh in the map's frame, z up. In a GLB each artefact is a node, named by
    its label and id; y is up, as its standard says.

    With --tracks where all artefacts and the robot were, tick by tick: a table of all, tracks.csv,
    and a file for each in tum/. With --kitti each augmented cloud with the boxes of the artefacts
    that were perceived, and what joins cloud and camera. With --coco each painted image with the
    masks of its artefacts (docs/data_sets.md).
    """
    if (mesh, tracks, kitti, coco) == (None, None, None, None):
        formats = "--mesh FILE.glb, --tracks, --kitti or --coco FOLDER"
        raise click.UsageError(f"Nothing to write: give {formats}")
    for option, is_given, form, path in (
        ("--at", at_s is not None, "--mesh", mesh),
        ("--octomap", octomap_file is not None, "--mesh", mesh),
        ("--cloud", bool(cloud), "--kitti", kitti),
        ("--image", bool(image), "--coco", coco),
    ):
        if is_given and path is None:
            raise click.UsageError(f"{option} is for {form} alone, which is not given")
    from are_ros.export.command import export_mesh, export_sets

    if mesh is not None:
        export_mesh(say, recording, mesh, at_s, octomap_file)
    folders = {"tracks": tracks, "kitti": kitti, "coco": coco}
    export_sets(say, recording, folders, cloud, image)


# The command of `are` that fits the mixture of Eq. 1 to observed rows.


_MOST_ROWS = 10_000
_MOST_COMPONENTS = 32


@click.command(cls=Command, short_help="Fit the Poisson mixture to observed rows.")
@click.argument("source", metavar="INPUT", type=FILE)
@click.option(
    "--rows",
    type=WholeNumber(2, _MOST_ROWS),
    help="Rows that can occur, where there is no catalogue.",
)
@click.option("--catalogue", "catalogue_file", metavar="FILE", type=FILE, help="Its rows occur.")
@click.option(
    "--components",
    type=WholeNumber(1, _MOST_COMPONENTS),
    help="Number n of components. [by BIC]",
)
@click.option(
    "--max-components",
    type=WholeNumber(1, _MOST_COMPONENTS),
    default=8,
    show_default=True,
    help="Most components that BIC may choose.",
)
@click.option(
    "--out", type=FILE, default=Path("fit"), show_default=True, help="Folder of the results."
)
@params_option
@click.option(
    "--seed",
    type=WholeNumber(min=0),
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
    from are_ros.fit.command import FitOptions, fit_command

    if options["rows"] is not None and options["catalogue_file"] is not None:
        raise click.UsageError("--rows is for where there is no --catalogue: give one of them.")
    fit_command(click.echo, say, FitOptions(**options))


_LAYOUT: Final = "soak {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} min [{elapsed}<{remaining}]"
_LOGGED_EVERY_S: Final = 60.0
"""Where stderr is no terminal (a file, CI), the bar is written this seldom."""


@click.command(cls=Command, short_help="Let artefacts live for hours, and judge how they move.")
@click.option("--map", "map_file", metavar="FILE.yaml", type=FILE, required=True, help="The map.")
@click.option(
    "--minutes",
    type=Amount("minutes", least=0.001),
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
    from are_ros.lab.soak import RESULTS, write_soak
    from are_ros.lab.soak import soak as run
    from are_ros.replay.command import effective_parameters
    from are_ros.replay.output_folder import no_empty_folders, prepare_folder
    from are_ros.replay.progress import SLOW_S
    from are_ros.world.map_io import read_map_file

    parameters = effective_parameters(
        options["parameter_files"], options["assignments"], options["seed"]
    )
    grid = read_map_file(options["map_file"], parameters.frames.map)
    minutes = options["minutes"]
    is_shown = sys.stderr.isatty()
    interval_s = 0.1 if is_shown else _LOGGED_EVERY_S
    bar: tqdm[NoReturn] = tqdm(
        total=minutes,
        bar_format=_LAYOUT if is_shown else f"{_LAYOUT}\n",
        mininterval=interval_s,
        maxinterval=_LOGGED_EVERY_S,
        delay=SLOW_S,
    )

    def move(done_min: float) -> None:
        bar.update(min(done_min, minutes) - bar.n)

    with no_empty_folders(options["out"]):
        prepare_folder(options["out"], RESULTS)
        catalogue = catalogue_of(parameters)
        with bar:
            result = run(grid, parameters, catalogue, artefact_minutes=minutes, progress=move)
        write_soak(result, grid, options["out"])
    for line in result.table():
        click.echo(line)
    say(f"results in {options['out']}")
    if not result.is_clean:
        sys.exit(IMPERFECT)


COMMANDS = (replay, inspect, align, describe, check, view, export, fit, soak)
