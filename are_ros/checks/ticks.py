"""The ticks: their lists, counts and events have to agree.

Every tick has its artefacts, perceived and metrics, stamped alike, at its time, in the world frame.
"""

from bisect import bisect_right
from collections import Counter, defaultdict, deque
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from statistics import median
from typing import Any, Final

import numpy as np

from are_ros.bag.decoded import (
    ARRIVED,
    BLOCKED,
    CHANGED,
    DEPARTED,
    DISPLACED,
    LOST,
    PERCEIVED,
    ROBOT_CONTACT,
    Event,
    Metrics,
    Perceived,
    Scene,
)
from are_ros.bag.marker_decoding import DELETE_ALL
from are_ros.bag.recording import PREFIX
from are_ros.checks.record import Record
from are_ros.checks.result import CheckResult, Tally, at_s
from are_ros.conventions import NS_PER_S
from are_ros.wording import counted

_OTHER_CLOCK_NS: Final = 10 * NS_PER_S
"""If log times and stamps differ by more, two clocks made them."""
_KINDS: Final = (ARRIVED, DEPARTED, BLOCKED, DISPLACED, PERCEIVED, LOST, ROBOT_CONTACT, CHANGED)
_BECOMES: Final = " -> "
_DISPLACED_DETAIL: Final = "displaced"


def events_by_tick(record: Record) -> Iterator[tuple[Scene, list[Event], int]]:
    """Yield each tick's scene with the events since the tick before, and the stamp of that."""
    since_ns, at = -1, 0
    for scene in record.scenes:
        begin = at
        while at < len(record.events) and record.events[at].at_ns <= scene.at_ns:
            at += 1
        yield scene, record.events[begin:at], since_ns
        since_ns = scene.stamp_ns


class Departures:
    """When the lives of each id ended, as the events say.

    A node that was started again gives ids another time. Ids count modulo `id_range`.
    """

    def __init__(self, record: Record, id_range: int = 2**63) -> None:
        self.all: list[tuple[int, int]] = []
        """The stamps and ids of all departures, by time."""
        self._begun_ns: dict[int, list[int]] = defaultdict(list)
        self._ends_ns: dict[int, list[int | None]] = defaultdict(list)
        for event in sorted(record.events, key=lambda one: one.stamp_ns):
            number = event.artefact_id % id_range
            begun_ns, ends_ns = self._begun_ns[number], self._ends_ns[number]
            if event.kind == ARRIVED or (event.kind == DEPARTED and not ends_ns):
                begun_ns.append(event.stamp_ns)
                ends_ns.append(None)
            if event.kind == DEPARTED:
                self.all.append((event.stamp_ns, event.artefact_id))
                ends_ns[-1] = event.stamp_ns

    def of(self, number: int, at_ns: int) -> int | None:
        """Return when the last life of an id that had begun by then, else the first, ended.

        None where it did not.
        """
        begun_ns, ends_ns = self._begun_ns.get(number), self._ends_ns.get(number)
        if not begun_ns or not ends_ns:
            return None
        return ends_ns[max(bisect_right(begun_ns, at_ns) - 1, 0)]


def check_ticks(record: Record) -> CheckResult:
    """Every tick has its artefacts, perceived and metrics, stamped alike, in the world frame."""
    tally = Tally("ticks", "tick")
    for scene in record.scenes:
        tally.look()
        _check_scene(tally, record, scene)
    for before, after in pairwise(record.scenes):
        if after.stamp_ns <= before.stamp_ns:
            tally.fail(f"{at_s(after.stamp_ns)} does not follow {at_s(before.stamp_ns)}")
    lists: tuple[tuple[str, Sequence[Perceived | Metrics]], ...] = (
        ("perceived", record.perceived),
        ("metrics", record.metrics),
    )
    for name, messages in lists:
        if PREFIX + name not in record.topics:
            tally.note(f"without ~/{name}, which was not recorded")
        else:
            _check_stamps(tally, name, messages, record)
    if record.lags_ns:
        tally.note(_lag_text(record.lags_ns))
    return tally.result()


