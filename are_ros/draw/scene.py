"""The record of a run, which all pictures and the viewer are drawn from: lives, poses, events.

A replay fills it from its ticks, a recording through the decoder (`replay.recorded_scene`).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import ArtefactEvent, SceneMetrics
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.conventions import IDLE_NS
from are_ros.population.artefact import GroundPose
from are_ros.population.catalogue import CatalogueRow
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.cameras import CameraAt, ViewModel
from are_ros.world.footprint import Footprint, signed_distance_m
from are_ros.world.rigid_transform import RigidTransform

Floats = npt.NDArray[np.float64]
Stamps = npt.NDArray[np.int64]

MOST_TICKS: Final = 900
"""The viewer shows at most so many ticks: of a longer run every second one, every fourth, ..."""
_RETURNS_OF_A_SCAN: Final = 240


def shown_every(ticks: int) -> int:
    """Return the power of two k such that every k-th of so many ticks is shown."""
    every = 1
    while -(-ticks // every) > MOST_TICKS:
        every *= 2
    return every


class ScanPoints(NamedTuple):
    """Where a scan ended, float32 (N, 3) [m] in the map's frame; which returns (N,) are virtual."""

    points_m: npt.NDArray[np.float32]
    is_virtual: npt.NDArray[np.bool_]

    def thinned(self) -> "ScanPoints":
        """Return at most 240 real and 240 virtual returns, evenly chosen."""
        kinds = np.flatnonzero(~self.is_virtual), np.flatnonzero(self.is_virtual)
        steps = (max(1, -(-len(kind) // _RETURNS_OF_A_SCAN)) for kind in kinds)
        kept = np.concatenate([kind[::step] for kind, step in zip(kinds, steps, strict=True)])
        return ScanPoints(self.points_m[kept], self.is_virtual[kept])


def scan_points(
    scan: LaserScan, received: LaserScan | None, map_from_sensor: RigidTransform
) -> ScanPoints:
    """Return where the beams end, thinned; without the scan as received none is virtual."""
    ends_m, returned = scan.returns()
    is_virtual: npt.NDArray[np.bool_] = np.zeros(len(scan.ranges), dtype=np.bool_)
    if received is not None and len(received.ranges) == len(scan.ranges):
        is_virtual = scan.ranges.view(np.uint32) != received.ranges.view(np.uint32)
    points_m = map_from_sensor.apply(ends_m)
    return ScanPoints(points_m.astype(np.float32), is_virtual[returned]).thinned()


class ArtefactAt(NamedTuple):
    """An artefact at a tick: `pose` is on the ground below F_A, in the map's frame."""

    artefact_id: int
    row: CatalogueRow
    pose: GroundPose
    behaviour: str
    activity: str
    arrival_ns: int


@dataclass(frozen=True, eq=False)
class Moment:
    """A tick as pictures need it; `perceived` are ids, a pose is None where it is not known.

    `events` are those since the tick before. `scans` has the newest scan of each laser since then.
    `map_from_camera` is the pose of the first camera; `others` are all others whose pose is known.
    """

    stamp_ns: int
    artefacts: Sequence[ArtefactAt]
    perceived: frozenset[int]
    map_from_base: RigidTransform | None
    map_from_camera: RigidTransform | None
    events: Sequence[ArtefactEvent] = ()
    metrics: SceneMetrics | None = None
    scans: Sequence[ScanPoints] = ()
    others: Sequence[CameraAt] = ()


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

    def transform_at(self, stamp_ns: int) -> RigidTransform | None:
        """Return the pose (K = 7) of this very stamp, None if there is none."""
        at = int(np.searchsorted(self.stamps_ns, stamp_ns))
        if at == len(self) or int(self.stamps_ns[at]) != stamp_ns:
            return None
        return RigidTransform(self.poses[at, :3], self.poses[at, 3:])

    def drives(self) -> npt.NDArray[np.int64]:
        """Return the number of the drive that each pose belongs to, int64 (N,), ascending from 0.

        Between two drives is a gap of the recording, in which the way is unknown.
        """
        steps_ns = np.diff(self.stamps_ns, prepend=self.stamps_ns[:1])
        return np.cumsum(steps_ns >= IDLE_NS)


class Doing(NamedTuple):
    """What an artefact does from `since_ns` on; an `activity` that is empty is its behaviour."""

    since_ns: int
    behaviour: str
    activity: str = ""


@dataclass(frozen=True, eq=False)
class Life:
    """One artefact from its arrival to its departure (None: none within the record).

    `footprints` is a track of the box's centre, (x, y, yaw), one pose per change; it is empty for
    a life between two ticks. `heights_m` are those of the ground below, one for each of these
    poses. `left_by` is the cause of the departure. `seen_ns` int64 (M,) are the stamps of the ticks
    that perceived it. `doings` has one entry per change, the first from its arrival. `absences_ns`
    are the [begin, end) in which no tick had it, as while the node paused.
    """

    artefact_id: int
    row: CatalogueRow
    arrival_ns: int
    departure_ns: int | None
    left_by: str
    footprints: Track
    seen_ns: Stamps
    doings: tuple[Doing, ...] = ()
    heights_m: Floats = field(default_factory=lambda: np.zeros(0))
    absences_ns: tuple[tuple[int, int], ...] = ()

    @property
    def is_perceived(self) -> bool:
        """Whether it was ever perceived."""
        return len(self.seen_ns) > 0

    def is_present_at(self, t_ns: int) -> bool:
        """Say whether `t_ns` lies in [arrival, departure), and in no absence."""
        lives = self.arrival_ns <= t_ns and (self.departure_ns is None or t_ns < self.departure_ns)
        return lives and not any(begin <= t_ns < end for begin, end in self.absences_ns)

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
        x_m, y_m, yaw_rad = self.footprints.poses[self._pose_index(t_ns)].tolist()
        return x_m, y_m, yaw_rad

    def footprints_at(self, stamps_ns: Stamps) -> Floats:
        """Return the same at many instants, float64 (N, 3); without a pose N is 0."""
        after = np.searchsorted(self.footprints.stamps_ns, stamps_ns, side="right")
        return self.footprints.poses[np.maximum(after - 1, 0)]

    def at(self, t_ns: int) -> ArtefactAt:
        """Return the artefact as it was at `t_ns`; there must be a pose."""
        x_m, y_m, yaw_rad = self.footprint_at(t_ns)
        ahead_m, left_m, _ = self.row.box_centre_in_artefact_m
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        x_m, y_m = x_m - (cos * ahead_m - sin * left_m), y_m - (sin * ahead_m + cos * left_m)
        z_m = float(self.heights_m[self._pose_index(t_ns)])
        doing = self.doing_at(t_ns)
        pose = GroundPose(x_m, y_m, z_m, yaw_rad)
        return ArtefactAt(self.artefact_id, self.row, pose, *doing[1:], self.arrival_ns)

    def _pose_index(self, t_ns: int) -> int:
        return max(int(np.searchsorted(self.footprints.stamps_ns, t_ns, side="right")) - 1, 0)


class LivesById:
    """The lives that have a pose, by id; a node that was started again gives ids another time."""

    def __init__(self, lives: Sequence[Life]) -> None:
        self._lives: dict[int, list[Life]] = {}
        for life in lives:
            if len(life.footprints):
                self._lives.setdefault(life.artefact_id, []).append(life)

    def at(self, artefact_id: int, t_ns: int) -> Life | None:
        """Return the last life of an id that had begun by then, else the first; None without."""
        known = self._lives.get(artefact_id)
        if known is None:
            return None
        return next((life for life in reversed(known) if life.arrival_ns <= t_ns), known[0])


@dataclass(frozen=True, eq=False)
class TickSeries:
    """One number per tick: how many lived, how many were perceived, nu of Eq. 4, and the stamps.

    Arrays int64 or float64 (ticks,), read-only; `blind_ticks` counts those at which no camera's
    pose was known; it is None where perception was left out.
    """

    stamps_ns: Stamps
    alive: npt.NDArray[np.int64]
    perceived: npt.NDArray[np.int64]
    clutter_ratio: Floats
    blind_ticks: int | None

    def passed_ns(self) -> Stamps:
        """Return the time since the first tick at each tick, int64 (ticks,), gaps left out."""
        steps_ns = np.diff(self.stamps_ns, prepend=self.stamps_ns[:1])
        return np.cumsum(np.where(steps_ns < IDLE_NS, steps_ns, 0))

    def __post_init__(self) -> None:
        for values in (self.stamps_ns, self.alive, self.perceived, self.clutter_ratio):
            values.flags.writeable = False


@dataclass(frozen=True, eq=False)
class SceneRecord:
    """A whole run. `views` and the index (M,) of the view of each camera pose go together.

    `metrics` are those of the last tick, None without ticks; `lives` are in the order of ids, and
    those of the same id in that of time.
    `base` has the same poses as `robot`, in 3D; `scans` has those of the ticks that the viewer
    shows, by stamp. `camera` is the first one; `others` are those of each tick, by stamp.
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
    base: Track = field(default_factory=lambda: Track(np.zeros(0, np.int64), np.zeros((0, 7))))
    scans: Mapping[int, Sequence[ScanPoints]] = field(default_factory=dict)
    others: Mapping[int, Sequence[CameraAt]] = field(default_factory=dict)

    @property
    def is_perceiving(self) -> bool:
        """Whether anybody looked for what is perceived; else that is not known."""
        return self.series.blind_ticks is not None

    @property
    def has_cameras(self) -> bool:
        """Whether the pose of any camera was ever known."""
        return bool(len(self.camera) or self.others)

    def robot_distances(self, life: Life) -> tuple[Stamps, Floats]:
        """Return how far the robot's footprint was from that of an artefact, seen from above.

        Stamps [ns] int64 (N,) of the ticks at which it was there and the robot's pose was known,
        and distances float64 (N,) [m]; where they overlap it is minus the depth.
        """
        stamps_ns, poses = self.robot.stamps_ns, self.robot.poses
        is_there = np.zeros(len(stamps_ns), np.bool_)
        if len(life.footprints):
            is_there = stamps_ns >= life.arrival_ns
            is_there &= life.departure_ns is None or stamps_ns < life.departure_ns
            for begin_ns, end_ns in life.absences_ns:
                is_there &= (stamps_ns < begin_ns) | (stamps_ns >= end_ns)
        stamps_ns, poses = stamps_ns[is_there], poses[is_there]
        boxes = life.footprints_at(stamps_ns)
        dx_m, dy_m, turns_rad = (boxes - poses).T
        cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        ahead_m, left_m = cos * dx_m + sin * dy_m, cos * dy_m - sin * dx_m
        half_sizes_m = np.tile(0.5 * np.array(life.row.size_m), (len(poses), 1))
        centres_m = np.column_stack((ahead_m, left_m, half_sizes_m[:, 2]))
        in_base = OrientedBoxes(centres_m, turns_rad, half_sizes_m)
        return stamps_ns, signed_distance_m(self.footprint, in_base)

    def moments(self, every: int = 1) -> Iterator[Moment]:
        """Yield every `every`-th tick from the first on, without events and metrics."""
        for stamp_ns in self.series.stamps_ns[::every].tolist():
            yield self.moment(stamp_ns)

    def moment(self, stamp_ns: int) -> Moment:
        """Return the tick of this very stamp, without events and metrics."""
        there = [
            life for life in self.lives if len(life.footprints) and life.is_present_at(stamp_ns)
        ]
        return Moment(
            stamp_ns,
            [life.at(stamp_ns) for life in there],
            frozenset(life.artefact_id for life in there if life.is_perceived_at(stamp_ns)),
            self.base.transform_at(stamp_ns),
            self.camera.transform_at(stamp_ns),
            scans=self.scans.get(stamp_ns, ()),
            others=self.others.get(stamp_ns, ()),
        )

    @property
    def duration_ns(self) -> int:
        """From the first tick to the last, without the gaps of the recording."""
        return int(self.series.passed_ns()[-1]) if len(self.series.stamps_ns) else 0
