"""A judge of motion that shares no code with what it judges: it reads the ground truth only.

At each sub-step it tests, by arithmetic of its own, whether anybody overlaps a wall, another
artefact or the robot, and whether anybody moves as its type cannot; over time, whether those who
move get anywhere, and whether anybody stands for long without a cause that can be named.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from are_ros.builder.outputs import ArtefactState
from are_ros.world.occupancy_grid import OccupancyGrid

_TOUCH_M = 1e-6
_STILL_M = 0.3
_STILL_S = 60.0
_NO_CAUSE = ("", "walking", "driving", "running", "wandering", "following", "leaving")

_Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Limits:
    """What a type can do: top speed [m/s], acceleration [m/s^2], turn rate [rad/s], radius [m]."""

    speed_mps: float
    acceleration_mps2: float
    turn_rate_radps: float
    turn_radius_m: float


@dataclass
class Verdict:
    """What was counted; every list holds sentences, the first fifty of each."""

    artefact_s: float = 0.0
    moving_s: float = 0.0
    overlaps: list[str] = field(default_factory=list)
    walls: list[str] = field(default_factory=list)
    robot: list[str] = field(default_factory=list)
    limits: list[str] = field(default_factory=list)
    still: list[str] = field(default_factory=list)
    causes: Counter[str] = field(default_factory=Counter)
    travelled_m: dict[str, float] = field(default_factory=dict)
    lived_s: dict[str, float] = field(default_factory=dict)
    arrivals: int = 0

    @property
    def is_clean(self) -> bool:
        """Whether nothing was found that must not be."""
        return not (self.overlaps or self.walls or self.robot or self.limits or self.still)


@dataclass
class _Life:
    """What is kept of one artefact: where it was a sub-step ago, and since when it stands.

    The speed is NaN where it is not known: in the sub-step of its arrival it may have set off.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    speed_mps: float
    anchor: tuple[float, float]
    since_s: float
    is_told: bool = False
    activity: str = ""


class MotionJudge:
    """Takes the ground truth of one sub-step after the other."""

    def __init__(self, grid: OccupancyGrid, occupied: npt.NDArray[np.bool_], step_s: float) -> None:
        """Take the map, which of its cells are occupied, and the length of a sub-step."""
        self.verdict = Verdict()
        self._step_s = step_s
        self._walls = _Walls(grid, occupied)
        self._lives: dict[int, _Life] = {}

    def judge(
        self,
        t_s: float,
        states: Sequence[ArtefactState],
        limits: Mapping[str, Limits],
        jumped: frozenset[int],
        robot: tuple[float, float, float] | None,
        excused: frozenset[int],
    ) -> None:
        """Judge a sub-step at `t_s`.

        `limits` by label; `jumped` are those that an event says were displaced, `excused` those in
        a contact with the robot (x, y, radius) that was reported.
        """
        boxes = _boxes(states)
        ids = [state.artefact_id for state in states]
        labels = [state.label for state in states]
        for i, j in _overlapping(boxes):
            self._note("overlaps", t_s, f"{labels[i]} {ids[i]} and {labels[j]} {ids[j]}")
        for i in self._walls.met(boxes):
            self._note("walls", t_s, f"{labels[i]} {ids[i]}")
        if robot is not None:
            for i in _met_by_disc(boxes, *robot):
                if ids[i] not in excused:
                    self._note("robot", t_s, f"{labels[i]} {ids[i]}")
        before, self._lives = self._lives, {}
        for state in states:
            life = before.get(state.artefact_id)
            self._follow(t_s, state, life, limits[state.label], state.artefact_id in jumped)

    def _follow(
        self, t_s: float, state: ArtefactState, life: _Life | None, limits: Limits, jumped: bool
    ) -> None:
        pose, verdict = state.ground_pose, self.verdict
        verdict.artefact_s += self._step_s
        name = state.behaviour
        verdict.lived_s[name] = verdict.lived_s.get(name, 0.0) + self._step_s
        if life is None or jumped:
            here = (pose.x_m, pose.y_m)
            self._lives[state.artefact_id] = _Life(*here, pose.yaw_rad, math.nan, here, t_s)
            return
        self._lives[state.artefact_id] = life
        dx_m, dy_m = pose.x_m - life.x_m, pose.y_m - life.y_m
        moved_m = math.hypot(dx_m, dy_m)
        turn_rad = math.remainder(pose.yaw_rad - life.yaw_rad, math.tau)
        middle_rad = life.yaw_rad + 0.5 * turn_rad
        along_m = dx_m * math.cos(middle_rad) + dy_m * math.sin(middle_rad)
        across_m = dy_m * math.cos(middle_rad) - dx_m * math.sin(middle_rad)
        speed_mps = along_m / self._step_s
        verdict.travelled_m[name] = verdict.travelled_m.get(name, 0.0) + moved_m
        verdict.moving_s += self._step_s * (moved_m > 1e-4 * self._step_s)
        reason = _beyond(limits, self._step_s, speed_mps, life.speed_mps, turn_rad, across_m)
        if reason:
            self._note("limits", t_s, f"{state.label} {state.artefact_id}: {reason}")
        life.x_m, life.y_m, life.yaw_rad, life.speed_mps = (
            pose.x_m,
            pose.y_m,
            pose.yaw_rad,
            speed_mps,
        )
        self._watch_standing(t_s, state, life)

    def _watch_standing(self, t_s: float, state: ArtefactState, life: _Life) -> None:
        pose = state.ground_pose
        if state.activity == "pausing" and life.activity not in {"pausing", ""}:
            self.verdict.arrivals += 1
        life.activity = state.activity or state.behaviour
        if math.dist(life.anchor, (pose.x_m, pose.y_m)) > _STILL_M or state.behaviour == "standing":
            life.anchor, life.since_s, life.is_told = (pose.x_m, pose.y_m), t_s, False
        elif t_s - life.since_s > _STILL_S and not life.is_told:
            life.is_told = True
            cause = state.activity or state.behaviour
            self.verdict.causes[cause] += 1
            if cause in _NO_CAUSE:
                self._note("still", t_s, f"{state.label} {state.artefact_id} ({state.behaviour})")

    def _note(self, kind: str, t_s: float, sentence: str) -> None:
        noted: list[str] = getattr(self.verdict, kind)
        if len(noted) < 50:
            noted.append(f"{t_s:.2f} s: {sentence}")


