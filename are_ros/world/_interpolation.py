"""Poses as seven numbers x y z i j k w: composition, inversion, and tf2's interpolation."""

import math
from typing import Final

from are_ros._compiled import compiled

Pose = tuple[float, float, float, float, float, float, float]

SERIES_REACH: Final = 0.005
"""1 - cos(angle) up to which five terms of the series are exact to rounding (a turn of 11 deg)."""


@compiled
def weight_by_series(t: float, gap: float) -> float:
    """Return sin(t angle) / sin(angle) for 1 - cos(angle) = gap, without trigonometry.

    The factors are gap (i / (2i + 1) - t^2 / (i (2i + 1))), i = 1..5 (Eberly's slerp).
    """
    u = t * t
    total = 1.0 + gap * (5.0 / 11.0 - u * (1.0 / 55.0))
    total = 1.0 + gap * (4.0 / 9.0 - u * (1.0 / 36.0)) * total
    total = 1.0 + gap * (3.0 / 7.0 - u * (1.0 / 21.0)) * total
    total = 1.0 + gap * (2.0 / 5.0 - u * (1.0 / 10.0)) * total
    total = 1.0 + gap * (1.0 / 3.0 - u * (1.0 / 3.0)) * total
    return t * total


@compiled
def slerp_weights(t: float, cosine: float) -> tuple[float, float]:
    """Return the factors of the older and the newer quaternion at t in [0, 1].

    `cosine` is their scalar product; a negative one turns the newer round (the shorter arc).
    """
    gap = 1.0 - abs(cosine)
    sign = -1.0 if cosine < 0.0 else 1.0
    if gap < SERIES_REACH:
        return weight_by_series(1.0 - t, gap), sign * weight_by_series(t, gap)
    angle = math.acos(abs(cosine))
    scale = 1.0 / math.sin(angle)
    return math.sin((1.0 - t) * angle) * scale, sign * math.sin(t * angle) * scale


@compiled
def interpolated(older: Pose, newer: Pose, t: float) -> Pose:
    """Return the pose between two, t in [0, 1]: translation linearly, rotation by slerp."""
    x0, y0, z0, i0, j0, k0, w0 = older
    x1, y1, z1, i1, j1, k1, w1 = newer
    s = 1.0 - t
    a, b = slerp_weights(t, i0 * i1 + j0 * j1 + k0 * k1 + w0 * w1)
    return (
        s * x0 + t * x1,
        s * y0 + t * y1,
        s * z0 + t * z1,
        a * i0 + b * i1,
        a * j0 + b * j1,
        a * k0 + b * k1,
        a * w0 + b * w1,
    )


@compiled
def _turned(
    i: float, j: float, k: float, w: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return the vector x y z turned by the quaternion."""
    cx, cy, cz = j * z - k * y + w * x, k * x - i * z + w * y, i * y - j * x + w * z
    return x + 2 * (j * cz - k * cy), y + 2 * (k * cx - i * cz), z + 2 * (i * cy - j * cx)


@compiled
def composed(a: Pose, b: Pose) -> Pose:
    """Return a after b."""
    ax, ay, az, ai, aj, ak, aw = a
    bx, by, bz, bi, bj, bk, bw = b
    x, y, z = _turned(ai, aj, ak, aw, bx, by, bz)
    return (
        ax + x,
        ay + y,
        az + z,
        aw * bi + ai * bw + aj * bk - ak * bj,
        aw * bj - ai * bk + aj * bw + ak * bi,
        aw * bk + ai * bj - aj * bi + ak * bw,
        aw * bw - ai * bi - aj * bj - ak * bk,
    )


@compiled
def inverted(a: Pose) -> Pose:
    """Return the inverse."""
    x, y, z, i, j, k, w = a
    bx, by, bz = _turned(-i, -j, -k, w, -x, -y, -z)
    return bx, by, bz, -i, -j, -k, w
