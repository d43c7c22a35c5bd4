"""How long ticks take, and which came late or not at all."""

from collections import deque
from dataclasses import dataclass
from typing import Final

from are_ros.conventions import NS_PER_S

WINDOW_NS: Final = 60 * NS_PER_S
_NS_PER_MS: Final = 1e6


@dataclass(frozen=True)
class TickFigures:
    """The ticks at one moment: totals since the start, and durations over the last minute.

    The durations are None where no tick ran in that minute, `age_s` where none ran at all.
    """

    period_s: float
    count: int = 0
    skipped: int = 0
    late: int = 0
    """Those that began more than half a period after their time."""
    age_s: float | None = None
    p50_ms: float | None = None
    p99_ms: float | None = None
    max_ms: float | None = None
    over: int = 0
    """Those of the last minute that took longer than a period."""


class TickWatch:
    """Counts and times ticks; the times are those of a clock that never jumps."""

    def __init__(self, period_ns: int) -> None:
        self.period_ns = period_ns
        self.count = 0
        self.skipped_count = 0
        self.late_count = 0
        self._ended_ns: int | None = None
        self._durations: deque[tuple[int, int]] = deque()

    def ran(self, now_ns: int, duration_ns: int, late_ns: int = 0) -> None:
        """Count a tick that has just ended, and that had begun `late_ns` after its time."""
        self.count += 1
        self.late_count += 2 * late_ns > self.period_ns
        self._ended_ns = now_ns
        self._durations.append((now_ns, duration_ns))
        self._forget_before(now_ns - WINDOW_NS)

    def skipped(self, ticks: int = 1) -> None:
        """Count ticks whose time went by without them."""
        self.skipped_count += ticks

    def figures(self, now_ns: int) -> TickFigures:
        """Return what is to be said now."""
        self._forget_before(now_ns - WINDOW_NS)
        durations = sorted(duration_ns for _, duration_ns in self._durations)
        return TickFigures(
            period_s=self.period_ns / NS_PER_S,
            count=self.count,
            skipped=self.skipped_count,
            late=self.late_count,
            age_s=None if self._ended_ns is None else (now_ns - self._ended_ns) / NS_PER_S,
            p50_ms=_percentile_ms(durations, 50),
            p99_ms=_percentile_ms(durations, 99),
            max_ms=_percentile_ms(durations, 100),
            over=sum(duration_ns > self.period_ns for duration_ns in durations),
        )

    def _forget_before(self, begin_ns: int) -> None:
        while self._durations and self._durations[0][0] <= begin_ns:
            self._durations.popleft()


def _percentile_ms(durations_ns: list[int], percent: int) -> float | None:
    """Return the nearest-rank percentile of sorted durations."""
    if not durations_ns:
        return None
    rank = -(-percent * len(durations_ns) // 100)
    return durations_ns[max(rank, 1) - 1] / _NS_PER_MS
