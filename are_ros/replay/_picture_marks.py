"""What happened, in the overview picture: where the robot touched, and where somebody was moved."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.population_events import Cause
from are_ros.builder.events import ArtefactEvent, EventKind
from are_ros.draw.scene import Life, SceneRecord, Track

Floats = npt.NDArray[np.float64]

CONTACT_LOOK: Final = {
    "marker": (8, 1, 0.0),
    "markerfacecolor": "#e63946",
    "markeredgecolor": "white",
    "markeredgewidth": 0.7,
    "markersize": 9.0,
    "linestyle": "none",
}
DISPLACED_LOOK: Final = {
    "marker": "d",
    "markerfacecolor": "#ffd166",
    "markeredgecolor": "#5c4400",
    "markeredgewidth": 0.7,
    "markersize": 6.0,
    "linestyle": "none",
}


def of_kind(record: SceneRecord, kind: EventKind) -> list[ArtefactEvent]:
    """Return the events of a kind."""
    return [event for event in record.events if event.kind is kind]


def forced(record: SceneRecord) -> list[ArtefactEvent]:
    """Return an event for each who was moved by force, or had to leave: `displaced` in metrics."""
    return [
        event
        for event in record.events
        if event.kind is EventKind.DISPLACED
        or (event.kind is EventKind.DEPARTED and event.detail == Cause.DISPLACED.value)
    ]


def draw_marks(axes: Any, record: SceneRecord) -> None:
    """Mark contacts where the robot was then, and displacements where they ended.

    Who had to leave is marked where that was.
    """
    displaced, contacts = mark_places(record)
    axes.plot(*displaced.T, zorder=6.0, **DISPLACED_LOOK)
    axes.plot(*contacts.T, zorder=6.1, **CONTACT_LOOK)


def mark_places(record: SceneRecord) -> tuple[Floats, Floats]:
    """Return where displacements and contacts are marked, (N, 2) and (M, 2)."""
    lives = {life.artefact_id: life for life in record.lives if len(life.footprints)}
    contacts = _contacts(of_kind(record, EventKind.ROBOT_CONTACT), lives, record.robot)
    return _ends(forced(record), lives), contacts


def _ends(events: Sequence[ArtefactEvent], lives: dict[int, Life]) -> Floats:
    """Return where the artefacts stood from the event on (N, 2)."""
    places = []
    for event in events:
        if life := lives.get(event.artefact_id):
            stamps = life.footprints.stamps_ns
            at = min(int(np.searchsorted(stamps, event.stamp_ns)), len(stamps) - 1)
            places.append(life.footprints.poses[at, :2])
    return np.array(places, dtype=np.float64).reshape(-1, 2)


def _contacts(events: Sequence[ArtefactEvent], lives: dict[int, Life], robot: Track) -> Floats:
    """Return where the robot was at the events (N, 2); the artefacts, where it is not known."""
    if not len(robot):
        return _ends(events, lives)
    at = np.searchsorted(robot.stamps_ns, [event.stamp_ns for event in events], side="right")
    places: Floats = robot.poses[np.maximum(at - 1, 0), :2]
    return places
