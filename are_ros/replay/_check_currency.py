"""Whether a grid that goes out on change, at most so often, is up to date at each tick."""

import numpy as np

from are_ros.replay._check_admission import AdmittedTick
from are_ros.replay._check_cells import SURE, Cover, RealMap, are_same, layer
from are_ros.replay._check_result import Tally, at_s


class Currency:
    """Follows one grid: a change goes out at the first tick that may publish it.

    `full_value` is the value from which on a real cell hides an artefact in it.
    """

    def __init__(self, tally: Tally, interval_ns: int, full_value: int) -> None:
        self._tally = tally
        self._interval_ns = interval_ns
        self._full_value = full_value
        self._last_ns: int | None = None
        self._last: tuple[RealMap, list[Cover]] | None = None

    def take(self, tick: AdmittedTick, real: RealMap, *, is_published: bool) -> None:
        """Follow one tick."""
        now_ns = tick.scene.stamp_ns
        self._tally.look()
        if is_published:
            self._last_ns, self._last = now_ns, (real, tick.covers)
        elif self._last is None or self._last_ns is None:
            # A map of that very time may have come after the tick.
            if real.since_ns < now_ns:
                self._tally.fail(f"{at_s(now_ns)} there is a real map, but nothing was published")
        elif now_ns - self._last_ns >= self._interval_ns and self._is_stale(
            *self._last, tick, real
        ):
            text = f"shows the artefacts of {at_s(self._last_ns).removeprefix('at ')}"
            self._tally.fail(f"{at_s(now_ns)} the last one still {text}")

    def _is_stale(
        self, last_real: RealMap, last: list[Cover], tick: AdmittedTick, real: RealMap
    ) -> bool:
        """Tell whether some cell is certainly another than when the last one went out."""
        if real is not last_real:
            return not np.array_equal(real.cells, last_real.cells)
        if are_same(last, tick.covers):
            return False
        before, now = layer(last, real), layer(tick.covers, real)
        changed = np.abs(before - now) == SURE
        return bool((real.cells.reshape(-1)[changed] < self._full_value).any())
