"""Pauses: standing for some seconds, and no longer."""

import numpy as np

from are_ros.conventions import seconds_to_ns

SHORTEST_S, LONGEST_S = 1.0, 10.0
_MEAN_ABOVE_SHORTEST_S = 2.0


class Pause:
    """A pause of 1 to 10 s, mostly a few, that is over of itself."""

    def __init__(self) -> None:
        self._until_ns: int | None = None

    def begin(self, now_ns: int, random: np.random.Generator) -> None:
        """Pause from now on."""
        length_s = SHORTEST_S + float(random.exponential(_MEAN_ABOVE_SHORTEST_S))
        self._until_ns = now_ns + seconds_to_ns(min(length_s, LONGEST_S))

    def holds(self, now_ns: int) -> bool:
        """Say whether the pause goes on."""
        if self._until_ns is not None and now_ns >= self._until_ns:
            self._until_ns = None
        return self._until_ns is not None
