"""Trips: a destination at a time, and another one when it is reached or cannot be."""

from collections import deque
from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.behaviours.intent import Point
from are_ros.artefacts.behaviours.situation import Situation
from are_ros.conventions import NS_PER_S

LONGEST_TRIP_M: Final = 40.0
"""Destinations farther away than this are chosen only where there is no nearer one."""
_SHORTEST_TRIP_M = 3.0
_LEAST_TRIP_M = 1.0
_REMEMBERED = 3
_PATIENCE_S = (5.0, 12.0)

Choose = Callable[[Situation, npt.NDArray[np.bool_]], int | None]
"""(situation, bool (K,): the destinations not to be chosen) -> index of a destination, or None."""


def any_destination(situation: Situation, is_shut: npt.NDArray[np.bool_]) -> int | None:
    """Draw one of the open destinations 3 to 40 m away.

    Without any it is the nearest of those farther away, else the farthest of those nearer, but for
    those less than 1 m away.
    """
    distances_m = distances_to_destinations(situation)
    near = distances_m < _SHORTEST_TRIP_M
    usual = np.flatnonzero(~is_shut & ~near & (distances_m <= LONGEST_TRIP_M))
    if usual.size:
        return situation.drawn_from(usual)
    far = least(np.where(is_shut | near, np.inf, distances_m))
    if far is not None:
        return far
    return least(np.where(is_shut | (distances_m < _LEAST_TRIP_M), np.inf, -distances_m))


def distances_to_destinations(situation: Situation) -> npt.NDArray[np.float64]:
    """Return the distances (K,) [m] of the destinations from the artefact."""
    offsets_m = situation.places.destinations_m - np.array(situation.point_m)
    distances_m: npt.NDArray[np.float64] = np.hypot(offsets_m[:, 0], offsets_m[:, 1])
    return distances_m


def least(costs: npt.NDArray[np.float64]) -> int | None:
    """Return the index of the least cost that is finite, of several the first; None if none is."""
    best = int(costs.argmin()) if costs.size else 0
    return best if costs.size and np.isfinite(costs[best]) else None


class Trip:
    """The destination that an artefact is on its way to.

    It is given up when no way leads there, or when the artefact has been kept from going on for
    longer than its patience, drawn anew for each trip from 5 to 12 s. The last three are not
    chosen again, where there are others.
    """

    def __init__(self, choose: Choose = any_destination) -> None:
        self.goal_m: Point | None = None
        self._choose = choose
        self._shunned_m: deque[Point] = deque(maxlen=_REMEMBERED)
        self._begun_ns = 0
        self._patience_s = 0.0

    def is_reached(self, situation: Situation) -> bool:
        """Say whether the artefact has arrived; the trip is over then."""
        if not situation.has_reached(self.goal_m):
            return False
        self.give_up()
        return True

    def goal(self, situation: Situation) -> Point | None:
        """Return where to go; None if there is no destination."""
        if self._is_hopeless(situation):
            self.give_up()
        if self.goal_m is None:
            index = self._choose(situation, self.shut(situation))
            if index is None and self._shunned_m:
                # A map of few places: an old one is better than none, but not the one just left.
                index = self._choose(situation, _are(situation, [self._shunned_m[-1]]))
            if index is not None:
                self.change_to(index, situation)
        return self.goal_m

    def change_to(self, index: int, situation: Situation) -> None:
        """Go to this destination from now on."""
        x_m, y_m = situation.places.destinations_m[index].tolist()
        self.goal_m = (x_m, y_m)
        self._begun_ns = situation.now_ns
        self._patience_s = situation.drawn_between(*_PATIENCE_S)

    def give_up(self) -> None:
        """Choose another destination next time, and none of the last few."""
        if self.goal_m is not None:
            self._shunned_m.append(self.goal_m)
        self.goal_m = None

    def shut(self, situation: Situation) -> npt.NDArray[np.bool_]:
        """Return which destinations, bool (K,), are not to be chosen just now."""
        return _are(situation, self._shunned_m)

    def _is_hopeless(self, situation: Situation) -> bool:
        if not situation.wanted(self.goal_m):
            return False
        under_way_s = (situation.now_ns - self._begun_ns) / NS_PER_S
        hindered_s = min(situation.blocked_s, under_way_s)
        return situation.no_way or hindered_s > self._patience_s


def _are(situation: Situation, points_m: deque[Point] | list[Point]) -> npt.NDArray[np.bool_]:
    """Return which destinations, bool (K,), are among the points; a new map may know none."""
    destinations_m = situation.places.destinations_m
    found = np.zeros(len(destinations_m), np.bool_)
    for point_m in points_m:
        found |= (destinations_m[:, 0] == point_m[0]) & (destinations_m[:, 1] == point_m[1])
    return found
