"""Collects the record of a run, tick by tick, compactly: for a replay, and for a recording."""

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import Final

import numpy as np

from are_ros.agents.events import ArtefactEvent, EventKind, SceneMetrics
from are_ros.builder.assembly import robot_footprint
from are_ros.builder.tick import Tick
from are_ros.draw.scene import (
    ArtefactAt,
    Doing,
    Life,
    Moment,
    ScanPoints,
    SceneRecord,
    TickSeries,
    Track,
    shown_every,
)
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import GroundPose
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.world.cameras import Camera, CameraAt, ViewModel
from are_ros.world.rigid_transform import RigidTransform

_COUNTS: Final = ("arrivals", "departures", "blocked", "displaced", "robot_contacts")
"""The metrics that count since the start of the node."""


@dataclass
class _Poses:
    """A `Track` that grows, of `width` numbers a pose."""

    width: int
    stamps_ns: "array[int]" = field(default_factory=lambda: array("q"))
    numbers: "array[float]" = field(default_factory=lambda: array("d"))

    def add(self, stamp_ns: int, *numbers: float) -> None:
        self.stamps_ns.append(stamp_ns)
        self.numbers.extend(numbers)

    def add_transform(self, stamp_ns: int, pose: RigidTransform) -> None:
        self.add(stamp_ns, *pose.translation_m.tolist(), *pose.rotation_xyzw.tolist())

    def track(self) -> Track:
        poses = np.array(self.numbers, dtype=np.float64).reshape(-1, self.width)
        return Track(np.array(self.stamps_ns, dtype=np.int64), poses)


@dataclass
class _LifeRecorder:
    """Collects a `Life`; a pose or a doing is kept only where it differs from the one before."""

    row: CatalogueRow
    arrival_ns: int
    departure_ns: int | None = None
    left_by: str = ""
    poses: _Poses = field(default_factory=lambda: _Poses(3))
    heights_m: "array[float]" = field(default_factory=lambda: array("d"))
    last_pose: GroundPose | None = None
    seen_ns: "array[int]" = field(default_factory=lambda: array("q"))
    doings: list[Doing] = field(default_factory=list)
    absences_ns: list[tuple[int, int]] = field(default_factory=list)
    absent_since_ns: int | None = None

    def stand(self, stamp_ns: int, pose: GroundPose) -> None:
        """Take the artefact's pose."""
        if pose == self.last_pose:
            return
        self.last_pose = pose
        x_m, y_m, _ = self.row.box_centre_in_artefact_m
        cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        centre_m = (pose.x_m + cos * x_m - sin * y_m, pose.y_m + sin * x_m + cos * y_m)
        self.poses.add(stamp_ns, *centre_m, pose.yaw_rad)
        self.heights_m.append(pose.z_m)

    def do(self, stamp_ns: int, behaviour: str, activity: str) -> None:
        """Take the artefact's behaviour and activity."""
        if not self.doings or self.doings[-1][1:] != (behaviour, activity):
            self.doings.append(Doing(stamp_ns, behaviour, activity))

    def miss(self, stamp_ns: int) -> None:
        """Take that a tick lacks the artefact, without an event: it may have left."""
        self.absent_since_ns = stamp_ns
        if self.departure_ns is None:
            self.departure_ns = stamp_ns

    def come_back(self, stamp_ns: int) -> None:
        """Take that a tick has the artefact that those before lacked."""
        if self.absent_since_ns is not None and not self.left_by:
            self.absences_ns.append((self.absent_since_ns, stamp_ns))
            self.absent_since_ns = self.departure_ns = None

    def finished(self, artefact_id: int) -> Life:
        """Return the life so far; it may have ended during an absence."""
        absences_ns, begin_ns = self.absences_ns, self.absent_since_ns
        if begin_ns is not None and self.departure_ns is not None and begin_ns < self.departure_ns:
            absences_ns = [*absences_ns, (begin_ns, self.departure_ns)]
        return Life(
            artefact_id,
            self.row,
            self.arrival_ns,
            self.departure_ns,
            self.left_by,
            self.poses.track(),
            np.array(self.seen_ns, dtype=np.int64),
            tuple(self.doings),
            np.array(self.heights_m, dtype=np.float64),
            tuple(absences_ns),
        )


