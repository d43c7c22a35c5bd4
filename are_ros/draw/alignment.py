"""align.png: a map with laser scans where they are thought to belong."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.draw.canvas import Canvas
from are_ros.draw.map import View, draw_map, known_part, window_of
from are_ros.draw.palette import CONTACT, ROBOT, SERIES, Rgb
from are_ros.draw.sheet import Entry, Sheet, line_sign, mark_sign
from are_ros.world.occupancy_grid import OccupancyGrid

Floats = npt.NDArray[np.float64]

_NEAR: Final = SERIES[2]
_FAR: Final = SERIES[0]
_RIVALS: Final = (SERIES[5], CONTACT, SERIES[1])
_DOTS_PX: Final = (3.0, 3.0)


@dataclass(frozen=True, eq=False)
class PlacedScans:
    """Scans at a pose of the map: endpoints (N, 2), and where the laser was (M, 2) [m]."""

    endpoints_m: Floats
    places_m: Floats


def draw_alignment(
    grid: OccupancyGrid,
    placed: Sequence[PlacedScans],
    is_near: npt.NDArray[np.bool_],
    path: Path,
    *,
    near_m: float,
    title: str,
    subtitle: str,
) -> None:
    """Write the map with scans at their best pose, and at those that fit as well, as PNG.

    The best is the first of `placed`, whose endpoints lie near a wall or not, (N,), by `near_m`.
    The same input gives the same bytes. Raises OSError.
    """
    part = known_part(grid)
    rivals = [*zip(placed[1:], _RIVALS, strict=False)]
    window = window_of(grid, part, np.concatenate((np.empty((0, 2)), *_paths(placed))))
    sheet = Sheet.of(window, [_legend(placed, rivals, near_m)])
    canvas, view = sheet.canvas, sheet.view
    draw_map(canvas, view, grid, part)
    for scans, colour in reversed(rivals):
        _draw_dots(canvas, view, scans.endpoints_m, colour)
        for start, end in pairwise(view.pixels(scans.places_m)):
            canvas.dashes(start, end, colour, 1.3, pattern_px=_DOTS_PX)
    for scans in placed[:1]:
        _draw_dots(canvas, view, scans.endpoints_m[~is_near], _FAR)
        _draw_dots(canvas, view, scans.endpoints_m[is_near], _NEAR)
        points = view.pixels(scans.places_m)
        canvas.line(points, ROBOT, 2.0)
        canvas.mark("disc", points[0], 8.0, ROBOT, ROBOT)
    sheet.write(path, title, [subtitle])


def _paths(placed: Sequence[PlacedScans]) -> list[Floats]:
    return [scans.places_m for scans in placed]


def _draw_dots(canvas: Canvas, view: View, points_m: Floats, colour: Rgb) -> None:
    """Draw points (N, 2) as dots of a pixel and a half."""
    side, half = round(1.5 * canvas.fine), 0.75
    corners = np.rint((view.pixels(points_m) - half) * canvas.fine).astype(np.int64)
    height, width = canvas.pixels.shape[:2]
    for dx in range(side):
        for dy in range(side):
            x, y = np.add(corners, (dx, dy)).T
            inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
            canvas.pixels[y[inside], x[inside]] = colour


def _legend(
    placed: Sequence[PlacedScans], rivals: Sequence[tuple[PlacedScans, Rgb]], near_m: float
) -> list[Entry]:
    def dot(text: str, colour: Rgb) -> Entry:
        return Entry(text, mark_sign("disc", 6.0, colour, colour))

    if not placed:
        return []
    return [
        dot(f"endpoint within {near_m:g} m of a wall", _NEAR),
        dot("farther", _FAR),
        Entry("path of the laser", line_sign(ROBOT, 2.0)),
        *(dot("fits as well", colour) for _, colour in rivals),
    ]
