"""Loops of the judge of scans: rays and points against triangles; shares no code."""

import math
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
INF = math.inf


def _mesh_hits(origin: Floats, ways: Floats, triangles: Floats) -> Floats:
    """Return the first hits of rays (N, 3) from `origin` on triangles (T, 3, 3), else inf."""
    hits = np.full(len(ways), np.inf)
    for ray in range(len(ways)):
        x, y, z = ways[ray]
        for corner in triangles:
            ax, ay, az = corner[1] - corner[0]
            bx, by, bz = corner[2] - corner[0]
            px, py, pz = y * bz - z * by, z * bx - x * bz, x * by - y * bx
            volume = ax * px + ay * py + az * pz
            if abs(volume) < 1e-14:
                continue
            tx, ty, tz = origin - corner[0]
            u = (tx * px + ty * py + tz * pz) / volume
            qx, qy, qz = ty * az - tz * ay, tz * ax - tx * az, tx * ay - ty * ax
            v = (x * qx + y * qy + z * qz) / volume
            if u < -1e-9 or v < -1e-9 or u + v > 1.0 + 1e-9:
                continue
            far = (bx * qx + by * qy + bz * qz) / volume
            if 0.0 <= far < hits[ray]:
                hits[ray] = far
    return hits


def _triangle_distance(p: Floats, a: Floats, b: Floats, c: Floats) -> float:
    """Return the distance of a point from a triangle: its inside, else the nearest of its edges."""
    ab, ac, ap = b - a, c - a, p - a
    d00, d01, d11 = np.dot(ab, ab), np.dot(ab, ac), np.dot(ac, ac)
    d20, d21 = np.dot(ap, ab), np.dot(ap, ac)
    under = d00 * d11 - d01 * d01
    if under > 1e-18:
        v, w = (d11 * d20 - d01 * d21) / under, (d00 * d21 - d01 * d20) / under
        if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
            rest = ap - v * ab - w * ac
            return math.sqrt(np.dot(rest, rest))
    nearest2 = np.inf
    for k in range(3):
        start = a if k == 0 else (b if k == 1 else c)
        edge = ab if k == 0 else (c - b if k == 1 else -ac)
        length2 = np.dot(edge, edge)
        share = np.dot(p - start, edge) / length2 if length2 > 0.0 else 0.0
        rest = p - start - min(max(share, 0.0), 1.0) * edge
        nearest2 = min(nearest2, np.dot(rest, rest))
    return math.sqrt(nearest2)


def _mesh_distances(points: Floats, triangles: Floats) -> Floats:
    """Return the distances of points (N, 3) from the nearest of triangles (T, 3, 3)."""
    found = np.full(len(points), np.inf)
    for i in range(len(points)):
        for t in triangles:
            found[i] = min(found[i], triangle_distance(points[i], t[0], t[1], t[2]))
    return found


mesh_hits: Any = numba.njit(cache=True)(_mesh_hits)
triangle_distance: Any = numba.njit(cache=True)(_triangle_distance)
mesh_distances: Any = numba.njit(cache=True)(_mesh_distances)
