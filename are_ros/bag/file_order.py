"""Messages in the order in which they lie in a file, which is that in which they were written.

Only this order tells that the clock of a recording was set back, or that a simulation was started
anew while it was recorded by its own clock: in order of log time such messages lie in each other.
"""

import sqlite3
import struct
from collections.abc import Collection, Iterator, Mapping
from contextlib import closing
from itertools import chain
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S

_LEAST_JUMP_NS: Final = NS_PER_S
"""Writers may put messages in another order by less."""

_INDEX_AT: Final = 1 + 8 + 2
"""Where the size of an MCAP index stands in it: after its kind, its length and the topic."""

_Times = npt.NDArray[np.int64]
Raw = tuple[int, int, bytes]
"""Of a message: the number of its topic in the file, its log time [ns], its bytes."""


class JumpBack(NamedTuple):
    """The log times of a topic that occur twice: from `from_ns` to `until_ns`."""

    topic: str
    from_ns: int
    until_ns: int


def has_file_order(file: Path) -> bool:
    """Return whether messages of such a file can be had in its order."""
    return file.suffix in (".mcap", ".db3")


def messages_in_file_order(file: Path, topics: Mapping[int, str]) -> Iterator[Raw]:
    """Yield the messages of topics by number; raises what mcap and sqlite3 do of a damaged file."""
    if file.suffix == ".db3":
        yield from _rows(file, "topic_id, timestamp, data", topics)
        return
    from mcap.reader import make_reader

    with file.open("rb") as stream:
        names = set(topics.values())
        for _, channel, message in make_reader(stream).iter_messages(names, log_time_order=False):
            if channel.id in topics:
                yield channel.id, message.log_time, message.data


def jump_back(
    file: Path, reader: Any, topics: Collection[str], start_ns: int, stop_ns: int
) -> JumpBack | None:
    """Return the furthest jump back within [start_ns, stop_ns), None where by less than a second.

    `reader` is rosbags' of the file. Errors as `messages_in_file_order`.
    """
    names = {one.id: one.topic for one in reader.connections if one.topic in topics}
    if file.suffix == ".db3":
        times = _times_of_database(file, names)
    elif file.suffix == ".mcap":
        times = _times_of_mcap(file, names)
    else:
        times = _times_of_ros1(reader, names)
    window = start_ns, stop_ns
    found = (_furthest(names[number], at_ns, *window) for number, at_ns in times.items())
    jumps = [jump for jump in found if jump is not None]
    return max(jumps, key=lambda jump: jump.until_ns - jump.from_ns, default=None)


def _furthest(topic: str, times_ns: _Times, start_ns: int, stop_ns: int) -> JumpBack | None:
    latest_ns = np.maximum.accumulate(times_ns)
    back_ns = (latest_ns - times_ns) * ((times_ns < stop_ns) & (start_ns <= latest_ns))
    if not len(back_ns) or back_ns.max() <= _LEAST_JUMP_NS:
        return None
    worst = int(back_ns.argmax())
    return JumpBack(topic, int(times_ns[worst]), int(latest_ns[worst]))


def _times_of_database(file: Path, numbers: Collection[int]) -> dict[int, _Times]:
    values = chain.from_iterable(_rows(file, "topic_id, timestamp", numbers))
    rows = np.fromiter(values, np.int64).reshape(-1, 2)
    return {number: rows[rows[:, 0] == number, 1] for number in numbers}


def _rows(file: Path, columns: str, numbers: Collection[int]) -> Iterator[Any]:
    listed = ",".join(map(str, numbers))
    query = f"SELECT {columns} FROM messages WHERE topic_id IN ({listed}) ORDER BY id"  # noqa: S608 - of numbers
    with closing(sqlite3.connect(f"{file.absolute().as_uri()}?immutable=1", uri=True)) as database:
        yield from database.execute(query)


def _times_of_mcap(file: Path, numbers: Collection[int]) -> dict[int, _Times]:
    """Return the log times by the file's indexes, of the chunks one after the other."""
    from mcap.reader import make_reader

    found: dict[int, list[_Times]] = {number: [np.empty(0, np.int64)] for number in numbers}
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
        chunks = summary.chunk_indexes if summary else []
        for chunk in sorted(chunks, key=lambda one: one.chunk_start_offset):
            for number, at in chunk.message_index_offsets.items():
                if number in found:
                    stream.seek(at + _INDEX_AT)
                    (size,) = struct.unpack("<I", stream.read(4))
                    index = np.frombuffer(stream.read(size), "<i8").reshape(-1, 2)
                    found[number].append(index[np.argsort(index[:, 1]), 0])
    return {number: np.concatenate(times) for number, times in found.items()}


def _times_of_ros1(reader: Any, numbers: Collection[int]) -> dict[int, _Times]:
    found = {}
    for number in numbers:
        index = np.array([tuple(one) for one in reader.indexes[number]], np.int64).reshape(-1, 3)
        found[number] = index[np.lexsort((index[:, 2], index[:, 1])), 0]
    return found
