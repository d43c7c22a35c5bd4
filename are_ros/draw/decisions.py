"""decisions.png: what a type of artefact would do on a map, at several remaining lives."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.describe.decisions import MOMENT_NS, BestMoves, JourneyValues, Lives
from are_ros.draw.map import Window, known_part, map_image, window_of
from are_ros.draw.palette import INK, LAW, WHITE, behaviour_colours, hex_of
from are_ros.draw.plots import (
    EDGE_HEX,
    INK_HEX,
    draw_colour_bar,
    name_axes,
    write_head,
    written_figure,
)
from are_ros.parameters.model import BehaviourParameters
from are_ros.population.catalogue import CatalogueRow
from are_ros.wording import listed, percent
from are_ros.world.occupancy_grid import OccupancyGrid

Floats = npt.NDArray[np.float64]

_WIDTH_IN: Final = 14.0
_COLUMNS: Final = 3
_MARGIN_IN: Final = 0.4
_HEAD_IN, _TITLE_IN, _FOOT_IN = 0.75, 0.34, 0.42
_BAR_IN: Final = 0.75
_GAP_IN: Final = 0.3
_HIGHEST_IN: Final = 6.0
_LOWEST_IN: Final = 2.2
_PX_PER_IN: Final = 240.0
_ARROWS_APART_IN: Final = 0.17
_FIELD: Final = ("#5d7fae", "#86a9c9", "#b3d0d8", "#dfeacb", "#fdf1b4")
"""From the least value to the greatest: dark arrows stand out on all of them."""
_LEAST_QUANTILE: Final = 0.03
_WALKS, _RUNS = hex_of(INK), hex_of(LAW)
_HEADINGS: Final = np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
_SINCE: Final = "time since the arrival [s]"
_LEGEND_SHARE: Final = 0.43


def draw_decisions(
    row: CatalogueRow,
    settings: BehaviourParameters,
    grid: OccupancyGrid,
    journey: JourneyValues,
    lives: Lives,
    path: Path,
) -> None:
    """Write the picture as PNG; the same input gives the same bytes. Raises OSError.

    The values and the best moves at each remaining life; the ways of the simulated artefacts; and
    the shares of their behaviours over their lives, beside those of the catalogue.
    """
    window = window_of(grid, known_part(grid), np.empty((0, 2)))
    sheet = _Sheet(len(journey.horizons) + 2, window.width_m / window.height_m)
    floor = map_image(grid, window, sheet.map_in[0] * _PX_PER_IN / window.width_m)
    with written_figure(path, sheet.size_in) as figure:
        _write_title(figure, row, settings, journey)
        limits = value_range([journey])
        for k, best in enumerate(journey.horizons):
            axes = map_axes(figure, sheet.map_at(k), window, floor)
            draw_values(axes, grid, journey, best, limits)
            name_map(axes, _field_title(journey, best))
        draw_scale(figure.add_axes(sheet.bar), limits)
        below = map_axes(figure, sheet.map_at(len(journey.horizons)), window, floor)
        draw_ways(below, lives)
        name_map(below, f"where {len(lives.ways)} artefacts went, and what they did")
        shares = figure.add_axes(sheet.plot)
        draw_shares(shares, lives)
        name_axes(shares, "behaviours; dashed: the catalogue", _SINCE, "share")


class _Sheet:
    """Where the maps and the plot are: in rows of three, each in a place of the same size."""

    def __init__(self, count: int, shape: float) -> None:
        inner_in = _WIDTH_IN - 2.0 * _MARGIN_IN - _BAR_IN - (_COLUMNS - 1) * _GAP_IN
        self._place_in = inner_in / _COLUMNS
        height_in = max(_LOWEST_IN, min(_HIGHEST_IN, self._place_in / shape))
        self.map_in = (min(self._place_in, height_in * shape), height_in)
        self._row_in = _TITLE_IN + height_in + _FOOT_IN
        rows = math.ceil(count / _COLUMNS)
        self._count = count
        self.size_in = (_WIDTH_IN, _HEAD_IN + rows * self._row_in)

    def map_at(self, k: int) -> tuple[float, float, float, float]:
        """Return left, bottom, width and height of the k-th map, as shares of the figure."""
        return self._box(k, 0.0, *self.map_in)

    @property
    def plot(self) -> tuple[float, float, float, float]:
        """The place of the plot, the last one."""
        width_in = (1.0 - _LEGEND_SHARE) * (self._place_in + _BAR_IN)
        return self._box(self._count - 1, 0.3, width_in, self.map_in[1])

    @property
    def bar(self) -> tuple[float, float, float, float]:
        """The place of the scale, beside the maps of the first row."""
        return self._box(_COLUMNS - 1, self.map_in[0] + 0.5 * _GAP_IN, 0.12, self.map_in[1])

    def _box(
        self, k: int, aside_in: float, width_in: float, height_in: float
    ) -> tuple[float, float, float, float]:
        row, column = divmod(k, _COLUMNS)
        left_in = _MARGIN_IN + column * (self._place_in + _GAP_IN) + aside_in
        bottom_in = self.size_in[1] - _HEAD_IN - row * self._row_in - _TITLE_IN - height_in
        width, height = self.size_in
        return left_in / width, bottom_in / height, width_in / width, height_in / height


def _write_title(
    figure: Any, row: CatalogueRow, settings: BehaviourParameters, journey: JourneyValues
) -> None:
    """Write who decides, by which numbers, and what the signs on the maps mean."""
    model = journey.model
    reach_m = [reach * journey.coarse.cell_size_m for reach in model.reaches]
    subtitle = [
        f"goes {listed([f'{reach:g}' for reach in reach_m])} m in {settings.decision_period:g} s",
        f"slip {model.slip:g}",
        f"temperature {settings.temperature:g}",
        f"persistence {settings.persistence:g} s",
        f"horizon {journey.horizons[-1].left_s:g} s",
    ]
    write_head(figure, _MARGIN_IN, f"What {row.label} would do on this map", subtitle)
    draw_signs(figure, runs=len(model.reaches) > 1)


def draw_signs(figure: Any, *, runs: bool) -> None:
    """Write what the signs on the maps mean, in the upper right corner."""
    from matplotlib.lines import Line2D

    look: dict[str, Any] = {"ls": "none", "mew": 0}
    signs = [
        Line2D([], [], marker="*", ms=13, color=_WALKS, label="goal", **look),
        Line2D([], [], marker=r"$\rightarrow$", ms=13, color=_WALKS, label="best: go", **look),
    ]
    if runs:
        signs[-1].set_label("best: walk")
        run = Line2D([], [], marker=r"$\rightarrow$", ms=13, color=_RUNS, label="best: run", **look)
        signs.append(run)
    signs.append(Line2D([], [], marker="o", ms=3.5, color=_WALKS, label="best: stay", **look))
    width, height = figure.get_size_inches()
    place = (1.0 - _MARGIN_IN / width, 1.0 - 0.12 / height)
    figure.legend(
        handles=signs,
        loc="upper right",
        bbox_to_anchor=place,
        ncols=len(signs),
        frameon=False,
        fontsize=9.5,
        labelcolor=INK_HEX,
        handletextpad=0.3,
        columnspacing=1.4,
    )


def map_axes(
    figure: Any, place: tuple[float, float, float, float], window: Window, floor: Any
) -> Any:
    """Return axes with the map in metres."""
    axes = figure.add_axes(place)
    extent = (window.left, window.right, window.bottom, window.top)
    axes.imshow(floor, extent=extent, zorder=0)
    axes.set(xlim=extent[:2], ylim=extent[2:], aspect="equal", anchor="N")
    return axes


def name_map(axes: Any, title: str) -> None:
    """Write the title of a map and its unit, and draw a line around it."""
    name_axes(axes, title, "[m]")
    axes.xaxis.labelpad = 0.0
    axes.spines[:].set_visible(True)
    axes.spines[:].set_color(EDGE_HEX)
    axes.tick_params(labelsize=7.5)


def _field_title(journey: JourneyValues, best: BestMoves) -> str:
    """Return how much of the life is left, and where the best move is to run."""
    title = f"{best.left_s:g} s left"
    if best is journey.horizons[-1]:
        title += " or more"
    if len(journey.model.reaches) > 1:
        title += f": best to run on {100.0 * best.running_share:.0f} % of the floor"
    return title


def value_range(journeys: Sequence[JourneyValues]) -> tuple[float, float]:
    """Return the least and the greatest value shown; some far cells may be below."""
    everything = [best.values.ravel() for one in journeys for best in one.horizons]
    values = np.concatenate(everything)
    values = values[np.isfinite(values)]
    return float(np.quantile(values, _LEAST_QUANTILE)), float(values.max())


def _colours() -> Any:
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("values", _FIELD)


def draw_values(
    axes: Any,
    grid: OccupancyGrid,
    journey: JourneyValues,
    best: BestMoves,
    limits: tuple[float, float],
) -> None:
    """Draw values as colours, from the least to the greatest of the limits, and the best moves."""
    _draw_field(axes, grid, journey, best, limits)
    width_in = axes.get_position().width * axes.figure.get_size_inches()[0]
    left, right = axes.get_xlim()
    _draw_moves(axes, journey, best, _ARROWS_APART_IN * (right - left) / width_in)


def _draw_field(
    axes: Any,
    grid: OccupancyGrid,
    journey: JourneyValues,
    best: BestMoves,
    limits: tuple[float, float],
) -> None:
    """Colour the free floor of each coarse cell by its value."""
    from matplotlib.transforms import Affine2D

    coarse, least = journey.coarse, limits[0]
    side = round(coarse.cell_size_m / grid.resolution_m)
    shares = np.clip((best.values - least) / max(limits[1] - least, 1e-9), 0.0, 1.0)
    height, width = grid.cells.shape
    of_cells = np.repeat(np.repeat(shares, side, axis=0), side, axis=1)[:height, :width]
    image = _colours()(np.nan_to_num(of_cells))
    image[..., 3] = np.isfinite(of_cells) & (grid.cells == 0)
    flat = grid.origin.matrix()[np.ix_((0, 1, 3), (0, 1, 3))]
    extent = (0.0, width * grid.resolution_m, 0.0, height * grid.resolution_m)
    limits_now = axes.get_xlim(), axes.get_ylim()
    place = Affine2D(flat) + axes.transData
    axes.imshow(image, extent=extent, origin="lower", transform=place, zorder=1)
    axes.set(xlim=limits_now[0], ylim=limits_now[1])


def _draw_moves(axes: Any, journey: JourneyValues, best: BestMoves, apart_m: float) -> None:
    """Draw the best moves as arrows, in some of the cells, and the goal."""
    coarse = journey.coarse
    every = max(1, math.ceil(apart_m / coarse.cell_size_m))
    rows, cols = np.nonzero(best.moves >= 0)
    goal = coarse.cell_of(*journey.goal_m) or (-1, -1)
    shown = (rows % every == 0) & (cols % every == 0) & ~((rows == goal[0]) & (cols == goal[1]))
    cells = rows[shown], cols[shown]
    points_m, moves, paces = coarse.anchors_m[cells], best.moves[cells], best.paces[cells]
    length_m = 0.8 * every * coarse.cell_size_m
    turned = _HEADINGS @ coarse.grid.origin.matrix()[:2, :2].T * length_m
    for pace, colour in ((0, _WALKS), (1, _RUNS)):
        going = (moves > 0) & (paces == pace)
        steps = turned[moves[going] - 1]
        starts = points_m[going] - 0.5 * steps
        look = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.0032}
        axes.quiver(*starts.T, *steps.T, color=colour, headwidth=4.2, zorder=3, **look)
    axes.plot(*points_m[moves == 0].T, "o", ms=2.4, mew=0, color=_WALKS, zorder=3)
    axes.plot(*journey.goal_m, "*", ms=15, color=_WALKS, mec=hex_of(WHITE), mew=0.8, zorder=4)


def draw_scale(axes: Any, limits: tuple[float, float]) -> None:
    """Draw which colour is which value."""
    draw_colour_bar(axes, _colours(), limits, "value V")


def draw_ways(axes: Any, lives: Lives) -> None:
    """Draw each way in the colours of the behaviours on it, with a dot where it begins."""
    from matplotlib.collections import LineCollection

    colours = behaviour_colours(list(lives.catalogue))
    for way in lives.ways:
        shades = [hex_of(colours[name]) for name in way.behaviours]
        steps: Any = np.stack((way.points_m[:-1], way.points_m[1:]), axis=1)
        look = {"linewidths": 1.1, "alpha": 0.8}
        axes.add_collection(LineCollection(steps, colors=shades[:-1], zorder=2, **look))
    starts = np.array([way.points_m[0] for way in lives.ways])
    first = [hex_of(colours[way.behaviours[0]]) for way in lives.ways]
    axes.scatter(*starts.T, s=20, c=first, edgecolors="white", linewidths=0.7, zorder=3)


def draw_shares(axes: Any, lives: Lives) -> None:
    """Draw the shares of the behaviours, one above the other, and the catalogue's bounds."""
    names, shares = list(lives.catalogue), lives.shares_over_time
    order = sorted(range(len(names)), key=lambda k: -lives.catalogue[names[k]])
    colours, realised = behaviour_colours(names), lives.shares
    times_s = MOMENT_NS / NS_PER_S * np.arange(shares.shape[1])
    shades = [hex_of(colours[names[k]]) for k in order]
    labels = [
        f"{names[k]}  {percent(realised[names[k]])}  ({percent(lives.catalogue[names[k]])})"
        for k in order
    ]
    axes.stackplot(times_s, shares[order], colors=shades, labels=labels, lw=0)
    for bound in np.cumsum([lives.catalogue[names[k]] for k in order])[:-1]:
        axes.axhline(bound, color=INK_HEX, lw=1.0, ls=(0, (4, 3)))
    axes.set(xlim=(0.0, times_s[-1]), ylim=(0.0, 1.0))
    handles, texts = axes.get_legend_handles_labels()
    axes.legend(
        handles[::-1],
        texts[::-1],
        loc="upper left",
        bbox_to_anchor=(1.01, 1.02),
        frameon=False,
        fontsize=8.5,
        labelcolor=INK_HEX,
        handlelength=1.0,
        handleheight=1.0,
        title="share of the time (catalogue)",
        title_fontsize=8.5,
        alignment="left",
    )
