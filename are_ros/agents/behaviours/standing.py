"""The behaviour standing."""

from typing import ClassVar

from are_ros.agents.behaviours.situation import Intent, Situation, stand


class Standing:
    """Stays at its arrival pose."""

    name: ClassVar[str] = "standing"

    def decide(self, situation: Situation) -> Intent:  # noqa: ARG002 - it always stands
        """Return the intent to stand."""
        return stand("standing")
