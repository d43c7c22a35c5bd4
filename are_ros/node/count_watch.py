"""How much a counter has grown of late."""

from collections import deque


class CountWatch:
    """Sees a counter's totals, and tells its growth over a sliding window."""

    def __init__(self, window_ns: int) -> None:
        self._window_ns = window_ns
        self._totals: deque[tuple[int, int]] = deque([(-(2**63), 0)])
        """When each total was first seen; the first of them is that of the window's begin."""

    def update(self, now_ns: int, total: int) -> None:
        """Take the counter's total; one that is smaller means that it was set to zero."""
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
