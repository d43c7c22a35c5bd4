"""Odometry that drifts."""

import numpy as np
import pytest

from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.robot import OdometryErrors, RobotState, WheelOdometry, correction


def driven(errors: OdometryErrors, seed: int, steps: int = 1000) -> RigidTransform:
    """Return the estimate after driving straight at 1 m/s for `steps` of 10 ms."""
    odometry = WheelOdometry(errors, np.random.default_rng(seed))
    for _ in range(steps):
        odometry.advance(1.0, 0.0, 0.01)
    return odometry.odom_from_base


def test_without_errors_it_is_exact() -> None:
    """Arcs are counted as arcs."""
    odometry = WheelOdometry(OdometryErrors(1.0, 1.0, 0.0, 0.0), np.random.default_rng(0))
    state = RobotState(0.0, 0.0, 0.0)
    for _ in range(50):
        odometry.advance(0.5, 0.7, 0.1)
        state = state.moved(0.05, 0.07)
    np.testing.assert_allclose(odometry.odom_from_base.matrix(), state.pose().matrix(), atol=1e-12)


def test_the_random_error_grows_with_the_root_of_the_way() -> None:
    """Over 200 drives of 1 m and of 4 m; false alarms: 6 standard errors (5 %), so below 1e-6."""
    errors = OdometryErrors(1.0, 1.0, 0.02, 0.0)
    for metres in (1, 4):
        ends = [float(driven(errors, seed, 100 * metres).translation_m[0]) for seed in range(200)]
        assert np.std(ends) == pytest.approx(0.02 * metres**0.5, rel=0.3)
        assert np.mean(ends) == pytest.approx(metres, abs=6 * 0.02 * (metres / 200) ** 0.5)


def test_standing_still_adds_nothing() -> None:
    """Without motion there is no noise."""
    odometry = WheelOdometry(OdometryErrors(), np.random.default_rng(0))
    odometry.advance(0.0, 0.0, 0.1)
    assert odometry.odom_from_base.matrix().tolist() == np.eye(4).tolist()


def test_the_correction_makes_up_for_the_drift() -> None:
    """map_from_odom and the drifted estimate lead to the true pose."""
    true, estimate = RigidTransform.planar(9.0, 2.0, 0.4), driven(OdometryErrors(), 3)
    assert abs(float(estimate.translation_m[0]) - 10.0) > 0.01
    reached = correction(true, estimate) @ estimate
    np.testing.assert_allclose(reached.matrix(), true.matrix(), atol=1e-12)
