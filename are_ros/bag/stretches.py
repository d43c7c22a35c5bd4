"""The window of a replay, the gaps of a recording, and how late its transforms are.

A gap is a minute or more without a moving message (`MOVING_ROLES`): between two recordings of one
day, after a map that was recorded years before, before a stray message an hour later. A replay
skips it, and begins anew after it.
"""

from collections import defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from are_ros.bag.clock import MOVING_ROLES, BagClock, Edge, Ints, RecordedTimes, begin_of
from are_ros.bag.reader import BagReader
from are_ros.builder.sensors.sensor_path import REACH
from are_ros.conventions import IDLE_NS, NS_PER_S, seconds_to_ns
from are_ros.errors import BagError
from are_ros.parameters.model import PosesParameters, SensorsParameters
from are_ros.wording import counted, duration_text, several

GAP_NS: Final = IDLE_NS
"""The time after which the simulation stands still without an input."""
_STRAY_NS: Final = NS_PER_S
"""A shorter stretch of movement with gaps on both sides is left out."""
_SILENCE_NS: Final = 10 * NS_PER_S
"""A shorter time without a moving message is not worth a sentence."""
_SHOWN_GAPS: Final = 3
_WAIT_STEP_NS: Final = NS_PER_S // 100

Span = tuple[int, int]


@dataclass(frozen=True)
class Gap:
    """A gap [start_ns, stop_ns) of the log; it lasts `length_ns` by the clock."""

    start_ns: int
    stop_ns: int
    length_ns: int


@dataclass(frozen=True)
class Stretches:
    """The spans [start, stop) of the log [ns] that are replayed, in order, and the gaps.

    `ahead` and `behind` are the gaps before the first and after the last span, if any. There is no
    span where the whole window lies in one gap. `silences` are replayed: times within the spans
    that are too short for a gap.
    """

    spans: tuple[Span, ...]
    gaps: tuple[Gap, ...]
    ahead: Gap | None = None
    behind: Gap | None = None
    silences: tuple[Gap, ...] = ()

    def all_gaps(self) -> tuple[Gap, ...]:
        """Return the gaps, those before and after all spans among them."""
        return tuple(gap for gap in (self.ahead, *self.gaps, self.behind) if gap is not None)

    def sentences(self, begin_ns: int) -> list[str]:
        """Return notices about skipped times; seconds count from `begin_ns` of the log."""
        said = []
        if self.ahead is not None:
            said.append(stillness_ahead(self.ahead.length_ns, "the replay"))
        if self.gaps:
            it = "it" if len(self.gaps) == 1 else "them"
            said.append(
                f"the recording has {_listed(self.gaps, 'gap', begin_ns)}: the replay leaves "
                f"{it} out, and all artefacts go before {it}"
            )
        if self.silences:
            said.append(
                f"the recording has {_listed(self.silences, 'pause', begin_ns)}: less than a "
                "minute is replayed, and the artefacts move on in it"
            )
        if self.behind is not None:
            length = duration_text(self.behind.length_ns)
            said.append(f"nothing moves in the last {length}: the replay ends before them")
        return said


def _listed(gaps: Sequence[Gap], noun: str, begin_ns: int) -> str:
    texts = [
        f"{duration_text(gap.length_ns)} long, {duration_text(gap.start_ns - begin_ns)} into it"
        for gap in gaps
    ]
    more = [f"{len(gaps) - _SHOWN_GAPS} more"] if len(gaps) > _SHOWN_GAPS else []
    has = f"a {noun}" if len(gaps) == 1 else counted(len(gaps), noun)
    return f"{has} in which nothing moves ({'; '.join([*texts[:_SHOWN_GAPS], *more])})"


