"""What happens to the living in a sub-step: minds decide, traffic plans, collisions are resolved.

Positions belong to the sub-steps: who is KEPT is where the traffic has planned it to be; the others
are where the resolver has left them (section 3.3), and the traffic is told.
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
from are_ros.builder.collisions import CollisionResolver, Outcome, Resolution
from are_ros.builder.contact_log import ContactLog
from are_ros.builder.crowd import Crowd
from are_ros.builder.deciding import robot_view, view_of
from are_ros.builder.events import ArtefactEvent, EventKind
from are_ros.builder.life_keeper import LifeKeeper
from are_ros.builder.motion_counts import MotionCounts
from are_ros.builder.robot_motion import RobotWatch
from are_ros.builder.robots import RobotPose
from are_ros.world.environment import Environment
from are_ros.world.oriented_boxes import OrientedBoxes
from are_ros.world.region import SpawnRegion
from are_ros.world.zones import Zones

_NO_INDICES = np.empty(0, np.intp)
_STEPS_AHEAD = 30
"""So many sub-steps of a track the others know in advance."""


@dataclass
class Happened:
    """What a sub-step brought: events, who has to go and why."""

    events: list[ArtefactEvent] = field(default_factory=list)
    leavers: list[tuple[int, Cause]] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Wish:
    """Where N artefacts want to be at the end of a sub-step, in the order of their ids.

    `poses` float64 (N, 4) x, y, z, yaw, and the boxes there; `moved` bool (N,): who goes there by
    itself; `tracked` int64 (M,): the indices of those who go by a track, `jumping` of those of them
    whose track puts them elsewhere on the ground.
    """

    poses: npt.NDArray[np.float64]
    boxes: OrientedBoxes
    moved: npt.NDArray[np.bool_]
    tracked: npt.NDArray[np.intp]
    jumping: npt.NDArray[np.intp]


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
        self._entered: tuple[Environment, SpawnRegion] | None = None

    def begin(self, artefact: Artefact, script: ScriptedOffer | None) -> None:
        """Let an artefact that has just arrived be there; it has a track, or a mind of its own."""
        pose = artefact.history.latest
        body = Body.of(artefact.row)
        self.crowd.add(artefact.id, artefact.row, pose)
        self.traffic.add(artefact.id, pose, body)
        if script is not None and script.track is not None:
            self.player.add(artefact, script.track, script.start_ns)
        else:
            artefact.history = self._tape.begin(artefact.id, artefact.arrival_ns, pose)
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

    def step(
        self,
        step_ns: int,
        period_ns: int,
        living: Mapping[int, Artefact],
        environment: Environment,
        robot: RobotPose | None,
        plan_m: npt.NDArray[np.float64],
    ) -> Happened:
        """Run the sub-step that ends at `step_ns`, a multiple of `period_ns` since the epoch."""
        index = step_ns // period_ns
        motion = self._robot_watch.see(robot, step_ns) if robot else None
        gone = self._decide(index, step_ns, living, motion, plan_m)
        before, last_safe = self.crowd.poses, self.crowd.boxes
        wish = self._wish(index, step_ns, period_ns, environment, motion)
        resolution = self.resolver.resolve(
            self.crowd.ids, wish.boxes, last_safe, environment, [robot.footprint] if robot else []
        )
        if len(wish.tracked):
            resolution = resolution.letting_pass(wish.tracked)
        begun = self.contacts.begun(step_ns, resolution.contacts, living)
        happened = Happened(begun, [(artefact_id, Cause.LIFE_OVER) for artefact_id in gone])
        self.counts.add(wish.moved, resolution)
        self.counts.displaced += len(wish.jumping)
        for i in wish.jumping.tolist():
            artefact = living[int(self.crowd.ids[i])]
            happened.events.append(_displaced(step_ns, artefact, before[i], wish.poses[i]))
        moved = wish.moved
        if resolution.is_all_kept:
            self.crowd.move(wish.poses, wish.boxes)
        else:
            moved = self._correct(step_ns, wish, resolution, living, happened)
        self._tape.record(step_ns - period_ns, step_ns, self.crowd.ids, before, self.crowd.poses)
        if self.keeper is not None:
            self.keeper.step(step_ns, self.crowd.ids, self.crowd.poses, moved)
        return happened

    def _wish(
        self,
        index: int,
        step_ns: int,
        period_ns: int,
        environment: Environment,
        robot: RobotMotion | None,
    ) -> _Wish:
        """Let the traffic go on, and the tracks."""
        crowd, traffic, player = self.crowd, self.traffic, self.player
        for artefact_id in player.ids:
            ahead = player.ahead(artefact_id, step_ns - period_ns, _STEPS_AHEAD)
            traffic.prescribe(artefact_id, ahead)
        traffic.step(index, environment, robot)
        moved = traffic.moved
        poses, boxes = crowd.proposed(traffic.poses, moved, environment)
        if not player.ids:
            return _Wish(poses, boxes, moved, _NO_INDICES, _NO_INDICES)
        tracked = np.searchsorted(crowd.ids, player.ids)
        on_track, goes = player.move(step_ns)
        is_elsewhere = (on_track[:, :2] != crowd.poses[tracked, :2]).any(axis=1)
        poses, boxes = crowd.with_poses(poses, tracked, on_track)
        moved = moved.copy()
        moved[tracked] = goes
        return _Wish(poses, boxes, moved, tracked, tracked[is_elsewhere & ~goes])

    def _decide(
        self,
        index: int,
        step_ns: int,
        living: Mapping[int, Artefact],
        robot: RobotMotion | None,
        plan_m: npt.NDArray[np.float64],
    ) -> list[int]:
        """Let those decide whose turn it is; return who has left by an exit."""
        view = view_of(living, self.crowd, self.traffic, self.minds, self.player)
        seen = robot_view(robot, plan_m) if robot else None
        return self.minds.decide(index, step_ns, view, self.traffic, seen)

    def _correct(
        self,
        step_ns: int,
        wish: _Wish,
        resolution: Resolution,
        living: Mapping[int, Artefact],
        happened: Happened,
    ) -> npt.NDArray[np.bool_]:
        """Put those where they are who could not be kept; return who has moved by itself."""
        corrected = np.flatnonzero(resolution.outcomes != Outcome.KEPT)
        settled = wish.poses.copy()
        settled[corrected] = self.crowd.poses[corrected]
        moved: npt.NDArray[np.bool_] = wish.moved.copy()
        moved[corrected] = False
        for i in corrected.tolist():
            artefact = living[int(self.crowd.ids[i])]
            outcome = Outcome(int(resolution.outcomes[i]))
            if outcome is Outcome.DISPLACED_TO_SAFE:
                was, pose = artefact.history.latest, _pose_found(artefact, resolution, i)
                artefact.history.append(step_ns - 1, was)
                happened.events.append(_displaced(step_ns, artefact, was, pose))
                settled[i] = pose
            elif outcome is Outcome.LEAVES:
                happened.leavers.append((artefact.id, Cause.DISPLACED))
            elif outcome is Outcome.LEAVES_ON_CONTACT:
                happened.leavers.append((artefact.id, Cause.ROBOT_CONTACT))
            self.traffic.put(artefact.id, GroundPose(*settled[i].tolist()))
        self.crowd.move(settled)
        return moved


def _pose_found(artefact: Artefact, resolution: Resolution, i: int) -> GroundPose:
    """Return the pose that the search has found for an artefact."""
    was, (dx_m, dy_m) = artefact.history.latest, resolution.shifts_m[i].tolist()
    bottom_m = resolution.boxes.centres_m[i, 2] - resolution.boxes.half_sizes_m[i, 2]
    return GroundPose(was.x_m + dx_m, was.y_m + dy_m, float(bottom_m), was.yaw_rad)


def _displaced(
    step_ns: int, artefact: Artefact, was: Sequence[float], now: Sequence[float]
) -> ArtefactEvent:
    """Return the event of a jump on the ground; the value is how far."""
    kind, label = EventKind.DISPLACED, artefact.row.label
    distance_m = math.hypot(now[0] - was[0], now[1] - was[1])
    return ArtefactEvent(step_ns, kind, artefact.id, label, "moved", distance_m)
