"""The artefacts of a film at one instant: footprints, headings, tails and what they do."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.draw.scene import Life
from are_ros.replay._film_canvas import Picture, Rgb, Stage, fill, line, mixed
from are_ros.replay._picture_labels import id_text

Floats = npt.NDArray[np.float64]

TAIL_NS: Final = 4 * NS_PER_S
UNSEEN_SHARE: Final = 0.34
_SMALLEST_PX: Final = 7.0
_JUMP_M: Final = 0.5
_ARTEFACT: Final = re.compile(r"artefact (\d+)")


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
