"""The rows that `are fit` learns from: out of a table, a list, or a recording of ~/ar_builder."""

import csv
import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from are_ros.bag.decoded import ARRIVED, BLOCKED, Event, Scene
from are_ros.bag.file_order import ROS2_SUFFIXES
from are_ros.bag.recording import Recording, find_recording
from are_ros.errors import BagError, InputError
from are_ros.population.artefact import Origin
from are_ros.population.catalogue import Catalogue
from are_ros.population.mixture_fit import Counts, why_no_row
from are_ros.population.scenario import FIRST_ADMITTED_ID
from are_ros.replay.progress import OpenProgress
from are_ros.wording import counted

_TABLES: Final = (".csv", ".txt")


@dataclass(frozen=True, eq=False)
class RowSpace:
    """The rows that can occur: how many, and the catalogue with their labels (None: unknown)."""

    rows: int
    catalogue: Catalogue | None = None

    @classmethod
    def of(cls, catalogue: Catalogue) -> "RowSpace":
        """Return the rows of a catalogue."""
        return cls(len(catalogue.rows), catalogue)

    @cached_property
    def row_of_label(self) -> dict[str, int]:
        """The row of each label, as far as known."""
        rows = self.catalogue.rows if self.catalogue else ()
        return {row.label: row.index for row in rows}


@dataclass(frozen=True, eq=False)
class ObservedRows:
    """How often each row was drawn, int64 (rows,), and sentences on what was counted."""

    counts: Counts
    notes: tuple[str, ...] = ()


def read_observed(path: Path, space: RowSpace, open_progress: OpenProgress) -> ObservedRows:
    """Read the rows drawn out of a .csv or .txt table, a .json list, or a recording.

    Raises InputError, naming the file, the line or field and the reason, for what is no row of
    `space`, and BagError for a recording that cannot be read.
    """
    if is_recording(path):
        return read_recording(path, space, open_progress)
    if not path.exists():
        raise InputError(f"{path}: there is no such file or folder")
    if path.suffix == ".json":
        return read_list(path, space)
    if path.suffix in _TABLES:
        return read_table(path, space)
    known = ", ".join((*_TABLES, ".json", *ROS2_SUFFIXES))
    raise InputError(f"{path}: observed rows are read from {known} files and recordings' folders")


def is_recording(path: Path) -> bool:
    """Tell whether a path means a recording of ROS 2, by its name."""
    return path.is_dir() or path.suffix in ROS2_SUFFIXES


_ROW: Final = "row"
_LABEL: Final = "label"
_COUNT: Final = "count"
_SEPARATORS: Final = (",", ";", "\t")
_MOST: Final = 2**53

Line = tuple[int, list[str]]


def read_table(path: Path, space: RowSpace) -> ObservedRows:
    """Read a table: one column of rows, or one named `row` or `label`, maybe with a `count`.

    Separated by commas, semicolons or tabs; empty lines and those that begin with # are left out.
    """
    counts = [0] * space.rows
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            columns, lines = _columns(path, _lines(stream))
            for line, cells in lines:
                if len(cells) <= max(columns.values()):
                    raise InputError(f"{path}, line {line}: it has too few columns")
                where = f"{path}, line {line}"
                row_of, name = (_label_row, _LABEL) if _LABEL in columns else (_number_row, _ROW)
                row = row_of(where, cells[columns[name]], space)
                counts[row] += _count(where, cells[columns[_COUNT]] if _COUNT in columns else "1")
                if counts[row] > _MOST:
                    raise InputError(f"{where}: row {row} was counted more than 2^53 times")
    except (OSError, ValueError, csv.Error) as cause:
        raise _unreadable(path, cause) from cause
    return ObservedRows(np.array(counts, dtype=np.int64))


def read_list(path: Path, space: RowSpace) -> ObservedRows:
    """Read a JSON list of rows, or of their labels."""
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as cause:
        raise _unreadable(path, cause) from cause
    if not isinstance(content, list):
        raise InputError(f"{path}: it holds no list, but rows are read from one")
    counts = np.zeros(space.rows, dtype=np.int64)
    for entry, value in enumerate(content):
        counts[_entry_row(f"{path}, entry {entry}", value, space)] += 1
    return ObservedRows(counts)


