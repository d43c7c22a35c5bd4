"""Tracks of artefacts as CSV, with all digits: what is read is what was written, bit by bit.

The first line names the columns. An empty cell repeats what the line before of the same artefact
has there, and so do cells that are left out at the end. A line whose cells of the pose are all
empty is no pose: it only tells what the artefact does from then on.
"""

import csv
import math
from array import array
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from heapq import merge
from io import StringIO
from operator import itemgetter
from pathlib import Path
from typing import Final, TextIO

import numpy as np
import numpy.typing as npt

from are_ros.artefacts._seconds import ns_of_seconds, seconds_text
from are_ros.artefacts.scenario import Doing, Track
from are_ros.errors import ScenarioError
from are_ros.wording import why_refused

_WHO: Final = "artefact"
_TIME: Final = "t_s"
_POSE: Final = ("x_m", "y_m", "z_m", "yaw_rad")
_DOING: Final = ("behaviour", "activity", "departs_s")
COLUMNS: Final = (_WHO, _TIME, *_POSE, *_DOING)
_NEEDED: Final = (_TIME, *_POSE)
_NONE: Final = "-"
"""No activity, or no end of life that is known; a text of dashes only gets one more."""

_END: Final = "\r\n"
_PART_BYTES: Final = 1 << 20

_Cells = list[str]


def write_tracks(path: Path, tracks: Mapping[str, Track]) -> None:
    """Write tracks by the key of their artefact (an id or a name); ScenarioError if that fails."""
    try:
        with path.open("w", encoding="utf-8", newline="") as file:
            _write(file, tracks)
    except OSError as cause:
        raise ScenarioError(f"{path} cannot be written ({why_refused(cause)})") from cause


def lines_in(path: Path) -> int:
    """Return how many lines of a file have an end; one that was cut off has fewer than before.

    ScenarioError if it cannot be read.
    """
    try:
        with path.open("rb") as file:
            return sum(part.count(b"\n") for part in iter(lambda: file.read(_PART_BYTES), b""))
    except OSError as cause:
        raise ScenarioError(f"{path} cannot be read ({cause.strerror})") from cause


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


# ---------------------------------------------------------------------------------- writing


def _write(file: TextIO, tracks: Mapping[str, Track]) -> None:
    file.write(_line(COLUMNS))
    for key, track in tracks.items():
        who = _line([key]).removesuffix(_END)
        for t_ns, cells in merge(_pose_cells(track), _doing_cells(track), key=itemgetter(0)):
            file.write(f"{who},{seconds_text(t_ns)}{cells}")
            who = ""


def _pose_cells(track: Track) -> Iterator[tuple[int, str]]:
    """Yield the instant and the cells of each pose; x is never left out, or it would be none."""
    y = z = yaw = ""
    for t_ns, pose in zip(track.times_ns.tolist(), track.poses.tolist(), strict=True):
        was = y, z, yaw
        x, y, z, yaw = map(repr, pose)
        changed = [
            "" if now == before else now for now, before in zip((y, z, yaw), was, strict=True)
        ]
        yield t_ns, f",{x},{','.join(changed)}{_END}"


def _doing_cells(track: Track) -> Iterator[tuple[int, str]]:
    for doing in track.doings:
        ends_ns = doing.departs_ns
        ends = _NONE if ends_ns is None else seconds_text(ends_ns)
        said = _line([doing.behaviour, _dashed(doing.activity), ends])
        yield doing.t_ns, f"{',' * (len(_POSE) + 1)}{said}"


def _line(cells: Sequence[str]) -> str:
    """Return cells as a line of CSV, quoted where they have to be."""
    line = StringIO()
    csv.writer(line, lineterminator=_END).writerow(cells)
    return line.getvalue()


def _dashed(text: str) -> str:
    return text if text.strip(_NONE) else text + _NONE


def _undashed(cell: str) -> str:
    return cell if cell.strip(_NONE) else cell[1:]


# ---------------------------------------------------------------------------------- reading


