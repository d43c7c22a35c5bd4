"""Going from one destination to the next: walking, and what differs from it in a few numbers."""

from typing import ClassVar

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.behaviours.intent import Intent, stand
from are_ros.artefacts.behaviours.pause import Pause
from are_ros.artefacts.behaviours.situation import Situation
from are_ros.artefacts.behaviours.trip import (
    Choose,
    Trip,
    any_destination,
    distances_to_destinations,
)
from are_ros.conventions import seconds_to_ns

_ARRIVE_WITHIN_M = 0.5
_PAUSING, _NOWHERE_TO_GO = stand("pausing"), stand("nowhere to go")


class Walking:
    """Walks to a destination, pauses there at times, and goes on to another.

    Each has a pace of its own, 80 to 100 % of the row's speed, for all of its life.
    """

    name: ClassVar[str] = "walking"
    pause_share: ClassVar[float] = 0.4
    slowest_pace: ClassVar[float] = 0.8

    def __init__(self, choose: Choose = any_destination) -> None:
        self._trip = Trip(choose)
        self._pause = Pause()
        self._pace: float | None = None
        self._intent: Intent | None = None

    def decide(self, situation: Situation) -> Intent:
        """Return the intent to go on, to pause, or to stand where there is nowhere to go."""
        random = situation.random
        if self._trip.is_reached(situation) and random.random() < self.pause_share:
            self._pause.begin(situation.now_ns, random)
        if self._pause.holds(situation.now_ns):
            return _PAUSING
        goal_m = self._trip.goal(situation)
        if goal_m is None:
            return _NOWHERE_TO_GO
        if self._intent is None or self._intent.goal_m != goal_m:
            speed_mps, within_m = self.speed_mps(situation), arrival_m(situation)
            self._intent = Intent(goal_m, speed_mps, within_m, activity=self.name)
        return self._intent

    def change_destination(self) -> None:
        """Be on the way to somewhere else, from this decision on."""
        self._trip.give_up()

    def forget_destination(self) -> None:
        """Choose a destination in this decision, perhaps the same."""
        self._trip.goal_m = None

    def speed_mps(self, situation: Situation) -> float:
        """Return the speed it goes at."""
        if self._pace is None:
            self._pace = situation.drawn_between(self.slowest_pace, 1.0)
        return self._pace * situation.row.motion.speed_mps


class Running(Walking):
    """Runs from one destination to the next, without a pause."""

    name: ClassVar[str] = "running"
    pause_share: ClassVar[float] = 0.0

    def speed_mps(self, situation: Situation) -> float:
        """Return the speed it goes at."""
        return super().speed_mps(situation) * situation.row.motion.running_factor


class Driving(Walking):
    """Drives from one destination to the next, as vehicles and robots do, and rarely pauses."""

    name: ClassVar[str] = "driving"
    pause_share: ClassVar[float] = 0.2


class Wandering(Walking):
    """Strolls, from one place to another near it, with many pauses."""

    name: ClassVar[str] = "wandering"
    pause_share: ClassVar[float] = 0.7
    slowest_pace: ClassVar[float] = 0.5
    _FASTEST: ClassVar[float] = 0.7
    """Of a walk at the same pace."""

    def __init__(self) -> None:
        super().__init__(_near_destination)

    def speed_mps(self, situation: Situation) -> float:
        """Return the speed it goes at."""
        return self._FASTEST * super().speed_mps(situation)


class Stopping(Walking):
    """Walks, stops on its way every 4 to 15 s for a while, and goes on to where it was going."""

    name: ClassVar[str] = "stopping"
    _BETWEEN_STOPS_S: ClassVar[tuple[float, float]] = (4.0, 15.0)

    def __init__(self) -> None:
        super().__init__()
        self._stop_ns: int | None = None

    def decide(self, situation: Situation) -> Intent:
        """Return the intent to walk on, or to stand for a while."""
        now_ns = situation.now_ns
        if self._stop_ns is not None and now_ns >= self._stop_ns and not self._pause.holds(now_ns):
            self._pause.begin(now_ns, situation.random)
            self._stop_ns = None
        intent = super().decide(situation)
        if intent.goal_m is None:
            self._stop_ns = None  # a pause at a destination is a stop, too
        elif self._stop_ns is None:
            self._stop_ns = now_ns + seconds_to_ns(situation.drawn_between(*self._BETWEEN_STOPS_S))
        return intent


def arrival_m(situation: Situation) -> float:
    """Return how near to its goal an artefact has arrived: vehicles cannot stop on a point."""
    return max(_ARRIVE_WITHIN_M, 0.5 * situation.row.motion.turn_radius_m)


def _near_destination(situation: Situation, is_shut: npt.NDArray[np.bool_]) -> int | None:
    """Draw one of the five nearest destinations that are at least 1 m away."""
    distances_m = distances_to_destinations(situation)
    distances_m[is_shut | (distances_m < 1.0)] = np.inf
    near = np.argsort(distances_m, kind="stable")[:5]
    near = near[np.isfinite(distances_m[near])]
    return situation.drawn_from(near) if near.size else None
