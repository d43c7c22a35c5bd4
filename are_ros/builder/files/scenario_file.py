"""Reading and writing scenarios: YAML, with long tracks in a CSV file; see docs/scenarios.md.

The CSV file has a line per pose, rounded to a micrometre and a microradian.
"""

import csv
import io
import math
from array import array
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import yaml

from are_ros.agents.behaviours.along_way import AlongWay
from are_ros.agents.behaviours.following import Following
from are_ros.agents.behaviours.registry import why_not
from are_ros.agents.behaviours.situation import Standing
from are_ros.agents.local_planner.user_planners import why_not as why_no_planner
from are_ros.conventions import NS_PER_S
from are_ros.errors import CatalogueError, ScenarioError
from are_ros.population.artefact import GroundPose, Origin
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.departures import Cause
from are_ros.population.scenario import Scenario, ScriptedArtefact, Track
from are_ros.whole_file import write_whole
from are_ros.wording import why_refused
from are_ros.yaml_text import Dumper, Fields, read_yaml

_KEY: Final = "artefact"
_TIME: Final = "t_s"
_POSE: Final = ("x_m", "y_m", "z_m", "yaw_rad")
_NEEDED: Final = (_TIME, *_POSE)
COLUMNS: Final = (_KEY, *_NEEDED)
_DECIMALS: Final = 6

_SECOND_DIGITS: Final = 9
_MOST_S: Final = 10**_SECOND_DIGITS


def write_tracks(path: Path, tracks: Mapping[str, Track]) -> None:
    """Write tracks by the key of their artefact (an id or a name); ScenarioError if that fails."""
    table = io.StringIO()
    writer = csv.writer(table)
    writer.writerow(COLUMNS)
    for key, track in tracks.items():
        for t_ns, pose in zip(track.times_ns.tolist(), track.poses.tolist(), strict=True):
            numbers = (round(number, _DECIMALS) for number in pose)
            writer.writerow((key, seconds_text(t_ns), *numbers))
    _write(path, table.getvalue())


def _write(path: Path, text: str) -> None:
    """Write a text file; ScenarioError if that fails."""
    try:
        write_whole(path, text.encode())
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


def _read(path: Path, lines: Iterator[list[str]]) -> dict[str, Track]:
    names = [name.strip() for name in next(lines, [])]
    _check_columns(path, names)
    times_ns: defaultdict[str, array[int]] = defaultdict(lambda: array("q"))
    numbers: defaultdict[str, array[float]] = defaultdict(lambda: array("d"))
    for number, line in enumerate(lines, start=2):
        if not line:
            continue
        place = f"{path}, line {number}"
        if len(line) != len(names):
            raise ScenarioError(f"{place}: it has {len(line)} cells, the first line {len(names)}")
        cells = dict(zip(names, line, strict=True))
        key = cells.get(_KEY, "")
        try:
            times_ns[key].append(_seconds_of_cell(cells[_TIME]))
            numbers[key].extend([_number(column, cells[column]) for column in _POSE])
        except ValueError as cause:
            raise ScenarioError(f"{place}: {cause}") from cause
    return {key: _read_track(path, key, times_ns[key], numbers[key]) for key in times_ns}


def _read_track(path: Path, key: str, times_ns: "array[int]", numbers: "array[float]") -> Track:
    """Return the track of one artefact; ScenarioError where its poses are no track."""
    try:
        return Track(np.array(times_ns), np.array(numbers).reshape(-1, len(_POSE)))
    except ScenarioError as cause:
        artefact = f", artefact {key}" if key else ""
        raise ScenarioError(f"{path}{artefact}: {cause}") from cause


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


def _seconds_of_cell(cell: str) -> int:
    try:
        return ns_of_seconds(cell)
    except ValueError as cause:
        raise ValueError(f"{_TIME} {cause}") from cause


