"""An orderly end: a signal is noted, and asked for."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def stop_on_signal() -> Iterator[Callable[[], bool]]:
    """Give out what tells whether SIGINT or SIGTERM came; for the main thread.

    Inside, neither of them raises anything.
    """
    came = False

    def note(number: int, frame: Any) -> None:
        nonlocal came
        del number, frame
        came = True

    before = {number: signal.signal(number, note) for number in _SIGNALS}
    try:
        yield lambda: came
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)
