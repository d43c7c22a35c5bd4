"""The MarkerArray display of rviz as a state machine: what it shows, at any time."""

from dataclasses import dataclass, field
from typing import Final

from are_ros.bag.marker_decoding import (
    ADD,
    DELETE,
    DELETE_ALL,
    MarkerFields,
    decode_markers,
)

_ENDLESS_NS: Final = 2**63 - 1
_SHORTEST_LIFE_NS: Final = 100_000
"""A lifetime of no more than this is endless to rviz, as 0 is."""

Key = tuple[str, int]


@dataclass
class MarkerDisplay:
    """Takes the messages of one topic in the order of their reception, as rviz does.

    An ADD replaces the marker of its namespace and id, and begins its lifetime anew, counted from
    the reception; DELETE removes one, DELETEALL those of its namespace, or all where it names none.
    `complaints` are what rviz would put into its status, in sentences.
    """

    complaints: list[str] = field(default_factory=list)
    _shown: dict[Key, tuple[int, MarkerFields]] = field(default_factory=dict)

    def take(self, received_ns: int, data: bytes) -> None:
        """Follow a MarkerArray in CDR; a malformed one is a complaint, and changes nothing."""
        try:
            markers = decode_markers(data)
        except ValueError as cause:
            self.complaints.append(f"a MarkerArray {cause}")
            return
        self._complain_of_twins(markers)
        for marker in markers:
            self._take_marker(received_ns, marker)

    def shown(self, now_ns: int) -> list[MarkerFields]:
        """Return what is on display, by namespace and id; what ends at `now_ns` is gone."""
        alive = (key for key, (until_ns, _) in self._shown.items() if now_ns < until_ns)
        return [self._shown[key][1] for key in sorted(alive)]

    def _take_marker(self, received_ns: int, marker: MarkerFields) -> None:
        key = (marker.namespace, marker.number)
        if marker.action == ADD:
            until_ns = _ENDLESS_NS
            if marker.lifetime_ns > _SHORTEST_LIFE_NS:
                until_ns = received_ns + marker.lifetime_ns
            self._shown[key] = (until_ns, marker)
        elif marker.action == DELETE:
            self._shown.pop(key, None)
        elif marker.action == DELETE_ALL:
            gone = [k for k in self._shown if not marker.namespace or k[0] == marker.namespace]
            for each in gone:
                del self._shown[each]
        else:
            self.complaints.append(f"unknown marker action {marker.action}")

    def _complain_of_twins(self, markers: list[MarkerFields]) -> None:
        keys = [(marker.namespace, marker.number) for marker in markers]
        if len(set(keys)) < len(keys):
            self.complaints.append("several markers of one message have the same namespace and id")
