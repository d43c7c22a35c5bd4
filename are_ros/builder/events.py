"""What happened to the artefacts: the values behind `~/events`."""

from dataclasses import dataclass
from enum import IntEnum


class EventKind(IntEnum):
    """Kinds of event, numbered as the constants of are_msgs/ArtefactEvent."""

    ARRIVED = 0
    DEPARTED = 1
    BLOCKED = 2
    DISPLACED = 3
    PERCEIVED = 4
    LOST = 5
    ROBOT_CONTACT = 6


@dataclass(frozen=True)
class ArtefactEvent:
    """One event of one artefact, at `stamp_ns`, in the map's frame.

    `detail` names a cause or a reason; `value` is a number that belongs to it: the penetration of a
    robot contact, or the distance of a displacement, in metres; else 0.
    """

    stamp_ns: int
    kind: EventKind
    artefact_id: int
    label: str
    detail: str = ""
    value: float = 0.0
