"""Behaviours of the user's own that do not return: said at once, by a thread of its own."""

import sys
import threading
from collections.abc import Callable
from time import monotonic_ns
from typing import Final

from are_ros.artefacts.behaviours.asking import who_is_asked
from are_ros.conventions import NS_PER_S
from are_ros.node.busy_watch import BusyWatch, Turn

PATIENCE_NS: Final = NS_PER_S
_LOOKS_PER_S: Final = 4


class HangWatch:
    """Looks from outside whom a node waits for that has not answered for a second.

    `say(sentence)` is called from the thread of this watch, so it must not publish anything. What
    holds the interpreter's lock, as compiled code may, lets nobody look.
    """

    def __init__(self, busy: BusyWatch, say: Callable[[str], None]) -> None:
        self._busy = busy
        self._say = say
        self._hung: tuple[Turn, str] | None = None
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="hang watch", daemon=True)
        self._thread.start()

    def take(self) -> tuple[Turn, str] | None:
        """Return the turn in which somebody was waited for so long, and whom; each once.

        To be asked between turns.
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
            who = who_is_asked(sys._current_frames().get(turn.thread))  # noqa: SLF001 - of Python
            if self._busy.turn is not turn:
                continue
            # Several that are slow, one after the other, are no hang.
            if (turn, who) != asked:
                asked, since_ns = (turn, who), monotonic_ns()
            elif who and monotonic_ns() - since_ns >= PATIENCE_NS:
                self._hung = turn, who
                self._say(f"{who} has not returned for a second; the node stands still")
