"""Laser scans: geometry, immutability, and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest

from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.errors import InputError

SCAN = LaserScan(
    frame_id="laser",
    stamp_ns=5,
    angle_min_rad=-1.0,
    angle_max_rad=1.0,
    angle_increment_rad=0.5,
    time_increment_s=0.0,
    scan_time_s=0.1,
    range_min_m=0.1,
    range_max_m=10.0,
    ranges=np.ones(5, dtype=np.float32),
    intensities=np.empty(0, dtype=np.float32),
)


def test_beams_are_counted_from_angle_min() -> None:
    """Beam i looks along angle_min + i * increment in the x-y plane."""
    expected = [(math.cos(a), math.sin(a), 0.0) for a in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    np.testing.assert_allclose(SCAN.directions(), expected, atol=1e-15)


def test_a_scan_is_a_value() -> None:
    """Its arrays are read-only views; the caller's own array stays writable."""
    ranges = np.ones(5, dtype=np.float32)
    scan = replace(SCAN, ranges=ranges)
    assert not scan.ranges.flags.writeable
    assert ranges.flags.writeable
    assert scan.checked() is scan


@pytest.mark.parametrize("count", [4, 5, 6])
def test_a_count_off_by_one_fits(count: int) -> None:
    """Drivers disagree whether angle_max is the last beam or one past it."""
    scan = replace(SCAN, ranges=np.ones(count, dtype=np.float32)).checked()
    assert not scan.misfit


@pytest.mark.parametrize("count", [3, 7])
def test_a_count_off_by_two_does_not_fit(count: int) -> None:
    """No driver counts so."""
    assert replace(SCAN, ranges=np.ones(count, dtype=np.float32)).checked().misfit


@pytest.mark.parametrize(
    ("scan", "sentence"),
    [
        (replace(SCAN, angle_max_rad=2.0), "ranges has 5 values, and -1 to 2 by 0.5 gives 7.0"),
        (replace(SCAN, angle_increment_rad=-0.5), "ranges has 5 values, and -1 to 1 by -0.5 gives"),
    ],
)
def test_an_angle_max_that_does_not_fit_is_said_and_not_used(
    scan: LaserScan, sentence: str
) -> None:
    """Beams go by angle_min and the increment; the message keeps the angle_max that it had."""
    assert scan.checked().misfit.startswith(sentence)
    angles = -1.0 + scan.angle_increment_rad * np.arange(5)
    np.testing.assert_allclose(scan.directions()[:, 1], np.sin(angles), atol=1e-15)


def test_a_scan_may_turn_the_other_way_and_see_without_end() -> None:
    """A negative increment with angles to match, and an infinite range_max, are accepted."""
    turned = replace(
        SCAN, angle_min_rad=1.0, angle_max_rad=-1.0, angle_increment_rad=-0.5, range_max_m=math.inf
    )
    assert turned.checked()


@pytest.mark.parametrize("increment", [0.0, math.nan, math.inf, 0.01])
def test_the_increment_of_a_single_beam_may_be_anything(increment: float) -> None:
    """Gazebo divides by the number of beams less 1; the beam looks along angle_min all the same."""
    one = np.array([2.0], dtype=np.float32)
    none = np.empty(0, dtype=np.float32)
    single = replace(SCAN, angle_max_rad=-1.0, angle_increment_rad=increment, ranges=one)
    scan = replace(single, intensities=none).checked()
    assert not scan.misfit
    expected = np.array([[math.cos(-1.0), math.sin(-1.0), 0.0]])
    np.testing.assert_allclose(scan.directions(), expected)
    np.testing.assert_allclose(scan.returns()[0], 2.0 * expected)


@pytest.mark.parametrize(
    ("scan", "sentence"),
    [
        (replace(SCAN, angle_min_rad=math.nan), "front: angle_min is nan"),
        (replace(SCAN, angle_max_rad=math.inf), "front: angle_max is inf"),
        (replace(SCAN, time_increment_s=math.nan), "front: time_increment is nan"),
        (replace(SCAN, angle_increment_rad=0.0), "front: angle_increment is 0"),
        (replace(SCAN, angle_increment_rad=math.nan), "front: angle_increment is nan"),
        (replace(SCAN, range_min_m=11.0), "front: range_min is 11.0 and range_max 10.0"),
        (replace(SCAN, range_min_m=-0.1), "front: range_min is -0.1"),
        (replace(SCAN, range_max_m=math.nan), "front: range_min is 0.1 and range_max nan"),
        (replace(SCAN, ranges=np.empty(0, dtype=np.float32)), "front: ranges is empty"),
        (
            replace(SCAN, ranges=np.ones((1, 5), dtype=np.float32)),
            "front: ranges has the shape (1, 5), not (N,)",
        ),
        (replace(SCAN, intensities=np.ones(3, dtype=np.float32)), "front: intensities has 3"),
        (replace(SCAN, frame_id=""), "front: header.frame_id is empty"),
    ],
)
def test_a_bad_scan_is_refused_with_field_and_reason(scan: LaserScan, sentence: str) -> None:
    """Each fault is named by source, field and reason."""
    with pytest.raises(InputError) as caught:
        scan.checked("front")
    assert str(caught.value).startswith(sentence)


def test_returns_are_what_came_back() -> None:
    """Not too close, not nothing, and not range_max, which many drivers write for nothing."""
    ranges = [0.05, 0.1, 2.0, 7.9, 7.97, 8.0, math.inf, math.nan, -math.inf]
    scan = replace(
        LaserScan.miniature("laser", 1),
        angle_min_rad=0.0,
        angle_increment_rad=0.5 * math.pi,
        range_min_m=0.1,
        range_max_m=8.0,
        ranges=np.array(ranges, np.float32),
    )
    points_m, returned = scan.returns()
    assert np.flatnonzero(returned).tolist() == [1, 2, 3]
    expected = np.array([[0.0, 0.1, 0.0], [-2.0, 0.0, 0.0], [0.0, -7.9, 0.0]])
    np.testing.assert_allclose(points_m, expected, atol=1e-6)
