"""Readings of sensors as the checks take them: what is a return, and where rays end."""

import math
from dataclasses import replace

import numpy as np

from are_ros.checks.sensors.samples import LaserSample

INF = math.inf
NUMBERS = {
    "angle_min": 0.0,
    "angle_max": 0.3,
    "angle_increment": 0.1,
    "time_increment": 0.0,
    "scan_time": 0.1,
    "range_min": 0.0,
    "range_max": INF,
}


def sample(*ranges: float) -> LaserSample:
    """Return a scan of a laser that measures from 0 to infinity, as it says."""
    return LaserSample(
        5, 7, "laser", NUMBERS, np.array(ranges, np.float32), np.empty(0, np.float32)
    )


def test_beams_that_end_nowhere_are_no_returns_whatever_the_limits_are() -> None:
    """Neither infinity nor 0, which drivers write for nothing: walls hide what is on them."""
    real = sample(INF, 0.0, math.nan, 2.0)
    kept = real.unchanged(real)
    assert kept.unreturned.tolist() == [True, True, True, False]
    assert kept.limits_m.tolist() == [INF, INF, INF, 2.0]


def test_a_beam_without_a_return_may_end_at_an_artefact() -> None:
    """It comes nearer, also to 0, or is too close; it never ends in nothing."""
    real = sample(INF, 0.0, 0.0, 2.0)
    changes = real.changes(sample(3.0, 1.5, -INF, 1.0))
    assert changes.fault == ""
    assert changes.unreturned.tolist() == [True, True, True, False]
    assert changes.too_close.tolist() == [False, False, True, False]
    assert "in beam 3" in real.changes(sample(INF, 0.0, 0.0, INF)).fault
    assert real.changes(sample(INF, 0.0, 0.0, 0.0)).fault == ""


def test_a_single_beam_looks_along_angle_min() -> None:
    """Whatever its increment is: in Gazebo it is NaN."""
    numbers = NUMBERS | {"angle_min": 0.5 * math.pi, "angle_increment": math.nan}
    real, output = (replace(sample(range_m), numbers=numbers) for range_m in (2.0, 1.0))
    changes = real.changes(output)
    assert changes.fault == ""
    np.testing.assert_allclose(changes.points_m, [[[0.0, 1.0, 0.0]]], atol=1e-12)
