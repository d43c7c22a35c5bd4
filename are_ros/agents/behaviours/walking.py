"""The behaviour walking, from destination to destination, and its variants.

Running, driving, wandering and stopping differ from it in a few numbers. An artefact that may walk,
run, drive or stop keeps its destination when it changes from one to the other.
"""

from collections import deque
from collections.abc import Callable, Iterable
from typing import ClassVar, Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.situation import (
    ARRIVE_WITHIN_M,
    Intent,
    Point,
    Situation,
    stand,
)
from are_ros.conventions import NS_PER_S, seconds_to_ns

# Trips: one destination at a time.


LONGEST_TRIP_M: Final = 40.0
"""A destination farther away than this is chosen only if there is no nearer one."""
_SHORTEST_TRIP_M = 3.0
_LEAST_TRIP_M = 1.0
_REMEMBERED = 3
_PATIENCE_S = (5.0, 12.0)

Choose = Callable[[Situation, npt.NDArray[np.bool_]], int | None]
"""(situation, bool (K,): the destinations not to choose) -> index of a destination, or None."""


def any_destination(situation: Situation, is_shut: npt.NDArray[np.bool_]) -> int | None:
    """Draw one of the destinations 3 to 40 m away.

    If there is none, return the nearest one farther away, else the farthest one within 3 m that is
    at least `least_trip_m` away.
    """
    distances_m = distances_to_destinations(situation)
    near = distances_m < _SHORTEST_TRIP_M
    usual = np.flatnonzero(~is_shut & ~near & (distances_m <= LONGEST_TRIP_M))
    if usual.size:
        return situation.drawn_from(usual)
    far = least(np.where(is_shut | near, np.inf, distances_m))
    if far is not None:
        return far
    return least(np.where(is_shut | (distances_m < least_trip_m(situation)), np.inf, -distances_m))


def least_trip_m(situation: Situation) -> float:
    """Return how far [m] a destination is at least; a nearer one could count as reached."""
    return max(_LEAST_TRIP_M, arrival_m(situation) + ARRIVE_WITHIN_M)


def distances_to_destinations(situation: Situation) -> npt.NDArray[np.float64]:
    """Return the distances (K,) [m] of the destinations from the artefact."""
    offsets_m = situation.places.destinations_m - np.array(situation.point_m)
    distances_m: npt.NDArray[np.float64] = np.hypot(offsets_m[:, 0], offsets_m[:, 1])
    return distances_m


def least(costs: npt.NDArray[np.float64]) -> int | None:
    """Return the index of the least finite cost, the first of equal ones; None if there is none."""
    best = int(costs.argmin()) if costs.size else 0
    return best if costs.size and np.isfinite(costs[best]) else None


class Trip:
    """The present destination of an artefact.

    It is given up when no way leads there, or when the artefact is blocked for longer than its
    patience, which each trip draws from 5 to 12 s. The last three destinations are not chosen again
    if there are others, and the last of them only if there is no other at all.
    """

    def __init__(self, choose: Choose = any_destination) -> None:
        self.goal_m: Point | None = None
        self._choose = choose
        self._recent_m: deque[Point] = deque(maxlen=_REMEMBERED)
        self._begun_ns = 0
        self._patience_s = 0.0

    def is_reached(self, situation: Situation) -> bool:
        """Return whether the destination is reached; if so, end the trip."""
        if not situation.has_reached(self.goal_m):
            return False
        self.give_up()
        return True

    def goal(self, situation: Situation) -> Point | None:
        """Return the destination, a new one if necessary; None if there is none."""
        if self._is_hopeless(situation):
            self.give_up()
        if self.goal_m is None:
            recent_m = [*self._recent_m]
            # On a map with few destinations, allow recent ones, at last the one given up just now.
            for shut_m in (recent_m, recent_m[-1:], []):
                index = self._choose(situation, _is_one_of(situation, shut_m))
                if index is not None:
                    self.change_to(index, situation)
                    break
        return self.goal_m

    def change_to(self, index: int, situation: Situation) -> None:
        """Begin a trip to this destination."""
        x_m, y_m = situation.places.destinations_m[index].tolist()
        self.goal_m = (x_m, y_m)
        self._begun_ns = situation.now_ns
        self._patience_s = situation.drawn_between(*_PATIENCE_S)

    def give_up(self) -> None:
        """End the trip; the next one has another destination."""
        if self.goal_m is not None:
            self._recent_m.append(self.goal_m)
        self.goal_m = None

    def shut(self, situation: Situation) -> npt.NDArray[np.bool_]:
        """Return which destinations, bool (K,), are recent ones."""
        return _is_one_of(situation, self._recent_m)

    def _is_hopeless(self, situation: Situation) -> bool:
        if not situation.wanted(self.goal_m):
            return False
        under_way_s = (situation.now_ns - self._begun_ns) / NS_PER_S
        blocked_s = min(situation.blocked_s, under_way_s)
        return situation.no_way or blocked_s > self._patience_s


def _is_one_of(situation: Situation, points_m: Iterable[Point]) -> npt.NDArray[np.bool_]:
    """Return which destinations, bool (K,), are among the points; on a new map perhaps none."""
    destinations_m = situation.places.destinations_m
    found = np.zeros(len(destinations_m), np.bool_)
    for point_m in points_m:
        found |= (destinations_m[:, 0] == point_m[0]) & (destinations_m[:, 1] == point_m[1])
    return found


