"""Where an animation goes, and in which format: decided before anything is run."""

from pathlib import Path
from typing import Final

from are_ros.errors import BagError

ANIMATION: Final = "animation.gif"
FILM_SUFFIXES: Final = (".gif", ".webp", ".mp4")


def why_no_film(path: Path) -> str:
    """Return why a file of this name is no animation, empty if it can be one."""
    if path.suffix in FILM_SUFFIXES:
        return ""
    known = ", ".join(FILM_SUFFIXES[:-1])
    return f"'{path}' is no {known} or {FILM_SUFFIXES[-1]} file"


def film_path(wanted: Path, folder: Path) -> Path:
    """Return where an animation goes: a bare name into the folder of the results.

    Raises BagError for another format, or where the folder that it names is not there.
    """
    if reason := why_no_film(wanted):
        raise BagError(f"--animate: {reason}")
    if wanted.name == str(wanted):
        return folder / wanted
    if not wanted.parent.is_dir():
        raise BagError(f"--animate {wanted}: there is no folder {wanted.parent}")
    return wanted
