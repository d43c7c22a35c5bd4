"""Rotations about z alone: how far a quaternion is from one, and its turn in the plane."""

from typing import Final

import numpy as np
import numpy.typing as npt

MAX_TILT_RAD: Final = 1e-3
"""Roll and pitch up to this count as noise of whoever wrote the pose."""


def tilt_rad(rotation_xyzw: npt.ArrayLike) -> float:
    """Return the angle between the turned z axis and z of a unit quaternion, in 0..pi."""
    x, y, z, w = np.asarray(rotation_xyzw, dtype=np.float64)
    return float(2.0 * np.arctan2(np.hypot(x, y), np.hypot(z, w)))


def yaw_only(rotation_xyzw: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return the unit quaternion (4,) of the part about z; a pure yaw comes back as it was."""
    _, _, z, w = np.asarray(rotation_xyzw, dtype=np.float64)
    norm = np.hypot(z, w)
    return np.array([0.0, 0.0, z / norm, w / norm])


def cosine_and_sine(rotation_xyzw: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Return cos and sin of the yaw of a quaternion about z."""
    z, w = float(rotation_xyzw[2]), float(rotation_xyzw[3])
    return w * w - z * z, 2.0 * w * z
