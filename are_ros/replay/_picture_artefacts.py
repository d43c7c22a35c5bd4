"""The artefacts in the overview picture: oriented footprints in the colours of their classes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.draw.scene import Life

Floats = npt.NDArray[np.float64]

_KNOWN_CLASSES: Final[Mapping[str, str]] = {
    "person": "#d1495b",
    "car": "#6a4c93",
    "pallet": "#c9871f",
    "robot": "#2a9d8f",
    "structure": "#7d5a50",
}
_FURTHER: Final = ("#3a7d44", "#b5179e", "#8d99ae", "#e07a1f", "#5f0f40", "#606c38")
_SMALLEST_PT: Final = 7.0
_GONE_ALPHA: Final = 0.38


@dataclass(frozen=True, eq=False)
class Drawn:
    """A life as it ended: corners (4, 2) of its box and the middle of its front (2,) [m].

    `is_gone`: it left before the record ends.
    """

    life: Life
    centre_m: Floats
    corners_m: Floats
    front_m: Floats
    is_gone: bool


def class_colours(names: Sequence[str]) -> dict[str, str]:
    """Return a colour for each class; those of the shipped catalogue always have their own."""
    others = sorted(set(names) - set(_KNOWN_CLASSES))
    further = {name: _FURTHER[i % len(_FURTHER)] for i, name in enumerate(others)}
    return {**_KNOWN_CLASSES, **further}


def drawn_lives(lives: Sequence[Life], end_ns: int) -> list[Drawn]:
    """Return each life where it ended: at the end of the record, or where it left.

    On top are those still there, and of these and of the others those ever perceived.
    """
    drawn = [_drawn(life, end_ns) for life in lives if len(life.footprints)]
    return sorted(drawn, key=lambda item: (not item.is_gone, item.life.is_perceived))


def bounding_boxes(drawn: Sequence[Drawn]) -> Floats:
    """Return what the artefacts cover at most: left, bottom, right, top (N, 4) [m]."""
    boxes = [(*item.corners_m.min(axis=0), *item.corners_m.max(axis=0)) for item in drawn]
    return np.array(boxes, dtype=np.float64).reshape(-1, 4)


def draw_artefacts(
    axes: Any, drawn: Sequence[Drawn], colours: Mapping[str, str], points_per_m: float
) -> None:
    """Draw the footprints: filled if ever perceived, else hatched; pale are those that left."""
    from matplotlib.patches import Polygon

    for order, item in enumerate(drawn):
        colour, layer = colours[item.life.row.class_name], 4.0 + order * 1e-4
        look = _filled(colour) if item.life.is_perceived else _hatched(colour)
        look |= {"alpha": _GONE_ALPHA if item.is_gone else 1.0, "zorder": layer}
        if np.ptp(item.corners_m, axis=0).max() * points_per_m < _SMALLEST_PT:
            _draw_dot(axes, item, colour, layer)
            continue
        axes.add_patch(Polygon(item.corners_m, closed=True, **look))
        tick = np.array((item.centre_m, item.front_m))
        tick_colour = "white" if item.life.is_perceived else colour
        look = {"alpha": look["alpha"], "zorder": layer, "solid_capstyle": "butt"}
        axes.plot(*tick.T, color=tick_colour, lw=1.3, **look)


def is_gone(life: Life, end_ns: int) -> bool:
    """Say whether it left before the end; live, in the last second everybody has to."""
    return life.departure_ns is not None and life.departure_ns < end_ns - NS_PER_S


def _drawn(life: Life, end_ns: int) -> Drawn:
    x_m, y_m, yaw_rad = life.footprints.poses[-1].tolist()
    forward = np.array((np.cos(yaw_rad), np.sin(yaw_rad)))
    left = np.array((-forward[1], forward[0]))
    ahead, aside = 0.5 * life.row.size_m[0] * forward, 0.5 * life.row.size_m[1] * left
    centre = np.array((x_m, y_m))
    corners = centre + np.array((ahead + aside, aside - ahead, -ahead - aside, ahead - aside))
    return Drawn(life, centre, corners, centre + ahead, is_gone(life, end_ns))


def _filled(colour: str) -> dict[str, Any]:
    return {"facecolor": colour, "edgecolor": "white", "lw": 0.7}


def _hatched(colour: str) -> dict[str, Any]:
    return {"facecolor": "#ffffffd0", "edgecolor": colour, "lw": 1.0, "hatch": "/////"}


def _draw_dot(axes: Any, item: Drawn, colour: str, layer: float) -> None:
    """Draw what would be too small to be seen as a dot."""
    face = colour if item.life.is_perceived else "white"
    edge = "white" if item.life.is_perceived else colour
    look = {"markerfacecolor": face, "markeredgecolor": edge, "markeredgewidth": 0.9}
    alpha = _GONE_ALPHA if item.is_gone else 1.0
    axes.plot(*item.centre_m, "o", ms=_SMALLEST_PT - 1.0, alpha=alpha, zorder=layer, **look)
