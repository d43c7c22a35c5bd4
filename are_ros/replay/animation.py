"""A film of a run from above: walls, robot, field of view, and the artefacts on their ways."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from are_ros.conventions import NS_PER_S
from are_ros.draw.scene import SceneRecord
from are_ros.errors import BagError
from are_ros.replay._film_palette import Palette, Picture
from are_ros.replay._film_scene import FilmScene
from are_ros.replay._film_writers import OpenFilm
from are_ros.replay.film_path import why_no_film
from are_ros.replay.runner import Progress
from are_ros.wording import why_refused
from are_ros.world.occupancy_grid import OccupancyGrid

OpenProgress = Callable[[int, int], Progress]

_FPS: Final = 10
_SPEED: Final = 3
_MOST_PICTURES: Final = 600
_SAMPLES: Final = 16
_SCALES: Final = (1.0, 0.75, 0.55, 0.4)
_MOST_BYTES: Final = 10_000_000


@dataclass(frozen=True)
class Film:
    """What was written: so many pictures, so many times as fast as it was, and the size."""

    path: Path
    pictures: int
    speed: float
    size_px: tuple[int, int]
    length_bytes: int

    def sentence(self) -> str:
        """Say it."""
        return (
            f"animation: {self.path} ({self.length_bytes / 1e6:.1f} MB, {self.pictures} pictures "
            f"of {self.size_px[0]}x{self.size_px[1]}, {self.speed:g} times real time)"
        )


def write_animation(
    record: SceneRecord,
    grid: OccupancyGrid,
    path: Path,
    open_progress: OpenProgress,
    *,
    occupied_threshold: int,
    most_bytes: int = _MOST_BYTES,
) -> Film:
    """Write a film of a run over its map, as .gif, .webp or .mp4; return what it is.

    Ten pictures a second, at three times real time, or faster where that would be more than 600
    pictures; smaller where the file would be larger than `most_bytes`. The same input gives the
    same bytes. Raises BagError for another suffix, a record without ticks, or where the system
    refuses to write.
    """
    if reason := why_no_film(path):
        raise BagError(reason)
    if not len(record.series.stamps_ns):
        raise BagError(f"{path}: there is no tick to animate")
    stamps, speed = film_stamps(record)
    try:
        for scale in _SCALES:
            scene = FilmScene(record, grid, occupied_threshold, scale)
            limit = None if scale == _SCALES[-1] else most_bytes
            if _written(scene, stamps, path, open_progress, limit):
                break
    except OSError as cause:
        message = f"{path}: the animation cannot be written ({why_refused(cause)})"
        raise BagError(message) from cause
    return Film(path, len(stamps), speed, scene.stage.size, path.stat().st_size)


def film_stamps(record: SceneRecord) -> tuple[list[int], float]:
    """Return the stamps of the ticks that are shown, and how much faster than it was."""
    ticks = record.series.stamps_ns
    shown_ns = record.duration_ns
    speed = max(_SPEED, -(-shown_ns * _FPS // ((_MOST_PICTURES - 1) * NS_PER_S)))
    step_ns = speed * NS_PER_S // _FPS
    wanted = np.arange(0, shown_ns + 1, step_ns, dtype=np.int64)
    at = np.searchsorted(record.series.passed_ns(), wanted, side="right") - 1
    return ticks[at].tolist(), float(speed)


def _written(
    scene: FilmScene,
    stamps: Sequence[int],
    path: Path,
    open_progress: OpenProgress,
    most_bytes: int | None,
) -> bool:
    """Write the film; return False, and leave it, as soon as it is too long."""
    palette = Palette.of(_samples(scene, stamps))
    progress = open_progress(stamps[0], stamps[-1] + 1)
    with OpenFilm(path, scene.stage.size, _FPS, palette) as film:
        for stamp_ns in stamps:
            film.add(scene.picture(stamp_ns))
            progress(stamp_ns)
            if most_bytes is not None and film.written_bytes > most_bytes:
                return False
    progress(stamps[-1] + 1)
    return True


def _samples(scene: FilmScene, stamps: Sequence[int]) -> Iterator[Picture]:
    """Yield some of the pictures, for the palette."""
    at = np.unique(np.linspace(0, len(stamps) - 1, _SAMPLES).astype(np.int64))
    return (scene.picture(stamps[i]) for i in at.tolist())
