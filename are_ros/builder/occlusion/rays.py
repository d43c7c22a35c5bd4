"""Rays of a camera in tiles, and first hits of rays in a lattice of voxels."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, inlined, owning
from are_ros.world.rigid_transform import RigidTransform, product
from are_ros.world.voxel_map import VoxelMap

TILE: Final = 16
"""Pixels along a tile's side."""

PIXELS: Final = TILE * TILE


class Tiles(NamedTuple):
    """What the kernels take of T tiles.

    `rays` float32 (T, 3, PIXELS), `valid` uint8 (T, PIXELS), `axes` float32 (T, 3), `spreads`
    float32 (T,), `first_pixels` int64 (T, 2) of x and y. A ray differs from its tile's axis by a
    vector no longer than the spread: at t metres it is at most `spread` t metres away from the
    axis' point at t. Tiles without a valid ray are left out; an invalid ray is zero.
    """

    rays: npt.NDArray[np.float32]
    valid: npt.NDArray[np.uint8]
    axes: npt.NDArray[np.float32]
    spreads: npt.NDArray[np.float32]
    first_pixels: npt.NDArray[np.int64]


def aligned(*shape: int) -> npt.NDArray[np.float32]:
    """Return room for float32 that begins where a line of the cache does.

    Vectors of 64 bytes that lie across two lines cost the kernels up to three times as long.
    """
    size = math.prod(shape)
    room = np.empty(size + 16, dtype=np.float32)
    first = -room.ctypes.data % 64 // room.itemsize
    return room[first : first + size].reshape(shape)


def tiled(directions: npt.NDArray[np.float32]) -> Tiles:
    """Return the unit rays (H, W, 3) of a view, zero where a pixel has none, in tiles.

    Axes go through the mean ray; the spread has room for rounding.
    """
    rows, columns = -(-directions.shape[0] // TILE), -(-directions.shape[1] // TILE)
    padded = np.zeros((rows * TILE, columns * TILE, 3), dtype=np.float32)
    padded[: directions.shape[0], : directions.shape[1]] = directions
    blocks = padded.reshape(rows, TILE, columns, TILE, 3).transpose(0, 2, 4, 1, 3)
    rays = np.ascontiguousarray(blocks).reshape(rows * columns, 3, PIXELS)
    used = rays.any(axis=(1, 2))
    y, x = np.divmod(np.flatnonzero(used), columns)
    rays = rays[used]
    valid = np.any(rays != 0.0, axis=1)
    axes = rays.sum(axis=2, dtype=np.float64)
    axes /= np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-12)
    apart = np.linalg.norm(rays - axes[:, :, np.newaxis], axis=1)
    spreads = np.max(apart, axis=1, where=valid, initial=0.0) * 1.0001 + 1e-5
    return Tiles(
        rays,
        valid.astype(np.uint8),
        axes.astype(np.float32),
        spreads.astype(np.float32),
        np.stack((x, y), axis=1) * TILE,
    )


FAR: Final = 250
"""Largest distance kept: room above it, so that adding one never wraps around."""


