"""Lives: the events, the lists of artefacts and the counts of the metrics tell one story."""

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, Tally, at_s
from are_ros.replay._check_scene import Scene, time_ns

ARRIVED, DEPARTED, BLOCKED, DISPLACED, PERCEIVED, LOST, ROBOT_CONTACT = range(7)
"""The kinds of are_msgs/ArtefactEvent."""

_DISPLACED_DETAIL = "displaced"


def check_ticks(record: Record) -> CheckResult:
    """Every tick has its artefacts, perceived and metrics, stamped alike, in the world frame."""
    tally = Tally("ticks", "ticks")
    scenes = record.scenes
    for scene in scenes:
        tally.look()
        ids = scene.ids.tolist()
        where = at_s(scene.stamp_ns)
        tally.require(
            scene.stamp_ns == scene.log_ns, f"the artefacts logged {at_s(scene.log_ns)} are {where}"
        )
        tally.require(all(a < b for a, b in pairwise(ids)), f"{where} ids do not ascend: {ids}")
        tally.require(
            scene.frame_id == record.world_frame, f"{where} the frame is '{scene.frame_id}'"
        )
        if scene.problems:
            tally.fail(f"{where} {scene.problems[0]}")
    for before, after in pairwise(scenes):
        if after.stamp_ns <= before.stamp_ns:
            tally.fail(f"{at_s(after.stamp_ns)} does not follow {at_s(before.stamp_ns)}")
    stamps = [scene.stamp_ns for scene in scenes]
    for name, messages in (("perceived", record.perceived), ("metrics", record.metrics)):
        _check_stamps(tally, name, messages, stamps, record.world_frame)
    return tally.result()


def _check_stamps(
    tally: Tally, name: str, messages: list[tuple[int, Any]], stamps: list[int], frame_id: str
) -> None:
    if [log_ns for log_ns, _ in messages] != stamps:
        other = {log_ns for log_ns, _ in messages} ^ set(stamps)
        where = at_s(min(other)) if other else "at some tick"
        tally.fail(f"~/{name} and ~/artefacts differ {where}: one of them has no message")
    for log_ns, message in messages:
        header = message.header
        if time_ns(header.stamp) != log_ns or header.frame_id != frame_id:
            stamp_ns = time_ns(header.stamp)
            text = f"~/{name} {at_s(log_ns)} is stamped {at_s(stamp_ns)} in '{header.frame_id}'"
            tally.fail(text)


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


def check_lives(record: Record) -> CheckResult:
    """Ids are never reused, and each tick lists those who arrived and did not depart."""
    tally = Tally("lives", "ticks")
    story = _Story(tally)
    for scene, events, since_ns in events_by_tick(record):
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
    """Compare the counts of the metrics with those of the events and lists so far."""
    tally = Tally("metrics", "messages")
    metrics = dict(record.metrics)
    seen = record.perceived_ids()
    counts: Counter[int] = Counter()
    censored: set[tuple[int, int]] = set()
    for scene, events, _ in events_by_tick(record):
        for event in events:
            counts[event.kind] += 1
            if event.kind == DISPLACED or event.detail == _DISPLACED_DETAIL:
                censored.add((int(event.id), time_ns(event.header.stamp)))
        message = metrics.get(scene.log_ns)
        if message is None:
            continue
        tally.look()
        wanted = {
            "alive": len(scene.ids),
            "perceived": len(seen.get(scene.log_ns, ())),
            "arrivals": counts[ARRIVED],
            "departures": counts[DEPARTED],
            "blocked": counts[BLOCKED],
            "displaced": len(censored),
            "robot_contacts": counts[ROBOT_CONTACT],
        }
        for name, count in wanted.items():
            found = int(getattr(message, name))
            text = f"{at_s(scene.stamp_ns)} {name} is {found}, events and lists say {count}"
            tally.require(found == count, text)
    return tally.result()


def events_by_tick(record: Record) -> Iterator[tuple[Scene, list[Any], int]]:
    """Yield each tick's scene with the events that it gives, and the stamp of the tick before."""
    by_log: dict[int, list[Any]] = {}
    for log_ns, event in record.events:
        by_log.setdefault(log_ns, []).append(event)
    since_ns = -1
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
