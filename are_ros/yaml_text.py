"""YAML text as values; whatever is wrong with it is one sentence of the family of errors."""

import re
from pathlib import Path
from typing import Any

import yaml

from are_ros.errors import AreError

_DEEPEST = 100
"""Levels of nesting: the parser in C would use up its stack before Python counts its own."""

# The loader in C is ten times as quick, and not everywhere.
_SafeLoader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_SafeLoader):  # type: ignore[misc]
    """YAML 1.1 as ROS reads it: 1e-3 is a number, too. No value holds itself."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        # Whole values at once: one that holds itself is then refused, not built.
        self.deep_construct = True


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)

# Beside YAMLError, what PyYAML's constructors let through, as for `2001-99-99` or `!!bool x`.
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
        _check_structure(text)
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
        raise error(f"{subject} cannot be read ({reason})") from cause
    return parse_yaml(text, subject, error)


class _OpenMapping:
    """The keys so far of a mapping whose end has not come."""

    def __init__(self) -> None:
        self._keys: set[str] = set()
        self._is_key_next = True

    def take(self, event: yaml.NodeEvent) -> None:
        """Take a key or a value, of which only the first event counts."""
        if self._is_key_next and isinstance(event, yaml.ScalarEvent):
            if event.value in self._keys:
                problem = f"the key '{event.value}' comes twice in one mapping"
                mark: Any = event.start_mark
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=mark)
            self._keys.add(event.value)
        self._is_key_next = not self._is_key_next


def _check_structure(text: str) -> None:
    """Refuse what the loader would die of, or take without a word: depth, a key given twice."""
    opened: list[_OpenMapping | None] = []
    for event in yaml.parse(text, _SafeLoader):
        if isinstance(event, yaml.CollectionEndEvent):
            opened.pop()
        elif isinstance(event, yaml.NodeEvent):
            if opened and (mapping := opened[-1]):
                mapping.take(event)
            if isinstance(event, yaml.CollectionStartEvent):
                is_mapping = isinstance(event, yaml.MappingStartEvent)
                opened.append(_OpenMapping() if is_mapping else None)
        if len(opened) > _DEEPEST:
            raise ValueError(f"it is nested deeper than {_DEEPEST} levels")


def _reason(cause: Exception) -> str:
    """Return the reason in one line; PyYAML's errors have it in parts, KeyError quotes a word."""
    if isinstance(cause, yaml.MarkedYAMLError):
        text = ", ".join(part for part in (cause.context, cause.problem) if part)
    elif isinstance(cause, yaml.YAMLError | ValueError):
        text = str(cause)
    else:
        text = "a value is not of the type that its tag or form says"
    return " ".join(text.split())
