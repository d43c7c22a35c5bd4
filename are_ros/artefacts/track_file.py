"""Tracks of artefacts as CSV: a line per pose, rounded to a micrometre and a microradian."""

import csv
import math
from array import array
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Final

import numpy as np

from are_ros.artefacts.scenario import Track
from are_ros.conventions import NS_PER_S
from are_ros.errors import ScenarioError
from are_ros.wording import why_refused

_WHO: Final = "artefact"
_TIME: Final = "t_s"
_POSE: Final = ("x_m", "y_m", "z_m", "yaw_rad")
_NEEDED: Final = (_TIME, *_POSE)
COLUMNS: Final = (_WHO, *_NEEDED)
_DECIMALS: Final = 6

_SECOND_DIGITS: Final = 9
_MOST_S: Final = 10**_SECOND_DIGITS


def write_tracks(path: Path, tracks: Mapping[str, Track]) -> None:
    """Write tracks by the key of their artefact (an id or a name); ScenarioError if that fails."""
    try:
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            for key, track in tracks.items():
                for t_ns, pose in zip(track.times_ns.tolist(), track.poses.tolist(), strict=True):
                    numbers = (round(number, _DECIMALS) for number in pose)
                    writer.writerow((key, seconds_text(t_ns), *numbers))
    except OSError as cause:
        raise ScenarioError(f"{path} cannot be written ({why_refused(cause)})") from cause


def read_tracks(path: Path) -> dict[str, Track]:
    """Read tracks by the key of their artefact, "" in a file without the column `artefact`.

    ScenarioError, a sentence that names file, line, column and reason, for whatever is wrong.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            return _read(path, csv.reader(file))
    except (OSError, ValueError, csv.Error) as cause:
        reason = getattr(cause, "strerror", None) or "it is no CSV of UTF-8 text"
        raise ScenarioError(f"{path} cannot be read ({reason})") from cause


@dataclass(eq=False, slots=True)
class _Reading:
    """The poses of one artefact so far."""

    times_ns: "array[int]" = field(default_factory=lambda: array("q"))
    numbers: "array[float]" = field(default_factory=lambda: array("d"))


def _read(path: Path, lines: Iterator[list[str]]) -> dict[str, Track]:
    names = [name.strip() for name in next(lines, [])]
    _check_columns(path, names)
    readings: defaultdict[str, _Reading] = defaultdict(_Reading)
    for number, line in enumerate(lines, start=2):
        if not line:
            continue
        place = f"{path}, line {number}"
        if len(line) != len(names):
            raise ScenarioError(f"{place}: it has {len(line)} cells, the first line {len(names)}")
        cells = dict(zip(names, line, strict=True))
        reading = readings[cells.get(_WHO, "")]
        try:
            reading.times_ns.append(_seconds(cells[_TIME]))
            reading.numbers.extend([_number(column, cells[column]) for column in _POSE])
        except ValueError as cause:
            raise ScenarioError(f"{place}: {cause}") from cause
    return {key: _track(path, key, reading) for key, reading in readings.items()}


def _track(path: Path, key: str, reading: _Reading) -> Track:
    """Return the track that was read; ScenarioError where it is none."""
    poses = np.array(reading.numbers).reshape(-1, len(_POSE))
    try:
        return Track(np.array(reading.times_ns), poses)
    except ScenarioError as cause:
        who = f", artefact {key}" if key else ""
        raise ScenarioError(f"{path}{who}: {cause}") from cause


def _check_columns(path: Path, names: Sequence[str]) -> None:
    for name in names:
        if name not in COLUMNS or names.count(name) > 1:
            fault = "comes twice" if name in COLUMNS else "is not known"
            msg = f"{path}: its first line names the columns, but {name!r} {fault}"
            raise ScenarioError(f"{msg}; known are {', '.join(COLUMNS)}")
    for name in _NEEDED:
        if name not in names:
            raise ScenarioError(f"{path}: its first line names the columns, but {name} is missing")


def _number(column: str, cell: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{column} is {cell!r}, but a finite number is needed")
    return number


def _seconds(cell: str) -> int:
    try:
        return ns_of_seconds(cell)
    except ValueError as cause:
        raise ValueError(f"{_TIME} {cause}") from cause


def ns_of_seconds(value: object) -> int:
    """Return a number, or its decimal text, of seconds in [0, 1e9] as the nearest nanosecond.

    A float counts as the shortest text that stands for it, so that 0.1 is 100,000,000 ns. Raises
    ValueError for anything else; its text goes on from the name of a field.
    """
    if isinstance(value, bool):
        raise ValueError(f"is {value!r}, but seconds are needed")  # noqa: TRY004 - one kind for all
    text = value.strip() if isinstance(value, str) else repr(value)
    try:
        seconds = Decimal(text)
        is_in_range = 0 <= seconds <= _MOST_S
    except ArithmeticError as cause:
        raise ValueError(f"is {value!r}, but seconds are needed") from cause
    if not is_in_range:
        raise ValueError(f"is {text}, but seconds from 0 to 1e9 are taken")
    return int((seconds * NS_PER_S).to_integral_value())


def seconds_text(t_ns: int) -> str:
    """Return nanoseconds >= 0 as seconds, in as many decimals as it takes and no more."""
    whole, part = divmod(t_ns, NS_PER_S)
    return f"{whole}.{part:0{_SECOND_DIGITS}d}".rstrip("0").rstrip(".")
