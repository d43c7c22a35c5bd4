"""The judge of motion: each kind of fault, fed by hand, is caught, and clean motion is not."""

import ast
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from are_ros.agents.events import ArtefactState
from are_ros.checks.oracle.solids import RealMap
from are_ros.lab import motion_judge
from are_ros.lab.motion_judge import FAULTS, Limits, MotionJudge, Verdict
from are_ros.population.artefact import GroundPose, Origin
from are_ros.world.rigid_transform import RigidTransform

STEP_S = 0.05
Pose = tuple[float, float, float]
LIMITS = {"person": Limits(2.0, 1.5, 3.0, 0.0), "car": Limits(3.0, 1.5, 0.6, 5.0)}
NO_WALLS = RealMap(np.zeros((1, 1), np.int8), 1.0, (0.0, 0.0, 0.0), 0.0, "map")
SIZES = {"person": (0.3, 0.5, 1.7), "car": (4.0, 1.8, 1.5)}


def state(
    at: Pose,
    artefact_id: int = 1,
    *,
    label: str = "person",
    behaviour: str = "walking",
    activity: str = "",
    z_m: float = 0.0,
    box_x_m: float = 0.0,
) -> ArtefactState:
    """Return the ground truth of one at x, y, yaw."""
    return ArtefactState(
        artefact_id=artefact_id,
        row=0,
        label=label,
        class_name=label,
        map_from_artefact=RigidTransform.identity(),
        ground_pose=GroundPose(at[0], at[1], z_m, at[2]),
        box_centre_m=(box_x_m, 0.0, 0.0),
        size_m=SIZES[label],
        linear_velocity_m_s=(0.0, 0.0, 0.0),
        angular_velocity_rad_s=(0.0, 0.0, 0.0),
        behaviour=behaviour,
        arrival_ns=0,
        departure_ns=0,
        origin=Origin.RANDOM,
        features={},
        activity=activity,
    )


def judged(
    moments: Sequence[Sequence[ArtefactState]],
    walls: RealMap = NO_WALLS,
    robot: Pose | None = None,
    excused: frozenset[int] = frozenset(),
    jumped: frozenset[int] = frozenset(),
) -> MotionJudge:
    """Return the judge after one sub-step after the other."""
    judge = MotionJudge(walls, LIMITS, STEP_S)
    for k, states in enumerate(moments):
        judge.judge(k * STEP_S, states, jumped if k else frozenset(), robot, excused)
    return judge


def found(moments: Sequence[Sequence[ArtefactState]], **known: object) -> dict[str, int]:
    """Return how often which fault was found."""
    return dict(judged(moments, **known).verdict.found)  # type: ignore[arg-type] # as judged takes


def driven(
    speeds_mps: Sequence[float], turns_radps: Sequence[float], label: str = "person"
) -> list[list[ArtefactState]]:
    """Return a drive: standing at first, then a sub-step on an arc for each speed and turn rate."""
    x, y, yaw = 1.0, -2.0, 0.4
    moments = [[state((x, y, yaw), label=label)]]
    for speed, rate in zip(speeds_mps, turns_radps, strict=True):
        turn = rate * STEP_S
        chord = speed * STEP_S * float(np.sinc(turn / (2.0 * math.pi)))
        x, y = x + chord * math.cos(yaw + 0.5 * turn), y + chord * math.sin(yaw + 0.5 * turn)
        yaw += turn
        moments.append([state((x, y, yaw), label=label)])
    return moments


def ramp(top_mps: float, acceleration_mps2: float = 1.5) -> list[float]:
    """Return the speeds of getting going, going on for a while, and braking to a stand."""
    up = np.arange(acceleration_mps2 * STEP_S, top_mps, acceleration_mps2 * STEP_S).tolist()
    return [0.0, *up, *([top_mps] * 20), *up[::-1], 0.0, 0.0]


# --- clean motion


