"""YAML text as values, and the fields of its mappings; errors are one sentence of the family."""

import math
import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NoReturn

import yaml

from are_ros.errors import AreError

_DEEPEST = 100
_LARGEST = 10**300


class _Loader(yaml.SafeLoader):
    """YAML 1.1 as ROS reads it: 1e-3 is a number, too. No value holds itself.

    The loader in Python is used on purpose: that in C ends the process where the nesting is deep.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        # Whole values at once: one that holds itself is then refused, not built.
        self.deep_construct = True
        self._depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Refuse deep nesting."""
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ValueError(f"it is nested deeper than {_DEEPEST} levels")
        node: yaml.Node | None = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """Refuse a repeated key: the last one would win without a warning."""
        mapping: yaml.MappingNode = super().compose_mapping_node(anchor)
        keys: set[str] = set()
        for key, _ in mapping.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            if key.value in keys:
                problem = f"the key '{key.value}' comes twice in one mapping"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            keys.add(key.value)
        return mapping


class Dumper(yaml.SafeDumper):
    """Writes what `parse_yaml` reads as it was: a text that looks like 1e5 gets quotes."""


for _kind in (_Loader, Dumper):
    _kind.add_implicit_resolver(
        "tag:yaml.org,2002:float",
        re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
        list("-+.0123456789"),
    )


def _whole_number(loader: _Loader, node: yaml.ScalarNode) -> int:
    """Refuse what no float can be, and 010: 8 by YAML 1.1, 10 by YAML 1.2 and for most writers."""
    number = loader.construct_yaml_int(node)
    if abs(number) > _LARGEST:
        raise yaml.MarkedYAMLError(
            problem=f"{node.value[:12]}... is too large a number", problem_mark=node.start_mark
        )
    digits = node.value.replace("_", "").lstrip("+-")
    if digits.isdecimal() and int(digits) != abs(number):
        problem = f"{node.value} may mean {abs(number)} or {int(digits)}: write the one that is"
        problem += " meant, or quotes around a text"
        raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
    return number


_Loader.add_constructor("tag:yaml.org,2002:int", _whole_number)

# Beside YAMLError, errors that PyYAML's constructors raise, as for `2001-99-99` or `!!bool x`.
_FAULTS = (
    yaml.YAMLError,
    ValueError,
    ArithmeticError,
    AttributeError,
    LookupError,
    TypeError,
    RecursionError,
)


