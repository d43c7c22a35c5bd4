"""Recordings of ROS 1 and ROS 2: their topics, and their messages in order of time."""

import heapq
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import chain
from pathlib import Path
from struct import Struct
from struct import error as StructError  # noqa: N812
from typing import Any, Final, NamedTuple
from urllib.parse import quote

from rosbags.interfaces import MessageDefinitionFormat, Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from are_ros.bag.file_order import (
    ROS2_SUFFIXES,
    JumpBack,
    jump_back,
    messages_in_file_order,
)
from are_ros.bag.types import jazzy_typestore, ros2_type
from are_ros.conventions import NS_PER_S
from are_ros.errors import AreError, BagError, InputError
from are_ros.messages.transforms import (
    ROS1_DIGEST,
    OdometryNumbers,
    StampedTransform,
    decode_transforms_cdr,
    decode_transforms_ros1,
    encode_transforms_cdr,
    is_plain_cdr,
    read_odometry_numbers,
    read_transforms,
)
from are_ros.wording import listed_files

# Errors of rosbags, as one sentence for the user.


_REINDEX = "it ends too early or is damaged; `rosbag reindex` may repair it"
_RECOVER = "it ends too early (an interrupted recording?); `mcap recover` may repair it"
_DAMAGED = "a part of it is damaged; `mcap recover` may save the rest"
_OTHER_KIND = "its first bytes are not those of a bag of this kind"
_DATABASE = "it ends too early or is damaged; `sqlite3 FILE .recover` may save a part"
_OTHER_DATABASE = "it is no rosbag2 database"
_FILES = "; give the files in it"

_UNSORTED = "its messages are not in order of time, and have no index; `mcap recover` writes one"

_SENTENCES = (
    ("not indexed", "it has no index; `rosbag reindex` makes one"),
    ("index looks damaged", _REINDEX),
    ("Header could not be read", _REINDEX),
    ("of requested", _REINDEX),
    ("File end magic", _RECOVER),
    ("Truncated record", _RECOVER),
    ("Invalid MCAP", _RECOVER),
    ("File magic is invalid", _OTHER_KIND),
    ("invalid magic", _OTHER_KIND),
    ("seems to be empty", "the file is empty"),
    ("Profile is not ros2", "it is an MCAP file of another kind than ROS 2"),
    ("Could not load YAML", f"its metadata.yaml is malformed{_FILES}"),
    ("Invalid bag metadata", f"its metadata.yaml is empty or no rosbag2 metadata{_FILES}"),
    ("metadata key is missing", f"its metadata.yaml lacks a part of rosbag2's metadata{_FILES}"),
    ("Rosbag2 version", f"its metadata.yaml is of an unknown version{_FILES}"),
    ("Serialization format", f"its metadata.yaml names topics that are not CDR{_FILES}"),
    ("Storage plugin", f"its metadata.yaml names another storage than mcap and sqlite3{_FILES}"),
    ("Compression format", "its files are not compressed by zstd; decompress and give them"),
    ("is not a database", f"{_OTHER_DATABASE}, or its beginning is damaged"),
    ("missing tables", f"{_OTHER_DATABASE}, or an empty one"),
    ("database", _DATABASE),
    ("checksum mismatch", _DAMAGED),
    ("not in timestamp order", _UNSORTED),
)

_CUT_OFF = ("EndOfFile", "RecordLengthLimitExceeded")
"""The mcap package's errors for a file whose end is missing: it looks there for the index first."""
_OTHER_SCHEMAS = ("ros1msg", "protobuf", "flatbuffer", "jsonschema")
"""The encodings of schemas that an MCAP file may have beside those of ROS 2."""
_PLAIN_SPOKEN = ("ReaderError", "SerdeError", "TypesysError", "FileNotFoundError")
"""Errors whose text describes the data; the text of others describes the code that failed."""


@contextmanager
def as_bag_errors(what: str) -> Iterator[None]:
    """Turn any other exception than an AreError into a BagError that begins with `what`."""
    try:
        yield
    except AreError:
        raise
    except Exception as cause:  # rosbags, its codecs and SQLite raise all kinds on bad bytes
        message = f"{what}: {sentence_of(cause)}"
        raise BagError(message) from cause


