"""What happens to the living in a sub-step: collisions are resolved, minds decide, traffic plans.

A sub-step begins where the one before has taken everybody: who is KEPT is there, the others are
where the resolver puts them (section 3.3), and the traffic is told. Then minds decide and the
traffic plans where all will be when the next sub-step begins. From then on that is certain: until
the next sub-step all go straight there, whatever comes in. Who arrives in between stands, unless
it has a track.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.artefact import Artefact, GroundPose
from are_ros.artefacts.exits import exits_of
from are_ros.artefacts.minds import Minds
from are_ros.artefacts.motion.body import Body
from are_ros.artefacts.motion.robot import RobotMotion
from are_ros.artefacts.motion.traffic import Traffic
from are_ros.artefacts.navigation import Navigation
from are_ros.artefacts.places import places_in
from are_ros.artefacts.population_events import Cause
from are_ros.artefacts.pose_tape import PoseTape
from are_ros.artefacts.scripted import ScriptedOffer
from are_ros.artefacts.track_player import TrackPlayer
from are_ros.builder.collisions import CollisionResolver, ContactLog, Outcome, Resolution
from are_ros.builder.crowd import Crowd
from are_ros.builder.deciding import robot_view, view_of
from are_ros.builder.life_keeper import LifeKeeper
from are_ros.builder.motion_counts import MotionCounts
from are_ros.builder.outputs import ArtefactEvent, EventKind
from are_ros.builder.robots import RobotPose, RobotWatch
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment
from are_ros.world.regions import SpawnRegion, Zones

_Floats = npt.NDArray[np.float64]
_STEPS_AHEAD = 30
"""So many sub-steps of a track the others know in advance."""


@dataclass
class Happened:
    """What a sub-step brought: events, who has to go and why."""

    events: list[ArtefactEvent] = field(default_factory=list)
    leavers: list[tuple[int, Cause]] = field(default_factory=list)


class Motions:
    """Moves the living, all at once, from one sub-step to the next."""

    def __init__(
        self,
        crowd: Crowd,
        tape: PoseTape,
        minds: Minds,
        navigation: Navigation,
        traffic: Traffic,
        player: TrackPlayer,
        resolver: CollisionResolver,
        robot: str,
    ) -> None:
        """Take the parts, and the name of the robot."""
        self.crowd = crowd
        self._tape = tape
        self.minds = minds
        self.navigation = navigation
        self.traffic = traffic
        self.player = player
        self.keeper: LifeKeeper | None = None
        self.resolver = resolver
        self.counts = MotionCounts()
        self.contacts = ContactLog(robot)
        self._robot_watch = RobotWatch()
        self._robot: RobotMotion | None = None
        self._entered: tuple[Environment, SpawnRegion] | None = None

    def begin(self, artefact: Artefact, script: ScriptedOffer | None) -> None:
        """Let an artefact that has just arrived be there; it has a track, or a mind of its own."""
        pose = end = artefact.history.latest
        body, goes_to = Body.of(artefact.row), None
        if script is not None and script.track is not None:
            goes_to = self.player.add(artefact, script.track, script.start_ns)
            end = goes_to[1]
        artefact.history = self._tape.begin(artefact.id, artefact.arrival_ns, pose, goes_to)
        self.crowd.add(artefact.id, artefact.row, pose, end)
        self.traffic.add(artefact.id, end, body)
        if goes_to is None:
            self.minds.admit(artefact, body)
        if self.keeper is not None:
            self.keeper.arrived(artefact)

    def end(self, artefact_id: int, now_ns: int, cause: Cause) -> None:
        """Let an artefact be gone, that has departed."""
        if self.keeper is not None:
            self.keeper.departed(artefact_id, now_ns, cause)
        if artefact_id in self.player and cause is Cause.DISPLACED:
            self.counts.displaced += 1  # the resolver has not counted whom it lets pass
        self.player.remove(artefact_id)
        self._tape.stop(artefact_id)
        self.crowd.remove(artefact_id)
        self.traffic.remove(artefact_id)
        self.minds.dismiss(artefact_id)

    def enter(self, environment: Environment, region: SpawnRegion | None, zones: Zones) -> None:
        """Go on in this environment and region; where they are others, so are places and exits."""
        if region is None or (environment, region) == self._entered:
            return
        self._entered = (environment, region)
        grid, clearance_m = environment.grid, environment.clearance_m
        exits_m = exits_of(environment, region.mask, zones)
        places = places_in(grid, region.mask, clearance_m, exits_m=exits_m)
        self.navigation.enter(environment, places)

    def forget(self) -> None:
        """Forget where all were, how the robot moved, and whom it touches: the clock jumped."""
        self._tape.clear()
        self.contacts.forget()
        self._robot_watch.forget()
        self._robot = None

    @property
    def still_since_ns(self) -> int:
        """The instant from which on, as far as it is known, nobody moves."""
        return self._tape.still_since_ns

    def settle(
        self,
        step_ns: int,
        living: Mapping[int, Artefact],
        environment: Environment,
        robot: RobotPose | None,
    ) -> Happened:
        """Begin the sub-step at `step_ns`: all are where they were bound for, or are put elsewhere.

        Who has to leave is to be ended before `set_out`.
        """
        self._robot = self._robot_watch.see(robot, step_ns) if robot else None
        crowd = self.crowd
        was, wish, boxes = crowd.poses, crowd.ends, crowd.end_boxes
        moved: npt.NDArray[np.bool_] = np.zeros(len(wish), np.bool_)
        if wish is not was:
            moved = (wish != was).any(axis=1)
        jumped: list[ArtefactEvent] = []
        tracked = np.searchsorted(crowd.ids, self.player.ids)
        jumps = self.player.jumps(step_ns)
        if jumps:
            wish, boxes = self._jump(step_ns, jumps, living, jumped)
        resolution = self.resolver.resolve(
            crowd.ids, boxes, crowd.boxes, environment, [robot.footprint] if robot else []
        )
        if len(tracked):
            resolution = resolution.letting_pass(tracked)
        begun = self.contacts.begun(step_ns, resolution.contacts, living)
        happened = Happened([*begun, *jumped])
        self.counts.add(moved, resolution)
        if resolution.is_all_kept:
            crowd.move(wish, boxes)
        else:
            self._correct(step_ns, wish, resolution, living, happened)
        return happened

    def decide(
        self, step_ns: int, period_ns: int, living: Mapping[int, Artefact], plan_m: _Floats
    ) -> list[int]:
        """Let those decide whose turn it is; return who has left by an exit."""
        view = view_of(living, self.crowd, self.traffic, self.minds, self.player)
        seen = robot_view(self._robot, plan_m) if self._robot else None
        return self.minds.decide(step_ns // period_ns, step_ns, view, self.traffic, seen)

    def set_out(self, step_ns: int, period_ns: int, environment: Environment) -> None:
        """Fix where all go until the next sub-step, `period_ns` after the one at `step_ns`."""
        crowd, traffic, player = self.crowd, self.traffic, self.player
        for artefact_id in player.ids:
            ahead = player.ahead(artefact_id, step_ns, _STEPS_AHEAD)
            traffic.prescribe(artefact_id, ahead)
        traffic.step(step_ns // period_ns, environment, self._robot)
        ends, boxes = crowd.proposed(traffic.poses, traffic.moved, environment)
        if player.ids:
            tracked = np.searchsorted(crowd.ids, player.ids)
            legs = player.set_out(step_ns, crowd.poses[tracked])
            if not np.array_equal(legs, ends[tracked]):
                ends, boxes = crowd.with_poses(ends, tracked, legs)
        crowd.set_out(ends, boxes)
        self._tape.record(step_ns, step_ns + period_ns, crowd.ids, crowd.poses, ends)
        if self.keeper is not None:
            self.keeper.step(step_ns, crowd.ids, crowd.poses, ends)

    def _jump(
        self,
        step_ns: int,
        jumps: Mapping[int, GroundPose],
        living: Mapping[int, Artefact],
        events: list[ArtefactEvent],
    ) -> tuple[_Floats, OrientedBoxes]:
        """Return where all are when those have jumped whose tracks do, and add the events of it."""
        crowd = self.crowd
        which, poses = np.searchsorted(crowd.ids, list(jumps)), list(jumps.values())
        for i, (artefact_id, pose) in zip(which.tolist(), jumps.items(), strict=True):
            end = crowd.ends[i].tolist()
            is_back = pose == tuple(crowd.poses[i].tolist())
            if list(pose[:2]) != end[:2] and not is_back:
                events.append(_displaced(step_ns, living[artefact_id], end, pose))
                self.counts.displaced += 1
        return crowd.with_poses(crowd.ends, which, np.array(poses))

    def _correct(
        self,
        step_ns: int,
        wish: _Floats,
        resolution: Resolution,
        living: Mapping[int, Artefact],
        happened: Happened,
    ) -> None:
        """Put those where they are who could not be kept."""
        crowd = self.crowd
        corrected = np.flatnonzero(resolution.outcomes != Outcome.KEPT)
        settled = wish.copy()
        settled[corrected] = crowd.poses[corrected]
        for i in corrected.tolist():
            artefact = living[int(crowd.ids[i])]
            outcome, end = Outcome(int(resolution.outcomes[i])), wish[i].tolist()
            if outcome is Outcome.DISPLACED_TO_SAFE:
                settled[i] = pose = _pose_found(crowd.poses[i].tolist(), resolution, i)
                happened.events.append(_displaced(step_ns, artefact, end, pose))
            elif outcome is Outcome.LEAVES:
                happened.leavers.append((artefact.id, Cause.DISPLACED))
            elif outcome is Outcome.LEAVES_ON_CONTACT:
                happened.leavers.append((artefact.id, Cause.ROBOT_CONTACT))
            self.traffic.put(artefact.id, GroundPose(*settled[i].tolist()))
        crowd.move(settled)


def _pose_found(was: Sequence[float], resolution: Resolution, i: int) -> GroundPose:
    """Return the pose that the search has found for an artefact, from its last safe one."""
    dx_m, dy_m = resolution.shifts_m[i].tolist()
    bottom_m = resolution.boxes.centres_m[i, 2] - resolution.boxes.half_sizes_m[i, 2]
    return GroundPose(was[0] + dx_m, was[1] + dy_m, float(bottom_m), was[3])


def _displaced(
    step_ns: int, artefact: Artefact, was: Sequence[float], now: Sequence[float]
) -> ArtefactEvent:
    """Return the event of a jump on the ground; the value is how far."""
    kind, label = EventKind.DISPLACED, artefact.row.label
    distance_m = math.hypot(now[0] - was[0], now[1] - was[1])
    return ArtefactEvent(step_ns, kind, artefact.id, label, "moved", distance_m)
