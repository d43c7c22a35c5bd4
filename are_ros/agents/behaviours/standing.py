"""Standing: what cannot move, and what does not care to."""

from typing import ClassVar

from are_ros.agents.behaviours.situation import Intent, Situation, stand


class Standing:
    """Stays where it arrived, as it stood then."""

    name: ClassVar[str] = "standing"

    def decide(self, situation: Situation) -> Intent:  # noqa: ARG002 - nothing can change its mind
        """Return the intent to stand."""
        return stand("standing")