def sentence_of(error: Exception) -> str:
    """Return a plain description of an error, without a full stop."""
    text = " ".join(" ".join(str(part) for part in error.args).split()).rstrip(".")
    if "files are missing" in text:
        paths = re.findall(r"'([^']+)'|\"([^\"]+)\"", text)  # so is a name that has a '
        names = listed_files([Path(one or other).name for one, other in paths])
        return f"files that its metadata.yaml names are missing: {names}; give those there are"
    for part, sentence in _SENTENCES:
        if part in text:
            return sentence
    name = type(error).__name__
    if name in _CUT_OFF:
        return _RECOVER
    if isinstance(error, PermissionError):
        return "there is no permission to read it"
    if isinstance(error, KeyError) and text in _OTHER_SCHEMAS:
        return (
            f"the types of some of its topics are described as {text}, which is not ROS 2's way;"
            " `mcap filter` leaves such topics out"
        )
    return f"it cannot be read: {text}" if name in _PLAIN_SPOKEN else "it is damaged"


STAMP_AT: Final = 4
"""Where the stamp of a message with a header lies, in CDR and in ROS 1 alike."""
STAMPS_END_NS: Final = 2**31 * NS_PER_S
"""A stamp of ROS 2 lies before this time, in 2038."""
_STAMPS: Final = (Struct(">iI"), Struct("<iI"))


def stamp_in(data: bytes | memoryview, at: int = STAMP_AT, *, is_ros1: bool = False) -> int | None:
    """Return the stamp [ns] at a place in the bytes of a message, None where they are too short."""
    try:
        seconds, nanoseconds = _STAMPS[is_ros1 or data[1] & 1].unpack_from(data, at)
    except (StructError, IndexError):
        return None
    return int(seconds) * NS_PER_S + int(nanoseconds)


# Which types are the same in ROS 1 and ROS 2.


_HEADER = "std_msgs/msg/Header"


@cache
def _has_same_fields(ros1: Any, ros2: Any, kind: str, type_name: str) -> bool:
    """Return whether a type has the same fields in two typestores, except for Header.seq.

    Then `ros1_to_cdr` of rosbags, which skips that number, converts its bytes.
    """
    return bool(_fields(ros1, kind) == _fields(ros2, type_name))


@cache
def _begins_with_header(store: Any, type_name: str) -> bool:
    fields = store.fielddefs[type_name][1]
    return bool(fields) and fields[0][1] == (Nodetype.NAME, _HEADER)


def _fields(store: Any, type_name: str) -> list[tuple[str, Any]]:
    """Return the names of a type's fields, and their kinds down to numbers and strings."""
    return [
        (name, _kind(store, node))
        for name, node in store.fielddefs[type_name][1]
        if (type_name, name) != (_HEADER, "seq")
    ]


def _kind(store: Any, node: Any) -> Any:
    """Return a field's kind: its base type, its fields, or what it is a sequence of."""
    form, content = node
    if form == Nodetype.NAME:
        return _fields(store, content)
    if form == Nodetype.BASE:
        return content
    return form, _kind(store, content[0]), content[1]


# Which files are recordings, and their readers.


_COMPRESSED = (".zstd", ".zst")
"""Files of rosbag2's compression by file, which metadata.yaml tells."""
METADATA: Final = "metadata.yaml"
_ZSTD = b"\x28\xb5\x2f\xfd"
RECORDING: Final = "augmented.mcap"
"""The recording that replay and demo write into their folder."""


def check_paths(paths: Sequence[Path]) -> bool:
    """Return whether these are recordings of ROS 1 (else of ROS 2).

    BagError if there is none, one does not exist or is no recording, or if they are mixed.
    """
    if not paths:
        raise BagError("no recording was given")
    kinds = {_is_ros1(path) for path in paths}
    if len(kinds) > 1:
        raise BagError("recordings of ROS 1 and of ROS 2 cannot be read together")
    return kinds.pop()


