"""Roll-outs keep the limits whatever is asked for, and stop where they should."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.agents.body import Body
from are_ros.agents.local_planner import rollouts as _rollouts
from are_ros.agents.local_planner import state as _state
from are_ros.agents.local_planner.primitives import way_left
from are_ros.agents.local_planner.rollouts import (
    ARC_TO_POINT,
    BRAKE,
    CURVE,
    HEADING,
    POINT,
    RETREAT,
)
from tests.agents.local_planner.streets import CAR, PERSON, SCOOTER, STEP_S, inspect_motion

_TEMPO = _state.PlannerTiming(STEP_S, 20, 30, 20)
_angles = st.floats(-6.0, 6.0)


def _rolled(
    body: Body,
    start: tuple[float, float],
    option: list[float],
    goal: tuple[float, float],
    tempo: _state.PlannerTiming = _TEMPO,
) -> np.ndarray:
    """Return the path of an option from the origin, with (yaw, speed) at the start."""
    path = np.zeros((90, 6))
    yaw, speed = start
    path[0] = (0.0, 0.0, yaw, math.cos(yaw), math.sin(yaw), speed)
    record = np.zeros(1, _state.BODY)
    _state.write_body(record[0], body, 0)
    row = np.array(option)
    last = _rollouts.roll_out(path, row, np.array(goal), record[0], tempo)
    assert path[last, _state.SPEED] == 0.0
    return path[: last + 1]


@pytest.mark.parametrize("walk", [20, 25, 5])
def test_a_step_aside_leads_on_after_half_of_it(walk: int) -> None:
    """However many sub-steps it has: with steps of 0.04 s they are odd."""
    tempo = _state.PlannerTiming(1.0 / walk, walk, 2 * walk, walk)
    path = _rolled(PERSON, (0.0, 1.0), [HEADING, 0.6, 1.0, 0.0, 0.0], (9.0, 0.0), tempo)
    assert path[:, _state.YAW].max() > 0.3
    assert abs(path[-1, _state.YAW]) < 0.05


def _inspect(path: np.ndarray, body: Body) -> None:
    speeds = np.array([path[0, _state.SPEED]])
    for before, after in zip(path[:-1, :3], path[1:, :3], strict=True):
        speeds = inspect_motion(before[None], after[None], speeds, {0: body})


@given(
    st.sampled_from([HEADING, POINT, BRAKE]),
    st.tuples(_angles, st.floats(-0.4, 1.3)),
    _angles,
    _angles,
    st.floats(0.0, 1.35),
    st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)),
)
def test_walkers_keep_their_limits(
    kind: int,
    start: tuple[float, float],
    heading: float,
    then: float,
    speed: float,
    goal: tuple[float, float],
) -> None:
    """Any option ends in a stand, within speed, acceleration and turn rate, never sideways."""
    _inspect(_rolled(PERSON, start, [kind, heading, speed, 0.0, then], goal), PERSON)


@given(st.tuples(_angles, st.floats(-0.4, 1.3)), st.floats(-0.4, -0.01))
def test_who_walks_back_looks_ahead_and_stops(start: tuple[float, float], speed: float) -> None:
    """It goes straight, as fast as it is asked to and can be in its time, and keeps its limits."""
    path = _rolled(PERSON, start, [RETREAT, 0.0, speed, 0.0, 0.0], (0.0, 0.0))
    _inspect(path, PERSON)
    assert (path[:, _state.YAW] == start[0]).all()
    reachable = start[1] - PERSON.acceleration_mps2 * _TEMPO.walk * STEP_S
    slowest = max(min(speed, start[1]), reachable)
    assert path[:, _state.SPEED].min() == pytest.approx(slowest)


@given(
    st.sampled_from([CURVE, ARC_TO_POINT, BRAKE]),
    st.sampled_from([CAR, SCOOTER]),
    st.tuples(_angles, st.floats(-0.8, 1.6)),
    st.floats(-1.0, 1.0),
    st.floats(-0.5, 1.0),
    st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0)),
)
def test_vehicles_keep_their_limits(
    kind: int,
    body: Body,
    start: tuple[float, float],
    bend: float,
    share: float,
    goal: tuple[float, float],
) -> None:
    """They turn on no smaller circle than their own, forward or in reverse."""
    option = [kind, bend / body.turn_radius_m, share * body.speed_mps, 0.0, 0.0]
    _inspect(_rolled(body, start, option, goal), body)


@pytest.mark.parametrize("speed", [1.2, -0.6])
def test_a_vehicle_without_a_curve_brakes_straight_on(speed: float) -> None:
    """One that is told to stand before it has chosen any curve keeps its heading."""
    path = _rolled(SCOOTER, (0.3, speed), [BRAKE, math.nan, 0.0, 0.0, 0.0], (0.0, 0.0))
    _inspect(path, SCOOTER)
    assert (path[:, 2] == 0.3).all()
    assert path[-1, 0] * speed > 0.1


@given(st.floats(0.02, 1.0), st.floats(0.3, 1.35))
def test_a_walker_stops_at_its_goal(distance: float, speed: float) -> None:
    """It does not run past it by more than a centimetre, and gets there if it has the time."""
    path = _rolled(PERSON, (0.0, 0.0), [POINT, 0.0, speed, 0.0, 0.0], (distance, 0.0))
    assert path[-1, 0] < distance + 0.01
    if distance < 0.5 * speed:
        assert path[-1, 0] == pytest.approx(distance, abs=0.02)


@pytest.mark.parametrize("goal", [(3.0, 0.0), (4.0, 1.0), (3.0, -0.7), (-2.0, 0.1), (-2.5, -0.5)])
def test_an_arc_ends_in_its_goal(goal: tuple[float, float]) -> None:
    """The arc to a point that is near enough is driven to its end, ahead or in reverse."""
    body = Body(
        (1.0, 0.5), speed_mps=6.0, acceleration_mps2=9.0, turn_rate_radps=9.0, turn_radius_m=2.0
    )
    speed = 5.0 if goal[0] > 0.0 else -5.0
    path = _rolled(body, (0.0, 0.0), [ARC_TO_POINT, 0.0, speed, 0.0, 0.0], goal)
    assert math.dist(path[-1, :2], goal) < 0.1


@given(
    st.floats(-8.0, 8.0), st.floats(-8.0, 8.0), _angles, st.floats(0.5, 4.0), st.floats(-0.5, 0.5)
)
def test_the_way_left_shrinks_by_no_more_than_what_is_driven(
    x: float, y: float, yaw: float, radius: float, bend: float
) -> None:
    """An arc of 10 cm ahead gains at most 10 cm; the way is never shorter than the distance."""
    way, turn = 0.1, bend * 0.1 / radius
    before = way_left(0.0, 0.0, yaw, x, y, radius)
    middle = yaw + 0.5 * turn
    after = way_left(way * math.cos(middle), way * math.sin(middle), yaw + turn, x, y, radius)
    assert before >= math.hypot(x, y) - 1e-9
    forward_only = before < 1.4 * math.hypot(x, y)
    assert not forward_only or before - after <= way + 1e-6


@pytest.mark.parametrize("goal", [(5.0, 0.0), (0.0, 4.0), (3.0, 3.0), (4.0, -1.0), (1.0, 5.0)])
def test_the_way_ahead_is_that_of_arc_and_tangent(goal: tuple[float, float]) -> None:
    """It agrees with a search over the angle at which the circle is left."""
    radius, least = 1.5, math.inf
    side = math.copysign(1.0, goal[1])
    for angle in np.linspace(0.0, math.tau, 20_001):
        x, y = radius * math.sin(angle), side * radius * (1.0 - math.cos(angle))
        dx, dy = goal[0] - x, goal[1] - y
        aside = dy * math.cos(angle) - side * dx * math.sin(angle)
        ahead = dx * math.cos(angle) + side * dy * math.sin(angle)
        if abs(aside) < 1e-3 and ahead >= 0.0:
            least = min(least, radius * angle + ahead)
    assert way_left(0.0, 0.0, 0.0, *goal, radius) == pytest.approx(least, abs=5e-3)


def _slowly_walked(
    start: tuple[float, float], option: list[float], goal: tuple[float, float], body: Body
) -> np.ndarray:
    """Walk sub-step by sub-step, each from the one before by all of the law, without shortcuts."""
    steps, dt = _TEMPO.walk, _TEMPO.step_s
    most, gain = body.turn_rate_radps * dt, body.acceleration_mps2 * dt
    kind, heading, top, _, then = option
    x, y, (yaw, speed) = 0.0, 0.0, start
    poses = [(x, y, yaw, speed)]
    for k in range(200):
        error, want = 0.0, 0.0
        if k < steps:
            want, heading = top, then if 2 * k == steps else heading
            if kind == POINT:
                dx, dy = goal[0] - x, goal[1] - y
                left = math.hypot(dx, dy)
                if left > 0.05:
                    heading = math.atan2(dy, dx)
                else:
                    left = max(dx * math.cos(yaw) + dy * math.sin(yaw), 0.0)
                want = min(want, _rollouts.stopping_speed(left, speed, body.acceleration_mps2, dt))
            error = math.remainder(heading - yaw, math.tau)
            error = error if abs(error) > 1e-9 else 0.0
            if error != 0.0:
                want *= max(math.cos(error), 0.0)
        turn = min(max(error, -most), most)
        slower = min(max(speed - gain, 0.0), speed + gain)
        faster = min(max(want, slower), speed + gain)
        if turn == 0.0 and speed == 0.0 and faster < 1e-9:
            break
        way = 0.5 * (speed + faster) * dt
        x, y = x + way * math.cos(yaw + 0.5 * turn), y + way * math.sin(yaw + 0.5 * turn)
        yaw, speed = yaw + turn, faster
        poses.append((x, y, yaw, speed))
    return np.array(poses)


@given(
    st.sampled_from([HEADING, POINT]),
    st.tuples(_angles, st.sampled_from([0.0, 0.6, 1.2]) | st.floats(0.0, 1.3)),
    st.sampled_from([0.0, 0.5]) | _angles,
    st.sampled_from([0.0, 0.5]) | _angles,
    st.sampled_from([0.6, 1.2]) | st.floats(0.05, 1.35),
    st.tuples(st.floats(0.5, 3.0), st.floats(0.5, 3.0)),
)
def test_shortcuts_lead_where_each_sub_step_does(
    kind: int,
    start: tuple[float, float],
    heading: float,
    then: float,
    speed: float,
    goal: tuple[float, float],
) -> None:
    """Straight stretches and turns without trigonometry are the walk, but for rounding."""
    after = then if kind == HEADING else heading
    path = _rolled(PERSON, start, [kind, heading, speed, 0.0, after], goal)
    slow = _slowly_walked(start, [kind, heading, speed, 0.0, after], goal, PERSON)
    assert len(path) == len(slow)
    columns = [_state.X, _state.Y, _state.YAW, _state.SPEED]
    np.testing.assert_allclose(path[:, columns], slow, rtol=0.0, atol=1e-9)
