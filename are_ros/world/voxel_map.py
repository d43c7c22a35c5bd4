"""M3D: the occupied voxels of the real place (section 3.1), dense, from a cloud or extruded.

Which lattice a cloud of voxel centres lies on, and which voxels each centre stands for.

octomap_server sends the centre of every occupied leaf. Leaves of the finest size lie on one
lattice; a pruned leaf, 2^k voxels wide, has its centre on a corner of that lattice. In the
octree's own frame the corners are integer multiples of the voxel size, and a leaf's centre is an
odd multiple of 2^(k-1) voxels on each axis: so the position tells the size. In a frame that is
shifted against the octree's only k = 0 and k >= 1 can be told apart, and k = 1 is assumed.

The few points that lie far from all others, or on no lattice, have no say in which lattice it is.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import InputError
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import (
    MAX_TILT_RAD,
    RigidTransform,
    in_level_frame,
    tilt_rad,
    yaw_only,
)

_FLOAT32_NOISE: Final = 8.0 * float(np.finfo(np.float32).eps)
_MIN_NOISE_M: Final = 1e-6
_MIN_SPACING_M: Final = 1e-3
_MAX_STEPS: Final = 64


def coordinate_noise_m(points_m: npt.NDArray[np.floating]) -> float:
    """Return how far coordinates of points (N, 3) may be off by having been float32."""
    return max(_MIN_NOISE_M, _FLOAT32_NOISE * float(np.abs(points_m).max()))


def common_spacing(points_m: npt.NDArray[np.floating]) -> float | None:
    """Return the largest spacing [m] of which all gaps of points (N, 3) are multiples, or None.

    The gaps are those between neighbouring distinct coordinates of one axis, pooled over the
    axes; coordinates carry the noise of float32. None if there is no gap at all, or if the gaps
    have no divisor of a millimetre that stands out of the noise (the points lie on no lattice).
    """
    noise = coordinate_noise_m(points_m)
    axes = [_distinct(points_m[:, axis], noise) for axis in range(3)]
    gaps = np.concatenate([np.diff(values) for values in axes])
    if not gaps.size:
        return None
    spacing = _approximate_divisor(_distinct(gaps, noise), noise)
    return None if spacing is None else _refined(spacing, axes, noise)


def usual_gap(points_m: npt.NDArray[np.floating]) -> float | None:
    """Return the most frequent gap [m] between neighbouring distinct coordinates, or None.

    The least of several that are equally frequent; None where there is no gap at all.
    """
    noise = coordinate_noise_m(points_m)
    gaps = np.concatenate([np.diff(_distinct(points_m[:, axis], noise)) for axis in range(3)])
    if not gaps.size:
        return None
    gaps.sort()
    group = np.concatenate(([0], np.cumsum(np.diff(gaps) > noise)))
    counts = np.bincount(group)
    most = int(counts.argmax())
    return float(gaps[group == most].mean())


def _distinct(values: npt.NDArray[np.floating], noise: float) -> npt.NDArray[np.float64]:
    """Return the sorted means of values that lie within a chain of steps of at most noise."""
    unique = np.unique(values).astype(np.float64)
    group = np.concatenate(([0], np.cumsum(np.diff(unique) > noise)))
    sums = np.bincount(group, weights=unique)
    return np.asarray(sums / np.bincount(group), dtype=np.float64)


def _approximate_divisor(gaps: npt.NDArray[np.float64], noise: float) -> float | None:
    """Return Euclid's divisor of sorted gaps, where remainders within noise count as none."""
    divisor = float(gaps[0])
    for _ in range(_MAX_STEPS):
        counts = np.round(gaps / divisor)
        remainders = np.abs(gaps - counts * divisor)
        wrong = remainders > 2.0 * noise * (counts + 1.0)
        if not wrong.any():
            return divisor
        divisor = float(remainders[wrong].min())
        if divisor < max(_MIN_SPACING_M, 8.0 * noise):
            return None
    return None


