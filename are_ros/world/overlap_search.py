"""Whether any two boxes overlap: a yes or no for all at once, by a hash of their centres."""

import numpy as np
from numpy.typing import NDArray

from are_ros._compiled import compiled
from are_ros.world.box_kernels import boxes_overlap

_FloatArray = NDArray[np.float64]

_NOBODY = -1
_LEAST_BITS = 2  # a table of four by four: three neighbouring cells are three buckets


@compiled
def any_overlap(packed: _FloatArray, tolerance_m: float) -> bool:
    """Tell whether any two of the packed boxes (N, 8) overlap by more than a tolerance.

    Cells are as wide as the widest box can reach, so that who overlaps is in one of nine; the
    plane wraps around in the table, which has at least as many buckets as there are boxes.
    """
    count = packed.shape[0]
    reaches_m = np.empty(count)
    widest_m = 0.0
    for i in range(count):
        reaches_m[i] = np.sqrt(packed[i, 5] ** 2 + packed[i, 6] ** 2)
        widest_m = max(widest_m, reaches_m[i])
    per_m = 1.0 / max(2.0 * widest_m, 1e-6)
    bits = _LEAST_BITS
    while 1 << (2 * bits) < count:
        bits += 1
    mask = (1 << bits) - 1
    newest = np.full(1 << (2 * bits), _NOBODY, np.int32)
    older = np.empty(count, np.int32)
    for i in range(count):
        column = np.int64(np.floor(packed[i, 0] * per_m))
        row = np.int64(np.floor(packed[i, 1] * per_m))
        for y in range(row - 1, row + 2):
            for x in range(column - 1, column + 2):
                j = newest[((y & mask) << bits) | (x & mask)]
                while j != _NOBODY:
                    reach_m = reaches_m[i] + reaches_m[j]
                    if (
                        abs(packed[i, 0] - packed[j, 0]) < reach_m
                        and abs(packed[i, 1] - packed[j, 1]) < reach_m
                        and boxes_overlap(packed, i, packed, j, tolerance_m)
                    ):
                        return True
                    j = older[j]
        bucket = ((row & mask) << bits) | (column & mask)
        older[i] = newest[bucket]
        newest[bucket] = i
    return False
