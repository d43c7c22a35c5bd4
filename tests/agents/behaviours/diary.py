"""Behaviours that write down what happens to them, named in catalogues as `module:Class`."""

from typing import ClassVar

from are_ros.agents.behaviours.situation import Intent, Point, Situation, stand

DIARY = "tests.agents.behaviours.diary:Diary"
STROLLER = "tests.agents.behaviours.diary:Stroller"
MARCHER = "tests.agents.behaviours.diary:Marcher"
EASTBOUND = "tests.agents.behaviours.diary:Eastbound"
ENTRIES: list[tuple[int, int, float]] = []
"""Time [ns], id and a random number of each decision, to be cleared by the test that reads it."""


class Diary:
    """Stands, and draws a number at each decision."""

    name: ClassVar[str] = "diary"

    def decide(self, situation: Situation) -> Intent:
        """Write down when, who, and what was drawn."""
        stream = situation.random
        ENTRIES.append((situation.now_ns, situation.me.id, float(stream.random())))
        return stand("writing")


class Stroller:
    """Goes to the destination that the number of each fourth decision names, and writes, too."""

    name: ClassVar[str] = "stroller"

    def __init__(self) -> None:
        self._goal_m: Point | None = None
        self._decisions = 0

    def decide(self, situation: Situation) -> Intent:
        """Draw one number, write it down, and go."""
        stream = situation.random
        number = float(stream.random())
        ENTRIES.append((situation.now_ns, situation.me.id, number))
        places_m = situation.places.destinations_m
        if self._decisions % 4 == 0:
            x_m, y_m = places_m[int(number * len(places_m))].tolist()
            self._goal_m = (x_m, y_m)
        self._decisions += 1
        return Intent(self._goal_m, situation.row.motion.speed_mps, activity="strolling")


class Marcher:
    """Goes to (8, 4), whatever comes."""

    name: ClassVar[str] = "marcher"

    def decide(self, situation: Situation) -> Intent:
        """Go there."""
        return Intent((8.0, 4.0), situation.row.motion.speed_mps, activity="marching")


class Eastbound:
    """Goes east to x = 40 m, in a lane of its own: 6 m from one id to the next."""

    name: ClassVar[str] = "eastbound"

    def decide(self, situation: Situation) -> Intent:
        """Go there."""
        return Intent((40.0, 6.0 * (situation.me.id + 1)), situation.row.motion.speed_mps)
