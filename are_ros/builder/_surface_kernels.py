"""Triangles into voxels: the separating-axis test of Akenine-Moeller, in voxel units."""

import numpy as np
from numpy.typing import NDArray

from are_ros._compiled import compiled

_FloatArray = NDArray[np.float64]
_IndexArray = NDArray[np.int64]


@compiled
def _is_axis_separating(triangle: _FloatArray, axis: _FloatArray, half: _FloatArray) -> bool:
    """Tell whether an axis parts a triangle (3, 3) from the open cuboid about the origin."""
    reach = half[0] * abs(axis[0]) + half[1] * abs(axis[1]) + half[2] * abs(axis[2])
    if reach == 0.0:  # parallel edges give no axis
        return False
    a = triangle[0, 0] * axis[0] + triangle[0, 1] * axis[1] + triangle[0, 2] * axis[2]
    b = triangle[1, 0] * axis[0] + triangle[1, 1] * axis[1] + triangle[1, 2] * axis[2]
    c = triangle[2, 0] * axis[0] + triangle[2, 1] * axis[1] + triangle[2, 2] * axis[2]
    return bool(min(a, b, c) >= reach or max(a, b, c) <= -reach)


@compiled
def _axes(triangle: _FloatArray, normal: _FloatArray) -> _FloatArray:
    """Return the 13 axes: the cuboid's, the triangle's normal, and edge cross cuboid axis."""
    axes = np.zeros((13, 3))
    axes[0, 0], axes[1, 1], axes[2, 2] = 1.0, 1.0, 1.0
    axes[3] = normal
    for k in range(3):
        edge = triangle[(k + 1) % 3] - triangle[k]
        axes[4 + 3 * k, 1], axes[4 + 3 * k, 2] = -edge[2], edge[1]
        axes[5 + 3 * k, 0], axes[5 + 3 * k, 2] = edge[2], -edge[0]
        axes[6 + 3 * k, 0], axes[6 + 3 * k, 1] = -edge[1], edge[0]
    return axes


@compiled
def _meets(triangle: _FloatArray, axes: _FloatArray, voxel: _IndexArray, half: _FloatArray) -> bool:
    """Tell whether a triangle meets the open cuboid in a voxel."""
    local = np.empty((3, 3))
    for k in range(3):
        for axis in range(3):
            local[k, axis] = triangle[k, axis] - (voxel[axis] + 0.5)
    for k in range(13):  # noqa: SIM110 - numba
        if _is_axis_separating(local, axes[k], half):
            return False
    return True


@compiled
def _span(triangle: _FloatArray, axis: int) -> tuple[int, int]:
    """Return the first and last voxel that a triangle reaches along an axis, with a margin."""
    low, high = np.min(triangle[:, axis]), np.max(triangle[:, axis])
    return np.int64(np.floor(low - 1e-6)), np.int64(np.floor(high + 1e-6))


@compiled
def _mark_triangle(
    triangle: _FloatArray, half: _FloatArray, low: _IndexArray, marks: NDArray[np.bool_]
) -> None:
    """Mark the voxels that a triangle meets, columns along its normal's main direction."""
    first, second = triangle[1] - triangle[0], triangle[2] - triangle[0]
    normal = np.cross(first, second)
    axes = _axes(triangle, normal)
    w = np.int64(np.argmax(np.abs(normal)))
    u, v = (w + 1) % 3, (w + 2) % 3
    low_w, high_w = _span(triangle, w)
    slope_u = -normal[u] / normal[w] if normal[w] != 0.0 else np.inf
    slope_v = -normal[v] / normal[w] if normal[w] != 0.0 else np.inf
    reach = 0.5 * (abs(slope_u) + abs(slope_v)) + 1e-6
    voxel = np.empty(3, np.int64)
    for i in range(_span(triangle, u)[0], _span(triangle, u)[1] + 1):
        for j in range(_span(triangle, v)[0], _span(triangle, v)[1] + 1):
            start, end = low_w, high_w
            if reach < 1e6:  # else an area of zero: all voxels in reach are tested
                rise = slope_u * (i + 0.5 - triangle[0, u]) + slope_v * (j + 0.5 - triangle[0, v])
                start = max(start, np.int64(np.floor(triangle[0, w] + rise - reach)))
                end = min(end, np.int64(np.floor(triangle[0, w] + rise + reach)))
            for k in range(start, end + 1):
                voxel[u], voxel[v], voxel[w] = i, j, k
                if _meets(triangle, axes, voxel, half):
                    marks[voxel[0] - low[0], voxel[1] - low[1], voxel[2] - low[2]] = True


@compiled
def mark_triangles(
    triangles: _FloatArray, half: _FloatArray, low: _IndexArray, marks: NDArray[np.bool_]
) -> None:
    """Mark, in an array whose voxel (0, 0, 0) has index `low`, what triangles (F, 3, 3) meet.

    All in voxel units; `half` (3,) is half the part of a voxel that counts, up to 0.5.
    """
    for face in range(triangles.shape[0]):
        _mark_triangle(triangles[face], half, low, marks)
