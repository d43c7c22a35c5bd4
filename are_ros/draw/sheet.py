"""What surrounds a map in a picture: title, legend, scales; and the labels written on it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.draw.canvas import Canvas, Rectangle, text_size
from are_ros.draw.map import View, Window
from are_ros.draw.palette import FAINT_INK, GREY, INK, PAPER, WHITE, Rgb, time_colour
from are_ros.population.scenario import FIRST_ADMITTED_ID

Floats = npt.NDArray[np.float64]

_LARGEST_PX: Final = (1380.0, 1020.0)
_SMALLEST_PX: Final = (912.0, 312.0)
_MARGIN_PX: Final = 26
_HEADER_PX: Final = 98
_FOOTER_PX: Final = 86
_ROW_PX: Final = 25
_TIME_BAR_PX: Final = 264
_FINE: Final = 2
_TITLE_PX, _SUBTITLE_PX, _LEGEND_PX = 25, 15, 14
_SUBTITLE_ROW_PX: Final = 19
_SEPARATOR: Final = "   ·   "

SIGN_PX: Final = 20
"""A legend's sign is so wide at most, and as high as the text."""
_SIGN_GAP_PX: Final = 7
_ENTRY_GAP_PX: Final = 20

Sign = Callable[[Canvas, float, float], None]
"""Draws a sign on a canvas, from its left edge on, about a height."""


class Entry(NamedTuple):
    """What a sign means."""

    name: str
    sign: Sign

    def width_px(self, text_px: int) -> int:
        """Return how wide sign and name are, without the gap behind them."""
        return SIGN_PX + _SIGN_GAP_PX + text_size(self.name, text_px)[0]


def patch_sign(colour: Rgb, alpha: float = 1.0) -> Sign:
    """Return the sign of what is filled."""
    return lambda canvas, x, y: canvas.fill(_box(x, y), colour, alpha)


def line_sign(colour: Rgb, width_px: float, alpha: float = 1.0) -> Sign:
    """Return the sign of a line."""
    return lambda canvas, x, y: canvas.line(_level(x, y), colour, width_px, alpha)


def dashed_sign(colour: Rgb, width_px: float) -> Sign:
    """Return the sign of a dashed line."""

    def draw(canvas: Canvas, x: float, y: float) -> None:
        start_px, end_px = _level(x, y)
        canvas.dashes(start_px, end_px, colour, width_px)

    return draw


def mark_sign(
    name: str, size_px: float, face: Rgb = WHITE, edge: Rgb = GREY, edge_px: float = 1.4
) -> Sign:
    """Return the sign of a mark."""
    return lambda canvas, x, y: canvas.mark(
        name, np.array((x + 0.5 * SIGN_PX, y)), size_px, face, edge, edge_px
    )


def ring_sign(colour: Rgb, width_px: float) -> Sign:
    """Return the sign of an open circle."""
    return lambda canvas, x, y: canvas.ring(np.array((x + 0.5 * SIGN_PX, y)), 5.5, colour, width_px)


def robot_sign(colour: Rgb) -> Sign:
    """Return the sign of the robot, a disc that looks to the right."""

    def draw(canvas: Canvas, x: float, y: float) -> None:
        centre = np.array((x + 0.5 * SIGN_PX, y))
        canvas.ring(centre, 6.0, colour, 2)
        canvas.line(np.array((centre, np.add(centre, (6.0, 0.0)))), colour)

    return draw


def rows_of(entries: Sequence[Entry], width_px: float, text_px: int) -> list[list[Entry]]:
    """Return the entries in rows that are at most so wide, by the length of their texts."""
    rows: list[list[Entry]] = []
    used = math.inf
    for entry in entries:
        needed = entry.width_px(text_px)
        if used + needed > width_px:
            rows.append([])
            used = 0.0
        rows[-1].append(entry)
        used += needed + _ENTRY_GAP_PX
    return rows


def row_width_px(entries: Sequence[Entry], text_px: int) -> int:
    """Return how wide a row is."""
    gaps = _ENTRY_GAP_PX * max(len(entries) - 1, 0)
    return sum(entry.width_px(text_px) for entry in entries) + gaps


def draw_row(
    canvas: Canvas, entries: Sequence[Entry], place_px: tuple[float, float], text_px: int
) -> None:
    """Draw entries beside each other, from a left edge and about a height on."""
    x, y = place_px
    for entry in entries:
        entry.sign(canvas, x, y)
        at = (x + SIGN_PX + _SIGN_GAP_PX, y)
        canvas.text(entry.name, at, text_px, anchor=(0.0, 0.5), halo=False)
        x += entry.width_px(text_px) + _ENTRY_GAP_PX


