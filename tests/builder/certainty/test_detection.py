"""How probably a look detects, and how far off it is."""

import math

import numpy as np
import pytest
from scipy.stats import binomtest

from are_ros.builder.certainty.detector import detection_noise, detection_probability
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import CertaintyParameters
from tests.builder.certainty.hall import detector, ns, scene, seeing, sights, walkers

GOOD = CertaintyParameters()
LEVEL = 1e-4


@pytest.mark.parametrize("fraction", [0.05, 0.25, 0.5, 1.0])
@pytest.mark.parametrize("range_m", [0.5, 15.0, 40.0])
def test_the_probability_is_that_of_the_equation(fraction: float, range_m: float) -> None:
    """Two Hill curves of the fourth power, one for each of the halves."""
    by_fraction = fraction**4 / (fraction**4 + 0.25**4)
    by_range = 15.0**4 / (15.0**4 + range_m**4)
    wanted = 0.97 * by_fraction * by_range
    assert detection_probability(GOOD, fraction, range_m) == pytest.approx(wanted, rel=1e-12)


def test_a_half_of_zero_plays_no_part() -> None:
    """Then only the best probability is left; what is not visible is never detected."""
    blind = with_values(GOOD, {"half_fraction": 0.0, "half_range": 0.0})
    assert detection_probability(blind, 0.01, 1e6) == 0.97
    assert detection_probability(blind, 0.0, 1.0) == 0.0


def test_noise_lies_along_the_line_of_sight_and_grows_with_the_range() -> None:
    """Its covariance has these axes, whatever the bearing."""
    for range_m, bearing in ((0.0, 0.3), (5.0, -2.0), (20.0, 1.0)):
        factor = detection_noise(GOOD, range_m, bearing)
        covariance = factor @ factor.T
        along = np.array((math.cos(bearing), math.sin(bearing), 0.0))
        across = np.array((-math.sin(bearing), math.cos(bearing), 0.0))
        assert along @ covariance @ along == pytest.approx(0.04**2 + (0.02 * range_m) ** 2)
        assert across @ covariance @ across == pytest.approx(0.04**2 + (0.005 * range_m) ** 2)
        assert along @ covariance @ across == pytest.approx(0.0, abs=1e-15)
        assert covariance[2, 2] == pytest.approx(0.15**2)


@pytest.mark.parametrize(
    "rate_hz", [5, *(pytest.param(rate, marks=pytest.mark.long) for rate in (10, 20))]
)
@pytest.mark.parametrize(("fraction", "range_m"), [(1.0, 1.0), (0.25, 2.0), (0.4, 15.0)])
def test_looks_detect_as_the_curve_says(rate_hz: int, fraction: float, range_m: float) -> None:
    """Over 10,000 sightings, at each look anew, however often the camera looks (level 1e-4)."""
    eye, crowd, looks = detector({"certainty.coast": 100.0}), walkers(1_000), 10
    found = 0
    for k in range(looks):
        t_s = k / rate_hz
        seen = eye.observe(ns(t_s), scene(crowd, t_s), seeing(sights(crowd, fraction, range_m)))
        found += sum(one.sighting.seen_ns == ns(t_s) for one in seen.artefacts)
    wanted = detection_probability(GOOD, fraction, range_m)
    assert binomtest(found, looks * len(crowd), wanted).pvalue > LEVEL
