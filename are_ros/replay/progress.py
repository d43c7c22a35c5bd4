"""Progress bars, and how long the phases of a replay take by the wall clock."""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NoReturn

from tqdm import tqdm

from are_ros.conventions import NS_PER_S

Say = Callable[[str], None]
"""Takes a sentence for the user."""
Progress = Callable[[int], None]
"""Takes the time reached [ns]."""
OpenProgress = Callable[[int, int], Progress]
"""Takes the first and the last time [ns]; returns what takes the time reached."""

SLOW_S = 2.0
"""What takes longer is told of, or has a bar."""


@contextmanager
def said_if_slow(say: Say, sentence: str) -> Iterator[None]:
    """Say a sentence if the block is not over after two seconds."""
    timer = threading.Timer(SLOW_S, say, (sentence,))
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@dataclass
class Stopwatch:
    """Adds up seconds by phase, and keeps the duration of every tick [s]."""

    phases_s: dict[str, float] = field(default_factory=dict)
    ticks_s: list[float] = field(default_factory=list)

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
        self.ticks_s.append(time.perf_counter() - began_s)


_STEP_NS = NS_PER_S // 2
_LAYOUT = "{desc} {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} s [{elapsed}<{remaining}]"
_COUNTED = "{desc} {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} [{elapsed}]"


class ProgressBar:
    """A bar on stderr; a context manager, which ends the bar's line.

    Where stderr is no terminal (a file, CI) there is no bar.
    """

    def __init__(self, name: str = "replay") -> None:
        self._name = name
        self._bar: tqdm[NoReturn] | None = None

    def __enter__(self) -> "ProgressBar":  # noqa: PYI034 (Self came with Python 3.11)
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()

    def open(self, start_ns: int, end_ns: int) -> Progress:
        """Show the bar; return a callable that moves it, and closes it at `end_ns`."""
        total_s = round((end_ns - start_ns) / NS_PER_S, 3)
        bar: tqdm[NoReturn] = tqdm(
            total=total_s, desc=self._name, bar_format=_LAYOUT, leave=True, disable=None
        )
        self._bar = bar
        shown_ns = start_ns

        def move(now_ns: int) -> None:
            nonlocal shown_ns
            if now_ns - shown_ns < _STEP_NS and now_ns < end_ns:
                return
            shown_ns = now_ns
            bar.n = min((now_ns - start_ns) / NS_PER_S, total_s)
            bar.update(0)
            if now_ns >= end_ns:
                bar.close()

        return move


class CountBar:
    """A bar on stderr that counts what is done, once that has taken two seconds."""

    def __init__(self, name: str) -> None:
        self._bar: tqdm[NoReturn] = tqdm(
            desc=name, bar_format=_COUNTED, leave=True, disable=None, delay=SLOW_S, total=1
        )

    def __enter__(self) -> "CountBar":  # noqa: PYI034 (Self came with Python 3.11)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._bar.close()

    def count(self, done: int, total: int) -> None:
        """Show how many are done, of at most how many."""
        self._bar.total = total
        self._bar.update(done - self._bar.n)


class KernelBar(CountBar):
    """Counts the kernels that compile.

    The first Ctrl-C meanwhile makes `is_wanted` false, and interrupts when the block ends: the
    compiler would crash or swallow it. The second one interrupts at once.
    """

    def __init__(self) -> None:
        super().__init__("kernels")

    def __enter__(self) -> "KernelBar":  # noqa: PYI034 (Self came with Python 3.11)
        self._is_interrupted, self._handler = False, signal.getsignal(signal.SIGINT)
        if callable(self._handler) and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, self._interrupt)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self._bar.total = max(self._bar.n, 1)  # kernels that are not needed are not compiled
        self._bar.close()
        if signal.getsignal(signal.SIGINT) == self._interrupt:
            signal.signal(signal.SIGINT, self._handler)
        if self._is_interrupted:
            raise KeyboardInterrupt

    def is_wanted(self) -> bool:
        """Return whether no Ctrl-C has come."""
        return not self._is_interrupted

    def _interrupt(self, *_: object) -> None:
        self._is_interrupted = True
        signal.signal(signal.SIGINT, self._handler)
