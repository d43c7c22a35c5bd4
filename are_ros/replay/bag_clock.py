"""The time that a replay goes by: that of the recording, or of the stamps where they disagree.

A recording made under simulated time, from another recording, or on another machine than the
robot's has stamps that lie seconds, hours or years from the times at which its messages were
written. Poses would be too old or still to come; so the clock of the stamps is recovered: from
/clock where it was recorded, else from the stamps of odometry, transforms and scans.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError
from are_ros.replay.bag_times import Ints, RecordedTimes, Times
from are_ros.wording import duration_text, listed

_AHEAD_NS = NS_PER_S // 5
_BEHIND_NS = NS_PER_S // 2
"""Stamps go by another clock where they lie later than the recording by more than the first, or
earlier by more than the second: a message may be under way for some tenths of a second, but none
comes before it was stamped."""
_STEADY_NS = 3 * NS_PER_S // 10
"""An offset that varies by less than this is a constant, and the rest is delay."""
_TOPIC_APART_NS = 3 * NS_PER_S // 4
_EDGE_APART_NS = 3 * NS_PER_S // 2
"""Sources whose stamps are further apart have no common clock. A transform may be dated a second
ahead on purpose (transform_tolerance)."""
_LOOP_NS = NS_PER_S


@dataclass(frozen=True, eq=False)
class BagClock:
    """Turns log times [ns] into the times that the replay goes by; never decreasing.

    Between the instants known (int64 (N,) each, N of 0 for the identity) the clock goes evenly,
    outside them as fast as the log. `sentence` says what was done, empty for the identity;
    `disagreement` which sources of stamps have no clock in common with the others.
    """

    log_ns: Ints
    clock_ns: Ints
    sentence: str = ""
    disagreement: str = ""

    @classmethod
    def of(cls, times: RecordedTimes) -> "BagClock":
        """Return the clock of a recording's window.

        It is the clock of most sources of stamps, unless that is the log's. Raises BagError where
        the stamps jump back, as they do in a recording that looped.
        """
        source = _reference(times.sources)
        if source is None:
            return cls(np.empty(0, np.int64), np.empty(0, np.int64))
        log_ns, clock_ns, sentence = _instants(source, times.bag_start_ns)
        clock = cls(log_ns, clock_ns, sentence)
        return cls(log_ns, clock_ns, sentence, _disagreement(clock, source, times.sources))

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

    def at_many(self, log_times_ns: Ints) -> Ints:
        """Return the times that belong to log times, int64 (N,): `at`, to a microsecond or so."""
        if not len(self.log_ns):
            return log_times_ns
        index = np.searchsorted(self.log_ns, log_times_ns, side="right")
        before = np.maximum(index - 1, 0)
        after = np.minimum(before + 1, len(self.log_ns) - 1)
        log_steps = (self.log_ns[after] - self.log_ns[before]).astype(np.float64)
        clock_steps = (self.clock_ns[after] - self.clock_ns[before]).astype(np.float64)
        is_inside = (index > 0) & (index < len(self.log_ns))
        paces = np.where(is_inside, clock_steps / np.maximum(log_steps, 1.0), 1.0)
        since_ns = (log_times_ns - self.log_ns[before]) * paces
        return np.maximum(0, self.clock_ns[before] + since_ns.astype(np.int64))


def _reference(sources: Sequence[Times]) -> Times | None:
    """Return the source whose clock most others share, the first of several; /clock if there."""
    if not sources:
        return None
    offsets = np.array([_offset_ns(one) for one in sources])
    if sources[0].is_clock:
        return sources[0]
    company = np.abs(offsets[:, np.newaxis] - offsets) <= _TOPIC_APART_NS
    return sources[int(company.sum(axis=1).argmax())]


def _offset_ns(source: Times) -> float:
    return float(np.median(source.stamps_ns - source.log_ns))


def _instants(source: Times, bag_start_ns: int) -> tuple[Ints, Ints, str]:
    """Return log times, the clock's times at them, and what is to be said; none for the log's."""
    offsets_ns = source.stamps_ns - source.log_ns
    low_ns, middle_ns, high_ns = np.percentile(offsets_ns, (10, 50, 90)).tolist()
    if low_ns >= -_BEHIND_NS and high_ns <= _AHEAD_NS:
        return np.empty(0, np.int64), np.empty(0, np.int64), ""
    order = "ahead of" if middle_ns > 0 else "behind"
    sentence = (
        f"the stamps lie {duration_text(abs(round(middle_ns)))} {order} the times of recording "
        f"(another machine's clock, simulated time, or a recording of a recording): the replay "
        f"goes by the stamps of {source.name}"
    )
    if high_ns - low_ns <= _STEADY_NS:
        first_ns = source.log_ns[:1]
        return first_ns, first_ns + int(np.median(offsets_ns)), sentence
    instants = np.stack([source.log_ns, source.stamps_ns], axis=1)
    _check_no_loop(source.name, instants, bag_start_ns)
    return source.log_ns, np.maximum.accumulate(source.stamps_ns), sentence


def _check_no_loop(topic: str, instants: Ints, bag_start_ns: int) -> None:
    back_ns = -np.diff(instants[:, 1])
    if len(back_ns) and back_ns.max() > _LOOP_NS:
        worst = int(back_ns.argmax())
        at_s = (int(instants[worst + 1, 0]) - bag_start_ns) / NS_PER_S
        raise BagError(
            f"{topic}: the stamps jump back by {back_ns[worst] / NS_PER_S:.1f} s, {at_s:.1f} s "
            "into the recording (it looped): replay one pass of it with --start and --duration"
        )


def _disagreement(clock: BagClock, reference: Times, sources: Sequence[Times]) -> str:
    """Say which sources go by another clock than the reference; empty where none does."""

    def offset_ns(source: Times) -> float:
        return float(np.median(source.stamps_ns - clock.at_many(source.log_ns)))

    apart = {one.name: offset_ns(one) - offset_ns(reference) for one in sources}
    limits = {one.name: _EDGE_APART_NS if one.is_edge else _TOPIC_APART_NS for one in sources}
    parts = []
    for word, sign in (("later", 1), ("earlier", -1)):
        names = [name for name, by_ns in apart.items() if sign * by_ns > limits[name]]
        if names:
            most = duration_text(max(round(abs(apart[name])) for name in names))
            are = "are" if len(names) > 1 else "is"
            parts.append(f"{listed(names)} {are} stamped up to {most} {word} than {reference.name}")
    if not parts:
        return ""
    return (
        f"{listed(parts)} when they are recorded: there is no common clock. The replay goes by "
        f"{reference.name}; wherever it needs both, in scans above all, it errs by that time. "
        "Set the machines' clocks (NTP, chrony) and record anew, or leave those scans out "
        "(sensors.scans)"
    )
