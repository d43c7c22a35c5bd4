"""Writing what changes of markers into the bytes of all of them, in machine code."""

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled

Places = npt.NDArray[np.int64]


@compiled
def put_stamps_and_poses(
    integers: npt.NDArray[np.int32],
    doubles: npt.NDArray[np.float64],
    stamps_at: Places,
    poses_at: Places,
    seconds: int,
    nanoseconds: int,
    poses: npt.NDArray[np.float64],
) -> None:
    """Write a stamp and one of `poses` (N, 7) at each of the places (N,) of two views of a message.

    `stamps_at` counts `integers`, `poses_at` counts `doubles`.
    """
    for marker in range(stamps_at.size):
        integers[stamps_at[marker]] = seconds
        integers[stamps_at[marker] + 1] = nanoseconds
        for number in range(7):
            doubles[poses_at[marker] + number] = poses[marker, number]
