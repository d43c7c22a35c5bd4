"""The AR-builder (section 3.3): composes world, artefacts and augmentation into ticks."""

from collections.abc import Collection
from functools import partial

from are_ros.agents.events import ArtefactEvent, SceneMetrics
from are_ros.builder import assembly
from are_ros.builder.certainty.detector import Detector
from are_ros.builder.certainty.perception import Perception, View
from are_ros.builder.costmap.augmented_map import GateMemory, Grids
from are_ros.builder.costmap.augmented_octomap import AugmentedOctomap, Solid
from are_ros.builder.costmap.registration import (
    CellPatch,
    CoveredCells,
    clutter_ratio,
    covered_cells,
)
from are_ros.builder.markers import NO_MARKERS, EnvironmentDisplay, MarkerBatch, MarkerDisplay
from are_ros.builder.observation import Observation, Watch, perceived_artefacts, sight_events
from are_ros.builder.occlusion.meshes import MeshPool
from are_ros.builder.scene import Scene
from are_ros.builder.sensors.point_cloud import PointCloud
from are_ros.builder.simulation import Simulation
from are_ros.builder.tick import USUAL, Demand, Tick
from are_ros.conventions import seconds_to_ns
from are_ros.parameters.choices import CostmapGate, Shape
from are_ros.parameters.declaration import check_change
from are_ros.parameters.model import MarkersParameters, Parameters
from are_ros.population.catalogue import Catalogue
from are_ros.population.departures import Cause
from are_ros.world.environment import Environment
from are_ros.world.voxel_map import VoxelMap

_NAN = float("nan")


