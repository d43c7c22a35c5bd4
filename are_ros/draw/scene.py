"""What pictures are made of: a run as plain values, with artefacts, poses and events."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.builder.outputs import ArtefactEvent, SceneMetrics
from are_ros.builder.step_clock import IDLE_NS
from are_ros.world.cameras import ViewModel
from are_ros.world.footprint import Footprint

Floats = npt.NDArray[np.float64]
Stamps = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Track:
    """Poses over time: stamps [ns] int64 (N,), poses float64 (N, K), read-only.

    The robot's are (x, y, yaw) of its base; the camera's (x, y, z) and the quaternion (x, y, z, w)
    of its optical frame. All in the map's frame, one for each tick that had one.
    """

    stamps_ns: npt.NDArray[np.int64]
    poses: npt.NDArray[np.float64]

    def __post_init__(self) -> None:
        self.stamps_ns.flags.writeable = False
        self.poses.flags.writeable = False

    def __len__(self) -> int:
        """Count the poses."""
        return len(self.stamps_ns)

    def drives(self) -> npt.NDArray[np.int64]:
        """Return the number of the drive that each pose belongs to, int64 (N,), ascending from 0.

        Between two drives is a gap of the recording: nobody knows which way led across.
        """
        steps_ns = np.diff(self.stamps_ns, prepend=self.stamps_ns[:1])
        return np.cumsum(steps_ns >= IDLE_NS)


class Doing(NamedTuple):
    """What an artefact does from `since_ns` on; an `activity` that is empty is its behaviour."""

    since_ns: int
    behaviour: str
    activity: str = ""


def _never() -> npt.NDArray[np.int64]:
    return np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Life:
    """One artefact from its arrival to its departure (None: none within the record).

    `footprints` is a track of the box's centre, (x, y, yaw), one pose per change; it is empty for
    a life between two ticks. `left_by` is the cause of the departure. `seen_ticks` counts the
    ticks that perceived it, of which `first_seen_ns` and `last_seen_ns` are the ends, and `seen_ns`
    int64 (seen_ticks,) the stamps. `doings` has one entry per change, the first from its arrival.
    """

    artefact_id: int
    row: CatalogueRow
    arrival_ns: int
    departure_ns: int | None
    left_by: str
    footprints: Track
    seen_ticks: int
    first_seen_ns: int | None
    last_seen_ns: int | None
    seen_ns: npt.NDArray[np.int64] = field(default_factory=_never)
    doings: tuple[Doing, ...] = ()

    @property
    def is_perceived(self) -> bool:
        """Whether it was ever perceived."""
        return self.seen_ticks > 0

    def is_present_at(self, t_ns: int) -> bool:
        """Say whether `t_ns` lies in [arrival, departure)."""
        return self.arrival_ns <= t_ns and (self.departure_ns is None or t_ns < self.departure_ns)

    def is_perceived_at(self, stamp_ns: int) -> bool:
        """Say whether the tick of this very stamp perceived it."""
        at = int(np.searchsorted(self.seen_ns, stamp_ns))
        return at < len(self.seen_ns) and int(self.seen_ns[at]) == stamp_ns

    def doing_at(self, t_ns: int) -> Doing:
        """Return what it did at `t_ns`, held outside; a doing without names if none is known."""
        known = self.doings or (Doing(self.arrival_ns, ""),)
        begun = sum(doing.since_ns <= t_ns for doing in known)
        return known[max(begun - 1, 0)]

    def footprint_at(self, t_ns: int) -> tuple[float, float, float]:
        """Return (x, y, yaw) of the box's centre at `t_ns`, held outside; there must be a pose."""
        after = int(np.searchsorted(self.footprints.stamps_ns, t_ns, side="right"))
        x_m, y_m, yaw_rad = self.footprints.poses[max(after - 1, 0)].tolist()
        return x_m, y_m, yaw_rad


@dataclass(frozen=True, eq=False)
class TickSeries:
    """One number per tick: how many lived, how many were perceived, nu of Eq. 4, and the stamps.

    Arrays int64 or float64 (ticks,), read-only; `blind_ticks` counts those without a camera pose.
    """

    stamps_ns: Stamps
    alive: npt.NDArray[np.int64]
    perceived: npt.NDArray[np.int64]
    clutter_ratio: Floats
    blind_ticks: int

    def passed_ns(self) -> Stamps:
        """Return the time since the first tick at each tick, int64 (ticks,), gaps left out."""
        steps_ns = np.diff(self.stamps_ns, prepend=self.stamps_ns[:1])
        return np.cumsum(np.where(steps_ns < IDLE_NS, steps_ns, 0))

    def __post_init__(self) -> None:
        for values in (self.stamps_ns, self.alive, self.perceived, self.clutter_ratio):
            values.flags.writeable = False


@dataclass(frozen=True, eq=False)
class SceneRecord:
    """A whole replay. `views` and the index (M,) of the view of each camera pose go together.

    `metrics` are those of the last tick, None without ticks; `lives` are in the order of ids.
    """

    seed: int
    max_range_m: float
    footprint: Footprint
    robot: Track
    camera: Track
    views: tuple[ViewModel, ...]
    view_of_pose: npt.NDArray[np.int64]
    lives: tuple[Life, ...]
    events: tuple[ArtefactEvent, ...]
    series: TickSeries
    metrics: SceneMetrics | None

    @property
    def duration_ns(self) -> int:
        """From the first tick to the last, without the gaps of the recording."""
        return int(self.series.passed_ns()[-1]) if len(self.series.stamps_ns) else 0
