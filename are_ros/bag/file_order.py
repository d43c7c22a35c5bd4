"""Messages in the order in which they lie in a file, which is that in which they were written.

Only this order tells that the clock of a recording was set back, or that a simulation was started
anew while it was recorded by its own clock: in order of log time such messages lie in each other.
"""

import sqlite3
import struct
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import closing
from itertools import chain
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S

ROS2_SUFFIXES: Final = (".mcap", ".db3")
"""Of files whose messages can be had in their order."""

_LEAST_JUMP_NS: Final = NS_PER_S
"""Writers may put messages in another order by less."""

_INDEX_AT: Final = 1 + 8 + 2
"""Where the size of an MCAP index stands in it: after its kind, its length and the topic."""

_Times = npt.NDArray[np.int64]
Raw = tuple[int, int, bytes]
"""Of a message: the number of its topic in the file, its log time [ns], its bytes."""


class JumpBack(NamedTuple):
    """The log times of a topic jump back from `until_ns` to `from_ns`.

    The jumps of a file part it. `lone` are the times (first, last) in which only one part lies, in
    order: each can be replayed by itself.
    """

    topic: str
    from_ns: int
    until_ns: int
    lone: tuple[tuple[int, int], ...] = ()


def messages_in_file_order(file: Path, topics: Mapping[int, str]) -> Iterator[Raw]:
    """Yield the messages of topics by number; raises what mcap and sqlite3 do of a damaged file."""
    if file.suffix == ".db3":
        yield from _rows(file, "topic_id, timestamp, data", topics)
        return
    from mcap.reader import NonSeekingReader

    with file.open("rb") as stream:
        # the reader that seeks would first read the whole file, which may be larger than the memory
        reader, names = NonSeekingReader(stream), set(topics.values())
        for _, channel, message in reader.iter_messages(names, log_time_order=False):
            if channel.id in topics:
                yield channel.id, message.log_time, message.data


def jump_back(
    file: Path, reader: Any, topics: Collection[str], start_ns: int, stop_ns: int
) -> JumpBack | None:
    """Return the furthest jump back within [start_ns, stop_ns), None where by less than a second.

    A window that lies in one of the parts has none.

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
    if not jumps:
        return None
    worst = max(jumps, key=lambda jump: jump.until_ns - jump.from_ns)
    return worst._replace(lone=_lone(times.values()))


def _parts(times_ns: _Times) -> _Times:
    """Return the number of each message's part (N,): a jump back begins another one."""
    return np.cumsum(np.diff(times_ns, prepend=times_ns[:1]) < -_LEAST_JUMP_NS)


def _furthest(topic: str, times_ns: _Times, start_ns: int, stop_ns: int) -> JumpBack | None:
    """Return the furthest jump between parts of which both have messages in the window.

    Parts that follow each other in the window are in order, however far they go outside it.
    """
    inside = (start_ns <= times_ns) & (times_ns < stop_ns)
    parts = _parts(times_ns)
    numbers = parts[inside]
    if not len(numbers) or numbers[0] == numbers[-1]:
        return None
    begins = np.flatnonzero(np.diff(numbers, prepend=-1))
    firsts = np.minimum.reduceat(times_ns[inside], begins)
    lasts = np.maximum.accumulate(np.maximum.reduceat(times_ns[inside], begins))
    back_ns = lasts[:-1] - firsts[1:]
    if back_ns.max() <= 0:
        return None
    later = parts == numbers[begins[int(back_ns.argmax()) + 1]]
    until_ns = times_ns[: int(later.argmax())].max()
    return JumpBack(topic, int(times_ns[later].min()), int(until_ns))


def _lone(all_times_ns: Iterable[_Times]) -> tuple[tuple[int, int], ...]:
    """Return the times, longer than a second, in which no topic has messages of two parts."""
    parted = [(one, parts) for one in all_times_ns if (parts := _parts(one)).any()]
    times_ns, numbers = (np.concatenate(columns) for columns in zip(*parted, strict=True))
    order = np.argsort(times_ns, kind="stable")
    times_ns, numbers = times_ns[order], numbers[order]
    begins = np.flatnonzero(np.diff(numbers, prepend=-1))
    firsts, lasts = times_ns[begins], times_ns[np.append(begins[1:], len(numbers)) - 1]
    spans = zip(firsts.tolist(), lasts.tolist(), strict=True)
    return tuple(span for span in spans if span[1] - span[0] > _LEAST_JUMP_NS)


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
