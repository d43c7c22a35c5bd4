"""The artefacts in a picture: footprints, paths, behaviours and events."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import ArtefactEvent, EventKind
from are_ros.conventions import NS_PER_S
from are_ros.draw.canvas import Canvas
from are_ros.draw.map import View
from are_ros.draw.palette import CONTACT, DISPLACED, DISPLACED_EDGE, WHITE, Rgb, mixed
from are_ros.draw.scene import Life, SceneRecord
from are_ros.population.departures import Cause

Floats = npt.NDArray[np.float64]

UNSEEN_ALPHA: Final = 0.34
GONE_ALPHA: Final = 0.15
PATH_PX, SEEN_PATH_PX = 1.8, 4.4
BEHAVIOUR_PX: Final = 9.5
CONTACT_MARK: Final = ("burst", 15.0, CONTACT, WHITE)
DISPLACED_MARK: Final = ("lozenge", 12.0, DISPLACED, DISPLACED_EDGE)
"""Name, size [px], face and edge."""

_SMALLEST_PX: Final = 7.0
_FADE: Final = (0.25, 0.95)
_PALE_FADE: Final = (0.18, 0.75)
_CROWD: Final = 18
"""With more paths than this lines get thinner."""
_MOVED_M: Final = 0.3


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
    """Where an artefact went: points (N, 2) [m], and which steps (N - 1,) were seen."""

    life: Life
    points_m: Floats
    is_seen: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, life: Life) -> "Path":
        """Return the path of a life that has a pose."""
        stamps = life.footprints.stamps_ns
        before = np.searchsorted(life.seen_ns, stamps[:-1])
        is_seen = np.searchsorted(life.seen_ns, stamps[1:], side="right") > before
        return cls(life, life.footprints.poses[:, :2], is_seen)

    @property
    def length_m(self) -> float:
        """How far the artefact came."""
        return float(np.linalg.norm(np.diff(self.points_m, axis=0), axis=1).sum())


def draw_paths(
    canvas: Canvas,
    view: View,
    paths: Sequence[Path],
    colours: Mapping[str, Rgb],
    behaviours: Mapping[str, Rgb],
) -> None:
    """Draw all paths; those never perceived lie below the others, and are paler.

    A path fades in from its beginning and is thick where its artefact was perceived. A disc at its
    beginning has the colour of the behaviour.
    """
    thin = min(1.0, math.sqrt(_CROWD / max(len(paths), 1)))
    order = sorted(paths, key=lambda path: path.life.is_perceived)
    for path in order:
        if path.length_m > _MOVED_M:
            _draw_line(canvas, view, path, colours[path.life.row.class_name], thin)
    for path in order:
        place = view.pixels(path.points_m[0])
        face = behaviours.get(behaviour_of(path.life), WHITE)
        alpha = 1.0 if path.life.is_perceived else 0.75
        colour = colours[path.life.row.class_name]
        canvas.mark("disc", place, BEHAVIOUR_PX, face, colour, 1.5, alpha)


def _draw_line(canvas: Canvas, view: View, path: Path, colour: Rgb, thin: float) -> None:
    points = view.pixels(path.points_m)
    widths = thin * np.where(path.is_seen, SEEN_PATH_PX, PATH_PX)
    fade = _FADE if path.life.is_perceived else _PALE_FADE
    canvas.fading(points, colour, widths, np.linspace(*fade, len(widths)))


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


def contact_places(record: SceneRecord) -> Floats:
    """Return where the robot was at its contacts (N, 2) [m]; the artefacts, if that is unknown."""
    touched, robot = contacts(record), record.robot
    if not len(robot):
        return places_of(record, touched)
    at = np.searchsorted(robot.stamps_ns, [event.stamp_ns for event in touched], side="right")
    return np.asarray(robot.poses[np.maximum(at - 1, 0), :2])


def places_of(record: SceneRecord, events: Sequence[ArtefactEvent]) -> Floats:
    """Return where the artefacts stood from the event on (N, 2) [m]."""
    lives = {life.artefact_id: life for life in record.lives if len(life.footprints)}
    places = []
    for event in events:
        if life := lives.get(event.artefact_id):
            stamps = life.footprints.stamps_ns
            at = min(int(np.searchsorted(stamps, event.stamp_ns)), len(stamps) - 1)
            places.append(life.footprints.poses[at, :2])
    return np.array(places, dtype=np.float64).reshape(-1, 2)
