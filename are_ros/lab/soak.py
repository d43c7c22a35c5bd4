"""A soak: artefacts live for hours on a map beside a robot that drives about, and are judged.

Nothing is rendered: ticks run at the sub-steps, and their ground truth goes to the judge.
"""

import json
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import ArtefactState, EventKind
from are_ros.agents.simulate import MotionCounts
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.tick import MOTION_ONLY, Tick
from are_ros.checks.oracle.solids import RealMap
from are_ros.conventions import NS_PER_S
from are_ros.draw.canvas import Canvas
from are_ros.draw.map import View, draw_map, known_part, window_of
from are_ros.draw.palette import ROBOT, Rgb, class_colours
from are_ros.draw.sheet import Entry, Sheet, line_sign, patch_sign
from are_ros.errors import InputError, MapError, ParameterError
from are_ros.lab.motion_judge import Limits, MotionJudge, Verdict
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.population.catalogue import Catalogue, MotionLimits
from are_ros.population.randomness import Purpose, generator
from are_ros.replay.output_folder import left_of
from are_ros.wording import counted, why_refused
from are_ros.world.environment import Environment
from are_ros.world.occupancy_grid import OccupancyGrid

RECORD: Final = "soak.json"
PICTURE: Final = "soak.png"
RESULTS: Final = (RECORD, PICTURE)

# A robot that drives about on the map, in place of a real one.


_ROBOT_MPS = 0.5
_LOOK_AHEAD_M = 0.9
_ROOM_M = 0.15
_PATIENCE_S = 8.0


class RovingRobot:
    """Drives straight to points in view; on every other way it stops for artefacts.

    Raises MapError where it fits nowhere.
    """

    def __init__(self, environment: Environment, radius_m: float, seed: int) -> None:
        self._environment = environment
        self._radius_m = radius_m
        self._random = generator(seed, Purpose.REQUEST, 0)
        self._points_m = _open_points(environment, radius_m)
        self.x_m, self.y_m = self._points_m[0].tolist()
        self.yaw_rad = 0.0
        self._goal = (self.x_m, self.y_m)
        self._is_careful = True
        self._waited_s = 0.0

    def drive(self, dt_s: float, states: Sequence[ArtefactState]) -> None:
        """Go on for one sub-step."""
        if math.dist((self.x_m, self.y_m), self._goal) < 0.05 or self._waited_s > _PATIENCE_S:
            self._choose()
        heading = math.atan2(self._goal[1] - self.y_m, self._goal[0] - self.x_m)
        turn = math.remainder(heading - self.yaw_rad, math.tau)
        self.yaw_rad += max(-1.5 * dt_s, min(1.5 * dt_s, turn))
        if abs(turn) > 0.1:
            return
        if self._is_careful and self._is_blocked(states):
            self._waited_s += dt_s
            return
        way_m = min(_ROBOT_MPS * dt_s, math.dist((self.x_m, self.y_m), self._goal))
        self.x_m += way_m * math.cos(heading)
        self.y_m += way_m * math.sin(heading)

    def _choose(self) -> None:
        """Choose another goal in view, if there is one, and reset the wait."""
        self._waited_s = 0.0
        here = np.array((self.x_m, self.y_m))
        for _ in range(30):
            goal = self._points_m[int(self._random.integers(len(self._points_m)))]
            count = max(2, int(math.dist(here, goal) / 0.05))
            way = here + np.linspace(0.0, 1.0, count)[:, None] * (goal - here)
            if (self._environment.lookup(way) > self._radius_m + 0.1).all():
                self._goal = (float(goal[0]), float(goal[1]))
                self._is_careful = not self._is_careful
                return

    def _is_blocked(self, states: Sequence[ArtefactState]) -> bool:
        ahead = (
            self.x_m + _LOOK_AHEAD_M * math.cos(self.yaw_rad),
            self.y_m + _LOOK_AHEAD_M * math.sin(self.yaw_rad),
        )
        return any(
            math.dist(ahead, (s.ground_pose.x_m, s.ground_pose.y_m)) < _LOOK_AHEAD_M for s in states
        )


