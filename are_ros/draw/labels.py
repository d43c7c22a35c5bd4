"""Where texts are written: beside what they name, where they cover as little as possible."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.scenario import FIRST_ADMITTED_ID
from are_ros.draw.canvas import Image, Rectangle, text_size

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
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
_GAPS_PX: Final = (2.0, 12.0)
_CLEAR_GAP_PX: Final = 7.0
"""A label that is farther from its box does not tell by itself which box it belongs to."""
_SHORT_PICTURES: Final = 10
"""For so many pictures a longer text that found no place stays away, lest it flickers."""
_DARK: Final = 200


@dataclass(frozen=True)
class Label:
    """What is to be written beside a box: the first of `texts` that finds a place."""

    key: int
    box: Rectangle
    texts: tuple[str, ...]


@dataclass(frozen=True)
class Placed:
    """A text in its rectangle; `is_unclear`: far from its box, or nearer to another one."""

    label: Label
    text: str
    place: Rectangle
    is_unclear: bool


@dataclass(frozen=True)
class _Choice:
    """Which of the texts, how far from the box, on which side; (0, 0) is upon the box itself."""

    text: int
    gap_px: float
    side: Side


class Labels:
    """Finds places picture by picture; a label keeps its place as long as that is free."""

    def __init__(self, avoided: Mask, inside: Rectangle, size_px: int) -> None:
        """Take the pixels (height, width) to be covered only for want of another place.

        Labels stay `inside`, and are written `size_px` high.
        """
        self._avoided = np.pad(np.cumsum(np.cumsum(avoided, axis=0), axis=1), ((1, 0), (1, 0)))
        self._inside, self._size_px = inside, size_px
        self._choices: dict[int, _Choice] = {}
        self._short_until: dict[int, int] = {}
        self._pictures = 0

    def place(
        self, labels: Sequence[Label], boxes: Sequence[Rectangle], taken: Sequence[Rectangle]
    ) -> list[Placed]:
        """Return the labels that find a place, the first ones first.

        No label covers another one, a box but its own, or a rectangle of `taken`.
        """
        self._pictures += 1
        found: list[Placed] = []
        hard = np.array([*boxes, *taken], dtype=np.float64).reshape(-1, 4)
        for label in labels:
            others = hard[(hard != label.box).any(axis=1)]
            if placed := self._placed(label, others, hard[: len(boxes)]):
                found.append(placed)
                hard = np.vstack((hard, placed.place))
        return found

    def _placed(self, label: Label, others: Floats, boxes: Floats) -> Placed | None:
        sizes = [text_size(text, self._size_px) for text in label.texts]
        is_short = self._pictures < self._short_until.get(label.key, 0)
        first = len(sizes) - 1 if is_short else 0
        tried = [*_choices(self._choices.get(label.key), first, len(sizes))]
        for may_cover in (False, True):
            for choice in tried:
                place = beside(label.box, sizes[choice.text], choice.gap_px, choice.side)
                if place is None or not contains(self._inside, place):
                    continue
                if is_free(place, others) and (may_cover or not self._is_avoided(place)):
                    self._remember(label.key, choice, first)
                    unclear = _is_unclear(place, label.box, boxes)
                    return Placed(label, label.texts[choice.text], place, unclear)
        return None

    def _remember(self, key: int, choice: _Choice, first: int) -> None:
        self._choices[key] = choice
        if choice.text > first:
            self._short_until[key] = self._pictures + _SHORT_PICTURES

    def _is_avoided(self, place: Rectangle) -> bool:
        height, width = (side - 1 for side in self._avoided.shape)
        left, right = (min(max(round(side), 0), width) for side in place[::2])
        top, bottom = (min(max(round(side), 0), height) for side in place[1::2])
        total = self._avoided
        covered = total[bottom, right] - total[top, right] - total[bottom, left] + total[top, left]
        return bool(covered > 0)


def dark_pixels(picture: Image) -> Mask:
    """Return where a picture (height, width, 3) is as dark as a wall, (height, width)."""
    dark: Mask = picture.max(axis=2) < _DARK
    return dark


def beside(box: Rectangle, size_px: Sequence[float], gap_px: float, side: Side) -> Rectangle | None:
    """Return the rectangle of a size on a side of a box; None if it does not fit upon the box."""
    left, top, right, bottom = box
    width, height = right - left, bottom - top
    if side == (0, 0) and (size_px[0] > 0.9 * width or size_px[1] > 0.45 * height):
        return None
    across = side[0] * (0.5 * (width + size_px[0]) + gap_px)
    down = side[1] * (0.5 * (height + size_px[1]) + gap_px)
    # Upon the box, a label is beside the line to its front.
    down -= 0.25 * height if side == (0, 0) else 0.0
    x = 0.5 * (left + right - size_px[0]) + across
    y = 0.5 * (top + bottom - size_px[1]) + down
    return x, y, x + size_px[0], y + size_px[1]


def is_free(place: Rectangle, taken: Floats) -> bool:
    """Tell whether a rectangle meets none of others (N, 4)."""
    corner, far = place[:2], place[2:]
    apart = (np.array(corner) >= taken[:, 2:]).any(axis=1) | (np.array(far) <= taken[:, :2]).any(
        axis=1
    )
    return bool(apart.all())


def contains(outer: Rectangle, place: Rectangle) -> bool:
    """Tell whether a rectangle lies within another."""
    is_after = place[0] >= outer[0] and place[1] >= outer[1]
    return is_after and place[2] <= outer[2] and place[3] <= outer[3]


def id_text(artefact_id: int) -> str:
    """Return an id as short as it can be: requested ones count from s0, not from a billion."""
    requested = artefact_id - FIRST_ADMITTED_ID
    return str(artefact_id) if requested < 0 else f"s{requested}"


def _choices(kept: _Choice | None, first: int, count: int) -> Iterator[_Choice]:
    """Yield what to try, the best first: long texts, where it was, near, beside, upon."""
    for text in range(first, count):
        if kept is not None and kept.text == text:
            yield kept
        for gap_px in _GAPS_PX:
            yield from (_Choice(text, gap_px, side) for side in _SIDES)
        yield _Choice(text, 0.0, (0, 0))


def _is_unclear(place: Rectangle, own: Rectangle, boxes: Floats) -> bool:
    """Tell whether a label is far from its box, or another of the boxes (N, 4) is nearer."""
    gap_px = float(_gaps_px(place, np.array([own]))[0])
    return gap_px > min(_CLEAR_GAP_PX, float(_gaps_px(place, boxes).min()) + 1e-9)


def _gaps_px(place: Rectangle, boxes: Floats) -> Floats:
    """Return how far a rectangle is from others (N, 4), 0 where they meet."""
    low, high = np.array(place[:2]), np.array(place[2:])
    across = np.maximum(boxes[:, :2] - high, low - boxes[:, 2:])
    gaps: Floats = np.hypot(*np.maximum(across, 0.0).T)
    return gaps
