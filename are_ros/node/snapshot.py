"""What there is to say about a node at one moment, as plain values."""

from dataclasses import dataclass, field
from enum import Enum

from are_ros.node.busy_watch import BusyFigures
from are_ros.node.fault_watch import FaultSnapshot
from are_ros.node.input_watch import InputFigures
from are_ros.node.tick_watch import TickFigures


class NodeState(Enum):
    """The states of a lifecycle node in which it rests."""

    UNCONFIGURED = "unconfigured"
    INACTIVE = "inactive"
    ACTIVE = "active"
    FINALIZED = "finalized"


@dataclass(frozen=True)
class InputSnapshot:
    """An input: its role, the full name of its topic, and what came in."""

    role: str
    topic: str
    figures: InputFigures = field(default_factory=InputFigures)
    is_required: bool = False
    is_latched: bool = False
    """It comes once, or when it changes; so it never goes stale."""
    publishers: int = 0


@dataclass(frozen=True)
class ScanSnapshot:
    """How the scans of a topic left: in all, and as they came, without artefacts, of late."""

    topic: str
    exact: int = 0
    held: int = 0
    passed_through: int = 0
    passed_through_lately: int = 0
    """In the last 10 s."""
    last_problem: str = ""
    late_s: float = 0.0
    """How long after a scan its transform came, at most, of those that came too late lately."""


@dataclass(frozen=True)
class PopulationSnapshot:
    """The counts of the population since the start, and of arrivals in the last minute."""

    alive: int = 0
    arrivals: int = 0
    departures: int = 0
    blocked: int = 0
    displaced: int = 0
    arrivals_lately: int = 0
    blocked_lately: int = 0
    """Artefacts that found no place; `arrivals` holds none of them."""
    is_map_closed: bool = False
    """There is a map, but no free cell in it."""


@dataclass(frozen=True)
class ContactSnapshot:
    """The robot's contacts with artefacts: how many, and how long ago which was the last."""

    count: int = 0
    last: str = ""
    """As "person_adult 7, 0.05 m deep"."""
    last_age_s: float | None = None


@dataclass(frozen=True)
class NodeSnapshot:
    """The node at one moment. A problem is one sentence, empty where there is none.

    `active_s` is for how long the node has been active, 0 while it is not. `robot_problem` and
    `camera_problem` say why the pose of the robot or of its camera in the map is not known.
    """

    state: NodeState
    is_paused: bool = False
    active_s: float = 0.0
    uses_sim_time: bool = False
    is_without_clock: bool = False
    """It uses simulated time, and no /clock has come yet."""
    stamps_ahead_s: float | None = None
    """How much later than the node's time the newest transform is stamped; None without one."""
    inputs: tuple[InputSnapshot, ...] = ()
    robot_problem: str = ""
    camera_problem: str = ""
    cloud_problem: str = ""
    """Why the cloud of voxels that was received is not used yet."""
    ticks: TickFigures | None = None
    busy: BusyFigures = field(default_factory=BusyFigures)
    population: PopulationSnapshot = field(default_factory=PopulationSnapshot)
    contacts: ContactSnapshot = field(default_factory=ContactSnapshot)
    scans: tuple[ScanSnapshot, ...] = ()
    faults: FaultSnapshot = field(default_factory=FaultSnapshot)
