"""SIGINT and SIGTERM, noted from the first moment on."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


class Stop:
    """Set by a signal, which does nothing else: raised exceptions would crash what is compiled."""

    def __init__(self) -> None:
        self.is_set = False

    def __call__(self, number: int, frame: Any) -> None:
        """Take a signal."""
        del number, frame
        self.is_set = True


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
