"""The kinematics of the simulated robot."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bags.simulation.robot import Command, DriveLimits, RobotState, drive

LIMITS = DriveLimits(0.6, 1.2, 0.5, 2.0)


@given(st.floats(-1.0, 1.0), st.floats(-3.0, 3.0), st.floats(-4.0, 4.0))
def test_an_arc_is_the_limit_of_many_short_steps(distance: float, angle: float, yaw: float) -> None:
    """The oracle drives 2000 straight pieces."""
    end = RobotState(1.0, 2.0, yaw).moved(distance, angle)
    x, y, heading, pieces = 1.0, 2.0, yaw, 2000
    for _ in range(pieces):
        middle = heading + 0.5 * angle / pieces
        x += distance / pieces * math.cos(middle)
        y += distance / pieces * math.sin(middle)
        heading += angle / pieces
    assert (end.x_m, end.y_m, end.yaw_rad) == pytest.approx((x, y, heading), abs=1e-6)


def test_velocities_change_no_faster_than_the_limits() -> None:
    """From rest at full command, speed and turn rate grow by their accelerations."""
    state = drive(RobotState(0.0, 0.0, 0.0), Command(9.0, -9.0), LIMITS, 0.1)
    assert (state.speed_m_s, state.turn_rate_rad_s) == pytest.approx((0.05, -0.2))
    for _ in range(100):
        state = drive(state, Command(9.0, -9.0), LIMITS, 0.1)
    assert (state.speed_m_s, state.turn_rate_rad_s) == (0.6, -1.2)


def test_a_small_change_is_made_exactly() -> None:
    """A command within reach of one step is met, and then the base moves so far."""
    state = drive(RobotState(0.0, 0.0, 0.0, 0.3), Command(0.32), LIMITS, 0.1)
    assert state.speed_m_s == pytest.approx(0.32)
    assert state.x_m == pytest.approx(0.032)


def test_the_pose_stands_on_the_floor() -> None:
    """The transform has position, heading and no height."""
    pose = RobotState(1.0, 2.0, 0.5).pose()
    assert pose.translation_m.tolist() == [1.0, 2.0, 0.0]
    assert pose.yaw_rad() == pytest.approx(0.5)
