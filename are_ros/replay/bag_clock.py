"""The time that a replay goes by: that of the recording, or of the stamps where they disagree.

A recording made under simulated time, or from another recording, has stamps that lie hours or
years from the times at which its messages were written. Nothing in it would ever be fresh; so
the clock of the stamps is recovered, from /clock where it was recorded, else from the stamps of
the transforms or the odometry.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError, InputError
from are_ros.messages.times import read_time
from are_ros.replay.bag_reader import BagMessage, BagReader
from are_ros.replay.roles import RolesFound

_CLOCK = "/clock"
_DISAGREEMENT_NS = 10 * NS_PER_S
_LOOKED_AT = 50
_LOOP_NS = NS_PER_S
_STAMPED_ROLES = ("odom", "tf", "scan")

_Stamps = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class BagClock:
    """Turns log times [ns] into the times that the replay goes by; never decreasing.

    Between the instants known (int64 (N,) each, N of 0 for the identity) the clock goes evenly,
    outside them as fast as the log. `sentence` says what was done, empty for the identity.
    """

    log_ns: _Stamps
    clock_ns: _Stamps
    sentence: str = ""

    @classmethod
    def of(cls, reader: BagReader, roles: RolesFound, start_ns: int, stop_ns: int) -> "BagClock":
        """Return the clock of an open recording between two log times.

        Raises BagError where the stamps jump back, as they do in a recording that looped.
        """
        source = _reference_topic(reader, roles)
        if source is None or _disagreement_ns(reader, source) < _DISAGREEMENT_NS:
            return cls(np.empty(0, np.int64), np.empty(0, np.int64))
        window = _instants(reader, source, start_ns, stop_ns)
        instants = np.array(list(window), dtype=np.int64).reshape(-1, 2)
        _check_no_loop(source, instants, reader.start_ns)
        clock_ns = np.maximum.accumulate(instants[:, 1])
        apart_s = float(np.median(clock_ns - instants[:, 0])) / NS_PER_S
        return cls(
            instants[:, 0].copy(),
            clock_ns,
            f"the stamps lie {apart_s:.1f} s from the times of recording (simulated time, or a "
            f"recording of a recording): the replay goes by the clock of {source}",
        )

    def at(self, log_time_ns: int) -> int:
        """Return the time that belongs to a log time."""
        if not len(self.log_ns):
            return log_time_ns
        index = int(np.searchsorted(self.log_ns, log_time_ns, side="right"))
        if index == 0:
            return max(0, int(self.clock_ns[0] - self.log_ns[0]) + log_time_ns)
        since_ns = log_time_ns - int(self.log_ns[index - 1])
        if index == len(self.log_ns):
            return int(self.clock_ns[-1]) + since_ns
        log_step_ns = int(self.log_ns[index] - self.log_ns[index - 1])
        clock_step_ns = int(self.clock_ns[index] - self.clock_ns[index - 1])
        return int(self.clock_ns[index - 1]) + since_ns * clock_step_ns // log_step_ns


def _reference_topic(reader: BagReader, roles: RolesFound) -> str | None:
    if any(topic.name == _CLOCK and topic.count for topic in reader.topics):
        return _CLOCK
    named = (roles.topic(role) for role in _STAMPED_ROLES)
    return next((topic for topic in named if topic is not None), None)


def _disagreement_ns(reader: BagReader, topic: str) -> float:
    """Return how far the first stamps typically lie from their log times."""
    apart = [abs(clock - log) for log, clock in islice(_instants(reader, topic), _LOOKED_AT)]
    return float(np.median(apart)) if apart else 0.0


def _check_no_loop(topic: str, instants: _Stamps, bag_start_ns: int) -> None:
    back_ns = -np.diff(instants[:, 1])
    if len(back_ns) and back_ns.max() > _LOOP_NS:
        worst = int(back_ns.argmax())
        at_s = (int(instants[worst + 1, 0]) - bag_start_ns) / NS_PER_S
        raise BagError(
            f"{topic}: the stamps jump back by {back_ns[worst] / NS_PER_S:.1f} s, {at_s:.1f} s "
            "into the recording (it looped): replay one pass of it with --start and --duration"
        )


def _instants(
    reader: BagReader, topic: str, start_ns: int | None = None, stop_ns: int | None = None
) -> Iterator[tuple[int, int]]:
    """Yield (log time, stamp) of the messages of a topic that have one."""
    for message in reader.messages((topic,), start_ns, stop_ns):
        try:
            stamp_ns = _stamp_ns(reader, message)
        except InputError:
            continue
        if stamp_ns:
            yield message.log_time_ns, stamp_ns


def _stamp_ns(reader: BagReader, message: BagMessage) -> int:
    """Return the stamp of a message: of /clock its time, of transforms the newest."""
    if message.connection.msgtype.lower().endswith("tfmessage"):
        return max((transform.stamp_ns for transform in reader.transforms(message)), default=0)
    content: Any = reader.deserialize(message)
    return read_time(content.clock if message.topic == _CLOCK else content.header.stamp)
