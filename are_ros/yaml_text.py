"""YAML text as values; errors are one sentence of the family of errors."""

import re
from pathlib import Path
from typing import Any

import yaml

from are_ros.errors import AreError

_DEEPEST = 100


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


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)

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