class ArBuilder(Simulation):
    """Augments the real environment with the artefacts, tick by tick.

    What happens does not depend on how often `step` is called. Time is integer nanoseconds; all
    outputs are in F_E, the map's frame. Knows no middleware, no file and no clock.
    """

    def __init__(
        self, parameters: Parameters, catalogue: Catalogue, demand: Demand = USUAL
    ) -> None:
        super().__init__(parameters, catalogue)
        self.demand = demand
        rates_hz, tick_rate_hz = parameters.camera.rates, parameters.builder.tick_rate
        self._watch = Watch(self.robots, self._meshes, rates_hz, tick_rate_hz)
        is_certain = not parameters.certainty.enabled
        self._detector = None if is_certain else Detector(parameters, catalogue)
        self._grids = assembly.grid_augmentation(parameters)
        self._octomap = AugmentedOctomap(parameters.augmented_map.max_rate)
        self._gate = GateMemory(seconds_to_ns(parameters.costmap.memory))
        self._use_display(parameters.markers)
        self._is_redraw_due = False
        self._seen: dict[int, str] = {}
        self._clutter_ratio = _NAN

    @property
    def looks(self) -> int:
        """How often the camera's pose was known when it was time to look."""
        return self._watch.looks

    def prepare(self) -> None:
        """Compute what a new map needs, so that the next tick does not have to."""
        environment = self.world.environment
        if environment is None:
            return
        environment.prepare()
        if self.demand.perception:
            self._watch.prepare(environment)
        self.sensors.prepare(environment)
        if self.demand.grids:
            self._grids.prepare(environment)
        voxels = environment.own_voxels
        if self.demand.octomap and voxels is not None:
            self._octomap.prepare(voxels)
        if self.demand.markers and self._surroundings is not None:
            self._surroundings.prepare(environment.voxels)

    @property
    def camera_missing(self) -> str:
        """Why the pose of a camera was not known when it was to look, empty if all were."""
        return self._watch.missing

    def prepare_cameras(self) -> None:
        """Compute what other cameras need, so that the first tick that looks does not have to."""
        if self.demand.perception:
            self._watch.prepare_cameras(self.cameras, self.parameters.occlusion)

    def show_everything(self) -> None:
        """Give all markers at the next tick, after a DELETEALL: there is a new viewer."""
        self._is_redraw_due = True

    def farewell(self, now_ns: int) -> Tick:
        """Return the outputs without artefacts: the real grids, empty lists, a DELETEALL.

        The artefacts live on; the next tick gives everything again.
        """
        environment, nobody = self.world.environment, Scene.of((), now_ns)
        step_ns = seconds_to_ns(self.parameters.certainty.prediction_step) if self._predicts else 0
        perception = Perception(now_ns, paths=() if self._predicts else None, step_ns=step_ns)
        self.show_everything()
        self._forget()
        self._register(nobody)
        self._seen = {}
        return Tick(
            stamp_ns=now_ns,
            frame_id=self.parameters.frames.map,
            scene=nobody,
            observer=self.robots.observer.name,
            perception=perception,
            events=tuple(self.lives.take_events()),
            metrics=self._metrics(0, 0),
            markers=self._display.delete_all(),
            grids=self._grids.bare(now_ns, environment) if environment else Grids(),
            octomap=self._bare_octomap(now_ns),
            map_from_base=None,
            map_from_camera=None,
        )

    def restart(self, now_ns: int, cause: Cause = Cause.CLOCK_JUMPED_BACK) -> None:
        """Remove all artefacts, and forget what came later than `now_ns`: the clock jumped."""
        super().restart(now_ns, cause)
        self._forget()

    def interrupt(self, from_ns: int, until_ns: int) -> None:
        """Skip a time in which nothing came in, and remove all artefacts before it."""
        super().interrupt(from_ns, until_ns)
        self._forget()

    def reseed(self, seed: int, now_ns: int) -> None:
        """Draw from another seed from now on; artefacts alive stay."""
        super().reseed(seed, now_ns)
        if self._detector is not None:
            self._detector.reseed(seed)

    def reconfigure(self, parameters: Parameters, now_ns: int) -> None:
        """Use other values of the live parameters from `now_ns` on; the others are fixed.

        Raises ParameterError, and changes nothing, where the mixture is bad, or another parameter
        than a live one differs.
        """
        before = self.parameters
        check_change(before, parameters)
        if self.has_begun:
            self.advance(now_ns)
        self.lives.reconfigure(parameters, assembly.collision_resolver(parameters), now_ns)
        self.parameters = parameters
        if self._detector is not None:
            self._detector.reconfigure(parameters)
        self.sensors.reconfigure(parameters)
        self._grids.limit_rate(parameters.augmented_map.max_rate)
        self._octomap.limit_rate(parameters.augmented_map.max_rate)
        self._gate.memory_ns = seconds_to_ns(parameters.costmap.memory)
        if parameters.markers != before.markers:
            self._use_display(parameters.markers)

    def _use_display(self, markers: MarkersParameters) -> None:
        meshes = self._meshes if markers.shape is Shape.MESH else None
        self._display = MarkerDisplay(markers.labels, meshes)
        self._surroundings = EnvironmentDisplay() if markers.environment else None

    def step(self, now_ns: int) -> Tick:
        """Run one tick: occlude, register, gate, augment (section 3.3)."""
        self.advance(now_ns)
        scene = self.lives.scene_at(now_ns)
        observation = self._observe(now_ns, scene)
        perception = self._perceive(now_ns, scene, observation)
        cells = self._register(scene)
        admitted = self._admit(now_ns, perception, scene)
        return Tick(
            stamp_ns=now_ns,
            frame_id=self.parameters.frames.map,
            scene=scene,
            observer=self.robots.observer.name,
            perception=perception,
            events=self._events(now_ns, perception, scene),
            metrics=self._metrics(len(scene), len(perception.artefacts)),
            markers=self._draw(now_ns, scene, perception),
            grids=self._augment(now_ns, perception, scene, cells, admitted),
            octomap=self._augment_octomap(now_ns, perception, scene, admitted),
            map_from_base=observation.map_from_base,
            map_from_camera=observation.map_from_camera,
        )

    def _observe(self, now_ns: int, scene: Scene) -> Observation:
        """Occlusion: which artefacts the cameras see."""
        environment, cameras = self.lives.environment, self.cameras
        if environment is None or not any(cameras) or not self.demand.perception:
            return self._watch.stand_by(now_ns)
        settings = self.parameters.occlusion
        return self._watch.observe(now_ns, cameras, environment, scene, settings)

    def _perceive(self, now_ns: int, scene: Scene, observation: Observation) -> Perception:
        """Certainty: A_f, or what a detector and a tracker make of it."""
        ids = observation.sightings.keys()
        if self._detector is None:
            perception = Perception(now_ns, perceived_artefacts(scene, observation))
        else:
            perception = self._detector.observe(now_ns, scene, self._views(observation))
            if self.parameters.certainty.applies_to_sensors:
                ids = perception.seen_ns.keys()
        if self.demand.perception:
            self.sensors.perceived = frozenset(ids)
        return perception

    @property
    def _predicts(self) -> bool:
        return self._detector is not None and self._detector.predicts

    def _views(self, observation: Observation) -> list[View] | None:
        """Return what the cameras look at whose pose is known, None between looks."""
        environment, settings = self.lives.environment, self.parameters.occlusion
        if observation.looks is None or environment is None:
            return None
        views = []
        for look in observation.looks:
            camera, pose = look.camera, look.map_from_camera
            if camera is not None and pose is not None:
                eye = self._watch.eyes[look.number]
                imagine = partial(eye.imagine, camera, pose, environment, settings)
                where_m, range_m = pose.translation_m[:2], settings.max_range
                views.append(
                    View(environment, imagine, where_m, range_m, look.period_s, look.sightings)
                )
        return views

    def _forget(self) -> None:
        """Forget what was seen."""
        self._watch.forget()
        if self._detector is not None:
            self._detector.forget()

    def _register(self, scene: Scene) -> CoveredCells | None:
        """Registration: the cells that each artefact covers; None before there is a map."""
        environment = self.lives.environment
        if environment is None:
            return None
        cells = covered_cells(scene.boxes, environment.grid)
        self._clutter_ratio = clutter_ratio(cells, environment.classes)
        return cells

    def _admit(self, now_ns: int, perception: Perception, scene: Scene) -> Collection[int]:
        """Gate: the ids of the artefacts that the maps show."""
        candidates = {*scene.ids.tolist(), *self._perceived_elsewhere(perception)}
        # What is seen while all are shown is remembered, too: the gate may change.
        admitted = self._gate.admitted(now_ns, perception.seen_ns, candidates)
        is_open = self.parameters.costmap.gate is CostmapGate.ALL
        return sorted(candidates) if is_open else admitted

    def _augment(
        self,
        now_ns: int,
        perception: Perception,
        scene: Scene,
        cells: CoveredCells | None,
        admitted: Collection[int],
    ) -> Grids:
        """Augmentation of the grids with the artefacts that the gate admits."""
        environment = self.lives.environment
        if environment is None or cells is None or not self.demand.grids:
            return Grids()
        perceived = self._perceived_cells(perception, environment)
        places = {number: k for k, number in enumerate(scene.ids.tolist())}
        patches = {i: perceived.get(i) or cells.patch(places[i]) for i in admitted}
        return self._grids.update(now_ns, environment, patches)

    def _augment_octomap(
        self, now_ns: int, perception: Perception, scene: Scene, admitted: Collection[int]
    ) -> PointCloud | None:
        """Augmentation of M3D with the same artefacts, in the shape that sensors meet."""
        voxels = _octomap_of(self.lives.environment)
        if not self.demand.octomap or voxels is None:
            self._octomap.forget()
            return None
        places = self._perceived_elsewhere(perception)
        there = scene.only(set(admitted).difference(places))
        shapes = self._meshes.shapes(there.rows, self.parameters.sensors.shape)
        columns = there.ids.tolist(), there.boxes.packed, shapes.indices.tolist()
        solids = [*map(Solid, *columns)]
        if places and perception.boxes is not None:
            rows = zip(places, perception.boxes.packed, strict=True)
            solids += [Solid(number, box, -1) for number, box in rows if number in admitted]
        map_frame = self.parameters.frames.map
        return self._octomap.update(now_ns, map_frame, voxels, solids, shapes.pool)

    def _bare_octomap(self, now_ns: int) -> PointCloud | None:
        """Return M3D without artefacts, if it is not what went out last, or is awaited."""
        voxels, octomap = _octomap_of(self.world.environment), self._octomap
        is_awaited = octomap.has_gone_out or self.demand.octomap
        if voxels is None or octomap.is_bare(voxels) or not is_awaited:
            return None
        self._octomap.forget()
        map_frame = self.parameters.frames.map
        return self._octomap.update(now_ns, map_frame, voxels, (), MeshPool.of([]))

    def _perceived_elsewhere(self, perception: Perception) -> tuple[int, ...]:
        """Return the ids of `perception.boxes`, which are perceived elsewhere than they are.

        There are none where the gate does not ask for what is perceived.
        """
        is_gated = self.parameters.costmap.gate is CostmapGate.PERCEIVED
        if perception.boxes is None or not is_gated:
            return ()
        return tuple(one.artefact_id for one in perception.artefacts)

    def _perceived_cells(
        self, perception: Perception, environment: Environment
    ) -> dict[int, CellPatch]:
        """Return the cells of what is perceived elsewhere than it is, by id."""
        ids = self._perceived_elsewhere(perception)
        if perception.boxes is None or not ids:
            return {}
        cells = covered_cells(perception.boxes, environment.grid)
        return {number: cells.patch(k) for k, number in enumerate(ids)}

    def _events(
        self, now_ns: int, perception: Perception, scene: Scene
    ) -> tuple[ArtefactEvent, ...]:
        """Return what happened to artefacts; of what is perceived only what is there."""
        labels = {artefact.id: artefact.row.label for artefact in scene.artefacts}
        seen = {i: labels[i] for i in perception.seen_ns if i in labels}
        sights = sight_events(now_ns, self._seen, seen, labels)
        self._seen = seen
        return (*self.lives.take_events(), *sights)

    def _metrics(self, alive: int, perceived: int) -> SceneMetrics:
        counts = self.lives.population.counts
        return SceneMetrics(
            alive=alive,
            perceived=perceived,
            arrivals=counts.arrived,
            departures=counts.departed,
            blocked=counts.blocked,
            displaced=self.lives.crowd.counts.displaced,
            robot_contacts=self.lives.crowd.contacts.count,
            area_m2=self.lives.area_m2,
            clutter_ratio=self._clutter_ratio,
        )

    def _draw(self, now_ns: int, scene: Scene, perception: Perception) -> MarkerBatch:
        if not self.demand.markers:
            return NO_MARKERS
        everything, self._is_redraw_due = self._is_redraw_due, False
        seen_ns = perception.seen_ns
        markers = self._display.update(now_ns, scene, seen_ns, everything=everything)
        environment = self.lives.environment
        if self._surroundings is None or environment is None:
            return markers
        return self._surroundings.added_to(markers, environment.voxels)


def _octomap_of(environment: Environment | None) -> VoxelMap | None:
    """Return M3D as it was received, None where there is only the map."""
    return None if environment is None else environment.own_voxels
