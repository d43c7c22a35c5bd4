"""Lookups over the tables of a frame tree: climb, interpolate and compose along the chain."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled

Pose = tuple[float, float, float, float, float, float, float]

SERIES_REACH: Final = 0.005
"""1 - cos(angle) up to which five terms of the series are exact to rounding (a turn of 11 deg)."""


@compiled
def weight_by_series(t: float, gap: float) -> float:
    """Return sin(t angle) / sin(angle) for 1 - cos(angle) = gap, without trigonometry.

    The factors are gap (i / (2i + 1) - t^2 / (i (2i + 1))), i = 1..5 (Eberly's slerp).
    """
    u = t * t
    total = 1.0 + gap * (5.0 / 11.0 - u * (1.0 / 55.0))
    total = 1.0 + gap * (4.0 / 9.0 - u * (1.0 / 36.0)) * total
    total = 1.0 + gap * (3.0 / 7.0 - u * (1.0 / 21.0)) * total
    total = 1.0 + gap * (2.0 / 5.0 - u * (1.0 / 10.0)) * total
    total = 1.0 + gap * (1.0 / 3.0 - u * (1.0 / 3.0)) * total
    return t * total


@compiled
def _turned(
    i: float, j: float, k: float, w: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return the vector x y z turned by the quaternion."""
    cx, cy, cz = j * z - k * y + w * x, k * x - i * z + w * y, i * y - j * x + w * z
    return x + 2 * (j * cz - k * cy), y + 2 * (k * cx - i * cz), z + 2 * (i * cy - j * cx)


@compiled
def composed(a: Pose, b: Pose) -> Pose:
    """Return a after b."""
    ax, ay, az, ai, aj, ak, aw = a
    bx, by, bz, bi, bj, bk, bw = b
    x, y, z = _turned(ai, aj, ak, aw, bx, by, bz)
    return (
        ax + x,
        ay + y,
        az + z,
        aw * bi + ai * bw + aj * bk - ak * bj,
        aw * bj - ai * bk + aj * bw + ak * bi,
        aw * bk + ai * bj - aj * bi + ak * bw,
        aw * bw - ai * bi - aj * bj - ak * bk,
    )


@compiled
def inverted(a: Pose) -> Pose:
    """Return the inverse."""
    x, y, z, i, j, k, w = a
    bx, by, bz = _turned(-i, -j, -k, w, -x, -y, -z)
    return bx, by, bz, -i, -j, -k, w


Integers = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

STAMP: Final = 0
SAMPLE_PARENT: Final = 1
SAMPLE_WIDTH: Final = 9

FIRST: Final = 0
END: Final = 1
KIND: Final = 2
FRAME_WIDTH: Final = 3

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
def row_at(samples: Integers, frames: Integers, frame: int, stamp_ns: int) -> int:
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
        row = row_at(samples, frames, frame, stamp_ns)
        if hold and row == -FUTURE:
            row = int(frames[frame, END] - 1)
        if row < 0:
            return step, -row
        path[1, step] = row
        frame = samples[row, SAMPLE_PARENT]
    return 0, LOOP


@compiled
def _joined(
    samples: Integers,
    frames: Integers,
    ends: tuple[int, int],
    stamp_ns: int,
    hold: bool,
    down: Integers,
    up: Integers,
) -> tuple[int, int, int]:
    """Climb from `ends`, target and source, until the paths `down` and `up` meet; see `_climb`.

    Returns a status, and how many steps along `down` and `up` the first frame lies that both have.
    Where they do not meet, the target's failure comes first, as in tf2.
    """
    down_steps, down_status = _climb(samples, frames, ends[0], stamp_ns, hold, down)
    up_steps, up_status = _climb(samples, frames, ends[1], stamp_ns, hold, up)
    if LOOP in (up_status, down_status):
        return LOOP, -1, -1
    for j in range(down_steps + 1):
        for i in range(up_steps + 1):
            if up[0, i] == down[0, j]:
                return FOUND, j, i
    if down_status != FOUND:
        return int(down_status + STATUSES * down[0, down_steps]), -1, -1
    if up_status != FOUND:
        return int(up_status + STATUSES * up[0, up_steps]), -1, -1
    return DISCONNECTED, -1, -1


@compiled
def _along(samples: Integers, frames: Integers, path: Integers, steps: int, stamp_ns: int) -> Pose:
    """Return the composed pose of the first `steps` edges of a path: top_from_start.

    Between two samples of an edge the translation is linear, the rotation a slerp along the shorter
    arc. Where the next sample has another parent, the pose is held.
    """
    numbers = samples.view(np.float64)
    pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    for step in range(steps):
        row = path[1, step]
        edge, stamp = pose_in_row(numbers, row), samples[row, STAMP]
        if (
            frames[path[0, step], KIND] != STATIC
            and stamp != stamp_ns
            and samples[row, SAMPLE_PARENT] == samples[row + 1, SAMPLE_PARENT]
        ):
            t = (stamp_ns - stamp) / (samples[row + 1, STAMP] - stamp)
            x0, y0, z0, i0, j0, k0, w0 = edge
            x1, y1, z1, i1, j1, k1, w1 = pose_in_row(numbers, row + 1)
            s = 1.0 - t
            cosine = i0 * i1 + j0 * j1 + k0 * k1 + w0 * w1
            gap, sign = 1.0 - abs(cosine), -1.0 if cosine < 0.0 else 1.0
            if gap < SERIES_REACH:
                a, b = weight_by_series(s, gap), sign * weight_by_series(t, gap)
            else:
                angle = math.acos(abs(cosine))
                scale = 1.0 / math.sin(angle)
                a, b = math.sin(s * angle) * scale, sign * math.sin(t * angle) * scale
            edge = (
                s * x0 + t * x1,
                s * y0 + t * y1,
                s * z0 + t * z1,
                a * i0 + b * i1,
                a * j0 + b * j1,
                a * k0 + b * k1,
                a * w0 + b * w1,
            )
        pose = composed(edge, pose)
    return pose


@compiled
def look_up(
    samples: Integers, frames: Integers, target: int, source: int, stamp_ns: int, out: Floats
) -> int:
    """Write target_from_source into `out` (7,), each sample's own parent heeded."""
    down, up = np.empty((2, frames.shape[0]), np.int64), np.empty((2, frames.shape[0]), np.int64)
    status, j, i = _joined(samples, frames, (target, source), stamp_ns, False, down, up)
    if status != FOUND:
        return status
    pose = _along(samples, frames, up, i, stamp_ns)
    if j > 0:
        pose = composed(inverted(_along(samples, frames, down, j, stamp_ns)), pose)
    out[0], out[1], out[2] = pose[0], pose[1], pose[2]
    qx, qy, qz, qw = pose[3:]
    scale = 1.0 / math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    out[3], out[4], out[5], out[6] = qx * scale, qy * scale, qz * scale, qw * scale
    return FOUND


@compiled
def latest_not_after(
    samples: Integers, frames: Integers, target: int, source: int, now_ns: int
) -> tuple[int, int]:
    """Return (status, stamp): the latest stamp <= now at which the whole chain is known.

    Each pass takes the chain in force at a limit, and lowers the limit to the newest sample of
    its edges; it ends because a limit is `now` or some edge's newest stamp.
    """
    down, up = np.empty((2, frames.shape[0]), np.int64), np.empty((2, frames.shape[0]), np.int64)
    limit = now_ns
    while True:
        status, j, i = _joined(samples, frames, (target, source), limit, True, down, up)
        if status != FOUND:
            return status, limit
        lowered = NO_LIMIT
        for path, steps in ((up, i), (down, j)):
            for step in range(steps):
                frame = path[0, step]
                if frames[frame, KIND] == DYNAMIC:
                    lowered = min(lowered, samples[frames[frame, END] - 1, STAMP])
        if lowered >= limit:
            return FOUND, limit
        limit = lowered
