"""Loops of the judge of scans: rays against boxes, triangles and lattices; shares no code."""

import math
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
INF = math.inf


def _box_hits(origin: Floats, ways: Floats, half: Floats) -> Floats:
    """Return where rays (N, 3) from `origin` enter a box round 0, 0 from inside, inf if never."""
    hits = np.full(len(ways), np.inf)
    for ray in range(len(ways)):
        enter, leave = 0.0, np.inf
        for axis in range(3):
            way, at = ways[ray, axis], origin[axis]
            if way == 0.0:
                if abs(at) > half[axis]:
                    leave = -1.0
                continue
            one, other = (-half[axis] - at) / way, (half[axis] - at) / way
            enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
        if enter <= leave:
            hits[ray] = enter
    return hits


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


def _box_distances(points: Floats, half: Floats) -> Floats:
    """Return the distances of points (N, 3) from the surface of a box round 0."""
    found = np.empty(len(points))
    for i in range(len(points)):
        outside2, inside = 0.0, np.inf
        for axis in range(3):
            beyond = abs(points[i, axis]) - half[axis]
            inside = min(inside, -beyond)
            outside2 += max(beyond, 0.0) ** 2
        found[i] = math.sqrt(outside2) if outside2 > 0.0 else inside
    return found


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


def _first_solid(
    origins: Floats, ways: Floats, reach: Floats, solid: Any, corner: Floats, size: Floats
) -> Floats:
    """Return how far rays (N, 3) go until they enter a solid cell, inf if not within `reach` (N,).

    `solid` (X, Y, Z) is a lattice of cells of `size` (3,) from its low corner; the cell in which
    a ray starts does not count.
    """
    found = np.full(len(ways), np.inf)
    cell, step = np.zeros(3, np.int64), np.zeros(3, np.int64)
    next_at, each = np.zeros(3), np.zeros(3)
    for ray in range(len(ways)):
        begin, end = 0.0, reach[ray]
        for axis in range(3):  # the part of the ray inside the lattice
            way, at = ways[ray, axis], origins[ray, axis] - corner[axis]
            extent = size[axis] * solid.shape[axis]
            if way == 0.0:
                if at < 0.0 or at >= extent:
                    end = -1.0
                continue
            begin = max(begin, min(-at / way, (extent - at) / way))
            end = min(end, max(-at / way, (extent - at) / way))
        if begin > end:
            continue
        for axis in range(3):
            way = ways[ray, axis]
            at = origins[ray, axis] + begin * way - corner[axis]
            index = math.floor(at / size[axis])
            cell[axis] = min(max(index, 0), solid.shape[axis] - 1)
            step[axis] = 1 if way > 0.0 else -1
            each[axis] = abs(size[axis] / way) if way != 0.0 else np.inf
            edge = (cell[axis] + (1 if way > 0.0 else 0)) * size[axis]
            start = origins[ray, axis] - corner[axis]
            next_at[axis] = (edge - start) / way if way != 0.0 else np.inf
        at, counts = begin, begin > 0.0
        while at <= end:
            if counts and solid[cell[0], cell[1], cell[2]]:
                found[ray] = at
                break
            axis = int(np.argmin(next_at))
            at, counts = next_at[axis], True
            next_at[axis] += each[axis]
            cell[axis] += step[axis]
            if cell[axis] < 0 or cell[axis] >= solid.shape[axis]:
                break
    return found


box_hits: Any = numba.njit(cache=True)(_box_hits)
mesh_hits: Any = numba.njit(cache=True)(_mesh_hits)
box_distances: Any = numba.njit(cache=True)(_box_distances)
triangle_distance: Any = numba.njit(cache=True)(_triangle_distance)
mesh_distances: Any = numba.njit(cache=True)(_mesh_distances)
first_solid: Any = numba.njit(cache=True)(_first_solid)
