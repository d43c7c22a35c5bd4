"""What surrounds the map in the overview picture: title, legend, time and scale."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from are_ros.builder.events import EventKind
from are_ros.conventions import NS_PER_S
from are_ros.draw.scene import SceneRecord
from are_ros.replay._picture_map import KnownPart, Window, map_from_part, shaded
from are_ros.replay._picture_robot import time_colours
from are_ros.replay.output_folder import METRICS
from are_ros.wording import counted
from are_ros.world.occupancy_grid import OccupancyGrid

_LARGEST_IN: Final = (11.5, 8.5)
_SMALLEST_IN: Final = (7.6, 2.6)
_MARGIN_IN: Final = 0.22
_HEADER_IN: Final = 0.82
_FOOTER_IN: Final = 0.74
_ROW_IN: Final = 0.2
_TIME_BAR_IN: Final = 2.2
_DPI: Final = 120
_PAPER: Final = "#eceef0"
_INK: Final = "#23282e"
_FAINT_INK: Final = "#66707a"


@dataclass(frozen=True, eq=False)
class Sheet:
    """The figure, the axes of the map on it, what they show, and points (1/72 inch) per metre.

    `footer_in` is the height of the strip below the map, in inches.
    """

    figure: Any
    axes: Any
    window: Window
    points_per_m: float
    footer_in: float

    @classmethod
    def of(cls, window: Window, legends: Sequence[Sequence[Any]] = ()) -> "Sheet":
        """Lay out a sheet as large as the window's shape asks for, with room for the legends."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        scale = min(_LARGEST_IN[0] / window.width_m, _LARGEST_IN[1] / window.height_m)
        width = max(_SMALLEST_IN[0], window.width_m * scale)
        height = max(_SMALLEST_IN[1], window.height_m * scale)
        rows = sum(len(legend_rows(legend, width + 2 * _MARGIN_IN)) for legend in legends)
        footer = max(_FOOTER_IN, 0.16 + _ROW_IN * rows)
        sides = (width + 2 * _MARGIN_IN, height + _HEADER_IN + footer)
        figure = Figure(figsize=sides, dpi=_DPI, facecolor="white")
        FigureCanvasAgg(figure)
        place = (_MARGIN_IN / sides[0], footer / sides[1], width / sides[0], height / sides[1])
        axes = figure.add_axes(place, facecolor=_PAPER, xticks=[], yticks=[])
        axes.spines[:].set_color("#d3d7db")
        middle = (0.5 * (window.left + window.right), 0.5 * (window.bottom + window.top))
        half_m = (0.5 * width / scale, 0.5 * height / scale)
        shown = Window(
            middle[0] - half_m[0],
            middle[0] + half_m[0],
            middle[1] - half_m[1],
            middle[1] + half_m[1],
        )
        axes.set(xlim=(shown.left, shown.right), ylim=(shown.bottom, shown.top), autoscale_on=False)
        return cls(figure, axes, shown, scale * 72.0, footer)


def draw_map(sheet: Sheet, grid: OccupancyGrid, part: KnownPart) -> None:
    """Draw the known part of a map."""
    from matplotlib.transforms import Affine2D

    image, factor = shaded(part, sheet.points_per_m * grid.resolution_m)
    corners = map_from_part(grid, part, [(0, 0), (factor, 0), (0, factor)])
    (a, b), (c, d) = corners[1] - corners[0], corners[2] - corners[0]
    place = Affine2D.from_values(a, b, c, d, *corners[0])
    height, width = image.shape[:2]
    sheet.axes.imshow(
        image,
        origin="lower",
        extent=(0, width, 0, height),
        transform=place + sheet.axes.transData,
        interpolation="nearest",
        zorder=0,
        aspect="auto",
    )


def draw_frame(
    sheet: Sheet,
    record: SceneRecord,
    legends: Sequence[Sequence[Any]],
    *,
    without_id: int = 0,
    ids_as_in: str,
) -> None:
    """Write title and legends around the map, and the scale of length and of time.

    `without_id` artefacts have no id beside them, for want of room; `ids_as_in` is where a reader
    finds ids again.
    """
    draw_surroundings(sheet, _title(record), _subtitle(record, without_id, ids_as_in), legends)
    if len(record.robot):
        _draw_time(sheet, record)


def draw_surroundings(
    sheet: Sheet, title: str, subtitle: str, legends: Sequence[Sequence[Any]]
) -> None:
    """Write title and legends around the map, and the scale of length into it."""
    width_in, height_in = sheet.figure.get_size_inches()
    left, top = _MARGIN_IN / width_in, 1.0 - 0.16 / height_in
    sheet.figure.text(left, top, title, size=15, weight="bold", color=_INK, va="top")
    below = top - 0.34 / height_in
    sheet.figure.text(left, below, subtitle, size=9, color=_FAINT_INK, va="top")
    top_in = sheet.footer_in - 0.06
    for row in (row for legend in legends for row in legend_rows(legend, width_in)):
        _add_legend(sheet, row, top_in)
        top_in -= _ROW_IN
    _draw_scale(sheet)


