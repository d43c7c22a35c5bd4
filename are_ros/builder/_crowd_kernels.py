"""The arrays of the living, taken from one sub-step to the next."""

import numpy as np
from numpy.typing import NDArray

from are_ros._compiled import compiled
from are_ros.world.boxes import write_standing

_FloatArray = NDArray[np.float64]


@compiled
def moved_to(
    poses: _FloatArray,
    packed: _FloatArray,
    shapes: _FloatArray,
    planar: _FloatArray,
    moved: NDArray[np.bool_],
) -> tuple[_FloatArray, _FloatArray]:
    """Return poses (N, 4) and boxes (N, 8), those `moved` (N,) at `planar` (N, 3), x, y, yaw.

    `poses`, `packed` and `shapes` (N, 5) are as `box_kernels.standing` has them.
    """
    poses, packed = poses.copy(), packed.copy()
    for i in range(poses.shape[0]):
        if moved[i]:
            poses[i, 0], poses[i, 1], poses[i, 3] = planar[i, 0], planar[i, 1], planar[i, 2]
            write_standing(packed, i, poses[i], shapes[i])
    return poses, packed
