"""Reading a catalogue of artefacts from YAML; each error names file, row, field and reason."""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from are_ros.agents.behaviours.registry import BEHAVIOURS, why_not
from are_ros.agents.body import PLANNERS
from are_ros.agents.local_planner.user_planners import why_not as why_no_planner
from are_ros.errors import CatalogueError
from are_ros.population.catalogue import (
    TOLD,
    Catalogue,
    CatalogueRow,
    MeshFile,
    MotionLimits,
    RewardWeights,
)
from are_ros.population.meshes.geometry import BoxGeometry, file_geometry, shape_geometry
from are_ros.population.meshes.shapes import Shape
from are_ros.yaml_text import Fields, read_yaml

SHIPPED_CATALOGUE: Final = Path(__file__).parent / "catalogue.yaml"

_LARGEST_M = 100.0
_LARGEST_WEIGHT = 1000.0
"""The sums of larger ones over a life would come near the value of what cannot be reached."""
_HEXADECIMAL = frozenset("0123456789abcdefABCDEF")
_METRES: Mapping[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
_AXES = ("x", "y", "z", "-x", "-y", "-z")
_CLASS_KEYS = (
    "shape",
    "colour",
    "forever",
    "motion",
    "behaviours",
    "planners",
    "rewards",
    "slip",
    "features",
)
_ROW_KEYS = ("label", "class", "size_m", "mesh", *_CLASS_KEYS)
_MERGED = ("motion", "rewards", "features")
_SHAPES = tuple(shape.value for shape in Shape)
_GLB_AXES = ("y", "z")
"""Up and forward in a GLB file, by the glTF 2.0 specification (3.4)."""


def read_catalogue(path: Path = SHIPPED_CATALOGUE) -> Catalogue:
    """Read the catalogue at `path`; the format is described in docs/catalogue.md.

    Raises CatalogueError, which names file, row, field and reason. User-defined meshes are read,
    too, for their boxes; built-in shapes are not computed.
    """
    content = read_yaml(path, f"the catalogue {path}", CatalogueError)
    document = Fields(str(path), content, ("classes", "rows"), CatalogueError)
    names = document.raw("classes")
    if not isinstance(names, dict) or not names:
        document.refuse("classes", "must map the name of each class to its defaults")
    classes = {str(name): _class_defaults(path, str(name), names[name]) for name in names}
    entries = document.raw("rows")
    if not isinstance(entries, list) or not entries:
        document.refuse("rows", "must be a list with at least one row")
    rows = [_row(path, index, entry, classes) for index, entry in enumerate(entries)]
    _check_labels(path, rows)
    _check_blocks(path, rows, list(classes))
    return Catalogue(tuple(rows))


def _class_defaults(path: Path, name: str, values: object) -> dict[str, Any]:
    """Check the defaults of a class on their own, so that an error names the class."""
    place = f"{path}: class {name!r}"
    given = Fields(place, values, _CLASS_KEYS, CatalogueError)
    if "shape" in given:
        given.choice("shape", _SHAPES)
    _shared_fields(given)
    return {key: given.raw(key) for key in given}


def _row(
    path: Path, index: int, entry: object, classes: Mapping[str, Mapping[str, Any]]
) -> CatalogueRow:
    """Read one row, with the defaults of its class."""
    label = entry.get("label") if isinstance(entry, dict) else None
    place = f"{path}: row {index}" + (f" ({label})" if isinstance(label, str) else "")
    own = Fields(place, entry, _ROW_KEYS, CatalogueError)
    own.text("label")
    class_name = own.choice("class", tuple(classes))
    _shared_fields(own)
    given = Fields(place, _merged(classes[class_name], own), _ROW_KEYS, CatalogueError)
    surface, geometry = _geometry(path, place, own, given)
    shared = _shared_fields(given)
    _check_moves(given, shared)
    return CatalogueRow(
        index=index,
        label=own.text("label"),
        class_name=class_name,
        size_m=geometry.size_m,
        box_centre_in_artefact_m=geometry.box_centre_in_artefact_m,
        surface=surface,
        **shared,
    )


def _check_moves(given: Fields, shared: Mapping[str, Any]) -> None:
    """Raise CatalogueError for a behaviour that moves if the speed is 0."""
    for name, share in shared.get("behaviours", {}).items():
        reason = why_not(name, shared["motion"].speed_mps)
        if share > 0.0 and reason is not None:
            given.refuse(f"behaviours.{name}", reason)


def _merged(defaults: Mapping[str, Any], own: Fields) -> dict[str, Any]:
    """Return the values of a row over its class's; motion, rewards, features merge by key."""
    values = {**defaults, **{key: own.raw(key) for key in own}}
    for key in _MERGED:
        if key in defaults or key in own:
            values[key] = {**(defaults.get(key) or {}), **(own.raw(key) or {})}  # type: ignore[dict-item]
    return values


def _geometry(
    path: Path, place: str, own: Fields, given: Fields
) -> tuple[Shape | MeshFile, BoxGeometry]:
    """Return the row's surface and its box in F_A."""
    if "mesh" not in own:
        shape = Shape(given.choice("shape", _SHAPES))
        x, y, z = _size(given)
        return shape, shape_geometry(shape, (x, y, z))
    for key in ("shape", "size_m"):
        if key in own:
            own.refuse(key, "is given beside mesh, whose file decides it")
    source = _mesh_file(path, own.section("mesh", ("file", "unit", "scale", "up", "forward")))
    try:
        geometry = file_geometry(source)
    except CatalogueError as cause:
        raise CatalogueError(f"{place}: mesh.file: {cause}") from cause
    if max(geometry.size_m) > _LARGEST_M:
        size = " x ".join(f"{length:g}" for length in geometry.size_m)
        own.refuse("mesh.unit", f"makes the artefact {size} m large; is the unit right?")
    return source, geometry


def _size(given: Fields) -> list[float]:
    """Return the three lengths of the box."""
    size_m = given.numbers("size_m", (3,), positive=True)
    for number, length in enumerate(size_m):
        if length > _LARGEST_M:
            given.refuse(
                f"size_m[{number}]", f"is {length:g}, but at most {_LARGEST_M:g} m are taken"
            )
    return size_m


def _mesh_file(path: Path, mesh: Fields) -> MeshFile:
    """Read the path of a user-defined mesh, its unit and its axes."""
    file = path.parent / mesh.text("file")
    up, forward = _GLB_AXES if file.suffix.lower() == ".glb" else ("z", "x")
    up, forward = mesh.choice("up", _AXES, up), mesh.choice("forward", _AXES, forward)
    if up[-1] == forward[-1]:
        mesh.refuse("forward", f"is {forward!r}, along the axis that is up")
    unit = _METRES[mesh.choice("unit", tuple(_METRES), "m")]
    return MeshFile(file, unit * mesh.number("scale", 1.0, positive=True), up, forward)


def _shared_fields(given: Fields) -> dict[str, Any]:
    """Read the fields that classes and rows have in common, with their defaults."""
    shared: dict[str, Any] = {"forever": given.flag("forever", default=False)}
    if "colour" in given:
        shared["colour"] = _colour(given)
    for key, kind in (("motion", MotionLimits), ("rewards", RewardWeights)):
        known = asdict(kind())
        section = given.section(key, tuple(known))
        shared[key] = kind(**{name: section.number(name, value) for name, value in known.items()})
    _check_numbers(given, shared["motion"], shared["rewards"])
    if "slip" in given:
        shared["slip"] = given.number("slip")
        if shared["slip"] > 1.0:
            given.refuse("slip", f"is {shared['slip']:g}, but must be at most 1")
    if "behaviours" in given:
        shared["behaviours"] = _shares(given, "behaviours", BEHAVIOURS, why_not)
    if "planners" in given:
        shared["planners"] = _shares(given, "planners", PLANNERS, why_no_planner)
    shared["features"] = _features(given)
    return shared


_SLOWEST_START_S: Final = 60.0
_WIDEST_TURN_M: Final = 100.0
_MOST_RUNNING: Final = 10.0


def _check_what_moves(given: Fields, motion: MotionLimits) -> None:
    """Raise CatalogueError for limits with which an artefact would stand, without a word."""
    acceleration = motion.acceleration_mps2
    if acceleration == 0.0:
        given.refuse("motion.acceleration_mps2", "is 0, but what has a speed must reach it")
    starts_s = motion.speed_mps / acceleration
    if starts_s > _SLOWEST_START_S:
        reason = f"is {acceleration:g}: it reaches its speed after {starts_s:.3g} s"
        given.refuse("motion.acceleration_mps2", f"{reason}, but at most {_SLOWEST_START_S:g} s do")
    if motion.turn_rate_radps == 0.0:
        given.refuse("motion.turn_rate_radps", "is 0, but what has a speed must turn")
    if motion.turn_radius_m > _WIDEST_TURN_M:
        reason = f"is {motion.turn_radius_m:g}, but must be <= {_WIDEST_TURN_M:g}"
        given.refuse("motion.turn_radius_m", reason)


def _check_numbers(given: Fields, motion: MotionLimits, rewards: RewardWeights) -> None:
    """Raise CatalogueError for limits that contradict each other, and weights that overflow."""
    factor = motion.running_factor
    if motion.speed_mps > 0.0:
        _check_what_moves(given, motion)
    if factor < 1.0:
        given.refuse("motion.running_factor", f"is {factor:g}, but must be >= 1")
    if factor > _MOST_RUNNING:
        given.refuse("motion.running_factor", f"is {factor:g}, but must be <= {_MOST_RUNNING:g}")
    for name, weight in asdict(rewards).items():
        if weight > _LARGEST_WEIGHT:
            most = f"{_LARGEST_WEIGHT:g}"
            given.refuse(f"rewards.{name}", f"is {weight:g}, but must be at most {most}")


def _shares(
    given: Fields, key: str, known: Collection[str], why_not: Callable[[str], str | None]
) -> dict[str, float]:
    """Return the probability of each behaviour or planner; user-defined ones are imported."""
    raw = given.raw(key)
    names = [name for name in raw if isinstance(name, str)] if isinstance(raw, dict) else []
    own = [name for name in names if ":" in name]
    weights = given.section(key, (*known, "module:Class", *own))
    for name in weights:
        if (reason := why_not(name)) is not None:
            weights.refuse(name, reason)
    numbers = {name: weights.number(name) for name in weights}
    total = sum(numbers.values())
    if not total > 0.0:
        given.refuse(key, "has no positive weight")
    if not math.isfinite(total):
        given.refuse(key, "has weights whose sum is not finite; give smaller ones")
    return {name: number / total for name, number in numbers.items()}


def _features(given: Fields) -> dict[str, str]:
    """Return free features as text: words, numbers, true and false."""
    raw = given.raw("features")
    section = given.section("features", tuple(raw) if isinstance(raw, dict) else ())
    features = {}
    for key in section:
        value = section.raw(key)
        if key in TOLD:
            section.refuse(str(key), "is published as what the artefact does; give another name")
        if not isinstance(value, str | int | float | bool):
            section.refuse(str(key), f"is {value!r}, but text, a number, true or false is needed")
        features[str(key)] = str(value).lower() if isinstance(value, bool) else str(value)
    return features


def _colour(given: Fields) -> tuple[float, float, float, float]:
    """Return a colour given as '#rrggbb', '#rrggbbaa', or three or four numbers in [0, 1]."""
    raw = given.raw("colour")
    if raw is None:
        given.refuse("colour", "is empty; '#rrggbb' needs its quotes, as # begins a comment")
    if isinstance(raw, str):
        digits = raw.removeprefix("#")
        if not raw.startswith("#") or len(digits) not in {6, 8} or not set(digits) <= _HEXADECIMAL:
            given.refuse("colour", f"is {raw!r}, but '#rrggbb' or '#rrggbbaa' is needed")
        values = [byte / 255.0 for byte in bytes.fromhex(digits)]
    else:
        values = given.numbers("colour", (3, 4))
        if max(values) > 1.0:
            given.refuse("colour", f"is {raw!r}, but each number must be in [0, 1]")
    red, green, blue, alpha = [*values, 1.0][:4]
    return (red, green, blue, alpha)


def _check_labels(path: Path, rows: Sequence[CatalogueRow]) -> None:
    """Raise CatalogueError if two rows have one label."""
    first: dict[str, int] = {}
    for row in rows:
        if row.label in first:
            msg = f"{path}: row {row.index} ({row.label}): label is that of row {first[row.label]}"
            raise CatalogueError(f"{msg} already")
        first[row.label] = row.index


def _check_blocks(path: Path, rows: Sequence[CatalogueRow], classes: Sequence[str]) -> None:
    """Raise CatalogueError for a class without rows, or with rows that are not contiguous."""
    seen: list[str] = []
    for row in rows:
        if row.class_name in seen and seen[-1] != row.class_name:
            msg = (
                f"{path}: row {row.index} ({row.label}): class is {row.class_name!r}, whose block "
                f"was ended by a row of {seen[-1]!r}; the rows of a class stand together"
            )
            raise CatalogueError(msg)
        if row.class_name not in seen:
            seen.append(row.class_name)
    for name in classes:
        if name not in seen:
            raise CatalogueError(f"{path}: class {name!r} has no row")