@pytest.mark.parametrize("label", ["person", "car"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_motion_within_the_limits_is_clean(label: str, sign: float) -> None:
    """Up to the top speed and back, on an arc as narrow as allowed, forwards and in reverse."""
    top_mps = LIMITS[label].speed_mps
    speeds = [sign * speed for speed in ramp(top_mps)]
    widest = [3.0 if label == "person" else min(0.6, abs(v) / 5.0) for v in speeds]
    verdict = judged(driven(speeds, widest, label)).verdict
    assert verdict.is_clean, verdict.sentences
    assert verdict.hard_brakes == 0
    assert verdict.travelled_m["walking"] == pytest.approx(STEP_S * sum(map(abs, speeds)), rel=1e-2)
    assert verdict.moving_s == pytest.approx(STEP_S * sum(v != 0.0 for v in speeds))


def test_whoever_moves_at_once_after_its_arrival_is_caught() -> None:
    """What is left of the sub-step counts, by the exact time, not the whole of it."""
    turned, arrival = (1.0, 1.0, 0.14), (0.0, (1.0, 1.0, 0.0))
    for came_s, faults in ((0.0, {}), (0.0485, {"limits": 1})):
        judge = MotionJudge(NO_WALLS, LIMITS, STEP_S)
        judge.judge(STEP_S, [state(turned)], arrived={1: (came_s, arrival[1])})
        assert dict(judge.verdict.found) == faults
    judge = MotionJudge(NO_WALLS, LIMITS, STEP_S)
    judge.judge(STEP_S, [state(turned)], arrived={1: (STEP_S, turned)})
    assert judge.verdict.is_clean


@pytest.mark.parametrize("twist", [((0.0, 0.0, 0.0), 94.0), ((1.9, 0.9, 0.0), 0.0)])
def test_a_twist_that_the_type_cannot_have_is_caught(twist: tuple[Pose, float]) -> None:
    """Whatever the poses say."""
    linear_mps, turn_radps = twist
    one = replace(
        state((1.0, 1.0, 0.0)),
        linear_velocity_m_s=linear_mps,
        angular_velocity_rad_s=(0.0, 0.0, turn_radps),
    )
    assert found([[one], [one]]) == {"limits": 2}


def test_turning_back_within_the_limits_is_clean() -> None:
    """From forwards through the stand into reverse, and round through pi."""
    speeds = [0.075 * k for k in range(10)]
    speeds += speeds[::-1] + [-v for v in speeds]
    assert found(driven(speeds, [3.0] * len(speeds))) == {}


# --- overlaps


def at_angle(gap_m: float) -> list[ArtefactState]:
    """Return two people, the second turned by 45 degrees, whose boxes are so far apart."""
    reach_m = (0.15 + 0.25) / math.sqrt(2.0)
    return [state((0.0, 0.0, 0.0)), state((0.15 + reach_m + gap_m, 0.05, math.pi / 4), 2)]


@pytest.mark.parametrize(("gap_m", "count"), [(-1e-3, 1), (1e-3, 0), (-1e-8, 0)])
def test_overlapping_artefacts_are_caught(gap_m: float, count: int) -> None:
    """A millimetre too near is, a touch is not."""
    assert found([at_angle(gap_m)]).get("overlaps", 0) == count


def test_one_above_the_other_is_no_overlap() -> None:
    """The heights count: 1.8 m up there is room above 1.7 m."""
    low = state((0.0, 0.0, 0.0))
    assert found([[low, state((0.0, 0.0, 0.0), 2, z_m=1.8)]]) == {}
    assert found([[low, state((0.0, 0.0, 0.0), 2, z_m=1.6)]]) == {"overlaps": 1}


def test_the_box_is_where_its_centre_is() -> None:
    """A box 1 m ahead of the origin of its frame overlaps what is there, and nothing at it."""
    ahead = state((0.0, 0.0, math.pi / 2), box_x_m=1.0)
    assert found([[ahead, state((0.0, 1.0, 0.0), 2)]]) == {"overlaps": 1}
    assert found([[ahead, state((0.0, 0.0, 0.0), 2)]]) == {}


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
@pytest.mark.parametrize(("x_m", "count"), [(0.66, 1), (0.64, 0)])
def test_walls_are_caught_on_a_turned_map(yaw: float, x_m: float, count: int) -> None:
    """Column 8 of cells of 0.1 m begins 0.8 m along the map: a person reaches 0.15 m ahead."""
    occupied = np.zeros((10, 12), np.int8)
    occupied[4, 8] = 100
    walls = RealMap(occupied, 0.1, (3.0, -1.0, yaw), 0.0, "map")
    c, s, y_m = math.cos(yaw), math.sin(yaw), 0.45
    at = (3.0 + c * x_m - s * y_m, -1.0 + s * x_m + c * y_m, yaw)
    assert found([[state(at)]], walls=walls).get("walls", 0) == count


def test_a_wall_inside_of_a_large_box_is_caught() -> None:
    """Also where no corner of either is in the other."""
    occupied = np.full((41, 1), 100, np.int8)
    walls = RealMap(occupied, 0.1, (0.5, -2.05, 0.0), 0.0, "map")
    assert found([[state((0.0, 0.0, 0.0), label="car")]], walls=walls) == {"walls": 1}


@pytest.mark.parametrize(("x_m", "count"), [(0.34, 1), (0.36, 0)])
def test_the_robot_is_caught_unless_it_was_said(x_m: float, count: int) -> None:
    """A disc of 0.2 m, 0.15 m ahead of the middle of a person; a reported contact is excused."""
    moment = [[state((0.0, 0.0, 0.0))]]
    assert found(moment, robot=(x_m, 0.0, 0.2)).get("robot", 0) == count
    assert found(moment, robot=(x_m, 0.0, 0.2), excused=frozenset({1})) == {}


# --- limits


@pytest.mark.parametrize(
    ("label", "speeds", "turns", "words"),
    [
        ("person", [0.07 * k for k in range(32)], [0.0] * 32, "speed 2."),
        ("person", [0.0, 0.1], [0.0, 0.0], "gains 2.0"),
        ("person", [0.0, -0.1], [0.0, 0.0], "gains -2.0"),
        ("person", [0.0, 0.0], [3.1, 0.0], "turns at 3.1"),
        ("car", [0.07 * k for k in range(20)], [0.0] * 19 + [0.35], "radius below 5 m"),
        ("car", [0.0, 0.0], [0.1, 0.0], "radius below 5 m"),
    ],
)
def test_broken_limits_are_caught(
    label: str, speeds: list[float], turns: list[float], words: str
) -> None:
    """Too fast, too strong, turning too fast or too narrowly, each with its numbers."""
    verdict = judged(driven(speeds, turns, label)).verdict
    assert verdict.found.keys() == {"limits"}
    assert words in verdict.sentences["limits"][0]


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_sliding_sideways_is_caught(yaw: float) -> None:
    """A millimetre across the heading, beside 10 mm along it, is a slide."""
    moments = [
        [state((k * 0.0035 * math.cos(yaw + 0.3), k * 0.0035 * math.sin(yaw + 0.3), yaw))]
        for k in range(3)
    ]
    verdict = judged(moments).verdict
    assert verdict.found == {"limits": 2}
    assert "sideways" in verdict.sentences["limits"][0]


def test_a_first_speed_is_not_known() -> None:
    """Who arrives may have set off in that sub-step: from the third on accelerations count."""
    moments = [[state((0.05 * k, 0.0, 0.0))] for k in range(4)]
    assert found(moments) == {}


def test_a_jump_that_was_said_is_no_motion() -> None:
    """Half a metre sideways is one without the event, and breaks every limit."""
    moments = [[state((0.0, 0.0, 0.0))], [state((0.0, 0.5, 0.0))]]
    assert found(moments, jumped=frozenset({1})) == {}
    assert found(moments) == {"limits": 1}


def test_hard_braking_is_counted_apart() -> None:
    """A dead stop from 1 m/s, and one from 0.5 to 0.3 m/s; the limit itself is none."""
    verdict = judged(driven([*ramp(1.0)[:-16], 0.0], [0.0] * (len(ramp(1.0)) - 15))).verdict
    assert verdict.is_clean
    assert (verdict.hard_brakes, verdict.dead_stops) == (1, 1)
    assert any(line.endswith("  1 (1 dead stop)") for line in verdict.table())
    assert verdict.hardest_mps2 == pytest.approx(20.0)
    softer = [0.075 * k for k in range(7)] + [0.3, 0.3]
    verdict = judged(driven(softer, [0.0] * len(softer))).verdict
    assert (verdict.hard_brakes, verdict.dead_stops) == (1, 0)
    assert any(line.endswith("  1 (0 dead stops)") for line in verdict.table())
    assert verdict.hardest_mps2 == pytest.approx(3.0)


# --- over time


def standing(
    minutes: float, activity_at: Callable[[float], str], behaviour: str = "walking"
) -> list[list[ArtefactState]]:
    """Return a stand, in which the activity depends on the time [s]."""
    steps = round(60.0 * minutes / STEP_S)
    return [
        [state((0.0, 0.0, 0.0), behaviour=behaviour, activity=activity_at(k * STEP_S))]
        for k in range(steps)
    ]


@pytest.mark.parametrize("activity", ["", "walking", "following artefact 7", "on its way"])
def test_a_minute_without_a_cause_is_caught_once(activity: str) -> None:
    """Who is said to get on, and does not, is noted once for each stand."""
    verdict = judged(standing(1.2, lambda _: activity)).verdict
    assert verdict.found == {"still": 1}
    assert verdict.causes == {"no cause": 1}
    assert found(standing(0.99, lambda _: activity)) == {}


def test_creeping_is_standing() -> None:
    """Who moves to and fro within 0.3 m does not get on."""
    steps = round(65.0 / STEP_S)
    moments = [[state((0.1 * math.sin(0.01 * k), 0.0, 0.0))] for k in range(steps)]
    assert found(moments) == {"still": 1}
    slow = [[state((0.01 * k * STEP_S, 0.0, 0.0))] for k in range(steps)]
    assert found(slow) == {}


def test_a_cause_must_hold_for_half_of_the_time() -> None:
    """Seconds of pausing do not excuse a minute; most of one waiting does."""
    assert found(standing(1.1, lambda t: "pausing" if t % 10.0 < 3.0 else "")) == {"still": 1}
    verdict = judged(standing(1.1, lambda t: "no way" if t % 10.0 < 6.0 else "")).verdict
    assert verdict.is_clean
    assert verdict.causes == {"no way": 1}
    assert [stand.cause for stand in verdict.stands] == ["no way"]
    assert verdict.stands[0].stood_s == pytest.approx(max(verdict.longest_s.values()), abs=0.01)
    assert verdict.longest_s["no way"] == pytest.approx(66.0, abs=0.2)


def test_who_is_to_stand_may() -> None:
    """The behaviour standing is no fault, and needs no cause."""
    verdict = judged(standing(1.2, lambda _: "", "standing")).verdict
    assert verdict.is_clean
    assert not verdict.causes


def waiting(awaited: dict[int, int], seconds: float) -> list[list[ArtefactState]]:
    """Return a stand of some, each waiting for another."""
    moment = [
        state((2.0 * one, 0.0, 0.0), one, activity=f"waiting for artefact {other}")
        for one, other in awaited.items()
    ]
    return [moment] * round(seconds / STEP_S)


@pytest.mark.parametrize(
    ("awaited", "circles"),
    [
        ({1: 2, 2: 1}, ["artefacts 1, 2"]),
        ({1: 2, 2: 3, 3: 1, 4: 1, 5: 4}, ["artefacts 1, 2, 3"]),
        ({1: 2, 2: 1, 3: 4, 4: 3}, ["artefacts 1, 2", "artefacts 3, 4"]),
        ({1: 2, 2: 3}, []),
    ],
)
def test_a_circle_of_waiting_is_a_deadlock(awaited: dict[int, int], circles: list[str]) -> None:
    """Each circle is noted once, with its members; who waits for one of them is not one."""
    verdict = judged(waiting(awaited, 61.0)).verdict
    told = [line.split(": ")[1] for line in verdict.sentences.get("deadlocks", [])]
    assert told == circles
    assert verdict.causes == {"waiting for artefact": len(awaited)}
    assert found(waiting(awaited, 59.0)) == {}


def shuttled(seconds: float, reach_m: float, label: str) -> list[list[ArtefactState]]:
    """Return a drive to and fro about a place, as far to each side, at half a metre a second."""
    ways_m = 0.5 * STEP_S * np.arange(round(seconds / STEP_S))
    places = reach_m - np.abs(np.mod(ways_m + reach_m, 4.0 * reach_m) - 2.0 * reach_m)
    return [[state((x_m, 0.0, 0.0), label=label, activity="manoeuvring")] for x_m in places]


def test_vehicles_that_drive_and_get_nowhere_are_counted() -> None:
    """Once for all the time; it is no fault, and neither people nor longer ways are meant."""
    judge = judged(shuttled(90.0, 1.2, "car"))
    assert judge.verdict.to_and_fro.times == 1
    assert 89.0 < judge.verdict.to_and_fro.longest_s < 90.0
    assert "to and fro" in "\n".join(judge.verdict.table())
    for others in (
        shuttled(59.0, 1.2, "car"),
        shuttled(90.0, 4.0, "car"),
        shuttled(90.0, 1.2, "person"),
        [[state((0.0, 0.0, 0.0), label="car", activity="no way")]] * round(90.0 / STEP_S),
    ):
        assert judged(others).verdict.to_and_fro.times == 0


def test_followers_are_measured_against_their_leader() -> None:
    """By the number that the activity says."""
    leader = [state((0.1 * k, 0.0, 0.0), 7) for k in range(11)]
    other = state((0.0, 1.0, 0.0), 8, behaviour="standing")
    near_m = math.hypot(1.0, 1.0)
    for activity in ("following artefact 8", "waiting behind artefact 8"):
        follower = state((-1.0, 0.0, 0.0), behaviour="following", activity=activity)
        moments = [[follower, one, other] for one in leader]
        follower_gaps = judged(moments).verdict.follower_gaps
        assert follower_gaps.near_share == 1.0
        assert follower_gaps.mean_gap_m == pytest.approx(near_m, abs=0.06)
    far = state((-9.0, 0.0, 0.0), behaviour="following", activity="following artefact 7")
    verdict = judged([[far, one] for one in leader]).verdict
    assert verdict.follower_gaps.near_share == 0.0
    assert _lines_of_followers(verdict) == [["0", "%"], ["9.50", "m"]]


def test_without_followers_the_table_says_nothing_of_them() -> None:
    """Not that all were near, at a distance of 0 m."""
    assert _lines_of_followers(judged([[state((0.0, 0.0, 0.0))]] * 3).verdict) == []


def _lines_of_followers(verdict: Verdict) -> list[list[str]]:
    """Return the figures of the lines about followers."""
    said = [line.split() for line in verdict.table()]
    return [words[-2:] for words in said if {"followers", "leader"} & {*words}]


def test_stops_at_destinations_are_arrivals() -> None:
    """A pause counts once when it begins, by behaviour and per minute."""
    moments = standing(0.5, lambda t: "pausing" if t % 10.0 >= 5.0 else "")
    verdict = judged(moments).verdict
    assert verdict.arrivals == {"walking": 3}
    assert verdict.arrivals_per_minute("walking") == pytest.approx(6.0)
    assert verdict.arrivals_per_minute("driving") == 0.0
    table = [line.split() for line in verdict.table()]
    assert ["behaviour", "minutes", "m/s", "pauses/min"] in table


def test_who_is_gone_is_forgotten() -> None:
    """An id that is away for a sub-step is a new one: no motion joins the two."""
    here, there = state((0.0, 0.0, 0.0)), state((5.0, 0.0, 0.0))
    assert found([[here], [], [there]]) == {}


# --- the verdict


def test_the_table_says_all() -> None:
    """Each kind of fault with its number, behaviours, causes, and the first sentences."""
    verdict = judged([*standing(1.1, lambda _: ""), at_angle(-0.1)]).verdict
    text = "\n".join(verdict.table())
    for words in FAULTS.values():
        assert words in text
    assert "person 1 and person 2" in text
    assert "no cause" in text
    assert not verdict.is_clean
    assert verdict.as_json()["faults"]["overlaps"] == 1


def test_sentences_are_bounded_and_counts_are_not() -> None:
    """Sixty overlaps are sixty, with fifty sentences."""
    verdict = judged([at_angle(-0.1)] * 60).verdict
    assert verdict.found["overlaps"] == 60
    assert len(verdict.sentences["overlaps"]) == 50


def test_the_judge_shares_no_geometry_with_what_it_judges() -> None:
    """Of the package it imports the record that it reads, its own modules, and the oracle."""
    names = {
        f"{node.module}.{alias.name}"
        for node in ast.walk(ast.parse(Path(motion_judge.__file__).read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("are_ros.")
        for alias in node.names
    }
    own = ("are_ros.lab.", "are_ros.checks.oracle", "are_ros.wording")
    others = {name for name in names if not name.startswith(own)}
    assert others == {"are_ros.agents.events.ArtefactState"}


def test_states_are_taken_as_they_are() -> None:
    """A state that differs by its activity only moves nobody."""
    one = state((0.0, 0.0, 0.0))
    assert found([[one], [replace(one, activity="pausing")]]) == {}