# Journeys: trip after trip, with pauses.


SHORTEST_S, LONGEST_S = 1.0, 10.0
_MEAN_ABOVE_SHORTEST_S = 2.0
_ARRIVE_WITHIN_M = 0.5
_PAUSING, _NOWHERE_TO_GO = stand("pausing"), stand("nowhere to go")
_STOPPING = stand("standing")


def end_of_pause(situation: Situation) -> int:
    """Draw the end [ns] of a pause that begins now: 1 to 10 s, exponential beyond the first."""
    stream = situation.random
    length_s = SHORTEST_S + float(stream.exponential(_MEAN_ABOVE_SHORTEST_S))
    return situation.now_ns + seconds_to_ns(min(length_s, LONGEST_S))


class Journey(Trip):
    """The trips of an artefact, one after the other, its pauses, and its pace.

    It pauses until `paused_until_ns`. The pace is a share of the speed of its row.
    """

    def __init__(self, choose: Choose = any_destination) -> None:
        super().__init__(choose)
        self.paused_until_ns = 0
        self._pace: float | None = None

    def pace(self, situation: Situation, slowest: float) -> float:
        """Return the pace, which is drawn once from [slowest, 1)."""
        if self._pace is None:
            self._pace = situation.drawn_between(slowest, 1.0)
        return self._pace


class Walking:
    """Walks from destination to destination, with pauses at some of them.

    Each artefact draws its pace once: 80 to 100 % of the row's speed.
    """

    name: ClassVar[str] = "walking"
    pause_share: ClassVar[float] = 0.4
    slowest_pace: ClassVar[float] = 0.8

    def __init__(self, choose: Choose = any_destination, journey: Journey | None = None) -> None:
        """Draw destinations by `choose`; with `journey`, share that of another behaviour."""
        self.journey = journey or Journey(choose)
        self._intent: Intent | None = None

    def decide(self, situation: Situation) -> Intent:
        """Return the intent to walk, to pause, or to stand if there is no destination."""
        random, journey = situation.random, self.journey
        if journey.is_reached(situation) and random.random() < self.pause_share:
            journey.paused_until_ns = end_of_pause(situation)
        if situation.now_ns < journey.paused_until_ns:
            return _PAUSING
        goal_m = journey.goal(situation)
        if goal_m is None:
            return _NOWHERE_TO_GO
        if self._intent is None or self._intent.goal_m != goal_m:
            speed_mps, within_m = self.speed_mps(situation), arrival_m(situation)
            self._intent = Intent(goal_m, speed_mps, within_m, activity=self.name)
        return self._intent

    def change_destination(self) -> None:
        """Choose another destination at this decision."""
        self.journey.give_up()

    def forget_destination(self) -> None:
        """Choose a destination at this decision, perhaps the same."""
        self.journey.goal_m = None

    def speed_mps(self, situation: Situation) -> float:
        """Return the speed [m/s]."""
        return self.journey.pace(situation, self.slowest_pace) * situation.row.motion.speed_mps


class Running(Walking):
    """Runs from destination to destination, without pauses."""

    name: ClassVar[str] = "running"
    pause_share: ClassVar[float] = 0.0

    def speed_mps(self, situation: Situation) -> float:
        """Return the speed [m/s]."""
        return super().speed_mps(situation) * situation.row.motion.running_factor


class Driving(Walking):
    """Drives from destination to destination, as vehicles and robots do, and rarely pauses."""

    name: ClassVar[str] = "driving"
    pause_share: ClassVar[float] = 0.2


class Wandering(Walking):
    """Strolls from one destination to another near it, with many pauses."""

    name: ClassVar[str] = "wandering"
    pause_share: ClassVar[float] = 0.7
    slowest_pace: ClassVar[float] = 0.5
    _FASTEST: ClassVar[float] = 0.7
    """Share of the walking speed."""

    def __init__(self) -> None:
        super().__init__(_near_destination)

    def speed_mps(self, situation: Situation) -> float:
        """Return the speed [m/s]."""
        return self._FASTEST * super().speed_mps(situation)


class Stopping(Walking):
    """Stands on its way, until another behaviour takes its place."""

    name: ClassVar[str] = "stopping"

    def decide(self, situation: Situation) -> Intent:  # noqa: ARG002 - it always stands
        """Return the intent to stand; the destination is kept."""
        return _STOPPING


def arrival_m(situation: Situation) -> float:
    """Return within which distance [m] a goal counts as reached; vehicles need more."""
    return max(_ARRIVE_WITHIN_M, 0.5 * situation.row.motion.turn_radius_m)


def _near_destination(situation: Situation, is_shut: npt.NDArray[np.bool_]) -> int | None:
    """Draw one of the five nearest destinations that are a trip away."""
    distances_m = distances_to_destinations(situation)
    distances_m[is_shut | (distances_m < least_trip_m(situation))] = np.inf
    near = np.argsort(distances_m, kind="stable")[:5]
    near = near[np.isfinite(distances_m[near])]
    return situation.drawn_from(near) if near.size else None
