"""The results of a soak: soak.json, and soak.png with the ways of all artefacts."""

import json
from collections import Counter
from pathlib import Path

import numpy as np

from are_ros.draw.canvas import Canvas
from are_ros.draw.map import View, draw_map, known_part, window_of
from are_ros.draw.palette import ROBOT, Rgb, class_colours
from are_ros.draw.sheet import Entry, Sheet, line_sign, patch_sign
from are_ros.errors import InputError
from are_ros.lab.soak import SoakResult, Way
from are_ros.wording import counted, why_refused
from are_ros.world.occupancy_grid import OccupancyGrid

_WAY_PX, _ROBOT_PX, _DOT_PX = 1.4, 2.0, 4.0
_WAY_ALPHA, _ROBOT_ALPHA = 0.55, 0.35


def write_soak(result: SoakResult, grid: OccupancyGrid, folder: Path) -> None:
    """Write numbers and picture into a folder, made if need be; InputError where that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(result.as_json(), indent=2)
        (folder / "soak.json").write_text(text + "\n", encoding="utf-8")
        draw_soak(result, grid, folder / "soak.png")
    except OSError as cause:
        message = f"{folder}: the results cannot be written ({why_refused(cause)})"
        raise InputError(message) from cause


def draw_soak(result: SoakResult, grid: OccupancyGrid, path: Path) -> None:
    """Write the ways on the known part of the map, in the colours of the classes. OSError."""
    ways, robot_m = [*result.ways.values()], np.array(result.robot_way_m).reshape(-1, 2)
    classes = Counter(way.class_name for way in ways)
    colours, part = class_colours(sorted(classes)), known_part(grid)
    points_m = np.concatenate((robot_m, *(np.array(way.points_m) for way in ways)))
    entries = [
        Entry(f"{name}  {classes[name]}", patch_sign(colours[name])) for name in sorted(classes)
    ]
    robot = Entry("path of the robot", line_sign(ROBOT, _ROBOT_PX, _ROBOT_ALPHA))
    sheet = Sheet.of(window_of(grid, part, points_m), [[*entries, robot]])
    draw_map(sheet.canvas, sheet.view, grid, part)
    if len(robot_m) > 1:
        sheet.canvas.line(sheet.view.pixels(robot_m), ROBOT, _ROBOT_PX, _ROBOT_ALPHA)
    for way in ways:
        _draw_way(sheet.canvas, sheet.view, way, colours[way.class_name])
    minutes, verdict = result.verdict.artefact_s / 60.0, "clean" if result.is_clean else "not clean"
    title = f"{minutes:.0f} artefact-minutes, {counted(len(ways), 'artefact')}: {verdict}"
    contacts = f"{counted(result.contacts, 'contact')} with the robot"
    sheet.write(path, title, [f"{result.simulated_s:.0f} s simulated", contacts])


def _draw_way(canvas: Canvas, view: View, way: Way, colour: Rgb) -> None:
    """Draw a way, with gaps where the artefact was displaced; a dot if it never moved."""
    places_px = view.pixels(way.points_m)
    for stretch_px in np.split(places_px, sorted(way.jumps)):
        if len(stretch_px) > 1:
            canvas.line(stretch_px, colour, _WAY_PX, _WAY_ALPHA)
    if (np.ptp(places_px, axis=0) < _WAY_PX).all():
        canvas.mark("disc", places_px[0], _DOT_PX, colour, colour, 1.0)
