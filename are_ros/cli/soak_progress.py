"""How far a soak has come: a bar on a terminal, a line a minute in a log."""

import sys
import time
from collections.abc import Callable
from typing import NoReturn

from tqdm import tqdm

_LAYOUT = "soak {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} min [{elapsed}<{remaining}]"
_EVERY_S = 60.0


class SoakProgress:
    """Tells on stderr how many of the artefact-minutes are done; to be closed.

    On a terminal as a bar. Elsewhere (a file, CI) in a line after each minute of the wall clock,
    with an estimate of what is left; a soak that is shorter says nothing.
    """

    def __init__(
        self,
        total_min: float,
        say: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._total_min = total_min
        self._say, self._clock = say, clock
        self._began_s = self._said_s = clock()
        self._bar: tqdm[NoReturn] | None = None
        if sys.stderr.isatty():
            self._bar = tqdm(total=total_min, bar_format=_LAYOUT)

    def close(self) -> None:
        """End the bar, so that what is said after it has a line of its own."""
        if self._bar is not None:
            self._bar.close()

    def move(self, done_min: float) -> None:
        """Take the artefact-minutes that are done."""
        done_min = min(done_min, self._total_min)
        if self._bar is not None:
            self._bar.update(done_min - self._bar.n)
            return
        now_s = self._clock()
        if now_s - self._said_s >= _EVERY_S and done_min < self._total_min:
            self._said_s = now_s
            self._say(self._sentence(done_min, now_s - self._began_s))

    def _sentence(self, done_min: float, passed_s: float) -> str:
        done = f"soak: {done_min:.0f} of {self._total_min:.0f} artefact-minutes"
        if done_min <= 0.0:
            return f"{done} after {passed_s / 60.0:.0f} min: nobody lives yet"
        left_min = passed_s / 60.0 * (self._total_min / done_min - 1.0)
        left = "less than a minute" if left_min < 1.0 else f"about {left_min:.0f} min"
        return f"{done} after {passed_s / 60.0:.0f} min, {left} to go"
