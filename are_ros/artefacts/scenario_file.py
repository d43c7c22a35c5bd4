"""Scenarios as YAML, each with its long tracks in a CSV file beside it; see docs/scenarios.md."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from are_ros.artefacts.artefact import GroundPose, Origin
from are_ros.artefacts.behaviours.along_way import AlongWay
from are_ros.artefacts.behaviours.following import Following
from are_ros.artefacts.behaviours.registry import why_not
from are_ros.artefacts.behaviours.standing import Standing
from are_ros.artefacts.catalogue import Catalogue, CatalogueRow
from are_ros.artefacts.catalogue_file import Fields
from are_ros.artefacts.departures import Cause
from are_ros.artefacts.scenario import Scenario, ScriptedArtefact, Track
from are_ros.artefacts.track_file import ns_of_seconds, read_tracks, seconds_text, write_tracks
from are_ros.errors import CatalogueError, ScenarioError
from are_ros.wording import why_refused
from are_ros.yaml_text import read_yaml

_EXACT_DIGITS: Final = 15
"""A decimal of so many digits is the shortest text of the float that YAML makes of it."""
_LINE: Final = 100

_MOVEMENTS: Final = ("way", "follows", "track")
_NOT_BESIDE_TRACK: Final = ("at", "speed")
_KEYS: Final = (
    *("label", "row", "id", "name", "at", "arrives", "stays", "behaviour", "way", "loop"),
    *("speed", "follows", "track", "origin", "left_by"),
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
    with _as_scenario_errors():
        document = Fields(str(path), content, ("scenario", "artefacts"))
        head = document.section("scenario", ("name", "random"))
        entries = document.raw("artefacts")
        if not isinstance(entries, list):
            document.refuse("artefacts", "must be a list of artefacts; it may be empty")
        files = _TrackFiles(path.parent)
        artefacts = [
            _artefact(Fields(_place(path, index, entry), entry, _KEYS), catalogue, files)
            for index, entry in enumerate(entries)
        ]
        name = head.text("name") if "name" in head else ""
        random = head.flag("random", default=True)
    try:
        return Scenario(tuple(artefacts), random, name)
    except ScenarioError as cause:
        raise ScenarioError(f"{path}: {cause}") from cause


def scenario_files(path: Path) -> tuple[Path, Path]:
    """Return the files that a scenario is written into: its own, and that of its long tracks."""
    return path, path.with_name(f"{path.stem}.tracks.csv")


def write_scenario(scenario: Scenario, path: Path) -> list[Path]:
    """Write a scenario, and its long tracks beside it as NAME.tracks.csv; return the files.

    Times are exact to the nanosecond; poses of long tracks are rounded to a micrometre.
    ScenarioError if the files cannot be written.
    """
    _, sidecar = scenario_files(path)
    artefacts = scenario.artefacts
    tracks = {_key(one): one.track for one in artefacts if one.track and _is_beside(one)}
    head: dict[str, Any] = {"name": scenario.name} if scenario.name else {}
    head["random"] = scenario.random
    if tracks:
        write_tracks(sidecar, tracks)
    content = {"scenario": head, "artefacts": [_entry(one, sidecar.name) for one in artefacts]}
    text = yaml.safe_dump(
        content, sort_keys=False, allow_unicode=True, width=_LINE, default_flow_style=None
    )
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as cause:
        raise ScenarioError(f"{path} cannot be written ({why_refused(cause)})") from cause
    return [path, sidecar] if tracks else [path]


@contextmanager
def _as_scenario_errors() -> Iterator[None]:
    """Raise errors of fields and of the catalogue as errors of the scenario."""
    try:
        yield
    except CatalogueError as cause:
        raise ScenarioError(str(cause)) from cause


def _place(path: Path, index: int, entry: object) -> str:
    """Return how sentences name an artefact, before anything of it is checked."""
    name = None
    if isinstance(entry, dict):
        name = next((entry[key] for key in ("name", "label", "row") if key in entry), None)
    return f"{path}: artefact {index}" + ("" if name is None else f" ({name})")


def _is_beside(artefact: ScriptedArtefact) -> bool:
    """Tell whether a track goes into the CSV: it has several poses, and a key to find it by."""
    track = artefact.track
    return bool(track and len(track) > 1 and _key(artefact))


def _key(artefact: ScriptedArtefact) -> str:
    return artefact.name if artefact.artefact_id is None else str(artefact.artefact_id)


def _entry(artefact: ScriptedArtefact, sidecar: str) -> dict[str, Any]:
    """Return one artefact as YAML has it, without the fields that have their defaults."""
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
    return given | _movement(artefact, sidecar)


def _movement(artefact: ScriptedArtefact, sidecar: str) -> dict[str, Any]:
    given: dict[str, Any] = {}
    if artefact.follows:
        given["follows"] = artefact.follows
    elif not artefact.way_m and artefact.behaviour != "standing":
        given["behaviour"] = artefact.behaviour
    if artefact.track is not None:
        return given | {"track": sidecar if _is_beside(artefact) else _inline(artefact.track)}
    pose = artefact.pose
    given["at"] = [pose.x_m, pose.y_m, pose.yaw_rad]
    if artefact.way_m:
        given |= {"way": [list(point) for point in artefact.way_m], "loop": artefact.loop}
    if artefact.speed_mps is not None:
        given["speed"] = artefact.speed_mps
    return given


def _inline(track: Track) -> list[list[Any]]:
    times_ns, poses = track.times_ns.tolist(), track.poses.tolist()
    return [[_seconds(t_ns), *pose] for t_ns, pose in zip(times_ns, poses, strict=True)]


def _seconds(t_ns: int) -> int | float | str:
    """Return seconds as YAML keeps them: a number where that loses nothing, else its text."""
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
        known = " or ".join(map(repr, keys)) or "of nobody in particular (no id, no name is given)"
        raise ScenarioError(f"{self._folder / file} has no track {known}")


def _artefact(given: Fields, catalogue: Catalogue, files: _TrackFiles) -> ScriptedArtefact:
    """Read one artefact; CatalogueError, with its place and field, for whatever is wrong."""
    _check_movements(given)
    row = _row(given, catalogue)
    name = given.text("name") if "name" in given else ""
    artefact_id = _id(given)
    track = _track(given, files, artefact_id, name)
    arrives_ns = _arrival_ns(given, track)
    return ScriptedArtefact(
        row=row,
        pose=_pose(given) if track is None else track.pose_at(arrives_ns),
        arrives_ns=arrives_ns,
        stays_ns=_stay_ns(given),
        behaviour=_behaviour(given, row),
        way_m=_way(given),
        loop=given.flag("loop", default=False),
        follows=given.text("follows") if "follows" in given else "",
        track=track,
        speed_mps=_speed_mps(given, row),
        artefact_id=artefact_id,
        name=name,
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
            given.refuse(key, "is given beside track, which tells where the artefact is when")
    if "loop" in given and "way" not in given:
        given.refuse("loop", "is given, but there is no way to go again and again")


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
        given.refuse("label", f"is not to be had: {cause}")
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


def _arrival_ns(given: Fields, track: Track | None) -> int:
    if "arrives" not in given and track is not None:
        return int(track.times_ns[0])
    return _ns(given, "arrives", given.raw("arrives")) if "arrives" in given else 0


def _stay_ns(given: Fields) -> int | None:
    stays = given.raw("stays")
    return None if stays is None or stays == "forever" else _ns(given, "stays", stays)


def _ns(given: Fields, key: str, value: object) -> int:
    try:
        return ns_of_seconds(value)
    except ValueError as cause:
        given.refuse(key, str(cause))


def _pose(given: Fields) -> GroundPose:
    if "at" not in given:
        given.refuse("at", "is missing: [x, y, yaw] in the map's frame, or a track")
    x_m, y_m, yaw_rad = _numbers(given, "at", given.raw("at"), "x, y, yaw")
    return GroundPose(x_m, y_m, 0.0, yaw_rad)


def _behaviour(given: Fields, row: CatalogueRow) -> str:
    """Return the behaviour; on a track it is only a word for what the artefact is seen to do."""
    if "track" in given:
        return given.text("behaviour") if "behaviour" in given else Standing.name
    for key, name in (("way", AlongWay.name), ("follows", Following.name)):
        if key in given:
            _check_moves(given, key, row)
            if "behaviour" in given and given.text("behaviour") != name:
                given.refuse("behaviour", f"is given beside {key}, which makes it {name}")
            return name
    behaviour = given.text("behaviour") if "behaviour" in given else Standing.name
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
    way = [_numbers(given, f"way[{k}]", point, "x, y") for k, point in enumerate(points)]
    return tuple((x_m, y_m) for x_m, y_m in way)


def _speed_mps(given: Fields, row: CatalogueRow) -> float | None:
    if "speed" not in given:
        return None
    _check_moves(given, "speed", row)
    speed_mps, most = given.number("speed", positive=True), row.motion.speed_mps
    if speed_mps > most:
        given.refuse("speed", f"is {speed_mps:g}, but {row.label} moves at {most:g} m/s at most")
    return speed_mps


def _track(given: Fields, files: _TrackFiles, artefact_id: int | None, name: str) -> Track | None:
    if "track" not in given:
        return None
    value = given.raw("track")
    keys = [text for text in (str(artefact_id or ""), name) if text]
    try:
        if isinstance(value, str):
            return files.track(value, tuple(keys))
        return _inline_track(given, value)
    except ScenarioError as cause:
        given.refuse("track", f"cannot be used: {cause}")


def _inline_track(given: Fields, value: Any) -> Track:
    if not isinstance(value, list):
        given.refuse("track", f"is {value!r}, but a file or a list of [t, x, y, z, yaw] is needed")
    times_ns, poses = [], []
    for k, entry in enumerate(value):
        if not isinstance(entry, list) or len(entry) != 5:
            given.refuse(
                f"track[{k}]", f"is {entry!r}, but five numbers t, x, y, z, yaw are needed"
            )
        times_ns.append(_ns(given, f"track[{k}], time,", entry[0]))
        poses.append(_numbers(given, f"track[{k}]", entry[1:], "x, y, z, yaw"))
    return Track(np.array(times_ns, np.int64), np.array(poses, np.float64).reshape(-1, 4))


def _numbers(given: Fields, key: str, values: Any, names: str) -> list[float]:
    """Return as many finite numbers as there are names."""
    count = names.count(",") + 1
    if not isinstance(values, list) or len(values) != count:
        given.refuse(key, f"is {values!r}, but {count} numbers are needed: {names}")
    for value in values:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value):
            given.refuse(key, f"is {values!r}, but {value!r} in it is no finite number")
    return [float(value) for value in values]
