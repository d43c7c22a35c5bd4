"""Rays through a lattice of voxels, in leaps as long as the distance field allows.

A voxel at chessboard distance k from the nearest occupied one is the middle of a cube of 2 k - 1
voxels that are all free: the ray goes on at that cube's far side. Many rays advance in step, their
state in two flat arrays at fixed offsets, because only so does the arithmetic become SIMD code.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled

LANES: Final = 32
"""Rays that advance together; their state stays in the first-level cache."""

# Offsets of the integer state: voxel; -1 where the direction is negative; distance; flat index.
_X: Final = 0
_Y: Final = LANES
_Z: Final = 2 * LANES
_SIGN_X: Final = 3 * LANES
_SIGN_Y: Final = 4 * LANES
_SIGN_Z: Final = 5 * LANES
_FREE: Final = 6 * LANES
_INDEX: Final = 7 * LANES
INTEGERS: Final = 8 * LANES

# Offsets of the float state: direction [voxels/m], its inverse, last distance to look at, distance.
_DX: Final = 0
_DY: Final = LANES
_DZ: Final = 2 * LANES
_IX: Final = 3 * LANES
_IY: Final = 4 * LANES
_IZ: Final = 5 * LANES
_END: Final = 6 * LANES
_AT: Final = 7 * LANES
FLOATS: Final = 8 * LANES

_TINY: Final = np.float32(1e-20)
_ZERO: Final = np.float32(0.0)
_ONE: Final = np.float32(1.0)
_INFINITE: Final = np.float32(np.inf)


@compiled
def trace(
    field: npt.NDArray[np.uint8],
    origin: npt.NDArray[np.float32],
    ignored: int,
    directions: npt.NDArray[np.float32],
    start_m: np.float32,
    limits_m: npt.NDArray[np.float32],
    hits_m: npt.NDArray[np.float32],
) -> None:
    """Write the first hit of each ray, from `start_m` on and below its limit [m], else inf.

    `field` is `chessboard_distance`; `origin` (3,) [voxels] is common to all rays; `directions`
    (3, N) [voxels/m] are unit vectors in metres, turned and scaled into the lattice. The voxel with
    flat index `ignored` (-1: none) counts as free: the one that the sensor itself stands in.
    """
    integers = np.empty(INTEGERS, dtype=np.int32)
    floats = np.empty(FLOATS, dtype=np.float32)
    flat = field.reshape(-1)
    for first in range(0, hits_m.size, LANES):
        count = min(LANES, hits_m.size - first)
        floats[_END:] = -_INFINITE
        floats[_DX : _DX + count] = directions[0, first : first + count]
        floats[_DY : _DY + count] = directions[1, first : first + count]
        floats[_DZ : _DZ + count] = directions[2, first : first + count]
        floats[_END : _END + count] = limits_m[first : first + count]
        _begin(field.shape, origin, start_m, integers, floats)
        while _leap(flat, field.shape[1], field.shape[2], origin, ignored, integers, floats):
            pass
        for lane in range(count):
            hit = integers[_FREE + lane] == 0
            hits_m[first + lane] = floats[_AT + lane] if hit else _INFINITE


@compiled
def _begin(
    shape: tuple[int, int, int],
    origin: npt.NDArray[np.float32],
    start_m: np.float32,
    integers: npt.NDArray[np.int32],
    floats: npt.NDArray[np.float32],
) -> None:
    """Put every ray at the voxel where it starts or enters the lattice; idle if it never does.

    A ray that never enters, or whose limit lies before, never moves and has its hit at infinity.
    """
    nx, ny, nz = np.int32(shape[1]), np.int32(shape[2]), np.int32(shape[0])
    ox, oy, oz = origin[0], origin[1], origin[2]
    for lane in range(LANES):
        dx, dy, dz = floats[_DX + lane], floats[_DY + lane], floats[_DZ + lane]
        ix, iy, iz = inverse(dx), inverse(dy), inverse(dz)
        ax, bx = -ox * ix, (np.float32(nx) - ox) * ix
        ay, by = -oy * iy, (np.float32(ny) - oy) * iy
        az, bz = -oz * iz, (np.float32(nz) - oz) * iz
        at = max(start_m, min(ax, bx), min(ay, by), min(az, bz))
        end = min(floats[_END + lane], max(ax, bx), max(ay, by), max(az, bz))
        enters = at < end
        t = at if enters else _ZERO
        x = _within(np.int32(ox + t * dx), np.int32(0), nx - np.int32(1))
        y = _within(np.int32(oy + t * dy), np.int32(0), ny - np.int32(1))
        z = _within(np.int32(oz + t * dz), np.int32(0), nz - np.int32(1))
        integers[_X + lane], integers[_Y + lane], integers[_Z + lane] = x, y, z
        integers[_SIGN_X + lane] = np.int32(0) if ix >= _ZERO else np.int32(-1)
        integers[_SIGN_Y + lane] = np.int32(0) if iy >= _ZERO else np.int32(-1)
        integers[_SIGN_Z + lane] = np.int32(0) if iz >= _ZERO else np.int32(-1)
        integers[_INDEX + lane] = (z * nx + x) * ny + y
        floats[_IX + lane], floats[_IY + lane], floats[_IZ + lane] = ix, iy, iz
        floats[_END + lane] = end if enters else -_INFINITE
        floats[_AT + lane] = at if enters else _INFINITE


@compiled
def inverse(component: np.float32) -> np.float32:
    """Return 1 / component, finite also for zero."""
    divisor: np.float32 = component if abs(component) > _TINY else _TINY
    reciprocal: np.float32 = _ONE / divisor
    return reciprocal


@compiled
def _leap(
    flat: npt.NDArray[np.uint8],
    stride_z: int,
    stride_x: int,
    origin: npt.NDArray[np.float32],
    ignored: int,
    integers: npt.NDArray[np.int32],
    floats: npt.NDArray[np.float32],
) -> bool:
    """Advance every lane that still can by one leap; return whether any did.

    The axis along which a ray leaves its cube is set exactly; the others are floored and kept
    within the cube, so that each leap makes progress whatever the rounding.
    """
    for lane in range(LANES):
        index = integers[_INDEX + lane]
        integers[_FREE + lane] = 1 if index == ignored else flat[np.uint32(index)]
    rows, columns = np.int32(stride_z), np.int32(stride_x)
    ox, oy, oz = origin[0], origin[1], origin[2]
    moving = np.int32(0)
    for lane in range(LANES):
        x, y, z = integers[_X + lane], integers[_Y + lane], integers[_Z + lane]
        free = integers[_FREE + lane]
        sx, sy, sz = integers[_SIGN_X + lane], integers[_SIGN_Y + lane], integers[_SIGN_Z + lane]
        next_x, next_y, next_z = (
            x + ((free ^ sx) - sx),
            y + ((free ^ sy) - sy),
            z + ((free ^ sz) - sz),
        )
        tx = (np.float32(np.int32(next_x - sx)) - ox) * floats[_IX + lane]
        ty = (np.float32(np.int32(next_y - sy)) - oy) * floats[_IY + lane]
        tz = (np.float32(np.int32(next_z - sz)) - oz) * floats[_IZ + lane]
        t = min(tz, ty)
        t = min(t, tx)
        go = (free != 0) & (t < floats[_END + lane])
        half = free - np.int32(1)
        inner_x = _within(np.int32(ox + t * floats[_DX + lane]), x - half, x + half)
        inner_y = _within(np.int32(oy + t * floats[_DY + lane]), y - half, y + half)
        inner_z = _within(np.int32(oz + t * floats[_DZ + lane]), z - half, z + half)
        x = (next_x if tx <= t else inner_x) if go else x
        y = (next_y if ty <= t else inner_y) if go else y
        z = (next_z if tz <= t else inner_z) if go else z
        integers[_X + lane], integers[_Y + lane], integers[_Z + lane] = x, y, z
        integers[_INDEX + lane] = (z * rows + x) * columns + y
        floats[_AT + lane] = t if go else floats[_AT + lane]
        moving += np.int32(go)
    return bool(moving > 0)


@compiled
def _within(value: np.int32, low: np.int32, high: np.int32) -> np.int32:
    raised = max(value, low)
    return min(raised, high)


@compiled
def free_cone(
    field: npt.NDArray[np.uint8],
    origin: npt.NDArray[np.float32],
    ignored: int,
    axis: npt.NDArray[np.float32],
    spread: npt.NDArray[np.float32],
    limit_m: np.float32,
) -> np.float32:
    """Return a distance [m] up to which no ray of a bundle meets an occupied voxel.

    A ray of the bundle is at most `spread` t [voxels, per axis] off the axis' point at t metres;
    `axis` and `spread` are (3,) [voxels/m]. Ends where the axis leaves the lattice or at the limit.
    """
    flat = field.reshape(-1)
    t = _ZERO
    while t < limit_m:
        x, y, z = (
            _floor(origin[0] + t * axis[0]),
            _floor(origin[1] + t * axis[1]),
            _floor(origin[2] + t * axis[2]),
        )
        if not (0 <= x < field.shape[1] and 0 <= y < field.shape[2] and 0 <= z < field.shape[0]):
            break
        index = (z * field.shape[1] + x) * field.shape[2] + y
        free = 1 if index == ignored else int(flat[index])
        reach = min(
            _reach(origin[0], axis[0], spread[0], x, free),
            _reach(origin[1], axis[1], spread[1], y, free),
            _reach(origin[2], axis[2], spread[2], z, free),
        )
        if free == 0 or reach <= t * np.float32(1.0001) + np.float32(1e-6):
            break
        t = reach
    return min(t, limit_m)


@compiled
def _floor(value: np.float32) -> int:
    return int(np.floor(value))


@compiled
def _reach(
    origin: np.float32, axis: np.float32, spread: np.float32, voxel: int, free: int
) -> np.float32:
    """Return up to which distance [m] the bundle stays in its cube along one axis."""
    high, low = np.float32(voxel + free) - origin, origin - np.float32(voxel + 1 - free)
    up = high / (axis + spread) if axis + spread > _TINY else _INFINITE
    down = low / (spread - axis) if spread - axis > _TINY else _INFINITE
    return min(up, down)
