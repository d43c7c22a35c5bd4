"""A line of the diagnostics."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum


class Level(IntEnum):
    """The levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class Status:
    """What is said about one part of the node: a sentence, and the figures behind it."""

    level: Level
    name: str
    message: str
    values: Mapping[str, str] = field(default_factory=dict)


def figure(value: float | None, unit: str = "", digits: int = 1) -> str:
    """Return a number with its unit, "-" where there is none."""
    if value is None:
        return "-"
    return f"{value:.{digits}f} {unit}".rstrip()