def _refined(spacing: float, axes: list[npt.NDArray[np.float64]], noise: float) -> float:
    """Return the spacing averaged over the extents, rounded to a micrometre if that fits."""
    extent, steps = 0.0, 0.0
    for values in axes:
        extent += float(values[-1] - values[0])
        steps += float(np.round(np.diff(values) / spacing).sum())
    refined = extent / steps
    rounded = round(refined, 6)
    return rounded if abs(rounded - refined) * steps <= 3.0 * noise else refined


_MIN_CONCENTRATION: Final = 0.9
_MIN_SHARE: Final = 0.99
_ALIGNED: Final = 1e-3
_FEWEST_TO_JUDGE: Final = 16
_MAX_LEVEL: Final = 16
_MAX_INFERRED_M: Final = 10.0
_MIN_INFERRED_M: Final = 1e-3
_FAR: Final = 8.0
"""As many times farther from the middle than nine tenths of the points are: a stray point."""
_SAME: Final = 1e-3
"""Sizes that differ by less than this part are one."""


@dataclass(frozen=True, eq=False)
class VoxelLattice:
    """Voxels of `size_m`, one corner of which lies at `phase_m` (3,) in the cloud's frame.

    `has_leaves`: some centres lie on corners and stand for coarser leaves; `is_octree`: their
    size follows from where they lie.
    """

    size_m: float
    phase_m: npt.NDArray[np.float64]
    has_leaves: bool = False
    is_octree: bool = False


def lattice_of(
    points_m: npt.NDArray[np.floating],
    size_m: float | None,
    source: str,
    wanted_m: float | None,
) -> VoxelLattice:
    """Return the lattice of centres (N, 3), its size given or inferred.

    Points that lie on no lattice of a given size are binned, with corners at its multiples. Voxels
    are `wanted_m` wide in the end: where the size can neither be given nor inferred, that is the
    lattice's. Raises InputError if a size is no positive length, cannot be inferred, or is larger
    than what is wanted.
    """
    for length_m in (size_m, wanted_m):
        if length_m is not None and not (np.isfinite(length_m) and length_m > 0.0):
            message = f"{source}: world.voxel_size is {length_m}, it must be a positive length"
            raise InputError(message)
    bulk_m = without_far_points(points_m)
    if size_m is not None:
        lattice = _given(bulk_m, size_m)
    elif wanted_m is None:
        lattice = _inferred(bulk_m, source)
    else:
        lattice = _inferred_or_wanted(bulk_m, source, wanted_m)
    if wanted_m is not None and wanted_m < (1.0 - _SAME) * lattice.size_m:
        message = (
            f"{source}: its voxels are {lattice.size_m:g} m wide, finer ones of world.voxel_size,"
            f" {wanted_m:g} m, cannot be made of them; set that to 0 or to a multiple"
        )
        raise InputError(message)
    return lattice


