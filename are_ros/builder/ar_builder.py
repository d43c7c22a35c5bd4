"""The AR-builder (section 3.3): composes world, artefacts and augmentation into ticks."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.catalogue import Catalogue
from are_ros.builder import assembly
from are_ros.builder.events import ArtefactEvent
from are_ros.builder.grids import Grids
from are_ros.builder.lives import Lives
from are_ros.builder.markers import Marker
from are_ros.builder.mesh_bank import MeshBank
from are_ros.builder.observation import Observation, sight_events
from are_ros.builder.outputs import ArtefactState, SceneMetrics
from are_ros.builder.real_world import RealWorld
from are_ros.builder.registration import CellPatch, clutter_ratio, covered_cells
from are_ros.builder.scans import ScanAugmentation
from are_ros.builder.scene import Scene
from are_ros.builder.sensor_path import ReleasedScan, SensorPathCounts
from are_ros.builder.states import StateKeeper, perceived_artefact
from are_ros.builder.tick import EVERYTHING, Demand, Tick
from are_ros.conventions import NS_PER_S
from are_ros.errors import InputError
from are_ros.parameters.choices import CameraModel, OdometryUse
from are_ros.parameters.model import Parameters
from are_ros.world.environment import Environment
from are_ros.world.frame_tree import FrameTree, TransformSource
from are_ros.world.laser_scan import LaserScan
from are_ros.world.observer import Camera
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import Values

_NAN = float("nan")
_BEFORE_ALL_NS: Final = -(2**63)
_CLOCK_JITTER_NS: Final = NS_PER_S // 10
"""Inputs that come out of order by no more than this are taken as if they came now."""
_ODOMETRY_SOURCES: Final = {
    OdometryUse.AUTO: TransformSource.ODOMETRY,
    OdometryUse.USE: TransformSource.PREFERRED_ODOMETRY,
}


class ArBuilder:
    """The real environment and the artefacts become what is perceived, tick by tick.

    Inputs come in through the `receive_...` methods, in the order of the time at which they were
    received; whatever is due before that time happens first, with what was known before. So
    what happens does not depend on how often `step` is called. Bad input raises InputError or
    FrameError and changes nothing. Time is integer nanoseconds; all outputs are in F_E, the map's
    frame. Knows no middleware, no file and no clock.
    """

    def __init__(
        self, parameters: Parameters, catalogue: Catalogue, demand: Demand = EVERYTHING
    ) -> None:
        self.parameters = parameters
        self.demand = demand
        self.notices: list[str] = []
        self.frames = FrameTree()
        self.world = RealWorld(parameters.world, parameters.frames.map, self.frames, self.notices)
        self.robots = assembly.robot_tracker(parameters, self.frames)
        resolver = assembly.collision_resolver(parameters)
        self.lives = Lives(parameters, catalogue, self.world, self.robots, resolver)
        self._meshes = MeshBank()
        self.camera: Camera | None = assembly.default_camera(parameters)
        self._watch = assembly.watch(parameters, self.robots, self._meshes)
        self._gate = assembly.gate(parameters)
        self._grids = assembly.grid_augmentation(parameters)
        self._display = assembly.display(parameters, self._meshes)
        self._scans = ScanAugmentation(parameters, self.frames, self.lives, self._meshes)
        self._seen: dict[int, str] = {}
        self._states = StateKeeper()
        self._registered: tuple[Environment | None, Scene | None, dict[int, CellPatch]]
        self._registered = (None, None, {})
        self._clutter_ratio = _NAN
        self._now_ns = _BEFORE_ALL_NS
        self._idle_until_ns = _BEFORE_ALL_NS
        assembly.set_static_frames(parameters, self.frames)

    # ------------------------------------------------------------------------------ inputs

    def receive_map(self, grid: OccupancyGrid, received_ns: int) -> None:
        """Take the real map M2D, which must be in the map's frame."""
        self._received(received_ns)
        if grid.frame_id != self.parameters.frames.map:
            wanted = self.parameters.frames.map
            raise InputError(f"map: its frame is '{grid.frame_id}', but frames.map is '{wanted}'")
        self.world.set_grid(grid)
        self._settle(received_ns)

    def receive_cloud(
        self,
        centres_m: npt.NDArray[np.floating],
        frame_id: str,
        received_ns: int,
        voxel_size_m: float | None = None,
        stamp_ns: int | None = None,
    ) -> None:
        """Take the centres (N, 3) of M3D's occupied voxels, in any frame of the tree.

        The frame's pose is that at the stamp where it is known, else (None, or too long ago) the
        newest; a frame that is not known yet is waited for.
        """
        self._received(received_ns)
        self.world.set_cloud(centres_m, voxel_size_m, frame_id, stamp_ns)
        self._settle(received_ns)

    def receive_transform(
        self,
        parent: str,
        child: str,
        stamp_ns: int,
        translation_m: Values,
        rotation_xyzw: Values,
        received_ns: int,
        *,
        is_static: bool = False,
    ) -> None:
        """Take one transform of /tf or /tf_static."""
        self._received(received_ns)
        if is_static:
            self.frames.set_static(parent, child, translation_m, rotation_xyzw)
        else:
            self.frames.set_transform(parent, child, stamp_ns, translation_m, rotation_xyzw)
        self._scans.transforms_came(received_ns)

    def receive_odometry(
        self,
        parent: str,
        child: str,
        stamp_ns: int,
        translation_m: Values,
        rotation_xyzw: Values,
        received_ns: int,
    ) -> None:
        """Take a pose from odometry; an empty child frame means the robot's base."""
        self._received(received_ns)
        source = _ODOMETRY_SOURCES.get(self.parameters.frames.odometry)
        if source is None:
            return
        child = child or self.robots.base_frame()
        self.frames.set_transform(
            parent, child, stamp_ns, translation_m, rotation_xyzw, source=source
        )
        self._scans.transforms_came(received_ns)

    def receive_camera(self, camera: Camera, received_ns: int) -> None:
        """Take the view model of the robot's camera, from its CameraInfo."""
        self._received(received_ns)
        self.camera = assembly.chosen_camera(self.parameters, camera)

    def receive_scan(self, topic: str, scan: LaserScan, received_ns: int) -> None:
        """Take a laser scan; it comes back, augmented, from `take_scans`."""
        self._received(received_ns)
        self._scans.push(topic, scan, received_ns)
        self._idle_until_ns = received_ns

    def take_scans(self) -> list[ReleasedScan]:
        """Return the scans that have left the sensor path since the last call."""
        return self._scans.take()

    @property
    def looks(self) -> int:
        """How often the camera's pose was known when it was time to look."""
        return self._watch.looks

    def await_camera(self) -> None:
        """Perceive nothing before the first CameraInfo, unless the parameters are the camera."""
        if self.parameters.camera.model is CameraModel.AUTO:
            self.camera = None

    def scan_counts(self) -> Mapping[str, SensorPathCounts]:
        """Return how the scans of each topic have left so far."""
        return self._scans.counts()

    def scan_problems(self) -> Mapping[str, str]:
        """Return why the last scan of a topic that passed through unaugmented did."""
        return self._scans.problems()

    # ------------------------------------------------------------------------------ time

    def advance(self, now_ns: int) -> None:
        """Let happen what is due up to `now_ns`: lives, motion, collisions, waiting scans."""
        if now_ns < self._idle_until_ns:
            self._check_clock(now_ns)
            return
        self._now_ns = max(self._now_ns, now_ns)
        while (deadline_ns := self._scans.next_deadline_ns()) is not None:
            if deadline_ns > now_ns:
                break
            self.lives.advance(deadline_ns)
            self._scans.deadline_passed(deadline_ns)
        self.lives.advance(now_ns)
        self._idle_until_ns = self._next_due_ns()

    def prepare(self) -> None:
        """Make ready what a new map costs, so that the next tick need not."""
        environment = self.world.environment
        if environment is None:
            return
        environment.prepare()
        if self.demand.perception:
            self._watch.prepare(environment)
        if self.demand.grids:
            self._grids.prepare(environment)

    def finish(self, now_ns: int) -> None:
        """Let the scans go that still wait: the inputs have ended."""
        self.advance(now_ns)
        self._scans.flush(now_ns)

    def step(self, now_ns: int) -> Tick:
        """Run one tick: register, occlude, gate, augment (section 3.3)."""
        self.advance(now_ns)
        scene = self.lives.scene_at(now_ns)
        states = self._states.states(scene.artefacts, now_ns)
        observation = self._observe(now_ns, scene)
        patches = self._register(scene)
        grids = self._augment(now_ns, observation, patches)
        return Tick(
            stamp_ns=now_ns,
            frame_id=self.parameters.frames.map,
            artefacts=tuple(states),
            observer=self.robots.observer.name,
            perceived=tuple(
                perceived_artefact(
                    state, observation.sightings[state.artefact_id], observation.seen_ns
                )
                for state in states
                if state.artefact_id in observation.sightings
            ),
            events=self._events(now_ns, observation, scene),
            metrics=self._metrics(observation, patches),
            markers=self._draw(now_ns, scene, states, observation),
            grids=grids,
            map_from_base=observation.map_from_base,
            map_from_camera=observation.map_from_camera,
        )

    def _settle(self, received_ns: int) -> None:
        """Let artefacts make way for a new environment; what is due may have changed with it."""
        self.lives.settle(received_ns)
        self._idle_until_ns = received_ns

    def _next_due_ns(self) -> int:
        """Return the time before which nothing is due unless an input comes."""
        deadline_ns = self._scans.next_deadline_ns()
        due_ns = self.lives.next_due_ns()
        return due_ns if deadline_ns is None else min(due_ns, deadline_ns)

    def _check_clock(self, now_ns: int) -> None:
        """Start anew when the clock has jumped back, as it does when a recording loops."""
        if now_ns >= self._now_ns - _CLOCK_JITTER_NS:
            self._now_ns = max(self._now_ns, now_ns)
            return
        self.notices.append(
            f"the clock jumped back by {(self._now_ns - now_ns) / NS_PER_S:.3f} s: "
            "all artefacts are gone, and later transforms and scans are forgotten"
        )
        self._now_ns = now_ns
        self.frames.forget_after(now_ns)
        self.robots.forget()
        self.lives.restart(now_ns)
        self._scans.clear()
        self._watch.forget()
        self._idle_until_ns = now_ns

    def _received(self, received_ns: int) -> None:
        """Let happen what was due before an input that is about to be taken."""
        self.advance(received_ns)
        self.lives.touch(received_ns)

    def _observe(self, now_ns: int, scene: Scene) -> Observation:
        """Occlusion: which artefacts the camera sees."""
        environment, camera = self.world.environment, self.camera
        if environment is None or camera is None or not self.demand.perception:
            return self._watch.stand_by(now_ns)
        settings = self.parameters.occlusion
        observation = self._watch.observe(now_ns, camera, environment, scene, settings)
        self._scans.perceived = frozenset(observation.sightings)
        return observation

    def _register(self, scene: Scene) -> dict[int, CellPatch]:
        """Registration: the cells that each artefact covers, by id."""
        environment = self.world.environment
        if environment is None:
            return {}
        if self._registered[:2] != (environment, scene):
            patches = covered_cells(scene.boxes, environment.grid)
            by_id = {a.id: patch for a, patch in zip(scene.artefacts, patches, strict=True)}
            self._registered = (environment, scene, by_id)
            self._clutter_ratio = clutter_ratio(patches, environment.classes)
        return self._registered[2]

    def _augment(
        self, now_ns: int, observation: Observation, patches: Mapping[int, CellPatch]
    ) -> Grids:
        """Augmentation of the grids with the artefacts that the gate admits."""
        environment = self.world.environment
        admitted = self._gate.admitted(now_ns, observation.sightings, patches, observation.seen_ns)
        if environment is None or not self.demand.grids:
            return Grids()
        return self._grids.update(now_ns, environment, {i: patches[i] for i in admitted})

    def _events(
        self, now_ns: int, observation: Observation, scene: Scene
    ) -> tuple[ArtefactEvent, ...]:
        labels = {artefact.id: artefact.row.label for artefact in scene.artefacts}
        seen = {i: labels[i] for i in observation.sightings}
        sights = sight_events(now_ns, self._seen, seen, labels)
        self._seen = seen
        return (*self.lives.take_events(), *sights)

    def _metrics(self, observation: Observation, patches: Mapping[int, CellPatch]) -> SceneMetrics:
        counts = self.lives.population.counts
        return SceneMetrics(
            alive=len(patches),
            perceived=len(observation.sightings),
            arrivals=counts.arrived,
            departures=counts.departed,
            blocked=counts.blocked,
            displaced=self.lives.displaced,
            robot_contacts=self.lives.robot_contacts,
            area_m2=self.lives.area_m2,
            clutter_ratio=self._clutter_ratio,
            rho=_NAN,
        )

    def _draw(
        self,
        now_ns: int,
        scene: Scene,
        states: Sequence[ArtefactState],
        observation: Observation,
    ) -> tuple[Marker, ...]:
        if not self.demand.markers:
            return ()
        return self._display.update(now_ns, states, scene.rows, observation.sightings)
