"""What a soak leaves behind: soak.json, and soak.png with all ways on the map."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import InputError
from are_ros.experiments.soak import SoakResult, Way
from are_ros.world.occupancy_grid import OccupancyGrid

NUMBERS: Final = "soak.json"
PICTURE: Final = "soak.png"
_LONGEST_IN = 11.0
_DPI = 120
_THINNEST_PT, _WIDEST_PT = 0.15, 1.0
_FEW_WAYS = 40.0


def write_soak(result: SoakResult, grid: OccupancyGrid, folder: Path) -> None:
    """Write numbers and picture into a folder, made if need be; InputError where that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(result.as_json(), indent=2)
        (folder / NUMBERS).write_text(text + "\n", encoding="utf-8")
        draw_ways(result, grid, folder / PICTURE)
    except OSError as cause:
        reason = (cause.strerror or str(cause)).lower()
        raise InputError(f"{folder}: the results cannot be written ({reason})") from cause


def draw_ways(result: SoakResult, grid: OccupancyGrid, path: Path) -> None:
    """Draw everybody's way on the map, in a colour for each class, the robot's in black."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows, columns = grid.cells.shape
    inch = _LONGEST_IN / max(rows, columns)
    figure = Figure(figsize=(max(columns * inch, 3.0), max(rows * inch, 3.0) + 0.6), dpi=_DPI)
    FigureCanvasAgg(figure)
    axes: Any = figure.add_axes((0.02, 0.02, 0.96, 0.9))
    shades = np.where(grid.cells < 0, 205, np.where(grid.cells >= 50, 60, 250)).astype(np.uint8)
    axes.imshow(shades, cmap="gray", vmin=0, vmax=255, origin="lower", interpolation="nearest")
    width = min(_WIDEST_PT, max(_THINNEST_PT, _WIDEST_PT * _FEW_WAYS / max(len(result.ways), 1)))
    _draw_classes(axes, result.ways, grid, width)
    robot = _in_cells(np.array(result.robot_way_m).reshape(-1, 2), grid)
    axes.plot(*robot.T, color="black", lw=width, alpha=0.5, label="robot")
    axes.set_axis_off()
    axes.set_title(_title(result), fontsize=9, loc="left")
    for handle in axes.legend(loc="upper right", fontsize=8).legend_handles:
        handle.set_linewidth(2.0)
    figure.savefig(path, metadata={"Software": None})


def _draw_classes(axes: Any, ways: Mapping[int, Way], grid: OccupancyGrid, width_pt: float) -> None:
    """Draw the ways class by class; who never moved is a dot."""
    names = sorted({way.class_name for way in ways.values()})
    for k, name in enumerate(names):
        colour = f"C{k}"
        axes.plot([], [], color=colour, label=name)
        for way in ways.values():
            if way.class_name != name:
                continue
            points = _in_cells(np.array(way.points_m), grid)
            if len(points) == 1:
                axes.plot(*points.T, ".", color=colour, ms=2.0)
            for piece in np.split(points, sorted(way.jumps)):
                axes.plot(*piece.T, color=colour, lw=width_pt, alpha=0.6)


def _in_cells(points_m: npt.NDArray[np.float64], grid: OccupancyGrid) -> npt.NDArray[np.float64]:
    """Return points (N, 2) of the map frame as (column, row), cell centres at whole numbers."""
    x_m, y_m, _ = grid.origin.translation_m.tolist()
    yaw_rad = grid.origin.yaw_rad()
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    local_m: npt.NDArray[np.float64] = (points_m - (x_m, y_m)) @ np.array([(c, -s), (s, c)])
    return local_m / grid.resolution_m - 0.5


def _title(result: SoakResult) -> str:
    minutes = result.verdict.artefact_s / 60.0
    verdict = "clean" if result.is_clean else "not clean"
    return f"{minutes:.0f} artefact-minutes, {len(result.ways)} artefacts: {verdict}"
