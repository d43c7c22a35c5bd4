"""The markers: a viewer that follows them shows exactly the artefacts alive."""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field

from are_ros.replay._check_marker_decoding import ADD, DELETE_ALL
from are_ros.replay._check_marker_rules import MarkerChange
from are_ros.replay._check_record import MarkerShow, Record
from are_ros.replay._check_result import CheckResult, Tally, at_s
from are_ros.replay._check_scene import Scene

_FOREVER_NS = 2**63 - 1
_ID_RANGE = 2**31


@dataclass
class _Viewer:
    """What rviz has: until when, by namespace and id."""

    until_ns: dict[tuple[str, int], int] = field(default_factory=dict)
    namespaces: set[str] = field(default_factory=set)

    def take(self, log_ns: int, change: MarkerChange) -> None:
        """Follow one marker."""
        if change.action == DELETE_ALL:
            self.until_ns.clear()
        elif change.action == ADD:
            life_ns = change.lifetime_ns
            self.until_ns[change.key] = log_ns + life_ns if life_ns else _FOREVER_NS
            self.namespaces.add(change.key[0])
        else:
            self.until_ns.pop(change.key, None)

    def shown(self, now_ns: int) -> dict[str, set[int]]:
        """Return the ids on display, by namespace."""
        ids: dict[str, set[int]] = {namespace: set() for namespace in self.namespaces}
        for (namespace, number), until_ns in self.until_ns.items():
            if until_ns > now_ns:
                ids[namespace].add(number)
        return ids


def check_marker_rules(record: Record) -> CheckResult:
    """Every marker obeys the rules of visualization_msgs, and none comes twice in a message."""
    tally = Tally("marker rules", "markers")
    for show in record.shows:
        seen: set[tuple[str, int]] = set()
        for number, change in enumerate(show.changes):
            tally.look()
            namespace, identifier = change.key
            where = f"{at_s(show.log_ns)} marker {identifier} of '{namespace}'"
            tally.require(not change.fault, f"{where} {change.fault}")
            if change.action == DELETE_ALL:
                tally.require(number == 0, f"{where} deletes all, but is not the first")
                continue
            tally.require(change.key not in seen, f"{where} comes twice in one message")
            seen.add(change.key)
    return tally.result()


def check_marker_state(record: Record) -> CheckResult:
    """At each tick every namespace shows the artefacts alive, and nobody else."""
    tally = Tally("markers of the living", "ticks")
    if not record.shows:
        tally.note("no markers were written")
        return tally.result()
    viewer = _Viewer()
    for scene, shows in _by_tick(record):
        for show in shows:
            for change in show.changes:
                viewer.take(show.log_ns, change)
        tally.look()
        alive = {int(number) % _ID_RANGE for number in scene.ids}
        shown = viewer.shown(scene.stamp_ns) or {"any namespace": set()}
        for namespace, ids in shown.items():
            if ids != alive:
                faults = f"stale {sorted(ids - alive)}, missing {sorted(alive - ids)}"
                tally.fail(f"{at_s(scene.stamp_ns)} '{namespace}' is wrong: {faults}")
    return tally.result()


def _by_tick(record: Record) -> Iterator[tuple[Scene, list[MarkerShow]]]:
    """Yield each scene with the markers since the scene before."""
    logs = [show.log_ns for show in record.shows]
    begin = 0
    for scene in record.scenes:
        end = bisect_right(logs, scene.log_ns)
        yield scene, record.shows[begin:end]
        begin = max(begin, end)
