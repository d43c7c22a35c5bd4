"""Lookups over the tables of a frame tree: climb, interpolate and compose along the chain."""

import math

import numpy as np

from are_ros._compiled import compiled
from are_ros.world._edge_kernels import (
    DISCONNECTED,
    DYNAMIC,
    END,
    FOUND,
    FUTURE,
    KIND,
    LOOP,
    NO_LIMIT,
    PARENT,
    ROOT,
    SAMPLE_PARENT,
    STAMP,
    STATUSES,
    UNIFORM,
    Floats,
    Integers,
    edge_pose,
    row_at,
)
from are_ros.world._interpolation import Pose, composed, inverted


@compiled
def write(pose: Pose, out: Floats) -> None:
    """Write a pose into `out` (7,), its quaternion normalised."""
    x, y, z, i, j, k, w = pose
    scale = 1.0 / math.sqrt(i * i + j * j + k * k + w * w)
    out[0], out[1], out[2] = x, y, z
    out[3], out[4], out[5], out[6] = i * scale, j * scale, k * scale, w * scale


@compiled
def _climb(
    samples: Integers, frames: Integers, start: int, stamp_ns: int, hold: bool, path: Integers
) -> tuple[int, int]:
    """Follow the parents at the stamp up from `start`: (steps, status at the end).

    `path` (2, frames): the frames passed, the end included, and the rows of their samples.
    `hold` lets the newest sample stand for what comes after it.
    """
    frame = start
    for step in range(frames.shape[0]):
        path[0, step] = frame
        if frames[frame, KIND] == ROOT:
            return step, FOUND
        row = row_at(samples, frames, frame, stamp_ns, -1)
        if hold and row == -FUTURE:
            row = int(frames[frame, END] - 1)
        if row < 0:
            return step, -row
        path[1, step] = row
        frame = samples[row, SAMPLE_PARENT]
    return 0, LOOP


@compiled
def _meeting(up: Integers, up_steps: int, down: Integers, down_steps: int) -> tuple[int, int]:
    """Return how many steps up each path the first frame lies that both have, or (-1, -1)."""
    for j in range(down_steps + 1):
        for i in range(up_steps + 1):
            if up[0, i] == down[0, j]:
                return i, j
    return -1, -1


@compiled
def _why_apart(
    up: Integers, up_steps: int, up_status: int, down: Integers, down_steps: int, down_status: int
) -> int:
    """Return why two paths do not meet; the target's failure comes first, as in tf2."""
    if down_status != FOUND:
        return int(down_status + STATUSES * down[0, down_steps])
    if up_status != FOUND:
        return int(up_status + STATUSES * up[0, up_steps])
    return DISCONNECTED


@compiled
def _along(samples: Integers, frames: Integers, path: Integers, steps: int, stamp_ns: int) -> Pose:
    """Return the composed pose of the first `steps` edges of a path: top_from_start."""
    numbers = samples.view(np.float64)
    pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    for step in range(steps):
        kind = frames[path[0, step], KIND]
        edge = edge_pose(samples, numbers, kind, path[1, step], stamp_ns)
        pose = composed(edge, pose)
    return pose


@compiled
def look_up_general(
    samples: Integers, frames: Integers, target: int, source: int, stamp_ns: int, out: Floats
) -> int:
    """Write target_from_source into `out` (7,), each sample's own parent heeded."""
    up, down = np.empty((2, frames.shape[0]), np.int64), np.empty((2, frames.shape[0]), np.int64)
    up_steps, up_status = _climb(samples, frames, source, stamp_ns, False, up)
    down_steps, down_status = _climb(samples, frames, target, stamp_ns, False, down)
    if LOOP in (up_status, down_status):
        return LOOP
    i, j = _meeting(up, up_steps, down, down_steps)
    if i < 0:
        return _why_apart(up, up_steps, up_status, down, down_steps, down_status)
    top_from_source = _along(samples, frames, up, i, stamp_ns)
    top_from_target = _along(samples, frames, down, j, stamp_ns)
    write(composed(inverted(top_from_target), top_from_source), out)
    return FOUND


@compiled
def _newest(samples: Integers, frames: Integers, path: Integers, steps: int) -> int:
    """Return the lowest of the newest stamps of a path's first edges; `NO_LIMIT` if all static."""
    newest = NO_LIMIT
    for step in range(steps):
        frame = path[0, step]
        if frames[frame, KIND] == DYNAMIC:
            newest = min(newest, samples[frames[frame, END] - 1, STAMP])
    return newest


@compiled
def latest_not_after(
    samples: Integers, frames: Integers, target: int, source: int, now_ns: int
) -> tuple[int, int]:
    """Return (status, stamp): the latest stamp <= now at which the whole chain is known.

    Each pass takes the chain in force at a limit, and lowers the limit to the newest sample of
    its edges; it ends because a limit is `now` or some edge's newest stamp.
    """
    up, down = np.empty((2, frames.shape[0]), np.int64), np.empty((2, frames.shape[0]), np.int64)
    limit = now_ns
    while True:
        up_steps, up_status = _climb(samples, frames, source, limit, True, up)
        down_steps, down_status = _climb(samples, frames, target, limit, True, down)
        if LOOP in (up_status, down_status):
            return LOOP, limit
        i, j = _meeting(up, up_steps, down, down_steps)
        if i < 0:
            return _why_apart(up, up_steps, up_status, down, down_steps, down_status), limit
        lowered = min(_newest(samples, frames, up, i), _newest(samples, frames, down, j))
        if lowered >= limit:
            return FOUND, limit
        limit = lowered


@compiled
def depth(frames: Integers, frame: int) -> int:
    """Return the steps up to the root, or -1 if an edge on the way has several parents."""
    for step in range(frames.shape[0]):
        if frames[frame, KIND] == ROOT:
            return step
        if frames[frame, UNIFORM] == 0:
            return -1
        frame = frames[frame, PARENT]
    return -1


@compiled
def look_up(
    samples: Integers, frames: Integers, target: int, source: int, stamp_ns: int, out: Floats
) -> int:
    """Write target_from_source at the stamp into `out`, float64 (7,); return a status.

    Climbs without memory from both ends where no edge ever changed its parent; whatever is out of
    the ordinary is left to `look_up_general`.
    """
    numbers = samples.view(np.float64)
    left, right = source, target
    up, down = depth(frames, left), depth(frames, right)
    if up < 0 or down < 0:
        return look_up_general(samples, frames, target, source, stamp_ns, out)
    left_pose = right_pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    turned_back = False
    while left != right:
        on_left = up >= down
        frame = left if on_left else right
        if frames[frame, KIND] == ROOT:
            return look_up_general(samples, frames, target, source, stamp_ns, out)
        row = row_at(samples, frames, frame, stamp_ns, -1)
        if row < 0:
            return look_up_general(samples, frames, target, source, stamp_ns, out)
        pose = edge_pose(samples, numbers, frames[frame, KIND], row, stamp_ns)
        if on_left:
            left_pose, left, up = composed(pose, left_pose), frames[frame, PARENT], up - 1
        else:
            right_pose, right, down = composed(pose, right_pose), frames[frame, PARENT], down - 1
            turned_back = True
    write(composed(inverted(right_pose), left_pose) if turned_back else left_pose, out)
    return FOUND
