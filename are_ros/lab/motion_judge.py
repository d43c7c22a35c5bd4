"""A judge of motion, and its findings: counts and sentences, and both as a table.

It reads the ground truth only, and shares no geometry with the builder. At each sub-step it tests
for overlaps with walls, artefacts and the robot, and for motion beyond the limits of the type. Over
time it tests whether moving artefacts arrive, whether followers stay near their leaders, whether an
artefact stands for long without a named cause, and for deadlocks; and it counts the vehicles that
go to and fro.
"""

import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from are_ros.agents.events import ArtefactState
from are_ros.checks.oracle.plane import TOUCHING_M, Outline, PlainBoxes, overlapping
from are_ros.checks.oracle.solids import Covers, RealMap
from are_ros.wording import aligned, counted

FAULTS: Final = {
    "overlaps": "overlaps of artefacts",
    "walls": "overlaps with walls",
    "robot": "overlaps with the robot, unreported",
    "limits": "limits of motion broken",
    "still": "a minute's stand without a cause",
    "deadlocks": "waiting for each other over a minute",
}
"""Faults by kind: the words of the table."""

_KEPT_SENTENCES = 50


@dataclass
class FollowerGaps:
    """The distance of followers from their leaders, over all seconds of following."""

    followed_s: float = 0.0
    near_s: float = 0.0
    gaps_m: float = 0.0

    def note(self, gap_m: float, seconds: float, *, is_near: bool) -> None:
        """Count some seconds at a distance from the leader."""
        self.followed_s += seconds
        self.near_s += seconds * is_near
        self.gaps_m += seconds * gap_m

    @property
    def near_share(self) -> float:
        """The share of the time near the leader; 1 without followers."""
        return self.near_s / self.followed_s if self.followed_s else 1.0

    @property
    def mean_gap_m(self) -> float:
        """The mean distance from the leader; 0 without followers."""
        return self.gaps_m / self.followed_s if self.followed_s else 0.0


@dataclass
class LongStand:
    """An artefact that stood for more than a minute: its place, start, duration and cause."""

    artefact_id: int
    label: str
    behaviour: str
    since_s: float
    stood_s: float
    x_m: float
    y_m: float
    cause: str


@dataclass
class ToAndFro:
    """How often a vehicle drove for more than a minute and got nowhere, and the longest time."""

    times: int = 0
    longest_s: float = 0.0