def _beyond(
    limits: Limits,
    step_s: float,
    speed_mps: float,
    before_mps: float,
    turn_rad: float,
    across_m: float,
) -> str:
    """Return how a motion breaks the limits, empty where it does not."""
    turn_rate = abs(turn_rad) / step_s
    if abs(speed_mps) > limits.speed_mps * 1.001 + 1e-6:
        return f"speed {speed_mps:.3f} m/s, at most {limits.speed_mps:g}"
    if turn_rate > limits.turn_rate_radps * 1.001 + 1e-6:
        return f"turns at {turn_rate:.3f} rad/s, at most {limits.turn_rate_radps:g}"
    change = abs(speed_mps) - abs(before_mps)
    if abs(speed_mps - before_mps) / step_s > limits.acceleration_mps2 * 1.02 + 1e-6 and change > 0:
        return f"gains {(speed_mps - before_mps) / step_s:.3f} m/s^2"
    if abs(across_m) > 1e-4 + 0.002 * abs(speed_mps) * step_s:
        return f"slides {across_m * 1000:.2f} mm sideways"
    radius_m = limits.turn_radius_m
    if radius_m > 0.0 and turn_rate * radius_m > abs(speed_mps) * 1.01 + 1e-3:
        return (
            f"turns at {turn_rate:.3f} rad/s with {speed_mps:.3f} m/s: radius below {radius_m:g} m"
        )
    return ""


def _boxes(states: Sequence[ArtefactState]) -> _Floats:
    """Return rows x, y, yaw, half length, half width, low z, high z of the boxes."""
    rows = []
    for state in states:
        pose, (bx, by, _), (lx, ly, lz) = state.ground_pose, state.box_centre_m, state.size_m
        c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        x_m, y_m = pose.x_m + c * bx - s * by, pose.y_m + s * bx + c * by
        rows.append((x_m, y_m, pose.yaw_rad, lx / 2, ly / 2, pose.z_m, pose.z_m + lz))
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


