"""The folder of a replay's results: made before the run, and never left with half of a set."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from are_ros.errors import BagError

AUGMENTED: Final = "augmented.mcap"
RESULTS: Final = (AUGMENTED, "overview.png", "effective.yaml", "metrics.json", "timing.json")


def prepare_folder(folder: Path) -> None:
    """Make the folder; BagError if it cannot be, or if a folder has the name of a result."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as cause:
        is_taken = isinstance(cause, FileExistsError)
        reason = "it is a file" if is_taken else (cause.strerror or "unknown").lower()
        message = f"--out {folder}: the folder cannot be made ({reason})"
        raise BagError(message) from cause
    for name in RESULTS:
        if (folder / name).is_dir():
            raise BagError(f"--out {folder}: {name} cannot be written, a folder has that name")


def picture_beside(recording: Path, name: str) -> Path:
    """Return where a picture of a recording goes: into its folder, where none of another is.

    The standard recording gives it its name, any other file has its own before that.
    """
    if recording.is_dir():
        return recording / name
    is_standard = recording.name == AUGMENTED
    return recording.with_name(name if is_standard else f"{recording.stem}_{name}")


@contextmanager
def all_or_nothing(folder: Path, results: Sequence[str] = RESULTS) -> Iterator[None]:
    """Turn what the system refuses to write into a BagError, and remove every result then."""
    try:
        yield
    except OSError as cause:
        for name in results:
            with suppress(OSError):
                (folder / name).unlink()
        reason = (cause.strerror or str(cause)).lower()
        message = f"--out {folder}: the results cannot be written ({reason}), none is left"
        raise BagError(message) from cause
