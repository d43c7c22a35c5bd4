"""The ways of the artefacts in the overview picture, from where they arrived to where they ended.

A way fades in from its beginning, is thick where the robot perceived its artefact, and has
arrowheads. The mark at its beginning tells the behaviour.
"""

import colorsys
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.events import ArtefactEvent, EventKind
from are_ros.draw.scene import Life
from are_ros.replay._picture_behaviours import behaviour_of
from are_ros.replay._picture_company import Company, positions_at

Floats = npt.NDArray[np.float64]
Rgb = tuple[float, float, float]

_FADE: Final = (0.25, 0.95)
_PALE_FADE: Final = (0.18, 0.75)
_PLAIN_LW, _SEEN_LW = 1.1, 2.6
_MOST_VERTICES: Final = 500
_CROWD: Final = 18
"""With more lives than this lines get thinner."""

_MOVED_M: Final = 0.3
_ARROW_EVERY_PT: Final = 62.0
_ARROW_PT: Final = 4.6
_MARK_PT: Final = 5.8
_RUNGS: Final = 6
_LONGEST_RUNG_M: Final = 2.2
_SHADES: Final = (0.0, 0.1, -0.1, 0.05, -0.06)


@dataclass(frozen=True, eq=False)
class Way:
    """Where an artefact went: points (N, 2) [m], which steps (N - 1,) were seen, which jumps."""

    life: Life
    points_m: Floats
    is_seen: npt.NDArray[np.bool_]
    is_jump: npt.NDArray[np.bool_]

    @property
    def length_m(self) -> float:
        """What it went on its own feet."""
        steps = np.linalg.norm(np.diff(self.points_m, axis=0), axis=1)
        return float(steps[~self.is_jump].sum())


def way_of(life: Life, moved_ns: Sequence[int]) -> Way:
    """Return the way of a life that has a pose; `moved_ns` are the stamps when it was displaced."""
    stamps, poses = life.footprints.stamps_ns, life.footprints.poses
    jumps: list[int] = np.searchsorted(stamps, np.array(moved_ns, dtype=np.int64)).tolist()
    count = len(stamps)
    every = max(1, math.ceil(count / _MOST_VERTICES))
    kept = np.unique((*range(0, count, every), count - 1, *_around(jumps, count))).astype(np.int64)
    is_jump = np.isin(kept[1:], np.array(jumps, dtype=np.int64))
    at = np.searchsorted(life.seen_ns, stamps[kept])
    is_seen = np.searchsorted(life.seen_ns, stamps[kept[1:]], side="right") > at[:-1]
    return Way(life, poses[kept, :2], is_seen, is_jump)


def displacements(events: Sequence[ArtefactEvent]) -> dict[int, list[int]]:
    """Return when each artefact was moved by the resolution of collisions."""
    moved: dict[int, list[int]] = {}
    for event in events:
        if event.kind is EventKind.DISPLACED:
            moved.setdefault(event.artefact_id, []).append(event.stamp_ns)
    return moved


