"""Behaviours that fail, each in a way of its own, named in catalogues as `module:Class`."""

import time
from typing import Any, ClassVar

from are_ros.agents.behaviours.situation import Intent, Situation, stand

MODULE = "tests.agents.behaviours.failing"


class Late:
    """Walks on for three decisions, and raises at the fourth."""

    name: ClassVar[str] = "late"

    def __init__(self) -> None:
        self._decisions = 0

    def decide(self, situation: Situation) -> Intent:
        """Go ahead."""
        self._decisions += 1
        if self._decisions > 3:
            raise ValueError("late boom\nand more of it")
        x_m, y_m = situation.point_m
        return Intent((x_m + 0.5, y_m), 0.5, activity="hurrying", is_moving_goal=True)


class Unmade:
    """Cannot be made."""

    name: ClassVar[str] = "unmade"

    def __init__(self) -> None:
        raise RuntimeError("no parts")

    def decide(self, situation: Situation) -> Intent:
        """Is never asked."""
        raise NotImplementedError


class Returns:
    """Returns what its class says."""

    name: ClassVar[str] = "returns"
    what: ClassVar[Any] = None

    def decide(self, situation: Situation) -> Any:  # noqa: ARG002 - it never changes its mind
        """Return that."""
        return self.what


class Sleeps:
    """Takes a second and a half for its first decision."""

    name: ClassVar[str] = "sleeps"

    def __init__(self) -> None:
        self._rest_s = 1.5

    def decide(self, situation: Situation) -> Intent:  # noqa: ARG002 - it never changes its mind
        """Stand, after a while."""
        time.sleep(self._rest_s)
        self._rest_s = 0.0
        return stand("rested")


class Hangs:
    """Never decides."""

    name: ClassVar[str] = "hangs"

    def decide(self, situation: Situation) -> Intent:
        """Look for an answer."""
        while situation.row:
            time.sleep(3600.0)
        raise NotImplementedError


class Helpless:
    """Lets something of are_ros raise."""

    name: ClassVar[str] = "helpless"

    def decide(self, situation: Situation) -> Intent:
        """Ask for the distance from nowhere."""
        nowhere: Any = None
        return stand(str(situation.distance_m(nowhere)))
