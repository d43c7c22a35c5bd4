"""All overlapping pairs of boxes, for tests that check them one by one."""

import numpy as np
import numpy.typing as npt

from are_ros.world import boxes as box_kernels
from are_ros.world.boxes import OrientedBoxes, candidate_pairs, overlaps


def overlapping_pairs(boxes: OrientedBoxes) -> npt.NDArray[np.int64]:
    """Return the index pairs (M, 2) of boxes that overlap, low index first, in sorted order."""
    pairs = candidate_pairs(box_kernels.bounds(boxes.packed))
    if len(pairs):
        pairs = pairs[overlaps(boxes.take(pairs[:, 0]), boxes.take(pairs[:, 1]))]
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
