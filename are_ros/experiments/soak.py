"""A soak: artefacts live for hours on a map beside a robot that drives about, and are judged.

Nothing is rendered: ticks run at the sub-steps, and their ground truth goes to the judge.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.catalogue import Catalogue, MotionLimits
from are_ros.artefacts.randomness import Purpose, generator
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.events import EventKind
from are_ros.builder.motions import MotionCounts
from are_ros.builder.tick import Demand, Tick
from are_ros.conventions import NS_PER_S
from are_ros.errors import MapError
from are_ros.experiments.motion_judge import Limits, MotionJudge, Verdict
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.world.environment import Environment
from are_ros.world.occupancy_grid import OccupancyGrid

_NOTHING_SHOWN = Demand(perception=False, grids=False, markers=False)
_ROBOT_MPS = 0.5
_LOOK_AHEAD_M = 0.9


@dataclass(frozen=True)
class SoakResult:
    """What was judged, and how often the resolver had to step in."""

    verdict: Verdict
    counts: MotionCounts
    contacts: int
    blocked: int
    simulated_s: float

    @property
    def resolved_share(self) -> float:
        """The share of artefact-seconds in which a collision was resolved, not avoided."""
        steps = max(self.counts.artefact_steps, 1)
        return (self.counts.moved_back + self.counts.displaced) / steps


def soak(
    grid: OccupancyGrid,
    parameters: Parameters,
    catalogue: Catalogue,
    duration_s: float,
    progress: Callable[[float], object] = lambda _: None,
) -> SoakResult:
    """Let artefacts live on a map, judged at each sub-step; `progress` is told the time [s]."""
    step_s = parameters.motion.step
    step_ns = round(step_s * NS_PER_S)
    parameters = with_values(parameters, {"builder.tick_rate": 1.0 / step_s})
    builder = ArBuilder(parameters, catalogue, _NOTHING_SHOWN)
    builder.receive_map(grid, 0)
    environment = builder.world.environment
    if environment is None:
        raise MapError("nobody lives without a map")
    judge = MotionJudge(grid, environment.classes.occupied, step_s)
    limits = {row.label: _limits(row.motion) for row in catalogue.rows}
    robot = RovingRobot(environment, parameters.robot.radius, parameters.seed)
    touching: set[int] = set()
    for index in range(1, round(duration_s / step_s) + 1):
        now_ns = index * step_ns
        tick = builder.step(now_ns)
        touching |= {e.artefact_id for e in tick.events if e.kind is EventKind.ROBOT_CONTACT}
        jumped = {e.artefact_id for e in tick.events if e.kind is EventKind.DISPLACED}
        here = None if index == 1 else (robot.x_m, robot.y_m, parameters.robot.radius)
        judge.judge(
            now_ns / NS_PER_S, tick.artefacts, limits, frozenset(jumped), here, frozenset(touching)
        )
        touching &= _touched(tick, robot, parameters.robot.radius)
        robot.drive(step_s, tick)
        pose = (robot.x_m, robot.y_m, 0.0)
        turn = (0.0, 0.0, math.sin(0.5 * robot.yaw_rad), math.cos(0.5 * robot.yaw_rad))
        then_ns = now_ns + step_ns // 2
        builder.receive_transform("map", "base_link", then_ns, pose, turn, then_ns)
        progress(now_ns / NS_PER_S)
    lives = builder.lives
    return SoakResult(
        judge.verdict,
        lives.motion_counts,
        lives.robot_contacts,
        lives.population.counts.blocked,
        duration_s,
    )


def _limits(motion: MotionLimits) -> Limits:
    return Limits(
        motion.top_speed_mps,
        motion.acceleration_mps2,
        motion.turn_rate_radps,
        motion.turn_radius_m,
    )


def _touched(tick: Tick, robot: "RovingRobot", radius_m: float) -> set[int]:
    """Return who is near enough to the robot to be in contact still."""
    near = set()
    for state in tick.artefacts:
        reach_m = radius_m + 0.5 * math.hypot(*state.size_m[:2]) + 0.2
        pose = state.ground_pose
        if math.hypot(pose.x_m - robot.x_m, pose.y_m - robot.y_m) <= reach_m:
            near.add(state.artefact_id)
    return near


class RovingRobot:
    """Drives straight from point to point that it sees; every other time it stops for artefacts."""

    def __init__(self, environment: Environment, radius_m: float, seed: int) -> None:
        self._environment = environment
        self._radius_m = radius_m
        self._random = generator(seed, Purpose.REQUEST, 0)
        self._points_m = _open_points(environment, radius_m)
        self.x_m, self.y_m = self._points_m[0].tolist()
        self.yaw_rad = 0.0
        self._goal = (self.x_m, self.y_m)
        self._is_careful = True

    def drive(self, dt_s: float, tick: Tick) -> None:
        """Go on for one sub-step."""
        if math.dist((self.x_m, self.y_m), self._goal) < 0.05:
            self._choose()
        heading = math.atan2(self._goal[1] - self.y_m, self._goal[0] - self.x_m)
        turn = math.remainder(heading - self.yaw_rad, math.tau)
        self.yaw_rad += max(-1.5 * dt_s, min(1.5 * dt_s, turn))
        if abs(turn) > 0.1 or (self._is_careful and self._is_blocked(tick)):
            return
        way_m = min(_ROBOT_MPS * dt_s, math.dist((self.x_m, self.y_m), self._goal))
        self.x_m += way_m * math.cos(heading)
        self.y_m += way_m * math.sin(heading)

    def _choose(self) -> None:
        here = np.array((self.x_m, self.y_m))
        for _ in range(30):
            goal = self._points_m[int(self._random.integers(len(self._points_m)))]
            count = max(2, int(math.dist(here, goal) / 0.05))
            way = here + np.linspace(0.0, 1.0, count)[:, None] * (goal - here)
            if (self._environment.lookup(way) > self._radius_m + 0.1).all():
                self._goal = (float(goal[0]), float(goal[1]))
                self._is_careful = not self._is_careful
                return

    def _is_blocked(self, tick: Tick) -> bool:
        ahead = (
            self.x_m + _LOOK_AHEAD_M * math.cos(self.yaw_rad),
            self.y_m + _LOOK_AHEAD_M * math.sin(self.yaw_rad),
        )
        return any(
            math.dist(ahead, (s.ground_pose.x_m, s.ground_pose.y_m)) < _LOOK_AHEAD_M
            for s in tick.artefacts
        )


def _open_points(environment: Environment, radius_m: float) -> npt.NDArray[np.float64]:
    """Return up to 500 points of the largest part of the map where the robot fits."""
    import cv2

    open_cells = environment.clearance_m > radius_m + 0.15
    _, labels, stats, _ = cv2.connectedComponentsWithStats(open_cells.view(np.uint8))
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    cells = np.argwhere(labels == largest)
    chosen = cells[:: max(1, len(cells) // 500)]
    middle = chosen[np.argsort(np.abs(chosen - chosen.mean(axis=0)).sum(axis=1), kind="stable")]
    return environment.grid.cells_to_points(middle)
