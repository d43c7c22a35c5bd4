"""Observed rows out of a recording: who the mixture sent, by the events and the ground truth."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from are_ros.artefacts.artefact import Origin
from are_ros.artefacts.scenario import FIRST_ADMITTED_ID
from are_ros.bag.decoded import ARRIVED, BLOCKED, Event, Scene
from are_ros.bag.recording import Recording, find_recording
from are_ros.errors import BagError, InputError
from are_ros.replay.fit_input import ObservedRows, OpenProgress, RowSpace
from are_ros.wording import counted

_EVENT: Final = "are_msgs/msg/ArtefactEvent"
_ARRAY: Final = "are_msgs/msg/ArtefactArray"
_COUNTED: Final = ("arrived", "blocked", "without an event")


class _Key(NamedTuple):
    """One coming: a node's name, the artefact's id, and when. A node begun anew counts anew."""

    node: str
    artefact_id: int
    time_ns: int


class _Known(NamedTuple):
    """What the ground truth says of an artefact."""

    row: int
    label: str
    origin: int


@dataclass
class Census:
    """Who came, who could not, and who was there, each of them once however often it is told."""

    arrived: dict[_Key, str] = field(default_factory=dict)
    blocked: dict[_Key, str] = field(default_factory=dict)
    seen: dict[_Key, _Known] = field(default_factory=dict)
    begun_ns: dict[str, int] = field(default_factory=dict)
    low_scripted: set[str] = field(default_factory=set)
    """Nodes whose scenario gives low ids; nobody comes at random beside such a scenario."""

    def take_event(self, node: str, event: Event) -> None:
        """Keep an event of a node."""
        self.begun_ns.setdefault(node, event.stamp_ns)
        kinds = {ARRIVED: self.arrived, BLOCKED: self.blocked}
        if event.kind in kinds:
            kinds[event.kind][_Key(node, event.artefact_id, event.stamp_ns)] = event.label

    def take_scene(self, node: str, scene: Scene) -> None:
        """Keep a list of the living of a node."""
        self.begun_ns.setdefault(node, scene.stamp_ns)
        columns = (scene.ids, scene.arrivals_ns, scene.rows, scene.labels, scene.origins)
        for artefact_id, arrival_ns, row, label, origin in zip(*columns, strict=True):
            key = _Key(node, int(artefact_id), int(arrival_ns))
            if key not in self.seen:
                known = self.seen[key] = _Known(int(row), label, int(origin))
                if known.origin == Origin.SCRIPTED and key.artefact_id < FIRST_ADMITTED_ID:
                    self.low_scripted.add(node)

    def comers(self) -> "Comers":
        """Return the labels of those whom the mixture sent within the recording."""
        comers = Comers()
        for key, label in self.arrived.items():
            comers.take("arrived" if self._is_random(key) else "asked for", label)
        for key, label in self.blocked.items():
            comers.take("blocked" if self._is_random(key) else "asked for", label)
        for key in (each for each in self.seen if each not in self.arrived):
            within = key.time_ns >= self.begun_ns[key.node]
            what = "without an event" if within else "there before"
            comers.take(what if self._is_random(key) else "asked for", self.seen[key].label)
        return comers

    def _is_random(self, key: _Key) -> bool:
        """Tell whether the mixture drew it; without the ground truth its id tells."""
        known = self.seen.get(key)
        if known is not None:
            return known.origin == Origin.RANDOM
        is_low = 0 < key.artefact_id < FIRST_ADMITTED_ID
        return is_low and key.node not in self.low_scripted


@dataclass
class Comers:
    """Labels and how many of them, by what became of them."""

    by_fate: dict[str, Counter[str]] = field(default_factory=dict)

    def take(self, fate: str, label: str) -> None:
        """Count one."""
        self.by_fate.setdefault(fate, Counter())[label] += 1

    def how_many(self, fate: str) -> int:
        """Return how many had this fate."""
        return sum(self.by_fate.get(fate, Counter()).values())

    def counted(self) -> Counter[str]:
        """Return the labels of those who count."""
        return sum((self.by_fate.get(fate, Counter()) for fate in _COUNTED), Counter())


def read_recording(path: Path, space: RowSpace, open_progress: OpenProgress) -> ObservedRows:
    """Count the arrivals of random artefacts, those blocked included, in a recording.

    Rows come from the ground truth, else from the labels of the catalogue. Those that were there
    before it began do not count: who stays long would be counted more often. InputError where a
    label's row is not known, or the recording was made with another catalogue.
    """
    census = Census()
    with Recording(find_recording(path)) as recording:
        types = recording.types
        topics = [name for name, kind in types.items() if kind in {_EVENT, _ARRAY}]
        if not topics:
            raise BagError(f"{path}: there are neither events nor artefacts of ar_builder in it")
        start_ns, end_ns = recording.span_ns
        move = open_progress(start_ns, end_ns)
        for message in recording.in_log_order(topics):
            node, value = message.topic.rpartition("/")[0], recording.decode(message)
            if isinstance(value, Event):
                census.take_event(node, value)
            else:
                census.take_scene(node, value)
            move(message.log_ns)
        move(end_ns)
    comers = census.comers()
    rows = _rows_by_label(path, census, space)
    counts = np.zeros(space.rows, dtype=np.int64)
    for label, count in comers.counted().items():
        counts[_row(path, label, rows)] += count
    kinds = {types[topic] for topic in topics}
    return ObservedRows(counts, tuple(_notes(comers, has_events=_EVENT in kinds)))


def _rows_by_label(path: Path, census: Census, space: RowSpace) -> dict[str, int]:
    """Return the row of each label known; InputError where recording and catalogue differ."""
    rows = dict(space.row_of_label)
    for known in census.seen.values():
        if known.row >= space.rows:
            message = f"{path}: artefacts: row {known.row} ({known.label}) is beyond the "
            raise InputError(f"{message}{counted(space.rows, 'row')} (--rows, --catalogue)")
        if rows.setdefault(known.label, known.row) != known.row or (
            space.catalogue is not None and known.label not in space.row_of_label
        ):
            message = (
                f"{path}: artefacts: {known.label} is row {known.row}, not so in the catalogue"
            )
            raise InputError(f"{message}: it was recorded with another (--catalogue)")
    return rows


def _row(path: Path, label: str, rows: dict[str, int]) -> int:
    if label not in rows:
        message = f"{path}: events: the row of {label!r} is not known, neither from the ground "
        raise InputError(f"{message}truth nor from a catalogue (--catalogue)")
    return rows[label]


def _notes(comers: Comers, *, has_events: bool) -> list[str]:
    """Say what was counted and what was left out."""
    parts = [f"{comers.how_many('arrived')} arrivals", f"{comers.how_many('blocked')} blocked"]
    untold = comers.how_many("without an event")
    if untold:
        parts.append(f"{untold} that came within the recording without an event")
    notes = [f"counted: {', '.join(parts)}"]
    left_out = [
        (comers.how_many("there before"), "there before the recording began"),
        (comers.how_many("asked for"), "scripted or asked for"),
    ]
    told = [f"{count} {reason}" for count, reason in left_out if count]
    if told:
        notes.append(f"left out: {', '.join(told)}")
    if not has_events:
        notes.append("no events were recorded, so blocked arrivals and the shortest lives lack")
    return notes