def _corners(boxes: _Floats) -> _Floats:
    """Return the corners (N, 4, 2) of the footprints."""
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    local = signs * boxes[:, None, 3:5]
    c, s = np.cos(boxes[:, 2])[:, None], np.sin(boxes[:, 2])[:, None]
    x, y = c * local[..., 0] - s * local[..., 1], s * local[..., 0] + c * local[..., 1]
    return boxes[:, None, :2] + np.stack((x, y), axis=-1)


def _overlapping(boxes: _Floats) -> list[tuple[int, int]]:
    """Return the pairs whose footprints share more than a touch, and whose heights do."""
    if len(boxes) < 2:
        return []
    reach = np.hypot(boxes[:, 3], boxes[:, 4])
    pairs = cKDTree(boxes[:, :2]).query_pairs(2.0 * float(reach.max()))
    corners, found = _corners(boxes), []
    for i, j in sorted(pairs):
        is_high = min(boxes[i, 6], boxes[j, 6]) - max(boxes[i, 5], boxes[j, 5]) > _TOUCH_M
        if is_high and _share_area(corners[i], corners[j]):
            found.append((i, j))
    return found


def _share_area(one: _Floats, other: _Floats) -> bool:
    """Tell whether two convex polygons (K, 2) overlap by more than a touch: separating axes."""
    for polygon in (one, other):
        edges = np.roll(polygon, -1, axis=0) - polygon
        normals = np.column_stack((edges[:, 1], -edges[:, 0]))
        normals /= np.hypot(normals[:, 0], normals[:, 1])[:, None]
        a, b = one @ normals.T, other @ normals.T
        depth = np.minimum(a.max(axis=0), b.max(axis=0)) - np.maximum(a.min(axis=0), b.min(axis=0))
        if (depth <= _TOUCH_M).any():
            return False
    return True


def _met_by_disc(boxes: _Floats, x_m: float, y_m: float, radius_m: float) -> list[int]:
    """Return which boxes a disc on the ground overlaps by more than a touch."""
    dx, dy = x_m - boxes[:, 0], y_m - boxes[:, 1]
    c, s = np.cos(boxes[:, 2]), np.sin(boxes[:, 2])
    along = np.maximum(np.abs(c * dx + s * dy) - boxes[:, 3], 0.0)
    across = np.maximum(np.abs(c * dy - s * dx) - boxes[:, 4], 0.0)
    return [int(i) for i in np.flatnonzero(np.hypot(along, across) < radius_m - _TOUCH_M)]


class _Walls:
    """The occupied cells of a map, as squares that footprints are tested against."""

    def __init__(self, grid: OccupancyGrid, occupied: npt.NDArray[np.bool_]) -> None:
        centres_m = grid.cells_to_points(np.argwhere(occupied))
        self._tree = cKDTree(centres_m)
        self._centres_m = centres_m
        half, yaw = 0.5 * grid.resolution_m, grid.origin.yaw_rad()
        c, s = math.cos(yaw), math.sin(yaw)
        square = half * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
        self._square = square @ np.array([(c, s), (-s, c)])
        self._reach_m = half * math.sqrt(2.0)

    def met(self, boxes: _Floats) -> list[int]:
        """Return which footprints overlap an occupied cell by more than a touch."""
        if not len(boxes):
            return []
        reach = np.hypot(boxes[:, 3], boxes[:, 4]) + self._reach_m
        distances, _ = self._tree.query(boxes[:, :2])
        corners = _corners(boxes)
        near = np.flatnonzero(distances < reach).tolist()
        return [i for i in near if self._meets(corners[i], boxes[i], reach[i])]

    def _meets(self, corners: _Floats, box: _Floats, reach_m: float) -> bool:
        near = self._centres_m[self._tree.query_ball_point(box[:2], reach_m)]
        c, s = math.cos(box[2]), math.sin(box[2])
        local = near - box[:2]
        along = np.abs(c * local[:, 0] + s * local[:, 1]) - box[3]
        across = np.abs(c * local[:, 1] - s * local[:, 0]) - box[4]
        candidates = near[(along < self._reach_m) & (across < self._reach_m)]
        return any(_share_area(corners, centre + self._square) for centre in candidates)
