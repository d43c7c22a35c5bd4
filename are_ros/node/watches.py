"""The node's measurements of itself: ticks, callbacks, inputs, faults and hangs."""

import sys
import threading
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from time import monotonic_ns
from typing import Any, Final

import numpy as np

from are_ros.agents.behaviours.calls import running_behaviour
from are_ros.conventions import NS_PER_S
from are_ros.errors import BehaviourError

MINUTE_NS: Final = 60 * NS_PER_S
LATELY_NS: Final = 10 * NS_PER_S
_NS_PER_MS: Final = 1e6


_SEVERAL: Final = 3
"""A map that takes seconds to prepare costs ticks, too, but once."""


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
    left_out: int = 0
    """Those skipped in the last minute, if some were at several times: the node falls behind."""


class TickWatch:
    """Counts and times ticks; the times are those of a clock that never jumps."""

    def __init__(self, period_ns: int) -> None:
        self.period_ns = period_ns
        self.count = 0
        self.skipped_count = 0
        self.late_count = 0
        self._ended_ns: int | None = None
        self._durations: deque[tuple[int, int]] = deque()
        self._skipped: deque[tuple[int, int]] = deque()

    def ran(self, now_ns: int, duration_ns: int, late_ns: int = 0) -> None:
        """Count a tick that has just ended; it began `late_ns` after its time."""
        self.count += 1
        self.late_count += 2 * late_ns > self.period_ns
        self._ended_ns = now_ns
        self._durations.append((now_ns, duration_ns))
        self._forget_before(now_ns - MINUTE_NS)

    def skipped(self, now_ns: int, ticks: int) -> None:
        """Count ticks that are skipped now, if any are."""
        if ticks > 0:
            self.skipped_count += ticks
            self._skipped.append((now_ns, ticks))
            self._forget_before(now_ns - MINUTE_NS)

    def figures(self, now_ns: int) -> TickFigures:
        """Return the figures at this moment."""
        self._forget_before(now_ns - MINUTE_NS)
        durations_ns = [duration_ns for _, duration_ns in self._durations]
        p50_ms = p99_ms = max_ms = None
        is_behind = len(self._skipped) >= _SEVERAL
        if durations_ns:
            ranks_ns = np.percentile(durations_ns, (50, 99, 100), method="inverted_cdf")
            p50_ms, p99_ms, max_ms = (ranks_ns / _NS_PER_MS).tolist()
        return TickFigures(
            period_s=self.period_ns / NS_PER_S,
            count=self.count,
            skipped=self.skipped_count,
            late=self.late_count,
            age_s=None if self._ended_ns is None else (now_ns - self._ended_ns) / NS_PER_S,
            p50_ms=p50_ms,
            p99_ms=p99_ms,
            max_ms=max_ms,
            over=sum(duration_ns > self.period_ns for duration_ns in durations_ns),
            left_out=sum(ticks for _, ticks in self._skipped) if is_behind else 0,
        )

    def _forget_before(self, begin_ns: int) -> None:
        for noted in (self._durations, self._skipped):
            while noted and noted[0][0] <= begin_ns:
                noted.popleft()


# Blocking times of the node, by kind of work.


PREPARING: Final = "preparing"
"""A map, a cloud or a camera was made ready, in whatever turn: that is no reason to warn."""
MACHINE: Final = "machine"
"""The node had due work but did not run: other processes had the processor, or it was stopped."""
_REQUESTED: Final = frozenset({"services", "parameters", "transitions", "diagnostics"})
"""Turns that keep their names, although ticks may run in them first."""


@dataclass(frozen=True)
class Turn:
    """One callback of the node: when it began, and in which thread."""

    began_ns: int
    thread: int


