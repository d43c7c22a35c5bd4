"""The results of a soak: soak.json, and soak.png with the paths of all artefacts."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path as File
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.draw.artefacts import (
    JUMP_PATTERN_PX,
    PATH_PX,
    Path,
    behaviour_counts,
    behaviour_entries,
    draw_paths,
)
from are_ros.draw.map import draw_map, known_part, window_of
from are_ros.draw.palette import GREY, ROBOT, Rgb, behaviour_marks, class_colours
from are_ros.draw.sheet import (
    Entry,
    Sheet,
    dashed_sign,
    line_sign,
    mark_sign,
    patch_sign,
)
from are_ros.errors import InputError
from are_ros.lab.soak import SoakResult, Way
from are_ros.wording import counted, why_refused
from are_ros.world.occupancy_grid import OccupancyGrid

Floats = npt.NDArray[np.float64]

_FEW_PATHS: Final = 60
"""With more paths than this, arrowheads and behaviours would overlap and are not drawn."""
_DOT_PX: Final = 4.0
_ROBOT_ALPHA: Final = 0.35


def draw_soak(result: SoakResult, grid: OccupancyGrid, path: File) -> None:
    """Write the paths on the known part of the map, in the colours of the classes, as PNG.

    The robot's path lies below them. Raises OSError.
    """
    paths = paths_of(result)
    colours = class_colours([one.class_name for one in paths])
    marks = behaviour_marks([one.behaviour for one in paths])
    robot_m = np.array(result.robot_way_m, dtype=np.float64).reshape(-1, 2)
    is_detailed = len(paths) <= _FEW_PATHS
    part = known_part(grid)
    points_m = np.concatenate((robot_m, *(one.points_m for one in paths)))
    sheet = Sheet.of(window_of(grid, part, points_m), legends(paths, robot_m, colours, marks))
    canvas, view = sheet.canvas, sheet.view
    draw_map(canvas, view, grid, part)
    if len(robot_m) > 1:
        canvas.line(view.pixels(robot_m), ROBOT, 2.0, _ROBOT_ALPHA)
    draw_paths(canvas, view, paths, colours, marks, is_detailed=is_detailed)
    for one in paths:
        if len(one.points_m) == 1:
            colour = colours[one.class_name]
            canvas.mark("disc", view.pixels(one.points_m[0]), _DOT_PX, colour, colour, 1.0)
    sheet.write(path, _title(result), _subtitle(result))


def paths_of(result: SoakResult) -> list[Path]:
    """Return the paths of all artefacts, which no camera perceives."""
    return [_path(number, way) for number, way in sorted(result.ways.items())]


def legends(
    paths: Sequence[Path], robot_m: Floats, colours: Mapping[str, Rgb], marks: Mapping[str, str]
) -> list[list[Entry]]:
    """Return the entries for classes, behaviours, and what else there is to see."""
    classes = Counter(path.class_name for path in paths)
    behaviours = behaviour_counts([path.behaviour for path in paths])
    return [
        [Entry(f"{name}  {classes[name]}", patch_sign(colours[name])) for name in sorted(classes)],
        behaviour_entries(behaviours, marks) if len(paths) <= _FEW_PATHS else [],
        _others(paths, robot_m),
    ]


def _path(number: int, way: Way) -> Path:
    points_m = np.array(way.points_m, dtype=np.float64).reshape(-1, 2)
    steps = np.arange(1, len(points_m))
    is_jump = np.isin(steps, np.array(sorted(way.jumps), dtype=np.int64))
    is_seen = np.zeros_like(is_jump)
    name = way.row.class_name
    return Path(number, name, way.behaviour, points_m, is_seen, is_jump, is_perceived=False)


def _others(paths: Sequence[Path], robot_m: Floats) -> list[Entry]:
    driven_m = float(np.linalg.norm(np.diff(robot_m, axis=0), axis=1).sum())
    walked_m = sum(path.length_m for path in paths)
    entries = [
        Entry(f"paths  {walked_m:.0f} m", line_sign(GREY, PATH_PX)),
        Entry(f"path of the robot  {driven_m:.0f} m", line_sign(ROBOT, 2.7, 0.5)),
    ]
    stood = sum(len(path.points_m) == 1 for path in paths)
    if stood:
        entries.append(Entry(f"never moved  {stood}", mark_sign("disc", _DOT_PX, GREY)))
    if any(path.is_jump.any() for path in paths):
        entries.append(Entry("displaced", dashed_sign(GREY, 1.4, JUMP_PATTERN_PX)))
    return entries


def _title(result: SoakResult) -> str:
    minutes = result.verdict.artefact_s / 60.0
    verdict = "clean" if result.is_clean else "not clean"
    return f"{minutes:.0f} artefact-minutes, {counted(len(result.ways), 'artefact')}: {verdict}"


def _subtitle(result: SoakResult) -> list[str]:
    resolved = result.counts.moved_back + result.counts.displaced
    return [
        f"{result.simulated_s:.0f} s simulated",
        f"{counted(resolved, 'collision')} resolved",
        f"{counted(result.contacts, 'contact')} with the robot",
        f"{counted(result.blocked, 'arrival')} blocked",
        f"seed {result.seed}",
    ]


NUMBERS: Final = "soak.json"
PICTURE: Final = "soak.png"


def write_soak(result: SoakResult, grid: OccupancyGrid, folder: File) -> None:
    """Write numbers and picture into a folder, made if need be; InputError where that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(result.as_json(), indent=2)
        (folder / NUMBERS).write_text(text + "\n", encoding="utf-8")
        draw_soak(result, grid, folder / PICTURE)
    except OSError as cause:
        message = f"{folder}: the results cannot be written ({why_refused(cause)})"
        raise InputError(message) from cause