class SceneRecorder:
    """Collects a `SceneRecord`, tick by tick.

    A node that is started again while it is recorded counts ids and metrics anew: what has an id
    and another arrival is another life, and counts that are lower than before are added to these.
    """

    def __init__(
        self, parameters: Parameters, catalogue: Catalogue, *, is_perceiving: bool = True
    ) -> None:
        """Take the parameters of the run; without perception ticks are not counted as blind."""
        self._is_perceiving, self._parameters = is_perceiving, parameters
        self._rows = {row.label: row for row in catalogue.rows}
        self._lives: dict[int, _LifeRecorder] = {}
        self._lives_before: list[tuple[int, _LifeRecorder]] = []
        """Those whose ids others have now."""
        self._counts_before = dict.fromkeys(_COUNTS, 0)
        self._events: list[ArtefactEvent] = []
        self._robot, self._base, self._camera = _Poses(3), _Poses(7), _Poses(7)
        self._views: list[ViewModel] = []
        self._view_of_pose = array("q")
        self._counts: tuple[array[int], ...] = (array("q"), array("q"), array("q"))
        self._clutter = array("d")
        self._blind_ticks = 0
        self._metrics: SceneMetrics | None = None
        self._scans: dict[int, Sequence[ScanPoints]] = {}
        self._newest_scans: Sequence[ScanPoints] = ()
        self._scans_every = 1
        self._others: dict[int, Sequence[CameraAt]] = {}
        self._present: set[int] = set()

    @property
    def wants_scans(self) -> bool:
        """Whether the viewer shows the next tick, as far as is known."""
        return len(self._clutter) % self._scans_every == 0

    def add(
        self,
        tick: Tick,
        camera: Camera | None,
        scans: Sequence[ScanPoints] = (),
        others: Sequence[CameraAt] = (),
    ) -> None:
        """Take a tick, the first camera (None: it is not known), and the others."""
        artefacts = [
            ArtefactAt(one.id, one.row, pose, behaviour, activity, one.arrival_ns)
            for one, pose, (_, behaviour, activity, _) in zip(
                tick.scene.artefacts, tick.scene.ground_poses, tick.scene.status, strict=True
            )
        ]
        moment = Moment(
            tick.stamp_ns,
            artefacts,
            frozenset(seen.artefact_id for seen in tick.perceived),
            tick.map_from_base,
            tick.map_from_camera,
            tick.events,
            tick.metrics,
            scans,
            others,
        )
        self.keep(moment, camera)

    def keep(self, moment: Moment, camera: Camera | None) -> None:
        """Take a tick in the form that is kept."""
        self._newest_scans = moment.scans or self._newest_scans
        if self._newest_scans and self.wants_scans:
            self._scans[moment.stamp_ns], self._newest_scans = self._newest_scans, ()
        for one in moment.artefacts:
            self._rows.setdefault(one.row.label, one.row)
        self._add_events(moment.events)
        for one in moment.artefacts:
            life = self._life(one.artefact_id, one.row, one.arrival_ns)
            life.stand(moment.stamp_ns, one.pose)
            life.do(moment.stamp_ns, one.behaviour, one.activity)
        self._end_absent(moment)
        for seen in moment.perceived:
            if seen in self._lives:
                self._lives[seen].seen_ns.append(moment.stamp_ns)
        self._add_robot(moment)
        self._add_camera(moment, camera)
        self._count(moment.metrics)
        counts = (moment.stamp_ns, len(moment.artefacts), len(moment.perceived))
        for series, value in zip(self._counts, counts, strict=True):
            series.append(value)
        self._clutter.append(moment.metrics.clutter_ratio if moment.metrics else 0.0)
        self._thin_scans()

    def record(self) -> SceneRecord:
        """Return the record so far."""
        stamps, alive, perceived = (np.array(values, dtype=np.int64) for values in self._counts)
        clutter = np.array(self._clutter, dtype=np.float64)
        blind_ticks = self._blind_ticks if self._is_perceiving else None
        lives = sorted((*self._lives_before, *self._lives.items()), key=itemgetter(0))
        return SceneRecord(
            seed=self._parameters.seed,
            max_range_m=self._parameters.occlusion.max_range,
            footprint=robot_footprint(self._parameters.robot),
            robot=self._robot.track(),
            camera=self._camera.track(),
            views=tuple(self._views),
            view_of_pose=np.array(self._view_of_pose, dtype=np.int64),
            lives=tuple(life.finished(number) for number, life in lives),
            events=tuple(self._events),
            series=TickSeries(stamps, alive, perceived, clutter, blind_ticks),
            metrics=self._all_metrics(),
            base=self._base.track(),
            scans=dict(self._scans),
            others=dict(self._others),
        )

    def _thin_scans(self) -> None:
        """Move scans of ticks that the viewer does not show in a run of this length to the next."""
        stamps, every = self._counts[0], shown_every(len(self._clutter))
        if every > self._scans_every:
            before, self._scans = self._scans, {}
            for number, stamp_ns in enumerate(stamps):
                shown = -(-number // every) * every
                if stamp_ns in before and shown < len(stamps):
                    self._scans[stamps[shown]] = before[stamp_ns]
            self._scans_every = every

    def _add_events(self, events: Sequence[ArtefactEvent]) -> None:
        self._events.extend(events)
        for event in events:
            if event.kind is EventKind.ARRIVED and event.label in self._rows:
                self._life(event.artefact_id, self._rows[event.label], event.stamp_ns)
            elif event.kind is EventKind.DEPARTED and event.artefact_id in self._lives:
                life = self._lives[event.artefact_id]
                life.departure_ns, life.left_by = event.stamp_ns, event.detail

    def _end_absent(self, moment: Moment) -> None:
        """End the lives that are missing in a tick without an event, as after a pause."""
        before, self._present = self._present, {one.artefact_id for one in moment.artefacts}
        for number in before - self._present:
            self._lives[number].miss(moment.stamp_ns)
        for number in self._present - before:
            self._lives[number].come_back(moment.stamp_ns)

    def _life(self, artefact_id: int, row: CatalogueRow, arrival_ns: int) -> _LifeRecorder:
        known = self._lives.get(artefact_id)
        if known is None or known.arrival_ns != arrival_ns:
            if known is not None:
                if known.departure_ns is None:
                    known.departure_ns = arrival_ns
                self._lives_before.append((artefact_id, known))
            self._lives[artefact_id] = _LifeRecorder(row, arrival_ns)
        return self._lives[artefact_id]

    def _count(self, metrics: SceneMetrics | None) -> None:
        """Take the metrics of a tick."""
        before = self._metrics
        if before is not None and metrics is not None and metrics.arrivals < before.arrivals:
            for name in _COUNTS:
                self._counts_before[name] += getattr(before, name)
        self._metrics = metrics

    def _all_metrics(self) -> SceneMetrics | None:
        """Return the metrics of the last tick, with the counts of earlier starts of the node."""
        last = self._metrics
        if last is None:
            return None
        counts = {name: getattr(last, name) + n for name, n in self._counts_before.items()}
        return replace(last, **counts)

    def _add_robot(self, moment: Moment) -> None:
        pose = moment.map_from_base
        if pose is not None:
            x_m, y_m, _ = pose.translation_m.tolist()
            self._robot.add(moment.stamp_ns, x_m, y_m, pose.yaw_rad())
            self._base.add_transform(moment.stamp_ns, pose)

    def _add_camera(self, moment: Moment, camera: Camera | None) -> None:
        pose = moment.map_from_camera
        if moment.others:
            self._others[moment.stamp_ns] = moment.others
        if pose is None:
            self._blind_ticks += not moment.others
        elif camera is not None:
            if not self._views or self._views[-1] != camera.view:
                self._views.append(camera.view)
            self._camera.add_transform(moment.stamp_ns, pose)
            self._view_of_pose.append(len(self._views) - 1)
