"""The artefacts as markers for rviz: values, and a board that gives out only what changed."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from are_ros.builder._marker_shapes import (
    Marker,
    MarkerAction,
    MarkerKind,
    MarkerSubject,
    deletion,
    drawn,
    looks_equal,
)
from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import Shape

REFRESH_NS: Final = NS_PER_S

__all__ = (
    "Marker",
    "MarkerAction",
    "MarkerBoard",
    "MarkerKind",
    "MarkerSubject",
)


@dataclass(frozen=True, eq=False)
class _Shown:
    """A subject as rviz has it, and when it was last given out."""

    subject: MarkerSubject
    sent_ns: int


class MarkerBoard:
    """Remembers what viewers have been given, and gives out the difference.

    A marker fades 3 s after it was last given out, so that a dead ARE leaves none; each is
    refreshed once a second. All poses are in the map's frame.
    """

    def __init__(self, shape: Shape = Shape.BOX) -> None:
        self._shape = shape
        self._shown: dict[int, _Shown] = {}
        self._now_ns: int | None = None

    def update(self, now_ns: int, shown: Sequence[MarkerSubject]) -> list[Marker]:
        """Return the markers that bring viewers up to date with the artefacts of now.

        DELETE for those who departed, ADD for those who came, moved, changed their looks or were
        due for a refresh. The first update, and one after the clock jumped back, begins with a
        DELETEALL and gives everything. Ids in `shown` are distinct.
        """
        if self._now_ns is None or now_ns < self._now_ns:
            self._shown = {subject.artefact_id: _Shown(subject, now_ns) for subject in shown}
            return self.everything(now_ns)
        self._now_ns = now_ns
        departed = self._shown.keys() - {subject.artefact_id for subject in shown}
        markers = [marker for i in sorted(departed) for marker in self._delete(i)]
        due = [subject for subject in shown if self._is_due(now_ns, subject)]
        return markers + self._draw(now_ns, due)

    def everything(self, now_ns: int) -> list[Marker]:
        """Return a DELETEALL and all that is shown since the last update: for a new subscriber."""
        self._now_ns = now_ns
        subjects = [shown.subject for shown in self._shown.values()]
        return [Marker.delete_all(), *self._draw(now_ns, subjects)]

    def delete_all(self) -> list[Marker]:
        """Return a DELETEALL, and start anew: the next update gives everything."""
        self._shown, self._now_ns = {}, None
        return [Marker.delete_all()]

    def _is_due(self, now_ns: int, subject: MarkerSubject) -> bool:
        shown = self._shown.get(subject.artefact_id)
        if shown is None or now_ns - shown.sent_ns >= REFRESH_NS:
            return True
        return not looks_equal(shown.subject, subject)

    def _draw(self, now_ns: int, subjects: Iterable[MarkerSubject]) -> list[Marker]:
        markers: list[Marker] = []
        for subject in subjects:
            self._shown[subject.artefact_id] = _Shown(subject, now_ns)
            markers.extend(drawn(subject, self._shape))
        return markers

    def _delete(self, artefact_id: int) -> list[Marker]:
        del self._shown[artefact_id]
        return deletion(artefact_id)