def _check_scene(tally: Tally, record: Record, scene: Scene) -> None:
    where, ids = at_s(scene.stamp_ns), scene.ids.tolist()
    if scene.stamp_ns != scene.at_ns:
        tally.fail(f"the artefacts logged {at_s(scene.at_ns)} are {where}")
    tally.require(all(a < b for a, b in pairwise(ids)), f"{where} ids do not ascend: {ids}")
    tally.require(scene.frame_id == record.world_frame, f"{where} the frame is '{scene.frame_id}'")
    if record.parameters is not None and scene.stamp_ns % record.period_ns:
        tally.fail(f"{where} there is no tick, they are {record.period_ns} ns apart")
    for text, is_wrong in _pose_faults(scene):
        if is_wrong.any():
            tally.fail(f"{where} artefact {scene.ids[is_wrong][0]} {text}")
            break


def _pose_faults(scene: Scene) -> Iterator[tuple[str, Any]]:
    """Yield what can be wrong with a pose, and a mask bool (N,) of the artefacts where it is."""
    poses, grounds, halves_m = scene.poses, scene.ground_poses, scene.half_sizes_m
    everything = np.hstack((poses, grounds, scene.centres_m, halves_m))
    yield "has numbers that are not finite", ~np.isfinite(everything).all(axis=1)
    yield "has a size that is not positive", (halves_m <= 0.0).any(axis=1)
    norms = np.abs(np.linalg.norm(poses[:, 3:], axis=1) - 1.0)
    yield "has a rotation that is no unit quaternion", norms > 1e-6
    yield "does not stand upright", np.abs(poses[:, 3:5]).max(axis=1, initial=0.0) > 1e-9
    bottoms_m = scene.centres_m[:, 2] - halves_m[:, 2]
    yield "does not stand on its ground pose", np.abs(bottoms_m - grounds[:, 2]) > 1e-6
    aside_m = np.hypot(*(poses[:, :2] - grounds[:, :2]).T)
    turn = np.abs(np.abs(np.sum(poses[:, 3:] * grounds[:, 3:], axis=1)) - 1.0)
    yield "is not above its ground pose", (aside_m > 1e-6) | (turn > 1e-9)


def _check_stamps(
    tally: Tally, name: str, messages: Sequence[Perceived | Metrics], record: Record
) -> None:
    """Compare with the lists, but near the ends of what a live recording holds without a gap."""
    ticks = {scene.at_ns for scene in record.scenes if not record.runs.is_edge(scene.at_ns)}
    given = {message.at_ns for message in messages if not record.runs.is_edge(message.at_ns)}
    if ticks != given:
        where = at_s(min(ticks ^ given))
        tally.fail(f"~/{name} and ~/artefacts differ {where}: one of them has no message")
    if any(a.at_ns >= b.at_ns for a, b in pairwise(messages)):
        tally.fail(f"~/{name} comes twice at a time, or goes back")
    for message in messages:
        is_right = message.frame_id == record.world_frame
        if is_right and isinstance(message, Perceived):
            is_right = record.is_of_its_time(message)
        elif message.stamp_ns != message.at_ns:
            is_right = False
        if not is_right:
            text = f"is stamped {at_s(message.stamp_ns)} in '{message.frame_id}'"
            tally.fail(f"~/{name} {at_s(message.at_ns)} {text}")


def _lag_text(lags_ns: list[int]) -> str:
    """Say how late the recorder received the ticks."""
    middle_ns = median(lags_ns)
    if abs(middle_ns) > _OTHER_CLOCK_NS:
        return "logged by another clock than that of their stamps"
    most = max(lags_ns, key=abs)
    delays = f"{middle_ns / 1e6:.0f} ms after their time in the median, {most / 1e6:.0f} at most"
    return f"logged {delays}"


