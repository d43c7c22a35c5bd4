"""What the wall clock says of a replay: for `timing.json` only."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[int], None]
"""Takes the time reached [ns]."""

_SLOW_S = 2.0


@contextmanager
def said_if_slow(say: Callable[[str], None], sentence: str) -> Iterator[None]:
    """Say a sentence if the block is not over after two seconds."""
    timer = threading.Timer(_SLOW_S, say, (sentence,))
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


class Stopwatch:
    """Adds up seconds by phase, and keeps the duration of every tick."""

    def __init__(self) -> None:
        self.phases_s: dict[str, float] = {}
        self.tick_durations_s: list[float] = []

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Count the time inside the block to a phase."""
        began_s = time.perf_counter()
        try:
            yield
        finally:
            taken_s = time.perf_counter() - began_s
            self.phases_s[name] = self.phases_s.get(name, 0.0) + taken_s

    @contextmanager
    def tick(self) -> Iterator[None]:
        """Keep the time inside the block as the duration of one tick."""
        began_s = time.perf_counter()
        yield
        self.tick_durations_s.append(time.perf_counter() - began_s)