def ns_of_seconds(value: object) -> int:
    """Return a number, or its decimal text, of seconds in [0, 1e9] as the nearest nanosecond.

    A float counts as its shortest decimal text, so 0.1 is 100,000,000 ns. Raises ValueError for
    anything else; its text continues a sentence that begins with the name of a field.
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
    """Return nanoseconds >= 0 as the shortest exact decimal text of seconds."""
    whole, part = divmod(t_ns, NS_PER_S)
    return f"{whole}.{part:0{_SECOND_DIGITS}d}".rstrip("0").rstrip(".")


_EXACT_DIGITS: Final = 15
"""A decimal of so many digits is the shortest text of the float that YAML makes of it."""
_LINE: Final = 100

_MOVEMENTS: Final = ("way", "follows", "track")
_NOT_BESIDE_TRACK: Final = ("at", "speed", "planner")
_KEYS: Final = (
    *("label", "row", "id", "name", "at", "arrives", "stays", "behaviour", "way", "loop"),
    *("speed", "planner", "follows", "track", "origin", "left_by"),
)
_ORIGINS: Final = {origin.name.lower(): origin for origin in Origin}
_BLOCKS: Final = (Cause.MAX_ALIVE, Cause.NO_PLACE, Cause.NO_HIDDEN_PLACE, Cause.REFUSED)
_CAUSES: Final = {cause.value: cause for cause in Cause if cause not in _BLOCKS}


def read_scenario(path: Path, catalogue: Catalogue) -> Scenario:
    """Read a scenario, whose artefacts are of a catalogue.

    ScenarioError, one sentence that names file, artefact (index and name), field and reason, for
    whatever is wrong.
    """
    content = read_yaml(path, f"the scenario {path}", ScenarioError)
    document = Fields(str(path), content, ("scenario", "artefacts"), ScenarioError)
    head = document.section("scenario", ("name", "random"))
    entries = document.raw("artefacts")
    if not isinstance(entries, list):
        document.refuse("artefacts", "must be a list of artefacts; it may be empty")
    files = _TrackFiles(path.parent)
    artefacts = [
        _artefact(Fields(_place(path, index, entry), entry, _KEYS, ScenarioError), catalogue, files)
        for index, entry in enumerate(entries)
    ]
    name = head.text("name", "")
    random = head.flag("random", default=True)
    try:
        return Scenario(tuple(artefacts), random, name)
    except ScenarioError as cause:
        raise ScenarioError(f"{path}: {cause}") from cause


def scenario_files(path: Path) -> tuple[Path, Path]:
    """Return the files of a scenario: the YAML file, and the CSV file of its long tracks."""
    return path, path.with_name(f"{path.stem}.tracks.csv")


def write_scenario(scenario: Scenario, path: Path, catalogue: str = "") -> list[Path]:
    """Write a scenario, and its long tracks beside it as NAME.tracks.csv; return the files.

    A comment names the file of a `catalogue` other than the shipped one. Times are exact to the
    nanosecond; poses of long tracks are rounded to a micrometre. ScenarioError if the
    files cannot be written.
    """
    _, sidecar = scenario_files(path)
    artefacts = scenario.artefacts
    tracks: dict[str, Track] = {}
    for one in artefacts:
        if one.track is not None and len(one.track) > 1 and _key(one):
            tracks.setdefault(_key(one), one.track)
    head: dict[str, Any] = {"name": scenario.name} if scenario.name else {}
    head["random"] = scenario.random
    if tracks:
        write_tracks(sidecar, tracks)
    entries = [_entry(one, tracks, sidecar.name) for one in artefacts]
    content = {"scenario": head, "artefacts": entries}
    text = yaml.dump(
        content,
        Dumper=Dumper,
        sort_keys=False,
        allow_unicode=True,
        width=_LINE,
        default_flow_style=None,
    )
    if catalogue:
        text = f"# Its artefacts are of the catalogue {catalogue}: replay it with that one.\n{text}"
    _write(path, text)
    return [path, sidecar] if tracks else [path]


def _place(path: Path, index: int, entry: object) -> str:
    """Return the name of an entry in error messages, before it is checked."""
    name = None
    if isinstance(entry, dict):
        name = next((entry[key] for key in ("name", "label", "row") if key in entry), None)
    return f"{path}: artefact {index}" + ("" if name is None else f" ({name})")


def _key(artefact: ScriptedArtefact) -> str:
    return artefact.name if artefact.artefact_id is None else str(artefact.artefact_id)


def _entry(artefact: ScriptedArtefact, beside: Mapping[str, Track], sidecar: str) -> dict[str, Any]:
    """Return the YAML entry of one artefact, without fields that have their default.

    Its track is in the file `sidecar` if it is among those `beside`.
    """
    given: dict[str, Any] = {"label": artefact.row.label}
    if artefact.artefact_id is not None:
        given["id"] = artefact.artefact_id
    if artefact.name:
        given["name"] = artefact.name
    given["arrives"] = _seconds(artefact.arrives_ns)
    if artefact.stays_ns is not None:
        given["stays"] = _seconds(artefact.stays_ns)
    if artefact.origin is not Origin.SCRIPTED:
        given["origin"] = artefact.origin.name.lower()
    if artefact.cause is not Cause.LIFE_OVER:
        given["left_by"] = artefact.cause.value
    return given | _movement(artefact, beside, sidecar)


def _movement(
    artefact: ScriptedArtefact, beside: Mapping[str, Track], sidecar: str
) -> dict[str, Any]:
    given: dict[str, Any] = {}
    if artefact.follows:
        given["follows"] = artefact.follows
    elif not artefact.way_m and artefact.behaviour != "standing":
        given["behaviour"] = artefact.behaviour
    if artefact.track is not None:
        is_beside = beside.get(_key(artefact)) is artefact.track
        return given | {"track": sidecar if is_beside else _inline(artefact.track)}
    pose = artefact.pose
    given["at"] = [pose.x_m, pose.y_m, pose.yaw_rad]
    if artefact.speed_mps is not None:
        given["speed"] = artefact.speed_mps
    if artefact.planner:
        given["planner"] = artefact.planner
    if artefact.way_m:
        given |= {"way": [list(point) for point in artefact.way_m], "loop": artefact.loop}
    return given


def _inline(track: Track) -> list[list[Any]]:
    times_ns, poses = track.times_ns.tolist(), track.poses.tolist()
    return [[_seconds(t_ns), *pose] for t_ns, pose in zip(times_ns, poses, strict=True)]


def _seconds(t_ns: int) -> int | float | str:
    """Return seconds as a number if YAML keeps it exactly, else as text."""
    text = seconds_text(t_ns)
    if "." not in text:
        return int(text)
    return float(text) if len(text) - 1 <= _EXACT_DIGITS else text


class _TrackFiles:
    """The tracks of files, named relative to a folder; each file is read once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._tracks: dict[str, dict[str, Track]] = {}

    def track(self, file: str, keys: tuple[str, ...]) -> Track:
        """Return the track of the first key that the file has; ScenarioError if it has none."""
        if file not in self._tracks:
            self._tracks[file] = read_tracks(self._folder / file)
        tracks = self._tracks[file]
        for key in (*keys, ""):
            if key in tracks:
                return tracks[key]
        known = " or ".join(map(repr, keys)) or "without a key (the artefact has no id and no name)"
        raise ScenarioError(f"{self._folder / file} has no track {known}")


