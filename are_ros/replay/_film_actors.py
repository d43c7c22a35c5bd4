"""The artefacts of a film at one instant: footprints, headings, tails and what they do."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.replay._film_canvas import (
    INK,
    Picture,
    Rgb,
    Stage,
    fill,
    line,
    mixed,
    text_mask,
    write,
)
from are_ros.replay._picture_artefacts import id_text
from are_ros.replay.life_record import Life

Floats = npt.NDArray[np.float64]
Rectangle = tuple[float, float, float, float]

TAIL_NS: Final = 4 * NS_PER_S
UNSEEN_SHARE: Final = 0.34
_SMALLEST_PX: Final = 7.0
_JUMP_M: Final = 0.5
_LABEL_PX: Final = 11
_MOST_LABELS: Final = 16
_ARTEFACT: Final = re.compile(r"artefact (\d+)")
_SIDES: Final = ((0, -1), (0, 1), (1, 0), (-1, 0), (1, -1), (-1, -1), (1, 1), (-1, 1))


@dataclass(frozen=True, eq=False)
class Actor:
    """An artefact at an instant: its corners (4, 2) and the line to its front (2, 2) in pixels."""

    life: Life
    is_perceived: bool
    corners_px: Floats
    nose_px: Floats
    tail_px: tuple[Floats, ...]
    colour: Rgb
    text: str


def actors_at(
    lives: Sequence[Life], stamp_ns: int, stage: Stage, colours: Mapping[str, str]
) -> list[Actor]:
    """Return those present, in order of id; `stamp_ns` is that of a tick."""
    present = (life for life in lives if life.is_present_at(stamp_ns) and len(life.footprints))
    return [_actor(life, stamp_ns, stage, colours) for life in present]


def draw_actors(picture: Picture, actors: Sequence[Actor]) -> None:
    """Draw tails, then who is not perceived, translucent, then who is."""
    for actor in actors:
        _draw_tail(picture, actor)
    for actor in actors:
        if not actor.is_perceived:
            fill(picture, actor.corners_px, actor.colour, UNSEEN_SHARE)
            line(picture, actor.corners_px, mixed(actor.colour, 0.6), closed=True)
            line(picture, actor.nose_px, mixed(actor.colour, 0.7))
    for actor in actors:
        if actor.is_perceived:
            fill(picture, actor.corners_px, actor.colour)
            line(picture, actor.corners_px, mixed(actor.colour, 0.75, (0, 0, 0)), closed=True)
            line(picture, actor.nose_px, (255, 255, 255), 2)


class Labels:
    """What the artefacts do, beside them; each keeps its side for as long as it is free."""

    def __init__(self) -> None:
        self._side_of: dict[int, tuple[int, int]] = {}

    def draw(self, picture: Picture, actors: Sequence[Actor], taken: list[Rectangle]) -> None:
        """Write the labels where they cover nothing; of many, those of the perceived only."""
        taken = [*taken, *(_bounds(actor.corners_px) for actor in actors)]
        labelled = [a for a in actors if a.is_perceived or len(actors) <= _MOST_LABELS]
        for actor in sorted(labelled, key=lambda actor: not actor.is_perceived):
            mask = text_mask(actor.text, _LABEL_PX)
            found = self._place(actor, (mask.shape[1], mask.shape[0]), picture, taken)
            if found is not None:
                colour = INK if actor.is_perceived else mixed(INK, 0.62)
                write(picture, actor.text, found[:2], _LABEL_PX, colour)
                taken.append(found)

    def _place(
        self, actor: Actor, size: tuple[int, int], picture: Picture, taken: Sequence[Rectangle]
    ) -> Rectangle | None:
        number = actor.life.artefact_id
        sides = [side for side in (self._side_of.get(number),) if side is not None]
        left, top, right, bottom = _bounds(actor.corners_px)
        middle, half = (0.5 * (left + right), 0.5 * (top + bottom)), (0.5 * size[0], 0.5 * size[1])
        for side in (*sides, *_SIDES):
            x = middle[0] + side[0] * (0.5 * (right - left) + half[0] + 2) - half[0]
            y = middle[1] + side[1] * (0.5 * (bottom - top) + half[1] + 1) - half[1]
            place = (x, y, x + size[0], y + size[1])
            inside = x >= 0 and y >= 0 and place[2] <= picture.shape[1]
            if inside and not any(_overlap(place, other) for other in taken):
                self._side_of[number] = side
                return place
        return None


def _actor(life: Life, stamp_ns: int, stage: Stage, colours: Mapping[str, str]) -> Actor:
    x_m, y_m, yaw_rad = life.footprint_at(stamp_ns)
    smallest_m = _SMALLEST_PX / stage.px_per_m
    length, width = (max(side, smallest_m) for side in life.row.size_m[:2])
    forward = np.array((np.cos(yaw_rad), np.sin(yaw_rad)))
    ahead = 0.5 * length * forward
    aside = 0.5 * width * np.array((-forward[1], forward[0]))
    centre = np.array((x_m, y_m))
    corners = centre + np.array((ahead + aside, aside - ahead, -ahead - aside, ahead - aside))
    code = colours[life.row.class_name]
    doing = life.doing_at(stamp_ns)
    words = _ARTEFACT.sub(lambda found: id_text(int(found[1])), doing.activity or doing.behaviour)
    return Actor(
        life,
        life.is_perceived_at(stamp_ns),
        stage.pixels(corners),
        stage.pixels(np.array((centre, centre + ahead))),
        tuple(stage.pixels(piece) for piece in _tail(life, stamp_ns)),
        rgb_of(code),
        f"{id_text(life.artefact_id)} {words}".strip(),
    )


def rgb_of(code: str) -> Rgb:
    """Return red, green and blue of "#rrggbb"."""
    return int(code[1:3], 16), int(code[3:5], 16), int(code[5:7], 16)


def _tail(life: Life, stamp_ns: int) -> list[Floats]:
    """Return where it went of late, as pieces (N, 2) between jumps, the oldest first."""
    stamps, poses = life.footprints.stamps_ns, life.footprints.poses
    first = max(int(np.searchsorted(stamps, stamp_ns - TAIL_NS)) - 1, 0)
    points = poses[first : int(np.searchsorted(stamps, stamp_ns, side="right")), :2]
    if len(points) < 2:
        return []
    jumps = np.flatnonzero(np.linalg.norm(np.diff(points, axis=0), axis=1) > _JUMP_M)
    return [piece for piece in np.split(points, jumps + 1) if len(piece) > 1]


def _draw_tail(picture: Picture, actor: Actor) -> None:
    count = sum(len(piece) - 1 for piece in actor.tail_px)
    strongest = 0.75 if actor.is_perceived else 0.45
    done = 0
    for piece in actor.tail_px:
        for i in range(len(piece) - 1):
            done += 1
            share = strongest * (0.15 + 0.85 * done / count)
            line(picture, piece[i : i + 2], mixed(actor.colour, share), 2)


def _bounds(corners_px: Floats) -> Rectangle:
    (left, top), (right, bottom) = corners_px.min(axis=0), corners_px.max(axis=0)
    return float(left), float(top), float(right), float(bottom)


def _overlap(one: Rectangle, other: Rectangle) -> bool:
    apart = one[0] >= other[2] or other[0] >= one[2] or one[1] >= other[3] or other[1] >= one[3]
    return not apart
