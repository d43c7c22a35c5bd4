"""The tables of a frame tree that kernels read, and one edge at a stamp.

`samples` is int64 (rows, 9): stamp [ns], number of the parent frame, and the bits of seven float64
x y z i j k w, parent_from_child. `frames` is int64 (frames, 5): the rows [first, end) of the edge
to the parent, ascending in stamp; its kind; the newest sample's parent; 1 if all samples have it.
Stamps that tie an edge's first or last sample are inside.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.world._interpolation import Pose, interpolated

Integers = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

STAMP: Final = 0
SAMPLE_PARENT: Final = 1
SAMPLE_WIDTH: Final = 9

FIRST: Final = 0
END: Final = 1
KIND: Final = 2
PARENT: Final = 3
UNIFORM: Final = 4
FRAME_WIDTH: Final = 5

ROOT: Final = 0
STATIC: Final = 1
DYNAMIC: Final = 2

FOUND: Final = 0
PAST: Final = 1
FUTURE: Final = 2
DISCONNECTED: Final = 3
LOOP: Final = 4
STATUSES: Final = 5
"""A kernel answers with a status, plus `STATUSES` times the number of the frame it failed at."""

NO_LIMIT: Final = 2**63 - 1


@compiled
def row_at(samples: Integers, frames: Integers, frame: int, stamp_ns: int, hint: int) -> int:
    """Return the row in force at the stamp (the newest not after it), or minus a status."""
    low, high = frames[frame, FIRST], frames[frame, END] - 1
    if frames[frame, KIND] == STATIC:
        return int(low)
    oldest, newest = samples[low, STAMP], samples[high, STAMP]
    if stamp_ns >= newest:
        return int(high) if stamp_ns == newest else -FUTURE
    if stamp_ns < oldest:
        return -PAST
    guess = low + int((stamp_ns - oldest) / (newest - oldest) * (high - low))
    if low <= hint < high:
        guess = hint
    while True:
        guess = min(max(guess, low), high - 1)
        if stamp_ns < samples[guess, STAMP]:
            high = guess
        elif stamp_ns < samples[guess + 1, STAMP]:
            return int(guess)
        else:
            low = guess + 1
            if stamp_ns < samples[low + 1, STAMP]:
                return int(low)
        guess = (low + high) >> 1


@compiled
def pose_in_row(numbers: Floats, row: int) -> Pose:
    """Return the seven numbers of a row; an unsigned index spares the test for a negative one."""
    r = np.uint64(row)
    return (
        numbers[r, 2],
        numbers[r, 3],
        numbers[r, 4],
        numbers[r, 5],
        numbers[r, 6],
        numbers[r, 7],
        numbers[r, 8],
    )


@compiled
def edge_pose(samples: Integers, numbers: Floats, kind: int, row: int, stamp_ns: int) -> Pose:
    """Return parent_from_child at the stamp; it is held where the next sample's parent differs."""
    pose = pose_in_row(numbers, row)
    stamp = samples[row, STAMP]
    if kind == STATIC or stamp == stamp_ns:
        return pose
    if samples[row, SAMPLE_PARENT] != samples[row + 1, SAMPLE_PARENT]:
        return pose
    t = (stamp_ns - stamp) / (samples[row + 1, STAMP] - stamp)
    return interpolated(pose, pose_in_row(numbers, row + 1), t)