def check_lives(record: Record) -> CheckResult:
    """Ids are never reused, and each tick lists the artefacts that arrived and did not depart.

    Their behaviours change only with an event. A node that was configured or started again
    counts ids from the first on.
    """
    tally = Tally("lives", "tick")
    story, begun_ns = _LivingArtefacts(tally), deque(_begun_anew_ns(record))
    for scene, events, since_ns in events_by_tick(record):
        is_anew = record.runs.is_beginning(scene.stamp_ns) and story.is_of_before(scene, since_ns)
        while begun_ns and begun_ns[0] <= scene.at_ns:
            begun_ns.popleft()
            is_anew = True
        if is_anew:
            story = _LivingArtefacts(tally)
        if record.runs.is_fresh(scene.stamp_ns):
            story.begin_with(scene)
            continue
        tally.look()
        for event in events:
            if not since_ns < event.stamp_ns <= scene.stamp_ns:
                tally.fail(f"the tick {at_s(scene.stamp_ns)} gives an event {at_s(event.stamp_ns)}")
            if not record.is_live and event.at_ns != scene.at_ns:
                tally.fail(f"an event is logged {at_s(event.at_ns)}, where there is no tick")
            story.hear(event)
        ids, told = scene.ids.tolist(), story.living()
        if ids != told:
            wrong = sorted(set(ids) ^ set(told))
            tally.fail(f"{at_s(scene.stamp_ns)} list and events differ in the ids {wrong}")
        story.compare(scene)
        _check_spans(tally, scene, story.arrived_ns)
    return tally.result()


def _begun_anew_ns(record: Record) -> list[int]:
    """Return when a live node was configured or started again: it counts arrivals from none."""
    if not record.is_live:
        return []
    pairs = pairwise(sorted(record.metrics, key=lambda message: message.at_ns))
    return [after.at_ns for before, after in pairs if after.arrivals < before.arrivals]


class _LivingArtefacts:
    """The artefacts alive, and their behaviours, according to the events."""

    def __init__(self, tally: Tally) -> None:
        self.arrived_ns: dict[int, int] = {}
        self._behaviours: dict[int, str] = {}
        self.departed_ns: dict[int, int] = {}
        self._living: set[int] = set()
        self._tally = tally

    def hear(self, event: Event) -> None:
        """Take an arrival, a departure, or a change of behaviour."""
        number, stamp_ns = event.artefact_id, event.stamp_ns
        if event.kind == ARRIVED:
            unheard_of = number not in self.arrived_ns
            self._tally.require(unheard_of, f"id {number} arrives again {at_s(stamp_ns)}")
            self.arrived_ns[number] = stamp_ns
            self._living |= {number} - self.departed_ns.keys()
        elif event.kind == DEPARTED:
            lives = number in self.arrived_ns and number not in self.departed_ns
            self._tally.require(
                lives, f"id {number} departs {at_s(stamp_ns)}, but it was not there"
            )
            self.departed_ns[number] = stamp_ns
            self._living.discard(number)
        elif event.kind == CHANGED:
            was, _, becomes = event.detail.partition(_BECOMES)
            known = self._behaviours.get(number, was)
            self._behaviours[number] = becomes
            text = f"id {number} is {known}, but {event.detail!r} is said {at_s(stamp_ns)}"
            self._tally.require(known == was, text)
        elif event.kind not in _KINDS:
            self._tally.fail(f"an event {at_s(stamp_ns)} is of kind {event.kind}")

    def living(self) -> list[int]:
        """Return the ids that arrived and did not depart."""
        return sorted(self._living)

    def compare(self, scene: Scene) -> None:
        """Compare the behaviours of a tick with those that the events say."""
        for number, behaviour in zip(scene.ids.tolist(), scene.behaviours, strict=True):
            known = self._behaviours.setdefault(number, behaviour)
            text = f"{at_s(scene.stamp_ns)} id {number} is {behaviour}, the events say {known}"
            self._tally.require(known == behaviour, text)

    def is_of_before(self, scene: Scene, since_ns: int) -> bool:
        """Tell whether the first list after a gap is of a node that was started again meanwhile.

        All in it came after the tick before, at `since_ns`, and an id among them is known.
        """
        are_new = bool((scene.arrivals_ns > since_ns).all())
        return are_new and any(number in self.arrived_ns for number in scene.ids.tolist())

    def begin_with(self, scene: Scene) -> None:
        """Take a list as true where events were missed; departed ids stay departed."""
        self._behaviours.update(zip(scene.ids.tolist(), scene.behaviours, strict=True))
        arrivals = dict(zip(scene.ids.tolist(), scene.arrivals_ns.tolist(), strict=True))
        self.arrived_ns = {**arrivals, **self.arrived_ns}
        for number in self._living - arrivals.keys():
            self.departed_ns[number] = scene.stamp_ns
        self._living = arrivals.keys() - self.departed_ns.keys()


