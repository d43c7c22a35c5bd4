"""How probably a look detects an artefact, and how far off the detection is."""

import math

import numpy as np
import numpy.typing as npt

from are_ros.parameters.model import CertaintyParameters

_STEEPNESS = 4


def detection_probability(settings: CertaintyParameters, fraction: float, range_m: float) -> float:
    """Return the probability that a look detects what is visible to this fraction, at this range.

    It is detection / ((1 + (half_fraction / fraction)^4) (1 + (range / half_range)^4)); a half of 0
    leaves out its factor. `fraction` is in [0, 1]; nothing visible is never detected.
    """
    if fraction <= 0.0:
        return 0.0
    odds_of_missing = (settings.half_fraction / fraction) ** _STEEPNESS
    probability = settings.detection / (1.0 + odds_of_missing)
    if settings.half_range > 0.0:
        probability /= 1.0 + (range_m / settings.half_range) ** _STEEPNESS
    return probability


def detection_noise(
    settings: CertaintyParameters, range_m: float, bearing_rad: float
) -> npt.NDArray[np.float64]:
    """Return a factor L (3, 3) of the covariance L L^T of a detected x, y [m] and yaw [rad].

    Along the line of sight, which has this bearing in the map, the deviation is
    hypot(position_noise, range_noise * range); across it hypot(position_noise, bearing_noise *
    range).
    """
    along_m = math.hypot(settings.position_noise, settings.range_noise * range_m)
    across_m = math.hypot(settings.position_noise, settings.bearing_noise * range_m)
    cos, sin = math.cos(bearing_rad), math.sin(bearing_rad)
    return np.array(
        (
            (along_m * cos, -across_m * sin, 0.0),
            (along_m * sin, across_m * cos, 0.0),
            (0.0, 0.0, settings.yaw_noise),
        )
    )
