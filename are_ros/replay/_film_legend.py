"""What the colours and lines of a film mean: in the header the robot's, in the footer the rest."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from are_ros.replay._film_canvas import (
    FOOTER_PX,
    INK,
    Picture,
    Rgb,
    dashed,
    fill,
    line,
    ring,
    text_mask,
    write,
)

_TEXT_PX: Final = 13
_SIGN_PX: Final = 19
_GAP_PX: Final = 17
_MARGIN_PX: Final = 12
_CLOCK_PX: Final = 350
"""What the time and the counts take of the header."""

Sign = Callable[[Picture, float, float], None]


class Entry(NamedTuple):
    """What a sign means; the sign is drawn 14 pixels wide, from its left upper corner."""

    name: str
    sign: Sign

    @property
    def width_px(self) -> int:
        """How wide sign and name are, with the gap behind them."""
        return int(_SIGN_PX + text_mask(self.name, _TEXT_PX).shape[1] + _GAP_PX)


def patch(colour: Rgb, share: float = 1.0) -> Sign:
    """Return the sign of what is filled."""
    return partial(_draw_patch, colour, share)


def way(colour: Rgb) -> Sign:
    """Return the sign of a line."""
    return partial(_draw_way, colour)


def robot(colour: Rgb) -> Sign:
    """Return the sign of the robot, a disc that looks to the right."""
    return partial(_draw_robot, colour)


def circle(colour: Rgb) -> Sign:
    """Return the sign of an open circle."""
    return partial(_draw_circle, colour)


def dashes(colour: Rgb) -> Sign:
    """Return the sign of a dashed line."""
    return partial(_draw_dashes, colour)


def draw_legend(picture: Picture, header: Sequence[Entry], footer: Sequence[Entry]) -> None:
    """Draw as many entries as there is room for; those of the header end at its right."""
    height, width = picture.shape[:2]
    kept = [*header]
    while kept and _width_px(kept) > width - _CLOCK_PX:
        kept.pop()
    _draw_row(picture, kept, width - _width_px(kept), 7)
    _draw_row(picture, footer, _MARGIN_PX, height - FOOTER_PX + 5)


def _width_px(entries: Sequence[Entry]) -> int:
    return sum(entry.width_px for entry in entries)


def _draw_row(picture: Picture, entries: Sequence[Entry], x: int, y: int) -> None:
    for entry in entries:
        if x + entry.width_px - _GAP_PX > picture.shape[1]:
            return
        entry.sign(picture, x, y)
        write(picture, entry.name, (x + _SIGN_PX, y), _TEXT_PX, INK)
        x += entry.width_px


def _draw_patch(colour: Rgb, share: float, picture: Picture, x: float, y: float) -> None:
    box = np.array(((x, y + 2), (x + 14, y + 2), (x + 14, y + 13), (x, y + 13)), float)
    fill(picture, box, colour, share)


def _draw_way(colour: Rgb, picture: Picture, x: float, y: float) -> None:
    line(picture, np.array(((x, y + 8), (x + 14, y + 8)), float), colour, 2)


def _draw_circle(colour: Rgb, picture: Picture, x: float, y: float) -> None:
    ring(picture, np.array((x + 7.0, y + 8.5)), 5.5, colour, 1)


def _draw_dashes(colour: Rgb, picture: Picture, x: float, y: float) -> None:
    dashed(picture, np.array((x, y + 8)), np.array((x + 14, y + 8)), colour)


def _draw_robot(colour: Rgb, picture: Picture, x: float, y: float) -> None:
    centre = np.array((x + 7.0, y + 8.5))
    ring(picture, centre, 6.0, colour, 2)
    line(picture, np.array((centre, (x + 13.0, y + 8.5))), colour)
