"""Recordings of the node, of a replay or of `are record`: files, messages, runs of ticks.

A replay logs every message at its stamp. A live recorder logs a message when it is received: later,
and perhaps by another clock than that of the stamps. Then the ticks, by their stamps and in the
order of the file, give the time: `RecordedMessage.at_ns`.
"""

import json
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, Final, NamedTuple

import yaml

from are_ros.bag.decoded import Scene, value_of
from are_ros.bag.file_order import ROS2_SUFFIXES
from are_ros.bag.marker_decoding import decode_markers
from are_ros.bag.reader import (
    METADATA,
    RECORDING,
    STAMP_AT,
    BagMessage,
    BagReader,
    BagTopic,
    stamp_in,
)
from are_ros.conventions import NS_PER_S
from are_ros.errors import AreError, BagError, InputError, ParameterError
from are_ros.messages.sensors import CAMERA_INFO_TYPE, OUTPUT_TYPES, SENSORS
from are_ros.messages.tick_encoding import ALL_OUTPUTS, OUTPUTS
from are_ros.parameters.declaration import Value, flatten
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import EFFECTIVE_TOPIC, EFFECTIVE_TYPE, with_file, with_text
from are_ros.wording import listed, listed_files

PREFIX: Final = "/ar_builder/"
INPUT_TYPES: Final = (
    "nav_msgs/msg/OccupancyGrid",
    "tf2_msgs/msg/TFMessage",
    "nav_msgs/msg/Odometry",
    *(name for kind in SENSORS.values() for name in kind.type_names),
    CAMERA_INFO_TYPE,
)
GRID_TOPICS: Final = tuple(
    PREFIX + name for name, output in OUTPUTS.items() if "/OccupancyGrid" in output.type_name
)
MARKERS: Final = PREFIX + "markers"
ARTEFACTS: Final = PREFIX + "artefacts"
_DRAWN: Final = (MARKERS, *GRID_TOPICS)

_EFFECTIVE: Final = PREFIX + EFFECTIVE_TOPIC

PARAMETERS: Final = "effective.yaml"
_METRICS: Final = "metrics.json"

_OWN_TYPES: Final = "are_"
_MARKER_ARRAY: Final = "visualization_msgs/msg/MarkerArray"
_LISTS: Final = (_MARKER_ARRAY, "tf2_msgs/msg/TFMessage")
_LATCHED: Final = ("/map", "/tf_static")
_PAST_NS: Final = 2 * NS_PER_S
"""An output whose stamp is this much before the last tick is a relayed message."""
_JUMP_NS: Final = NS_PER_S
"""The clock jumped back where an output of ticks is this much earlier than the one before."""

_OpenProgress = Callable[[int, int], Callable[[int], None]]
"""Takes the first and the last log time [ns]; what it returns takes the time reached."""

SETTLING_NS: Final = NS_PER_S
"""For this long after the beginning of a run, and before its end, messages may be missing."""
_LONGEST_GAP: Final = 2.5
"""In periods: one tick may be missing within a run, since the next one has all events."""


@dataclass(frozen=True)
class RecordingFiles:
    """The files of a recording: readers open `path`; `files` hold the messages.

    `parameters` is the effective.yaml beside it, None where there is none of this run.
    """

    path: Path
    files: tuple[Path, ...]
    parameters: Path | None
    is_replay: bool

    @cached_property
    def told(self) -> Parameters | None:
        """The parameters of the run, None where nothing tells them. ParameterError.

        Those of the file beside it, else those that the node published last.
        """
        if self.parameters is not None:
            return with_file(Parameters(), self.parameters)
        last: Parameters | None = None
        with suppress(BagError), Recording(self) as recording:  # who reads on tells of them
            for parameters in recording.published_parameters():
                last = parameters
        return last

    def effective(self) -> Parameters:
        """Return the parameters of the run, the defaults where nothing tells. ParameterError."""
        return Parameters() if self.told is None else self.told

    @property
    def untold(self) -> str:
        """What to do where nothing tells the parameters, as the end of a sentence; else ""."""
        if self.told is not None:
            return ""
        return (
            f"; the defaults were taken, as the recording holds no {_EFFECTIVE} and no {PARAMETERS}"
            " of this run lies beside it: copy the node's parameter file there by that name, or"
            f" write it with `ros2 param dump /ar_builder > {PARAMETERS}`"
        )