def recording_in(path: Path) -> Path:
    """Return the recording in a folder: augmented.mcap, or the only recording there.

    Any other path, a rosbag2 folder too, is returned unchanged.
    """
    if not path.is_dir() or (path / METADATA).is_file():
        return path
    inside = [path / RECORDING] if (path / RECORDING).is_file() else _recordings_in(path)
    return inside[0] if len(inside) == 1 else path


def _is_ros1(path: Path) -> bool:
    """Return whether a recording is of ROS 1, by its name; BagError if it is none."""
    if not path.exists():
        raise BagError(f"{path}: there is no such file or folder")
    if path.is_dir():
        _check_folder(path)
        return False
    if path.suffix == ".active":
        message = f"{path}: the recording was not ended; `rosbag reindex` makes a .bag of it"
        raise BagError(message)
    if path.suffix in _COMPRESSED:
        raise BagError(
            f"{path}: a compressed file; give its folder, if that has a metadata.yaml, or"
            " decompress it (zstd -d)"
        )
    if path.suffix not in (".bag", *ROS2_SUFFIXES):
        message = f"{path}: it is no recording; give a rosbag2 folder, an .mcap, .db3 or .bag file"
        raise BagError(message)
    return path.suffix == ".bag"


def _check_folder(path: Path) -> None:
    if (path / METADATA).is_file():
        return
    inside = [file.name for file in _recordings_in(path)]
    message = f"{path}: a folder without metadata.yaml is no rosbag2 recording"
    if inside:
        message += f"; give the files in it themselves: {listed_files(inside)}"
    elif any(file.suffix in _COMPRESSED for file in path.iterdir()):
        message += "; decompress the files in it (zstd -d), and give those themselves"
    raise BagError(message)


def _not_among(folder: Path, named: Collection[Path]) -> list[str]:
    """Return the names of the recordings in a folder that are none of some, and no result."""
    files = {file.resolve(): file.name for file in _recordings_in(folder)}
    suffixes = {path.suffix for path in named}
    return [
        name
        for path, name in files.items()
        if path not in named and path.suffix in suffixes and name != RECORDING
    ]


def _recordings_in(folder: Path) -> list[Path]:
    return sorted(file for file in folder.iterdir() if file.suffix in (".bag", *ROS2_SUFFIXES))


# The message types that a recording defines, parsed when they are first needed.


_IDL_SEPARATOR = "=" * 80 + "\n"
CDR: Final = "cdr"


def encoding_of(connection: Any) -> str:
    """Return how the messages of a connection are encoded; those of ROS 1 count as CDR."""
    return str(getattr(connection.ext, "serialization_format", CDR))


def not_cdr(encoding: str) -> str:
    """Return why messages cannot be used, as the end of a sentence about them."""
    return f"encoded as {encoding}, not as CDR"


def _typestore_of(connection: Any, *, is_ros1: bool) -> Any:
    """Return a typestore that knows the connection's type.

    A type without a definition is taken from ROS 2 Jazzy or ROS 1 Noetic. BagError if it is not
    known there, its definition cannot be understood, or the messages are not CDR.
    """
    encoding = encoding_of(connection)
    if encoding != CDR:
        raise BagError(f"{connection.topic}: its messages are {not_cdr(encoding)}")
    if connection.msgdef.format == MessageDefinitionFormat.NONE or not connection.msgdef.data:
        store = get_typestore(Stores.ROS1_NOETIC) if is_ros1 else jazzy_typestore()
        if connection.msgtype not in store.fielddefs:
            message = (
                f"{connection.topic}: the recording does not define its type,"
                f" {connection.msgtype}, and it is none of ROS's own"
            )
            raise BagError(message)
        return store
    try:
        return _store_with(connection.msgtype, connection.msgdef)
    except Exception as cause:
        message = (
            f"{connection.topic}: the recording's definition of {connection.msgtype}"
            f" cannot be understood: {sentence_of(cause)}"
        )
        raise BagError(message) from cause


@lru_cache(maxsize=256)
def _store_with(type_name: str, definition: Any) -> Any:
    """Return a typestore of a definition: one for all recordings that have the same."""
    store = get_typestore(Stores.EMPTY)
    store.register(_types_of(type_name, definition))
    store.get_msgdef(type_name)
    return store


