"""Signed distance between a rounded convex polygon and the rectangles of packed boxes."""

import numpy as np
from numpy.typing import NDArray

from are_ros._compiled import compiled

_FloatArray = NDArray[np.float64]


@compiled
def _to_box_frame(vertices: _FloatArray, box: _FloatArray, i: int, local: _FloatArray) -> None:
    """Write the polygon's vertices, in the frame of box i, to `local`."""
    for k in range(vertices.shape[0]):
        dx = vertices[k, 0] - box[i, 0]
        dy = vertices[k, 1] - box[i, 1]
        local[k, 0] = dx * box[i, 3] + dy * box[i, 4]
        local[k, 1] = dy * box[i, 3] - dx * box[i, 4]


@compiled
def _largest_separation(polygon: _FloatArray, hx: float, hy: float) -> float:
    """Return the largest gap over all edge normals; negative: minus the penetration depth.

    These normals are those of the Minkowski difference, so the least translation is among them.
    """
    count = polygon.shape[0]
    separation = max(np.min(polygon[:, 0]) - hx, -np.max(polygon[:, 0]) - hx)
    separation = max(separation, np.min(polygon[:, 1]) - hy, -np.max(polygon[:, 1]) - hy)
    if count == 1:
        return float(separation)
    for k in range(count):
        following = (k + 1) % count
        ex = polygon[following, 0] - polygon[k, 0]
        ey = polygon[following, 1] - polygon[k, 1]
        offset = ey * polygon[k, 0] - ex * polygon[k, 1]
        gap = -(hx * abs(ey) + hy * abs(ex) + offset) / np.hypot(ex, ey)
        separation = max(separation, gap)
    return float(separation)


@compiled
def _squared_distance_to_edge(
    ax: float, ay: float, bx: float, by: float, x: float, y: float
) -> float:
    """Return the squared distance of point (x, y) from the segment a-b."""
    ex, ey = bx - ax, by - ay
    along = ((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey)
    along = min(max(along, 0.0), 1.0)
    return (ax + along * ex - x) ** 2 + (ay + along * ey - y) ** 2


@compiled
def _distance_apart(polygon: _FloatArray, hx: float, hy: float) -> float:
    """Return the distance of two disjoint shapes: one end of it is a vertex of either."""
    count = polygon.shape[0]
    least = np.inf
    for k in range(count):
        x = max(abs(polygon[k, 0]) - hx, 0.0)
        y = max(abs(polygon[k, 1]) - hy, 0.0)
        least = min(least, x * x + y * y)
    for k in range(count if count > 1 else 0):
        ax, ay = polygon[k, 0], polygon[k, 1]
        bx, by = polygon[(k + 1) % count, 0], polygon[(k + 1) % count, 1]
        for x in (-hx, hx):
            for y in (-hy, hy):
                least = min(least, _squared_distance_to_edge(ax, ay, bx, by, x, y))
    return float(np.sqrt(least))


@compiled
def signed_distances(vertices: _FloatArray, radius_m: float, packed: _FloatArray) -> _FloatArray:
    """Return the signed distances (N,) of a rounded polygon (K, 2) from boxes (N, 8)."""
    out = np.empty(packed.shape[0])
    local = np.empty(vertices.shape)
    for i in range(packed.shape[0]):
        _to_box_frame(vertices, packed, i, local)
        distance = _largest_separation(local, packed[i, 5], packed[i, 6])
        if distance > 0.0:
            distance = _distance_apart(local, packed[i, 5], packed[i, 6])
        out[i] = distance - radius_m
    return out


@compiled
def penetrations(vertices: _FloatArray, radius_m: float, packed: _FloatArray) -> _FloatArray:
    """Return the penetration depths (N,), 0 where apart; far boxes cost one comparison."""
    out = np.zeros(packed.shape[0])
    x, y = np.mean(vertices[:, 0]), np.mean(vertices[:, 1])
    reach = radius_m + np.max(np.hypot(vertices[:, 0] - x, vertices[:, 1] - y))
    local = np.empty(vertices.shape)
    for i in range(packed.shape[0]):
        limit = reach + packed[i, 5] + packed[i, 6]
        if abs(packed[i, 0] - x) < limit and abs(packed[i, 1] - y) < limit:
            _to_box_frame(vertices, packed, i, local)
            distance = _largest_separation(local, packed[i, 5], packed[i, 6])
            if distance > 0.0:
                distance = _distance_apart(local, packed[i, 5], packed[i, 6])
            out[i] = max(radius_m - distance, 0.0)
    return out
