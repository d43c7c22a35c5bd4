"""For how long the node did not answer, and what it did meanwhile."""

import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from are_ros.conventions import NS_PER_S

WINDOW_S: Final = 60
MACHINE: Final = "machine"
"""The node had something to do, and was not run: others had the processor, or it was stopped."""
_REQUESTED: Final = frozenset({"services", "parameters", "transitions", "diagnostics"})
"""Turns that keep their names, though ticks may be run in them first."""
_NS_PER_MS: Final = 1e6


@dataclass(frozen=True)
class Turn:
    """Something that the node does: since when, and in which thread."""

    began_ns: int
    thread: int


@dataclass(frozen=True)
class BusyFigures:
    """The longest times without an answer in the last minute [ms], by what was done meanwhile."""

    longest_ms: Mapping[str, float] = field(default_factory=dict)


class BusyWatch:
    """Times each turn that the executor gives to the node: until its end nobody else has one.

    The times are those of a clock that never jumps. `turn` is the one that goes on, if any; other
    threads may look at it.
    """

    def __init__(self) -> None:
        self.turn: Turn | None = None
        self._what = ""
        self._depth = 0
        self._ended_ns = -(2**63)
        self._longest: deque[tuple[int, dict[str, int]]] = deque()

    def begin(self, now_ns: int, what: str) -> None:
        """Begin a turn; one within another is a part of it."""
        self._depth += 1
        if self._depth == 1:
            self._what = what
            self.turn = Turn(now_ns, threading.get_ident())

    def call_it(self, what: str) -> None:
        """Name the turn after what is done in it, if it was none of a user's: inputs make ticks."""
        if self._what not in _REQUESTED:
            self._what = what

    def end(self, now_ns: int) -> None:
        """End the turn, or the part of it."""
        self._depth -= 1
        turn = self.turn
        if self._depth == 0 and turn is not None:
            self.turn, self._ended_ns = None, now_ns
            self._note(now_ns, self._what, now_ns - turn.began_ns)

    def woke(self, now_ns: int, due_ns: int) -> None:
        """Note by how much a timer was late, as far as no turn explains it."""
        self._note(now_ns, MACHINE, now_ns - max(due_ns, self._ended_ns))

    def figures(self, now_ns: int) -> BusyFigures:
        """Return what is to be said now."""
        self._forget_before(now_ns // NS_PER_S - WINDOW_S)
        longest_ms: dict[str, float] = {}
        for _, durations in self._longest:
            for what, duration_ns in durations.items():
                longest_ms[what] = max(longest_ms.get(what, 0.0), duration_ns / _NS_PER_MS)
        return BusyFigures(dict(sorted(longest_ms.items())))

    def _note(self, now_ns: int, what: str, duration_ns: int) -> None:
        """Keep the longest duration of each second."""
        second = now_ns // NS_PER_S
        if not self._longest or self._longest[-1][0] != second:
            self._longest.append((second, {}))
            self._forget_before(second - WINDOW_S)
        durations = self._longest[-1][1]
        durations[what] = max(durations.get(what, 0), duration_ns)

    def _forget_before(self, second: int) -> None:
        while self._longest and self._longest[0][0] < second:
            self._longest.popleft()