def find_recording(path: Path) -> RecordingFiles:
    """Return the recording at a path.

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
    if path.suffix not in ROS2_SUFFIXES:
        raise BagError(f"{path}: it is no recording of ROS 2, whose files end in .mcap or .db3")
    is_replay = path.name == RECORDING and (path.parent / _METRICS).is_file()
    # an effective.yaml beside augmented.mcap is that run's
    is_own = path.name == RECORDING or not (path.parent / RECORDING).is_file()
    parameters = _parameters_in(path.parent) if is_own else None
    return RecordingFiles(path, (path,), parameters, is_replay)


def walls_of(recording: Path) -> str:
    """Return the walls of a run by the metrics beside its recording: "map", "octomap" or ""."""
    try:
        content = json.loads((recording.parent / _METRICS).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return ""
    return str(content.get("walls", "")) if isinstance(content, dict) else ""


def _in_folder(folder: Path) -> RecordingFiles:
    if (folder / RECORDING).is_file():
        return find_recording(folder / RECORDING)
    if (folder / METADATA).is_file():
        files = _files_of(folder)
        return RecordingFiles(folder, files, _parameters_in(folder), is_replay=False)
    inside = sorted(file for file in folder.iterdir() if file.suffix in ROS2_SUFFIXES)
    if not inside:
        raise BagError(f"{folder}: there is no {RECORDING} in it, nor another recording")
    if len(inside) > 1:
        names = listed_files([file.name for file in inside])
        raise BagError(f"{folder}: there are several recordings, give one of them: {names}")
    return find_recording(inside[0])


def _files_of(folder: Path) -> tuple[Path, ...]:
    """Return the files that the metadata of a rosbag2 folder name, in their order."""
    try:
        content = yaml.safe_load((folder / METADATA).read_text(encoding="utf-8"))
        names = content["rosbag2_bagfile_information"]["relative_file_paths"]
        files = tuple(folder / str(name) for name in names)
    except (OSError, yaml.YAMLError, KeyError, TypeError, UnicodeDecodeError) as cause:
        message = f"{folder}: its {METADATA} is malformed"
        raise BagError(message) from cause
    missing = [file.name for file in files if not file.is_file()]
    if missing or not files:
        raise BagError(f"{folder}: files that its {METADATA} names are missing")
    return files


def _parameters_in(folder: Path) -> Path | None:
    file = folder / PARAMETERS
    return file if file.is_file() else None


def stamp_of(type_name: str, data: bytes) -> int | None:
    """Return the stamp of a message in CDR whose type begins with a header, or a list of such."""
    return stamp_in(data, STAMP_AT + 4 * (type_name in _LISTS))


@dataclass
class LiveTicks:
    """The ticks of a live recording, by the places of their messages in the file.

    Messages from the place `end` on are left out: there the clock has jumped back by `back_ns`, as
    where a looping recording is played to the node. None: it never has.
    """

    places: list[int] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)
    end: int | None = None
    back_ns: int = 0

    @classmethod
    def of(cls, messages: Iterable["RecordedMessage"]) -> "LiveTicks":
        """Return the ticks among messages, which come in the order of the file."""
        ticks, newest_ns = cls(), dict[str, int]()
        for place, message in enumerate(messages):
            if not message.type_name.startswith(_OWN_TYPES):
                continue
            stamp_ns = stamp_of(message.type_name, message.data)
            if stamp_ns is None:
                continue
            back_ns = newest_ns.get(message.topic, stamp_ns) - stamp_ns
            if back_ns > _JUMP_NS:
                ticks.end, ticks.back_ns = place, back_ns
                break
            newest_ns[message.topic] = stamp_ns
            if message.topic == ARTEFACTS:
                ticks.places.append(place)
                ticks.stamps_ns.append(stamp_ns)
        return ticks

    def before(self, place: int) -> int | None:
        """Return the last tick before a place, the first one before all; None without ticks."""
        if not self.places:
            return None
        return self.stamps_ns[max(bisect_right(self.places, place) - 1, 0)]


def home_of(topics: Iterable[str], where: str) -> str:
    """Return the namespace of the node whose outputs are among topics; "" for none, and for /.

    BagError names `where` if there are several nodes, none of them in the namespace /.
    """
    homes = sorted({topic.split(PREFIX)[0] for topic in topics if PREFIX in topic})
    if len(homes) > 1 and homes[0]:
        nodes = listed([home + PREFIX.rstrip("/") for home in homes])
        raise BagError(f"{where}: it holds topics of several nodes, {nodes}: record one alone")
    return homes[0] if homes else ""


def without_home(topic: str, home: str) -> str:
    """Return the name of a topic as a node without that namespace has it: /a/scan as /scan."""
    return topic[len(home) :] if topic.startswith(f"{home}/") else topic


class RecordedMessage(NamedTuple):
    """A recorded message; `Recording.decode` makes a value of it.

    `at_ns` is the time at which it counts. In a replay that is its log time. Live it is the stamp
    of an output, and for an input the stamp of the last tick before it.
    """

    topic: str
    type_name: str
    log_ns: int
    data: bytes
    at_ns: int = 0


class Recording:
    """The messages of a recording, any number of times; a context manager, open inside `with`.

    Of a node in a namespace, topics have the names that they would have without it. BagError where
    it cannot be opened or read.
    """

    def __init__(self, files: RecordingFiles) -> None:
        self.files = files
        self._reader = BagReader([files.path])
        self._names: dict[str, str] = {}
        self._connections: dict[tuple[str, str], Any] = {}
        self._ticks: LiveTicks | None = None

    def __enter__(self) -> "Recording":  # noqa: PYI034 (Self came with Python 3.11)
        self._reader.__enter__()
        names = [topic.name for topic in self._reader.topics]
        try:
            home = home_of(names, str(self.files.path))
        except BagError:
            self._reader.__exit__(None, None, None)
            raise
        self._names = {name: without_home(name, home) for name in names}
        connections = self._reader.connections()
        self._connections = {(self._names[one.topic], one.msgtype): one for one in connections}
        return self

    def __exit__(self, *error: object) -> None:
        self._reader.__exit__(*error)

    @property
    def topics(self) -> tuple[BagTopic, ...]:
        """The topics, in order of name."""
        topics = [replace(one, name=self._names[one.name]) for one in self._reader.topics]
        return tuple(sorted(topics, key=lambda topic: topic.name))

    @property
    def types(self) -> dict[str, str]:
        """The type of each topic, as "sensor_msgs/msg/LaserScan"."""
        return {topic.name: topic.type_name for topic in self.topics}

    @property
    def left_out(self) -> str:
        """What `messages` leave out, as a sentence: all after a jump of the clock; "" for nothing.

        A replay has no jump. Of a folder, files that its metadata do not name are left out, too.
        """
        said = self._reader.unnamed
        ticks = LiveTicks() if self.files.is_replay else self._live_ticks()
        if ticks.end is not None:
            back = f"the clock jumps back by {ticks.back_ns / NS_PER_S:.1f} s"
            said += [
                f"{back}, as where a drive is played once more: what comes after that is left out"
            ]
        return "; ".join(said)

    def published_parameters(self) -> Iterator[Parameters]:
        """Yield the parameters that the node published, each time that they changed.

        A ParameterError names the recording; what else is wrong raises as `messages` does.
        """
        text, subject = "", f"{self.files.path}: its {_EFFECTIVE}"
        for message in self.in_log_order([_EFFECTIVE]):
            if message.type_name == EFFECTIVE_TYPE:
                before, text = text, self._text_of(message)
                if text not in ("", before):
                    yield with_text(Parameters(), text, subject)

    def _text_of(self, message: RecordedMessage) -> str:
        try:
            return str(self.deserialize(message).data)
        except InputError as cause:
            raise ParameterError(f"{self.files.path}: {cause}") from cause

    @property
    def changed_parameters(self) -> tuple[str, ...]:
        """The names of parameters that changed meanwhile, as far as the node published them."""
        changed, before = set[str](), dict[str, Value]()
        with suppress(AreError):
            for parameters in self.published_parameters():
                now = flatten(parameters)
                changed |= {name for name in before if now[name] != before[name]}
                before = now
        return tuple(sorted(changed))

    def in_log_order(
        self,
        topics: Collection[str] | None,
        open_progress: _OpenProgress | None = None,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages of some topics in order of log time, which is their `at_ns`.

        `open_progress` gets the first and the last log time; what it returns, the time reached.
        """
        return self._with_progress(self._in_log_order(topics), open_progress)

    def messages(
        self,
        topics: Collection[str] | None = None,
        open_progress: _OpenProgress | None = None,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages of some topics (None: all) with the times at which they count.

        Those of a replay come in order of log time, those of a live recording in the order of the
        file: the topics of `matters` only, up to the first jump of the clock. `open_progress` is as
        for `in_log_order`.
        """
        return self._with_progress(self._timed(topics), open_progress)

    def decode(self, message: RecordedMessage) -> Any:
        """Return the value of a message: one of `decoded`, or a list of `MarkerFields`.

        A type without a value gives rosbags' object. InputError for bytes that are no such message,
        with what the decoder raised as its cause; ValueError or OverflowError for bad contents.
        """
        if message.type_name == _MARKER_ARRAY:
            return decode_markers(bytes(message.data))
        return value_of(message.type_name, self.deserialize(message), message.at_ns)

    def deserialize(self, message: RecordedMessage) -> Any:
        """Return rosbags' object of a message; InputError where it is malformed."""
        topic, type_name, log_ns, data, *_ = message
        connection = self._connections[topic, type_name]
        try:
            return self._reader.deserialize(BagMessage(topic, log_ns, data, connection))
        except BagError as cause:
            raise InputError(str(cause)) from None

    def _with_progress(
        self, messages: Iterable[RecordedMessage], open_progress: _OpenProgress | None
    ) -> Iterator[RecordedMessage]:
        start_ns, end_ns = self._reader.start_ns, self._reader.end_ns
        progress = open_progress(start_ns, end_ns) if open_progress else lambda _: None
        for message in messages:
            yield message
            progress(message.log_ns)
        progress(end_ns)

    def _in_log_order(self, topics: Collection[str] | None) -> Iterator[RecordedMessage]:
        names = None if topics is None else self._recorded(topics)
        for topic, log_ns, data, connection in self._reader.messages(names):
            yield RecordedMessage(self._names[topic], connection.msgtype, log_ns, data, log_ns)

    def _timed(self, topics: Collection[str] | None) -> Iterator[RecordedMessage]:
        if self.files.is_replay:
            yield from self._in_log_order(topics)
            return
        ticks = self._live_ticks()
        for place, message in enumerate(islice(self._in_file_order(), ticks.end)):
            if topics is None or message.topic in topics:
                yield _timed(message, ticks.before(place))

    def _in_file_order(self) -> Iterator[RecordedMessage]:
        """Yield the relevant messages of a live recording as they were written."""
        types = {topic: name for topic, name in self.types.items() if matters(topic, name)}
        for topic, log_ns, data, _ in self._reader.in_file_order(self._recorded(types)):
            name = self._names[topic]
            yield RecordedMessage(name, types[name], log_ns, data)

    def _recorded(self, topics: Collection[str]) -> list[str]:
        """Return the names in the file of some topics."""
        return [recorded for recorded, name in self._names.items() if name in topics]

    def _live_ticks(self) -> LiveTicks:
        self._ticks = self._ticks or LiveTicks.of(self._in_file_order())
        return self._ticks


def matters(topic: str, type_name: str) -> bool:
    """Return whether a topic is an output of the node, or may be one of its inputs."""
    if topic.startswith(PREFIX):
        name = topic.removeprefix(PREFIX)
        expected = {ALL_OUTPUTS[name].type_name} if name in ALL_OUTPUTS else OUTPUT_TYPES
        return type_name in expected
    return type_name in INPUT_TYPES


def _timed(message: RecordedMessage, tick_ns: int | None) -> RecordedMessage:
    """Return a message of a live recording, which came after a tick, with its time."""
    is_latched = message.topic in _LATCHED
    stamp_ns = None if is_latched else stamp_of(message.type_name, message.data)
    tick_ns = stamp_ns or 0 if tick_ns is None else tick_ns
    at_ns = tick_ns
    if stamp_ns is not None:
        is_relayed = stamp_ns < tick_ns - _PAST_NS  # as a real map's may be
        is_drawn = message.topic in _DRAWN and not is_relayed
        is_own = message.topic.startswith(PREFIX) and message.type_name.startswith(_OWN_TYPES)
        if is_drawn or is_own:
            at_ns = stamp_ns
    return message._replace(at_ns=at_ns)


@dataclass(frozen=True)
class Runs:
    """First and last stamps of runs of ticks, in order; none where every tick counts.

    A recording begins and ends at any time, and it may pause; so may the node. Checks cannot expect
    messages of these times, nor while the topics of a recording connect one by one.
    """

    spans_ns: tuple[tuple[int, int], ...] = ()

    def is_fresh(self, stamp_ns: int) -> bool:
        """Return whether a run began less than `SETTLING_NS` before."""
        span = self._span_at(stamp_ns)
        return span is not None and stamp_ns < span[0] + SETTLING_NS

    def is_beginning(self, stamp_ns: int) -> bool:
        """Return whether this is the first tick of a run."""
        span = self._span_at(stamp_ns)
        return span is not None and stamp_ns == span[0]

    def is_edge(self, stamp_ns: int) -> bool:
        """Return whether a time is in no run, or near the beginning or the end of one."""
        if not self.spans_ns:
            return False
        span = self._span_at(stamp_ns)
        return span is None or not span[0] + SETTLING_NS <= stamp_ns <= span[1] - SETTLING_NS

    def is_between(self, stamp_ns: int) -> bool:
        """Return whether a time is after a run, before the next one, and near neither of them."""
        index = bisect_right(self.spans_ns, (stamp_ns, 2**63)) - 1
        if index < 0 or stamp_ns <= self.spans_ns[index][1] + SETTLING_NS:
            return False
        after = self.spans_ns[index + 1 : index + 2]
        return not after or stamp_ns <= after[0][0] - SETTLING_NS

    def are_together(self, before_ns: int, after_ns: int) -> bool:
        """Return whether two times are in the same run."""
        if not self.spans_ns:
            return True
        return self._span_at(before_ns) == self._span_at(after_ns) is not None

    def _span_at(self, stamp_ns: int) -> tuple[int, int] | None:
        index = bisect_right(self.spans_ns, (stamp_ns, 2**63)) - 1
        if index < 0 or stamp_ns > self.spans_ns[index][1]:
            return None
        return self.spans_ns[index]


def runs_of(stamps_ns: Iterable[int], period_ns: int, breaks_ns: Iterable[int]) -> Runs:
    """Return the runs of ticks, which a gap or one of `breaks_ns` (a farewell) parts."""
    breaks = sorted(breaks_ns)
    spans: list[tuple[int, int]] = []
    for stamp_ns in stamps_ns:
        before_ns = spans[-1][1] if spans else None
        if (
            before_ns is not None
            and stamp_ns - before_ns <= _LONGEST_GAP * period_ns
            and bisect_left(breaks, stamp_ns) == bisect_left(breaks, before_ns)
        ):
            spans[-1] = (spans[-1][0], stamp_ns)
        else:
            spans.append((stamp_ns, stamp_ns))
    return Runs(tuple(spans))


def part_farewells(scenes: Iterable[Scene], period_ns: int) -> tuple[list[Scene], list[int]]:
    """Separate the ticks from the farewells of a node; return the ticks and the farewells' stamps.

    A farewell is empty. Its stamp is no multiple of the period, or that of the tick before.
    """
    ticks: list[Scene] = []
    farewells_ns: list[int] = []
    for scene in scenes:
        is_late = bool(scene.stamp_ns % period_ns)
        is_again = bool(ticks) and ticks[-1].stamp_ns == scene.stamp_ns
        if not len(scene.ids) and (is_late or is_again):
            farewells_ns.append(scene.stamp_ns)
        else:
            ticks.append(scene)
    return ticks, farewells_ns
