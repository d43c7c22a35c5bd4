"""Lens distortion undone: rays of distorted pixels, by Newton's method inside the valid domain."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled

COEFFICIENTS: Final = 14
"""OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y (the last two are refused)."""

_STEPS: Final = 30
_CONVERGED: Final = 1e-9
_NEGLIGIBLE: Final = 1e-60
_FAR: Final = 1e3
"""Slope of the steepest ray that is kept: 89.94 degrees off the axis."""


def radial_limit(coefficients: npt.NDArray[np.float64]) -> float:
    """Return the slope r up to which the radial part r (1 + k1 r^2 ...) / (1 + k4 r^2 ...) grows.

    Beyond it the lens model folds back, and a pixel no longer has one ray. `coefficients` is
    float64 (14,) in OpenCV's order; the answer is at most `_FAR`.
    """
    k1, k2, _, _, k3, k4, k5, k6 = coefficients[:8]
    upper, lower = np.poly1d((k3, k2, k1, 1.0)), np.poly1d((k6, k5, k4, 1.0))
    s = np.poly1d((1.0, 0.0))
    slope = (upper + 2 * s * upper.deriv()) * lower - 2 * s * upper * lower.deriv()
    return min(_FAR, math.sqrt(min(_first_root(slope), _first_root(lower))))


def angular_limit(coefficients: npt.NDArray[np.float64]) -> float:
    """Return the angle [rad] up to which theta (1 + k1 theta^2 + ...) grows, at most pi."""
    k1, k2, k3, k4 = coefficients
    slope = np.poly1d((9 * k4, 7 * k3, 5 * k2, 3 * k1, 1.0))
    return min(math.pi, math.sqrt(_first_root(slope)))


def _first_root(polynomial: np.poly1d) -> float:
    """Return the least positive real root, inf if there is none."""
    weights = polynomial.coeffs
    roots = np.poly1d(np.where(np.abs(weights) < _NEGLIGIBLE, 0.0, weights)).roots
    real = roots.real[(np.abs(roots.imag) < 1e-9 * (1.0 + np.abs(roots))) & (roots.real > 0.0)]
    return float(real.min(initial=np.inf))


@compiled
def undistort_points(
    points: npt.NDArray[np.float64], coefficients: npt.NDArray[np.float64], limit: float
) -> npt.NDArray[np.float64]:
    """Return the undistorted slopes (N, 2) of distorted ones (N, 2); NaN where there are none.

    `limit` is `radial_limit`. A solution must reproduce the point to 1e-9 and lie where the model
    is one to one: within the limit, with a positive Jacobian.
    """
    slopes = np.empty_like(points)
    for index in range(points.shape[0]):
        slopes[index] = _undistorted(points[index, 0], points[index, 1], coefficients, limit)
    return slopes


@compiled
def _undistorted(
    u: float, v: float, coefficients: npt.NDArray[np.float64], limit: float
) -> tuple[float, float]:
    radius = math.sqrt(u * u + v * v)
    scale = _radial_inverse(radius, coefficients, limit) / radius if radius > 0.0 else 1.0
    x, y = u * scale, v * scale
    for _ in range(_STEPS):
        du, dv, a, b, c, d = _distorted(x, y, coefficients)
        determinant = a * d - b * c
        error_u, error_v = du - u, dv - v
        if not determinant > 0.0 or x * x + y * y > limit * limit:
            break
        if abs(error_u) + abs(error_v) < _CONVERGED * (1.0 + radius):
            return x, y
        x -= (d * error_u - b * error_v) / determinant
        y -= (a * error_v - c * error_u) / determinant
    return np.nan, np.nan


@compiled
def _radial_inverse(radius: float, coefficients: npt.NDArray[np.float64], limit: float) -> float:
    """Return the slope whose radial distortion is `radius`; the limit if it is beyond.

    Newton's method, and a bisection wherever it would leave the bracket.
    """
    low, high, slope = 0.0, limit, min(radius, 0.5 * limit)
    for _ in range(_STEPS * 2):
        factor, change = _radial(slope * slope, coefficients)
        error = slope * factor - radius
        low, high = (slope, high) if error < 0.0 else (low, slope)
        following = slope - error / (factor + 2.0 * slope * slope * change)
        following = following if low < following < high else 0.5 * (low + high)
        if abs(following - slope) < _CONVERGED:
            break
        slope = following
    return slope


@compiled
def _radial(s: float, coefficients: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Return the radial factor and its derivative by s = r^2."""
    k1, k2, k3 = coefficients[0], coefficients[1], coefficients[4]
    k4, k5, k6 = coefficients[5], coefficients[6], coefficients[7]
    upper = 1.0 + s * (k1 + s * (k2 + s * k3))
    lower = 1.0 + s * (k4 + s * (k5 + s * k6))
    upper_slope = k1 + s * (2.0 * k2 + s * 3.0 * k3)
    lower_slope = k4 + s * (2.0 * k5 + s * 3.0 * k6)
    factor = upper / lower
    return factor, (upper_slope - factor * lower_slope) / lower


@compiled
def _distorted(
    x: float, y: float, coefficients: npt.NDArray[np.float64]
) -> tuple[float, float, float, float, float, float]:
    """Return the distorted slopes of (x, y), and the Jacobian's entries row by row."""
    p1, p2 = coefficients[2], coefficients[3]
    s1, s2, s3, s4 = coefficients[8], coefficients[9], coefficients[10], coefficients[11]
    s = x * x + y * y
    factor, slope = _radial(s, coefficients)
    u = x * factor + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x) + s1 * s + s2 * s * s
    v = y * factor + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y + s3 * s + s4 * s * s
    prism_u, prism_v = 2.0 * (s1 + 2.0 * s2 * s), 2.0 * (s3 + 2.0 * s4 * s)
    cross = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    u_x = factor + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + prism_u * x
    v_y = factor + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + prism_v * y
    return u, v, u_x, cross + prism_u * y, cross + prism_v * x, v_y


@compiled
def undistort_angles(
    radii: npt.NDArray[np.float64], coefficients: npt.NDArray[np.float64], limit_rad: float
) -> npt.NDArray[np.float64]:
    """Return the angles [rad] (N,) off the axis of equidistant image radii (N,).

    `limit_rad` is `angular_limit`; NaN where a radius lies beyond it.
    """
    angles = np.empty_like(radii)
    outermost = _angular(limit_rad, coefficients)[0]
    for index in range(radii.size):
        beyond = radii[index] > outermost
        angles[index] = np.nan if beyond else _angle(radii[index], coefficients, limit_rad)
    return angles


@compiled
def _angle(radius: float, coefficients: npt.NDArray[np.float64], limit_rad: float) -> float:
    """Return the angle whose image radius this is, by Newton's method kept in a bracket."""
    low, high, theta = 0.0, limit_rad, min(radius, 0.5 * limit_rad)
    for _ in range(_STEPS * 2):
        value, slope = _angular(theta, coefficients)
        low, high = (theta, high) if value < radius else (low, theta)
        following = theta - (value - radius) / slope
        following = following if low < following < high else 0.5 * (low + high)
        if abs(following - theta) < _CONVERGED:
            return following
        theta = following
    return theta


@compiled
def _angular(theta: float, coefficients: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Return the image radius of an angle, and its derivative."""
    s = theta * theta
    k1, k2, k3, k4 = coefficients[0], coefficients[1], coefficients[2], coefficients[3]
    value = theta * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))))
    return value, 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4)))
