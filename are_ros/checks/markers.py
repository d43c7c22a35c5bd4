"""The markers: a viewer that follows them shows exactly the artefacts alive."""

from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from are_ros.bag.decoded import Scene
from are_ros.bag.marker_decoding import ADD, DELETE, DELETE_ALL
from are_ros.checks.marker_rules import MarkerChange
from are_ros.checks.record import MarkerShow, Record
from are_ros.checks.result import CheckResult, Tally, at_s
from are_ros.checks.ticks import Departures
from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import Labels

FADING_NS: Final = 3 * NS_PER_S
"""A marker stays visible for at most this time after it was last sent."""

_FOREVER_NS: Final = 2**63 - 1
_BODY, _LABEL = "body", "label"
_ENVIRONMENT: Final = "environment"
"""The namespace of the real place, which is no artefact: it stays, and does not fade."""
_ID_RANGE: Final = 2**31
_REFRESH_NS: Final = 13 * NS_PER_S // 10
"""Live: after this time a viewer knows every artefact, for each is sent again every second."""


def _of_artefacts(show: MarkerShow) -> tuple[MarkerChange, ...]:
    """Return what a message does to the markers of artefacts."""
    return tuple(change for change in show.changes if change.key[0] != _ENVIRONMENT)


@dataclass
class _Viewer:
    """What rviz shows: the end of each marker by namespace and id."""

    until_ns: dict[tuple[str, int], int] = field(default_factory=dict)
    namespaces: set[str] = field(default_factory=set)
    opaque: set[int] = field(default_factory=set)
    """Ids whose body was last drawn opaque: the perceived artefacts."""

    def take(self, at_ns: int, change: MarkerChange) -> None:
        """Follow one marker."""
        if change.action == DELETE_ALL:
            self.until_ns.clear()
        elif change.action == ADD:
            life_ns = change.lifetime_ns
            self.until_ns[change.key] = at_ns + life_ns if life_ns else _FOREVER_NS
            namespace, number = change.key
            self.namespaces.add(namespace)
            if namespace == _BODY:
                (self.opaque.add if change.alpha == 1.0 else self.opaque.discard)(number)
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
    tally = Tally("marker rules", "marker")
    viewer, is_sure = _Viewer(), not record.is_live
    last_ns: int | None = None
    for show in record.shows:
        seen: set[tuple[str, int]] = set()
        is_missing = last_ns is not None and not record.runs.are_together(last_ns, show.at_ns)
        is_sure = (is_sure and not is_missing) or _begins_anew(show)
        last_ns = show.at_ns
        for number, change in enumerate(show.changes):
            tally.look()
            for fault in _faults(record, change, number, seen):
                tally.fail(f"{_where(show, change)} {fault}")
            if is_sure and change.action == DELETE and change.key not in viewer.until_ns:
                tally.fail(f"{_where(show, change)} is deleted, but was not there")
            seen.add(change.key)
            viewer.take(show.at_ns, change)
    return tally.result()


def _faults(
    record: Record, change: MarkerChange, number: int, seen: set[tuple[str, int]]
) -> Iterator[str]:
    """Yield what is wrong with a marker by itself, and with its place in the message."""
    if change.fault:
        yield change.fault
    elif change.frame_id != record.world_frame:
        yield f"is in frame '{change.frame_id}', not '{record.world_frame}'"
    if change.action == DELETE_ALL and number:
        yield "deletes all, but is not the first"
    elif change.action != DELETE_ALL and change.key in seen:
        yield "comes twice in one message"


def _where(show: MarkerShow, change: MarkerChange) -> str:
    return f"{at_s(show.at_ns)} marker {change.key[1]} of '{change.key[0]}'"


def _begins_anew(show: MarkerShow) -> bool:
    return bool(show.changes) and show.changes[0].action == DELETE_ALL


