"""Triangles into voxels: the separating-axis test of Akenine-Moeller, in voxel units."""

import numpy as np
from numpy.typing import NDArray

from are_ros._compiled import compiled

_FloatArray = NDArray[np.float64]
_IndexArray = NDArray[np.int64]


@compiled
def _is_axis_separating(
    triangle: _FloatArray, axes: _FloatArray, which: int, half: _FloatArray
) -> bool:
    """Tell whether one axis parts a triangle (3, 3) from the open cuboid about the origin."""
    x, y, z = axes[which, 0], axes[which, 1], axes[which, 2]
    reach = half[0] * abs(x) + half[1] * abs(y) + half[2] * abs(z)
    if reach == 0.0:  # parallel edges give no axis
        return False
    a = triangle[0, 0] * x + triangle[0, 1] * y + triangle[0, 2] * z
    b = triangle[1, 0] * x + triangle[1, 1] * y + triangle[1, 2] * z
    c = triangle[2, 0] * x + triangle[2, 1] * y + triangle[2, 2] * z
    return bool(min(a, b, c) >= reach or max(a, b, c) <= -reach)


@compiled
def _write_axes(triangle: _FloatArray, axes: _FloatArray) -> None:
    """Write the 13 axes: the cuboid's, the triangle's normal, and edge cross cuboid axis.

    Those elements that are zero for all triangles are taken to be zero.
    """
    axes[0, 0], axes[1, 1], axes[2, 2] = 1.0, 1.0, 1.0
    for k in range(3):
        following = (k + 1) % 3
        x = triangle[following, 0] - triangle[k, 0]
        y = triangle[following, 1] - triangle[k, 1]
        z = triangle[following, 2] - triangle[k, 2]
        axes[4 + 3 * k, 1], axes[4 + 3 * k, 2] = -z, y
        axes[5 + 3 * k, 0], axes[5 + 3 * k, 2] = z, -x
        axes[6 + 3 * k, 0], axes[6 + 3 * k, 1] = -y, x
    for k in range(3):
        u, v = (k + 1) % 3, (k + 2) % 3
        first_u, first_v = triangle[1, u] - triangle[0, u], triangle[1, v] - triangle[0, v]
        second_u, second_v = triangle[2, u] - triangle[0, u], triangle[2, v] - triangle[0, v]
        axes[3, k] = first_u * second_v - first_v * second_u


@compiled
def _meets(
    triangle: _FloatArray,
    axes: _FloatArray,
    voxel: _IndexArray,
    half: _FloatArray,
    local: _FloatArray,
) -> bool:
    """Tell whether a triangle meets the open cuboid in a voxel; `local` is working space."""
    for k in range(3):
        for axis in range(3):
            local[k, axis] = triangle[k, axis] - (voxel[axis] + 0.5)
    for k in range(13):  # noqa: SIM110 - numba
        if _is_axis_separating(local, axes, k, half):
            return False
    return True


@compiled
def _span(triangle: _FloatArray, axis: int) -> tuple[int, int]:
    """Return the first and last voxel that a triangle reaches along an axis, with a margin."""
    a, b, c = triangle[0, axis], triangle[1, axis], triangle[2, axis]
    return np.int64(np.floor(min(a, b, c) - 1e-6)), np.int64(np.floor(max(a, b, c) + 1e-6))


@compiled
def _main_axis(axes: _FloatArray) -> int:
    """Return the axis along which the triangle's normal is longest."""
    x, y, z = abs(axes[3, 0]), abs(axes[3, 1]), abs(axes[3, 2])
    if x >= y and x >= z:
        return 0
    return 1 if y >= z else 2


@compiled
def _column(
    triangle: _FloatArray, axes: _FloatArray, w: int, i: int, j: int
) -> tuple[float, float]:
    """Return the heights between which the triangle's plane passes a column of voxels."""
    u, v = (w + 1) % 3, (w + 2) % 3
    if axes[3, w] == 0.0:  # a triangle without area has no plane
        return -np.inf, np.inf
    slope_u, slope_v = -axes[3, u] / axes[3, w], -axes[3, v] / axes[3, w]
    reach = 0.5 * (abs(slope_u) + abs(slope_v)) + 1e-6
    rise = slope_u * (i + 0.5 - triangle[0, u]) + slope_v * (j + 0.5 - triangle[0, v])
    return triangle[0, w] + rise - reach, triangle[0, w] + rise + reach


@compiled
def mark_triangles(
    triangles: _FloatArray, half: _FloatArray, low: _IndexArray, marks: NDArray[np.bool_]
) -> None:
    """Mark, in an array whose voxel (0, 0, 0) has index `low`, what triangles (F, 3, 3) meet.

    All in voxel units; `half` (3,) is half the part of a voxel that counts, up to 0.5. Columns
    of voxels run along the main direction of each triangle's normal.
    """
    axes, local, voxel = np.zeros((13, 3)), np.empty((3, 3)), np.empty(3, np.int64)
    for face in range(triangles.shape[0]):
        triangle = triangles[face]
        _write_axes(triangle, axes)
        w = _main_axis(axes)
        u, v = (w + 1) % 3, (w + 2) % 3
        low_w, high_w = _span(triangle, w)
        for i in range(_span(triangle, u)[0], _span(triangle, u)[1] + 1):
            for j in range(_span(triangle, v)[0], _span(triangle, v)[1] + 1):
                bottom, top = _column(triangle, axes, w, i, j)
                start = np.int64(np.floor(max(bottom, low_w + 0.5)))
                end = np.int64(np.floor(min(top, high_w + 0.5)))
                for k in range(start, end + 1):
                    voxel[u], voxel[v], voxel[w] = i, j, k
                    if _meets(triangle, axes, voxel, half, local):
                        marks[voxel[0] - low[0], voxel[1] - low[1], voxel[2] - low[2]] = True
