"""Lookups of many stamps at once: edge after edge, a block of stamps along each.

The loops over a block have no branches and read columns, so that the compiler vectorises them.
"""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.world._edge_kernels import (
    END,
    FIRST,
    FOUND,
    KIND,
    PARENT,
    STAMP,
    STATIC,
    Floats,
    Integers,
    pose_in_row,
    row_at,
)
from are_ros.world._frame_kernels import depth, look_up_general, write
from are_ros.world._interpolation import (
    SERIES_REACH,
    Pose,
    composed,
    inverted,
    slerp_weights,
    weight_by_series,
)

Rows = npt.NDArray[np.uint64]

BLOCK: Final = 256


@compiled
def _find_places(
    samples: Integers, frames: Integers, frame: int, stamps_ns: Integers, rows: Rows, ts: Floats
) -> bool:
    """Write each stamp's row, and its place t in [0, 1] from there to the next; False: outside.

    Each search begins where the last one ended: ascending stamps cost a comparison or two. The
    last sample is written as t = 1 from the one before, so that a next row is always there.
    """
    last = frames[frame, END] - 1
    if frames[frame, FIRST] == last:
        return False
    row, low, high = -1, 0, 0
    for n in range(stamps_ns.shape[0]):
        stamp = stamps_ns[n]
        if not low <= stamp < high:
            row = row_at(samples, frames, frame, stamp, row + 1)
            if row < 0:
                return False
            row = min(row, last - 1)
            low, high = samples[row, STAMP], samples[row + 1, STAMP]
        rows[n] = row
        ts[n] = (stamp - low) / (high - low)
    return True


@compiled
def _find_weights(numbers: Floats, rows: Rows, ts: Floats, weights: Floats) -> None:
    """Write the slerp's two factors per stamp into `weights` (3, N); the third row is scratch."""
    one = np.uint64(1)
    for n in range(rows.shape[0]):
        r = rows[n]
        cosine = (
            numbers[r, 5] * numbers[r + one, 5]
            + numbers[r, 6] * numbers[r + one, 6]
            + numbers[r, 7] * numbers[r + one, 7]
            + numbers[r, 8] * numbers[r + one, 8]
        )
        gap = 1.0 - abs(cosine)
        weights[0, n] = weight_by_series(1.0 - ts[n], gap)
        weights[1, n] = math.copysign(weight_by_series(ts[n], gap), cosine)
        weights[2, n] = cosine
    for n in range(rows.shape[0]):
        if abs(weights[2, n]) <= 1.0 - SERIES_REACH:
            weights[0, n], weights[1, n] = slerp_weights(ts[n], weights[2, n])


@compiled
def _column(poses: Floats, n: int) -> Pose:
    """Return one column of `poses` (7, N)."""
    return (
        poses[0, n],
        poses[1, n],
        poses[2, n],
        poses[3, n],
        poses[4, n],
        poses[5, n],
        poses[6, n],
    )


@compiled
def _put(poses: Floats, n: int, pose: Pose) -> None:
    """Write one column of `poses` (7, N)."""
    poses[0, n], poses[1, n], poses[2, n] = pose[0], pose[1], pose[2]
    poses[3, n], poses[4, n], poses[5, n], poses[6, n] = pose[3], pose[4], pose[5], pose[6]


@compiled
def _move_along(numbers: Floats, rows: Rows, ts: Floats, weights: Floats, poses: Floats) -> None:
    """Replace each column of `poses` (7, N) by the interpolated edge after it."""
    one = np.uint64(1)
    for n in range(rows.shape[0]):
        r = rows[n]
        q = r + one
        t, a, b = ts[n], weights[0, n], weights[1, n]
        s = 1.0 - t
        edge = (
            s * numbers[r, 2] + t * numbers[q, 2],
            s * numbers[r, 3] + t * numbers[q, 3],
            s * numbers[r, 4] + t * numbers[q, 4],
            a * numbers[r, 5] + b * numbers[q, 5],
            a * numbers[r, 6] + b * numbers[q, 6],
            a * numbers[r, 7] + b * numbers[q, 7],
            a * numbers[r, 8] + b * numbers[q, 8],
        )
        _put(poses, n, composed(edge, _column(poses, n)))


@compiled
def _move_by(edge: Pose, poses: Floats) -> None:
    """Replace each column of `poses` (7, N) by a fixed edge after it."""
    for n in range(poses.shape[1]):
        _put(poses, n, composed(edge, _column(poses, n)))


@compiled
def _climb_block(
    samples: Integers, frames: Integers, start: int, top: int, stamps_ns: Integers, poses: Floats
) -> bool:
    """Write top_from_start at each stamp into `poses` (7, N); False if an edge does not reach."""
    numbers = samples.view(np.float64)
    count = stamps_ns.shape[0]
    rows, ts, weights = np.empty(count, np.uint64), np.empty(count), np.empty((3, count))
    poses[:6], poses[6] = 0.0, 1.0
    frame = start
    while frame != top:
        if frames[frame, KIND] == STATIC:
            _move_by(pose_in_row(numbers, frames[frame, FIRST]), poses)
        else:
            if not _find_places(samples, frames, frame, stamps_ns, rows, ts):
                return False
            _find_weights(numbers, rows, ts, weights)
            _move_along(numbers, rows, ts, weights, poses)
        frame = frames[frame, PARENT]
    return True


@compiled
def _meeting_frame(frames: Integers, target: int, source: int) -> int:
    """Return the first frame above both; -1 without one, or if an edge changed its parent."""
    up, down = depth(frames, source), depth(frames, target)
    if up < 0 or down < 0:
        return -1
    while source != target:
        if max(up, down) == 0:
            return -1
        if up >= down:
            source, up = frames[source, PARENT], up - 1
        else:
            target, down = frames[target, PARENT], down - 1
    return source


@compiled
def _look_up_block(
    samples: Integers,
    frames: Integers,
    target: int,
    top: int,
    source: int,
    stamps_ns: Integers,
    out: Floats,
) -> bool:
    """Write target_from_source at each stamp into `out` (N, 7), by way of `top`; False: outside."""
    poses, others = np.empty((7, stamps_ns.shape[0])), np.empty((7, stamps_ns.shape[0]))
    if not _climb_block(samples, frames, source, top, stamps_ns, poses):
        return False
    if not _climb_block(samples, frames, target, top, stamps_ns, others):
        return False
    for n in range(stamps_ns.shape[0]):
        pose = _column(poses, n)
        if target != top:
            pose = composed(inverted(_column(others, n)), pose)
        write(pose, out[n])
    return True


@compiled
def look_up_many(
    samples: Integers, frames: Integers, target: int, source: int, stamps_ns: Integers, out: Floats
) -> tuple[int, int]:
    """Write target_from_source at each stamp into `out`, float64 (N, 7).

    Return (status, number of the stamp that it failed at). A block that meets anything out of the
    ordinary is left to `look_up_general`, stamp by stamp.
    """
    top = _meeting_frame(frames, target, source)
    for begin in range(0, stamps_ns.shape[0], BLOCK):
        stamps, block = stamps_ns[begin : begin + BLOCK], out[begin : begin + BLOCK]
        if top >= 0 and _look_up_block(samples, frames, target, top, source, stamps, block):
            continue
        for n in range(stamps.shape[0]):
            status = look_up_general(samples, frames, target, source, stamps[n], block[n])
            if status != FOUND:
                return status, begin + n
    return FOUND, stamps_ns.shape[0]