def _artefact(given: Fields, catalogue: Catalogue, files: _TrackFiles) -> ScriptedArtefact:
    """Read one artefact; ScenarioError, with its place and field, for whatever is wrong."""
    _check_movements(given)
    row = _row(given, catalogue)
    name = given.text("name", "")
    artefact_id = _id(given)
    track = _track(given, files, artefact_id, name)
    arrives_ns = 0 if track is None else int(track.times_ns[0])
    if "arrives" in given:
        arrives_ns = _ns(given, "arrives", given.raw("arrives"))
    stays = given.raw("stays")
    speed_mps, planner = _speed_mps(given, row), _planner(given, row)
    moved = row if speed_mps is None else _at_speed(row, speed_mps)
    return ScriptedArtefact(
        row=replace(moved, planners={planner: 1.0}) if planner else moved,
        pose=_pose(given) if track is None else track.pose_at(arrives_ns),
        arrives_ns=arrives_ns,
        stays_ns=None if stays is None or stays == "forever" else _ns(given, "stays", stays),
        behaviour=_behaviour(given, row),
        way_m=_way(given),
        loop=given.flag("loop", default=False),
        follows=given.text("follows", ""),
        track=track,
        artefact_id=artefact_id,
        name=name,
        speed_mps=speed_mps,
        planner=planner,
        origin=_ORIGINS[given.choice("origin", tuple(_ORIGINS), "scripted")],
        cause=_CAUSES[given.choice("left_by", tuple(_CAUSES), Cause.LIFE_OVER.value)],
    )


def _check_movements(given: Fields) -> None:
    """Refuse fields that contradict each other."""
    kinds = [key for key in _MOVEMENTS if key in given]
    if len(kinds) > 1:
        given.refuse(kinds[1], f"is given beside {kinds[0]}; an artefact has one of them")
    for key in _NOT_BESIDE_TRACK:
        if "track" in given and key in given:
            given.refuse(key, "is given beside track, which gives all poses")
    if "loop" in given and "way" not in given:
        given.refuse("loop", "is given, but there is no way to repeat")


def _row(given: Fields, catalogue: Catalogue) -> CatalogueRow:
    if "row" not in given:
        return _row_of_label(given, catalogue)
    if "label" in given:
        given.refuse("label", "is given beside row; one of them is enough")
    index, count = given.raw("row"), len(catalogue.rows)
    if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < count:
        given.refuse("row", f"is {index!r}, but the catalogue has rows 0 to {count - 1}")
    return catalogue.rows[index]


def _row_of_label(given: Fields, catalogue: Catalogue) -> CatalogueRow:
    label = given.text("label")
    try:
        rows = catalogue.rows_named(label)
    except CatalogueError as cause:
        given.refuse("label", f"cannot be used: {cause}")
    if len(rows) > 1:
        labels = ", ".join(row.label for row in rows)
        given.refuse("label", f"is {label!r}, a class of several rows; take one of {labels}")
    return rows[0]


