"""What a replay keeps of its ticks, compactly: what the picture and the metrics are made of."""

import math
from array import array
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.artefact import GroundPose
from are_ros.artefacts.catalogue import Catalogue, CatalogueRow
from are_ros.builder.events import ArtefactEvent, EventKind
from are_ros.builder.outputs import SceneMetrics
from are_ros.builder.tick import Tick
from are_ros.world.footprint import Footprint
from are_ros.world.observer import Camera
from are_ros.world.view_models import ViewModel

Floats = npt.NDArray[np.float64]
Stamps = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Track:
    """Poses over time: stamps [ns] int64 (N,), poses float64 (N, K), read-only.

    The robot's are (x, y, yaw) of its base; the camera's (x, y, z) and the quaternion (x, y, z, w)
    of its optical frame. All in the map's frame, one for each tick that had one.
    """

    stamps_ns: Stamps
    poses: Floats

    def __post_init__(self) -> None:
        self.stamps_ns.flags.writeable = False
        self.poses.flags.writeable = False

    def __len__(self) -> int:
        """Count the poses."""
        return len(self.stamps_ns)


@dataclass(frozen=True, eq=False)
class Life:
    """One artefact from its arrival to its departure (None: none within the record).

    `footprints` is a track of the box's centre, (x, y, yaw), one pose per change; it is empty for
    a life between two ticks. `left_by` is the cause of the departure. `seen_ticks` counts the
    ticks that perceived it, of which `first_seen_ns` and `last_seen_ns` are the ends.
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

    @property
    def is_perceived(self) -> bool:
        """Whether it was ever perceived."""
        return self.seen_ticks > 0

    def is_present_at(self, t_ns: int) -> bool:
        """Say whether `t_ns` lies in [arrival, departure)."""
        return self.arrival_ns <= t_ns and (self.departure_ns is None or t_ns < self.departure_ns)

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
        """From the first tick to the last."""
        stamps = self.series.stamps_ns
        return int(stamps[-1] - stamps[0]) if len(stamps) else 0


@dataclass
class _Life:
    row: CatalogueRow
    arrival_ns: int
    departure_ns: int | None = None
    left_by: str = ""
    stamps_ns: "array[int]" = field(default_factory=lambda: array("q"))
    poses: "array[float]" = field(default_factory=lambda: array("d"))
    last_pose: GroundPose | None = None
    seen_ticks: int = 0
    first_seen_ns: int | None = None
    last_seen_ns: int | None = None

    def stand(self, stamp_ns: int, pose: GroundPose) -> None:
        if pose == self.last_pose:
            return
        self.last_pose = pose
        x_m, y_m, _ = self.row.box_centre_in_artefact_m
        cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        self.stamps_ns.append(stamp_ns)
        centre_m = (pose.x_m + cos * x_m - sin * y_m, pose.y_m + sin * x_m + cos * y_m)
        self.poses.extend((*centre_m, pose.yaw_rad))

    def see(self, stamp_ns: int) -> None:
        self.seen_ticks += 1
        self.last_seen_ns = stamp_ns
        if self.first_seen_ns is None:
            self.first_seen_ns = stamp_ns

    def finished(self, artefact_id: int) -> Life:
        return Life(
            artefact_id,
            self.row,
            self.arrival_ns,
            self.departure_ns,
            self.left_by,
            _track(self.stamps_ns, self.poses, 3),
            self.seen_ticks,
            self.first_seen_ns,
            self.last_seen_ns,
        )


class SceneRecorder:
    """Collects a `SceneRecord`, tick by tick."""

    def __init__(
        self, catalogue: Catalogue, *, seed: int, max_range_m: float, footprint: Footprint
    ) -> None:
        """Take the rows that the artefacts are of, and the robot's outline on its base."""
        self._rows = {row.label: row for row in catalogue.rows}
        self._seed, self._max_range_m, self._footprint = seed, max_range_m, footprint
        self._lives: dict[int, _Life] = {}
        self._events: list[ArtefactEvent] = []
        self._robot: tuple[array[int], array[float]] = (array("q"), array("d"))
        self._camera: tuple[array[int], array[float]] = (array("q"), array("d"))
        self._views: list[ViewModel] = []
        self._view_of_pose = array("q")
        self._series = (array("q"), array("q"), array("q"), array("d"))
        self._blind_ticks = 0
        self._metrics: SceneMetrics | None = None

    def add(self, tick: Tick, camera: Camera | None) -> None:
        """Take a tick, and the camera that it looked through (None: none is known)."""
        self._add_events(tick)
        for state in tick.artefacts:
            self._life(state.artefact_id, state.label, state.arrival_ns).stand(
                tick.stamp_ns, state.ground_pose
            )
        for seen in tick.perceived:
            if seen.artefact_id in self._lives:
                self._lives[seen.artefact_id].see(tick.stamp_ns)
        self._add_robot(tick)
        self._add_camera(tick, camera)
        metrics = self._metrics = tick.metrics
        values = (tick.stamp_ns, len(tick.artefacts), len(tick.perceived))
        for series, value in zip(self._series, (*values, metrics.clutter_ratio), strict=True):
            series.append(value)  # type: ignore[arg-type]

    def record(self) -> SceneRecord:
        """Return what was collected so far."""
        stamps, alive, perceived, clutter = (np.array(values) for values in self._series)
        return SceneRecord(
            seed=self._seed,
            max_range_m=self._max_range_m,
            footprint=self._footprint,
            robot=_track(*self._robot, 3),
            camera=_track(*self._camera, 7),
            views=tuple(self._views),
            view_of_pose=np.array(self._view_of_pose, dtype=np.int64),
            lives=tuple(self._lives[i].finished(i) for i in sorted(self._lives)),
            events=tuple(self._events),
            series=TickSeries(stamps, alive, perceived, clutter, self._blind_ticks),
            metrics=self._metrics,
        )

    def _add_events(self, tick: Tick) -> None:
        self._events.extend(tick.events)
        for event in tick.events:
            if event.kind is EventKind.ARRIVED:
                self._life(event.artefact_id, event.label, event.stamp_ns)
            elif event.kind is EventKind.DEPARTED and event.artefact_id in self._lives:
                life = self._lives[event.artefact_id]
                life.departure_ns, life.left_by = event.stamp_ns, event.detail

    def _life(self, artefact_id: int, label: str, arrival_ns: int) -> _Life:
        if artefact_id not in self._lives:
            self._lives[artefact_id] = _Life(self._rows[label], arrival_ns)
        return self._lives[artefact_id]

    def _add_robot(self, tick: Tick) -> None:
        if tick.map_from_base is not None:
            x_m, y_m, _ = tick.map_from_base.translation_m.tolist()
            self._robot[0].append(tick.stamp_ns)
            self._robot[1].extend((x_m, y_m, tick.map_from_base.yaw_rad()))

    def _add_camera(self, tick: Tick, camera: Camera | None) -> None:
        pose = tick.map_from_camera
        if pose is None:
            self._blind_ticks += 1
        elif camera is not None:
            if not self._views or self._views[-1] != camera.view:
                self._views.append(camera.view)
            self._camera[0].append(tick.stamp_ns)
            self._camera[1].extend((*pose.translation_m.tolist(), *pose.rotation_xyzw.tolist()))
            self._view_of_pose.append(len(self._views) - 1)


def _track(stamps_ns: "array[int]", poses: "array[float]", width: int) -> Track:
    stamps = np.array(stamps_ns, dtype=np.int64)
    return Track(stamps, np.array(poses, dtype=np.float64).reshape(-1, width))