def _types_of(type_name: str, definition: Any) -> dict[str, Any]:
    if definition.format == MessageDefinitionFormat.MSG:
        return dict(get_types_from_msg(definition.data, type_name))
    if not definition.data.startswith(f"{_IDL_SEPARATOR}IDL: "):
        return dict(get_types_from_idl(definition.data))
    types: dict[str, Any] = {}
    for part in definition.data.split(_IDL_SEPARATOR)[1:]:
        types |= get_types_from_idl(part.split("\n", 1)[1])
    return types


# The files of a recording.


@dataclass(frozen=True, eq=False)
class _Part:
    """A file of a recording, opened: `reader` is rosbags' of this file alone.

    What rosbags reads of a whole folder relies on its metadata.yaml, which may be older than the
    files, name other QoS than they have, or name files in another order than that of their times.
    """

    path: Path
    reader: Any
    start_ns: int
    stop_ns: int
    count: int
    state: "_State"

    @classmethod
    def of(cls, path: Path, reader: Any, states: "Mapping[Path, _State]") -> "list[_Part]":
        """Return the files of an opened recording, with their states before they were opened.

        BagError for one that cannot be read by time.
        """
        storage = getattr(reader, "storage", None)
        if storage is None or not hasattr(storage, "storages"):
            _check_complete(path)
            times = int(reader.start_time), int(reader.end_time)
            _check_topics(path, reader, times)
            return [cls(path, reader, *times, reader.message_count, states.get(path, ()))]
        parts = []
        for file in {Path(file.path).name: file for file in storage.storages}.values():
            name, data = path / Path(file.path).name, file.metadata
            _check_complete(name)
            times = int(data.start_time), int(data.end_time)
            _check_topics(name, file, times)
            parts.append(cls(name, file, *times, data.message_count, states.get(name, ())))
        return parts

    def messages(
        self, topics: Collection[str] | None, start_ns: int | None, stop_ns: int | None
    ) -> Iterator["BagMessage"]:
        """Yield the messages of topics (None: all) in order of log time; BagError if damaged."""
        wanted = [c for c in self.reader.connections if topics is None or c.topic in topics]
        if not wanted:
            return
        read = 0
        with as_bag_errors(str(self.path)), _unwritten({self.path: self.state}):
            for connection, log_time_ns, data in self.reader.messages(wanted, start_ns, stop_ns):
                read += 1
                plain = self._plain(data)
                yield BagMessage(connection.topic, log_time_ns, plain, connection)
        promised = sum(connection.msgcount for connection in wanted)
        if start_ns is None and stop_ns is None and read < promised:
            # rosbags ends in silence at a record of an mcap that it cannot read
            raise BagError(f"{self.path}: damaged: {read} of {promised} messages can be read")

    def in_file_order(self, topics: Collection[str]) -> Iterator["BagMessage"]:
        """Yield the messages of topics as they were written; of ROS 1 in order of log time."""
        file = Path(self.reader.path)
        if file.suffix not in ROS2_SUFFIXES:
            yield from self.messages(topics, None, None)
            return
        wanted = {one.id: one for one in self.reader.connections if one.topic in topics}
        with as_bag_errors(str(self.path)), _unwritten({self.path: self.state}):
            names = {number: one.topic for number, one in wanted.items()}
            for number, log_time_ns, data in messages_in_file_order(file, names):
                plain = self._plain(data)
                yield BagMessage(wanted[number].topic, log_time_ns, plain, wanted[number])

    def _plain(self, data: bytes) -> bytes:
        """Return a message as it was before rosbag2 compressed it.

        The metadata, which may be missing, say so; but no CDR begins as zstd's frames do.
        """
        if not data.startswith(_ZSTD) or self.path.suffix == ".bag":
            return data
        from zstandard import ZstdDecompressor

        return ZstdDecompressor().decompressobj().decompress(data)

    def jump_back(self, topics: Collection[str], start_ns: int, stop_ns: int) -> JumpBack | None:
        """Return where the log times of topics jump back in the file, None where nowhere."""
        with as_bag_errors(str(self.path)), _unwritten({self.path: self.state}):
            return jump_back(Path(self.reader.path), self.reader, topics, start_ns, stop_ns)


