"""What happens to a population: who came, who went, who could not come, and how many so far."""

from dataclasses import dataclass
from enum import Enum

from are_ros.artefacts.catalogue import CatalogueRow


class EventKind(Enum):
    """What happened to an artefact."""

    ARRIVED = "arrived"
    DEPARTED = "departed"
    BLOCKED = "blocked"
    LEAVING = "leaving"
    """Its life is over, and it walks to an exit: it departs there."""


class Cause(Enum):
    """Why an artefact departed or was blocked."""

    LIFE_OVER = "life_over"
    DISPLACED = "displaced"
    REMOVED = "removed"
    ROBOT_CONTACT = "robot_contact"
    CLOCK_JUMPED_BACK = "clock_jumped_back"
    CLOCK_LEAPT = "clock_leapt"
    RECORDING_GAP = "recording_gap"
    MAX_ALIVE = "max_alive"
    NO_PLACE = "no_place"
    REFUSED = "refused"
    NO_HIDDEN_PLACE = "no_hidden_place"
    """There is a place, but a camera sees each (population.appear: out_of_view)."""


@dataclass(frozen=True, eq=False)
class PopulationEvent:
    """One artefact came, went, or could not come, at `time_ns`; an arrival has no cause.

    `reason` says in words why one that was scripted is refused.
    """

    time_ns: int
    kind: EventKind
    artefact_id: int
    row: CatalogueRow
    cause: Cause | None = None
    reason: str = ""


@dataclass(frozen=True)
class Counts:
    """How many so far: offered = arrived + blocked, alive = arrived - departed.

    `displaced` are those of the departed who had to go for want of a safe pose: censored lives.
    """

    offered: int = 0
    arrived: int = 0
    blocked: int = 0
    departed: int = 0
    displaced: int = 0

    def after(self, event: PopulationEvent) -> "Counts":
        """Return the counts with one more event."""
        kind = event.kind
        return Counts(
            offered=self.offered + (kind in {EventKind.ARRIVED, EventKind.BLOCKED}),
            arrived=self.arrived + (kind is EventKind.ARRIVED),
            blocked=self.blocked + (kind is EventKind.BLOCKED),
            departed=self.departed + (kind is EventKind.DEPARTED),
            displaced=self.displaced + (event.cause is Cause.DISPLACED),
        )