def chessboard_distance(occupied: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return the chessboard distance [voxels] to the nearest occupied voxel, at most `FAR`.

    `occupied` is uint8 (nx, ny, nz) of 0 and 1; the answer is uint8 (nz, nx, ny), so that a map of
    one layer has its long axis innermost. A shortest chessboard path can be walked along y, then
    with a step in x each, then with a step in z each; so a sweep there and back per axis is exact.
    """
    field = np.empty((occupied.shape[2], occupied.shape[0], occupied.shape[1]), dtype=np.uint8)
    np.multiply(occupied.transpose(2, 0, 1) == 0, np.uint8(FAR), out=field)
    if field.size:
        for layer in field:
            _sweep_rows(layer)
        _sweep(np.moveaxis(field, 1, 0), (1,))
        _sweep(field, (0, 1))
    return field


def _sweep_rows(layer: npt.NDArray[np.uint8]) -> None:
    """Relax a layer (nx, ny) along y, forward and back."""
    is_short = layer.shape[1] + FAR <= np.iinfo(np.int16).max
    steps = np.arange(layer.shape[1], dtype=np.int16 if is_short else np.int32)
    forward = np.minimum.accumulate(layer - steps, axis=1) + steps
    backward = np.minimum.accumulate((layer + steps)[:, ::-1], axis=1)[:, ::-1] - steps
    layer[:] = np.minimum(forward, backward)


def _sweep(slices: npt.NDArray[np.uint8], axes: tuple[int, ...]) -> None:
    """Relax slices (K, M, N) from one to the next, forward and back.

    A step may also go to a neighbour along the `axes` of a slice.
    """
    count = len(slices)
    for k in range(1, count):
        _relax(slices[k], slices[k - 1], axes)
    for k in range(count - 2, -1, -1):
        _relax(slices[k], slices[k + 1], axes)


def _relax(
    here: npt.NDArray[np.uint8], beside: npt.NDArray[np.uint8], axes: tuple[int, ...]
) -> None:
    """Lower the distances of a slice to one step more than the least near it in another slice."""
    least = beside + np.uint8(1)
    for axis in axes:
        around = np.moveaxis(least, axis, 0)
        alone = around.copy()
        np.minimum(around[1:], alone[:-1], out=around[1:])
        np.minimum(around[:-1], alone[1:], out=around[:-1])
    np.minimum(here, least, out=here)


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
_STEP: Final = np.int32(1)
_INFINITE: Final = np.float32(np.inf)


@owning
def trace(
    field: npt.NDArray[np.uint8],
    origin: npt.NDArray[np.float32],
    ignored: int,
    directions: npt.NDArray[np.float32],
    which: npt.NDArray[np.int64],
    start_m: np.float32,
    limits_m: npt.NDArray[np.float32],
    hits_m: npt.NDArray[np.float32],
) -> None:
    """Write the first hit of some rays, from `start_m` on and below their limit [m], else inf.

    `field` is `chessboard_distance`; `origin` (3,) [voxels] is common to all rays; `directions`
    (3, N) [voxels/m] are unit vectors in metres, turned and scaled into the lattice; `which` (K,)
    are the rays to trace, and the hits (N,) of others stay. The voxel with flat index `ignored`
    (-1: none) counts as free: the one that the sensor itself stands in.
    """
    integers = np.empty(INTEGERS, dtype=np.int32)
    floats = np.empty(FLOATS, dtype=np.float32)
    flat = field.reshape(-1)
    for first in range(0, which.size, LANES):
        count = min(LANES, which.size - first)
        floats[_END:] = -_INFINITE
        for lane in range(count):
            ray = which[first + lane]
            floats[_DX + lane] = directions[0, ray]
            floats[_DY + lane] = directions[1, ray]
            floats[_DZ + lane] = directions[2, ray]
            floats[_END + lane] = limits_m[ray]
        _begin(field.shape, origin, start_m, integers, floats)
        while _leap(flat, field.shape, origin, ignored, integers, floats):
            pass
        for lane in range(count):
            hit = integers[_FREE + lane] == 0
            hits_m[which[first + lane]] = floats[_AT + lane] if hit else _INFINITE


@inlined
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
        x = min(max(np.int32(ox + t * dx), np.int32(0)), nx - np.int32(1))
        y = min(max(np.int32(oy + t * dy), np.int32(0)), ny - np.int32(1))
        z = min(max(np.int32(oz + t * dz), np.int32(0)), nz - np.int32(1))
        integers[_X + lane], integers[_Y + lane], integers[_Z + lane] = x, y, z
        integers[_SIGN_X + lane] = np.int32(0) if ix >= _ZERO else np.int32(-1)
        integers[_SIGN_Y + lane] = np.int32(0) if iy >= _ZERO else np.int32(-1)
        integers[_SIGN_Z + lane] = np.int32(0) if iz >= _ZERO else np.int32(-1)
        integers[_INDEX + lane] = (z * nx + x) * ny + y
        floats[_IX + lane], floats[_IY + lane], floats[_IZ + lane] = ix, iy, iz
        floats[_END + lane] = end if enters else -_INFINITE
        floats[_AT + lane] = at if enters else _INFINITE


@borrowing
def inverse(component: Any) -> Any:
    """Return 1 / component, float32 or float64, finite also for zero."""
    return _ONE / (component if abs(component) > _TINY else _TINY)


@inlined
def _leap(
    flat: npt.NDArray[np.uint8],
    shape: tuple[int, int, int],
    origin: npt.NDArray[np.float32],
    ignored: int,
    integers: npt.NDArray[np.int32],
    floats: npt.NDArray[np.float32],
) -> bool:
    """Advance every lane that still can by one leap; return whether any did.

    The axis along which a ray leaves its cube is set exactly; the others are floored and kept
    within the cube, so that each leap makes progress whatever the rounding, and within the lattice:
    just before an edge of it, rounding would take a ray out of the field's memory. All integers are
    made int32 again at once, as numba widens their sums to int64, which halves the vectors.
    """
    for lane in range(LANES):
        integers[_FREE + lane] = flat[np.uint32(integers[_INDEX + lane])]
    own, none = np.int32(ignored), np.int32(0)
    rows, columns = np.int32(shape[1]), np.int32(shape[2])
    last_x, last_y, last_z = np.int32(rows - 1), np.int32(columns - 1), np.int32(shape[0] - 1)
    ox, oy, oz = origin[0], origin[1], origin[2]
    moving = np.int32(0)
    for lane in range(LANES):
        x, y, z = integers[_X + lane], integers[_Y + lane], integers[_Z + lane]
        free = _STEP if integers[_INDEX + lane] == own else integers[_FREE + lane]
        integers[_FREE + lane] = free
        sx, sy, sz = integers[_SIGN_X + lane], integers[_SIGN_Y + lane], integers[_SIGN_Z + lane]
        next_x, next_y, next_z = (
            np.int32(x + ((free ^ sx) - sx)),
            np.int32(y + ((free ^ sy) - sy)),
            np.int32(z + ((free ^ sz) - sz)),
        )
        tx = (np.float32(np.int32(next_x - sx)) - ox) * floats[_IX + lane]
        ty = (np.float32(np.int32(next_y - sy)) - oy) * floats[_IY + lane]
        tz = (np.float32(np.int32(next_z - sz)) - oz) * floats[_IZ + lane]
        t = min(tz, ty)
        t = min(t, tx)
        go = (free != 0) & (t < floats[_END + lane])
        half = np.int32(free - 1)
        inner_x = np.int32(ox + t * floats[_DX + lane])
        inner_y = np.int32(oy + t * floats[_DY + lane])
        inner_z = np.int32(oz + t * floats[_DZ + lane])
        inner_x = min(max(inner_x, np.int32(x - half), none), np.int32(x + half), last_x)
        inner_y = min(max(inner_y, np.int32(y - half), none), np.int32(y + half), last_y)
        inner_z = min(max(inner_z, np.int32(z - half), none), np.int32(z + half), last_z)
        x = (next_x if tx <= t else inner_x) if go else x
        y = (next_y if ty <= t else inner_y) if go else y
        z = (next_z if tz <= t else inner_z) if go else z
        integers[_X + lane], integers[_Y + lane], integers[_Z + lane] = x, y, z
        integers[_INDEX + lane] = (z * rows + x) * columns + y
        floats[_AT + lane] = t if go else floats[_AT + lane]
        moving = np.int32(moving + go)
    return bool(moving > 0)


@borrowing
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
        x = int(np.floor(origin[0] + t * axis[0]))
        y = int(np.floor(origin[1] + t * axis[1]))
        z = int(np.floor(origin[2] + t * axis[2]))
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


@inlined
def _reach(
    origin: np.float32, axis: np.float32, spread: np.float32, voxel: int, free: int
) -> np.float32:
    """Return up to which distance [m] the bundle stays in its cube along one axis."""
    high, low = np.float32(voxel + free) - origin, origin - np.float32(voxel + 1 - free)
    up = high / (axis + spread) if axis + spread > _TINY else _INFINITE
    down = low / (spread - axis) if spread - axis > _TINY else _INFINITE
    return min(up, down)


@dataclass(frozen=True, eq=False)
class VoxelField:
    """A voxel map made ready for rays; `of` builds it once per map, and all share it.

    `distances` is uint8 (nz, nx, ny), read-only: the chessboard distance to the nearest occupied
    voxel. `map_from_lattice` has its origin at the low corner of voxel (0, 0, 0) and turns about z;
    `voxel_size_m` is the size along the lattice's x, y, z.
    """

    map_from_lattice: RigidTransform
    voxel_size_m: tuple[float, float, float]
    distances: npt.NDArray[np.uint8]

    def __post_init__(self) -> None:
        self.distances.flags.writeable = False

    @classmethod
    def of(cls, voxels: VoxelMap | None) -> "VoxelField":
        """Return the field of a map (None: of nothing): about 3 ns per voxel, the first time."""
        if voxels is None or not voxels.occupied.size:
            return cls.empty()
        field = _FIELDS.get(voxels)
        if field is None:
            distances = chessboard_distance(voxels.occupied)
            field = cls(voxels.map_from_lattice, voxels.voxel_size_m, distances)
            _FIELDS[voxels] = field
        return field

    @classmethod
    def empty(cls) -> "VoxelField":
        """Return the field of an environment in which no ray ever hits anything."""
        distances = np.full((1, 1, 1), FAR, dtype=np.uint8)
        return cls(RigidTransform.identity(), (1.0, 1.0, 1.0), distances)

    def lattice_rays(
        self, origin_m: npt.NDArray[np.float64]
    ) -> tuple[npt.NDArray[np.float32], int, npt.NDArray[np.float32]]:
        """Return what the kernels take for rays from one point (3,) of the map frame.

        These are the origin (3,) [voxels], the flat index of the voxel to ignore (-1: none), and
        the matrix (3, 3) from directions in the map frame to voxels per metre.
        """
        matrix, rounded = self._matrices
        apart_m = origin_m - self.map_from_lattice.translation_m
        origin = product(matrix, apart_m).astype(np.float32)
        return origin, self._occupied_at(origin), rounded

    @cached_property
    def voxels_per_m(self) -> npt.NDArray[np.float32]:
        """The reciprocals of the voxel's sizes, float32 (3,) [1/m]."""
        return (1.0 / np.array(self.voxel_size_m)).astype(np.float32)

    @cached_property
    def _matrices(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float32]]:
        lattice_from_map = np.ascontiguousarray(self.map_from_lattice.rotation_matrix().T)
        matrix = lattice_from_map / np.array(self.voxel_size_m)[:, np.newaxis]
        return matrix, matrix.astype(np.float32)

    def _occupied_at(self, origin: npt.NDArray[np.float32]) -> int:
        x, y, z = (math.floor(value) for value in origin.tolist())
        nz, nx, ny = self.distances.shape
        inside = 0 <= x < nx and 0 <= y < ny and 0 <= z < nz
        return (z * nx + x) * ny + y if inside and self.distances[z, x, y] == 0 else -1

    def first_hits(
        self,
        origin_m: npt.NDArray[np.float64],
        directions: npt.NDArray[np.floating],
        max_range_m: float,
    ) -> npt.NDArray[np.float32]:
        """Return the distance [m] to the first occupied voxel along each ray, inf beyond the range.

        `origin_m` (3,) and the unit `directions` (N, 3) are in the map frame; float32 (N,) comes
        back. The range is closed. A direction of zeros hits nothing. When the origin lies in an
        occupied voxel (maps are noisy), that one voxel is ignored.
        """
        origin, ignored, matrix = self.lattice_rays(origin_m)
        rays = np.ascontiguousarray(product(matrix, np.asarray(directions, dtype=np.float32).T))
        limit = np.nextafter(np.float32(max_range_m), np.float32(np.inf))
        limits = np.where(np.any(rays != 0.0, axis=0), limit, np.float32(-1.0))
        hits = np.empty(rays.shape[1], dtype=np.float32)
        which = np.arange(len(hits))
        trace(self.distances, origin, ignored, rays, which, np.float32(0.0), limits, hits)
        return hits


_FIELDS: Final = WeakKeyDictionary[VoxelMap, VoxelField]()
"""The fields of the maps that are in use."""
