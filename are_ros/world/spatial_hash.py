"""A spatial hash of rectangles: the pairs that may meet, without N^2 tests."""

import numpy as np
from numpy.typing import NDArray

from are_ros._compiled import compiled
from are_ros.world.box_kernels import bounds, boxes_overlap

_FloatArray = NDArray[np.float64]
_IndexArray = NDArray[np.int64]

_NONE = -1
_LEAST_BITS = 2  # a table of four by four: three neighbouring cells are three buckets


@compiled
def _widest(rectangles: _FloatArray) -> float:
    """Return the longest side of any rectangle [m], at least a micrometre."""
    widest_m = 1e-6
    for i in range(rectangles.shape[0]):
        width_m = rectangles[i, 2] - rectangles[i, 0]
        height_m = rectangles[i, 3] - rectangles[i, 1]
        if not np.isfinite(width_m + height_m):
            raise ValueError("the rectangles are not all finite")
        widest_m = max(widest_m, width_m, height_m)
    return widest_m


@compiled
def candidate_pairs(rectangles: _FloatArray) -> _IndexArray:
    """Return each pair (M, 2), low index first, of rectangles (N, 4) whose interiors meet, once.

    A rectangle is low x, low y, high x, high y. Cells are as wide as the widest rectangle, so that
    centres of rectangles that meet lie in neighbouring cells. The plane wraps around in the table,
    which has at least N buckets. The order is the same for the same input. ValueError if there are
    several rectangles and a bound is NaN or infinite.
    """
    count, found = rectangles.shape[0], 0
    pairs = np.empty((max(16, count), 2), np.int64)
    if count < 2:
        return pairs[:0]
    per_m = 0.999 / _widest(rectangles)
    bits = _LEAST_BITS
    while 1 << (2 * bits) < count:
        bits += 1
    mask = (1 << bits) - 1
    newest = np.full(1 << (2 * bits), _NONE, np.int64)
    older = np.empty(count, np.int64)
    for i in range(count):
        column = np.int64(np.floor(0.5 * (rectangles[i, 0] + rectangles[i, 2]) * per_m))
        row = np.int64(np.floor(0.5 * (rectangles[i, 1] + rectangles[i, 3]) * per_m))
        for y in range(row - 1, row + 2):
            for x in range(column - 1, column + 2):
                j = newest[((y & mask) << bits) | (x & mask)]
                while j != _NONE:
                    if (
                        rectangles[i, 0] < rectangles[j, 2]
                        and rectangles[j, 0] < rectangles[i, 2]
                        and rectangles[i, 1] < rectangles[j, 3]
                        and rectangles[j, 1] < rectangles[i, 3]
                    ):
                        if found == pairs.shape[0]:
                            pairs = np.concatenate((pairs, np.empty_like(pairs)))
                        pairs[found, 0], pairs[found, 1] = j, i
                        found += 1
                    j = older[j]
        bucket = ((row & mask) << bits) | (column & mask)
        older[i] = newest[bucket]
        newest[bucket] = i
    return pairs[:found]


@compiled
def any_overlap(packed: _FloatArray, tolerance_m: float) -> bool:
    """Tell whether any two of the packed boxes (N, 8) overlap by more than a tolerance."""
    pairs = candidate_pairs(bounds(packed))
    for k in range(pairs.shape[0]):
        if boxes_overlap(packed, pairs[k, 0], packed, pairs[k, 1], tolerance_m):
            return True
    return False
