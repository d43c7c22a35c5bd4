"""Animations for the command line: of a run just made, or of any recording of the node."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from are_ros.bag.recording import PREFIX
from are_ros.draw.animation import write_animation
from are_ros.draw.overview import draw_overview
from are_ros.draw.scene import SceneRecord
from are_ros.replay.progress import ProgressBar
from are_ros.replay.recorded_scene import RecordedScene, read_recorded_scene
from are_ros.world.occupancy_grid import OccupancyGrid

Say = Callable[[str], None]

WITHOUT_ROBOT: Final = (
    "the robot is not shown: the recording does not tell where it is; "
    "`are replay BAG --with-inputs` writes the inputs, which do, beside the outputs"
)


def without_robot(problem: str) -> str:
    """Return the sentence for a picture without the robot: why, or what would tell where it is."""
    return f"the robot is not shown: {problem}" if problem else WITHOUT_ROBOT


def animate(
    record: SceneRecord, grid: OccupancyGrid, path: Path, occupied_threshold: int, say: Say
) -> None:
    """Write an animation with a progress bar, and say what it is. Raises BagError."""
    with ProgressBar("animation") as bar:
        film = write_animation(record, grid, path, bar.open, occupied_threshold=occupied_threshold)
    say(film.sentence())


def read_with_bar(recording: Path) -> RecordedScene:
    """Return the scene of a recording, with a progress bar. Raises AreError."""
    with ProgressBar("reading") as bar:
        return read_recorded_scene(recording, bar.open)


def animate_recording(recording: Path, path: Path, say: Say) -> None:
    """Write an animation of a recording of the node's outputs. Raises AreError."""
    scene = read_with_bar(recording)
    threshold = scene.parameters.world.occupied_threshold
    animate(scene.record, scene.grid, path, threshold, say)
    if not len(scene.record.robot):
        say(without_robot(scene.robot_problem))


def draw_recording(recording: Path, picture: Path, film: Path | None, say: Say) -> None:
    """Draw the overview of a recording and, if wanted, an animation of it. Raises AreError."""
    scene = read_with_bar(recording)
    threshold = scene.parameters.world.occupied_threshold
    draw_overview(
        scene.record,
        scene.grid,
        picture,
        occupied_threshold=threshold,
        ids_as_in=f"{PREFIX}artefacts",
    )
    if film is not None:
        animate(scene.record, scene.grid, film, threshold, say)
