"""What the artefacts of a film do, written beside them where it covers neither walls nor others."""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.replay._film_actors import Actor
from are_ros.replay._film_canvas import (
    FOOTER_PX,
    HEADER_PX,
    INK,
    Picture,
    mixed,
    text_mask,
    write,
)

Floats = npt.NDArray[np.float64]
Rectangle = tuple[float, float, float, float]
Choice = tuple[bool, float, tuple[int, int]]
"""Whether it is short, how far away, and on which side; (0, 0) is upon the artefact itself."""

_LABEL_PX: Final = 11
_MOST_TOLD: Final = 16
"""Of more than these only the perceived have words beside their ids."""

_SIDES: Final = ((0, -1), (0, 1), (1, 0), (-1, 0), (1, -1), (-1, -1), (1, 1), (-1, 1))
_GAPS_PX: Final = (2.0, 12.0)
_DARK: Final = 200
_SHORT_PICTURES: Final = 10
"""For so many pictures words that found no place stay away, lest they flicker."""


class Labels:
    """Writes ids, and what is done, beside the artefacts; each keeps its place while it is free."""

    def __init__(self, ground: Picture) -> None:
        """Take the picture without artefacts: what is dark in it is wall."""
        is_wall = ground.max(axis=2) < _DARK
        self._walls = np.pad(np.cumsum(np.cumsum(is_wall, axis=0), axis=1), ((1, 0), (1, 0)))
        self._choices: dict[int, Choice] = {}
        self._shortened: dict[int, int] = {}
        self._pictures = 0

    def draw(self, picture: Picture, actors: Sequence[Actor], taken: Sequence[Rectangle]) -> None:
        """Write the labels, first of the perceived, where nothing of `taken` lies either.

        Who finds no place with words has the id alone, and if need be upon a wall.
        """
        self._pictures += 1
        bounds = [bounds_of(actor.corners_px) for actor in actors]
        written = [*taken]
        order = sorted(range(len(actors)), key=lambda i: not actors[i].is_perceived)
        for i in order:
            others = [*written, *bounds[:i], *bounds[i + 1 :]]
            is_told = actors[i].is_perceived or len(actors) <= _MOST_TOLD
            found = self._place(actors[i], bounds[i], others, is_told=is_told)
            if found is not None:
                text, place = found
                colour = INK if actors[i].is_perceived else mixed(INK, 0.62)
                write(picture, text, place[:2], _LABEL_PX, colour)
                written.append(place)

    def _place(
        self, actor: Actor, bounds: Rectangle, others: Sequence[Rectangle], *, is_told: bool
    ) -> tuple[str, Rectangle] | None:
        """Return text and place of a label, None where all around is taken."""
        number = actor.life.artefact_id
        texts = {False: actor.text, True: actor.text.partition(" ")[0]}
        sizes = {
            is_short: text_mask(text, _LABEL_PX).shape[::-1] for is_short, text in texts.items()
        }
        is_told = is_told and self._pictures >= self._shortened.get(number, 0)
        tried = [*_choices(self._choices.get(number), is_told=is_told)]
        for may_cover_walls in (False, True):
            for choice in tried:
                place = _placed(bounds, sizes[choice[0]], choice)
                if place is None or not self._is_inside(place):
                    continue
                if any(_overlap(place, other) for other in others):
                    continue
                if may_cover_walls or not self._covers_walls(place):
                    self._choices[number] = choice
                    if is_told and choice[0]:
                        self._shortened[number] = self._pictures + _SHORT_PICTURES
                    return texts[choice[0]], place
        return None

    def _is_inside(self, place: Rectangle) -> bool:
        height, width = (side - 1 for side in self._walls.shape)
        is_low_enough = place[1] >= HEADER_PX and place[3] <= height - FOOTER_PX
        return is_low_enough and place[0] >= 0 and place[2] <= width

    def _covers_walls(self, place: Rectangle) -> bool:
        left, top, right, bottom = (round(side) for side in place)
        walls = self._walls
        covered = walls[bottom, right] - walls[top, right] - walls[bottom, left] + walls[top, left]
        return bool(covered > 0)


def bounds_of(corners_px: Floats) -> Rectangle:
    """Return left, top, right and bottom of points (N, 2)."""
    (left, top), (right, bottom) = corners_px.min(axis=0), corners_px.max(axis=0)
    return float(left), float(top), float(right), float(bottom)


def _choices(kept: Choice | None, *, is_told: bool) -> Iterator[Choice]:
    """Yield the places to try, the best first: with words; where it was; near; above."""
    for is_short in (False, True) if is_told else (True,):
        if kept is not None and kept[0] == is_short:
            yield kept
        for gap_px in _GAPS_PX:
            yield from ((is_short, gap_px, side) for side in _SIDES)
        yield is_short, 0.0, (0, 0)


def _placed(bounds: Rectangle, size: Sequence[int], choice: Choice) -> Rectangle | None:
    """Return where a label of a size would be; None if it does not fit upon its artefact."""
    _, gap_px, side = choice
    left, top, right, bottom = bounds
    width, height = right - left, bottom - top
    if side == (0, 0) and (size[0] > 0.9 * width or size[1] > 0.45 * height):
        return None
    # Upon the artefact it is beside the line to its front.
    down = 0.5 * (height + size[1]) + gap_px if side[1] else 0.0
    x = left + 0.5 * width + side[0] * (0.5 * (width + size[0]) + gap_px) - 0.5 * size[0]
    y = top + 0.5 * height + side[1] * down - 0.5 * size[1]
    y -= 0.25 * height if side == (0, 0) else 0.0
    return x, y, x + size[0], y + size[1]


def _overlap(one: Rectangle, other: Rectangle) -> bool:
    apart = one[0] >= other[2] or other[0] >= one[2] or one[1] >= other[3] or other[1] >= one[3]
    return not apart
