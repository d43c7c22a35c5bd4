"""Where the artefacts of a population appeared, on the map, with the times (the Fig. 3b)."""

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.description.population_trial import Trial
from are_ros.description.site import Site, Survey
from are_ros.replay._picture_laws import FAINT_INK, INK, time_unit
from are_ros.replay._picture_map import (
    KnownPart,
    Window,
    known_part,
    map_from_part,
    shaded,
    window_of,
)
from are_ros.wording import counted

_TINT: Final = np.array((47, 93, 138))
_MOST_TINT: Final = 0.16
_GREY: Final = "#8b97a3"
_NARROWEST: Final = 0.55
_WIDEST: Final = 1.7

Image = npt.NDArray[np.uint8]


def shown_window(site: Site) -> Window:
    """Return the rectangle [m] that holds what is known of the site."""
    if site.survey is None:
        side_m = math.sqrt(site.area_m2)
        return Window(-0.02 * side_m, 1.02 * side_m, -0.02 * side_m, 1.02 * side_m)
    grid = site.survey.environment.grid
    return window_of(grid, known_part(grid), np.empty((0, 2)))


def shape_of(window: Window) -> float:
    """Return how wide the panel of a window is, as a part of its height, within reason."""
    return min(max(window.width_m / window.height_m, _NARROWEST), _WIDEST)


def draw_arrivals(axes: Any, trial: Trial, site: Site, end_s: float, colours: Any) -> None:
    """Draw all places where someone appeared, those until `end_s` in the colour of their time."""
    window = shown_window(site)
    axes.set(xlim=(window.left, window.right), ylim=(window.bottom, window.top), aspect="equal")
    if site.survey is not None:
        _draw_map(axes, site.survey, window)
    else:
        axes.set_facecolor(tuple((255 - _MOST_TINT * (255 - _TINT)) / 255))
    early = trial.placed_s <= end_s
    axes.plot(*trial.points_m.T, ".", ms=2.4, color=_GREY, alpha=0.55, mew=0, zorder=2)
    axes.scatter(
        *trial.points_m[early].T,
        c=colours(trial.placed_s[early] / end_s),
        s=26,
        edgecolors="white",
        linewidths=0.6,
        zorder=3,
    )
    axes.spines[:].set_color("#d3d7db")
    axes.tick_params(labelsize=8.5, colors=FAINT_INK, length=3)
    axes.set_title("arrivals in space", fontsize=10, color=INK, loc="left", weight="bold", pad=6)
    axes.set_xlabel(_caption(trial), fontsize=8.5, color=FAINT_INK)
    axes.set_anchor("N")
    _draw_times(axes.inset_axes((1.015, 0.0, 0.02, 1.0)), end_s, colours)


def _caption(trial: Trial) -> str:
    """Return how many appeared, and what can be said of where."""
    whose = "the first of each group" if trial.chain.is_grouped else "all"
    count = f"[m]   {counted(len(trial.points_m), 'place')}, of {whose} who appeared"
    return f"{count}; in colour: in the time shown"


def _draw_times(axes: Any, end_s: float, colours: Any) -> None:
    """Draw which colour is which time, as an upright bar."""
    unit_s, name = time_unit(end_s)
    shades = np.linspace(0.0, 1.0, 256)[:, np.newaxis]
    axes.imshow(
        shades, cmap=colours, aspect="auto", origin="lower", extent=(0.0, 1.0, 0.0, end_s / unit_s)
    )
    axes.set_xticks([])
    axes.yaxis.tick_right()
    axes.tick_params(labelsize=8.5, colors=FAINT_INK, length=3)
    axes.spines[:].set_visible(False)
    axes.set_title(f"[{name}]", fontsize=8.5, color=FAINT_INK, pad=4)


def _draw_map(axes: Any, survey: Survey, window: Window) -> None:
    from matplotlib.transforms import Affine2D

    grid = survey.environment.grid
    part = known_part(grid)
    box = axes.get_window_extent()
    points_per_m = min(box.width / window.width_m, box.height / window.height_m)
    points_per_m *= 72.0 / axes.figure.dpi
    image, factor = shaded(part, points_per_m * grid.resolution_m)
    image = _tinted(image, survey, part, factor)
    corners = map_from_part(grid, part, [(0, 0), (factor, 0), (0, factor)])
    (a, b), (c, d) = corners[1] - corners[0], corners[2] - corners[0]
    place = Affine2D.from_values(a, b, c, d, *corners[0])
    axes.imshow(
        image,
        origin="lower",
        extent=(0, image.shape[1], 0, image.shape[0]),
        transform=place + axes.transData,
        interpolation="nearest",
        zorder=0,
        aspect="equal",
    )
    axes.set(xlim=(window.left, window.right), ylim=(window.bottom, window.top))


def _tinted(image: Image, survey: Survey, part: KnownPart, factor: int) -> Image:
    """Return the image with the region in a colour, as strong as its weight."""
    weight = survey.region.mask if survey.region.weight is None else survey.region.weight
    height, width = part.cells.shape
    cut = weight[part.row0 : part.row0 + height, part.col0 : part.col0 + width]
    strength = np.zeros(image.shape[:2])
    picked = cut[::factor, ::factor].astype(np.float64)
    strength[: picked.shape[0], : picked.shape[1]] = picked
    strength *= _MOST_TINT / max(float(strength.max()), 1e-9)
    tinted = image.astype(np.float64)
    tinted[..., :3] += strength[..., np.newaxis] * (_TINT - tinted[..., :3])
    return np.rint(tinted).astype(np.uint8)
