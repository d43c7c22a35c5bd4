"""What a replay keeps of its ticks, compactly: what the picture and the metrics are made of."""

from array import array
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from are_ros.artefacts.catalogue import Catalogue, CatalogueRow
from are_ros.builder.outputs import ArtefactEvent, ArtefactState, EventKind, SceneMetrics
from are_ros.builder.tick import Tick
from are_ros.draw.scene import SceneRecord, TickSeries
from are_ros.replay.life_record import LifeRecorder, track_of
from are_ros.world.cameras import Camera, ViewModel
from are_ros.world.footprint import Footprint
from are_ros.world.rigid_transform import RigidTransform


@dataclass(frozen=True, eq=False)
class Moment:
    """What is kept of a tick: the ids perceived, the events since the last tick, and the poses."""

    stamp_ns: int
    artefacts: Sequence[ArtefactState]
    perceived: Sequence[int]
    events: Sequence[ArtefactEvent]
    metrics: SceneMetrics
    map_from_base: RigidTransform | None
    map_from_camera: RigidTransform | None


class SceneRecorder:
    """Collects a `SceneRecord`, tick by tick."""

    def __init__(
        self,
        catalogue: Catalogue,
        *,
        seed: int,
        max_range_m: float,
        footprint: Footprint,
        is_perceiving: bool = True,
    ) -> None:
        """Take the rows that the artefacts are of, and the robot's outline on its base.

        Where perception is left out (not `is_perceiving`), no tick counts as blind.
        """
        self._is_perceiving = is_perceiving
        self._rows = {row.label: row for row in catalogue.rows}
        self._seed, self._max_range_m, self._footprint = seed, max_range_m, footprint
        self._lives: dict[int, LifeRecorder] = {}
        self._events: list[ArtefactEvent] = []
        self._robot: tuple[array[int], array[float]] = (array("q"), array("d"))
        self._camera: tuple[array[int], array[float]] = (array("q"), array("d"))
        self._views: list[ViewModel] = []
        self._view_of_pose = array("q")
        self._counts: tuple[array[int], ...] = (array("q"), array("q"), array("q"))
        self._clutter = array("d")
        self._blind_ticks = 0
        self._metrics: SceneMetrics | None = None

    def know(self, row: CatalogueRow) -> None:
        """Take one more row that artefacts may be of."""
        self._rows.setdefault(row.label, row)

    def add(self, tick: Tick, camera: Camera | None) -> None:
        """Take a tick, and the camera that it looked through (None: none is known)."""
        moment = Moment(
            tick.stamp_ns,
            tick.artefacts,
            [seen.artefact_id for seen in tick.perceived],
            tick.events,
            tick.metrics,
            tick.map_from_base,
            tick.map_from_camera,
        )
        self.keep(moment, camera)

    def keep(self, moment: Moment, camera: Camera | None) -> None:
        """Take what is kept of a tick."""
        self._add_events(moment.events)
        for state in moment.artefacts:
            life = self._life(state.artefact_id, state.label, state.arrival_ns)
            life.stand(moment.stamp_ns, state.ground_pose)
            life.do(moment.stamp_ns, state.behaviour, state.activity)
        for seen in moment.perceived:
            if seen in self._lives:
                self._lives[seen].see(moment.stamp_ns)
        self._add_robot(moment)
        self._add_camera(moment, camera)
        self._metrics = moment.metrics
        counts = (moment.stamp_ns, len(moment.artefacts), len(moment.perceived))
        for series, value in zip(self._counts, counts, strict=True):
            series.append(value)
        self._clutter.append(moment.metrics.clutter_ratio)

    def record(self) -> SceneRecord:
        """Return what was collected so far."""
        stamps, alive, perceived = (np.array(values, dtype=np.int64) for values in self._counts)
        clutter = np.array(self._clutter, dtype=np.float64)
        return SceneRecord(
            seed=self._seed,
            max_range_m=self._max_range_m,
            footprint=self._footprint,
            robot=track_of(*self._robot, 3),
            camera=track_of(*self._camera, 7),
            views=tuple(self._views),
            view_of_pose=np.array(self._view_of_pose, dtype=np.int64),
            lives=tuple(self._lives[i].finished(i) for i in sorted(self._lives)),
            events=tuple(self._events),
            series=TickSeries(stamps, alive, perceived, clutter, self._blind_ticks),
            metrics=self._metrics,
        )

    def _add_events(self, events: Sequence[ArtefactEvent]) -> None:
        self._events.extend(events)
        for event in events:
            if event.kind is EventKind.ARRIVED and event.label in self._rows:
                self._life(event.artefact_id, event.label, event.stamp_ns)
            elif event.kind is EventKind.DEPARTED and event.artefact_id in self._lives:
                life = self._lives[event.artefact_id]
                life.departure_ns, life.left_by = event.stamp_ns, event.detail

    def _life(self, artefact_id: int, label: str, arrival_ns: int) -> LifeRecorder:
        if artefact_id not in self._lives:
            self._lives[artefact_id] = LifeRecorder(self._rows[label], arrival_ns)
        return self._lives[artefact_id]

    def _add_robot(self, moment: Moment) -> None:
        if moment.map_from_base is not None:
            x_m, y_m, _ = moment.map_from_base.translation_m.tolist()
            self._robot[0].append(moment.stamp_ns)
            self._robot[1].extend((x_m, y_m, moment.map_from_base.yaw_rad()))

    def _add_camera(self, moment: Moment, camera: Camera | None) -> None:
        pose = moment.map_from_camera
        if pose is None:
            self._blind_ticks += self._is_perceiving
        elif camera is not None:
            if not self._views or self._views[-1] != camera.view:
                self._views.append(camera.view)
            self._camera[0].append(moment.stamp_ns)
            self._camera[1].extend((*pose.translation_m.tolist(), *pose.rotation_xyzw.tolist()))
            self._view_of_pose.append(len(self._views) - 1)
