"""The pictures of the command line: of a run just made, of a recording, and of a configuration."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from are_ros.bag.reader import RECORDING
from are_ros.bag.recording import PREFIX
from are_ros.builder.assembly import catalogue_of, robot_footprint
from are_ros.builder.tick import MOTION_ONLY
from are_ros.builder.warm_up import WarmUpNeeds, warm_up
from are_ros.describe.decisions import (
    decision_lines,
    journey_of,
    row_named,
    simulate_lives,
    simulated_ns,
)
from are_ros.describe.population_trial import run_trial
from are_ros.describe.site import Site, Survey
from are_ros.draw.animation import write_animation
from are_ros.draw.decisions import draw_decisions
from are_ros.draw.overview import draw_overview
from are_ros.draw.plots import draw_population
from are_ros.draw.scene import SceneRecord
from are_ros.draw.viewer import MISSING_VISER, ViewedPlace, has_viser, write_view
from are_ros.errors import AreError, BagError, InputError
from are_ros.parameters.model import Parameters
from are_ros.population.catalogue import Catalogue
from are_ros.replay.output_folder import no_empty_folders
from are_ros.replay.progress import KernelBar, ProgressBar, Say
from are_ros.replay.recorded_scene import RecordedScene, read_recorded_scene
from are_ros.wording import aligned, section, why_refused
from are_ros.world.cameras import ViewModel
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.voxel_map import VoxelMap

POPULATION: Final = "population.png"
DECISIONS: Final = "decisions.png"
WITHOUT_ROBOT: Final = (
    "the robot is not shown: the recording does not tell where it is; "
    "`are replay BAG --with-inputs` writes the inputs, which do, beside the outputs"
)


def animate(
    record: SceneRecord, grid: OccupancyGrid, path: Path, occupied_threshold: int, say: Say
) -> None:
    """Write an animation with a progress bar, and say what it is. Raises BagError."""
    with ProgressBar("animation") as bar:
        film = write_animation(record, grid, path, bar.open, occupied_threshold=occupied_threshold)
    say(film.sentence())


def animate_recording(recording: Path, path: Path, say: Say) -> None:
    """Write an animation of a recording of the node's outputs. Raises AreError."""
    scene = _read(recording)
    animate(scene.record, scene.grid, path, scene.parameters.world.occupied_threshold, say)
    _say_what_lacks(scene, say)


def draw_recording(recording: Path, picture: Path, film: Path | None, say: Say) -> None:
    """Draw the overview of a recording and, if wanted, an animation of it. Raises AreError."""
    scene = _read(recording)
    threshold, ids = scene.parameters.world.occupied_threshold, f"{PREFIX}artefacts"
    draw_overview(
        scene.record,
        scene.grid,
        picture,
        occupied_threshold=threshold,
        ids_as_in=ids,
        voxels=scene.voxels,
    )
    if film is not None:
        animate(scene.record, scene.grid, film, threshold, say)


def view_recording(recording: Path, page: Path, say: Say) -> None:
    """Write the page of a recording of the node's outputs, and say what it is. Raises AreError."""
    if not has_viser():
        raise BagError(MISSING_VISER)
    with ProgressBar("reading") as bar:
        scene = read_recorded_scene(recording, bar.open, with_scans=True)
    path = recording.resolve()
    title = path.parent.name if path.name == RECORDING else path.stem
    views = scene.record.views
    camera = views[-1] if views else None
    place = place_of(scene.parameters, scene.grid, scene.voxels, camera)
    say(write_view(page, place, scene.record, title).sentence())
    if scene.cloud_problem:
        say(scene.cloud_problem)
    _say_what_lacks(scene, say)


def place_of(
    parameters: Parameters,
    grid: OccupancyGrid,
    voxels: VoxelMap | None,
    camera: ViewModel | None,
) -> ViewedPlace:
    """Return what the viewer shows at all times; without an octomap the map's walls stand there.

    Without the catalogue's files, as on another machine, artefacts are shown as boxes.
    """
    world = parameters.world
    if voxels is None:
        walls = grid.cells >= world.occupied_threshold
        voxels = VoxelMap.extruded(grid, walls, world.wall_height, world.ground_height)
    try:
        catalogue = catalogue_of(parameters)
    except AreError:
        catalogue = Catalogue(())
    footprint, range_m = robot_footprint(parameters.robot), parameters.occlusion.max_range
    return ViewedPlace(grid, voxels, catalogue, footprint, camera, range_m, world.ground_height)


def plot_population(parameters: Parameters, catalogue: Catalogue, site: Site, out: Path) -> Path:
    """Run the population of a configuration alone, draw it, and return the picture's path.

    `out` is a file if its name ends in .png, else a folder; folders are made if need be. Raises
    InputError where nothing can be written there, ParameterError without any arrivals.
    """
    trial = run_trial(parameters, catalogue, site)
    return _plotted(
        out, POPULATION, lambda path: draw_population(trial, parameters, catalogue, site, path)
    )


def plot_decisions(
    parameters: Parameters, catalogue: Catalogue, survey: Survey, name: str, out: Path
) -> tuple[Path, list[str]]:
    """Draw what a row of the catalogue would do on a map; return the picture's path and a summary.

    `name` is a label or an index, `out` as in `plot_population`. Raises CatalogueError for another
    name, MapError where the type has no room.
    """
    settings, row = parameters.behaviour, row_named(catalogue, name)
    journey = journey_of(row, settings, survey)
    needs = WarmUpNeeds((), MOTION_ONLY, has_voxels=False)
    with KernelBar() as kernels:
        warm_up(catalogue, needs, kernels.is_wanted, kernels.count)
    with ProgressBar("lives") as bar:
        move = bar.open(0, simulated_ns(survey))
        lives = simulate_lives(row, catalogue, parameters, survey, move)
    grid = survey.environment.grid
    path = _plotted(
        out, DECISIONS, lambda file: draw_decisions(row, settings, grid, journey, lives, file)
    )
    lines = section(
        f"Decisions of {row.label}", aligned(decision_lines(row, settings, journey, lives))
    )
    return path, lines


def _plotted(out: Path, name: str, draw: Callable[[Path], None]) -> Path:
    """Draw into a file, or into one of this name in a folder; return its path."""
    is_file = out.suffix.lower() == ".png" and not out.is_dir()
    path = out if is_file else out / name
    try:
        with no_empty_folders(path.parent):
            path.parent.mkdir(parents=True, exist_ok=True)
            draw(path)
    except OSError as cause:
        reason = why_refused(cause)
        raise InputError(f"--plot {out}: {path.name} cannot be written ({reason})") from cause
    return path


def _read(recording: Path) -> RecordedScene:
    with ProgressBar("reading") as bar:
        return read_recorded_scene(recording, bar.open)


def _say_what_lacks(scene: RecordedScene, say: Say) -> None:
    """Say what was left out, and why the robot is not in the picture, or what would tell."""
    if scene.left_out:
        say(scene.left_out)
    if not len(scene.record.robot):
        problem = scene.robot_problem
        say(f"the robot is not shown: {problem}" if problem else WITHOUT_ROBOT)