@dataclass(eq=False, slots=True)
class _Reading:
    """One artefact's track as far as it is read; `cells` are the last of each column."""

    times_ns: "array[int]" = field(default_factory=lambda: array("q"))
    numbers: "array[float]" = field(default_factory=lambda: array("d"))
    doings: list[Doing] = field(default_factory=list)
    pose: list[float] = field(default_factory=lambda: [math.nan] * len(_POSE))
    doing: _Cells = field(default_factory=lambda: ["", _NONE, _NONE])


def _read(path: Path, lines: Iterator[_Cells]) -> dict[str, Track]:
    names = [name.strip() for name in next(lines, [])]
    _check_columns(path, names)
    places = [names.index(name) if name in names else len(names) for name in COLUMNS]
    readings: defaultdict[str, _Reading] = defaultdict(_Reading)
    key, blank = "", [""] * (len(names) + 1)
    for number, line in enumerate(lines, start=2):
        if not line:
            continue
        if len(line) > len(names):
            raise ScenarioError(f"{path}, line {number}: it has more cells than the first line")
        line.extend(blank[len(line) :])
        key = line[places[0]] or key
        try:
            _take(readings[key], [line[place] for place in places])
        except ValueError as cause:
            raise ScenarioError(f"{path}, line {number}: {cause}") from cause
    return dict(_finished(path, readings.items()))


def _finished(path: Path, readings: Iterable[tuple[str, _Reading]]) -> Iterator[tuple[str, Track]]:
    for key, reading in readings:
        yield key, _track(f"{path}" + (f", artefact {key}" if key else ""), reading)


def _track(place: str, reading: _Reading) -> Track:
    """Return the track that was read; ScenarioError where it is none."""
    poses: npt.NDArray[np.float64] = np.array(reading.numbers).reshape(-1, len(_POSE))
    try:
        return Track(np.array(reading.times_ns, np.int64), poses, tuple(reading.doings))
    except ScenarioError as cause:
        raise ScenarioError(f"{place}: {cause}") from cause


def _check_columns(path: Path, names: Sequence[str]) -> None:
    for name in names:
        if name not in COLUMNS or names.count(name) > 1:
            fault = "comes twice" if name in COLUMNS else "is not known"
            msg = f"{path}: its first line names the columns, but {name!r} {fault}"
            raise ScenarioError(f"{msg}; known are {', '.join(COLUMNS)}")
    for name in _NEEDED:
        if name not in names:
            raise ScenarioError(f"{path}: its first line names the columns, but {name} is missing")


def _take(reading: _Reading, cells: _Cells) -> None:
    """Take one line, whose cells are in the order of COLUMNS; ValueError names the column."""
    t_ns = _seconds(_TIME, cells[1])
    pose, doing = cells[2:6], cells[6:9]
    if any(pose):
        reading.times_ns.append(t_ns)
        reading.numbers.extend(_filled(reading.pose, pose))
    elif not any(doing):
        raise ValueError("it tells neither a pose nor what the artefact does")
    if any(doing):
        reading.doings.append(_doing(t_ns, reading.doing, doing))


def _filled(before: list[float], cells: _Cells) -> list[float]:
    """Write the numbers that are given over those before, and return these."""
    for k, cell in enumerate(cells):
        if cell:
            before[k] = _number(_POSE[k], cell)
        elif math.isnan(before[k]):
            raise ValueError(f"{_POSE[k]} is missing")
    return before


def _doing(t_ns: int, before: _Cells, cells: _Cells) -> Doing:
    for k, cell in enumerate(cells):
        before[k] = cell or before[k]
    behaviour, activity, ends = before
    if not behaviour:
        raise ValueError("behaviour is missing")
    ends_ns = None if ends == _NONE else _seconds("departs_s", ends)
    return Doing(t_ns, behaviour, _undashed(activity), ends_ns)


def _number(column: str, cell: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{column} is {cell!r}, but a finite number is needed")
    return number


def _seconds(column: str, cell: str) -> int:
    try:
        return ns_of_seconds(cell)
    except ValueError as cause:
        raise ValueError(f"{column} {cause}") from cause
