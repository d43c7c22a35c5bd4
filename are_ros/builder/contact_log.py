"""The robot's contacts with artefacts, each said once, when it begins."""

from collections.abc import Mapping, Sequence

from are_ros.artefacts.artefact import Artefact
from are_ros.builder.events import ArtefactEvent, EventKind
from are_ros.builder.robot_contact import RobotContact


class ContactLog:
    """Remembers who touches whom, and counts the contacts that begin."""

    def __init__(self, observer: str) -> None:
        self.count = 0
        self._observer = observer
        self._touching: set[tuple[int, int]] = set()

    def begun(
        self, now_ns: int, contacts: Sequence[RobotContact], living: Mapping[int, Artefact]
    ) -> list[ArtefactEvent]:
        """Return an event for each contact of now that was none before; the value is its depth."""
        touching = {(contact.observer, contact.artefact_id): contact for contact in contacts}
        new = [contact for key, contact in touching.items() if key not in self._touching]
        self._touching = set(touching)
        self.count += len(new)
        return [self._event(now_ns, contact, living) for contact in new]

    def forget(self) -> None:
        """Forget who touches whom: the clock jumped back."""
        self._touching = set()

    def _event(
        self, now_ns: int, contact: RobotContact, living: Mapping[int, Artefact]
    ) -> ArtefactEvent:
        artefact_id, depth_m = contact.artefact_id, contact.penetration_m
        label = living[artefact_id].row.label
        kind = EventKind.ROBOT_CONTACT
        return ArtefactEvent(now_ns, kind, artefact_id, label, self._observer, depth_m)