def _title(record: SceneRecord) -> str:
    arrived = record.metrics.arrivals if record.metrics else 0
    perceived = sum(life.is_perceived for life in record.lives)
    return f"{counted(arrived, 'virtual artefact')} arrived, {perceived} perceived"


def _subtitle(record: SceneRecord, without_id: int, ids_as_in: str = METRICS) -> str:
    steps = np.diff(record.robot.poses[:, :2], axis=0)
    is_driven = np.diff(record.robot.drives()) == 0
    driven_m = float(np.linalg.norm(steps[is_driven], axis=1).sum())
    counts = Counter(event.kind for event in record.events)
    blocked = counts[EventKind.BLOCKED]
    ids = f"numbers are ids, as in {ids_as_in}"
    if without_id:
        ids += f"; {counted(without_id, 'number')} left out for want of room"
    parts = [
        f"{record.duration_ns / NS_PER_S:.0f} s",
        f"robot drove {driven_m:.1f} m" if len(record.robot) else "no pose of the robot",
        f"{counted(blocked, 'arrival')} blocked" if blocked else "",
        f"seed {record.seed}",
        ids if record.lives else "",
    ]
    return "   ·   ".join(part for part in parts if part)


def legend_rows(handles: Sequence[Any], width_in: float) -> list[list[Any]]:
    """Return the handles in rows that fit beside the bar of time, by the length of their texts."""
    rows: list[list[Any]] = []
    used_in = math.inf
    for handle in handles:
        needed_in = 0.46 + 0.064 * len(handle.get_label())
        if used_in + needed_in > width_in - _TIME_BAR_IN:
            rows.append([])
            used_in = 0.0
        rows[-1].append(handle)
        used_in += needed_in
    return rows


def _add_legend(sheet: Sheet, handles: Sequence[Any], top_in: float) -> None:
    """Add a row of a legend whose upper edge is so high above the sheet's edge."""
    width_in, height_in = sheet.figure.get_size_inches()
    sheet.figure.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=((_MARGIN_IN - 0.06) / width_in, top_in / height_in),
        ncol=len(handles),
        frameon=False,
        fontsize=8.5,
        labelcolor=_INK,
        columnspacing=1.3,
        handlelength=1.5,
        borderpad=0.1,
    )


def _draw_time(sheet: Sheet, record: SceneRecord) -> None:
    """Draw the colours of the path as a bar from the first second to the last."""
    width_in, height_in = sheet.figure.get_size_inches()
    length = 1.6
    left = (width_in - _MARGIN_IN - length) / width_in
    place = (left, (sheet.footer_in - 0.36) / height_in, length / width_in, 0.09 / height_in)
    axes = sheet.figure.add_axes(place, yticks=[])
    colours = np.linspace(0.0, 1.0, 256)[np.newaxis]
    end_s = record.duration_ns / NS_PER_S
    axes.imshow(colours, cmap=time_colours(), aspect="auto", extent=(0.0, 1.0, 0.0, 1.0))
    axes.set_xticks([])
    axes.text(0.0, -0.6, "0 s", fontsize=8, color=_INK, va="top")
    axes.text(1.0, -0.6, f"{end_s:.0f} s", fontsize=8, color=_INK, va="top", ha="right")
    axes.spines[:].set_visible(False)
    axes.set_title("path of the robot", fontsize=8.5, color=_INK, pad=4)


def _draw_scale(sheet: Sheet) -> None:
    """Draw a bar of a round length into the lower left corner of the map."""
    from matplotlib.patches import FancyBboxPatch

    window, point_m = sheet.window, 1.0 / sheet.points_per_m
    length_m = _round_length_m(0.18 * window.width_m)
    left, bottom = window.left + 14 * point_m, window.bottom + 14 * point_m
    size = (length_m, 11 * point_m)
    style = f"round,pad={5 * point_m}"
    box = FancyBboxPatch((left, bottom), *size, boxstyle=style, fc="white", ec="none", alpha=0.8)
    box.set_zorder(9)
    sheet.axes.add_patch(box)
    ends = ((left, left, left + length_m, left + length_m), _bracket(bottom, point_m))
    sheet.axes.plot(*ends, color=_INK, lw=1.2, zorder=9.1)
    middle = (left + 0.5 * length_m, bottom + 7.5 * point_m)
    text = f"{length_m:g} m"
    sheet.axes.text(*middle, text, fontsize=8, color=_INK, ha="center", va="center", zorder=9.1)


def _bracket(bottom: float, point_m: float) -> tuple[float, float, float, float]:
    return (bottom + 3.0 * point_m, bottom, bottom, bottom + 3.0 * point_m)


def _round_length_m(longest_m: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not longer."""
    power = 10.0 ** math.floor(math.log10(longest_m))
    return max(step * power for step in (1, 2, 5) if step * power <= longest_m * 1.000001)
