"""Kernels over packed boxes: one float64 row (x, y, z, cos, sin, half x, half y, half z) each."""

import numpy as np
from numpy.typing import NDArray

from are_ros._compiled import compiled

_FloatArray = NDArray[np.float64]
_IndexArray = NDArray[np.int64]


@compiled
def pack(centres_m: _FloatArray, yaws_rad: _FloatArray, half_sizes_m: _FloatArray) -> _FloatArray:
    """Return the packed rows (N, 8) of boxes."""
    packed = np.empty((centres_m.shape[0], 8))
    for i in range(packed.shape[0]):
        packed[i, 3] = np.cos(yaws_rad[i])
        packed[i, 4] = np.sin(yaws_rad[i])
        for axis in range(3):
            packed[i, axis], packed[i, 5 + axis] = centres_m[i, axis], half_sizes_m[i, axis]
    return packed


@compiled
def write_standing(packed: _FloatArray, i: int, pose: _FloatArray, shape: _FloatArray) -> None:
    """Write box i of `packed` (N, 8): of a body that stands at a pose, as `standing` has them."""
    cos, sin = np.cos(pose[3]), np.sin(pose[3])
    packed[i, 0] = pose[0] + cos * shape[3] - sin * shape[4]
    packed[i, 1] = pose[1] + sin * shape[3] + cos * shape[4]
    packed[i, 2] = pose[2] + shape[2]
    packed[i, 3] = cos
    packed[i, 4] = sin
    packed[i, 5], packed[i, 6], packed[i, 7] = shape[0], shape[1], shape[2]


@compiled
def standing(poses: _FloatArray, shapes: _FloatArray) -> _FloatArray:
    """Return the packed boxes (N, 8) of bodies that stand on the ground.

    Poses (N, 4) are x, y, z, yaw. Shapes (N, 5), or one row for all: half x, half y, half z, and
    the box's centre x, y in the frame of the body.
    """
    packed = np.empty((poses.shape[0], 8))
    step = 0 if shapes.shape[0] == 1 else 1
    for i in range(poses.shape[0]):
        write_standing(packed, i, poses[i], shapes[i * step])
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
def overlaps_elementwise(p: _FloatArray, q: _FloatArray, tolerance_m: float) -> NDArray[np.bool_]:
    """Test row i of p against row i of q; either may have one row, which meets all."""
    step_p = 0 if p.shape[0] == 1 else 1
    step_q = 0 if q.shape[0] == 1 else 1
    count = q.shape[0] if step_p == 0 else p.shape[0]
    out = np.empty(count, np.bool_)
    for i in range(count):
        out[i] = boxes_overlap(p, i * step_p, q, i * step_q, tolerance_m)
    return out


@compiled
def overlaps_any_of(p: _FloatArray, q: _FloatArray, tolerance_m: float) -> NDArray[np.bool_]:
    """Tell for each row of p whether it overlaps any row of q."""
    out = np.zeros(p.shape[0], np.bool_)
    for i in range(p.shape[0]):
        own_m = p[i, 5] + p[i, 6]
        for j in range(q.shape[0]):
            reach_m = own_m + q[j, 5] + q[j, 6]  # more than any of the corners has
            near = abs(q[j, 0] - p[i, 0]) < reach_m and abs(q[j, 1] - p[i, 1]) < reach_m
            if near and boxes_overlap(p, i, q, j, tolerance_m):
                out[i] = True
                break
    return out


@compiled
def bounds(p: _FloatArray) -> _FloatArray:
    """Return the axis-aligned bounds (N, 4) of the footprints: low x, low y, high x, high y."""
    out = np.empty((p.shape[0], 4))
    for i in range(p.shape[0]):
        c, s = abs(p[i, 3]), abs(p[i, 4])
        x_m = c * p[i, 5] + s * p[i, 6]
        y_m = s * p[i, 5] + c * p[i, 6]
        out[i, 0], out[i, 1] = p[i, 0] - x_m, p[i, 1] - y_m
        out[i, 2], out[i, 3] = p[i, 0] + x_m, p[i, 1] + y_m
    return out
