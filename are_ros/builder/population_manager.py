"""The population in the real world: arrivals, departures and sub-steps in the order of time.

`PopulationManager.advance` runs the events of the population at their exact times, and the
sub-steps at multiples of `motion.step` since the epoch. A sub-step uses the inputs received before
it (environment, robot, goal), and fixes the poses of all artefacts until the next one. Events
between two sub-steps use the inputs of the first. So the result depends only on the seed and on
which inputs were received before which sub-step, not on how often `advance` is called. A pose that
has been returned for an instant never changes.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.registry import why_not
from are_ros.agents.collisions import CollisionResolver
from are_ros.agents.events import ArtefactEvent, EventKind
from are_ros.agents.local_planner.state import STAYS
from are_ros.agents.navigation.terrain import Terrains
from are_ros.agents.robots import RobotPose, RobotTracker
from are_ros.agents.scenario_recorder import ScenarioRecorder
from are_ros.agents.simulate import CrowdSimulator
from are_ros.agents.table import AgentTable
from are_ros.builder.files.scenario_file import read_scenario
from are_ros.builder.real_world import RealWorld
from are_ros.builder.scene import Scene
from are_ros.builder.spawning.spawner import OutOfView, Spawning, check_zones
from are_ros.conventions import IDLE_NS, NS_PER_S, seconds_to_ns
from are_ros.errors import BehaviourError, CatalogueError, PlacementError, ScenarioError
from are_ros.parameters.choices import Initial, Leave, Region
from are_ros.parameters.model import Parameters
from are_ros.population.arrivals import RandomSource
from are_ros.population.artefact import Artefact, GroundPose, Origin, boxes_of, on_ground
from are_ros.population.birth_death import BirthDeath
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.departures import Cause, departure_law
from are_ros.population.mixture import MixtureAmong, TruncatedPoissonMixture, mixture_of
from are_ros.population.population import EventKind as PopulationEventKind
from are_ros.population.population import Population, PopulationEvent
from are_ros.population.randomness import Purpose, generator
from are_ros.population.scenario import Scenario, ScriptedOffer, ScriptedSource
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.cameras import CameraAt
from are_ros.world.environment import Environment
from are_ros.world.footprint import Footprint


class StepClock:
    """The times of sub-steps: `next_ns` is a multiple of `period_ns` since the epoch [ns]."""

    def __init__(self, period_ns: int) -> None:
        self.period_ns = period_ns
        self.next_ns = 0
        self._last_input_ns = 0

    def touch(self, received_ns: int) -> None:
        """Note that an input was received."""
        self._last_input_ns = received_ns

    def begin(self, now_ns: int) -> None:
        """Set the first sub-step to the first multiple of the period that is not before now."""
        self.next_ns = -(-now_ns // self.period_ns) * self.period_ns

    def go_on(self, now_ns: int) -> None:
        """Go on to the next sub-step; after a long time without inputs, skip to `now_ns`."""
        step_ns, period_ns = self.next_ns, self.period_ns
        self.next_ns += period_ns
        if step_ns - self._last_input_ns >= IDLE_NS:
            self.next_ns = max(self.next_ns, now_ns // period_ns * period_ns + period_ns)

    @property
    def is_idle(self) -> bool:
        """Whether the last input is long ago at the next sub-step."""
        return self.next_ns - self._last_input_ns > IDLE_NS


_LAST_ID_IN_MASK: Final = 2**31 - 1
"""The pixels of masks are 32SC1."""
_PERSON: Final = (0.3, 0.3, 0.9, 0.0, 0.0)
"""The shape of a box, as `OrientedBoxes.standing` takes it [m], which stands for any artefact."""


class PopulationManager:
    """Runs the population and the crowd, and chooses where artefacts arrive."""

    def __init__(
        self,
        parameters: Parameters,
        catalogue: Catalogue,
        world: RealWorld,
        robots: RobotTracker,
        resolver: CollisionResolver,
    ) -> None:
        terrains = Terrains()
        self.crowd = CrowdSimulator(
            parameters, robots.observer.name, resolver, terrains, self.remove, self._overdue
        )
        self.population = population_of(
            parameters, catalogue, begun=self.crowd.begin, stays_on=self._stays_on
        )
        self.is_paused = False
        self._paused_ns = 0
        """When the pause began, or the population within it."""
        self._advanced_ns: int | None = None
        """Up to when it has run; None: it has not begun."""
        self.may_be_due = False
        """Whether something may be due sooner than `next_due_ns` said after the last `advance`."""
        self.goal: Footprint | None = None
        self.plan_m: npt.NDArray[np.float64] = np.empty((0, 2))
        self.viewpoints: Callable[[int], Sequence[CameraAt]] = lambda _: ()
        self._catalogue = catalogue
        self._parameters = parameters
        self._world = world
        self._robots = robots
        self._spawning = Spawning(parameters, robots.observer.footprint, terrains)
        self._steps = StepClock(seconds_to_ns(parameters.motion.step))
        self._robot: RobotPose | None = None
        self._viewpoints: Sequence[CameraAt] = ()
        self._environment: Environment | None = None
        self._scene = Scene.of((), 0)
        self._scene_ns = 0
        self._seed = parameters.seed
        self._beginnings = 0
        self._is_beginning = True
        self.crowd.decisions.by_exit = parameters.population.leave is Leave.BY_EXIT
        self.crowd.decisions.hides = self._hides

    @property
    def area_m2(self) -> float:
        """The area nu(M2D) [m^2] on which artefacts arrive, 0 before it is known."""
        return self._spawning.area_m2

    @property
    def doubt_about_region(self) -> str:
        """Where nobody can arrive at random though somebody should, and why; empty if nowhere."""
        return self._spawning.doubt_about_region if self._is_random else ""

    @property
    def awaits_robot(self) -> bool:
        """Whether somebody is to arrive at random, but where depends on the robot's first pose."""
        is_reachable = self._parameters.population.region is Region.REACHABLE
        return self._is_random and is_reachable and self._robot is None and self.area_m2 == 0.0

    @property
    def _is_random(self) -> bool:
        """Whether somebody is to arrive at random."""
        is_random = self.population.scripted.scenario.random
        return is_random and self._parameters.population.arrival_rate > 0.0

    def record_scenario(self) -> ScenarioRecorder:
        """Record the run as a scenario; call it before the first `advance`."""
        self.crowd.recorder = ScenarioRecorder(self._steps.period_ns)
        return self.crowd.recorder

    def report_faults_to(self, report: Callable[[BehaviourError], None]) -> None:
        """Stop an artefact whose behaviour fails and report the error, instead of raising it."""
        self.crowd.decisions.report_fault = report

    @property
    def environment(self) -> Environment | None:
        """The environment of the last sub-step; before the first one, the newest."""
        return self._environment or self._world.environment

    def scene_at(self, t_ns: int, arrived_by_ns: int | None = None) -> Scene:
        """Return the artefacts present at `t_ns` with their poses; the same object while all stand.

        With `arrived_by_ns`, only those that had arrived by that instant.
        """
        artefacts = self.population.present_at(t_ns)
        if arrived_by_ns is not None:
            artefacts = [one for one in artefacts if one.arrival_ns <= arrived_by_ns]
        all_stood = self.crowd.table.history.still_since_ns <= min(t_ns, self._scene_ns)
        if not all_stood or not self._scene.shows(artefacts):
            self._scene, self._scene_ns = Scene.of(artefacts, t_ns), t_ns
        return self._scene

    def take_events(self) -> list[ArtefactEvent]:
        """Return the events since the last call, in the order of time."""
        return self.crowd.take_events()

    def touch(self, received_ns: int) -> None:
        """Note that an input was received, so that sub-steps are not skipped."""
        self._steps.touch(received_ns)

    def advance(self, now_ns: int) -> None:
        """Run the population's events and the sub-steps that are due up to `now_ns`."""
        steps = self._steps
        if self._advanced_ns is None:
            self._start(now_ns)
            steps.begin(now_ns)
        self._advanced_ns, self.may_be_due = now_ns, False
        while True:
            event_ns = self._next_event_ns()
            if event_ns is not None and event_ns <= min(now_ns, steps.next_ns):
                for event in self.population.handle_next(self._find_place, self._admit):
                    self._apply(event)
            elif steps.next_ns <= now_ns:
                self._sub_step(steps.next_ns)
                steps.go_on(now_ns)
            else:
                return

    def next_due_ns(self) -> int:
        """Return when the next sub-step or event of the population is due."""
        step_ns, event_ns = self._steps.next_ns, self._next_event_ns()
        return step_ns if event_ns is None else min(step_ns, event_ns)

    def restart(self, now_ns: int, cause: Cause) -> None:
        """Remove all artefacts, with an event each, and go on at another time."""
        if self._advanced_ns is not None:
            self.population.halt(self._advanced_ns)
        self.clear(now_ns, cause)
        self._start(now_ns)
        self._go_on(now_ns)

    def interrupt(self, from_ns: int, until_ns: int) -> None:
        """Remove all artefacts at `from_ns`, and go on at `until_ns`: the recording has a gap.

        The wait for the next random arrival goes on after the gap; the scenario is postponed by it.
        """
        self.population.halt(from_ns)
        self.clear(from_ns, Cause.RECORDING_GAP)
        self.population.interrupt(from_ns, until_ns)
        if self.is_paused:  # of the pause count what is before the gap, and what is after it
            self.population.postpone(self._paused_ns, from_ns)
            self._paused_ns = until_ns
        if self.crowd.recorder is not None:
            self.crowd.recorder.postpone(until_ns - from_ns)
        self._go_on(until_ns)

    def _go_on(self, now_ns: int) -> None:
        """Go on after a jump: the robot, its plan and the past of the crowd are forgotten."""
        self.crowd.forget()
        self._is_beginning = True
        self._robot = self.goal = None
        self._viewpoints = ()
        self.plan_m = np.empty((0, 2))
        self._set_rates(now_ns)
        self._steps.touch(now_ns)
        self._steps.begin(now_ns)

    def _start(self, now_ns: int) -> None:
        self.population.start(now_ns)
        self._advanced_ns = self._paused_ns = now_ns
        if self.crowd.recorder is not None:
            self.crowd.recorder.start(now_ns)

    def clear(self, now_ns: int, cause: Cause = Cause.REMOVED) -> int:
        """Remove all artefacts, with an event each; return how many."""
        ids = list(self.population.living)
        for artefact_id in ids:
            self.remove(artefact_id, now_ns, cause)
        return len(ids)

    def remove(self, artefact_id: int, now_ns: int, cause: Cause = Cause.REMOVED) -> None:
        """Remove an artefact; InputError if none of this id is alive."""
        self._apply(self.population.remove(artefact_id, now_ns, cause))

    def reseed(self, seed: int, now_ns: int) -> None:
        """Draw from another seed from `now_ns` on; artefacts alive stay."""
        self._seed, self._beginnings, self.may_be_due = seed, 0, True
        self.population.reseed(seed, now_ns)
        self.crowd.decisions.reseed(seed)

    def pause(self, now_ns: int, *, is_paused: bool) -> None:
        """Stop or resume arrivals, lives and sub-steps; what is left of lives is kept."""
        if is_paused == self.is_paused:
            return
        self.is_paused = is_paused
        if is_paused:
            self._paused_ns = now_ns
        else:
            until_ns = max(now_ns, self._paused_ns)
            self.population.postpone(self._paused_ns, until_ns)
            self.crowd.table.postpone(self._paused_ns, until_ns)
        self._set_rates(now_ns)
        self.may_be_due = True

    def stand_still(self, from_ns: int, until_ns: int) -> None:
        """Go on at `until_ns`, as after a pause: nothing in between is simulated."""
        if not self.is_paused:
            self.pause(from_ns, is_paused=True)
            self.pause(until_ns, is_paused=False)
        self._steps.touch(until_ns)
        self._steps.begin(until_ns)

    def reconfigure(self, parameters: Parameters, resolver: CollisionResolver, now_ns: int) -> None:
        """Use other values of the live parameters from `now_ns` on.

        Raises ParameterError as `check`, and changes nothing then.
        """
        settings, law = parameters.population, self.check(parameters)
        self._spawning.reconfigure(parameters)
        self._parameters, self.crowd.resolver = parameters, resolver
        self.crowd.decisions.by_exit = settings.leave is Leave.BY_EXIT
        self.population.max_alive = settings.max_alive
        self.population.set_marks(self._catalogue.rows, law, settings.group_size)
        self._set_rates(now_ns)
        self.may_be_due = True

    def check(self, parameters: Parameters) -> TruncatedPoissonMixture:
        """Return the mixture of parameters that can be used now.

        Raises ParameterError where the mixture is bad, or the zones are lacking.
        """
        check_zones(parameters, self._spawning.zones)
        return mixture_of(parameters, self._catalogue)

    def place(
        self,
        row: CatalogueRow,
        pose: GroundPose,
        now_ns: int,
        *,
        life_ns: int | None = None,
        behaviour: str = "",
    ) -> int:
        """Add an artefact at exactly this pose, and return its id.

        Raises PlacementError if it cannot stand there or its life is negative, CatalogueError if it
        cannot have the behaviour, and changes nothing then.
        """
        if life_ns is not None and life_ns < 0:
            raise PlacementError(f"{row.label}: a life of {life_ns / NS_PER_S:g} s is negative")
        refusal = why_not(behaviour, row.motion.speed_mps) if behaviour else None
        if refusal is not None:
            raise CatalogueError(f"{row.label}: behaviour '{behaviour}' {refusal}")
        self.advance(now_ns)
        pose = GroundPose(*map(float, pose))  # of whole numbers, no box could be made
        environment, others = self._world.environment, self.crowd.table.taken
        box, robot = boxes_of([row], [pose]), self._robots.pose(now_ns) or self._robot
        reason = "there is no map yet"
        if environment is not None:
            reason = self._spawning.why_not(box, environment, others, robot)
            reason = reason or ("" if math.isfinite(pose.z_m) else "its height is not finite")
        if reason:
            raise PlacementError(f"{row.label} at {pose.x_m:.2f}, {pose.y_m:.2f}: {reason}")
        event = self.population.admit(row, pose, now_ns, life_ns=life_ns, behaviour=behaviour)
        self._apply(event)
        self.may_be_due = True
        return event.artefact_id

    def _next_event_ns(self) -> int | None:
        if self.is_paused:
            return None
        return self.population.next_event_ns()

    def _admit(self, offer: ScriptedOffer) -> GroundPose | str:
        """Return the pose of a scripted artefact, or the reason why it cannot stand there."""
        environment = self._environment
        if environment is None:
            return "there is no map yet"
        row, pose, others = offer.artefact.row, offer.pose, self.crowd.table.taken
        if offer.artefact.track is None:
            pose = on_ground(row, pose, environment)
        box, robot = boxes_of([row], [pose]), self._robot
        return self._spawning.why_not(box, environment, others, robot, 0.0) or pose

    def _find_place(
        self,
        row: CatalogueRow,
        random: np.random.Generator,
        near: tuple[float, float] | None,
        *,
        appears: bool = True,
    ) -> GroundPose | Cause:
        boxes, is_clear = self.crowd.table.taken, self.crowd.planner.is_clear
        spawning, robot = self._spawning, self._robot
        return spawning.place(row, random, boxes, robot, near, is_clear, appears=appears)

    def _begin(self, now_ns: int) -> None:
        """Have as many artefacts there as population.initial says.

        Those outside the law (scripted, placed, there for ever) take of the bound; who has come at
        random already, where the robot was known late, is one of the number.
        """
        settings = self._parameters.population
        self._is_beginning = False
        if settings.initial is Initial.EMPTY or not self.population.scripted.scenario.random:
            return
        law = mixture_of(self._parameters, self._catalogue)
        among = MixtureAmong(law, np.array([self._counts(row) for row in self._catalogue.rows]))
        living = self.population.living.values()
        present = sum(one.origin is Origin.RANDOM and not one.row.forever for one in living)
        bound = max(settings.max_alive - (len(living) - present), 0)
        chain = BirthDeath.of(settings, self._spawning.area_m2, among.share)
        stream = generator(self._seed, Purpose.INITIAL, self._beginnings)
        count = max(replace(chain, max_alive=bound).drawn(stream) - present, 0)
        self._beginnings += 1
        place = partial(self._find_place, appears=False)
        for event in self.population.populate(count, now_ns, place, among):
            self._apply(event)

    def _counts(self, row: CatalogueRow) -> bool:
        """Return whether the law of the number alive counts a row: it leaves, and it fits."""
        stream = generator(self._seed, Purpose.PLACE, 0)  # of nobody: the first id is 1
        return not row.forever and self._spawning.fits(row, stream)

    def _sub_step(self, step_ns: int) -> None:
        """Read the inputs (environment, robot, goal, cameras), and run a sub-step of the crowd."""
        self._world.retry_cloud()
        # If the robot's pose is not known now, use that of the last sub-step, not one that a tick
        # has read since: the result must not depend on when ticks run.
        self._robot = self._robots.pose(step_ns) or self._robot
        self._environment = self._world.environment
        self._spawning.goal = self.goal
        if self._environment is None:
            return
        spawning = self._spawning
        if spawning.needs_viewpoints:
            self._viewpoints = self.viewpoints(step_ns) or self._viewpoints
        was_known = spawning.area_m2 > 0.0
        if spawning.refresh(self._environment, self._robot, self._viewpoints):
            self._set_rates(step_ns)
        is_known = was_known and spawning.area_m2 > 0.0 and self._robot is not None
        # Not in the first step: the scenario comes before.
        if self._is_beginning and is_known and not self.is_paused:
            self._begin(step_ns)
        self.population.scripted.open(step_ns)
        goes_on = bool(self.population.living) and not (self.is_paused or self._steps.is_idle)
        if goes_on:
            self.crowd.enter(self._environment, spawning.region, spawning.zones)
            self.crowd.step(step_ns, self._environment, self._robot, self.plan_m)

    def _set_rates(self, now_ns: int) -> None:
        """Set the rates of the parameters; the arrival rate is 0 before the region is known."""
        settings, area_m2 = self._parameters.population, self._spawning.area_m2
        rate, mean_life_s = settings.arrival_rate, settings.mean_life
        if not self.population.scripted.scenario.random:
            rate = 0.0
        if self.is_paused:
            rate, mean_life_s = 0.0, float("inf")
        self.population.set_rates(rate, area_m2, mean_life_s, now_ns)

    def _overdue(self, now_ns: int) -> list[int]:
        """Return the ids of leaving artefacts that vanish now without being at an exit."""
        patience_ns = seconds_to_ns(self._parameters.population.exit_patience)
        exits_m = self.crowd.navigation.places.exits_m
        out_of_view = self._spawning.out_of_view
        return overdue(self.crowd.table, now_ns, patience_ns, exits_m, out_of_view)

    def is_hidden(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Return which boxes (N,), map frame, no camera sees where the last sub-step found it."""
        return self._spawning.out_of_view.hides(boxes)

    def _hides(self, points_m: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        """Return which points (N, 2) are so that no camera would see a person there."""
        poses = np.zeros((len(points_m), 4))
        poses[:, :2] = points_m
        shapes = np.tile(_PERSON, (len(points_m), 1))
        return self.is_hidden(OrientedBoxes.standing(poses, shapes))

    def _stays_on(self, artefact: Artefact) -> bool:
        """Return whether an artefact walks to an exit when its life ends."""
        walks_to_exit = self._parameters.population.leave is Leave.WALK_TO_EXIT
        return walks_to_exit and self.crowd.table.state_of(artefact.id) is not None

    def _apply(self, event: PopulationEvent) -> None:
        """Apply an event of the population to the crowd, and keep it for the outputs."""
        artefact_id = event.artefact_id
        if event.kind is PopulationEventKind.DEPARTED:
            self.crowd.end(artefact_id, event.time_ns, event.cause or Cause.REMOVED)
        elif event.kind is PopulationEventKind.LEAVING:
            row = self.crowd.table.row_of(artefact_id)
            self.crowd.decisions.send_out(row, event.time_ns)
            self.crowd.table.leaving_ns[row] = event.time_ns
            return
        detail = event.reason or (event.cause.value if event.cause else "")
        kind, label = EventKind[event.kind.name], event.row.label
        self.crowd.events.append(ArtefactEvent(event.time_ns, kind, artefact_id, label, detail))


def overdue(
    table: AgentTable,
    now_ns: int,
    patience_ns: int,
    exits_m: npt.NDArray[np.float64],
    out_of_view: OutOfView,
) -> list[int]:
    """Return the ids of the leaving agents that vanish now, ascending (section 3.2).

    An agent vanishes after `patience_ns` on its way to an exit; if the map has no exit, as soon as
    no camera sees it.
    """
    rows = np.flatnonzero(table.leaving_ns != STAYS)
    if not rows.size:
        return []
    gone = now_ns - table.leaving_ns[rows] >= patience_ns
    if not len(exits_m):
        gone = gone | out_of_view.hides(table.boxes.take(rows))
    ids: list[int] = table.ids[rows[gone]].tolist()
    return ids


def population_of(
    parameters: Parameters,
    catalogue: Catalogue,
    *,
    begun: Callable[[Artefact, ScriptedOffer | None], object],
    stays_on: Callable[[Artefact], bool],
) -> Population:
    """Return the population that the parameters describe, still empty.

    `begun` and `stays_on` are passed to `Population`. Raises ParameterError where the mixture is
    bad, ScenarioError where the scenario is.
    """
    settings, law = parameters.population, mixture_of(parameters, catalogue)
    return Population(
        parameters.seed,
        RandomSource(parameters.seed, catalogue.rows, law, settings.group_size),
        departure_law(settings.departures, parameters.seed, settings.mean_life),
        max_alive=settings.max_alive,
        history_ns=seconds_to_ns(parameters.poses.history),
        begun=begun,
        stays_on=stays_on,
        scripted=ScriptedSource(scenario_of(parameters, catalogue)),
    )


def scenario_of(parameters: Parameters, catalogue: Catalogue) -> Scenario:
    """Return the scenario that the parameters name, one of nobody where they name none.

    Raises ScenarioError where it is bad.
    """
    if not parameters.population.scenario:
        return Scenario()
    scenario = read_scenario(Path(parameters.population.scenario), catalogue)
    if parameters.sensors.masks:
        _check_ids_for_masks(scenario, parameters.population.scenario)
    return scenario


def _check_ids_for_masks(scenario: Scenario, source: str) -> None:
    """Raise ScenarioError for an id that is no pixel of a mask."""
    for artefact in scenario.artefacts:
        if (artefact.artefact_id or 0) > _LAST_ID_IN_MASK:
            raise ScenarioError(
                f"{source}: the id {artefact.artefact_id} does not fit into a mask "
                f"(sensors.masks), whose pixels are ids up to {_LAST_ID_IN_MASK}"
            )
