"""The artefacts in a picture: footprints, paths, behaviours, followers and events."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import ArtefactEvent, EventKind
from are_ros.conventions import NS_PER_S
from are_ros.draw.canvas import Canvas
from are_ros.draw.map import View
from are_ros.draw.palette import CONTACT, DISPLACED, DISPLACED_EDGE, WHITE, Rgb, mixed, shade_of
from are_ros.draw.scene import Doing, Life, LivesById, SceneRecord
from are_ros.population.departures import Cause

Floats = npt.NDArray[np.float64]
Stamps = npt.NDArray[np.int64]

UNSEEN_ALPHA: Final = 0.34
GONE_ALPHA: Final = 0.15
PATH_PX, SEEN_PATH_PX = 1.8, 4.4
BEHAVIOUR_PX: Final = 9.5
JUMP_PATTERN_PX: Final = (0.8, 4.0)
CONTACT_MARK: Final = ("burst", 15.0, CONTACT, WHITE)
DISPLACED_MARK: Final = ("lozenge", 12.0, DISPLACED, DISPLACED_EDGE)
"""Name, size [px], face and edge."""

_SMALLEST_PX: Final = 7.0
_FADE: Final = (0.25, 0.95)
_PALE_FADE: Final = (0.18, 0.75)
_MOST_VERTICES: Final = 500
_CROWD: Final = 18
"""With more paths than this lines get thinner."""
_MOVED_M: Final = 0.3
_FOLLOWS: Final = re.compile(r"(?:following|waiting behind) artefact (\d+)")
_SHORTEST_NS: Final = 2 * NS_PER_S
"""A shorter stretch, as between two moments of giving way, would only be clutter in a picture."""


@dataclass(frozen=True, eq=False)
class Outline:
    """A footprint on a canvas: its corners (4, 2), and the line from its middle to its front."""

    corners_px: Floats
    nose_px: Floats


def outline_of(
    view: View, pose: Sequence[float] | Floats, size_m: tuple[float, float, float]
) -> Outline:
    """Return the outline of a box at (x, y, yaw), enlarged where it would be too small to see."""
    x_m, y_m, yaw_rad = pose
    length_m, width_m = (max(side, _SMALLEST_PX / view.px_per_m) for side in size_m[:2])
    forward = np.array((math.cos(yaw_rad), math.sin(yaw_rad)))
    ahead = 0.5 * length_m * forward
    aside = 0.5 * width_m * np.array((-forward[1], forward[0]))
    centre = np.array((x_m, y_m))
    corners = centre + np.array((ahead + aside, aside - ahead, -ahead - aside, ahead - aside))
    return Outline(view.pixels(corners), view.pixels(np.array((centre, centre + ahead))))


def draw_artefact(
    canvas: Canvas, outline: Outline, colour: Rgb, *, is_opaque: bool, alpha: float = 1.0
) -> None:
    """Draw a footprint, opaque or translucent, with the line to its front."""
    corners = outline.corners_px
    if is_opaque:
        canvas.fill(corners, colour, alpha)
        canvas.line(corners, mixed(colour, 0.75, (0, 0, 0)), 1.0, alpha, closed=True)
        canvas.line(outline.nose_px, WHITE, 2.0, alpha)
        return
    canvas.fill(corners, colour, UNSEEN_ALPHA * alpha)
    edge = mixed(colour, 0.6)
    canvas.line(corners, edge, 1.0 if canvas.fine == 1 else 1.5, alpha, closed=True)
    canvas.line(outline.nose_px, edge, 1.0 if canvas.fine == 1 else 2.0, alpha)


def is_gone(life: Life, end_ns: int) -> bool:
    """Tell whether an artefact left before the end; live, in the last second every one has to."""
    return life.departure_ns is not None and life.departure_ns < end_ns - NS_PER_S


def behaviour_of(life: Life) -> str:
    """Return what an artefact came to do, empty if that is not known."""
    return life.doings[0].behaviour if life.doings else ""


@dataclass(frozen=True, eq=False)
class Path:
    """Where an artefact went: points (N, 2) [m], which steps (N - 1,) were seen, which jumps."""

    life: Life
    points_m: Floats
    is_seen: npt.NDArray[np.bool_]
    is_jump: npt.NDArray[np.bool_]

    @property
    def length_m(self) -> float:
        """The length of what the artefact went by itself."""
        steps = np.linalg.norm(np.diff(self.points_m, axis=0), axis=1)
        return float(steps[~self.is_jump].sum())


def path_of(life: Life, moved_ns: Sequence[int]) -> Path:
    """Return the path of a life that has a pose; it was displaced at the stamps `moved_ns`."""
    stamps, poses = life.footprints.stamps_ns, life.footprints.poses
    jumps: list[int] = np.searchsorted(stamps, np.array(moved_ns, dtype=np.int64)).tolist()
    count = len(stamps)
    every = max(1, math.ceil(count / _MOST_VERTICES))
    about_jumps = [i for jump in jumps for i in (jump - 1, jump) if 0 <= i < count]
    kept = np.unique((*range(0, count, every), count - 1, *about_jumps)).astype(np.int64)
    at = np.searchsorted(life.seen_ns, stamps[kept])
    return Path(
        life,
        poses[kept, :2],
        np.searchsorted(life.seen_ns, stamps[kept[1:]], side="right") > at[:-1],
        np.isin(kept[1:], np.array(jumps, dtype=np.int64)),
    )


def displacements(events: Sequence[ArtefactEvent]) -> dict[int, list[int]]:
    """Return when each artefact was moved by the resolution of collisions."""
    moved: dict[int, list[int]] = {}
    for event in events:
        if event.kind is EventKind.DISPLACED:
            moved.setdefault(event.artefact_id, []).append(event.stamp_ns)
    return moved


def draw_paths(
    canvas: Canvas,
    view: View,
    paths: Sequence[Path],
    colours: Mapping[str, Rgb],
    marks: Mapping[str, str],
) -> None:
    """Draw all paths; those never perceived lie below the others, and are paler.

    A path fades in from its beginning and is thick where its artefact was perceived. A mark at its
    beginning tells the behaviour.
    """
    thin = min(1.0, math.sqrt(_CROWD / max(len(paths), 1)))
    order = sorted(paths, key=lambda path: path.life.is_perceived)
    shades = [shade_of(colours[path.life.row.class_name], path.life.artefact_id) for path in order]
    for path, colour in zip(order, shades, strict=True):
        if path.length_m > _MOVED_M or path.is_jump.any():
            _draw_line(canvas, view, path, colour, thin)
    for path, colour in zip(order, shades, strict=True):
        place = view.pixels(path.points_m[0])
        mark = marks.get(behaviour_of(path.life), "disc")
        alpha = 1.0 if path.life.is_perceived else 0.75
        canvas.mark(mark, place, BEHAVIOUR_PX, WHITE, colour, 1.5, alpha)


def _draw_line(canvas: Canvas, view: View, path: Path, colour: Rgb, thin: float) -> None:
    points = view.pixels(path.points_m)
    widths = thin * np.where(path.is_seen, SEEN_PATH_PX, PATH_PX)
    widths[path.is_jump] = 0.0
    fade = _FADE if path.life.is_perceived else _PALE_FADE
    canvas.fading(points, colour, widths, np.linspace(*fade, len(widths)))
    for i in np.flatnonzero(path.is_jump).tolist():
        start, end = points[i], points[i + 1]
        canvas.dashes(start, end, colour, 1.4, 0.7, JUMP_PATTERN_PX)


@dataclass(frozen=True, eq=False)
class Following:
    """A follower behind its leader, from `start_ns` to `end_ns`."""

    follower: Life
    leader: Life
    start_ns: int
    end_ns: int


def following_stretches(lives: Sequence[Life], end_ns: int) -> list[Following]:
    """Return every stretch of following a leader of `lives`, as the followers' activities say."""
    by_id = LivesById(lives)
    return [
        Following(life, leader, start_ns, stop_ns)
        for life in lives
        if len(life.footprints)
        for leader_id, start_ns, stop_ns in _stretches(life, end_ns)
        if (leader := by_id.at(leader_id, start_ns)) is not None
    ]


