"""Boxes that rotate about the vertical only, and the exact overlap tests between them."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from are_ros.world import box_kernels, spatial_hash

TOUCH_TOLERANCE_M: Final = 1e-9
"""Sets are open: what meets by no more than this only touches. It absorbs rounding, no more."""


@dataclass(frozen=True, eq=False)
class OrientedBoxes:
    """N boxes in the map frame, upright, each turned by its yaw about its vertical axis.

    `centres_m` float64 (N, 3); `yaws_rad` float64 (N,), any real number; `half_sizes_m` float64
    (N, 3), not negative: half the length along the heading, half the width, half the height. All
    numbers are finite. Arrays are converted, then kept read-only.
    """

    centres_m: NDArray[np.float64]
    yaws_rad: NDArray[np.float64]
    half_sizes_m: NDArray[np.float64]

    def __post_init__(self) -> None:
        object.__setattr__(self, "centres_m", _readonly(self.centres_m, (-1, 3)))
        object.__setattr__(self, "yaws_rad", _readonly(self.yaws_rad, (-1,)))
        object.__setattr__(self, "half_sizes_m", _readonly(self.half_sizes_m, (-1, 3)))
        if not len(self.centres_m) == len(self.yaws_rad) == len(self.half_sizes_m):
            raise ValueError("centres, yaws and half sizes differ in length")

    @classmethod
    def empty(cls) -> "OrientedBoxes":
        """Return no boxes at all."""
        return cls(np.empty((0, 3)), np.empty(0), np.empty((0, 3)))

    @classmethod
    def of_packed(
        cls, packed: NDArray[np.float64], yaws_rad: NDArray[np.float64]
    ) -> "OrientedBoxes":
        """Return the boxes of rows (N, 8) as `packed` gives them, which are kept, with their yaws.

        Nobody writes into the rows later; cos and sin are those of the yaws (N,).
        """
        packed = packed.view()
        packed.flags.writeable = False
        boxes = object.__new__(cls)  # views are enough: nothing is converted, checked or copied
        boxes.__dict__.update(
            centres_m=packed[:, :3],
            yaws_rad=_readonly(yaws_rad, (-1,)),
            half_sizes_m=packed[:, 5:],
            packed=packed,
        )
        return boxes

    @classmethod
    def standing(cls, poses: NDArray[np.float64], shapes: NDArray[np.float64]) -> "OrientedBoxes":
        """Return the boxes of bodies on the ground at poses (N, 4), x, y, z, yaw, in their frame.

        Shapes (N, 5), or one row for all, are half x, half y, half z, and the box's centre x, y in
        the frame of the body.
        """
        return cls.of_packed(box_kernels.standing(poses, shapes), poses[:, 3])

    def __len__(self) -> int:
        return len(self.yaws_rad)

    def at(self, index: int) -> "OrientedBoxes":
        """Return box `index` (negative counts from the end) as boxes of length one."""
        row = range(len(self))[index]
        return self.take(slice(row, row + 1))

    def take(self, which: NDArray[np.int64] | NDArray[np.bool_] | slice) -> "OrientedBoxes":
        """Return the boxes chosen by indices, by a mask (N,) or by a slice."""
        return OrientedBoxes.of_packed(self.packed[which], self.yaws_rad[which])

    def footprints(self) -> NDArray[np.float64]:
        """Return the footprints' corners (N, 4, 2), counter-clockwise from the front left one."""
        signs = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
        local = signs * self.half_sizes_m[:, None, :2]
        c, s = self.packed[:, 3, None], self.packed[:, 4, None]
        x = local[..., 0] * c - local[..., 1] * s
        y = local[..., 0] * s + local[..., 1] * c
        return self.centres_m[:, None, :2] + np.stack((x, y), axis=-1)

    @cached_property
    def packed(self) -> NDArray[np.float64]:
        """Rows (N, 8) for kernels: x, y, z, cos yaw, sin yaw, half x, half y, half z; read-only."""
        packed = box_kernels.pack(self.centres_m, self.yaws_rad, self.half_sizes_m)
        packed.flags.writeable = False
        return packed


def overlaps(boxes: OrientedBoxes, others: OrientedBoxes) -> NDArray[np.bool_]:
    """Tell for each i whether `boxes[i]` and `others[i]` overlap; either may be of length one.

    Exact separating-axis test of open boxes, z included: boxes overlap if they meet by more than
    `TOUCH_TOLERANCE_M` on each axis. Raises ValueError where lengths neither agree nor are one.
    """
    if len(boxes) != len(others) and 1 not in {len(boxes), len(others)}:
        raise ValueError(f"cannot pair {len(boxes)} boxes with {len(others)}")
    return box_kernels.overlaps_elementwise(boxes.packed, others.packed, TOUCH_TOLERANCE_M)


def overlaps_any(boxes: OrientedBoxes, others: OrientedBoxes) -> NDArray[np.bool_]:
    """Tell for each of N boxes whether it overlaps any of the others: bool (N,)."""
    return box_kernels.overlaps_any_of(boxes.packed, others.packed, TOUCH_TOLERANCE_M)


def any_overlap(boxes: OrientedBoxes) -> bool:
    """Tell whether any two of the boxes overlap, by the test of `overlaps`."""
    return spatial_hash.any_overlap(boxes.packed, TOUCH_TOLERANCE_M)


def _readonly(values: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return a read-only, contiguous view (a copy if need be) of this shape."""
    array: NDArray[np.float64] = np.ascontiguousarray(values, dtype=np.float64)
    array = array.reshape(shape).view()
    array.flags.writeable = False
    return array