@dataclass(frozen=True)
class Window:
    """The part [start_ns, stop_ns) of a recording's log that --start and --duration choose.

    Their seconds count from `begin_ns`. What lies a minute or more before everything that moves (a
    latched map with the time of its making, or with none) does not count; it lasts `still_ns`.
    """

    begin_ns: int
    start_ns: int
    stop_ns: int
    still_ns: int = 0

    @classmethod
    def of(
        cls,
        reader: BagReader,
        role_of_topic: Mapping[str, str],
        start_s: float,
        duration_s: float | None,
    ) -> "Window":
        """Return the window; BagError, naming the option, where nothing lies in it."""
        moving = [topic for topic, role in role_of_topic.items() if role in MOVING_ROLES]
        begin_ns, stop_ns = begin_of(reader, moving), reader.end_ns
        still_ns = begin_ns - reader.start_ns
        start_ns = begin_ns + seconds_to_ns(start_s)
        if duration_s is not None:
            stop_ns = min(stop_ns, start_ns + seconds_to_ns(duration_s))
        if start_ns >= stop_ns:
            if start_ns < reader.end_ns:
                raise BagError(f"--duration {duration_s:g}: it must be above 0")
            length_s = (reader.end_ns - begin_ns) / NS_PER_S
            raise BagError(
                f"--start {start_s:g}: the recording is {length_s:.1f} s long, nothing is left"
            )
        return cls(begin_ns, start_ns, stop_ns, still_ns)

    def sentences(self, what: str) -> list[str]:
        """Return the sentence about stillness at the beginning, if any; `what` skips it."""
        return [stillness_ahead(self.still_ns, what)] if self.still_ns else []


def stillness_ahead(length_ns: int, what: str) -> str:
    """Return the sentence about stillness at the beginning, which `what` skips."""
    return f"nothing moves in the first {duration_text(length_ns)}: {what} begins after them"


def stretches_of(times: RecordedTimes, clock: BagClock, start_ns: int, stop_ns: int) -> Stretches:
    """Return the stretches of the window [start_ns, stop_ns) of the log that are to be replayed.

    Gaps are measured by the clock, the first one from the last moving message before the window,
    the last one up to the next one behind it. A stray message between two gaps belongs to them.
    """
    log_ns = times.moving_log_ns
    next_ns = stop_ns if times.next_moving_ns is None else times.next_moving_ns
    since_ns = start_ns if times.still_since_ns is None else times.still_since_ns

    def gap(from_ns: int, to_ns: int) -> Gap:
        return Gap(from_ns, to_ns, clock.at(to_ns) - clock.at(from_ns))

    if not len(log_ns):
        moves_elsewhere = times.next_moving_ns is not None or times.still_since_ns is not None
        if moves_elsewhere and clock.at(next_ns) - clock.at(since_ns) >= GAP_NS:
            return Stretches((), (gap(start_ns, stop_ns),))
        return Stretches(((start_ns, stop_ns),), ())
    edges_ns = np.concatenate(([since_ns], log_ns, [next_ns]))
    lengths_ns = np.diff(clock.at_many(edges_ns))
    is_gap = lengths_ns >= GAP_NS
    first = np.flatnonzero(is_gap[:-1] | (np.arange(len(log_ns)) == 0))
    last = np.append(first[1:], len(log_ns)) - 1
    starts, stops = log_ns[first], log_ns[last] + 1
    if not is_gap[0]:
        starts[0] = start_ns
    if not is_gap[-1]:
        stops[-1] = stop_ns
    is_drive = stops - starts >= _STRAY_NS
    if is_drive.any():
        starts, stops = starts[is_drive], stops[is_drive]

    spans = list(zip(starts.tolist(), stops.tolist(), strict=True))
    begin_ns, end_ns = spans[0][0], spans[-1][1]
    silent = np.flatnonzero((lengths_ns >= _SILENCE_NS) & ~is_gap)
    silences = (gap(*edges_ns[k : k + 2].tolist()) for k in silent.tolist())
    return Stretches(
        spans=tuple(spans),
        gaps=tuple(gap(one[1], other[0]) for one, other in pairwise(spans)),
        ahead=gap(start_ns, begin_ns) if begin_ns > start_ns else None,
        behind=gap(end_ns, stop_ns) if end_ns < stop_ns else None,
        silences=tuple(
            one for one in silences if begin_ns <= one.start_ns and one.stop_ns < end_ns
        ),
    )