@dataclass
class Verdict:
    """What was counted; `found` by kind of `FAULTS`, with a sentence for the first fifty of each.

    Brakings harder than the type's acceleration are apart, for only a resolved collision may cause
    them; `dead_stops` are those of them that ended in a stand within the sub-step. `stands` are
    those of more than a minute, `causes` counts them by cause, `longest_s` is the longest.
    `travelled_m`, `lived_s` and `arrivals` (stops at a destination) are by behaviour.
    """

    artefact_s: float = 0.0
    moving_s: float = 0.0
    found: Counter[str] = field(default_factory=Counter)
    sentences: dict[str, list[str]] = field(default_factory=dict)
    hard_brakes: int = 0
    dead_stops: int = 0
    hardest_mps2: float = 0.0
    stands: list[LongStand] = field(default_factory=list)
    causes: Counter[str] = field(default_factory=Counter)
    longest_s: dict[str, float] = field(default_factory=dict)
    travelled_m: dict[str, float] = field(default_factory=dict)
    lived_s: dict[str, float] = field(default_factory=dict)
    arrivals: Counter[str] = field(default_factory=Counter)
    follower_gaps: FollowerGaps = field(default_factory=FollowerGaps)
    to_and_fro: ToAndFro = field(default_factory=ToAndFro)

    @property
    def is_clean(self) -> bool:
        """Whether no fault was found."""
        return not self.found

    def note(self, kind: str, t_s: float, sentence: str) -> None:
        """Count a fault at a time."""
        self.found[kind] += 1
        kept = self.sentences.setdefault(kind, [])
        if len(kept) < _KEPT_SENTENCES:
            kept.append(f"{t_s:.2f} s: {sentence}")

    def arrivals_per_minute(self, behaviour: str) -> float:
        """Return how often an artefact of a behaviour stops at a destination, per minute."""
        lived_s = self.lived_s.get(behaviour, 0.0)
        return 60.0 * self.arrivals[behaviour] / lived_s if lived_s else 0.0

    def table(self) -> list[str]:
        """Return the findings as lines of text."""
        lines = _columns(self._summary())
        lines += ["", *_columns(self._behaviours())]
        if self.causes:
            lines += ["", *_columns(self._stands())]
        for kind, sentences in self.sentences.items():
            lines += ["", f"{FAULTS[kind]}:", *(f"  {sentence}" for sentence in sentences[:5])]
        return lines

    def as_json(self) -> dict[str, Any]:
        """Return the findings as plain values for JSON."""
        return {
            "artefact_minutes": self.artefact_s / 60.0,
            "moving_minutes": self.moving_s / 60.0,
            "faults": {kind: self.found[kind] for kind in FAULTS},
            "sentences": self.sentences,
            "hard_brakes": self.hard_brakes,
            "dead_stops": self.dead_stops,
            "hardest_braking_mps2": self.hardest_mps2,
            "stands": [asdict(stand) for stand in self.stands],
            "stands_by_cause": dict(sorted(self.causes.items())),
            "longest_stand_s": dict(sorted(self.longest_s.items())),
            "lived_s": dict(sorted(self.lived_s.items())),
            "travelled_m": dict(sorted(self.travelled_m.items())),
            "arrivals": dict(sorted(self.arrivals.items())),
            "to_and_fro": asdict(self.to_and_fro),
            "followed_s": self.follower_gaps.followed_s,
            "near_leader_share": self.follower_gaps.near_share,
            "mean_gap_m": self.follower_gaps.mean_gap_m,
        }

    def _summary(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = [
            ("artefact-minutes", f"{self.artefact_s / 60.0:.1f}"),
            ("of them moving", f"{self.moving_s / 60.0:.1f}"),
            *((words, str(self.found[kind])) for kind, words in FAULTS.items()),
        ]
        stops = f" ({counted(self.dead_stops, 'dead stop')})" if self.hard_brakes else ""
        rows.append(("brakings beyond the limit", f"{self.hard_brakes}{stops}"))
        longest = f" (longest {self.to_and_fro.longest_s:.0f} s)" if self.to_and_fro.times else ""
        rows.append(("vehicles to and fro, a minute", f"{self.to_and_fro.times}{longest}"))
        if self.follower_gaps.followed_s:
            near, gap = self.follower_gaps.near_share, self.follower_gaps.mean_gap_m
            rows.append(("time that followers are near", f"{100.0 * near:.0f} %"))
            rows.append(("mean distance to the leader", f"{gap:.2f} m"))
        return rows

    def _behaviours(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = [("behaviour", "minutes", "m/s", "pauses/min")]
        for name, lived_s in sorted(self.lived_s.items()):
            speed_mps = self.travelled_m.get(name, 0.0) / lived_s
            rate = self.arrivals_per_minute(name)
            rows.append((name, f"{lived_s / 60.0:.1f}", f"{speed_mps:.2f}", f"{rate:.2f}"))
        return rows

    def _stands(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = [("stands over a minute", "times", "longest [s]")]
        for cause, count in self.causes.most_common():
            rows.append((cause, str(count), f"{self.longest_s.get(cause, 0.0):.0f}"))
        return rows


def _columns(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Return rows of cells as lines; all columns but the first to the right."""
    return [line[2:] for line in aligned(rows, range(1, len(rows[0])))]


# Limits of motion: speed, acceleration, turning, and no sliding sideways.


_FASTER, _STRONGER = 1.001, 1.02
"""What rounding may add: positions are rounded, and accelerations are their second differences."""

_STANDS_MPS = 1e-6


@dataclass(frozen=True)
class Limits:
    """What a type can do: top speed [m/s], acceleration [m/s^2], turn rate [rad/s], radius [m].

    `turn_radius_m` is the radius of its smallest circle; with 0 it turns on the spot.
    """

    speed_mps: float
    acceleration_mps2: float
    turn_rate_radps: float
    turn_radius_m: float


@dataclass(frozen=True)
class Motion:
    """The motion in a sub-step: along the mean heading, across it, and the turn."""

    step_s: float
    along_m: float
    across_m: float
    turn_rad: float

    @classmethod
    def between(
        cls, start: tuple[float, float, float], end: tuple[float, float, float], step_s: float
    ) -> "Motion":
        """Return the motion from one x, y, yaw to another: on an arc, the chord is along."""
        dx_m, dy_m = end[0] - start[0], end[1] - start[1]
        turn_rad = math.remainder(end[2] - start[2], math.tau)
        middle_rad = start[2] + 0.5 * turn_rad
        c, s = math.cos(middle_rad), math.sin(middle_rad)
        return cls(step_s, dx_m * c + dy_m * s, dy_m * c - dx_m * s, turn_rad)

    @property
    def speed_mps(self) -> float:
        """The speed along the heading; negative in reverse."""
        return self.along_m / self.step_s

    @property
    def length_m(self) -> float:
        """How far it came."""
        return math.hypot(self.along_m, self.across_m)


def excess(speed_mps: float, turn_rate: float, limits: Limits) -> str:
    """Return which of a speed and a turn rate [rad/s] is too high; empty if none is."""
    if speed_mps > limits.speed_mps * _FASTER + 1e-6:
        return f"speed {speed_mps:.3f} m/s, at most {limits.speed_mps:g}"
    if turn_rate > limits.turn_rate_radps * _FASTER + 1e-6:
        return f"turns at {turn_rate:.3f} rad/s, at most {limits.turn_rate_radps:g}"
    return ""


def breach(motion: Motion, before_mps: float, limits: Limits) -> str:
    """Return how a motion after a speed (NaN: unknown) breaks the limits, empty if it does not."""
    speed_mps, turn_rate = motion.speed_mps, abs(motion.turn_rad) / motion.step_s
    too_fast = excess(motion.length_m / motion.step_s, turn_rate, limits)
    if too_fast:
        return too_fast
    gain = (speed_mps - before_mps) / motion.step_s
    if abs(speed_mps) > abs(before_mps) and _is_beyond(gain, limits):
        return f"gains {gain:.3f} m/s^2, at most {limits.acceleration_mps2:g}"
    if abs(motion.across_m) > 1e-4 + 0.002 * abs(motion.along_m):
        return f"slides {1000.0 * motion.across_m:.2f} mm sideways"
    radius_m = limits.turn_radius_m
    if radius_m > 0.0 and turn_rate * radius_m > abs(speed_mps) * 1.01 + 1e-3:
        speeds = f"{turn_rate:.3f} rad/s with {speed_mps:.3f} m/s"
        return f"turns at {speeds}: radius below {radius_m:g} m"
    return ""


def hard_braking_mps2(motion: Motion, before_mps: float, limits: Limits) -> float:
    """Return the deceleration where it is beyond the limit, else 0."""
    change = (motion.speed_mps - before_mps) / motion.step_s
    is_braking = abs(motion.speed_mps) <= abs(before_mps)
    return abs(change) if is_braking and _is_beyond(change, limits) else 0.0


def is_standing(motion: Motion) -> bool:
    """Tell whether the body is where it was."""
    return abs(motion.speed_mps) <= _STANDS_MPS


def _is_beyond(change_mps2: float, limits: Limits) -> bool:
    # Positions rounded to float64 are exact enough; the millimetre per second is for arcs.
    return abs(change_mps2) > limits.acceleration_mps2 * _STRONGER + 1e-3


# Artefacts that stand for long, their causes, and deadlocks.


STILL_S = 60.0
_STILL_M = 0.3
_WITHOUT_CAUSE = frozenset(
    {
        "",
        "walking",
        "driving",
        "running",
        "wandering",
        "following",
        "crossing",
        "avoiding",
        "leaving",
        "on its way",
    }
)
"""Activities of moving artefacts: none is a reason to stand."""

_WAITS_FOR = re.compile(r"waiting for artefact (\d+)")


@dataclass
class _Stand:
    """A stretch of time within 0.3 m: since when, and the seconds of each activity."""

    place_m: tuple[float, float]
    since_s: float
    seconds: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    cause: str | None = None
    noted: LongStand | None = None

    def main_cause(self) -> str:
        """Return the cause of most of the time that has one; empty if that is less than half."""
        named = {what: s for what, s in self.seconds.items() if not _gets_on(what)}
        if 2.0 * sum(named.values()) < sum(self.seconds.values()):
            return ""
        return max(named, key=lambda what: (named[what], what))

    def doings(self, behaviour: str) -> str:
        """Return its activities with their seconds, the longest first."""
        said = sorted(self.seconds.items(), key=lambda item: (-item[1], item[0]))
        return ", ".join(f"{what or behaviour} {seconds:.0f} s" for what, seconds in said)


class StandWatch:
    """Looks at all artefacts in each sub-step, and reports those that stand too long."""

    def __init__(self, verdict: Verdict, step_s: float) -> None:
        self._verdict = verdict
        self._step_s = step_s
        self._stands: dict[int, _Stand] = {}
        self._deadlocks: set[frozenset[int]] = set()

    def see(self, t_s: float, states: Iterable[ArtefactState]) -> None:
        """Take a sub-step; an artefact that is not among the states has departed."""
        before, self._stands = self._stands, {}
        for state in states:
            pose = state.ground_pose
            here_m = (pose.x_m, pose.y_m)
            stand = before.get(state.artefact_id)
            is_free = state.behaviour == "standing" and state.activity in {"", "standing"}
            if stand is None or is_free or math.dist(stand.place_m, here_m) > _STILL_M:
                stand = _Stand(here_m, t_s)
            self._stands[state.artefact_id] = stand
            stand.seconds[state.activity] += self._step_s
            self._judge(t_s, state, stand)
        self._find_deadlocks(t_s)

    def _judge(self, t_s: float, state: ArtefactState, stand: _Stand) -> None:
        """Name the cause as soon as the stand is too long, and keep the longest of each."""
        stood_s = t_s - stand.since_s
        if stood_s <= STILL_S:
            return
        verdict = self._verdict
        if stand.cause is None:
            stand.cause = stand.main_cause()
            verdict.causes[_kind(stand.cause)] += 1
            who = (state.artefact_id, state.label, state.behaviour)
            x_m, y_m = (round(coordinate, 3) for coordinate in stand.place_m)
            since_s, cause = round(stand.since_s, 2), stand.cause or "no cause"
            stand.noted = LongStand(*who, since_s, 0.0, x_m, y_m, cause)
            verdict.stands.append(stand.noted)
            if not stand.cause:
                name = f"{state.label} {state.artefact_id} ({state.behaviour})"
                verdict.note("still", t_s, f"{name}: {stand.doings(state.behaviour)}")
        if stand.noted is not None:
            stand.noted.stood_s = round(stood_s, 2)
        kind = _kind(stand.cause)
        verdict.longest_s[kind] = max(verdict.longest_s.get(kind, 0.0), stood_s)

    def _find_deadlocks(self, t_s: float) -> None:
        """Report artefacts that have stood for long and wait for each other in a circle."""
        awaited = {}
        for artefact_id, stand in self._stands.items():
            if stand.cause is not None and (match := _WAITS_FOR.fullmatch(stand.main_cause())):
                awaited[artefact_id] = int(match[1])
        circles = {circle for one in awaited if (circle := _circle_of(one, awaited))}
        for circle in sorted(circles - self._deadlocks, key=min):
            self._verdict.note("deadlocks", t_s, "artefacts " + ", ".join(map(str, sorted(circle))))
        self._deadlocks = circles


def _gets_on(activity: str) -> bool:
    """Tell whether an artefact moves in this activity."""
    return activity.partition(" artefact ")[0] in _WITHOUT_CAUSE


def _kind(cause: str) -> str:
    """Return the cause without the number of the artefact."""
    return re.sub(r" \d+$", "", cause) or "no cause"


def _circle_of(start: int, awaited: Mapping[int, int]) -> frozenset[int]:
    """Return the circle of waiting that one is part of; empty if it is of none."""
    way, here = [start], awaited.get(start)
    while here is not None and here not in way:
        way.append(here)
        here = awaited.get(here)
    return frozenset(way) if here == start else frozenset()


_NOWHERE_M, _DRIVEN_M = 3.0, 6.0
"""Who drives the second distance, and stays within the first of where it began, gets nowhere."""


@dataclass(slots=True)
class _Stay:
    """A stretch of time near a place: since when, how far it was driven, and if it was counted."""

    place_m: tuple[float, float]
    since_s: float
    driven_m: float = 0.0
    is_counted: bool = False


class ToAndFroWatch:
    """Counts the vehicles that go to and fro for longer than a minute."""

    def __init__(self, found: ToAndFro) -> None:
        self._found = found
        self._stays: dict[int, _Stay] = {}

    def see(
        self, t_s: float, states: Iterable[ArtefactState], moved_m: Mapping[int, float]
    ) -> None:
        """Take a sub-step: the vehicles, and how far each has come in it."""
        before, self._stays = self._stays, {}
        for state in states:
            here_m = (state.ground_pose.x_m, state.ground_pose.y_m)
            stay = before.get(state.artefact_id)
            if stay is None or math.dist(stay.place_m, here_m) > _NOWHERE_M:
                stay = _Stay(here_m, t_s)
            stay.driven_m += moved_m.get(state.artefact_id, 0.0)
            self._stays[state.artefact_id] = stay
            stayed_s = t_s - stay.since_s
            if stayed_s > STILL_S and stay.driven_m > _DRIVEN_M:
                self._found.times += not stay.is_counted
                stay.is_counted = True
                self._found.longest_s = max(self._found.longest_s, stayed_s)


_STOPS = frozenset({"pausing", "waiting", "talking", "looking round"})
"""Activities at a destination."""

_NEAR_LEADER_M = 4.0
_FOLLOWS = re.compile(r"(?:following|waiting behind) artefact (\d+)")

_Pose = tuple[float, float, float]


@dataclass(slots=True)
class _Last:
    """An artefact a sub-step ago, or at its arrival; its speed is NaN where it is not known."""

    t_s: float
    pose: _Pose
    speed_mps: float
    activity: str
    moved_m: float = 0.0


class MotionJudge:
    """Judges the ground truth of one sub-step after the other; it sees nothing else."""

    def __init__(self, walls: RealMap, limits: Mapping[str, Limits], step_s: float) -> None:
        """Take a map whose cells are walls unless 0, the limits by label, and the sub-step [s]."""
        self.verdict = Verdict()
        self._is_wall, self._covers = walls.cells.reshape(-1) != 0, Covers(walls)
        self._limits = limits
        self._step_s = step_s
        self._last: dict[int, _Last] = {}
        self._stands_watch = StandWatch(self.verdict, step_s)
        self._to_and_fro_watch = ToAndFroWatch(self.verdict.to_and_fro)

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
        self._stands_watch.see(t_s, states)
        moved_m = {one: last.moved_m for one, last in self._last.items()}
        vehicles = [state for state in states if self._limits[state.label].turn_radius_m > 0.0]
        self._to_and_fro_watch.see(t_s, vehicles, moved_m)
        for state in states:
            if match := _FOLLOWS.fullmatch(state.activity):
                self._judge_following(state, int(match[1]), states)

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
            verdict.hard_brakes += 1
            verdict.dead_stops += is_standing(motion)
            verdict.hardest_mps2 = max(verdict.hardest_mps2, braking_mps2)
        return _Last(t_s, pose, motion.speed_mps, state.activity, motion.length_m)

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

    def _judge_following(
        self, state: ArtefactState, leader_id: int, states: Sequence[ArtefactState]
    ) -> None:
        """Count the distance of a follower to its leader, if that is there."""
        for leader in states:
            if leader.artefact_id == leader_id:
                gap_m = _apart_m(state, leader)
                gaps, is_near = self.verdict.follower_gaps, gap_m <= _NEAR_LEADER_M
                gaps.note(gap_m, self._step_s, is_near=is_near)


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
