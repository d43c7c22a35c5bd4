"""Broad phase: the pairs of rectangles that may meet, by a spatial hash, without N^2 tests."""

import numpy as np
from numpy.typing import NDArray

from are_ros._compiled import compiled

_FloatArray = NDArray[np.float64]
_IndexArray = NDArray[np.int64]


@compiled
def _hash_cell_size(rectangles: _FloatArray) -> float:
    """Return a cell size near the mean extent, such that the table stays linear in N.

    It doubles while huge rectangles would fill more than eight cells per rectangle on average.
    ValueError where their extents have no finite sum: no doubling would ever be enough.
    """
    count = rectangles.shape[0]
    extent = 0.0
    for i in range(count):
        extent += rectangles[i, 2] - rectangles[i, 0] + rectangles[i, 3] - rectangles[i, 1]
    if not np.isfinite(extent):
        raise ValueError("the rectangles are not all finite")
    size = max(extent / (2.0 * count), 1e-6)
    while True:
        entries = 0.0
        for i in range(count):
            columns = np.floor(rectangles[i, 2] / size) - np.floor(rectangles[i, 0] / size) + 1.0
            rows = np.floor(rectangles[i, 3] / size) - np.floor(rectangles[i, 1] / size) + 1.0
            entries += columns * rows
        if entries <= 8.0 * count:
            return float(size)
        size *= 2.0


@compiled
def _cells(rectangles: _FloatArray, size: float) -> _IndexArray:
    """Return the hash cells (N, 4) that each rectangle spans: low x, low y, high x, high y."""
    cells = np.empty(rectangles.shape, np.int64)
    for i in range(rectangles.shape[0]):
        for k in range(4):
            cells[i, k] = np.int64(np.floor(rectangles[i, k] / size))
    return cells


@compiled
def _bucket(x: int, y: int, bits: int) -> int:
    """Return the bucket of a hash cell: the plane wraps around, so that neighbours stay near."""
    mask = (1 << bits) - 1
    return ((y & mask) << bits) | (x & mask)


@compiled
def _fill_buckets(cells: _IndexArray) -> tuple[_IndexArray, _IndexArray]:
    """Return bucket starts (T + 1,) and entries (E, 3): rectangle, cell x, cell y."""
    total = 0
    for i in range(cells.shape[0]):
        total += (cells[i, 2] - cells[i, 0] + 1) * (cells[i, 3] - cells[i, 1] + 1)
    bits = 2
    while 1 << (2 * bits) < total:
        bits += 1
    starts = np.zeros((1 << (2 * bits)) + 1, np.int64)
    for i in range(cells.shape[0]):
        for y in range(cells[i, 1], cells[i, 3] + 1):
            for x in range(cells[i, 0], cells[i, 2] + 1):
                starts[_bucket(x, y, bits)] += 1
    end = 0
    for bucket in range(starts.shape[0]):
        end += starts[bucket]
        starts[bucket] = end
    entries = np.empty((total, 3), np.int64)
    for i in range(cells.shape[0]):
        for y in range(cells[i, 1], cells[i, 3] + 1):
            for x in range(cells[i, 0], cells[i, 2] + 1):
                bucket = _bucket(x, y, bits)
                starts[bucket] -= 1
                entry = starts[bucket]
                entries[entry, 0], entries[entry, 1], entries[entry, 2] = i, x, y
    return starts, entries


@compiled
def _is_found_here(
    rectangles: _FloatArray, cells: _IndexArray, entries: _IndexArray, a: int, b: int
) -> bool:
    """Tell whether entries a and b meet, in the first cell that both rectangles span."""
    i, j = entries[a, 0], entries[b, 0]
    x, y = entries[a, 1], entries[a, 2]
    return bool(
        x == entries[b, 1]
        and y == entries[b, 2]
        and x == max(cells[i, 0], cells[j, 0])
        and y == max(cells[i, 1], cells[j, 1])
        and rectangles[i, 0] < rectangles[j, 2]
        and rectangles[j, 0] < rectangles[i, 2]
        and rectangles[i, 1] < rectangles[j, 3]
        and rectangles[j, 1] < rectangles[i, 3]
    )


@compiled
def candidate_pairs(rectangles: _FloatArray) -> _IndexArray:
    """Return each pair (M, 2), low index first, of rectangles (N, 4) whose interiors meet, once.

    The order is that of the hash table: the same for the same input, but not sorted. ValueError
    if there are several and a bound is NaN or infinite.
    """
    pairs = np.empty((max(16, rectangles.shape[0]), 2), np.int64)
    count = 0
    if rectangles.shape[0] < 2:
        return pairs[:0]
    cells = _cells(rectangles, _hash_cell_size(rectangles))
    starts, entries = _fill_buckets(cells)
    for bucket in range(starts.shape[0] - 1):
        for a in range(starts[bucket], starts[bucket + 1]):
            for b in range(a + 1, starts[bucket + 1]):
                if _is_found_here(rectangles, cells, entries, a, b):
                    if count == pairs.shape[0]:
                        pairs = np.concatenate((pairs, np.empty_like(pairs)))
                    pairs[count, 0] = min(entries[a, 0], entries[b, 0])
                    pairs[count, 1] = max(entries[a, 0], entries[b, 0])
                    count += 1
    return pairs[:count]
