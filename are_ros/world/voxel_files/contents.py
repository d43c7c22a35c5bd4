"""What all files of M3D have in common: they can be read, and are not too large."""

from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import MapError
from are_ros.wording import why_refused

Points = npt.NDArray[np.float32]

MAX_CENTRES: Final = 2**26
"""Bound on the voxels or points of one file: 768 MiB of them."""

_MOST_ROUNDING_M: Final = 1e-3


def read_bytes(path: Path) -> bytes:
    """Return what a file holds; MapError, naming it, if it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as cause:
        message = f"{path}: the file cannot be read ({why_refused(cause)})"
        raise MapError(message) from cause


def check_count(path: Path, count: int) -> None:
    """Raise MapError for a file of more than `MAX_CENTRES` points."""
    if count > MAX_CENTRES:
        raise MapError(f"{path}: {count} points are more than {MAX_CENTRES}; thin out the cloud")


def finite_points(path: Path, points_m: npt.NDArray[np.floating]) -> Points:
    """Return the finite ones of points (N, 3) [m], in single precision, as clouds have them.

    A sensor's cloud has NaN where there was no return. MapError where no point is left, or where
    single precision would move one by more than a millimetre.
    """
    is_finite = np.isfinite(points_m).all(axis=1)
    if not is_finite.any():
        raise MapError(f"{path}: no finite point among {len(points_m)}")
    exact_m = points_m if is_finite.all() else points_m[is_finite]
    with np.errstate(over="ignore"):
        rounded_m = exact_m.astype(np.float32)
        is_near = np.abs(rounded_m - exact_m) <= _MOST_ROUNDING_M
    if not is_near.all():
        farthest_m = float(np.abs(exact_m).max())
        message = (
            f"{path}: a point lies {farthest_m:g} m from the origin, too far for a resolution of a"
            " millimetre; move the cloud into the map's frame"
        )
        raise MapError(message)
    return rounded_m
