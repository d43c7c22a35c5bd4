"""Which boxes overlap, pair by pair, for tests that check them one by one."""

import numpy as np
import numpy.typing as npt

from are_ros.world import boxes as box_kernels
from are_ros.world.boxes import TOUCH_TOLERANCE_M, OrientedBoxes, candidate_pairs


def overlaps(boxes: OrientedBoxes, others: OrientedBoxes) -> npt.NDArray[np.bool_]:
    """Tell for each i whether `boxes[i]` and `others[i]` overlap; either may be of length one."""
    p, q = np.broadcast_arrays(boxes.packed, others.packed)
    return np.array(
        [box_kernels.boxes_overlap(p, i, q, i, TOUCH_TOLERANCE_M) for i in range(len(p))], bool
    )


def overlapping_pairs(boxes: OrientedBoxes) -> npt.NDArray[np.int64]:
    """Return the index pairs (M, 2) of boxes that overlap, low index first, in sorted order."""
    pairs = candidate_pairs(box_kernels.bounds(boxes.packed))
    if len(pairs):
        pairs = pairs[overlaps(boxes.take(pairs[:, 0]), boxes.take(pairs[:, 1]))]
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