def lines_of(parts: Sequence[str], width_px: float) -> list[str]:
    """Return a subtitle's parts in lines of at most a width; one that is wider has its own line."""
    lines: list[str] = []
    for part in parts:
        longer = _SEPARATOR.join((*lines[-1:], part))
        if lines and text_size(longer, _SUBTITLE_PX)[0] <= width_px:
            lines[-1] = longer
        else:
            lines.append(part)
    return lines


@dataclass(frozen=True, eq=False)
class Sheet:
    """A canvas with a window on the map; above it a title, below it the rows of the legend."""

    canvas: Canvas
    view: View
    rows: tuple[tuple[Entry, ...], ...]

    @classmethod
    def of(cls, window: Window, legends: Sequence[Sequence[Entry]]) -> "Sheet":
        """Lay out a sheet as large as the window's shape asks for, with room for the legends.

        Each of the legends begins a row.
        """
        px_per_m = min(_LARGEST_PX[0] / window.width_m, _LARGEST_PX[1] / window.height_m)
        width = max(_SMALLEST_PX[0], round(window.width_m * px_per_m))
        height = max(_SMALLEST_PX[1], round(window.height_m * px_per_m))
        room = width - _TIME_BAR_PX
        rows = [tuple(row) for legend in legends for row in rows_of(legend, room, _LEGEND_PX)]
        footer = max(_FOOTER_PX, 22 + _ROW_PX * len(rows))
        size = (round(width) + 2 * _MARGIN_PX, round(height) + _HEADER_PX + footer)
        canvas = Canvas(size, _FINE)
        shown = _widened(window, width / px_per_m, height / px_per_m)
        view = View(shown, px_per_m, _MARGIN_PX, _HEADER_PX)
        left, top, right, bottom = view.rectangle
        corners = ((left, top), (right, top), (right, bottom), (left, bottom))
        canvas.fill(np.array(corners), PAPER)
        return cls(canvas, view, tuple(rows))

    def write(
        self, path: Path, title: str, subtitle: Sequence[str], duration_s: float | None = None
    ) -> None:
        """Draw what surrounds the map and write the picture as PNG; the same gives the same bytes.

        The parts of the subtitle that are empty are left out. With a duration, the colours of the
        robot's path are explained. Raises OSError.
        """
        from PIL import Image

        self._draw_surroundings(title, [part for part in subtitle if part])
        if duration_s is not None:
            self._draw_time(duration_s)
        Image.fromarray(self.canvas.finished()).save(path, "PNG", optimize=False, compress_level=6)

    def _draw_surroundings(self, title: str, parts: Sequence[str]) -> None:
        canvas, (left, _, right, bottom) = self.canvas, self.view.rectangle
        canvas.keep_only(self.view.rectangle)
        canvas.frame(self.view.rectangle)
        canvas.text(title, (left, 14), _TITLE_PX, bold=True, halo=False)
        for number, line in enumerate(lines_of(parts, right - left)):
            top = 56 + _SUBTITLE_ROW_PX * number
            canvas.text(line, (left, top), _SUBTITLE_PX, FAINT_INK, halo=False)
        for number, row in enumerate(self.rows):
            draw_row(canvas, row, (left, bottom + 22 + _ROW_PX * number), _LEGEND_PX)
        self._draw_scale()

    def _draw_time(self, duration_s: float) -> None:
        """Draw the colours of the robot's path as a bar from the first second to the last."""
        right, bottom = self.view.rectangle[2:]
        left, top, high = right - 192.0, bottom + 34.0, 11.0
        edges = np.linspace(left, right, 97)
        for i in range(96):
            x0, x1 = edges[i], edges[i + 1]
            corners = ((x0, top), (x1, top), (x1, top + high), (x0, top + high))
            self.canvas.fill(np.array(corners), time_colour((i + 0.5) / 96))
        middle = 0.5 * (left + right)
        for text, x, y, anchor in (
            ("path of the robot", middle, top - 3.0, (0.5, 1.0)),
            ("0 s", left, top + high + 2.0, (0.0, 0.0)),
            (f"{duration_s:.0f} s", right, top + high + 2.0, (1.0, 0.0)),
        ):
            self.canvas.text(text, (x, y), _LEGEND_PX - 1, anchor=anchor, halo=False)

    def _draw_scale(self) -> None:
        """Draw a bar of a round length above the map; in the map it would hide something."""
        length_m = round_length_m(0.18 * self.view.window.width_m)
        right, bottom = self.view.rectangle[2] - 1.0, 38.0
        left = right - length_m * self.view.px_per_m
        bracket = ((left, bottom - 5.0), (left, bottom), (right, bottom), (right, bottom - 5.0))
        self.canvas.line(np.array(bracket), INK, 2.0)
        middle = (0.5 * (left + right), bottom - 12.0)
        self.canvas.text(f"{length_m:g} m", middle, 13, anchor=(0.5, 0.5), halo=False)


