"""One artefact's life as a replay keeps it: when it came and went, where it stood, when seen."""

import math
from array import array
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.artefact import GroundPose
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.bag.stretches import GAP_NS


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
        return np.cumsum(steps_ns >= GAP_NS)


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


@dataclass
class LifeRecorder:
    """Collects a `Life`, tick by tick; `departure_ns` and `left_by` are set from outside."""

    row: CatalogueRow
    arrival_ns: int
    departure_ns: int | None = None
    left_by: str = ""
    stamps_ns: "array[int]" = field(default_factory=lambda: array("q"))
    poses: "array[float]" = field(default_factory=lambda: array("d"))
    last_pose: GroundPose | None = None
    seen_ns: "array[int]" = field(default_factory=lambda: array("q"))
    doings: list[Doing] = field(default_factory=list)

    def stand(self, stamp_ns: int, pose: GroundPose) -> None:
        """Say where the artefact stands; kept only if it is elsewhere than before."""
        if pose == self.last_pose:
            return
        self.last_pose = pose
        x_m, y_m, _ = self.row.box_centre_in_artefact_m
        cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        self.stamps_ns.append(stamp_ns)
        centre_m = (pose.x_m + cos * x_m - sin * y_m, pose.y_m + sin * x_m + cos * y_m)
        self.poses.extend((*centre_m, pose.yaw_rad))

    def do(self, stamp_ns: int, behaviour: str, activity: str) -> None:
        """Say what it does; kept only if it is something else than before."""
        if not self.doings or self.doings[-1][1:] != (behaviour, activity):
            self.doings.append(Doing(stamp_ns, behaviour, activity))

    def see(self, stamp_ns: int) -> None:
        """Say that a tick perceived it."""
        self.seen_ns.append(stamp_ns)

    def finished(self, artefact_id: int) -> Life:
        """Return the life as it is known so far."""
        return Life(
            artefact_id,
            self.row,
            self.arrival_ns,
            self.departure_ns,
            self.left_by,
            track_of(self.stamps_ns, self.poses, 3),
            len(self.seen_ns),
            self.seen_ns[0] if self.seen_ns else None,
            self.seen_ns[-1] if self.seen_ns else None,
            np.array(self.seen_ns, dtype=np.int64),
            tuple(self.doings),
        )


def track_of(stamps_ns: "array[int]", poses: "array[float]", width: int) -> Track:
    """Return the track of flat stamps and poses, `width` numbers each."""
    stamps = np.array(stamps_ns, dtype=np.int64)
    return Track(stamps, np.array(poses, dtype=np.float64).reshape(-1, width))
