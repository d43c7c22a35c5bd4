"""Where rays meet boxes: plain numpy, beside the oracle that `are check` uses."""

import numpy as np
from numpy.typing import NDArray

from are_ros.checks.oracle.plane import in_box, slab

Floats = NDArray[np.float64]


def ray_hits_m(
    start_m: Floats, ways: Floats, centre_m: Floats, yaw_rad: float, half_m: Floats
) -> Floats:
    """Return how far rays (N, 3) from a start (3,) go to a box: 0 from inside, inf if never."""
    enter, leave = ray_chords_m(start_m, ways, centre_m, yaw_rad, half_m)
    enter = np.maximum(enter, 0.0)
    hits: Floats = np.where(enter <= leave, enter, np.inf)
    return hits


def ray_chords_m(
    start_m: Floats, ways: Floats, centre_m: Floats, yaw_rad: float, half_m: Floats
) -> tuple[Floats, Floats]:
    """Return where lines (N, 3) through a start (3,) enter and leave a box, or enter > leave."""
    origin, own = in_box((start_m - centre_m)[None], yaw_rad)[0], in_box(ways, yaw_rad)
    enter, leave = slab(origin, own, -half_m, half_m)
    return enter.max(axis=1), leave.min(axis=1)