class CallbackTimer:
    """Times each callback of the node; the executor runs one at a time.

    The times are those of a clock that never jumps. `turn` is the running callback, None between
    callbacks; other threads may read it.
    """

    def __init__(self) -> None:
        self.turn: Turn | None = None
        self._what = ""
        self._depth = 0
        self._ended_ns = -(2**63)
        self._longest: deque[tuple[int, dict[str, int]]] = deque()

    def begin(self, now_ns: int, what: str) -> None:
        """Begin a turn; a nested one is part of the outer one."""
        self._depth += 1
        if self._depth == 1:
            self._what = what
            self.turn = Turn(now_ns, threading.get_ident())

    def call_it(self, what: str) -> None:
        """Rename the turn after its work; one that was asked for keeps its name beside ticks."""
        if self._what not in _REQUESTED or what == PREPARING:
            self._what = what

    def end(self, now_ns: int) -> None:
        """End the turn, or the part of it."""
        self._depth -= 1
        turn = self.turn
        if self._depth == 0 and turn is not None:
            self.turn, self._ended_ns = None, now_ns
            self._note(now_ns, self._what, now_ns - turn.began_ns)

    def woke(self, now_ns: int, due_ns: int) -> None:
        """Record the delay of a timer that no turn explains."""
        self._note(now_ns, MACHINE, now_ns - max(due_ns, self._ended_ns))

    def figures(self, now_ns: int) -> dict[str, float]:
        """Return the longest time without an answer in the last minute [ms], by kind of work."""
        self._forget_before((now_ns - MINUTE_NS) // NS_PER_S)
        longest_ms: dict[str, float] = {}
        for _, durations in self._longest:
            for what, duration_ns in durations.items():
                longest_ms[what] = max(longest_ms.get(what, 0.0), duration_ns / _NS_PER_MS)
        return dict(sorted(longest_ms.items()))

    def _note(self, now_ns: int, what: str, duration_ns: int) -> None:
        """Keep the longest duration of each second."""
        second = now_ns // NS_PER_S
        if not self._longest or self._longest[-1][0] != second:
            self._longest.append((second, {}))
            self._forget_before((now_ns - MINUTE_NS) // NS_PER_S)
        durations = self._longest[-1][1]
        durations[what] = max(durations.get(what, 0), duration_ns)

    def _forget_before(self, second: int) -> None:
        while self._longest and self._longest[0][0] < second:
            self._longest.popleft()


# Failed behaviours of users, and when they are logged.


@dataclass
class FaultWatch:
    """Collects faults; logs the first of each behaviour at once, then at most one a minute.

    `counts` are the failures since the start, by behaviour; `last` is the last one. `hung` is a
    sentence about the last behaviour that blocked the node. Both are empty if there was none.
    """

    counts: Counter[str] = field(default_factory=Counter)
    last: str = ""
    hung: str = ""
    _untold: dict[str, str] = field(default_factory=dict)
    _told_ns: dict[str, int] = field(default_factory=dict)

    def take(self, fault: BehaviourError) -> None:
        """Take a fault."""
        self.last = self._untold[fault.behaviour] = str(fault)
        self.counts[fault.behaviour] += 1

    def sentences(self, now_ns: int) -> list[str]:
        """Return the sentences to log now; `now_ns` is monotonic."""
        rested_ns = now_ns - MINUTE_NS
        due = [name for name in self._untold if self._told_ns.get(name, rested_ns) <= rested_ns]
        self._told_ns.update(dict.fromkeys(due, now_ns))
        return [f"{self._untold.pop(name)}; it stands from now on" for name in due]


# Behaviours of users that do not return: a watchdog thread logs them at once.


PATIENCE_NS: Final = NS_PER_S
_LOOKS_PER_S: Final = 4


class Watchdog:
    """A watchdog thread: logs the behaviour that has blocked the node for a second.

    `say(sentence)` is called from the watchdog's thread, so it must not publish anything. Compiled
    code that holds the interpreter's lock stops the watchdog, too.
    """

    def __init__(self, busy: CallbackTimer, say: Callable[[str], None]) -> None:
        self._busy = busy
        self._say = say
        self._hung: tuple[Turn, str] | None = None
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="hang watch", daemon=True)
        self._thread.start()

    def take(self) -> tuple[Turn, str] | None:
        """Return the blocked turn and the behaviour that blocked it, each once.

        Call it between turns.
        """
        hung, self._hung = self._hung, None
        return hung

    def close(self) -> None:
        """End the thread."""
        self._is_over.set()
        self._thread.join()

    def _run(self) -> None:
        asked: tuple[Turn | None, str] = None, ""
        since_ns = 0
        while not self._is_over.wait(1.0 / _LOOKS_PER_S):
            turn, hung = self._busy.turn, self._hung
            is_known = hung is not None and hung[0] is turn
            if turn is None or is_known:
                continue
            who = running_behaviour(sys._current_frames().get(turn.thread))  # noqa: SLF001 - of Python
            if self._busy.turn is not turn:
                continue
            # Several slow behaviours, one after the other, are no hang.
            if (turn, who) != asked:
                asked, since_ns = (turn, who), monotonic_ns()
            elif who and monotonic_ns() - since_ns >= PATIENCE_NS:
                self._hung = turn, who
                self._say(f"{who} has not returned for a second; the node stands still")


# The recent growth of a counter.


class CountWatch:
    """Measures a counter's growth over a sliding window."""

    def __init__(self, window_ns: int) -> None:
        self._window_ns = window_ns
        self._totals: deque[tuple[int, int]] = deque([(-(2**63), 0)])
        """When each total was first seen; the first of them is that of the window's begin."""

    def update(self, now_ns: int, total: int) -> None:
        """Take the counter's total; a smaller one means that the counter was reset."""
        if total < self._totals[-1][1]:
            self._totals = deque([(now_ns, 0)])
        if total != self._totals[-1][1]:
            self._totals.append((now_ns, total))

    def growth(self, now_ns: int) -> int:
        """Return by how much the total grew in the window (now - window, now]."""
        begin_ns = now_ns - self._window_ns
        while len(self._totals) > 1 and self._totals[1][0] <= begin_ns:
            self._totals.popleft()
        return self._totals[-1][1] - self._totals[0][1]


# One input: messages, rate, refusals and their reasons.


_LEAST_SPAN_S: Final = 0.2
"""Messages that had queued before the start come in an instant: that is no rate."""
_MOST_STAMPS: Final = 1024
"""Beyond these the rate is that over the newest; a minute's transforms need not be kept."""


@dataclass(frozen=True)
class InputSnapshot:
    """An input at one moment: its role, the full name of its topic, and what came in.

    `rate_hz` and `period_s` are those of the last messages, up to 10 s of them, whenever they came:
    they stay as they were when the input stops, and `age_s` grows. None where nothing is known.
    """

    role: str
    topic: str
    count: int = 0
    refused: int = 0
    refused_lately: int = 0
    """In the last 10 s; refused messages count as messages too."""
    last_refusal: str = ""
    age_s: float | None = None
    period_s: float | None = None
    is_required: bool = False
    is_latched: bool = False
    """It comes once, or when it changes; so it never goes stale."""
    publishers: int = 0
    published_s: float = 0.0
    """For so long there has been a publisher."""
    asked: str = ""
    """What is asked of the QoS of its publishers, as "reliable, transient local"."""
    mistyped: str = ""
    """What all its publishers send in place of its type, as "std_msgs/msg/String, not ..."."""

    @property
    def rate_hz(self) -> float | None:
        """Messages per second, None until they have come for 0.2 s."""
        period_s = self.period_s or 0.0
        return 1.0 / period_s if period_s * (self.count - 1) >= _LEAST_SPAN_S else None


class InputWatch:
    """Counts the messages of one input; the times are those of a clock that never jumps."""

    def __init__(self) -> None:
        self.count = 0
        self.refused_count = 0
        self.last_refusal = ""
        self._stamps: deque[int] = deque(maxlen=_MOST_STAMPS)
        self._refusals = CountWatch(LATELY_NS)
        self._published_ns: int | None = None

    def received(self, now_ns: int) -> None:
        """Count a message, whether or not it will be refused."""
        self.count += 1
        self._stamps.append(now_ns)
        while self._stamps[0] <= now_ns - LATELY_NS:
            self._stamps.popleft()

    def refused(self, now_ns: int, sentence: str) -> None:
        """Count a message that was received and refused, and keep the reason."""
        self.refused_count += 1
        self.last_refusal = sentence
        self._refusals.update(now_ns, self.refused_count)

    def snapshot(
        self, now_ns: int, role: str, topic: str, publishers: int = 0, **known: Any
    ) -> InputSnapshot:
        """Return the input at this moment; `known` are further fields."""
        if not publishers:
            self._published_ns = None
        elif self._published_ns is None:
            self._published_ns = now_ns
        since_ns = now_ns if self._published_ns is None else self._published_ns
        return InputSnapshot(
            role,
            topic,
            count=self.count,
            refused=self.refused_count,
            refused_lately=self._refusals.growth(now_ns),
            last_refusal=self.last_refusal,
            age_s=(now_ns - self._stamps[-1]) / NS_PER_S if self._stamps else None,
            period_s=self._period_s(),
            publishers=publishers,
            published_s=(now_ns - since_ns) / NS_PER_S,
            **known,
        )

    def _period_s(self) -> float | None:
        intervals = len(self._stamps) - 1
        if intervals < 1:
            return None
        return (self._stamps[-1] - self._stamps[0]) / intervals / NS_PER_S


# How long something lasts.


GRACE_S: Final = 5.0
"""For so long after activation, or from its first publisher on, a missing input is no error."""


class Lasting:
    """Tells whether something has held for `least_s` without a break.

    Times are those of a clock that never jumps.
    """

    def __init__(self, least_s: float) -> None:
        self._least_ns = least_s * NS_PER_S
        self._since_ns: int | None = None

    def see(self, now_ns: int, *, holds: bool) -> bool:
        """Take whether it holds now; return whether it has lasted."""
        if not holds:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = now_ns
        return self._since_ns is not None and now_ns - self._since_ns >= self._least_ns
