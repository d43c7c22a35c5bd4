"""soak.png: all ways of a soak on its map, drawn as the overview of a replay draws them."""

from collections import Counter
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.draw.scene import Doing, Life, Track
from are_ros.experiments.soak import SoakResult, Way
from are_ros.replay._picture_artefacts import class_colours
from are_ros.replay._picture_behaviours import behaviour_counts, behaviour_marks
from are_ros.replay._picture_frame import Sheet, draw_map, draw_surroundings
from are_ros.replay._picture_map import known_part, window_of
from are_ros.replay._picture_paths import Way as DrawnWay
from are_ros.replay._picture_paths import draw_ways
from are_ros.wording import counted
from are_ros.world.occupancy_grid import OccupancyGrid

Floats = npt.NDArray[np.float64]

_ROBOT: Final = "#2f7fc1"
_GREY: Final = "#6c757d"
_FEW_WAYS: Final = 60
"""Of more than these no arrowheads and no behaviours are drawn: nobody could tell them apart."""


def draw_soak(result: SoakResult, grid: OccupancyGrid, path: Path) -> None:
    """Write everybody's way on the known part of the map, in the colour of the class, as PNG.

    The robot's way lies below them. Settings of matplotlib in force change nothing.
    """
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams["font.family"] = "DejaVu Sans"
        figure = figure_of(result, grid)
        figure.savefig(path, format="png", metadata={"Software": None})


def figure_of(result: SoakResult, grid: OccupancyGrid) -> Any:
    """Return the figure."""
    ways = [_drawn(number, way) for number, way in sorted(result.ways.items())]
    lives = [way.life for way in ways]
    colours = class_colours([life.row.class_name for life in lives])
    marks = behaviour_marks([*behaviour_counts(lives)])
    robot_m = np.array(result.robot_way_m, dtype=np.float64).reshape(-1, 2)
    is_detailed = len(ways) <= _FEW_WAYS
    legends = [_classes(lives, colours), _behaviours(lives, marks) if is_detailed else []]
    legends.append(_others(ways, robot_m))
    part = known_part(grid)
    points_m = np.concatenate((robot_m, *(way.points_m for way in ways)))
    sheet = Sheet.of(window_of(grid, part, points_m), legends)
    draw_map(sheet, grid, part)
    sheet.axes.plot(*robot_m.T, color=_ROBOT, lw=1.2, alpha=0.35, zorder=3.0)
    draw_ways(sheet.axes, ways, colours, marks, sheet.points_per_m, is_detailed=is_detailed)
    _draw_standing(sheet.axes, ways, colours)
    draw_surroundings(sheet, _title(result), _subtitle(result), legends)
    return sheet.figure


def _drawn(number: int, way: Way) -> DrawnWay:
    """Return a way as the overview takes it: of a life that was in nobody's sight."""
    points_m = np.array(way.points_m, dtype=np.float64).reshape(-1, 2)
    poses = np.column_stack((points_m, np.zeros(len(points_m))))
    track = Track(np.arange(len(poses), dtype=np.int64), poses)
    doings = (Doing(0, way.behaviour, ""),)
    life = Life(number, way.row, 0, None, "", track, 0, None, None, doings=doings)
    is_jump = np.isin(np.arange(1, len(poses)), np.array(sorted(way.jumps), dtype=np.int64))
    return DrawnWay(life, points_m, np.zeros_like(is_jump), is_jump)


def _draw_standing(axes: Any, ways: list[DrawnWay], colours: dict[str, str]) -> None:
    """Mark who never moved by a dot."""
    for way in ways:
        if len(way.points_m) == 1:
            colour = colours[way.life.row.class_name]
            axes.plot(*way.points_m.T, ".", color=colour, ms=4.0, zorder=3.4)


def _classes(lives: list[Life], colours: dict[str, str]) -> list[Any]:
    from matplotlib.patches import Patch

    counts = Counter(life.row.class_name for life in lives)
    return [
        Patch(facecolor=colours[name], edgecolor="white", label=f"{name}  {counts[name]}")
        for name in sorted(counts)
    ]


def _behaviours(lives: list[Life], marks: dict[str, str]) -> list[Any]:
    from matplotlib.lines import Line2D

    look: dict[str, Any] = {
        "markerfacecolor": "white",
        "markeredgecolor": _GREY,
        "markeredgewidth": 1.1,
    }
    return [
        Line2D([], [], marker=marks[name], ls="none", ms=5.6, label=f"{name}  {count}", **look)
        for name, count in behaviour_counts(lives).items()
    ]


def _others(ways: list[DrawnWay], robot_m: Floats) -> list[Any]:
    from matplotlib.lines import Line2D

    driven_m = float(np.linalg.norm(np.diff(robot_m, axis=0), axis=1).sum())
    walked_m = sum(way.length_m for way in ways)
    handles = [
        Line2D([], [], color=_GREY, lw=1.1, label=f"ways  {walked_m:.0f} m"),
        Line2D(
            [], [], color=_ROBOT, lw=1.6, alpha=0.5, label=f"way of the robot  {driven_m:.0f} m"
        ),
    ]
    stood = sum(len(way.points_m) == 1 for way in ways)
    if stood:
        look: dict[str, Any] = {"color": _GREY, "ls": "none", "marker": "."}
        handles.append(Line2D([], [], label=f"never moved  {stood}", **look))
    if any(way.is_jump.any() for way in ways):
        handles.append(Line2D([], [], color=_GREY, lw=0.8, ls=":", label="displaced"))
    return handles


def _title(result: SoakResult) -> str:
    minutes = result.verdict.artefact_s / 60.0
    verdict = "clean" if result.is_clean else "not clean"
    return f"{minutes:.0f} artefact-minutes, {counted(len(result.ways), 'artefact')}: {verdict}"


def _subtitle(result: SoakResult) -> str:
    resolved = result.counts.moved_back + result.counts.displaced
    parts = [
        f"{result.simulated_s:.0f} s simulated",
        f"{counted(resolved, 'collision')} resolved",
        f"{counted(result.contacts, 'contact')} with the robot",
        f"{counted(result.blocked, 'arrival')} blocked",
        f"seed {result.seed}",
    ]
    return "   ·   ".join(parts)
