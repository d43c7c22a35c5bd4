"""Declaration of parameters, their values by path, and checked changes.

A parameter is a field of a frozen dataclass, made by `parameter(...)`; sections are dataclasses in
dataclasses. The path of a field ("population.arrival_rate") is its YAML path and its ROS name.
"""

import dataclasses
import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, TypeVar

from are_ros.errors import ParameterError

Value = bool | int | float | str | tuple[str, ...] | tuple[float, ...]
_Section = TypeVar("_Section")


@dataclass(frozen=True)
class Description:
    """A parameter: for ROS descriptors, the YAML file and the table in the docs."""

    path: str
    default: Value
    unit: str
    low: float | None
    high: float | None
    choices: tuple[str, ...]
    live: bool
    text: str


def parameter(
    default: Any,
    text: str,
    *,
    unit: str = "",
    bounds: tuple[float | None, float | None] = (None, None),
    live: bool = False,
) -> Any:
    """Declare a field: its default, meaning, unit, closed bounds, and whether it may change live.

    The default's type is the parameter's: bool, int, float, str, an Enum of strings, or a tuple of
    strings or floats.
    """
    details = {"text": text, "unit": unit, "bounds": bounds, "live": live}
    return dataclasses.field(default=default, metadata=details)


def describe(section: Any, prefix: str = "") -> list[Description]:
    """Return the description of every parameter below a section, in the order of declaration."""
    found: list[Description] = []
    for field in dataclasses.fields(section):
        value = getattr(section, field.name)
        path = prefix + field.name
        if dataclasses.is_dataclass(value):
            found += describe(value, path + ".")
        else:
            found.append(_described(path, field))
    return found


def flatten(section: Any) -> dict[str, Value]:
    """Return every parameter's plain value by path; an Enum is given as its string."""
    return {item.path: plain(value_at(section, item.path)) for item in describe(section)}


def value_at(section: Any, path: str) -> Any:
    """Return the value at a path, which must exist."""
    for name in path.split("."):
        section = getattr(section, name)
    return section


def plain(value: Any) -> Value:
    """Return a value as ROS and YAML know it."""
    return value.value if isinstance(value, Enum) else value  # type: ignore[no-any-return]


def with_values(section: _Section, values: Mapping[str, Any]) -> _Section:
    """Return a section with some values replaced, all checked first.

    Raises ParameterError for an unknown path, a wrong type or a value out of range, naming it; the
    section given is never changed.
    """
    known = {item.path: item for item in describe(section)}
    for path, value in values.items():
        if path not in known:
            raise ParameterError(_unknown(path, known))
        section = _replaced(section, path.split("."), _checked(section, known[path], value))
    return section


def check_change(before: Any, after: Any) -> None:
    """Raise ParameterError, which names it, if a parameter differs that is not a live one."""
    for item in describe(before):
        if not item.live and value_at(after, item.path) != value_at(before, item.path):
            raise ParameterError(f"parameter '{item.path}': it cannot change during a run")


def _described(path: str, field: Any) -> Description:
    default, details = field.default, field.metadata
    choices = tuple(str(one.value) for one in type(default)) if isinstance(default, Enum) else ()
    low, high = details["bounds"]
    return Description(
        path,
        plain(default),
        details["unit"],
        low,
        high,
        choices,
        details["live"],
        details["text"],
    )


def _unknown(path: str, known: Mapping[str, Description]) -> str:
    if group := [name for name in known if name.startswith(f"{path}.")]:
        return f"parameter '{path}': it is a group of parameters, as {group[0]}, and has no value"
    if path.rsplit(".", maxsplit=1)[-1].isdigit():
        return f"parameter '{path}': there is no such parameter; a decimal comma has to be a point"
    near = difflib.get_close_matches(path, known, n=1)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    return f"parameter '{path}': there is no such parameter{hint}"


def _replaced(section: Any, names: list[str], value: Any) -> Any:
    if len(names) > 1:
        value = _replaced(getattr(section, names[0]), names[1:], value)
    return dataclasses.replace(section, **{names[0]: value})


def _checked(section: Any, item: Description, value: Any) -> Any:
    default = value_at(section, item.path)
    if isinstance(default, Enum):
        return _choice(item, type(default), value)
    if isinstance(default, tuple):
        return _elements(item, value)
    value = _typed(item, value, type(item.default))
    _check_bounds(item, value)
    return value


def _choice(item: Description, kind: type[Enum], value: Any) -> Enum:
    value = plain(value)
    if value not in item.choices:
        wanted = ", ".join(item.choices)
        raise ParameterError(f"parameter '{item.path}': {value!r} is none of {wanted}")
    return kind(value)


def _elements(item: Description, value: Any) -> tuple[Any, ...]:
    """Check a list; its elements have the type of the default's, strings where that is empty."""
    if isinstance(value, str) or not hasattr(value, "__iter__"):
        raise ParameterError(f"parameter '{item.path}': {value!r} is not a list")
    default = item.default
    numbers = isinstance(default, tuple) and bool(default) and isinstance(default[0], float)
    kind = float if numbers else str
    elements = tuple(_typed(item, one, kind) for one in value)
    for one in elements:
        _check_bounds(item, one)
    return elements


_TYPE_NAMES = {bool: "true or false", int: "a whole number", float: "a number", str: "a string"}


def _typed(item: Description, value: Any, kind: type) -> Any:
    whole_as_float = kind is float and isinstance(value, int) and not isinstance(value, bool)
    if whole_as_float:
        value = float(value)
    if not isinstance(value, kind) or (kind is not bool and isinstance(value, bool)):
        raise ParameterError(f"parameter '{item.path}': {value!r} is not {_TYPE_NAMES[kind]}")
    return value


def _check_bounds(item: Description, value: Any) -> None:
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return
    if not math.isfinite(value):
        raise ParameterError(f"parameter '{item.path}': {value} is not finite")
    if item.low is not None and value < item.low:
        raise ParameterError(f"parameter '{item.path}': {value} is below {item.low}{_unit(item)}")
    if item.high is not None and value > item.high:
        raise ParameterError(f"parameter '{item.path}': {value} is above {item.high}{_unit(item)}")


def _unit(item: Description) -> str:
    return f" {item.unit}" if item.unit else ""


# The parameters of the node alone, which a replay has no use for.


@dataclass(frozen=True)
class NodeParameters:
    """What the node reads once, when it starts; declared like all other parameters."""

    autostart: bool = parameter(
        True,
        "The node configures and activates itself; false: it waits for a lifecycle manager "
        "or for `ros2 lifecycle set`.",
    )