def _lines(stream: Iterable[str]) -> Iterator[Line]:
    """Yield the number and the cells of each line that holds something."""
    lines = ("\n" if line.startswith("#") else line for line in stream)
    begin: list[str] = []
    for line in lines:
        begin.append(line)
        if line.strip():
            break
    separator = next((each for each in _SEPARATORS if each in "".join(begin)), _SEPARATORS[0])
    reader = csv.reader(chain(begin, lines), delimiter=separator)
    for cells in reader:
        if cells and (len(cells) > 1 or cells[0].strip()):
            yield reader.line_num, cells


def _columns(path: Path, lines: Iterator[Line]) -> tuple[dict[str, int], Iterator[Line]]:
    """Return the columns that count by name, and the lines below the header if there is one."""
    line, cells = next(lines, (0, [""]))
    names = [cell.strip().lower() for cell in cells]
    known: tuple[str, ...] = (_ROW, _LABEL, _COUNT)
    if twice := next((name for name in known if names.count(name) > 1), ""):
        raise InputError(f"{path}, line {line}: the column '{twice}' comes twice")
    found = {name: names.index(name) for name in known if name in names}
    if _ROW in found or _LABEL in found:
        if _ROW in found:
            found.pop(_LABEL, None)
        return found, lines
    if any(name and _number(name) is None for name in names) and len(names) > 1:
        raise InputError(f"{path}, line {line}: no column is named '{_ROW}' or '{_LABEL}'")
    if len(names) > 1:
        message = f"{path}, line {line}: {len(names)} columns, but no header names '{_ROW}'"
        raise InputError(message)
    if line and _number(names[0]) is None:
        reason = f"is not a number, nor a header that is '{_ROW}' or '{_LABEL}'"
        raise InputError(f"{path}, line {line}: row {cells[0].strip()!r} {reason}")
    return {_ROW: 0}, chain(((line, cells),), lines) if line else lines


def _entry_row(where: str, value: Any, space: RowSpace) -> int:
    if isinstance(value, str):
        return _label_row(where, value, space)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: {json.dumps(value)[:40]} is not a number")
    return _number_row(where, str(value), space)


def _label_row(where: str, label: str, space: RowSpace) -> int:
    if space.catalogue is None:
        raise InputError(f"{where}: the row of a label is known to a catalogue only (--catalogue)")
    row = space.row_of_label.get(label.strip())
    if row is None:
        raise InputError(f"{where}: the catalogue has no row labelled {label.strip()!r}")
    return row


def _number_row(where: str, text: str, space: RowSpace) -> int:
    value = _number(text)
    reason = "not a number" if value is None else why_no_row(value, space.rows)
    if value is None or reason:
        raise InputError(f"{where}: row {text.strip()!r} is {reason}")
    return int(value)


def _count(where: str, text: str) -> int:
    value = _number(text)
    if value is not None and value > _MOST:
        raise InputError(f"{where}: {_COUNT} {text.strip()} is above 2^53")
    if value is None or not value >= 0.0 or value != int(value):
        raise InputError(f"{where}: {_COUNT} {text.strip()!r} is no whole number from 0 on")
    return int(value)


def _number(text: str) -> float | None:
    """Return the number that a text is, None if it is none; 1_000 is Python, and none."""
    try:
        return None if "_" in text else float(text)
    except ValueError:
        return None


def _unreadable(path: Path, cause: Exception) -> InputError:
    if isinstance(cause, InputError):
        return cause
    if isinstance(cause, json.JSONDecodeError):
        return InputError(f"{path}, line {cause.lineno}: no valid JSON ({cause.msg.lower()})")
    reason = "not UTF-8 text" if isinstance(cause, UnicodeError) else None
    reason = reason or getattr(cause, "strerror", None) or str(cause)
    return InputError(f"{path} cannot be read ({str(reason).lower()})")


