"""The progress bar of a replay, over the seconds of the recording."""

from types import TracebackType
from typing import NoReturn

from tqdm import tqdm

from are_ros.conventions import NS_PER_S
from are_ros.replay.stopwatch import Progress

_STEP_NS = NS_PER_S // 2
_LAYOUT = "{desc} {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} s [{elapsed}<{remaining}]"


class ProgressBar:
    """A bar on stderr; a context manager, so that what is said after it has a line of its own.

    Where stderr is no terminal (a file, CI) there is none.
    """

    def __init__(self, name: str = "replay") -> None:
        self._name = name
        self._bar: tqdm[NoReturn] | None = None

    def __enter__(self) -> "ProgressBar":  # noqa: PYI034 (Self came with Python 3.11)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.close()

    def open(self, start_ns: int, end_ns: int) -> Progress:
        """Show the bar; what is returned moves it, and closes it at `end_ns`."""
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