def shade_of(colour: str, artefact_id: int) -> Rgb:
    """Return a class's colour, a little lighter or darker by the id, to tell ways apart."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    hue, light, saturation = colorsys.rgb_to_hls(red, green, blue)
    light = min(max(light + _SHADES[artefact_id % len(_SHADES)], 0.0), 1.0)
    return colorsys.hls_to_rgb(hue, light, saturation)


def draw_ways(
    axes: Any,
    ways: Sequence[Way],
    colours: Mapping[str, str],
    marks: Mapping[str, str],
    points_per_m: float,
    *,
    is_detailed: bool = True,
) -> None:
    """Draw all ways; those never perceived lie below the others, and are paler.

    Arrowheads, and marks where they begin, can be left out where there are too many.
    """
    thin = min(1.0, math.sqrt(_CROWD / max(len(ways), 1)))
    for way in sorted(ways, key=lambda way: way.life.is_perceived):
        colour = shade_of(colours[way.life.row.class_name], way.life.artefact_id)
        if way.length_m > _MOVED_M or way.is_jump.any():
            _draw_line(axes, way, colour, thin)
            if is_detailed:
                _draw_arrows(axes, way, colour, points_per_m)
        if is_detailed:
            _draw_mark(axes, way, colour, marks)


def draw_companies(axes: Any, found: Sequence[Company], colours: Mapping[str, str]) -> None:
    """Join followers and leaders by a few dotted rungs."""
    for company in found:
        stamps = company.instants(_RUNGS)
        behind, ahead = (positions_at(one, stamps) for one in (company.follower, company.leader))
        colour = shade_of(colours[company.follower.row.class_name], company.follower.artefact_id)
        near = np.linalg.norm(ahead - behind, axis=1) <= _LONGEST_RUNG_M
        for ends in np.stack((behind, ahead), axis=1)[near]:
            axes.plot(*ends.T, color=colour, lw=1.1, ls=(0, (1, 1.2)), alpha=0.9, zorder=3.55)


def _around(jumps: Sequence[int], count: int) -> list[int]:
    """Return the indices before and after each jump."""
    return [i for jump in jumps for i in (jump - 1, jump) if 0 <= i < count]


def _draw_line(axes: Any, way: Way, colour: Rgb, thin: float) -> None:
    from matplotlib.collections import LineCollection

    pieces = np.stack((way.points_m[:-1], way.points_m[1:]), axis=1)
    low, high = _FADE if way.life.is_perceived else _PALE_FADE
    alphas = np.linspace(low, high, len(pieces))
    rgba = np.column_stack((np.tile(colour, (len(pieces), 1)), alphas))
    widths = thin * np.where(way.is_seen, _SEEN_LW, _PLAIN_LW)
    walked = ~way.is_jump
    line = LineCollection(
        [*pieces[walked]], colors=rgba[walked], linewidths=widths[walked], zorder=3.5
    )
    line.set_capstyle("butt")
    axes.add_collection(line, autolim=False)
    for piece in pieces[way.is_jump]:
        axes.plot(*piece.T, color=colour, lw=0.8, ls=":", alpha=0.6, zorder=3.5)


def _draw_arrows(axes: Any, way: Way, colour: Rgb, points_per_m: float) -> None:
    """Set arrowheads at even distances along the way."""
    from matplotlib.patches import Polygon

    steps = np.diff(way.points_m, axis=0)
    lengths = np.where(way.is_jump, 0.0, np.linalg.norm(steps, axis=1))
    travelled = np.cumsum(lengths)
    spacing_m, size_m = _ARROW_EVERY_PT / points_per_m, _ARROW_PT / points_per_m
    places = np.arange(0.6 * spacing_m, travelled[-1], spacing_m)
    low, high = _FADE if way.life.is_perceived else _PALE_FADE
    for place in places.tolist():
        i = int(np.searchsorted(travelled, place))
        share = (place - (travelled[i] - lengths[i])) / lengths[i]
        tip = way.points_m[i] + share * steps[i]
        corners = tip + _head(steps[i] / lengths[i], size_m)
        alpha = low + (high - low) * place / travelled[-1]
        head = Polygon(corners, closed=True, fc=(*colour, alpha), lw=0, zorder=3.6)
        axes.add_patch(head)


def _head(forward: Floats, size_m: float) -> Floats:
    left = np.array((-forward[1], forward[0]))
    tips = ((0.75, 0.0), (-0.55, 0.52), (-0.25, 0.0), (-0.55, -0.52))
    return size_m * np.array([a * forward + b * left for a, b in tips])


def _draw_mark(axes: Any, way: Way, colour: Rgb, marks: Mapping[str, str]) -> None:
    """Mark the beginning of a way by what its artefact came to do."""
    behaviour = behaviour_of(way.life)
    alpha = 1.0 if way.life.is_perceived else 0.75
    look = {"markerfacecolor": "white", "markeredgecolor": colour, "markeredgewidth": 1.1}
    mark = marks.get(behaviour, "o")
    axes.plot(*way.points_m[0], marker=mark, ms=_MARK_PT, alpha=alpha, zorder=3.7, **look)
