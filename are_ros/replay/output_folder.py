"""The folder of a replay's results: made before the run; it gets all results or none."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from are_ros.bag.writer import lock
from are_ros.errors import BagError
from are_ros.wording import listed, why_refused

AUGMENTED: Final = "augmented.mcap"
VIEW: Final = "view.html"
METRICS: Final = "metrics.json"
TIMING: Final = "timing.json"
ANIMATION: Final = "animation.gif"
_EXPORTS: Final = (".gif", ".glb", ".ply")
RESULTS: Final = (AUGMENTED, "overview.png", VIEW, "effective.yaml", METRICS, TIMING)


def prepare_folder(folder: Path, results: Sequence[str] = RESULTS) -> None:
    """Make the folder; BagError if nothing can be written, or a folder has a result's name."""
    _make(folder, f"--out {folder}: the folder")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise BagError(f"--out {folder}: nothing can be written there (permission denied)")
    for name in results:
        if (folder / name).is_dir():
            raise BagError(f"--out {folder}: {name} cannot be written, a folder has that name")


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Make the folder, and keep other runs out of it while a block runs.

    BagError if it cannot be made, or if another run is at work there.
    """
    _make(folder, f"--out {folder}: the folder")
    handle = None
    try:
        try:
            handle = os.open(folder, os.O_RDONLY)
            lock(handle)
        except BlockingIOError as cause:
            raise BagError(f"--out {folder}: another run writes its results there") from cause
        except OSError:  # a folder that may not be listed cannot be locked
            pass
        yield
    finally:
        if handle is not None:
            os.close(handle)


@contextmanager
def no_empty_folders(*folders: Path) -> Iterator[None]:
    """Remove the folders that a failing block has made, and those above them, if they are empty."""
    above = [path for folder in folders for path in (folder, *folder.parents)]
    missing = [path for path in above if not os.access(path, os.F_OK)]
    try:
        yield
    except BaseException:
        for path in missing:
            with suppress(OSError):
                path.rmdir()
        raise


def earlier_results(folder: Path) -> list[Path]:
    """Return where results of an earlier run may lie: none of them belongs to a new recording."""
    paths = [folder / name for name in (*RESULTS, ANIMATION)]
    return [path for path in paths if not path.is_dir()]


def earlier_exports(folder: Path) -> list[str]:
    """Return a sentence if meshes or animations in a folder are older than its recording.

    The user has named them, so they are not removed.
    """
    written_ns = (folder / AUGMENTED).stat().st_mtime_ns
    files = [file for file in folder.iterdir() if file.suffix in _EXPORTS]
    names = sorted(file.name for file in files if file.lstat().st_mtime_ns < written_ns)
    verb = "is" if len(names) == 1 else "are"
    return [f"{listed(names)} in that folder {verb} of an earlier run"] if names else []


def prepare_scenario(path: Path) -> None:
    """Make the folder of a scenario; BagError if the files cannot be written."""
    from are_ros.builder.files.scenario_file import scenario_files

    _make(path.parent, f"--save-scenario {path}: its folder")
    for file in scenario_files(path):
        reason = "a folder has that name" if file.is_dir() else ""
        if not os.access(file if file.exists() else file.parent, os.W_OK):
            reason = "permission denied"
        if reason:
            raise BagError(f"--save-scenario {path}: {file.name} cannot be written ({reason})")


def _make(folder: Path, subject: str) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as cause:
        raise BagError(f"{subject} cannot be made ({why_refused(cause)})") from cause


def picture_beside(recording: Path, name: str) -> Path:
    """Return the path of a picture of a recording, in the folder of the recording.

    Beside augmented.mcap it is `name`; beside any other file the file's name comes first.
    """
    if recording.is_dir():
        return recording / name
    is_standard = recording.name == AUGMENTED
    return recording.with_name(name if is_standard else f"{recording.stem}_{name}")


def why_no_animation(path: Path) -> str:
    """Return why a file of this name is no animation, empty if it can be one."""
    return "" if path.suffix == ".gif" else f"'{path}' is no .gif file: animations are GIFs"


def animation_path(wanted: Path, folder: Path) -> Path:
    """Return where an animation goes: a bare name into the folder of the results.

    Raises BagError for another format, or where the folder that it names is not there.
    """
    if reason := why_no_animation(wanted):
        raise BagError(f"--animate: {reason}")
    if wanted.name == str(wanted):
        return folder / wanted
    if not wanted.parent.is_dir():
        raise BagError(f"--animate {wanted}: there is no folder {wanted.parent}")
    return wanted


@contextmanager
def all_or_nothing(folder: Path, results: Sequence[str] = RESULTS) -> Iterator[None]:
    """Turn an OSError of a write into a BagError, and remove all results, or tell which stay."""
    try:
        yield
    except OSError as cause:
        left = left_of(folder, results)
        rest = f"and {listed(left)} cannot be removed" if left else "none is left"
        reason = why_refused(cause)
        message = f"--out {folder}: the results cannot be written ({reason}), {rest}"
        raise BagError(message) from cause


def left_of(folder: Path, results: Sequence[str]) -> list[str]:
    """Remove files of a folder, and return the names of those that stay."""
    for name in results:
        with suppress(OSError):
            (folder / name).unlink()
    return [name for name in results if (folder / name).is_file()]
