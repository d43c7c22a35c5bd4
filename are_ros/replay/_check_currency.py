"""Whether a grid that goes out on change, moves at most so often, is up to date at each tick."""

from typing import Final

import numpy as np

from are_ros.checks.oracle_solids import SURE, Cover, RealMap, are_same, layer
from are_ros.replay._check_admission import AdmittedTick
from are_ros.replay._check_result import Tally, at_s

_NEVER: Final = -(2**63)


class Currency:
    """Follows one grid: a change goes out at the first tick that may publish it.

    That is the next one where somebody appears or goes, or else when the interval is over; before,
    nothing goes out. `full_value` is the value from which on a real cell hides an artefact in it.
    """

    def __init__(self, tally: Tally, interval_ns: int, full_value: int) -> None:
        self._tally = tally
        self._interval_ns = interval_ns
        self._full_value = full_value
        self._sent_ns = self._last_ns = _NEVER
        self._last: tuple[RealMap, list[Cover]] | None = None
        self._ids: frozenset[int] = frozenset()

    def take(self, tick: AdmittedTick, real: RealMap, *, is_published: bool, is_sent: bool) -> None:
        """Follow one tick; `is_sent`: this grid was published, or one that shares its interval."""
        now_ns = tick.scene.stamp_ns
        self._tally.look()
        is_early = 0 <= now_ns - self._sent_ns < self._interval_ns and tick.ids == self._ids
        if is_early and is_published:
            after = f"{(now_ns - self._sent_ns) / 1e9:g} s after the last one"
            self._tally.fail(f"{at_s(now_ns)} it goes out {after}, though nobody came or went")
        if is_published:
            self._last_ns, self._last = now_ns, (real, tick.covers)
        elif self._last is None:
            # A map of that very time may have come after the tick.
            if real.since_ns < now_ns:
                self._tally.fail(f"{at_s(now_ns)} there is a real map, but nothing was published")
        elif (is_sent or not is_early) and self._is_stale(*self._last, tick, real):
            text = f"shows the artefacts of {at_s(self._last_ns).removeprefix('at ')}"
            self._tally.fail(f"{at_s(now_ns)} the last one still {text}")
        self._sent_ns, self._ids = now_ns if is_sent else self._sent_ns, tick.ids

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
