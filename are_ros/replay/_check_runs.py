"""Live recordings: where ticks follow each other without a gap, and where the artefacts went away.

A recording begins and ends at any time, and may pause; so may the node. What was missed then is not
to be missed by a check, nor what happens while the topics of a recording connect one by one.
"""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from are_ros.conventions import NS_PER_S
from are_ros.replay._check_scene import Scene

SETTLING_NS: Final = NS_PER_S
"""So long after the beginning of a run, and before its end, messages may be missing."""

_LONGEST_GAP: Final = 2.5
"""In periods; with a single tick missing the next one still tells all that happened."""


@dataclass(frozen=True)
class Runs:
    """First and last stamps of runs of ticks, in order; none where every tick counts."""

    spans_ns: tuple[tuple[int, int], ...] = ()

    def is_fresh(self, stamp_ns: int) -> bool:
        """Tell whether a run began so shortly before that something may have been missed."""
        span = self._span_at(stamp_ns)
        return span is not None and stamp_ns < span[0] + SETTLING_NS

    def is_beginning(self, stamp_ns: int) -> bool:
        """Tell whether this is the first tick of a run."""
        span = self._span_at(stamp_ns)
        return span is not None and stamp_ns == span[0]

    def is_edge(self, stamp_ns: int) -> bool:
        """Tell whether a time is in no run, or near the beginning or the end of one."""
        if not self.spans_ns:
            return False
        span = self._span_at(stamp_ns)
        return span is None or not span[0] + SETTLING_NS <= stamp_ns <= span[1] - SETTLING_NS

    def is_between(self, stamp_ns: int) -> bool:
        """Tell whether a time is after a run and not near its end, and before the next one."""
        index = bisect_right(self.spans_ns, (stamp_ns, 2**63)) - 1
        return index >= 0 and stamp_ns > self.spans_ns[index][1] + SETTLING_NS

    def are_together(self, before_ns: int, after_ns: int) -> bool:
        """Tell whether two times are in the same run."""
        if not self.spans_ns:
            return True
        return self._span_at(before_ns) == self._span_at(after_ns) is not None

    def _span_at(self, stamp_ns: int) -> tuple[int, int] | None:
        index = bisect_right(self.spans_ns, (stamp_ns, 2**63)) - 1
        if index < 0 or stamp_ns > self.spans_ns[index][1]:
            return None
        return self.spans_ns[index]


def part_farewells(scenes: Iterable[Scene], period_ns: int) -> tuple[list[Scene], list[int]]:
    """Part the lists of ticks from those with which a node takes its leave; return their stamps.

    These are empty, and come when they come: not at a multiple of the period, or again at the time
    of the tick before.
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


def runs_of(stamps_ns: Sequence[int], period_ns: int, breaks_ns: Iterable[int]) -> Runs:
    """Return the runs of ticks: apart by a gap, or by a farewell (`breaks_ns`)."""
    breaks = sorted(breaks_ns)
    spans: list[tuple[int, int]] = []
    for stamp_ns in stamps_ns:
        if spans and _is_next(spans[-1][1], stamp_ns, period_ns, breaks):
            spans[-1] = (spans[-1][0], stamp_ns)
        else:
            spans.append((stamp_ns, stamp_ns))
    return Runs(tuple(spans))


def _is_next(before_ns: int, stamp_ns: int, period_ns: int, breaks: Sequence[int]) -> bool:
    if stamp_ns - before_ns > _LONGEST_GAP * period_ns:
        return False
    return bisect_right(breaks, stamp_ns - 1) == bisect_right(breaks, before_ns - 1)
