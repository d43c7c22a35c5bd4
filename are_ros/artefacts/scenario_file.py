"""Scenarios as YAML, each with its long tracks in a CSV file beside it; see docs/scenarios.md."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import yaml

from are_ros.artefacts._fields import Fields
from are_ros.artefacts._scenario_entry import KEYS, TrackFiles, read_artefact
from are_ros.artefacts._seconds import seconds_text
from are_ros.artefacts.artefact import Origin
from are_ros.artefacts.catalogue import Catalogue
from are_ros.artefacts.population_events import Cause
from are_ros.artefacts.scenario import Scenario, ScriptedArtefact, Track
from are_ros.artefacts.track_file import lines_in, write_tracks
from are_ros.errors import CatalogueError, ScenarioError
from are_ros.wording import counted, listed, why_refused
from are_ros.yaml_text import read_yaml

_EXACT_DIGITS: Final = 15
"""A decimal of so many digits is the shortest text of the float that YAML makes of it."""
_LINE: Final = 100


def read_scenario(path: Path, catalogue: Catalogue) -> Scenario:
    """Read a scenario, whose artefacts are of a catalogue.

    ScenarioError, one sentence that names file, artefact (index and name), field and reason, for
    whatever is wrong.
    """
    content = read_yaml(path, f"the scenario {path}", ScenarioError)
    with _as_scenario_errors():
        document = Fields(str(path), content, ("scenario", "artefacts"))
        head = document.section("scenario", ("name", "random", "track_lines"))
        entries = document.raw("artefacts")
        if not isinstance(entries, list):
            document.refuse("artefacts", "must be a list of artefacts; it may be empty")
        files = TrackFiles(path.parent)
        artefacts = [
            read_artefact(Fields(_place(path, index, entry), entry, KEYS), catalogue, files)
            for index, entry in enumerate(entries)
        ]
        name = head.text("name") if "name" in head else ""
        random = head.flag("random", default=True)
        if "track_lines" in head:
            _check_lines(head, files)
    try:
        return Scenario(tuple(artefacts), random, name)
    except ScenarioError as cause:
        raise ScenarioError(f"{path}: {cause}") from cause


def scenario_files(path: Path) -> tuple[Path, Path]:
    """Return the files that a scenario is written into: its own, and that of its long tracks."""
    return path, path.with_name(f"{path.stem}.tracks.csv")


def write_scenario(scenario: Scenario, path: Path) -> list[Path]:
    """Write a scenario, and its long tracks beside it as NAME.tracks.csv; return the files.

    What is read again is what was written, to the nanosecond and to the last bit. ScenarioError
    if the files cannot be written.
    """
    _, sidecar = scenario_files(path)
    artefacts = scenario.artefacts
    tracks = {_key(one): one.track for one in artefacts if one.track and _is_beside(one)}
    head: dict[str, Any] = {"name": scenario.name} if scenario.name else {}
    head["random"] = scenario.random
    if tracks:
        write_tracks(sidecar, tracks)
        head["track_lines"] = lines_in(sidecar)
    content = {"scenario": head, "artefacts": [_entry(one, sidecar.name) for one in artefacts]}
    text = yaml.safe_dump(
        content, sort_keys=False, allow_unicode=True, width=_LINE, default_flow_style=None
    )
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as cause:
        raise ScenarioError(f"{path} cannot be written ({why_refused(cause)})") from cause
    return [path, sidecar] if tracks else [path]


def _check_lines(head: Fields, files: TrackFiles) -> None:
    """Refuse tracks of which something is missing, or that are not those of the scenario."""
    wanted, found = head.raw("track_lines"), files.lines()
    if wanted != found:
        names = listed([str(path) for path in files.paths()]) or "no file of tracks"
        head.refuse(
            "track_lines",
            f"is {wanted!r}, but {names} has {counted(found, 'whole line')}: "
            "it is cut off, or of another run (who changed it by hand leaves the field out)",
        )


@contextmanager
def _as_scenario_errors() -> Iterator[None]:
    """Let what fields and catalogue refuse be the scenario's fault."""
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
    """Say whether a track goes into the file beside: a single pose, or one without id, does not."""
    track = artefact.track
    return bool(track and (len(track) > 1 or track.doings) and _key(artefact))


def _key(artefact: ScriptedArtefact) -> str:
    return artefact.name if artefact.artefact_id is None else str(artefact.artefact_id)


def _entry(artefact: ScriptedArtefact, sidecar: str) -> dict[str, Any]:
    """Return one artefact as YAML has it, without what is so anyway."""
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
    if artefact.blocked:
        return given | {"blocked": artefact.blocked}
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