def parse_yaml(text: str, subject: str, error: type[AreError]) -> Any:
    """Return the value of a YAML text, made of plain Python values only.

    Raises `error`, whose sentence begins with `subject`, for whatever is no YAML, a scalar that
    its type does not allow, a value that holds itself, a key that comes twice in one mapping, and
    more than 100 levels of nesting.
    """
    try:
        return yaml.load(text, _Loader)  # noqa: S506 - derived from the safe loader
    except _FAULTS as cause:
        mark = getattr(cause, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark and "\n" in text else ""
        raise error(f"{subject} is no valid YAML{where}: {_reason(cause)}") from cause


def read_yaml(path: Path, subject: str, error: type[AreError]) -> Any:
    """Return the value of a YAML file; as `parse_yaml`, and `error` where it cannot be read."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as cause:
        reason = getattr(cause, "strerror", None) or "not UTF-8 text"
        if isinstance(cause, FileNotFoundError) and not path.is_absolute():
            with suppress(OSError):  # the present folder may be gone
                reason += f" in {Path.cwd()}"
        raise error(f"{subject} cannot be read ({reason})") from cause
    return parse_yaml(text, subject, error)


def _reason(cause: Exception) -> str:
    """Return the reason in one line; PyYAML's errors have it in parts."""
    if isinstance(cause, yaml.MarkedYAMLError):
        text = ", ".join(part for part in (cause.context, cause.problem) if part)
    elif isinstance(cause, yaml.YAMLError | ValueError):
        text = str(cause)
    else:
        text = "a value is not of the type that its tag or form says"
    return " ".join(text.split())


_KINDS: Mapping[type, str] = {
    bool: "true or false",
    int: "a number",
    float: "a number",
    str: "text",
    list: "a list",
    dict: "a mapping",
    type(None): "nothing",
}


class Fields:
    """The values of one YAML mapping, with typed access; errors name its place in the file."""

    def __init__(
        self,
        place: str,
        values: object,
        known: Collection[str],
        error: type[AreError],
        path: str = "",
    ) -> None:
        """Take a mapping as YAML gives it (None counts as an empty one).

        Raises `error` if it is no mapping, or has an unknown key; so do all methods.
        """
        self._place, self._path, self._error = place, path, error
        if not isinstance(values, dict | None):
            subject = f" {path.rstrip('.')}" if path else ""
            found = _KINDS.get(type(values), type(values).__name__)
            raise error(f"{place}:{subject} is {found}, but a mapping is needed")
        self._values: dict[Any, Any] = values or {}
        for key in self._values:
            if key not in known:
                self.refuse(str(key), f"is not known{_nearest(str(key), known)}")

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def refuse(self, key: str, reason: str) -> NoReturn:
        """Raise the error about a field."""
        raise self._error(f"{self._place}: {self._path}{key} {reason}")

    def text(self, key: str, default: str | None = None) -> str:
        """Return a text, which must not be empty."""
        if default is not None and key not in self._values:
            return default
        value = self._get(key, str)
        if not value.strip():
            self.refuse(key, "is empty")
        return str(value)

    def choice(self, key: str, known: Collection[str], default: str | None = None) -> str:
        """Return a text, which must be one of the known ones."""
        if default is not None and key not in self._values:
            return default
        value = self.text(key)
        if value not in known:
            self.refuse(key, f"is {value!r}, which is not known{_nearest(value, known)}")
        return value

    def flag(self, key: str, *, default: bool) -> bool:
        """Return true or false."""
        return bool(self._get(key, bool)) if key in self._values else default

    def number(self, key: str, default: float | None = None, *, positive: bool = False) -> float:
        """Return a finite number >= 0; with `positive`, > 0."""
        if default is not None and key not in self._values:
            return default
        return self._checked(key, self._get(key, float), positive=positive)

    def numbers(self, key: str, counts: Collection[int], *, positive: bool = False) -> list[float]:
        """Return a list of finite numbers >= 0, whose length is one of `counts`."""
        values = self._get(key, list)
        if len(values) not in counts:
            wanted = " or ".join(str(count) for count in counts)
            self.refuse(key, f"has {len(values)} numbers, but {wanted} are needed")
        return [
            self._checked(f"{key}[{i}]", value, positive=positive) for i, value in enumerate(values)
        ]

    def raw(self, key: str) -> object:
        """Return a value unchecked, None if it is not given."""
        return self._values.get(key)

    def section(self, key: str, known: Collection[str]) -> "Fields":
        """Return a mapping inside this one; empty if it is not given."""
        return self.inner(key, self._values.get(key), known)

    def inner(self, key: str, values: object, known: Collection[str]) -> "Fields":
        """Return a mapping that errors name as `key` inside this one."""
        return Fields(self._place, values, known, self._error, f"{self._path}{key}.")

    def vector(self, key: str, values: object, names: str) -> list[float]:
        """Return `values` as finite numbers, as many as there are names, as in "x, y, yaw"."""
        count = names.count(",") + 1
        if not isinstance(values, list) or len(values) != count:
            self.refuse(key, f"is {values!r}, but {count} numbers are needed: {names}")
        for value in values:
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if not is_number or not math.isfinite(value):
                self.refuse(key, f"is {values!r}, but {value!r} in it is no finite number")
        return [float(value) for value in values]

    def _get(self, key: str, kind: type) -> Any:
        if key not in self._values:
            self.refuse(key, "is missing")
        value = self._values[key]
        self._check_kind(key, value, kind)
        return value

    def _check_kind(self, key: str, value: object, kind: type) -> None:
        kinds = (int, float) if kind is float else (kind,)
        if not isinstance(value, kinds) or (isinstance(value, bool) and kind is not bool):
            self.refuse(key, f"is {value!r}, but {_KINDS[kind]} is needed")

    def _checked(self, key: str, value: object, *, positive: bool) -> float:
        self._check_kind(key, value, float)
        number = float(value)  # type: ignore[arg-type]  # just checked
        if not math.isfinite(number):
            self.refuse(key, f"is {number}, but a finite number is needed")
        if number < 0.0 or (positive and number == 0.0):
            self.refuse(key, f"is {number:g}, but must be {'positive' if positive else '>= 0'}")
        return number


def _nearest(word: str, known: Collection[str]) -> str:
    """Return a hint with the nearest known word, or with all of them if none is near."""
    near = get_close_matches(word, known, n=1)
    if near:
        return f"; did you mean {near[0]!r}?"
    return f"; known are {', '.join(known)}"
