"""SIGINT and SIGTERM: noted, and what takes long is cut short."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


class Stopped(BaseException):
    """A signal came while something was going on that may be cut short."""


class Stop:
    """Set by a signal, which raises Stopped while `may_cut()`, and nothing otherwise."""

    def __init__(self) -> None:
        self.is_set = False
        self.may_cut: Callable[[], bool] = bool

    def __call__(self, number: int, frame: Any) -> None:
        """Take a signal."""
        del number, frame
        self.is_set = True
        if self.may_cut():
            raise Stopped


@contextmanager
def stop_on_signals() -> Iterator[Stop]:
    """Give out what signals set while the block runs; for the main thread.

    After a signal later ones are ignored for good: who ends already need not be told again.
    """
    stop = Stop()
    before = {number: signal.signal(number, stop) for number in _SIGNALS}
    try:
        yield stop
    finally:
        for number, previous in before.items():
            signal.signal(number, signal.SIG_IGN if stop.is_set else previous)