def _check_spans(tally: Tally, scene: Scene, arrived_ns: dict[int, int]) -> None:
    """Each stamp lies in [arrival, departure), and the arrival is the one of the event."""
    spans = zip(
        scene.ids.tolist(), scene.arrivals_ns.tolist(), scene.departures_ns.tolist(), strict=True
    )
    for number, arrival_ns, departure_ns in spans:
        late = arrival_ns > scene.stamp_ns or 0 < departure_ns <= scene.stamp_ns
        if late or arrived_ns.get(number, arrival_ns) != arrival_ns:
            life = f"[{arrival_ns}, {departure_ns}) ns"
            tally.fail(f"{at_s(scene.stamp_ns)} id {number} is listed with the life {life}")


def check_metrics(record: Record) -> CheckResult:
    """Compare the counts of the metrics with those of the events and lists so far.

    In a recording that began late, with those since its beginning.
    """
    tally = Tally("metrics", "message")
    metrics = {message.at_ns: message for message in record.metrics}
    seen = record.perceived_ids()
    count = _EventCounts()
    for scene, events, _ in events_by_tick(record):
        count.hear(events)
        message = metrics.get(scene.at_ns)
        if message is None:
            continue
        if record.runs.is_fresh(scene.stamp_ns):
            count.begin_with(message)
            continue
        tally.look()
        wanted = {"alive": len(scene.ids), **count.since_start()}
        if not record.is_live or scene.at_ns in seen:
            wanted["perceived"] = len(seen.get(scene.at_ns, ()))
        for name, number in wanted.items():
            found = int(getattr(message, name))
            text = f"{at_s(scene.stamp_ns)} {name} is {found}, events and lists say {number}"
            tally.require(found == number, text)
    return tally.result()


class _EventCounts:
    """Counts events as the metrics do."""

    def __init__(self) -> None:
        self._kinds: Counter[int] = Counter()
        self._censored: set[tuple[int, int]] = set()
        self._before: Mapping[str, int] = {}

    def hear(self, events: list[Event]) -> None:
        """Count events."""
        for event in events:
            self._kinds[event.kind] += 1
            if event.kind == DISPLACED or event.detail == _DISPLACED_DETAIL:
                self._censored.add((event.artefact_id, event.stamp_ns))

    def begin_with(self, message: Metrics) -> None:
        """Take the counts of a message as the truth about what was missed."""
        self._before = {}
        counts = self.since_start()
        self._before = {name: int(getattr(message, name)) - n for name, n in counts.items()}

    def since_start(self) -> dict[str, int]:
        """Return the counts by their names."""
        counts = {
            "arrivals": self._kinds[ARRIVED],
            "departures": self._kinds[DEPARTED],
            "blocked": self._kinds[BLOCKED],
            "displaced": len(self._censored),
            "robot_contacts": self._kinds[ROBOT_CONTACT],
        }
        return {name: number + self._before.get(name, 0) for name, number in counts.items()}


def check_farewells(record: Record) -> CheckResult:
    """When a live node shuts down or is paused, its outputs show no artefact any more.

    The list of artefacts is empty, no artefact is perceived or counted, and a DELETEALL is sent.
    The grids of a farewell are checked with the other grids.
    """
    tally = Tally("farewells", "farewell")
    wiped = {
        show.at_ns
        for show in record.shows
        if any(change.action == DELETE_ALL for change in show.changes)
    }
    for stamp_ns in record.farewells_ns:
        tally.look()
        if PREFIX + "markers" in record.topics and stamp_ns not in wiped:
            if any(scene.stamp_ns > stamp_ns for scene in record.scenes):
                tally.fail(f"{at_s(stamp_ns)} the markers are not deleted")
            else:
                tally.note("the recording ends before the markers are deleted")
    for message in record.farewell_messages:
        if isinstance(message, Perceived):
            count = len(message.sightings)
        else:
            count = message.alive + message.perceived
        if count:
            told = f"there is still word of {counted(count, 'artefact')}"
            tally.fail(f"{at_s(message.at_ns)} {told}")
    return tally.result()