_State = tuple[int, ...]


@contextmanager
def _unwritten(states: Mapping[Path, _State]) -> Iterator[None]:
    """Raise BagError where a file was written to meanwhile, rather than what came of it."""
    try:
        yield
    except Exception:
        _check_unwritten(states)
        raise
    _check_unwritten(states)


def _check_unwritten(states: Mapping[Path, _State]) -> None:
    for path, earlier in states.items():
        now = _state_of(path)
        if now != earlier and now[:1] == earlier[:1]:  # else another file is there by now
            raise BagError(
                f"{path}: it was written to while it was read (a recorder, or a copy that is under"
                " way): wait for its end"
            )


def _state_of(path: Path) -> _State:
    """Return which file is at a path, its size and when it was written; empty where there is none.

    As where rosbags reads a copy of a compressed one.
    """
    try:
        state = path.stat()
    except FileNotFoundError:
        return ()
    return state.st_ino, state.st_size, state.st_mtime_ns


_JOURNAL = b"\xd9\xd5\x05\xf9"
"""So begins a journal that is still needed."""


def _check_once(path: Path, parts: Sequence[_Part], earlier: Sequence[_Part]) -> None:
    """Refuse a recording that is given twice, as a folder or as a file that it reads."""
    seen = {part.path.resolve() for part in earlier}
    if any(part.path.resolve() in seen for part in parts):
        raise BagError(f"{path}: this recording is given twice")


def _check_complete(path: Path) -> None:
    """Refuse a database that is read rightly only together with a file beside it."""
    if path.suffix != ".db3":
        return
    database = path.resolve()  # as SQLite writes beside the file itself, not beside a link
    if _first_bytes(rest := database.with_name(f"{database.name}-wal")):
        raise BagError(
            f"{path}: the last messages are in {rest.name} still (the recorder runs, or was"
            f" killed); `sqlite3 {database.name} 'PRAGMA wal_checkpoint(TRUNCATE)'` moves them"
        )
    if _first_bytes(rest := database.with_name(f"{database.name}-journal")) == _JOURNAL:
        raise BagError(
            f"{path}: the last messages were not written to their end, as {rest.name} tells"
            f" (the recorder runs, or was killed); `sqlite3 {database.name} .tables` undoes them"
        )


def _first_bytes(path: Path) -> bytes:
    """Return the first four bytes of a file, fewer where it has not so many, or is not there."""
    if not path.is_file():
        return b""
    with as_bag_errors(str(path)), path.open("rb") as file:
        return file.read(len(_JOURNAL))


class _UriPath(type(Path())):  # type: ignore[misc] # the class of this system's paths
    """A path that rosbags can put into an URI as it is: it opens databases by such."""

    def __format__(self, form: str) -> str:
        """Return the path with %, ? and #, which mean something in an URI, in other words."""
        return format(quote(str(self)), form)

    @property
    def stem(self) -> str:
        """The name of the copy that rosbags makes of a compressed one, without such characters."""
        return quote(super().stem).replace("%", "_")


_TIMES_END_NS: Final = 2**63 - 1
"""Times of a recording lie before this one, in the year 2262."""

_NO_TYPE = "__schemaless__"
"""What rosbags calls the type of an mcap's channel without a schema."""


def _check_topics(path: Path, reader: Any, times: tuple[int, int]) -> None:
    """Refuse what has messages and cannot be read by topic and time.

    That is an mcap whose summary leaves out the topics or all their types, or whose chunks have no
    index, and any recording with times that no integer of 64 bits holds.
    """
    chunks = getattr(reader, "storage", reader).chunks if path.suffix == ".mcap" else ()
    has_index = any(chunk.message_index_offsets for chunk in chunks)
    if chunks and not has_index and times[0] < times[1]:
        raise BagError(f"{path}: its chunks have no index of messages; `mcap recover` writes one")
    if times[0] < times[1] and times[1] > _TIMES_END_NS:
        raise BagError(f"{path}: the log times go on after the year 2262, where times end")
    has_types = any(one.msgtype != _NO_TYPE for one in reader.connections)
    if not has_types and times[0] < times[1]:
        raise BagError(
            f"{path}: its summary lacks the topics or their types; `mcap recover` writes a"
            " complete one"
        )


