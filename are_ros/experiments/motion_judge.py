"""A judge of motion that shares no geometry with what it judges: it reads the ground truth only.

At each sub-step it tests, by arithmetic of its own, whether anybody overlaps a wall, another
artefact or the robot, and whether anybody moves as its type cannot; over time, whether those who
move get anywhere, whether followers are near whom they follow, whether anybody stands for long
without a cause that can be named, and whether some wait for each other.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from are_ros.builder.outputs import ArtefactState
from are_ros.checks.oracle.plane import TOUCHING_M, Outline, PlainBoxes, overlapping
from are_ros.checks.oracle.solids import Covers, RealMap
from are_ros.experiments._judge_limits import (
    Limits,
    Motion,
    breach,
    excess,
    hard_braking_mps2,
    is_standing,
)
from are_ros.experiments._judge_patience import Patience
from are_ros.experiments.verdict import Verdict

__all__ = ("Limits", "MotionJudge")

_STOPS = frozenset({"pausing", "waiting", "talking", "looking round"})
"""Activities at a destination."""

_NEAR_LEADER_M = 4.0
_MOVES_MPS = 0.1
_FOLLOWS = re.compile(r"following|(?:following|waiting behind) artefact (\d+)")

_Pose = tuple[float, float, float]


@dataclass(slots=True)
class _Last:
    """An artefact a sub-step ago, or at its arrival; its speed is NaN where it is not known."""

    t_s: float
    pose: _Pose
    speed_mps: float
    activity: str


class MotionJudge:
    """Takes the ground truth of one sub-step after the other; nothing else is known to it."""

    def __init__(self, walls: RealMap, limits: Mapping[str, Limits], step_s: float) -> None:
        """Take a map of which all cells but 0 are walls, the limits by label, and the sub-step."""
        self.verdict = Verdict()
        self._is_wall, self._covers = walls.cells.reshape(-1) != 0, Covers(walls)
        self._limits = limits
        self._step_s = step_s
        self._last: dict[int, _Last] = {}
        self._patience = Patience(self.verdict, step_s)

    def judge(
        self,
        t_s: float,
        states: Sequence[ArtefactState],
        jumped: frozenset[int] = frozenset(),
        robot: tuple[float, float, float] | None = None,
        excused: frozenset[int] = frozenset(),
        arrived: Mapping[int, tuple[float, _Pose]] = MappingProxyType({}),
    ) -> None:
        """Judge the sub-step that ends at `t_s`.

        `jumped` are those that an event says were displaced, `excused` those in a contact with the
        robot (x, y, radius) that was reported, `arrived` when and where some came since the last.
        """
        self._judge_overlaps(t_s, states, robot, excused)
        before, self._last = self._last, {}
        for artefact_id, (came_s, pose) in arrived.items():
            before[artefact_id] = _Last(came_s, pose, math.nan, "")
        for state in states:
            last = None if state.artefact_id in jumped else before.get(state.artefact_id)
            self._last[state.artefact_id] = self._follow(t_s, state, last)
            self._judge_twist(t_s, state)
        self._patience.see(t_s, states)
        for state in states:
            if match := _FOLLOWS.fullmatch(state.activity or state.behaviour):
                self._judge_company(state, match[1], states)

    def _judge_overlaps(
        self,
        t_s: float,
        states: Sequence[ArtefactState],
        robot: tuple[float, float, float] | None,
        excused: frozenset[int],
    ) -> None:
        boxes, names = _boxes_of(states), [f"{s.label} {s.artefact_id}" for s in states]
        for i, j, _ in overlapping(boxes):
            self.verdict.note("overlaps", t_s, f"{names[i]} and {names[j]}")
        for name, cover in zip(names, self._covers.of(boxes), strict=True):
            if self._is_wall[cover.sure].any():
                self.verdict.note("walls", t_s, name)
        if robot is not None:
            x_m, y_m, radius_m = robot
            depths_m = Outline.of("", radius_m).depths_m(x_m, y_m, 0.0, boxes)
            for i in np.flatnonzero(depths_m > TOUCHING_M).tolist():
                if states[i].artefact_id not in excused:
                    self.verdict.note("robot", t_s, names[i])

    def _follow(self, t_s: float, state: ArtefactState, last: _Last | None) -> _Last:
        """Judge how one has moved, and return where it is."""
        verdict, name = self.verdict, state.behaviour
        pose = (state.ground_pose.x_m, state.ground_pose.y_m, state.ground_pose.yaw_rad)
        verdict.artefact_s += self._step_s
        verdict.lived_s[name] = verdict.lived_s.get(name, 0.0) + self._step_s
        if last is None or last.t_s >= t_s:
            return _Last(t_s, pose, math.nan, state.activity)
        if state.activity in _STOPS and last.activity not in _STOPS:
            verdict.arrivals[name] += 1
        motion = Motion.between(last.pose, pose, t_s - last.t_s)
        verdict.travelled_m[name] = verdict.travelled_m.get(name, 0.0) + motion.length_m
        verdict.moving_s += motion.step_s * (motion.length_m > 1e-3 * motion.step_s)
        limits = self._limits[state.label]
        reason = breach(motion, last.speed_mps, limits)
        if reason:
            verdict.note("limits", t_s, f"{state.label} {state.artefact_id}: {reason}")
        braking_mps2 = hard_braking_mps2(motion, last.speed_mps, limits)
        if braking_mps2:
            verdict.note_braking(braking_mps2, is_dead_stop=is_standing(motion))
        return _Last(t_s, pose, motion.speed_mps, state.activity)

    def _judge_twist(self, t_s: float, state: ArtefactState) -> None:
        """Judge the velocities that one is said to have."""
        reason = excess(
            math.hypot(*state.linear_velocity_m_s),
            abs(state.angular_velocity_rad_s[2]),
            self._limits[state.label],
        )
        if reason:
            self.verdict.note(
                "limits", t_s, f"{state.label} {state.artefact_id}: its twist {reason}"
            )

    def _judge_company(
        self, state: ArtefactState, leader: str | None, states: Sequence[ArtefactState]
    ) -> None:
        """Count how near a follower is: to its leader, or to the nearest who moves if none is said.

        One that walks for want of a leader does not follow anybody.
        """
        others = [s for s in states if s.artefact_id != state.artefact_id]
        if leader is not None:
            others = [s for s in others if s.artefact_id == int(leader)]
        else:
            others = [s for s in others if self._moves(s.artefact_id)]
        gaps_m = [_apart_m(state, other) for other in others]
        if gaps_m:
            gap_m = min(gaps_m)
            self.verdict.company.note(gap_m, self._step_s, is_near=gap_m <= _NEAR_LEADER_M)

    def _moves(self, artefact_id: int) -> bool:
        speed_mps = self._last[artefact_id].speed_mps
        return abs(speed_mps) > _MOVES_MPS


def _boxes_of(states: Sequence[ArtefactState]) -> PlainBoxes:
    """Return the boxes of artefacts, which stand on their ground poses."""
    poses = [state.ground_pose for state in states]
    feet_m = np.array([(p.x_m, p.y_m, p.z_m) for p in poses], np.float64).reshape(-1, 3)
    yaws_rad = np.array([pose.yaw_rad for pose in poses], np.float64)
    offsets_m = np.array([state.box_centre_m for state in states], np.float64).reshape(-1, 3)
    sizes_m = np.array([state.size_m for state in states], np.float64).reshape(-1, 3)
    return PlainBoxes.standing(feet_m, yaws_rad, offsets_m, sizes_m)


def _apart_m(one: ArtefactState, other: ArtefactState) -> float:
    here, there = one.ground_pose, other.ground_pose
    return math.hypot(here.x_m - there.x_m, here.y_m - there.y_m)
