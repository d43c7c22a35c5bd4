"""Which lattice a cloud of voxel centres lies on, and which voxels each centre stands for.

octomap_server sends the centre of every occupied leaf. Leaves of the finest size lie on one
lattice; a pruned leaf, 2^k voxels wide, has its centre on a corner of that lattice. In the
octree's own frame the corners are integer multiples of the voxel size, and a leaf's centre is an
odd multiple of 2^(k-1) voxels on each axis: so the position tells the size. In a frame that is
shifted against the octree's only k = 0 and k >= 1 can be told apart, and k = 1 is assumed.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.errors import InputError
from are_ros.world._spacing import common_spacing, coordinate_noise_m

_MIN_CONCENTRATION: Final = 0.9
_MIN_SHARE: Final = 0.99
_ALIGNED: Final = 1e-3
_FEWEST_TO_JUDGE: Final = 16
_MAX_LEVEL: Final = 16
_MAX_INFERRED_M: Final = 10.0


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
    points_m: npt.NDArray[np.floating], size_m: float | None, source: str
) -> VoxelLattice:
    """Return the lattice of centres (N, 3), its size given or inferred.

    Points that lie on no lattice of a given size are binned, with corners at its multiples.
    Raises InputError if the size is no positive length or cannot be inferred.
    """
    if size_m is None:
        return _inferred(points_m, source)
    if not (np.isfinite(size_m) and size_m > 0.0):
        raise InputError(f"{source}: world.voxel_size is {size_m}, it must be a positive length")
    fitted = _fitted(points_m, float(size_m))
    return fitted if fitted is not None else VoxelLattice(float(size_m), np.zeros(3))


def leaf_bounds(
    points_m: npt.NDArray[np.floating], lattice: VoxelLattice
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return low and exclusive high voxel index (3,) of all that the centres (N, 3) stand for."""
    low, high = _leaf_bounds(points_m, lattice.size_m, lattice.phase_m, *_flags(lattice))
    return low, high


def fill_voxels(
    points_m: npt.NDArray[np.floating],
    lattice: VoxelLattice,
    low: npt.NDArray[np.int64],
    occupied: npt.NDArray[np.uint8],
) -> None:
    """Set to 1, in an array whose voxel (0, 0, 0) has index `low`, what the centres stand for."""
    _fill(points_m, lattice.size_m, lattice.phase_m, *_flags(lattice), low, occupied)


def _flags(lattice: VoxelLattice) -> tuple[bool, bool]:
    return lattice.has_leaves, lattice.is_octree


def _inferred(points_m: npt.NDArray[np.floating], source: str) -> VoxelLattice:
    spacing = common_spacing(points_m)
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


@compiled
def _phase(
    points: npt.NDArray[np.floating], period: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the circular mean (3,) of the coordinates in [0, period), and its length (0..1)."""
    phase = np.empty(3)
    concentration = np.empty(3)
    for axis in range(3):
        real, imaginary = 0.0, 0.0
        for i in range(points.shape[0]):
            turns = points[i, axis] / period
            angle = 2.0 * np.pi * (turns - np.floor(turns))
            real += np.cos(angle)
            imaginary += np.sin(angle)
        concentration[axis] = np.hypot(real, imaginary) / points.shape[0]
        fraction = np.arctan2(imaginary, real) / (2.0 * np.pi)
        phase[axis] = period * (fraction - np.floor(fraction))
    return phase, concentration


@compiled
def _valuation(n: int) -> int:
    """Return how often 2 divides n, at most _MAX_LEVEL (so also for 0)."""
    level = 0
    while level < _MAX_LEVEL and n & 1 == 0:
        n >>= 1
        level += 1
    return level


@compiled
def _parities(
    points: npt.NDArray[np.floating], half: float, phase: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.int64], int]:
    """Return how many points have each parity (x, y, z as bits 2, 1, 0) in half voxels, (8,).

    And how many of the all-even ones have unequal powers of two on their axes.
    """
    counts = np.zeros(8, dtype=np.int64)
    unequal = 0
    for i in range(points.shape[0]):
        x = np.int64(np.rint((points[i, 0] - phase[0]) / half))
        y = np.int64(np.rint((points[i, 1] - phase[1]) / half))
        z = np.int64(np.rint((points[i, 2] - phase[2]) / half))
        parity = ((x & 1) << 2) | ((y & 1) << 1) | (z & 1)
        counts[parity] += 1
        if parity == 0:
            level = _valuation(x)
            if _valuation(y) != level or _valuation(z) != level:
                unequal += 1
    return counts, unequal


@compiled
def _leaf(
    x: float, y: float, z: float, has_leaves: bool, is_octree: bool
) -> tuple[int, int, int, int]:
    """Return low voxel index and width of the leaf with its centre at (x, y, z) [voxels]."""
    if has_leaves:
        i, j, k = np.int64(np.rint(2.0 * x)), np.int64(np.rint(2.0 * y)), np.int64(np.rint(2.0 * z))
        if (i | j | k) & 1 == 0:
            level = 1
            if is_octree:
                level = min(_valuation(i), _valuation(j), _valuation(k))
            reach = 1 << (level - 1)
            return (i >> 1) - reach, (j >> 1) - reach, (k >> 1) - reach, 2 * reach
    return np.int64(np.floor(x)), np.int64(np.floor(y)), np.int64(np.floor(z)), 1


@compiled
def _leaf_bounds(
    points: npt.NDArray[np.floating],
    size: float,
    phase: npt.NDArray[np.float64],
    has_leaves: bool,
    is_octree: bool,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    low = np.full(3, 2**62, dtype=np.int64)
    high = np.full(3, -(2**62), dtype=np.int64)
    for p in range(points.shape[0]):
        x = (points[p, 0] - phase[0]) / size
        y = (points[p, 1] - phase[1]) / size
        z = (points[p, 2] - phase[2]) / size
        i, j, k, width = _leaf(x, y, z, has_leaves, is_octree)
        low[0], low[1], low[2] = min(low[0], i), min(low[1], j), min(low[2], k)
        high[0], high[1] = max(high[0], i + width), max(high[1], j + width)
        high[2] = max(high[2], k + width)
    return low, high


@compiled
def _fill(
    points: npt.NDArray[np.floating],
    size: float,
    phase: npt.NDArray[np.float64],
    has_leaves: bool,
    is_octree: bool,
    low: npt.NDArray[np.int64],
    occupied: npt.NDArray[np.uint8],
) -> None:
    for p in range(points.shape[0]):
        x = (points[p, 0] - phase[0]) / size
        y = (points[p, 1] - phase[1]) / size
        z = (points[p, 2] - phase[2]) / size
        i, j, k, width = _leaf(x, y, z, has_leaves, is_octree)
        i, j, k = i - low[0], j - low[1], k - low[2]
        occupied[i : i + width, j : j + width, k : k + width] = 1