def _open_points(environment: Environment, radius_m: float) -> npt.NDArray[np.float64]:
    """Return up to 500 points of the largest part of the map where the robot fits."""
    import cv2

    open_cells = environment.clearance_m > radius_m + _ROOM_M
    if not open_cells.any():
        raise MapError(
            f"the robot fits nowhere on the map: a soak wants its radius of {radius_m:g} m "
            f"(robot.radius) and {_ROOM_M:g} m around it free"
        )
    _, labels, stats, _ = cv2.connectedComponentsWithStats(open_cells.view(np.uint8))
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    cells = np.argwhere(labels == largest)
    chosen = cells[:: max(1, len(cells) // 500)]
    middle = chosen[np.argsort(np.abs(chosen - chosen.mean(axis=0)).sum(axis=1), kind="stable")]
    return environment.grid.cells_to_points(middle)


_WAY_STEP_S = 0.5
_LONGEST_EMPTY_S = 60.0
_SHORTEST_STEP_S = 0.01
_LONGEST_BLOCKED_S = 600.0
_ALONG_AXIS_RAD = math.radians(5.0)


@dataclass(eq=False)
class Way:
    """The positions of an artefact, twice a second; `jumps` are the points it was displaced to."""

    class_name: str = ""
    points_m: list[tuple[float, float]] = field(default_factory=list)
    jumps: set[int] = field(default_factory=set)


@dataclass(frozen=True)
class SoakResult:
    """The verdict, the number of resolved collisions, and the ways by id."""

    verdict: Verdict
    counts: MotionCounts
    contacts: int
    blocked: int
    simulated_s: float
    ways: dict[int, Way]
    robot_way_m: list[tuple[float, float]]
    map_yaw_rad: float

    @property
    def resolved_share(self) -> float:
        """The share of artefact-seconds in which a collision was resolved, not avoided."""
        steps = max(self.counts.artefact_steps, 1)
        return (self.counts.moved_back + self.counts.displaced) / steps

    @property
    def along_axes_share(self) -> float:
        """The share of metres gone within 5 degrees of an axis of the map's grid; 1/9 by chance."""
        along_m = total_m = 0.0
        for way in self.ways.values():
            for k in range(1, len(way.points_m)):
                (x0_m, y0_m), (x_m, y_m) = way.points_m[k - 1 : k + 1]
                if k in way.jumps:
                    continue
                turn = (math.atan2(y_m - y0_m, x_m - x0_m) - self.map_yaw_rad) % (0.5 * math.pi)
                step_m = math.hypot(x_m - x0_m, y_m - y0_m)
                total_m += step_m
                along_m += step_m * (min(turn, 0.5 * math.pi - turn) < _ALONG_AXIS_RAD)
        return along_m / total_m if total_m else 0.0

    @property
    def unexplained_brakes(self) -> int:
        """Brakings beyond the limits that no resolved collision accounts for."""
        return max(0, self.verdict.hard_brakes - self.counts.moved_back - self.counts.displaced)

    @property
    def is_clean(self) -> bool:
        """Whether there is no fault, and no braking without a reason."""
        return self.verdict.is_clean and not self.unexplained_brakes

    def table(self) -> list[str]:
        """Return the result as lines of text."""
        counts = self.counts
        share = f"{100.0 * self.resolved_share:.4f} % of artefact-seconds"
        resolved = f"{counts.moved_back} moved back, {counts.displaced} displaced, {share}"
        return [
            f"simulated {self.simulated_s:.0f} s, {counted(self.blocked, 'arrival')} blocked",
            f"collisions resolved: {resolved}",
            f"brakings that nothing explains: {self.unexplained_brakes}",
            f"contacts with the robot: {self.contacts}",
            f"along the grid's axes: {100.0 * self.along_axes_share:.0f} % of the metres gone",
            "",
            *self.verdict.table(),
        ]

    def as_json(self) -> dict[str, Any]:
        """Return the result without the ways, as plain values for JSON."""
        return {
            "is_clean": self.is_clean,
            "simulated_s": self.simulated_s,
            "blocked_arrivals": self.blocked,
            "robot_contacts": self.contacts,
            "artefact_steps": self.counts.artefact_steps,
            "moved_back": self.counts.moved_back,
            "displaced": self.counts.displaced,
            "resolved_share": self.resolved_share,
            "unexplained_brakes": self.unexplained_brakes,
            "along_axes_share": self.along_axes_share,
            **self.verdict.as_json(),
        }


def soak(
    grid: OccupancyGrid,
    parameters: Parameters,
    catalogue: Catalogue,
    *,
    artefact_minutes: float = math.inf,
    longest_s: float = math.inf,
    progress: Callable[[float], object] = lambda _: None,
) -> SoakResult:
    """Simulate artefacts on a map for some artefact-minutes, and judge each sub-step.

    It ends earlier after `longest_s`; `progress` gets the artefact-minutes so far. Raises
    ParameterError where the arrival rate is 0, MapError where no artefact has room.
    """
    if parameters.population.arrival_rate <= 0.0:
        raise ParameterError("population.arrival_rate is 0: nobody would live to be judged")
    run = SoakRun(grid, parameters, catalogue)
    while run.judge.verdict.artefact_s < 60.0 * artefact_minutes and run.now_s < longest_s:
        run.step()
        progress(run.judge.verdict.artefact_s / 60.0)
    return run.result()


class SoakRun:
    """A builder, the robot beside it, and the judge of both; `step` runs a sub-step."""

    def __init__(self, grid: OccupancyGrid, parameters: Parameters, catalogue: Catalogue) -> None:
        self._step_s = parameters.motion.step
        self._radius_m = parameters.robot.radius
        if self._step_s < _SHORTEST_STEP_S:
            raise ParameterError(
                f"motion.step is {self._step_s:g} s: a soak looks at every sub-step, "
                f"which takes {_SHORTEST_STEP_S:g} s or more"
            )
        parameters = _with_roving_robot(parameters)
        self.builder = ArBuilder(parameters, catalogue, MOTION_ONLY)
        self.builder.receive_map(grid, 0)
        environment = self.builder.world.environment
        if environment is None:
            raise MapError("nobody lives without a map")
        limits = {row.label: _limits(row.motion) for row in catalogue.rows}
        is_wall = grid.cells >= parameters.world.occupied_threshold
        walls = replace(RealMap.of_grid(grid), cells=is_wall.astype(np.int8))
        self.judge = MotionJudge(walls, limits, self._step_s)
        self._map_yaw_rad = walls.corner[2]
        self._robot = RovingRobot(environment, self._radius_m, parameters.seed)
        self._is_robot_seen = False
        self._touching: set[int] = set()
        self._index = 0
        self._rows = catalogue.rows
        self._ways: dict[int, Way] = {}
        self._robot_way_m: list[tuple[float, float]] = []

    @property
    def now_s(self) -> float:
        """The time so far."""
        return self._index * self._step_s

    def step(self) -> Tick:
        """Run a sub-step, judge it, drive the robot on, and return the tick."""
        self._index += 1
        step_ns = round(self._step_s * NS_PER_S)
        now_ns = self._index * step_ns
        tick = self.builder.step(now_ns)
        if self.now_s > _LONGEST_EMPTY_S and not self.builder.lives.area_m2:
            raise MapError("the map has no room for anybody where the robot can go")
        blocked = self.builder.lives.population.counts.blocked
        if blocked and self.now_s > _LONGEST_BLOCKED_S and not self.judge.verdict.artefact_s:
            most = self.builder.parameters.population.max_alive
            why = "the map has too little room" if most else "population.max_alive is 0"
            raise MapError(
                f"{why}: in {self.now_s:.0f} s none of "
                f"{counted(blocked, 'arrival')} found a place beside the robot"
            )
        jumped = _named(tick, EventKind.DISPLACED)
        self._touching |= _named(tick, EventKind.ROBOT_CONTACT)
        robot = self._robot
        here = (robot.x_m, robot.y_m, self._radius_m) if self._is_robot_seen else None
        excused, arrived = frozenset(self._touching), self._arrived(tick)
        states = tick.artefacts
        self.judge.judge(self.now_s, states, jumped, here, excused, arrived)
        self._touching &= _near(states, robot, self._radius_m)
        self._remember(states, jumped)
        robot.drive(self._step_s, states)
        pose = (robot.x_m, robot.y_m, 0.0)
        turn = (0.0, 0.0, math.sin(0.5 * robot.yaw_rad), math.cos(0.5 * robot.yaw_rad))
        then_ns, frames = now_ns + step_ns // 2, self.builder.parameters.frames
        self.builder.receive_transform(frames.map, frames.base, then_ns, pose, turn, then_ns)
        self._is_robot_seen = True
        return tick

    def result(self) -> SoakResult:
        """Return the result so far."""
        lives = self.builder.lives
        return SoakResult(
            self.judge.verdict,
            lives.crowd.counts,
            lives.crowd.contacts.count,
            lives.population.counts.blocked,
            self.now_s,
            self._ways,
            self._robot_way_m,
            self._map_yaw_rad,
        )

    def _arrived(self, tick: Tick) -> dict[int, tuple[float, tuple[float, float, float]]]:
        """Return time [s] and pose (x, y, yaw) of the arrivals since the last tick, by id."""
        arrived = {}
        for event in tick.events:
            if event.kind is EventKind.ARRIVED:
                scene = self.builder.lives.scene_at(event.stamp_ns)
                for artefact_id, pose in zip(scene.ids.tolist(), scene.ground_poses, strict=True):
                    if artefact_id == event.artefact_id:
                        there = (pose.x_m, pose.y_m, pose.yaw_rad)
                        arrived[artefact_id] = (event.stamp_ns / NS_PER_S, there)
        return arrived

    def _remember(self, states: tuple[ArtefactState, ...], jumped: frozenset[int]) -> None:
        """Keep the ways, at the instants of a coarser clock and about jumps."""
        is_due = self._index % max(1, round(_WAY_STEP_S / self._step_s)) == 0
        if is_due:
            self._robot_way_m.append((self._robot.x_m, self._robot.y_m))
        for state in states:
            is_jump = state.artefact_id in jumped
            if not is_due and not is_jump:
                continue
            way = self._ways.setdefault(state.artefact_id, Way(self._rows[state.row].class_name))
            here_m = (state.ground_pose.x_m, state.ground_pose.y_m)
            if is_jump:
                way.jumps.add(len(way.points_m))
            if not way.points_m or way.points_m[-1] != here_m:
                way.points_m.append(here_m)


def _with_roving_robot(parameters: Parameters) -> Parameters:
    """Return the parameters of a soak: ticks at the sub-steps, and the robot that drives about.

    The robot is a disc, for the artefacts as for the judge. Its base is fixed to nothing, and its
    poses, half a sub-step old, are new enough.
    """
    step_s, frames = parameters.motion.step, parameters.frames
    base = frames.base or "base_link"
    soaked = {
        "builder.tick_rate": 1.0 / step_s,
        "robot.footprint": "",
        "frames.base": base,
        "frames.static": [text for text in frames.static if text.split()[-1:] != [base]],
        "frames.max_age": max(frames.max_age, step_s),
    }
    return with_values(parameters, soaked)


def _limits(motion: MotionLimits) -> Limits:
    return Limits(
        motion.top_speed_mps,
        motion.acceleration_mps2,
        motion.turn_rate_radps,
        motion.turn_radius_m,
    )


def _named(tick: Tick, kind: EventKind) -> frozenset[int]:
    return frozenset(event.artefact_id for event in tick.events if event.kind is kind)


def _near(states: Sequence[ArtefactState], robot: RovingRobot, radius_m: float) -> set[int]:
    """Return the ids that are near enough to the robot to be in contact still."""
    near = set()
    for state in states:
        reach_m = radius_m + 0.5 * math.hypot(*state.size_m[:2]) + 0.2
        pose, (ahead_m, left_m, _) = state.ground_pose, state.box_centre_m
        cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        x_m = pose.x_m + cos * ahead_m - sin * left_m
        y_m = pose.y_m + sin * ahead_m + cos * left_m
        if math.hypot(x_m - robot.x_m, y_m - robot.y_m) <= reach_m:
            near.add(state.artefact_id)
    return near


# The results: soak.json, and soak.png with the ways of all artefacts.


_WAY_PX, _ROBOT_PX, _DOT_PX = 1.4, 2.0, 4.0
_WAY_ALPHA, _ROBOT_ALPHA = 0.55, 0.35


def write_soak(result: SoakResult, grid: OccupancyGrid, folder: Path) -> None:
    """Write numbers and picture into a folder, made if need be.

    InputError where that fails; then neither is left, of an earlier soak neither.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(result.as_json(), indent=2)
        (folder / RECORD).write_text(text + "\n", encoding="utf-8")
        draw_soak(result, grid, folder / PICTURE)
    except OSError as cause:
        rest = "" if left_of(folder, RESULTS) else ", none is left"
        message = f"{folder}: the results cannot be written ({why_refused(cause)}){rest}"
        raise InputError(message) from cause


def draw_soak(result: SoakResult, grid: OccupancyGrid, path: Path) -> None:
    """Write the ways on the known part of the map, in the colours of the classes. OSError."""
    ways, robot_m = [*result.ways.values()], np.array(result.robot_way_m).reshape(-1, 2)
    classes = Counter(way.class_name for way in ways)
    colours, part = class_colours(sorted(classes)), known_part(grid)
    points_m = np.concatenate((robot_m, *(np.array(way.points_m) for way in ways)))
    entries = [
        Entry(f"{name}  {classes[name]}", patch_sign(colours[name])) for name in sorted(classes)
    ]
    robot = Entry("path of the robot", line_sign(ROBOT, _ROBOT_PX, _ROBOT_ALPHA))
    sheet = Sheet.of(window_of(grid, part, points_m), [[*entries, robot]])
    draw_map(sheet.canvas, sheet.view, grid, part)
    if len(robot_m) > 1:
        sheet.canvas.line(sheet.view.pixels(robot_m), ROBOT, _ROBOT_PX, _ROBOT_ALPHA)
    for way in ways:
        _draw_way(sheet.canvas, sheet.view, way, colours[way.class_name])
    minutes, verdict = result.verdict.artefact_s / 60.0, "clean" if result.is_clean else "not clean"
    title = f"{minutes:.0f} artefact-minutes, {counted(len(ways), 'artefact')}: {verdict}"
    contacts = f"{counted(result.contacts, 'contact')} with the robot"
    sheet.write(path, title, [f"{result.simulated_s:.0f} s simulated", contacts])


def _draw_way(canvas: Canvas, view: View, way: Way, colour: Rgb) -> None:
    """Draw a way, with gaps where the artefact was displaced; a dot if it never moved."""
    places_px = view.pixels(way.points_m)
    for stretch_px in np.split(places_px, sorted(way.jumps)):
        if len(stretch_px) > 1:
            canvas.line(stretch_px, colour, _WAY_PX, _WAY_ALPHA)
    if (np.ptp(places_px, axis=0) < _WAY_PX).all():
        canvas.mark("disc", places_px[0], _DOT_PX, colour, colour, 1.0)