def round_length_m(longest_m: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not longer."""
    power = 10.0 ** math.floor(math.log10(longest_m))
    return max(step * power for step in (1, 2, 5) if step * power <= longest_m * 1.000001)


def _box(x: float, y: float) -> Floats:
    return np.array(((x, y - 5.5), (x + SIGN_PX, y - 5.5), (x + SIGN_PX, y + 5.5), (x, y + 5.5)))


def _level(x: float, y: float) -> Floats:
    return np.array(((x, y), (x + SIGN_PX, y)))


def _widened(window: Window, width_m: float, height_m: float) -> Window:
    """Return a window of a size about the same middle."""
    x_m, y_m = 0.5 * (window.left + window.right), 0.5 * (window.bottom + window.top)
    half = 0.5 * width_m, 0.5 * height_m
    return Window(x_m - half[0], x_m + half[0], y_m - half[1], y_m + half[1])


Side = tuple[int, int]

_SIDES: Final[tuple[Side, ...]] = (
    (0, -1),
    (0, 1),
    (1, 0),
    (-1, 0),
    (1, -1),
    (-1, -1),
    (1, 1),
    (-1, 1),
)
_GAP_PX: Final = 2.0


@dataclass(frozen=True)
class Label:
    """What is to be written beside a box: the first of `texts` that finds a place."""

    key: int
    box: Rectangle
    texts: tuple[str, ...]


@dataclass(frozen=True)
class Placed:
    """A text in its rectangle."""

    label: Label
    text: str
    place: Rectangle


class Labels:
    """Places labels beside their boxes, picture by picture; each keeps its side while it can."""

    def __init__(self, inside: Rectangle, size_px: int) -> None:
        """Take the rectangle in which labels stay, and the height of their font."""
        self._inside, self._size_px = inside, size_px
        self._sides: dict[int, Side] = {}

    def place(self, labels: Sequence[Label], taken: Sequence[Rectangle]) -> list[Placed]:
        """Return the labels that find a place; earlier labels choose first.

        A label covers no other label, and no rectangle of `taken` but its own box.
        """
        found: list[Placed] = []
        hard = np.array(taken, dtype=np.float64).reshape(-1, 4)
        for label in labels:
            if placed := self._placed(label, hard[(hard != label.box).any(axis=1)]):
                found.append(placed)
                hard = np.vstack((hard, placed.place))
        return found

    def _placed(self, label: Label, others: Floats) -> Placed | None:
        kept = self._sides.get(label.key, _SIDES[0])
        for text in label.texts:
            size_px = text_size(text, self._size_px)
            for side in (kept, *_SIDES):
                place = beside(label.box, size_px, side)
                if contains(self._inside, place) and is_free(place, others):
                    self._sides[label.key] = side
                    return Placed(label, text, place)
        return None


def beside(box: Rectangle, size_px: Sequence[float], side: Side) -> Rectangle:
    """Return the rectangle of a size on a side of a box."""
    left, top, right, bottom = box
    across = side[0] * (0.5 * (right - left + size_px[0]) + _GAP_PX)
    down = side[1] * (0.5 * (bottom - top + size_px[1]) + _GAP_PX)
    x = 0.5 * (left + right - size_px[0]) + across
    y = 0.5 * (top + bottom - size_px[1]) + down
    return x, y, x + size_px[0], y + size_px[1]


def is_free(place: Rectangle, taken: Floats) -> bool:
    """Tell whether a rectangle meets none of others (N, 4)."""
    is_after = (np.array(place[:2]) >= taken[:, 2:]).any(axis=1)
    is_before = (np.array(place[2:]) <= taken[:, :2]).any(axis=1)
    return bool((is_after | is_before).all())


def contains(outer: Rectangle, place: Rectangle) -> bool:
    """Tell whether a rectangle lies within another."""
    is_after = place[0] >= outer[0] and place[1] >= outer[1]
    return is_after and place[2] <= outer[2] and place[3] <= outer[3]


def id_text(artefact_id: int) -> str:
    """Return an id as short as it can be: requested ones count from s0, not from a billion."""
    requested = artefact_id - FIRST_ADMITTED_ID
    return str(artefact_id) if requested < 0 else f"s{requested}"
