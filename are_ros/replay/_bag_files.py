"""Which files are recordings, and who reads them."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from are_ros.errors import BagError
from are_ros.replay._bag_errors import as_bag_errors

_ROS2_SUFFIXES = (".mcap", ".db3")
_METADATA = "metadata.yaml"
_RESULT = "augmented.mcap"
"""What replay and demo leave in their folder."""


def check_paths(paths: Sequence[Path]) -> bool:
    """Return whether these are recordings of ROS 1 (else of ROS 2).

    BagError if there is none, one does not exist, is no recording or is given twice, or if they
    are mixed.
    """
    if not paths:
        raise BagError("no recording was given")
    kinds = {_is_ros1(path) for path in paths}
    _check_once(paths)
    if len(kinds) > 1:
        raise BagError("recordings of ROS 1 and of ROS 2 cannot be read together")
    return kinds.pop()


@contextmanager
def open_reader(path: Path) -> Iterator[Any]:
    """Open one recording with rosbags' reader of its kind; BagError if it cannot be read."""
    from rosbags.rosbag1 import Reader as Ros1Reader
    from rosbags.rosbag2 import Reader as Ros2Reader

    with as_bag_errors(str(path)):
        reader: Any = Ros1Reader(path) if path.suffix == ".bag" else Ros2Reader(path)
        reader.open()
    try:
        yield reader
    finally:
        reader.close()


def recording_in(path: Path) -> Path:
    """Return the recording in a folder that is none itself: a result's, or the only one there.

    Anything else is returned as it is.
    """
    if not path.is_dir() or (path / _METADATA).is_file():
        return path
    inside = [path / _RESULT] if (path / _RESULT).is_file() else _recordings_in(path)
    return inside[0] if len(inside) == 1 else path


def _is_ros1(path: Path) -> bool:
    """Tell the kind of a recording by its name; BagError if it is none."""
    if not path.exists():
        raise BagError(f"{path}: there is no such file or folder")
    if path.is_dir():
        _check_folder(path)
        return False
    if path.suffix == ".active":
        message = f"{path}: the recording was not ended; `rosbag reindex` makes a .bag of it"
        raise BagError(message)
    if path.suffix not in (".bag", *_ROS2_SUFFIXES):
        message = f"{path}: no recording; rosbag2 folders, .mcap, .db3 and .bag files are"
        raise BagError(message)
    return path.suffix == ".bag"


def _check_once(paths: Sequence[Path]) -> None:
    """Refuse a recording that is given twice, whether as a folder or as the file in it."""
    seen: dict[Path, Path] = {}
    for path in paths:
        for file in _recordings_in(path) if path.is_dir() else [path]:
            if file.resolve() in seen:
                raise BagError(f"{path}: this recording is given twice")
            seen[file.resolve()] = path


def _check_folder(path: Path) -> None:
    if (path / _METADATA).is_file():
        return
    inside = [file.name for file in _recordings_in(path)]
    message = f"{path}: a folder without metadata.yaml is no rosbag2 recording"
    hint = f"; give the files in it themselves: {', '.join(inside)}" if inside else ""
    raise BagError(message + hint)


def _recordings_in(folder: Path) -> list[Path]:
    return sorted(file for file in folder.iterdir() if file.suffix in (".bag", *_ROS2_SUFFIXES))