def scan_waits(
    times: RecordedTimes, clock: BagClock, map_frame: str, given_edges: Iterable[Edge] = ()
) -> dict[str, Ints]:
    """Return how long the scans of each topic wait for their transforms: int64 (N,) [ns] each.

    The wait lasts from the reception of a scan until its pose in the map's frame at its stamp is
    known, by the clock. N counts the scans whose pose becomes known. `given_edges` are the
    (parent, child) of further static transforms.
    """
    static = times.static_edges | set(given_edges)
    waits: dict[str, Ints] = {}
    for topic, scans in times.scans.items():
        chain = _chain({*times.edges, *static}, map_frame, times.scan_frames[topic])
        known_ns = received_ns = clock.at_many(scans.log_ns)
        is_known = np.full(len(scans.log_ns), chain is not None)
        for edge in set(chain or ()) - static:
            samples = times.edges[edge]
            newest_ns = np.maximum.accumulate(samples.stamps_ns)
            at = np.searchsorted(newest_ns, scans.stamps_ns)
            is_known &= (at < len(newest_ns)) & (scans.stamps_ns >= samples.stamps_ns.min())
            came_ns = clock.at_many(samples.log_ns)[np.minimum(at, len(newest_ns) - 1)]
            known_ns = np.maximum(known_ns, came_ns)
        waits[topic] = (known_ns - received_ns)[is_known]
    return waits


def _chain(edges: Iterable[Edge], one: str, other: str) -> list[Edge] | None:
    """Return the edges of a shortest way from one frame to another, None where there is none."""
    joined: dict[str, list[tuple[str, Edge]]] = defaultdict(list)
    for edge in sorted(edges):
        joined[edge[0]].append((edge[1], edge))
        joined[edge[1]].append((edge[0], edge))
    ways: dict[str, list[Edge]] = {one: []}
    waiting = deque([one])
    while waiting:
        frame = waiting.popleft()
        for neighbour, edge in joined[frame]:
            if neighbour not in ways:
                ways[neighbour] = [*ways[frame], edge]
                waiting.append(neighbour)
    return ways.get(other)


def needed_wait_s(waits: Mapping[str, Ints], history_s: float) -> float:
    """Return the `sensors.tf_wait` [s] that is long enough for all scans.

    It exceeds the longest wait by at most 0.01 s, and is 0 where no scan waits. Waits beyond 0.75
    `history_s` do not count: `poses.history` is how long poses of artefacts are kept.
    """
    known = (in_reach(one, history_s) for one in waits.values())
    longest_ns = max((int(one.max(initial=0)) for one in known), default=0)
    steps = longest_ns // _WAIT_STEP_NS + 1 if longest_ns else 0
    return round(steps * _WAIT_STEP_NS / NS_PER_S, 2)


def wait_sentence(topic: str, noun: str, waits_ns: Ints, count: int) -> str:
    """Return a sentence on the waits of a topic's readings, and the `sensors.tf_wait` they need.

    `noun` is what to call one of the `count` readings: "scan". Parameters are taken at their
    defaults.
    """
    tf_wait_s, history_s = SensorsParameters().tf_wait, PosesParameters().history
    known_ns = in_reach(waits_ns, history_s)
    late, lost = len(waits_ns) - len(known_ns), count - len(waits_ns)
    readings = counted(count, noun)
    most = f"more than {REACH * history_s:g} s, too late for any wait"
    said_of = [f"{late} of {readings} get their transform after {most}"] * (late > 0)
    said_of += [f"{lost} of {readings} never get their transform"] * (lost > 0)
    never = "; ".join(said_of)
    if not len(known_ns):
        return f"{topic}: {never}"
    longest_s = float(known_ns.max()) / NS_PER_S
    needed_s = needed_wait_s({topic: waits_ns}, history_s)
    said = f"{topic}: {several(noun)} need not wait for their transforms"
    if longest_s >= 0.0005:
        said = f"{topic}: {several(noun)} wait up to {longest_s:.3f} s for their transforms"
    if needed_s > tf_wait_s:
        most_s = float(np.percentile(known_ns, 99)) / NS_PER_S
        said += (
            f", 99 of 100 up to {most_s:.3f} s: a replay has sensors.tf_wait at {needed_s:g} "
            f"unless it is set; set it on the robot, its default of {tf_wait_s:g} is too short"
        )
    return f"{said}; {never}" if never else said


def in_reach(waits_ns: Ints, history_s: float) -> Ints:
    """Return those of the waits, int64 (N,) [ns], that end while poses of artefacts are kept."""
    return waits_ns[waits_ns < REACH * history_s * NS_PER_S]
