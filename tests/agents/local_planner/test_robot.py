"""What is expected of the robot."""

import math

import numpy as np
import pytest

from are_ros.agents.local_planner.robot import RobotMotion
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.footprint import Footprint, signed_distance_m

_SQUARE = Footprint(np.array([[-0.3, -0.2], [0.3, -0.2], [0.3, 0.2], [-0.3, 0.2]]))


def test_it_goes_straight_on_and_then_stands() -> None:
    """With no turn the outline is shifted by the velocity, for a second and a half."""
    motion = RobotMotion(_SQUARE.at(1.0, 2.0, 0.5), 1.0, 2.0, 0.5, 0.8, -0.4, 0.0)
    outlines = motion.outlines_m(0.05, 40)
    assert outlines.shape == (41, 4, 2)
    assert outlines[0] == pytest.approx(motion.footprint.vertices_m)
    for k in range(41):
        t = min(k * 0.05, 1.5)
        assert outlines[k] == pytest.approx(outlines[0] + (0.8 * t, -0.4 * t))


def test_it_goes_on_along_its_arc() -> None:
    """One that turns is where a fine integration of its velocity brings it."""
    motion = RobotMotion(_SQUARE.at(0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.6, 0.0, 0.9)
    place = np.zeros(2)
    for n in range(10_000):
        yaw = 0.9 * (n + 0.5) * 1e-4
        place += 1e-4 * 0.6 * np.array([math.cos(yaw), math.sin(yaw)])
    expected = _SQUARE.at(float(place[0]), float(place[1]), 0.9)
    assert motion.outlines_m(0.05, 20)[20] == pytest.approx(expected.vertices_m, abs=1e-6)


@pytest.mark.parametrize(("vx_mps", "yaw_rate"), [(0.8, 0.6), (0.0, 0.6), (0.0, -1.0)])
def test_the_area_that_it_sweeps_holds_all_outlines(vx_mps: float, yaw_rate: float) -> None:
    """On an arc and on the spot, but for what the chords of its quarters leave out."""
    motion = RobotMotion(_SQUARE.at(1.0, 2.0, 0.5), 1.0, 2.0, 0.5, vx_mps, -0.5 * vx_mps, yaw_rate)
    boxes_m = motion.outlines_m(0.05, 30).reshape(-1, 2)
    points = OrientedBoxes(
        np.column_stack((boxes_m, np.zeros(len(boxes_m)))),
        np.zeros(len(boxes_m)),
        np.full((len(boxes_m), 3), 1e-6),
    )
    assert signed_distance_m(motion.swept, points).max() < 0.03
    assert motion.is_moving
    still = RobotMotion(_SQUARE.at(1.0, 2.0, 0.5), 1.0, 2.0, 0.5, 0.0, 0.0, 0.0)
    assert not still.is_moving
    assert still.swept is still.footprint
