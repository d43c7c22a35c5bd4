"""Upright boxes that rotate about the vertical: overlap tests, kernels, and a spatial hash.

Kernels take packed boxes: one float64 row (x, y, z, cos, sin, half x, half y, half z) each.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from are_ros._compiled import compiled

_FloatArray = NDArray[np.float64]
_IndexArray = NDArray[np.int64]


@compiled
def pack(poses: _FloatArray, shapes: _FloatArray) -> _FloatArray:
    """Return the packed boxes (N, 8) of bodies at poses (N, 4): x, y, z of the box's centre, yaw.

    Shapes (N, 5), or one row for all: half x, half y, half z, and the box's centre x, y in the
    frame of the body.
    """
    packed = np.empty((poses.shape[0], 8))
    step = 0 if shapes.shape[0] == 1 else 1
    for i in range(poses.shape[0]):
        pose, shape = poses[i], shapes[i * step]
        cos, sin = np.cos(pose[3]), np.sin(pose[3])
        packed[i, 0] = pose[0] + cos * shape[3] - sin * shape[4]
        packed[i, 1] = pose[1] + sin * shape[3] + cos * shape[4]
        packed[i, 2] = pose[2]
        packed[i, 3], packed[i, 4] = cos, sin
        packed[i, 5], packed[i, 6], packed[i, 7] = shape[0], shape[1], shape[2]
    return packed


@compiled
def boxes_overlap(p: _FloatArray, i: int, q: _FloatArray, j: int, tolerance_m: float) -> bool:
    """Tell whether box i of p and box j of q overlap by more than a tolerance on each axis.

    Separating axes: z, and the two edge directions of each footprint.
    """
    if p[i, 7] + q[j, 7] - abs(q[j, 2] - p[i, 2]) <= tolerance_m:
        return False
    dx = q[j, 0] - p[i, 0]
    dy = q[j, 1] - p[i, 1]
    c = abs(p[i, 3] * q[j, 3] + p[i, 4] * q[j, 4])
    s = abs(p[i, 3] * q[j, 4] - p[i, 4] * q[j, 3])
    px, py, qx, qy = p[i, 5], p[i, 6], q[j, 5], q[j, 6]
    along_p = px + qx * c + qy * s - abs(dx * p[i, 3] + dy * p[i, 4])
    across_p = py + qx * s + qy * c - abs(dy * p[i, 3] - dx * p[i, 4])
    along_q = qx + px * c + py * s - abs(dx * q[j, 3] + dy * q[j, 4])
    across_q = qy + px * s + py * c - abs(dy * q[j, 3] - dx * q[j, 4])
    return bool(min(along_p, across_p, along_q, across_q) > tolerance_m)


@compiled
def any_pair_overlaps(p: _FloatArray, pairs: _IndexArray, tolerance_m: float) -> bool:
    """Tell whether the rows of p overlap in any of the pairs (M, 2)."""
    for k in range(pairs.shape[0]):
        if boxes_overlap(p, pairs[k, 0], p, pairs[k, 1], tolerance_m):
            return True
    return False


@compiled
def overlaps_any_of(p: _FloatArray, q: _FloatArray, tolerance_m: float) -> NDArray[np.bool_]:
    """Tell for each row of p whether it overlaps any row of q."""
    out, count, first = np.zeros(p.shape[0], np.bool_), q.shape[0], 0
    for i in range(p.shape[0]):
        own_m = p[i, 5] + p[i, 6]
        for k in range(first, first + count):
            j = k - count if k >= count else k
            reach_m = own_m + q[j, 5] + q[j, 6]  # more than any of the corners has
            near = abs(q[j, 0] - p[i, 0]) < reach_m and abs(q[j, 1] - p[i, 1]) < reach_m
            if near and boxes_overlap(p, i, q, j, tolerance_m):
                out[i], first = True, j  # what the next box meets, too, if it is a neighbour
                break
    return out


def bounds(p: _FloatArray) -> _FloatArray:
    """Return the axis-aligned bounds (N, 4) of the footprints: low x, low y, high x, high y."""
    c, s = np.abs(p[:, 3]), np.abs(p[:, 4])
    x_m, y_m = c * p[:, 5] + s * p[:, 6], s * p[:, 5] + c * p[:, 6]
    out = np.empty((len(p), 4))
    out[:, 0], out[:, 1] = p[:, 0] - x_m, p[:, 1] - y_m
    out[:, 2], out[:, 3] = p[:, 0] + x_m, p[:, 1] + y_m
    return out


_NONE = -1
_LEAST_BITS = 2  # a table of four by four: three neighbouring cells are three buckets


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
    sides_m = rectangles[:, 2:] - rectangles[:, :2]
    if not np.isfinite(sides_m).all():
        raise ValueError("the rectangles are not all finite")
    per_m = 0.999 / max(1e-6, sides_m.max())
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
        centred = poses.copy()
        centred[:, 2] += shapes[:, 2]
        return cls.of_packed(pack(centred, shapes), poses[:, 3])

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
        poses, shapes = np.empty((len(self), 4)), np.zeros((len(self), 5))
        poses[:, :3], poses[:, 3], shapes[:, :3] = self.centres_m, self.yaws_rad, self.half_sizes_m
        packed = pack(poses, shapes)
        packed.flags.writeable = False
        return packed


def overlaps_any(boxes: OrientedBoxes, others: OrientedBoxes) -> NDArray[np.bool_]:
    """Tell for each of N boxes whether it overlaps any of the others: bool (N,).

    Exact separating-axis test of open boxes, z included: boxes overlap if they meet by more than
    `TOUCH_TOLERANCE_M` on each axis.
    """
    return overlaps_any_of(boxes.packed, others.packed, TOUCH_TOLERANCE_M)


def any_overlap(boxes: OrientedBoxes) -> bool:
    """Tell whether any two of the boxes overlap, by the test of `overlaps_any`."""
    pairs = candidate_pairs(bounds(boxes.packed))
    return any_pair_overlaps(boxes.packed, pairs, TOUCH_TOLERANCE_M)


def _readonly(values: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return a read-only, contiguous view (a copy if need be) of this shape."""
    array: NDArray[np.float64] = np.ascontiguousarray(values, dtype=np.float64)
    array = array.reshape(shape).view()
    array.flags.writeable = False
    return array
