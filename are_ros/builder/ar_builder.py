"""The AR-builder (section 3.3): composes world, artefacts and augmentation into ticks."""

from are_ros.agents.events import ArtefactEvent, SceneMetrics
from are_ros.builder import assembly
from are_ros.builder.costmap.augmented_map import Grids
from are_ros.builder.costmap.registration import CoveredCells, clutter_ratio, covered_cells
from are_ros.builder.markers import NO_MARKERS, MarkerBatch
from are_ros.builder.observation import Observation, perceived_artefacts, sight_events
from are_ros.builder.scene import Scene
from are_ros.builder.simulation import Simulation
from are_ros.builder.tick import EVERYTHING, Demand, Tick
from are_ros.parameters.model import Parameters
from are_ros.population.catalogue import Catalogue
from are_ros.population.departures import Cause

_NAN = float("nan")


class ArBuilder(Simulation):
    """Augments the real environment with the artefacts, tick by tick.

    What happens does not depend on how often `step` is called. Time is integer nanoseconds; all
    outputs are in F_E, the map's frame. Knows no middleware, no file and no clock.
    """

    def __init__(
        self, parameters: Parameters, catalogue: Catalogue, demand: Demand = EVERYTHING
    ) -> None:
        super().__init__(parameters, catalogue)
        self.demand = demand
        self._watch = assembly.watch(parameters, self.robots, self._meshes)
        self._gate = assembly.gate(parameters)
        self._grids = assembly.grid_augmentation(parameters)
        self._display = assembly.display(parameters, self._meshes)
        self._surroundings = assembly.environment_display(parameters)
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
        self._sensors.prepare(environment)
        if self.demand.grids:
            self._grids.prepare(environment)
        if self.demand.markers and self._surroundings is not None:
            self._surroundings.prepare(environment.voxels)

    def prepare_camera(self) -> None:
        """Compute what another camera needs, so that the first tick that looks does not have to."""
        if self.camera is not None and self.demand.perception:
            self._watch.prepare_camera(self.camera, self.parameters.occlusion)

    def show_everything(self) -> None:
        """Give all markers at the next tick, after a DELETEALL: there is a new viewer."""
        self._is_redraw_due = True

    def farewell(self, now_ns: int) -> Tick:
        """Return the outputs without artefacts: the real grids, empty lists, a DELETEALL.

        The artefacts live on; the next tick gives everything again.
        """
        environment = self.world.environment
        self.show_everything()
        self._watch.forget()
        nothing, self._seen = Observation(), {}
        return Tick(
            stamp_ns=now_ns,
            frame_id=self.parameters.frames.map,
            scene=Scene.of((), now_ns),
            observer=self.robots.observer.name,
            perceived=(),
            events=tuple(self.lives.take_events()),
            metrics=self._metrics(0, nothing),
            markers=self._display.delete_all(),
            grids=self._grids.bare(now_ns, environment) if environment else Grids(),
            map_from_base=None,
            map_from_camera=None,
        )

    def restart(self, now_ns: int, cause: Cause = Cause.CLOCK_JUMPED_BACK) -> None:
        """Remove all artefacts, and forget what came later than `now_ns`: the clock jumped."""
        super().restart(now_ns, cause)
        self._watch.forget()

    def interrupt(self, from_ns: int, until_ns: int) -> None:
        """Skip a time in which nothing came in, and remove all artefacts before it."""
        super().interrupt(from_ns, until_ns)
        self._watch.forget()

    def reconfigure(self, parameters: Parameters, now_ns: int) -> None:
        """Use other values of the live parameters from `now_ns` on; the others are fixed.

        Raises ParameterError, and changes nothing, where the mixture is bad.
        """
        before = self.parameters
        self.advance(now_ns)
        self.lives.reconfigure(parameters, assembly.collision_resolver(parameters), now_ns)
        self.parameters = parameters
        self._sensors.reconfigure(parameters.sensors)
        self._grids.limit_rate(parameters.augmented_map.max_rate)
        if parameters.costmap != before.costmap:
            self._gate = assembly.gate(parameters)
        if parameters.markers != before.markers:
            self._display = assembly.display(parameters, self._meshes)
            self._surroundings = assembly.environment_display(parameters)

    def step(self, now_ns: int) -> Tick:
        """Run one tick: occlude, register, gate, augment (section 3.3)."""
        self.advance(now_ns)
        scene = self.lives.scene_at(now_ns)
        observation = self._observe(now_ns, scene)
        cells = self._register(scene)
        grids = self._augment(now_ns, observation, scene, cells)
        return Tick(
            stamp_ns=now_ns,
            frame_id=self.parameters.frames.map,
            scene=scene,
            observer=self.robots.observer.name,
            perceived=perceived_artefacts(scene, observation),
            events=self._events(now_ns, observation, scene),
            metrics=self._metrics(len(scene), observation),
            markers=self._draw(now_ns, scene, observation),
            grids=grids,
            map_from_base=observation.map_from_base,
            map_from_camera=observation.map_from_camera,
        )

    def _observe(self, now_ns: int, scene: Scene) -> Observation:
        """Occlusion: which artefacts the camera sees."""
        environment, camera = self.lives.environment, self.camera
        if environment is None or camera is None or not self.demand.perception:
            return self._watch.stand_by(now_ns)
        settings = self.parameters.occlusion
        observation = self._watch.observe(now_ns, camera, environment, scene, settings)
        self._sensors.perceived = frozenset(observation.sightings)
        return observation

    def _register(self, scene: Scene) -> CoveredCells | None:
        """Registration: the cells that each artefact covers; None before there is a map."""
        environment = self.lives.environment
        if environment is None:
            return None
        cells = covered_cells(scene.boxes, environment.grid)
        self._clutter_ratio = clutter_ratio(cells, environment.classes)
        return cells

    def _augment(
        self, now_ns: int, observation: Observation, scene: Scene, cells: CoveredCells | None
    ) -> Grids:
        """Augmentation of the grids with the artefacts that the gate admits."""
        environment, ids = self.lives.environment, scene.ids.tolist()
        admitted = self._gate.admitted(now_ns, observation.sightings, ids, observation.seen_ns)
        if environment is None or cells is None or not self.demand.grids:
            return Grids()
        places = {number: k for k, number in enumerate(ids)}
        patches = {i: cells.patch(places[i]) for i in admitted}
        return self._grids.update(now_ns, environment, patches)

    def _events(
        self, now_ns: int, observation: Observation, scene: Scene
    ) -> tuple[ArtefactEvent, ...]:
        labels = {artefact.id: artefact.row.label for artefact in scene.artefacts}
        seen = {i: labels[i] for i in observation.sightings}
        sights = sight_events(now_ns, self._seen, seen, labels)
        self._seen = seen
        return (*self.lives.take_events(), *sights)

    def _metrics(self, alive: int, observation: Observation) -> SceneMetrics:
        counts = self.lives.population.counts
        return SceneMetrics(
            alive=alive,
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

    def _draw(self, now_ns: int, scene: Scene, observation: Observation) -> MarkerBatch:
        if not self.demand.markers:
            return NO_MARKERS
        everything, self._is_redraw_due = self._is_redraw_due, False
        seen = observation.sightings
        markers = self._display.update(now_ns, scene, seen, everything=everything)
        environment = self.lives.environment
        if self._surroundings is None or environment is None:
            return markers
        return self._surroundings.added_to(markers, environment.voxels)
