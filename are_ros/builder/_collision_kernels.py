"""The resolver's walk in id order, over neighbours that a spatial hash has found."""

import numpy as np
from numpy.typing import NDArray

from are_ros._compiled import compiled
from are_ros.world.box_kernels import bounds, boxes_overlap
from are_ros.world.spatial_hash import candidate_pairs

_FloatArray = NDArray[np.float64]
_IndexArray = NDArray[np.int64]
_Mask = NDArray[np.bool_]

KEPT = 0
MOVED_BACK = 1


@compiled
def neighbours(proposed: _FloatArray, safe: _FloatArray) -> tuple[_IndexArray, _IndexArray]:
    """Return starts (N + 1,) and indices of those that each may meet at either of its poses."""
    rectangles, others = bounds(proposed), bounds(safe)
    rectangles[:, :2] = np.minimum(rectangles[:, :2], others[:, :2])
    rectangles[:, 2:] = np.maximum(rectangles[:, 2:], others[:, 2:])
    pairs = candidate_pairs(rectangles)
    starts = np.zeros(rectangles.shape[0] + 1, np.int64)
    for k in range(pairs.shape[0]):
        starts[pairs[k, 0]] += 1
        starts[pairs[k, 1]] += 1
    starts = np.cumsum(starts)
    indices = np.empty(2 * pairs.shape[0], np.int64)
    for k in range(pairs.shape[0]):
        a, b = pairs[k, 0], pairs[k, 1]
        starts[a] -= 1
        indices[starts[a]] = b
        starts[b] -= 1
        indices[starts[b]] = a
    return starts, indices


@compiled
def _is_clear(
    pose: _FloatArray,
    i: int,
    current: _FloatArray,
    present: _Mask,
    candidates: _IndexArray,
    tolerance_m: float,
) -> bool:
    """Tell whether box i of `pose` overlaps none of the candidates where they now are."""
    for k in range(candidates.shape[0]):
        j = candidates[k]
        if j != i and present[j] and boxes_overlap(pose, i, current, j, tolerance_m):
            return False
    return True


@compiled
def walk(
    start: int,
    proposed: _FloatArray,
    safe: _FloatArray,
    allowed: _Mask,
    current: _FloatArray,
    present: _Mask,
    adjacency: tuple[_IndexArray, _IndexArray],
    strays: _IndexArray,
    outcomes: NDArray[np.int8],
    tolerance_m: float,
) -> int:
    """Keep or move back one after the other from `start`; return the first that can do neither.

    `allowed` (N, 2): whether proposed and last safe pose are clear of walls and robots. `strays`:
    those that a search has put out of their neighbourhood, so that all must heed them. `current`
    and `outcomes` are written. Returns N at the end.
    """
    starts, indices = adjacency
    for i in range(start, proposed.shape[0]):
        if not present[i]:
            continue
        near = indices[starts[i] : starts[i + 1]]
        resolved = False
        for choice in range(2):
            pose = proposed if choice == 0 else safe
            if (
                allowed[i, choice]
                and _is_clear(pose, i, current, present, near, tolerance_m)
                and _is_clear(pose, i, current, present, strays, tolerance_m)
            ):
                current[i] = pose[i]
                outcomes[i] = KEPT if choice == 0 else MOVED_BACK
                resolved = True
                break
        if not resolved:
            return i
    return int(proposed.shape[0])