# The rows of a recording: random arrivals, by the events and the ground truth.


_EVENT: Final = "are_msgs/msg/ArtefactEvent"
_ARRAY: Final = "are_msgs/msg/ArtefactArray"
_COUNTED: Final = ("arrived", "blocked", "without an event")

Fates = dict[str, Counter[str]]
"""Labels and how many artefacts had them, by what became of these."""


class _Key(NamedTuple):
    """One arrival: node name, artefact id and time. A restarted node counts anew."""

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
    """The artefacts that arrived, were blocked, or were in a list; each counts once."""

    arrived: dict[_Key, str] = field(default_factory=dict)
    blocked: dict[_Key, str] = field(default_factory=dict)
    seen: dict[_Key, _Known] = field(default_factory=dict)
    begun_ns: dict[str, int] = field(default_factory=dict)
    low_scripted: set[str] = field(default_factory=set)
    """Nodes whose scenario gives low ids; such a scenario excludes random arrivals."""

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

    def labels_by_fate(self) -> Fates:
        """Return the labels of all, counted, by what became of them within the recording."""
        fates: Fates = defaultdict(Counter)
        told = [("arrived", *one) for one in self.arrived.items()]
        told += [("blocked", *one) for one in self.blocked.items()]
        for key, known in self.seen.items():
            if key not in self.arrived:
                within = key.time_ns >= self.begun_ns[key.node]
                told.append(("without an event" if within else "there before", key, known.label))
        for fate, key, label in told:
            fates[fate if self._is_random(key) else "asked for"][label] += 1
        return fates

    def _is_random(self, key: _Key) -> bool:
        """Tell whether the artefact was drawn from the mixture; without ground truth, by its id."""
        known = self.seen.get(key)
        if known is not None:
            return known.origin == Origin.RANDOM
        is_low = 0 < key.artefact_id < FIRST_ADMITTED_ID
        return is_low and key.node not in self.low_scripted


def read_recording(path: Path, space: RowSpace, open_progress: OpenProgress) -> ObservedRows:
    """Count the arrivals of random artefacts, those blocked included, in a recording.

    Rows come from the ground truth, else from the labels of the catalogue. Artefacts that were
    alive before it began do not count: long lives would be counted too often. InputError where a
    label's row is not known, or the recording was made with another catalogue.
    """
    census = Census()
    with Recording(find_recording(path)) as recording:
        types = recording.types
        topics = [name for name, kind in types.items() if kind in {_EVENT, _ARRAY}]
        if not topics:
            raise BagError(f"{path}: there are neither events nor artefacts of ar_builder in it")
        for message in recording.in_log_order(topics, open_progress):
            node, value = message.topic.rpartition("/")[0], recording.decode(message)
            if isinstance(value, Event):
                census.take_event(node, value)
            else:
                census.take_scene(node, value)
    fates = census.labels_by_fate()
    rows = _rows_by_label(path, census, space)
    counts = np.zeros(space.rows, dtype=np.int64)
    for label, count in sum((fates[fate] for fate in _COUNTED), Counter()).items():
        counts[_row(path, label, rows)] += count
    kinds = {types[topic] for topic in topics}
    return ObservedRows(counts, tuple(_notes(fates, has_events=_EVENT in kinds)))


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


def _notes(fates: Fates, *, has_events: bool) -> list[str]:
    """Say what was counted and what was left out."""
    count = Counter({fate: sum(labels.values()) for fate, labels in fates.items()})
    parts = [f"{count['arrived']} arrivals", f"{count['blocked']} blocked"]
    if untold := count["without an event"]:
        parts.append(f"{untold} that came within the recording without an event")
    notes = [f"counted: {', '.join(parts)}"]
    left_out = [
        (count["there before"], "there before the recording began"),
        (count["asked for"], "scripted or asked for"),
    ]
    told = [f"{number} {reason}" for number, reason in left_out if number]
    if told:
        notes.append(f"left out: {', '.join(told)}")
    if not has_events:
        notes.append("no events were recorded, so blocked arrivals and the shortest lives lack")
    return notes
