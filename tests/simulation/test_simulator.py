"""The simulated world."""

import numpy as np
import pytest

from are_ros.conventions import NS_PER_S
from bags.simulation.building import Building
from bags.simulation.robot import Command, DriveLimits, RobotState
from bags.simulation.simulator import STEPS_PER_S, Simulator


def world(office: Building, seed: int = 0) -> Simulator:
    """Return the office with a robot in its corridor."""
    start = RobotState(2.0, 5.5, 0.1)
    return Simulator(office, start, limits=DriveLimits(), start_ns=5, seed=seed)


def test_steps_do_not_drift_from_the_clock(office: Building) -> None:
    """After a second's steps exactly a second has passed, and times in between increase."""
    simulator = world(office)
    times = []
    for _ in range(STEPS_PER_S):
        times.append(simulator.now_ns)
        simulator.step(Command())
    assert simulator.now_ns == NS_PER_S + 5
    assert set(np.diff([*times, simulator.now_ns])) == {NS_PER_S // 120, NS_PER_S // 120 + 1}


def test_the_frames_lead_to_where_the_robot_stands(office: Building) -> None:
    """Odometry begins at the identity, drifts, and its correction is exact."""
    simulator = world(office)
    assert simulator.odom_from_base.matrix().tolist() == np.eye(4).tolist()
    for _ in range(5 * STEPS_PER_S):
        simulator.step(Command(0.5, 0.02))
    composed = simulator.map_from_odom @ simulator.odom_from_base
    np.testing.assert_allclose(composed.matrix(), simulator.map_from_base.matrix(), atol=1e-12)
    assert simulator.state.x_m == pytest.approx(4.3, abs=0.1)
    drift = simulator.map_from_odom.translation_m - (2.0, 5.5, 0.0)
    assert 0.001 < float(np.hypot(*drift[:2])) < 0.3


def test_the_seed_decides_the_noise(office: Building) -> None:
    """The same seed and commands give the same odometry and scan, another seed does not."""
    worlds = [world(office, seed) for seed in (3, 3, 4)]
    for simulator in worlds:
        for _ in range(50):
            simulator.step(Command(0.5, 0.1))
    one, same, other = ((w.odom_from_base.matrix(), w.scan().ranges) for w in worlds)
    assert np.array_equal(one[0], same[0])
    assert np.array_equal(one[1], same[1])
    assert not np.array_equal(one[0], other[0])
    assert not np.array_equal(one[1], other[1])
