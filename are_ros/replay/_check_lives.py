"""Lives: the events, the lists of artefacts and the counts of the metrics tell one story."""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, Final

from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, Tally, at_s
from are_ros.replay._check_scene import Scene, time_ns

ARRIVED, DEPARTED, BLOCKED, DISPLACED, PERCEIVED, LOST, ROBOT_CONTACT = range(7)
"""The kinds of are_msgs/ArtefactEvent."""

_DISPLACED_DETAIL: Final = "displaced"
_NOW: Final = ("alive", "perceived")
"""The counts that are not counted since the start."""


class _Story:
    """Who lives, as the events tell it, event by event."""

    def __init__(self, tally: Tally) -> None:
        self.arrived_ns: dict[int, int] = {}
        self.departed_ns: dict[int, int] = {}
        self._tally = tally

    def hear(self, event: Any) -> None:
        """Take an arrival or a departure."""
        number, stamp_ns = int(event.id), time_ns(event.header.stamp)
        if event.kind == ARRIVED:
            unheard_of = number not in self.arrived_ns
            self._tally.require(unheard_of, f"id {number} arrives again {at_s(stamp_ns)}")
            self.arrived_ns[number] = stamp_ns
        elif event.kind == DEPARTED:
            lives = number in self.arrived_ns and number not in self.departed_ns
            self._tally.require(
                lives, f"id {number} departs {at_s(stamp_ns)}, but it was not there"
            )
            self.departed_ns[number] = stamp_ns
        elif event.kind not in {BLOCKED, DISPLACED, PERCEIVED, LOST, ROBOT_CONTACT}:
            self._tally.fail(f"an event {at_s(stamp_ns)} is of kind {event.kind}")

    def living(self) -> list[int]:
        """Return the ids of those who came and have not gone."""
        return sorted(self.arrived_ns.keys() - self.departed_ns.keys())

    def begin_with(self, scene: Scene) -> None:
        """Take a list as the truth about what was missed; those whose end was told stay away."""
        arrivals = dict(zip(scene.ids.tolist(), scene.arrivals_ns.tolist(), strict=True))
        self.arrived_ns = {**arrivals, **self.arrived_ns}
        for number in set(self.living()) - arrivals.keys():
            self.departed_ns[number] = scene.stamp_ns


def check_lives(record: Record) -> CheckResult:
    """Ids are never reused, and each tick lists those who arrived and did not depart."""
    tally = Tally("lives", "tick")
    story = _Story(tally)
    for scene, events, since_ns in events_by_tick(record):
        if record.runs.is_fresh(scene.stamp_ns):
            story.begin_with(scene)
            continue
        tally.look()
        for event in events:
            stamp_ns = time_ns(event.header.stamp)
            if not since_ns < stamp_ns <= scene.stamp_ns:
                tally.fail(f"the tick {at_s(scene.stamp_ns)} gives an event {at_s(stamp_ns)}")
            story.hear(event)
        ids, told = scene.ids.tolist(), story.living()
        if ids != told:
            wrong = sorted(set(ids) ^ set(told))
            tally.fail(f"{at_s(scene.stamp_ns)} list and events differ in the ids {wrong}")
        _check_spans(tally, scene, story.arrived_ns)
    return tally.result()


def _check_spans(tally: Tally, scene: Scene, arrived_ns: dict[int, int]) -> None:
    """Each stamp lies in [arrival, departure), and the arrival is that of the event."""
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
    metrics, seen = dict(record.metrics), record.perceived_ids()
    count = _Count()
    for scene, events, _ in events_by_tick(record):
        count.hear(events)
        message = metrics.get(scene.log_ns)
        if message is None:
            continue
        if record.runs.is_fresh(scene.stamp_ns):
            count.begin_with(message)
            continue
        tally.look()
        wanted = {"alive": len(scene.ids), **count.since_start()}
        if not record.is_live or scene.log_ns in seen:
            wanted["perceived"] = len(seen.get(scene.log_ns, ()))
        for name, number in wanted.items():
            found = int(getattr(message, name))
            text = f"{at_s(scene.stamp_ns)} {name} is {found}, events and lists say {number}"
            tally.require(found == number, text)
    return tally.result()


class _Count:
    """Counts events as the metrics do."""

    def __init__(self) -> None:
        self._kinds: Counter[int] = Counter()
        self._censored: set[tuple[int, int]] = set()
        self._before: Mapping[str, int] = {}

    def hear(self, events: list[Any]) -> None:
        """Count events."""
        for event in events:
            self._kinds[event.kind] += 1
            if event.kind == DISPLACED or event.detail == _DISPLACED_DETAIL:
                self._censored.add((int(event.id), time_ns(event.header.stamp)))

    def begin_with(self, message: Any) -> None:
        """Take the counts of a message as the truth about what was missed."""
        self._before = {}
        counted = self.since_start()
        self._before = {name: int(getattr(message, name)) - n for name, n in counted.items()}

    def since_start(self) -> dict[str, int]:
        """Return the counts by their names."""
        counted = {
            "arrivals": self._kinds[ARRIVED],
            "departures": self._kinds[DEPARTED],
            "blocked": self._kinds[BLOCKED],
            "displaced": len(self._censored),
            "robot_contacts": self._kinds[ROBOT_CONTACT],
        }
        return {name: number + self._before.get(name, 0) for name, number in counted.items()}


def events_by_tick(record: Record) -> Iterator[tuple[Scene, list[Any], int]]:
    """Yield each tick's scene with the events that it gives, and the stamp of the tick before.

    In a replay these are logged with the tick; live, they are those since the tick before.
    """
    since_ns = -1
    if record.is_live:
        pending = iter([*record.events, (2**63, None)])
        at_ns, event = next(pending)
        for scene in record.scenes:
            events = []
            while at_ns <= scene.stamp_ns:
                events.append(event)
                at_ns, event = next(pending)
            yield scene, events, since_ns
            since_ns = scene.stamp_ns
        return
    by_log: dict[int, list[Any]] = {}
    for log_ns, event in record.events:
        by_log.setdefault(log_ns, []).append(event)
    for scene in record.scenes:
        yield scene, by_log.pop(scene.log_ns, []), since_ns
        since_ns = scene.stamp_ns


def departures_ns(record: Record) -> dict[int, int]:
    """Return when each id departed, as the events say."""
    return {
        int(event.id): time_ns(event.header.stamp)
        for _, event in record.events
        if event.kind == DEPARTED
    }
