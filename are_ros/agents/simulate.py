"""The simulation of the agents in sub-steps: resolve collisions, decide, plan, move, record.

At the beginning of a sub-step, all agents are at the poses that the last one computed. The method
`CrowdSimulator.step` shows the five stages.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.situation import RobotView
from are_ros.agents.collisions import CollisionResolver, ContactLog, Outcome, Resolution
from are_ros.agents.decision import DecisionLayer
from are_ros.agents.events import ArtefactEvent, EventKind
from are_ros.agents.local_planner.planner import LocalPlanner
from are_ros.agents.local_planner.robot import RobotMotion
from are_ros.agents.mdp.exits import exits_of
from are_ros.agents.navigation.destinations import destinations_in
from are_ros.agents.navigation.navigation import Navigation
from are_ros.agents.navigation.terrain import Terrains
from are_ros.agents.robots import RobotPose, RobotWatch
from are_ros.agents.scenario_recorder import ScenarioRecorder
from are_ros.agents.table import AgentTable
from are_ros.agents.track_player import FollowedTrack
from are_ros.conventions import seconds_to_ns
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import Artefact, GroundPose
from are_ros.population.departures import Cause
from are_ros.population.scenario import ScriptedOffer
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment
from are_ros.world.regions import SpawnRegion, Zones

_Floats = npt.NDArray[np.float64]
_Mask = npt.NDArray[np.bool_]

_STEPS_AHEAD: Final = 30
"""Sub-steps of a track that the local planner knows in advance."""

Depart = Callable[[int, int, Cause], None]
"""(id, instant [ns], cause): removes an agent."""

Overdue = Callable[[int], Iterable[int]]
"""Instant [ns] -> ids of agents on their way out that depart now without being at an exit."""


@dataclass
class MotionCounts:
    """Numbers of sub-steps of artefacts so far: all, with motion, and corrected by the resolver.

    (`moved_back` + `displaced`) / `artefact_steps` is the share of artefact-seconds with a
    collision that planning did not avoid. An artefact that is removed for a contact with the robot
    does not count as displaced.
    """

    artefact_steps: int = 0
    moving_steps: int = 0
    moved_back: int = 0
    displaced: int = 0

    def add(self, moved: _Mask, resolution: Resolution) -> None:
        """Count a sub-step of N artefacts; `moved` (N,) tells which have left their poses."""
        self.artefact_steps += len(moved)
        self.moving_steps += int(np.count_nonzero(moved))
        if not resolution.is_all_kept:
            outcomes = resolution.outcomes
            by_force = (Outcome.DISPLACED_TO_SAFE, Outcome.LEAVES)
            self.moved_back += int(np.count_nonzero(outcomes == Outcome.MOVED_BACK))
            self.displaced += int(np.count_nonzero(np.isin(outcomes, by_force)))


class CrowdSimulator:
    """Moves all agents of a table from one sub-step to the next."""

    def __init__(
        self,
        parameters: Parameters,
        robot: str,
        resolver: CollisionResolver,
        terrains: Terrains,
        depart: Depart,
        overdue: Overdue = lambda _: (),
    ) -> None:
        """Take the parameters, the robot's name, and the callbacks for departures."""
        settings, step_s = parameters.behaviour, parameters.motion.step
        history_ns = seconds_to_ns(parameters.poses.history)
        self.table = AgentTable(step_s, parameters.world.ground, history_ns)
        self.navigation = Navigation(settings, terrains)
        self.planner = LocalPlanner(self.table, terrains)
        self.decisions = DecisionLayer(
            parameters.seed, settings, self.table, self.navigation, self.planner
        )
        self.decisions.report_change = self._note_change
        self.planner.user_planners.stop = self.decisions.stop
        self.resolver = resolver
        self.recorder: ScenarioRecorder | None = None
        self.counts = MotionCounts()
        self.contacts = ContactLog(robot)
        self.events: list[ArtefactEvent] = []
        """Events since the last `take_events`; the population's events are appended, too."""
        self.period_ns = seconds_to_ns(step_s)
        self._depart = depart
        self._overdue = overdue
        self._robot_watch = RobotWatch()
        self._entered: tuple[Environment, SpawnRegion] | None = None

    def step(
        self,
        now_ns: int,
        environment: Environment,
        robot_pose: RobotPose | None,
        plan_m: _Floats,
    ) -> None:
        """Run the sub-step at `now_ns`.

        Until the next sub-step all agents move on straight lines to their end poses, whatever is
        received meanwhile. `plan_m` (K, 2) is the path that the robot plans [m].
        """
        table, index = self.table, now_ns // self.period_ns
        robot = self._robot_watch.see(robot_pose, now_ns) if robot_pose else None

        # Resolve (section 3.3): an agent keeps its new pose, is moved, or departs.
        for agent_id, cause in self._resolve(now_ns, environment, robot):
            self._depart(agent_id, now_ns, cause)

        # Decide (section 3.2): agents that are due choose a goal, and the next part of the way.
        for agent_id in self.decisions.decide(index, now_ns, _view_of(robot, plan_m)):
            self._depart(agent_id, now_ns, Cause.LIFE_OVER)
        for agent_id in self._overdue(now_ns):
            self._depart(agent_id, now_ns, Cause.LIFE_OVER)

        # Plan: each agent commits to a free trajectory; a track is prescribed as it is.
        tracks = table.tracks
        for row, track in tracks:
            self.planner.prescribe(row, track.ahead(now_ns, _STEPS_AHEAD))
        planar, moved = self.planner.step(index, environment, robot)

        # Move: the poses until the next sub-step are fixed from now on.
        ends, boxes = table.proposed(planar, moved, environment)
        if tracks:
            ends, boxes = self._on_tracks(now_ns, tracks, ends, boxes)
        table.set_ends(*self._held_back(ends, boxes))

        # Record: the pose histories of the artefacts are views of these frames.
        until_ns = now_ns + self.period_ns
        table.history.record(now_ns, until_ns, table.ids, table.poses, table.ends)
        if self.recorder is not None:
            self.recorder.step(now_ns, table.ids, table.poses, table.ends)

    def begin(self, artefact: Artefact, script: ScriptedOffer | None) -> None:
        """Add an artefact that has just arrived; without a track, it decides on its own."""
        track, goes_to = None, None
        if script is not None and script.artefact.track is not None:
            track = FollowedTrack(script.artefact.track, script.start_ns, self.period_ns)
            goes_to = track.begin(artefact)
        self.table.add(artefact, goes_to=goes_to, track=track)
        if track is None:
            self.decisions.admit(artefact)
        if self.recorder is not None:
            self.recorder.arrived(artefact)

    def end(self, agent_id: int, now_ns: int, cause: Cause) -> None:
        """Remove an agent whose artefact has departed."""
        if self.recorder is not None:
            self.recorder.departed(agent_id, now_ns, cause)
        is_on_track = any(self.table.ids[row] == agent_id for row, _ in self.table.tracks)
        if cause is Cause.DISPLACED and is_on_track:
            self.counts.displaced += 1  # the counts of the resolver leave tracks out
        self.table.remove(agent_id)

    def enter(self, environment: Environment, region: SpawnRegion | None, zones: Zones) -> None:
        """Use this environment and region; if they are new, find destinations and exits."""
        if region is None or (environment, region) == self._entered:
            return
        self._entered = (environment, region)
        grid, clearance_m = environment.grid, environment.clearance_m
        exits_m = exits_of(environment, region.mask, zones)
        places = destinations_in(grid, region.mask, clearance_m, exits_m=exits_m)
        self.navigation.enter(environment, places)

    def forget(self) -> None:
        """Forget histories, contacts and the robot's motion: the clock jumped."""
        self.table.history.clear()
        self.contacts.forget()
        self._robot_watch.forget()

    def take_events(self) -> list[ArtefactEvent]:
        """Return what happened since the last call, in the order of time."""
        events, self.events = self.events, []
        return events

    def _note_change(self, now_ns: int, artefact: Artefact, was: str) -> None:
        """Append the event of a change of behaviour."""
        detail = f"{was} -> {artefact.behaviour}"
        label, kind = artefact.row.label, EventKind.CHANGED
        self.events.append(ArtefactEvent(now_ns, kind, artefact.id, label, detail))

    def _resolve(
        self, now_ns: int, environment: Environment, robot: RobotMotion | None
    ) -> list[tuple[int, Cause]]:
        """Move all agents to their end poses, as the resolver allows; return those that leave.

        An agent on a track is moved as the track says, unless it leaves for a contact with the
        robot.
        """
        table = self.table
        moved = (table.ends != table.poses).any(axis=1)
        tracks = table.tracks
        jumps = self._jump(now_ns, tracks) if tracks else []
        resolution = self.resolver.resolve(
            table.ids,
            table.end_boxes,
            table.boxes,
            environment,
            robot.footprint if robot else None,
            lambda: robot.swept if robot else None,
            [row for row, _ in tracks],
        )
        living = {one.id: one for one in table.artefacts} if resolution.contacts else {}
        self.events += self.contacts.begun(now_ns, resolution.contacts, living)
        self.events += jumps
        self.counts.add(moved, resolution)
        if resolution.is_all_kept:
            table.move(table.ends, table.end_boxes)
            return []
        return self._correct(now_ns, resolution)

    def _jump(
        self, now_ns: int, tracks: Sequence[tuple[int, FollowedTrack]]
    ) -> list[ArtefactEvent]:
        """Move agents whose tracks jump; return the events."""
        table, events = self.table, list[ArtefactEvent]()
        rows, poses = list[int](), list[GroundPose]()
        for row, track in tracks:
            pose = track.jump(now_ns)
            if pose is not None:
                rows.append(row)
                poses.append(pose)
                end = table.ends[row].tolist()
                has_waited = pose == tuple(table.poses[row].tolist())
                if list(pose[:2]) != end[:2] and not has_waited:
                    events.append(_displaced(now_ns, table.artefacts[row], end, pose))
                    self.counts.displaced += 1
        if rows:
            table.set_ends(*table.with_poses(table.ends, np.array(rows), np.array(poses)))
        return events

    def _correct(self, now_ns: int, resolution: Resolution) -> list[tuple[int, Cause]]:
        """Correct the poses of agents that are not kept; return those that leave, and why."""
        table, leaving = self.table, list[tuple[int, Cause]]()
        corrected = np.flatnonzero(resolution.outcomes != Outcome.KEPT)
        settled = table.ends.copy()
        settled[corrected] = table.poses[corrected]
        for i in corrected.tolist():
            artefact = table.artefacts[i]
            outcome, end = Outcome(int(resolution.outcomes[i])), table.ends[i].tolist()
            if outcome is Outcome.DISPLACED_TO_SAFE:
                settled[i] = pose = _pose_found(table.poses[i].tolist(), resolution, i)
                self.events.append(_displaced(now_ns, artefact, end, pose))
            elif outcome is Outcome.LEAVES:
                leaving.append((artefact.id, Cause.DISPLACED))
            elif outcome is Outcome.LEAVES_ON_CONTACT:
                leaving.append((artefact.id, Cause.ROBOT_CONTACT))
            table.stand(i, GroundPose(*settled[i].tolist()))
        table.move(settled, table.boxes_at(settled))
        return leaving

    def _on_tracks(
        self,
        now_ns: int,
        tracks: Sequence[tuple[int, FollowedTrack]],
        ends: _Floats,
        boxes: OrientedBoxes,
    ) -> tuple[_Floats, OrientedBoxes]:
        """Return the end poses (N, 4) and boxes (N), with those of the tracks."""
        rows = np.array([row for row, _ in tracks])
        poses = map(GroundPose._make, self.table.poses[rows].tolist())
        results = [
            track.advance(now_ns, pose) for (_, track), pose in zip(tracks, poses, strict=True)
        ]
        if np.array_equal(results, ends[rows]):
            return ends, boxes
        return self.table.with_poses(ends, rows, np.array(results))

    def _held_back(self, ends: _Floats, boxes: OrientedBoxes) -> tuple[_Floats, OrientedBoxes]:
        """Return the end poses (N, 4) and boxes (N); agents that would run into another one stand.

        It may have arrived, or been moved, in the way of a committed trajectory. Tracks go on.
        """
        table = self.table
        fixed = [row for row, _ in table.tracks]
        rows = np.flatnonzero(self.resolver.held_back(boxes, table.boxes, fixed))
        if not len(rows):
            return ends, boxes
        self.counts.moved_back += len(rows)
        poses = table.poses[rows]
        for row, pose in zip(rows.tolist(), poses.tolist(), strict=True):
            table.stand(row, GroundPose(*pose))
        return table.with_poses(ends, rows, poses)


def _view_of(robot: RobotMotion | None, plan_m: _Floats) -> RobotView | None:
    """Return the robot as behaviours see it."""
    if robot is None:
        return None
    return RobotView(
        robot.x_m,
        robot.y_m,
        robot.yaw_rad,
        robot.vx_mps,
        robot.vy_mps,
        robot.radius_m,
        plan_m,
    )


def _pose_found(was: Sequence[float], resolution: Resolution, i: int) -> GroundPose:
    """Return the pose that the search has found for artefact i; `was` is its last safe one."""
    dx_m, dy_m = resolution.shifts_m[i].tolist()
    bottom_m = resolution.boxes.centres_m[i, 2] - resolution.boxes.half_sizes_m[i, 2]
    return GroundPose(was[0] + dx_m, was[1] + dy_m, float(bottom_m), was[3])


def _displaced(
    now_ns: int, artefact: Artefact, was: Sequence[float], now: Sequence[float]
) -> ArtefactEvent:
    """Return the event of a displacement; its value is the distance [m]."""
    kind, label = EventKind.DISPLACED, artefact.row.label
    distance_m = math.hypot(now[0] - was[0], now[1] - was[1])
    return ArtefactEvent(now_ns, kind, artefact.id, label, "moved", distance_m)
