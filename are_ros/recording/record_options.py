"""What a recording is asked to do, where its file goes, and which topics it takes."""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from are_ros.errors import BagError
from are_ros.replay.bag_writer import partial_path
from are_ros.wording import why_refused

_OTHER_KINDS = (".bag", ".db3", ".part", ".yaml")


@dataclass(frozen=True)
class RecordOptions:
    """The options of `are record`.

    `path` is an .mcap file, or a folder that becomes a rosbag2 recording. `topics` (empty: all
    but hidden ones) and `exclude` are names, in which * and ? stand for anything. `wait_for`:
    the recording is ready when these have a publisher. `duration_s` counts from then on, in
    simulated seconds if `use_sim_time`: log times are then /clock's. Existing files are kept
    unless `overwrite`.
    """

    path: Path
    topics: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    duration_s: float | None = None
    use_sim_time: bool = False
    wait_for: tuple[str, ...] = ()
    overwrite: bool = False

    def is_selected(self, topic: str) -> bool:
        """Tell whether a topic, by its full name, is to be recorded."""
        if _matches(topic, self.exclude):
            return False
        return _matches(topic, self.topics) if self.topics else not _is_hidden(topic)

    def named_topics(self) -> tuple[str, ...]:
        """Return the full names of the topics that were asked for by name."""
        names = (_full(name) for name in self.topics if not {"*", "?", "["} & set(name))
        return tuple(name for name in names if self.is_selected(name))

    def awaited_topics(self) -> frozenset[str]:
        """Return the full names of `wait_for`; BagError if one of them is not to be recorded."""
        names = frozenset(_full(name) for name in self.wait_for)
        for name in sorted(names):
            if not self.is_selected(name):
                raise BagError(f"{name} is waited for, but it is not among the topics to record")
        return names

    @property
    def is_folder(self) -> bool:
        """Whether the recording is a rosbag2 folder."""
        return self.path.suffix != ".mcap"

    @property
    def file(self) -> Path:
        """The MCAP file, in a folder named as rosbag2 does."""
        return self.path / f"{self.path.name}_0.mcap" if self.is_folder else self.path

    def prepare_place(self) -> None:
        """Make the folder of the file; BagError if it cannot be, or something stands there."""
        if self.path.suffix in _OTHER_KINDS:
            raise BagError(f"{self.path}: a recording is an .mcap file, or a folder")
        if self.file.is_dir():
            raise BagError(f"{self.file} is a folder; choose another name")
        if not self.overwrite:
            self._refuse_existing()
        try:
            self.file.parent.mkdir(parents=True, exist_ok=True)
        except OSError as cause:
            message = f"{self.file.parent}: the folder cannot be made: {why_refused(cause)}"
            raise BagError(message) from cause

    def _refuse_existing(self) -> None:
        partial = partial_path(self.file)
        if partial.exists():
            raise BagError(
                f"{partial} is there: a recording that still runs, or was killed"
                " (`mcap recover` saves it); move it away, or choose another name or --overwrite"
            )
        is_taken = self.path.exists() and not (self.is_folder and _is_empty_folder(self.path))
        if is_taken:
            raise BagError(f"{self.path} exists already; choose another name, or --overwrite")


def _full(name: str) -> str:
    return name if name.startswith("/") else f"/{name}"


def _matches(topic: str, patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(topic, _full(pattern)) for pattern in patterns)


def _is_hidden(topic: str) -> bool:
    """Tell whether part of the name begins with an underscore, as the topics of actions do."""
    return "/_" in topic


def _is_empty_folder(path: Path) -> bool:
    return path.is_dir() and not any(path.iterdir())
