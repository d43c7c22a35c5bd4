"""Which files make up a recording of ~/ar_builder, and whether a replay or a live node wrote it."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import yaml

from are_ros.errors import BagError

RECORDING: Final = "augmented.mcap"
PARAMETERS: Final = "effective.yaml"
_METRICS: Final = "metrics.json"
_METADATA: Final = "metadata.yaml"
_SUFFIXES: Final = (".mcap", ".db3")


@dataclass(frozen=True)
class RecordingFiles:
    """What belongs together: `path` is what readers of recordings open, `files` hold the messages.

    `parameters` is the effective.yaml beside it, None where there is none. A replay logs each
    message at its very stamp; live, messages are logged when they were received.
    """

    path: Path
    files: tuple[Path, ...]
    parameters: Path | None
    is_replay: bool


def find_recording(path: Path) -> RecordingFiles:
    """Return the recording that a path means.

    A folder with augmented.mcap (metrics.json beside it: a replay's, else a live one), a rosbag2
    folder, a folder with one recording in it, or an .mcap or .db3 file. BagError for anything else.
    """
    if not path.exists():
        raise BagError(f"{path}: there is no such file or folder")
    if path.is_dir():
        return _in_folder(path)
    if path.suffix == ".bag":
        raise BagError(
            f"{path}: a recording of ROS 1 holds inputs only, and what the node or a replay gave "
            "out is needed: run `are replay` on it first, and give the folder of the results"
        )
    if path.suffix not in _SUFFIXES:
        raise BagError(f"{path}: no recording of ROS 2; .mcap and .db3 files are")
    is_replay = path.name == RECORDING and (path.parent / _METRICS).is_file()
    return RecordingFiles(path, (path,), _parameters_in(path.parent), is_replay)


def walls_of(recording: Path) -> str:
    """Return what the metrics beside a recording say of its walls: "map", "octomap" or nothing."""
    try:
        content = json.loads((recording.parent / _METRICS).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return ""
    return str(content.get("walls", "")) if isinstance(content, dict) else ""


def _in_folder(folder: Path) -> RecordingFiles:
    if (folder / RECORDING).is_file():
        return find_recording(folder / RECORDING)
    if (folder / _METADATA).is_file():
        files = _files_of(folder)
        return RecordingFiles(folder, files, _parameters_in(folder), is_replay=False)
    inside = sorted(file for file in folder.iterdir() if file.suffix in _SUFFIXES)
    if not inside:
        raise BagError(f"{folder}: there is no {RECORDING} in it, nor another recording")
    if len(inside) > 1:
        names = ", ".join(file.name for file in inside)
        raise BagError(f"{folder}: there are several recordings, give one of them: {names}")
    return find_recording(inside[0])


def _files_of(folder: Path) -> tuple[Path, ...]:
    """Return the files that the metadata of a rosbag2 folder name, in their order."""
    try:
        content = yaml.safe_load((folder / _METADATA).read_text(encoding="utf-8"))
        names = content["rosbag2_bagfile_information"]["relative_file_paths"]
        files = tuple(folder / str(name) for name in names)
    except (OSError, yaml.YAMLError, KeyError, TypeError, UnicodeDecodeError) as cause:
        message = f"{folder}: its {_METADATA} is malformed"
        raise BagError(message) from cause
    missing = [file.name for file in files if not file.is_file()]
    if missing or not files:
        raise BagError(f"{folder}: files that its {_METADATA} names are missing")
    return files


def _parameters_in(folder: Path) -> Path | None:
    file = folder / PARAMETERS
    return file if file.is_file() else None
