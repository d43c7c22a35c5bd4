"""Kernels of the floor search: surfaces of columns, and floods over the columns.

A surface of column (i, j) is an index k with voxel k - 1 occupied and voxel k not.
"""

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled


@compiled
def surface_counts(occupied: npt.NDArray[np.uint8]) -> npt.NDArray[np.int64]:
    """Return how many columns of uint8 (nx, ny, nz) have a surface at k, int64 (nz + 1,)."""
    nx, ny, nz = occupied.shape
    counts = np.zeros(nz + 1, dtype=np.int64)
    for i in range(nx):
        for j in range(ny):
            column = occupied[i, j]
            for k in range(1, nz):
                counts[k] += column[k - 1] & (1 - column[k])
            counts[nz] += column[nz - 1]
    return counts


@compiled
def _nearest_surface(column: npt.NDArray[np.uint8], k: int, step: int) -> int:
    """Return the surface nearest to k within step, the lower of two; -1 if there is none."""
    nz = column.shape[0]
    for distance in range(step + 1):
        for sign in (-1, 1):
            at = k + sign * distance
            if 1 <= at <= nz and column[at - 1] == 1 and (at == nz or column[at] == 0):
                return at
    return -1


@compiled
def flood_floor(
    occupied: npt.NDArray[np.uint8], level: int, step: int, unknown: int
) -> npt.NDArray[np.int32]:
    """Return the floor's surface index of each column, int32 (nx, ny), or `unknown`.

    Breadth first, from all columns with a surface within `step` of `level`, in C order.
    """
    nx, ny, _ = occupied.shape
    tops = np.full((nx, ny), unknown, dtype=np.int32)
    queue = np.empty((nx * ny, 2), dtype=np.int32)
    end = 0
    for i in range(nx):
        for j in range(ny):
            surface = _nearest_surface(occupied[i, j], level, step)
            if surface >= 0:
                tops[i, j] = surface
                queue[end, 0], queue[end, 1] = i, j
                end += 1
    start = 0
    while start < end:
        i, j = queue[start, 0], queue[start, 1]
        start += 1
        for di, dj in ((-1, 0), (0, -1), (0, 1), (1, 0)):
            a, b = i + di, j + dj
            if 0 <= a < nx and 0 <= b < ny and tops[a, b] == unknown:
                surface = _nearest_surface(occupied[a, b], tops[i, j], step)
                if surface >= 0:
                    tops[a, b] = surface
                    queue[end, 0], queue[end, 1] = a, b
                    end += 1
    return tops


@compiled
def fill_from_nearest(tops: npt.NDArray[np.int32], unknown: int) -> None:
    """Give each unknown column the value of a nearest known one (4-neighbour steps), in place.

    Of several equally near, the one that the breadth-first search in C order meets first.
    """
    nx, ny = tops.shape
    queue = np.empty((nx * ny, 2), dtype=np.int32)
    end = 0
    for i in range(nx):
        for j in range(ny):
            if tops[i, j] != unknown:
                queue[end, 0], queue[end, 1] = i, j
                end += 1
    start = 0
    while start < end:
        i, j = queue[start, 0], queue[start, 1]
        start += 1
        for di, dj in ((-1, 0), (0, -1), (0, 1), (1, 0)):
            a, b = i + di, j + dj
            if 0 <= a < nx and 0 <= b < ny and tops[a, b] == unknown:
                tops[a, b] = tops[i, j]
                queue[end, 0], queue[end, 1] = a, b
                end += 1
