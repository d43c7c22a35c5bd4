"""Text for people: counted nouns, lists, durations, and columns."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from are_ros.conventions import NS_PER_S

_UNITS: Final = (
    ("years", 31_557_600.0),
    ("days", 86_400.0),
    ("h", 3600.0),
    ("min", 60.0),
    ("s", 1.0),
)
_SHORT_S: Final = 20.0
_MOST_FILES: Final = 6


def counted(count: int, noun: str) -> str:
    """Return a number of things: "1 message", "2 messages", "3 boxes"."""
    return f"{count} {noun}" if count == 1 else f"{count} {several(noun)}"


def several(noun: str) -> str:
    """Return the plural of a regular noun: "messages", "boxes"."""
    return noun + ("es" if noun.endswith(("ch", "s", "sh", "x")) else "s")


def percent(share: float) -> str:
    """Return a share in per cent, with one digit."""
    number = 100.0 * share
    return f"{number:.1f} %" if number >= 0.05 or number == 0.0 else "< 0.1 %"


def why_refused(cause: OSError) -> str:
    """Return the reason of an OSError in words."""
    if isinstance(cause, FileExistsError):
        path = Path(cause.filename or "")
        is_lost = path.is_symlink() and not path.exists()
        return f"{path.name} is a link that leads nowhere" if is_lost else "it is a file"
    if isinstance(cause, IsADirectoryError):
        return "it is a folder"
    return (cause.strerror or str(cause)).lower()


def listed(words: Sequence[str]) -> str:
    """Return words as a list: "a", "a and b", "a, b and c"."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def listed_files(names: Sequence[str]) -> str:
    """Return names of files with commas; of many, the first two and the last, with their number."""
    if len(names) <= _MOST_FILES:
        return ", ".join(names)
    return f"{', '.join(names[:2])} ... {names[-1]} ({len(names)} files)"


def duration_text(duration_ns: int) -> str:
    """Return a duration: "0.25 s", "61.0 s", "10.0 min", "1.0 h", "3.0 years"."""
    duration_s = duration_ns / NS_PER_S
    length_s, unit = time_unit(duration_s)
    return f"{duration_s / length_s:.{2 if duration_s < _SHORT_S else 1}f} {unit}"


def time_unit(duration_s: float, least: float = 2.0) -> tuple[float, str]:
    """Return length [s] and name of the longest unit of which a duration has at least so many."""
    fitting = ((length_s, unit) for unit, length_s in _UNITS if duration_s >= least * length_s)
    return next(fitting, (1.0, "s"))


def aligned(rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()) -> list[str]:
    """Return rows of cells as lines, two spaces indented; columns in `numbers` to the right."""
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = [
            cell.rjust(width) if column in numbers else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append(("  " + "  ".join(cells)).rstrip())
    return lines


def section(title: str, lines: Sequence[str]) -> list[str]:
    """Return a title, its lines, and an empty line."""
    return [title, *lines, ""]