def _lanes(parts: Sequence[_Part]) -> list[list[int]]:
    """Return the numbers of parts in lanes: those of a lane follow each other in time.

    One after the other, the parts of a lane need not be open, with their chunks, at a time.
    """
    lanes: list[list[int]] = []
    for number in sorted(range(len(parts)), key=lambda k: parts[k].start_ns):
        start_ns = parts[number].start_ns
        lane = next((lane for lane in lanes if parts[lane[-1]].stop_ns <= start_ns), None)
        if lane is None:
            lanes.append(lane := [])
        lane.append(number)
    return lanes


_TRANSFORMS = "tf2_msgs/msg/TFMessage"


@dataclass(frozen=True)
class BagTopic:
    """A topic of a recording: `type_name` as "sensor_msgs/msg/LaserScan", in ROS 1 too.

    `is_latched`: a late subscriber gets the last message (transient local, latched).
    `is_reliable`: some publisher of it was, as all are in ROS 1.
    `encoding`: as `encoding_of`.
    A topic that was recorded with two types, or encodings, appears twice.
    """

    name: str
    type_name: str
    count: int
    is_latched: bool
    is_reliable: bool = True
    encoding: str = CDR

    @property
    def is_usable(self) -> bool:
        """Whether it has messages, and in CDR: no others are understood."""
        return self.count > 0 and self.encoding == CDR


class BagMessage(NamedTuple):
    """One recorded message; `BagReader.deserialize` makes an object of its bytes."""

    topic: str
    log_time_ns: int
    data: bytes
    connection: Any