def _stretches(life: Life, end_ns: int) -> Iterator[tuple[int, int, int]]:
    """Yield the leaders that an artefact followed, by id, and the [start, stop) in which it did."""
    last_ns = end_ns if life.departure_ns is None else life.departure_ns
    stops_ns = [*(doing.since_ns for doing in life.doings[1:]), last_ns]
    # Without a known doing there is one stop, and no doing that ends there.
    spans = zip(map(_leader, life.doings), life.doings, stops_ns, strict=False)
    for leader, same in groupby(spans, key=itemgetter(0)):
        stretch = list(same)
        start_ns, stop_ns = stretch[0][1].since_ns, stretch[-1][2]
        if leader is not None and stop_ns - start_ns >= _SHORTEST_NS:
            yield leader, start_ns, stop_ns


def _leader(doing: Doing) -> int | None:
    """Return the id of the artefact that is followed, None if none is."""
    match = _FOLLOWS.fullmatch(doing.activity)
    return int(match[1]) if match else None


def contacts(record: SceneRecord) -> list[ArtefactEvent]:
    """Return the contacts of the robot."""
    return [event for event in record.events if event.kind is EventKind.ROBOT_CONTACT]


def forced(record: SceneRecord) -> list[ArtefactEvent]:
    """Return an event for each artefact that was moved by force, or had to leave for it."""
    return [
        event
        for event in record.events
        if event.kind is EventKind.DISPLACED
        or (event.kind is EventKind.DEPARTED and event.detail == Cause.DISPLACED.value)
    ]


def mark_places(record: SceneRecord) -> tuple[Floats, Floats]:
    """Return where displacements ended (N, 2) and where the robot was at its contacts (M, 2) [m].

    Where the robot is not known, it is the artefact's place.
    """
    lives = LivesById(record.lives)
    touched, robot = contacts(record), record.robot
    if not len(robot):
        return _ends(forced(record), lives), _ends(touched, lives)
    at = np.searchsorted(robot.stamps_ns, [event.stamp_ns for event in touched], side="right")
    return _ends(forced(record), lives), robot.poses[np.maximum(at - 1, 0), :2]


def _ends(events: Sequence[ArtefactEvent], lives: LivesById) -> Floats:
    """Return where the artefacts stood from the event on (N, 2)."""
    places = []
    for event in events:
        if life := lives.at(event.artefact_id, event.stamp_ns):
            stamps = life.footprints.stamps_ns
            at = min(int(np.searchsorted(stamps, event.stamp_ns)), len(stamps) - 1)
            places.append(life.footprints.poses[at, :2])
    return np.array(places, dtype=np.float64).reshape(-1, 2)