def _id(given: Fields) -> int | None:
    if "id" not in given:
        return None
    value = given.raw("id")
    if isinstance(value, bool) or not isinstance(value, int):
        given.refuse("id", f"is {value!r}, but a whole number is needed")
    return value


def _ns(given: Fields, key: str, value: object) -> int:
    try:
        return ns_of_seconds(value)
    except ValueError as cause:
        given.refuse(key, str(cause))


def _pose(given: Fields) -> GroundPose:
    if "at" not in given:
        given.refuse("at", "is missing: [x, y, yaw] in the map's frame, or a track")
    x_m, y_m, yaw_rad = given.vector("at", given.raw("at"), "x, y, yaw")
    return GroundPose(x_m, y_m, 0.0, yaw_rad)


def _behaviour(given: Fields, row: CatalogueRow) -> str:
    """Return the behaviour; on a track it is only a label for the outputs."""
    if "track" in given:
        return given.text("behaviour", Standing.name)
    for key, name in (("way", AlongWay.name), ("follows", Following.name)):
        if key in given:
            _check_moves(given, key, row)
            if "behaviour" in given and given.text("behaviour") != name:
                given.refuse("behaviour", f"is given beside {key}, which makes it {name}")
            return name
    behaviour = given.text("behaviour", Standing.name)
    reason = why_not(behaviour, row.motion.speed_mps)
    if reason:
        given.refuse("behaviour", f"is {behaviour!r}, which {reason}")
    return behaviour


def _check_moves(given: Fields, key: str, row: CatalogueRow) -> None:
    if row.motion.speed_mps <= 0.0:
        given.refuse(key, f"is given, but {row.label} cannot move (its motion.speed_mps is 0)")


def _way(given: Fields) -> tuple[tuple[float, float], ...]:
    if "way" not in given:
        return ()
    points = given.raw("way")
    if not isinstance(points, list) or not points:
        given.refuse("way", f"is {points!r}, but a list of points [x, y] is needed")
    way = [given.vector(f"way[{k}]", point, "x, y") for k, point in enumerate(points)]
    return tuple((x_m, y_m) for x_m, y_m in way)


def _at_speed(row: CatalogueRow, speed_mps: float) -> CatalogueRow:
    """Return the row with another speed."""
    return replace(row, motion=replace(row.motion, speed_mps=speed_mps))


def _speed_mps(given: Fields, row: CatalogueRow) -> float | None:
    """Return the speed given, which is not above the row's own; None if none is."""
    if "speed" not in given:
        return None
    _check_moves(given, "speed", row)
    speed_mps, most = given.number("speed", positive=True), row.motion.speed_mps
    if speed_mps > most:
        given.refuse("speed", f"is {speed_mps:g}, but {row.label} moves at {most:g} m/s at most")
    return speed_mps


def _planner(given: Fields, row: CatalogueRow) -> str:
    """Return the planner given, empty if none is."""
    if "planner" not in given:
        return ""
    _check_moves(given, "planner", row)
    planner = given.text("planner")
    reason = why_no_planner(planner)
    if reason:
        given.refuse("planner", f"is {planner!r}, which {reason}")
    return planner


def _track(given: Fields, files: _TrackFiles, artefact_id: int | None, name: str) -> Track | None:
    if "track" not in given:
        return None
    value = given.raw("track")
    keys = [text for text in (str(artefact_id or ""), name) if text]
    make: Callable[[], Track]
    if isinstance(value, str):
        make = partial(files.track, value, tuple(keys))
    else:
        make = partial(Track, *_inline_poses(given, value))
    try:
        return make()
    except ScenarioError as cause:
        given.refuse("track", f"cannot be used: {cause}")


def _inline_poses(
    given: Fields, value: object
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Return the times (N,) [ns] and the poses (N, 4) of a track that is given in place."""
    if not isinstance(value, list):
        given.refuse("track", f"is {value!r}, but a file or a list of [t, x, y, z, yaw] is needed")
    times_ns, poses = [], []
    for k, entry in enumerate(value):
        if not isinstance(entry, list) or len(entry) != 5:
            given.refuse(
                f"track[{k}]", f"is {entry!r}, but five numbers t, x, y, z, yaw are needed"
            )
        times_ns.append(_ns(given, f"track[{k}], time,", entry[0]))
        poses.append(given.vector(f"track[{k}]", entry[1:], "x, y, z, yaw"))
    return np.array(times_ns, np.int64), np.array(poses, np.float64).reshape(-1, 4)