def without_far_points(points_m: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """Return the points (M, 3) without those that lie far from nearly all others."""
    if len(points_m) < _FEWEST_TO_JUDGE:
        return points_m
    middle_m = np.median(points_m, axis=0)
    away_m = np.abs(points_m - middle_m).max(axis=1)
    reach_m = _FAR * float(np.quantile(away_m, 0.9))
    is_near = away_m <= reach_m
    return points_m if reach_m == 0.0 or is_near.all() else points_m[is_near]


def times_wider(lattice: VoxelLattice, size_m: float) -> float:
    """Return how many voxels of a lattice one of `size_m` is wide; whole where that is meant."""
    times = size_m / lattice.size_m
    return float(round(times)) if abs(times - round(times)) <= _SAME * times else times


def _given(points_m: npt.NDArray[np.floating], size_m: float) -> VoxelLattice:
    return _fitted(points_m, float(size_m)) or VoxelLattice(float(size_m), np.zeros(3))


def _inferred_or_wanted(
    points_m: npt.NDArray[np.floating], source: str, wanted_m: float
) -> VoxelLattice:
    """Return the cloud's own lattice; one of the size wanted where it shows none.

    A few points lie on many lattices: there a finer one that is wanted may be theirs.
    """
    try:
        own = _inferred(points_m, source)
    except InputError:
        return _given(points_m, wanted_m)
    is_doubtful = len(points_m) < _FEWEST_TO_JUDGE and own.size_m > wanted_m
    return _given(points_m, wanted_m) if is_doubtful else own


def _spacing(points_m: npt.NDArray[np.floating]) -> float | None:
    """Return the spacing of nearly all points: those on no lattice with the others do not count."""
    spacing, usual_m = common_spacing(points_m), usual_gap(points_m)
    if usual_m is None:
        return spacing
    half = 0.5 * usual_m
    phase, _ = _phase(points_m, half)
    aside = np.abs(np.mod(points_m - phase + 0.5 * half, half) - 0.5 * half)
    is_on = (aside <= max(_ALIGNED * half, 2.0 * coordinate_noise_m(points_m))).all(axis=1)
    if is_on.all() or np.count_nonzero(is_on) < _MIN_SHARE * len(points_m):
        return spacing
    return common_spacing(points_m[is_on])


def _inferred(points_m: npt.NDArray[np.floating], source: str) -> VoxelLattice:
    spacing = _spacing(points_m)
    if spacing is None:
        message = (
            f"{source}: the voxel size cannot be inferred from {len(points_m)} points that show"
            f" no common spacing; set world.voxel_size"
        )
        raise InputError(message)
    if spacing > _MAX_INFERRED_M:  # one wild point drowns the lattice of all others
        farthest_m = float(np.abs(points_m).max())
        message = (
            f"{source}: a point lies {farthest_m:g} m from the origin, which would make voxels of"
            f" {spacing:g} m; crop the cloud or set world.voxel_size"
        )
        raise InputError(message)
    if spacing < _MIN_INFERRED_M:  # as of centres that were turned into another frame
        message = (
            f"{source}: its {len(points_m)} points lie on no grid along the axes of their frame;"
            " set world.voxel_size to the width of their voxels, or send them in their own frame"
        )
        raise InputError(message)
    with_leaves = _fitted(points_m, 2.0 * spacing)
    if (
        with_leaves is not None
        and with_leaves.has_leaves
        and (with_leaves.is_octree or len(points_m) >= _FEWEST_TO_JUDGE)
    ):
        return with_leaves
    return _fitted(points_m, spacing) or VoxelLattice(spacing, np.zeros(3))


def _fitted(points_m: npt.NDArray[np.floating], size_m: float) -> VoxelLattice | None:
    """Return the lattice of this size whose centres or corners the points are, or None."""
    half = 0.5 * size_m
    phase, concentration = _phase(points_m, half)
    if concentration.min() < _MIN_CONCENTRATION:
        return None
    tolerance = max(_ALIGNED * half, coordinate_noise_m(points_m))
    aligned = bool((np.minimum(phase, half - phase) <= tolerance).all())
    phase = np.zeros(3) if aligned else phase
    counts, odd_leaves = _parities(points_m, half, phase)
    pairs = counts + counts[::-1]
    pair = int(pairs.argmax())
    if pairs[pair] < _MIN_SHARE * len(points_m):
        return None
    is_octree = aligned and counts[7] > 0 and pair in {0, 7}
    is_octree = is_octree and odd_leaves <= (1.0 - _MIN_SHARE) * counts[0]
    fine = 7 if is_octree else max(pair, 7 - pair, key=lambda parity: int(counts[parity]))
    odd = np.array([fine >> 2 & 1, fine >> 1 & 1, fine & 1])
    corner = np.mod(phase + half * (odd - 1), size_m)
    return VoxelLattice(size_m, corner, bool(counts[7 - fine] > 0), is_octree)


def _phase(
    points_m: npt.NDArray[np.floating], period: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the circular mean (3,) of the coordinates in [0, period), and its length (0..1)."""
    turns = 2.0j * np.pi / period * points_m.astype(np.float64)
    mean = np.exp(turns).mean(axis=0)
    return period * np.mod(np.angle(mean) / (2.0 * np.pi), 1.0), np.abs(mean)


def _whole(numbers: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """Return whole numbers as integers; what no integer can hold is refused later, by its size."""
    with np.errstate(invalid="ignore"):
        return numbers.astype(np.int64)


def _valuations(numbers: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return how often 2 divides each number, at most _MAX_LEVEL (so also for 0)."""
    powers = np.array(1 << np.arange(_MAX_LEVEL), np.int64)
    lowest_bits = (numbers | powers[-1] << 1) & -(numbers | powers[-1] << 1)
    valuations: npt.NDArray[np.int64] = np.searchsorted(powers, lowest_bits)
    return valuations


def _parities(
    points: npt.NDArray[np.floating], half: float, phase: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.int64], int]:
    """Return how many points have each parity (x, y, z as bits 2, 1, 0) in half voxels, (8,).

    And how many of the all-even ones have unequal powers of two on their axes.
    """
    steps = _whole(np.rint((points - phase) / half))
    parities = (steps & 1) @ np.array([4, 2, 1])
    levels = _valuations(steps[parities == 0])
    unequal = (levels != levels[:, :1]).any(axis=1)
    return np.bincount(parities, minlength=8), int(np.count_nonzero(unequal))


def _leaves(
    points_m: npt.NDArray[np.floating], lattice: VoxelLattice, share: float
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return low and exclusive high voxel index (N, 3) of the leaves with centres (N, 3).

    Voxels of the lattice are a `share` as wide as those of the indices.
    """
    centres = (points_m - lattice.phase_m) / lattice.size_m
    low = _whole(np.floor(centres))
    last = low.copy()
    if lattice.has_leaves:
        halves = _whole(np.rint(2.0 * centres))
        coarse = np.flatnonzero((np.bitwise_or.reduce(halves, axis=1) & 1) == 0)
        corners = halves[coarse]
        level = _valuations(corners).min(axis=1) if lattice.is_octree else np.ones_like(coarse)
        reach = np.left_shift(1, level - 1)[:, None]
        low[coarse] = (corners >> 1) - reach
        last[coarse] = low[coarse] + 2 * reach - 1
    return _whole(np.floor((low + 0.5) * share)), _whole(np.floor((last + 0.5) * share)) + 1


def _fill(
    low: npt.NDArray[np.int64], high: npt.NDArray[np.int64], occupied: npt.NDArray[np.uint8]
) -> None:
    """Set the voxels of boxes (N, 3), from low to exclusive high index, to 1."""
    is_single = (high - low == 1).all(axis=1)
    occupied[tuple(low[is_single].T)] = 1
    boxes = np.column_stack((low, high))[~is_single].tolist()
    for i, j, k, i_end, j_end, k_end in boxes:
        occupied[i:i_end, j:j_end, k:k_end] = 1


MAX_VOXELS: Final = 2**30
"""Bound of the dense array: one byte each, so 1 GiB."""

_MAX_REACH: Final = 2**40
_STRIDE: Final = 1.02
"""By at most this factor more than needed is the size that is proposed for too large a box."""


@dataclass(frozen=True, eq=False)
class VoxelMap:
    """Voxels on a lattice that may be turned about z in the map frame.

    `map_from_lattice` has its origin at the low corner of voxel (0, 0, 0) and yaw only;
    `voxel_size_m` is the size along the lattice's x, y, z; `occupied` is uint8 (nx, ny, nz) of
    0 and 1, C order, read-only. Where a cloud's voxels were made coarser, `cloud_voxel_m` is their
    own size. Raises InputError if the lattice is tilted.
    """

    map_from_lattice: RigidTransform
    voxel_size_m: tuple[float, float, float]
    occupied: npt.NDArray[np.uint8]
    is_extruded: bool = False
    cloud_voxel_m: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "map_from_lattice", _without_tilt(self.map_from_lattice))
        occupied = np.ascontiguousarray(self.occupied, dtype=np.uint8).view()
        occupied.flags.writeable = False
        object.__setattr__(self, "occupied", occupied)

    @classmethod
    def from_centres(
        cls,
        points_m: npt.NDArray[np.floating],
        voxel_size_m: float | None,
        map_from_cloud: RigidTransform,
        source: str = "voxel cloud",
        wanted_m: float | None = None,
    ) -> "VoxelMap":
        """Return the map of voxel centres (N, 3) in the cloud's frame, as octomap_server sends.

        Points that are not finite are dropped. Without the cloud's own size, it is inferred from
        the centres; the lattice's phase always is. A centre between voxels is a coarser leaf of the
        octree, and is expanded (see the module). The map has voxels of `wanted_m`, if that is
        given: each one is occupied in which the middle of an occupied voxel of the cloud lies.
        `source` begins every sentence. Raises InputError if no point is left, the size cannot be
        inferred or is larger than the one wanted, the transform tilts, or the box around the voxels
        would hold more than `MAX_VOXELS`.
        """
        points = _finite_points(source, points_m)
        lattice = lattice_of(points, voxel_size_m, source, wanted_m)
        times = 1.0 if wanted_m is None else times_wider(lattice, wanted_m)
        size = times * lattice.size_m
        _check_reach(source, points, lattice.size_m)
        low, high = _leaves(points, lattice, 1.0 / times)
        first = low.min(axis=0)
        extent = high.max(axis=0) - first
        _check_count(source, extent, points, lattice, times)
        occupied = np.zeros(extent, dtype=np.uint8)
        _fill(low - first, high - first, occupied)
        corner_m = lattice.phase_m + first * size
        shift = RigidTransform(corner_m, np.array([0.0, 0.0, 0.0, 1.0]))
        map_from_lattice = _without_tilt(map_from_cloud) @ shift
        cloud_voxel_m = None if times == 1.0 else lattice.size_m
        return cls(map_from_lattice, (size, size, size), occupied, False, cloud_voxel_m)

    @classmethod
    def extruded(
        cls,
        grid: OccupancyGrid,
        occupied_mask: npt.NDArray[np.bool_],
        wall_height_m: float,
        ground_m: float,
    ) -> "VoxelMap":
        """Return walls over the cells of `occupied_mask` (height, width), one tall voxel each.

        They reach from `ground_m` to `ground_m + wall_height_m`; voxel (i, j, 0) stands on cell
        (row j, col i), also on a rotated grid. Raises InputError unless the height is positive
        and the mask has the grid's shape.
        """
        if not (math.isfinite(wall_height_m) and wall_height_m > 0.0 and math.isfinite(ground_m)):
            message = f"walls of {wall_height_m} m from {ground_m} m up cannot be extruded"
            raise InputError(message)
        if occupied_mask.shape != grid.cells.shape:
            message = f"the mask is {occupied_mask.shape}, the grid {grid.cells.shape}"
            raise InputError(message)
        x, y, _ = grid.origin.translation_m
        corner = np.array([x, y, ground_m])
        size = (grid.resolution_m, grid.resolution_m, float(wall_height_m))
        layer = np.ascontiguousarray(occupied_mask.T).astype(np.uint8)[:, :, np.newaxis]
        return cls(RigidTransform(corner, grid.origin.rotation_xyzw), size, layer, True)

    @property
    def occupied_count(self) -> int:
        """Number of occupied voxels."""
        return int(np.count_nonzero(self.occupied))

    def centres_m(self) -> npt.NDArray[np.float64]:
        """Return the centres (N, 3) of the occupied voxels in the map frame, in C order.

        Of an extruded map these are the centres of its tall voxels, half a wall up.
        """
        voxels = np.argwhere(self.occupied)
        return self.map_from_lattice.apply((voxels + 0.5) * np.array(self.voxel_size_m))

    def bounds_m(self) -> npt.NDArray[np.float64]:
        """Return low and high corner (2, 3), in the map frame, of the box around the lattice."""
        size = np.array(self.voxel_size_m) * self.occupied.shape
        corners = self.map_from_lattice.apply(np.argwhere(np.ones((2, 2, 2))) * size)
        return np.stack((corners.min(axis=0), corners.max(axis=0)))

    def are_occupied(self, points_m: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Say of finite points (N, 3) of the map frame whether they are in an occupied voxel."""
        voxels = self.points_to_voxels(points_m)
        inside = np.flatnonzero(((voxels >= 0) & (voxels < self.occupied.shape)).all(axis=1))
        found = np.zeros(len(voxels), dtype=np.bool_)
        found[inside] = self.occupied[tuple(voxels[inside].T)] == 1
        return found

    def points_to_voxels(self, points_m: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Return the voxels (N, 3) that hold finite points (N, 3) of the map frame.

        A voxel holds its low faces, not its high ones; it may lie outside the array.
        """
        points = np.asarray(points_m, dtype=np.float64)
        along_x, along_y = in_level_frame(self.map_from_lattice, points)
        up = points[:, 2] - self.map_from_lattice.translation_m[2]
        local = np.column_stack((along_x, along_y, up))
        voxels: npt.NDArray[np.int64]
        voxels = np.floor(local / np.array(self.voxel_size_m)).astype(np.int64)
        return voxels


def _finite_points(
    source: str, points_m: npt.NDArray[np.floating]
) -> npt.NDArray[np.float32] | npt.NDArray[np.float64]:
    points = np.asarray(points_m)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{source}: points have the shape {points.shape}, not (N, 3)")
    points = points.astype(np.float64 if points.dtype.itemsize > 4 else np.float32, copy=False)
    finite = np.isfinite(points[:, 0]) & np.isfinite(points[:, 1]) & np.isfinite(points[:, 2])
    kept = points if finite.all() else points[finite]
    if not len(points):
        raise InputError(f"{source}: there is no occupied voxel in it")
    if not len(kept):
        raise InputError(f"{source}: no finite point among {len(points)}")
    return np.ascontiguousarray(kept)


def _check_reach(source: str, points_m: npt.NDArray[np.floating], size_m: float) -> None:
    """Refuse points so far out that their voxels' indices would overflow."""
    farthest_m = float(np.abs(points_m).max())
    if farthest_m > _MAX_REACH * size_m:
        message = (
            f"{source}: a point lies {farthest_m:g} m from the origin, the voxels are {size_m:g} m"
        )
        raise InputError(message)


def _check_count(
    source: str,
    extent: npt.NDArray[np.int64],
    points_m: npt.NDArray[np.floating],
    lattice: VoxelLattice,
    times: float,
) -> None:
    """Refuse a box of too many voxels; say which size would do, or which points stray."""
    if math.prod(extent.tolist()) <= MAX_VOXELS:
        return
    box = " x ".join(str(n) for n in extent.tolist())
    said = f"{source}: {box} voxels of {times * lattice.size_m:g} m are more than {MAX_VOXELS}"
    wider = times
    while math.prod((np.ceil(extent * times / wider) + 1).astype(int).tolist()) > MAX_VOXELS:
        wider = float(max(math.floor(wider) + 1, math.floor(wider * _STRIDE)))
    said += f"; set world.voxel_size to {wider * lattice.size_m:g} m, or crop the cloud"
    if strays := len(points_m) - len(without_far_points(points_m)):
        away_m = np.abs(points_m - np.median(points_m, axis=0)).max(axis=1)
        x, y, z = points_m[away_m.argmax()].tolist()
        said += (
            f": {strays} of {len(points_m)} lie far from the others, one at ({x:g}, {y:g}, {z:g})"
        )
    raise InputError(said)


def _without_tilt(transform: RigidTransform) -> RigidTransform:
    tilt = tilt_rad(transform.rotation_xyzw)
    if tilt > MAX_TILT_RAD:
        message = f"voxels: the lattice tilts by {tilt:.4f} rad; only a rotation about z will do"
        raise InputError(message)
    return RigidTransform(transform.translation_m, yaw_only(transform.rotation_xyzw))