def check_marker_state(record: Record) -> CheckResult:
    """At each tick every namespace shows exactly the artefacts alive.

    Labels are an exception: `markers.labels` chooses the perceived, all or none.
    """
    tally = Tally("markers of the living", "tick")
    if not record.shows:
        tally.note("no markers were written")
        return tally.result()
    viewer = _Viewer()
    since_ns: int | None = None
    for scene, shows in _by_tick(record):
        if record.runs.is_beginning(scene.stamp_ns):
            viewer.until_ns.clear()  # markers may have been deleted in the gap
        for show in shows:
            for change in _of_artefacts(show):
                viewer.take(show.at_ns, change)
        since_ns = _sure_since(record, scene, shows, since_ns)
        if since_ns is None or scene.stamp_ns < since_ns:
            tally.leave_out("tick", "before a viewer had been shown all artefacts")
            continue
        tally.look()
        alive = {int(number) % _ID_RANGE for number in scene.ids}
        shown = viewer.shown(scene.stamp_ns) or {"any namespace": set()}
        labelled = _labelled(record, alive, alive & viewer.opaque)
        if labelled[0]:
            shown.setdefault(_LABEL, set())
        for namespace, ids in shown.items():
            wanted = labelled if namespace == _LABEL else [alive]
            if ids not in wanted:
                faults = f"stale {sorted(ids - wanted[0])}, missing {sorted(wanted[0] - ids)}"
                tally.fail(f"{at_s(scene.stamp_ns)} '{namespace}' is wrong: {faults}")
    return tally.result()


def _labelled(record: Record, alive: set[int], opaque: set[int]) -> list[set[int]]:
    """Return the ids that may have labels; live, any choice, because the parameter may change."""
    choices = {Labels.PERCEIVED: opaque, Labels.ALL: alive, Labels.NONE: set[int]()}
    if record.is_live or record.parameters is None:
        return list(choices.values())
    return [choices[record.parameters.markers.labels]]


def _sure_since(
    record: Record, scene: Scene, shows: list[MarkerShow], before_ns: int | None
) -> int | None:
    """Return the time from which a viewer shows all; None while a live node sent no marker."""
    if not record.is_live:
        return scene.stamp_ns
    # With a farewell a node deletes all; who comes after it shows its own.
    shows = [show for show in shows if show.at_ns not in record.farewells_ns]
    begins = [show.at_ns for show in shows if _begins_anew(show)]
    if begins:
        return begins[-1]
    if record.runs.is_beginning(scene.stamp_ns) or before_ns is None:
        return shows[0].at_ns + _REFRESH_NS if shows else None
    return before_ns


def _by_tick(record: Record) -> Iterator[tuple[Scene, list[MarkerShow]]]:
    """Yield each scene with the markers since the scene before.

    Live, a message with a DELETEALL alone and the stamp of a tick comes after the tick: the node
    was paused or shut down.
    """
    times = [show.at_ns for show in record.shows]
    begin = 0
    for scene in record.scenes:
        end = bisect_right(times, scene.at_ns)
        if record.is_live and end and _is_farewell(record.shows[end - 1], scene):
            end -= 1
        yield scene, record.shows[begin:end]
        begin = max(begin, end)


def _is_farewell(show: MarkerShow, scene: Scene) -> bool:
    is_bare = len(show.changes) == 1 and _begins_anew(show)
    return is_bare and show.at_ns == scene.at_ns and bool(len(scene.ids))


def check_marker_fading(record: Record) -> CheckResult:
    """No marker outlives ARE, nor its artefact, by more than three seconds."""
    tally = Tally("markers fade", "marker")
    departures, viewer = Departures(record, _ID_RANGE), _Viewer()
    ends: dict[tuple[str, int], int | None] = {}
    """Of the artefact whose marker was sent last."""
    for show in record.shows:
        _check_ended(tally, viewer.until_ns, ends, show.at_ns)
        for change in _of_artefacts(show):
            if change.action == ADD:
                tally.look()
                if not 0 < change.lifetime_ns <= FADING_NS:
                    seconds = change.lifetime_ns / NS_PER_S
                    tally.fail(f"{_where(show, change)} has a lifetime of {seconds:g} s")
                ends[change.key] = departures.of(change.key[1], show.at_ns)
            viewer.take(show.at_ns, change)
    _check_ended(tally, viewer.until_ns, ends, _FOREVER_NS // 2)
    return tally.result()


def _check_ended(
    tally: Tally,
    until_ns: dict[tuple[str, int], int],
    ends: Mapping[tuple[str, int], int | None],
    now_ns: int,
) -> None:
    """Fail for each marker that is seen until `now_ns`, too long after its artefact's end."""
    for (namespace, number), last_ns in list(until_ns.items()):
        end_ns = ends.get((namespace, number))
        seen_ns = min(last_ns, now_ns)
        if end_ns is not None and seen_ns > end_ns + FADING_NS:
            text = f"marker {number} of '{namespace}' is seen until"
            tally.fail(f"{text} {at_s(seen_ns)[3:]}, its artefact departed {at_s(end_ns)}")
            del until_ns[namespace, number]
