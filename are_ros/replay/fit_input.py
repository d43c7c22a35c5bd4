"""The rows that `are fit` learns from: out of a table, a list, or a recording of ~/ar_builder."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

from are_ros.artefacts.catalogue import Catalogue
from are_ros.artefacts.mixture_fit import Counts
from are_ros.errors import InputError

OpenProgress = Callable[[int, int], Callable[[int], None]]
"""Given the first and the last time [ns], returns what is told how far the reading has come."""

_TABLES: Final = (".csv", ".txt")
_RECORDINGS: Final = (".mcap", ".db3")


@dataclass(frozen=True, eq=False)
class RowSpace:
    """The rows that can occur: how many, and whose labels they have (None: nobody knows)."""

    rows: int
    catalogue: Catalogue | None = None

    @classmethod
    def of(cls, catalogue: Catalogue) -> "RowSpace":
        """Return the rows of a catalogue."""
        return cls(len(catalogue.rows), catalogue)

    @cached_property
    def row_of_label(self) -> dict[str, int]:
        """The row of each label, as far as known."""
        rows = self.catalogue.rows if self.catalogue else ()
        return {row.label: row.index for row in rows}


@dataclass(frozen=True, eq=False)
class ObservedRows:
    """How often each row was drawn, int64 (rows,), and sentences on what was counted."""

    counts: Counts
    notes: tuple[str, ...] = ()


def read_observed(path: Path, space: RowSpace, open_progress: OpenProgress) -> ObservedRows:
    """Read the rows drawn out of a .csv or .txt table, a .json list, or a recording.

    Raises InputError, naming the file, the line or field and the reason, for what is no row of
    `space`, and BagError for a recording that cannot be read.
    """
    from are_ros.replay._fit_recording import read_recording
    from are_ros.replay._fit_tables import read_list, read_table

    if is_recording(path):
        return read_recording(path, space, open_progress)
    if not path.exists():
        raise InputError(f"{path}: there is no such file or folder")
    if path.suffix == ".json":
        return read_list(path, space)
    if path.suffix in _TABLES:
        return read_table(path, space)
    known = ", ".join((*_TABLES, ".json", *_RECORDINGS))
    raise InputError(f"{path}: observed rows are read from {known} files and recordings' folders")


def is_recording(path: Path) -> bool:
    """Tell whether a path means a recording of ROS 2, by its name."""
    return path.is_dir() or path.suffix in _RECORDINGS