class BagReader:
    """One or several recordings as one stream; a context manager, open inside `with`.

    Takes rosbag2 folders, .mcap and .db3 files, or ROS 1 .bag files, not mixed. BagError if one of
    them cannot be read: on entering, or later while reading.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = tuple(paths)
        self._stack = ExitStack()
        self._parts: list[_Part] = []
        self.is_ros1 = check_paths(self._paths)
        self._stores: dict[tuple[str, str], Any] = {}
        self._migrations: dict[str, Any] = {}
        self._expected: dict[str, tuple[str, ...]] = {}

    def __enter__(self) -> "BagReader":  # noqa: PYI034 (Self came with Python 3.11)
        """Open the recordings; BagError if one cannot be read or none holds a message."""
        from rosbags.rosbag1 import Reader as Ros1Reader
        from rosbags.rosbag2 import Reader as Ros2Reader

        with ExitStack() as stack:
            for path in self._paths:
                with as_bag_errors(str(path)):
                    files = _recordings_in(path) if path.is_dir() else [path]
                    states = {file: _state_of(file) for file in files}
                    reader: Any = Ros1Reader(path) if self.is_ros1 else Ros2Reader(_UriPath(path))
                    try:
                        with _unwritten(states):
                            reader.open()
                    except Exception:
                        for file in files:  # one that is not complete may be what cannot be opened
                            _check_complete(file)
                        raise
                stack.callback(reader.close)
                parts = _Part.of(path, reader, states)
                _check_once(path, parts, self._parts)
                self._parts += parts
            if not any(part.count for part in self._parts):
                names = ", ".join(path.name for path in self._paths)
                raise BagError(f"{names}: the recording holds no message")
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._parts = []
        self._stack.close()

    @property
    def unnamed(self) -> list[str]:
        """A sentence for each folder with files that its metadata.yaml does not name.

        They are not read. A recorder that was killed leaves such files.
        """
        named = {part.path.resolve() for part in self._parts}
        return [
            f"{folder}: its {METADATA} does not name {listed_files(rest)}, left out here;"
            " `ros2 bag reindex` makes one that does, or give the files themselves"
            for folder in self._paths
            if folder.is_dir() and (rest := _not_among(folder, named))
        ]

    @property
    def start_ns(self) -> int:
        """Log time of the first message."""
        return min(part.start_ns for part in self._parts)

    @property
    def end_ns(self) -> int:
        """Just after the log time of the last message: messages lie in [start_ns, end_ns)."""
        return max(part.stop_ns for part in self._parts)

    @property
    def topics(self) -> tuple[BagTopic, ...]:
        """The topics, in order of name, counted over all recordings."""
        found: dict[tuple[str, str, str], BagTopic] = {}
        for connection in self.connections():
            key = (connection.topic, connection.msgtype, encoding_of(connection))
            count, latched = connection.msgcount, _is_latched(connection)
            reliable = _is_reliable(connection)
            if key in found:
                count, latched = count + found[key].count, latched or found[key].is_latched
                reliable = reliable or found[key].is_reliable
            found[key] = BagTopic(*key[:2], count, latched, reliable, key[2])
        return tuple(found[key] for key in sorted(found))

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        stop_ns: int | None = None,
    ) -> Iterator[BagMessage]:
        """Yield the messages of `topics` (None: all) with log times in [start_ns, stop_ns).

        In order of log time, whatever the files; at the same time, in order of the files. BagError
        if one is damaged.
        """
        lanes = [self._lane(lane, topics, start_ns, stop_ns) for lane in _lanes(self._parts)]
        for _, _, message in heapq.merge(*lanes) if len(lanes) > 1 else chain(*lanes):
            yield message

    def _lane(
        self,
        lane: Sequence[int],
        topics: Collection[str] | None,
        start_ns: int | None,
        stop_ns: int | None,
    ) -> Iterator[tuple[int, int, BagMessage]]:
        """Yield the messages of parts that follow each other, with their times and part numbers."""
        for number in lane:
            for message in self._parts[number].messages(topics, start_ns, stop_ns):
                yield message.log_time_ns, number, message

    def in_file_order(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """Yield the messages of topics as they were written, file by file."""
        for part in self._parts:
            yield from part.in_file_order(topics)

    def jump_back(self, topics: Collection[str], start_ns: int, stop_ns: int) -> JumpBack | None:
        """Return the furthest jump back of log times in a file, within [start_ns, stop_ns)."""
        found = (part.jump_back(topics, start_ns, stop_ns) for part in self._parts)
        jumps = [jump for jump in found if jump is not None]
        return max(jumps, key=lambda jump: jump.until_ns - jump.from_ns, default=None)

    def expect(self, types: Mapping[str, tuple[str, ...]]) -> None:
        """Refuse messages of topics, from now on, whose type is none of theirs."""
        self._expected = dict(types)

    def is_expected(self, message: BagMessage) -> bool:
        """Return whether a message is of a type that is expected on its topic."""
        connection = message.connection
        return connection.msgtype in self._expected.get(connection.topic, (connection.msgtype,))

    def first(self, topic: str) -> BagMessage | None:
        """Return the first message of a topic that is of an expected type, None without any."""
        return next(filter(self.is_expected, self.messages((topic,))), None)

    def deserialize(self, message: BagMessage) -> Any:
        """Return the message object, its arrays numpy arrays.

        BagError if the recording does not say what the type is, InputError for malformed bytes, and
        for a message of another type than expected.
        """
        self._check(message)
        connection = message.connection
        store = self._store_of(connection)
        try:
            if self.is_ros1:
                return store.deserialize_ros1(message.data, connection.msgtype)
            return store.deserialize_cdr(message.data, connection.msgtype)
        except Exception as cause:
            raise _malformed(message, cause) from cause

    def first_object(self, topic: str) -> Any:
        """Return the first such message as an object, None if it cannot be understood."""
        message = self.first(topic)
        try:
            return None if message is None else self.deserialize(message)
        except AreError:
            return None

    def _check(self, message: BagMessage) -> None:
        """Raise InputError for another type than expected, or a stamp that ROS 2 cannot hold."""
        topic, kind = message.connection.topic, message.connection.msgtype
        if not self.is_expected(message):
            wanted = " or ".join(self._expected[topic])
            raise InputError(f"{topic}: a message is of type {kind}, not {wanted}")
        stamp_ns = stamp_in(message.data, is_ros1=True) if self.is_ros1 else None
        # the seconds are unsigned in ROS 1; rosbags reads large ones as negative
        is_large = stamp_ns is not None and stamp_ns < 0
        if is_large and _begins_with_header(self._store_of(message.connection), kind):
            raise _large_stamp(message)

    def transforms(self, message: BagMessage) -> list[StampedTransform]:
        """Return the transforms of a TFMessage; as `deserialize` and `read_transforms`, quicker."""
        self._check(message)
        try:
            if not self.is_ros1 and is_plain_cdr(message.data):
                return decode_transforms_cdr(message.data)
        except (StructError, UnicodeDecodeError) as cause:
            raise _malformed(message, cause) from cause
        if self.is_ros1 and message.connection.digest == ROS1_DIGEST:
            with suppress(StructError, UnicodeDecodeError):  # let the general way complain
                found = decode_transforms_ros1(message.data)
                if any(transform.stamp_ns >= STAMPS_END_NS for transform in found):
                    raise _large_stamp(message)
                return found
        return read_transforms(self.deserialize(message))

    def odometry(self, message: BagMessage) -> OdometryNumbers:
        """Return the numbers of an Odometry; errors as `deserialize`."""
        return read_odometry_numbers(self.deserialize(message))

    def as_ros2(self, message: BagMessage) -> bytes:
        """Return a message of ROS 1 as the bytes of the type that it has become in ROS 2.

        Fields that ROS 2 lacks (Header.seq) are dropped, new ones are zero or empty. Errors as
        `deserialize`. Transforms and types with the same fields are converted without objects.
        """
        kind = message.connection.msgtype
        type_name = ros2_type(kind)
        if type_name == _TRANSFORMS:
            return encode_transforms_cdr(self.transforms(message))
        self._check(message)
        ros1, ros2 = self._store_of(message.connection), jazzy_typestore()
        try:
            if _has_same_fields(ros1, ros2, kind, type_name):
                return bytes(ros2.ros1_to_cdr(message.data, type_name))
            return self._migrated(message, type_name)
        except Exception as cause:
            raise _malformed(message, cause) from cause

    def _migrated(self, message: BagMessage, type_name: str) -> bytes:
        """Return a message of ROS 1, whose fields differ from those of ROS 2."""
        from rosbags.convert.converter import migrate_message

        kind, data = message.connection.msgtype, message.data
        ros1, ros2 = self._store_of(message.connection), jazzy_typestore()
        original = ros1.deserialize_ros1(data, kind)
        migrated = migrate_message(ros1, ros2, kind, type_name, self._migrations, original)
        return bytes(ros2.serialize_cdr(migrated, type_name))

    def connections(self) -> Iterator[Any]:
        """Yield rosbags' connections of all files: a topic and a type each."""
        for part in self._parts:
            yield from part.reader.connections

    def _store_of(self, connection: Any) -> Any:
        """Return the typestore of a connection, made at its first message."""
        key = (connection.msgtype, connection.msgdef.data)
        if key not in self._stores:
            self._stores[key] = _typestore_of(connection, is_ros1=self.is_ros1)
        return self._stores[key]


def _is_latched(connection: Any) -> bool:
    profiles = getattr(connection.ext, "offered_qos_profiles", None)
    if profiles is None:
        return bool(connection.ext.latching)
    return any(profile.durability.name == "TRANSIENT_LOCAL" for profile in profiles)


def _is_reliable(connection: Any) -> bool:
    profiles = getattr(connection.ext, "offered_qos_profiles", None)
    return not profiles or any(profile.reliability.name == "RELIABLE" for profile in profiles)


def _large_stamp(message: BagMessage) -> InputError:
    text = f"{message.topic}: the message at {message.log_time_ns} ns has a stamp after 2038"
    return InputError(f"{text}, which ROS 2 cannot hold")


def _malformed(message: BagMessage, cause: Exception) -> InputError:
    kind = message.connection.msgtype
    text = f"{message.topic}: the message at {message.log_time_ns} ns is no {kind}"
    return InputError(f"{text}, {sentence_of(cause)}")
