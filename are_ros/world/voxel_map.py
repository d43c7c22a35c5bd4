"""M3D: the occupied voxels of the real place (section 3.1), dense, from a cloud or extruded."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import InputError
from are_ros.world._planar import MAX_TILT_RAD, cosine_and_sine, tilt_rad, yaw_only
from are_ros.world._voxel_lattice import (
    VoxelLattice,
    fill_voxels,
    lattice_of,
    leaf_bounds,
    times_wider,
    without_far_points,
)
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

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
        octree, and is expanded (see `_voxel_lattice`). The map has voxels of `wanted_m`, if that is
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
        low, high = leaf_bounds(points, lattice, times)
        _check_count(source, high - low, points, lattice, times)
        occupied = np.zeros(high - low, dtype=np.uint8)
        fill_voxels(points, lattice, low, occupied, times)
        map_from_lattice = _without_tilt(map_from_cloud) @ _shift(lattice.phase_m + low * size)
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

    def points_to_voxels(self, points_m: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Return the voxels (N, 3) that hold finite points (N, 3) of the map frame.

        A voxel holds its low faces, not its high ones; it may lie outside the array.
        """
        offset = np.asarray(points_m, dtype=np.float64) - self.map_from_lattice.translation_m
        cosine, sine = cosine_and_sine(self.map_from_lattice.rotation_xyzw)
        along_x = offset[:, 0] * cosine + offset[:, 1] * sine
        along_y = offset[:, 1] * cosine - offset[:, 0] * sine
        local = np.column_stack((along_x, along_y, offset[:, 2]))
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


def _shift(translation_m: npt.NDArray[np.float64]) -> RigidTransform:
    return RigidTransform(translation_m, np.array([0.0, 0.0, 0.0, 1.0]))


def _without_tilt(transform: RigidTransform) -> RigidTransform:
    tilt = tilt_rad(transform.rotation_xyzw)
    if tilt > MAX_TILT_RAD:
        message = f"voxels: the lattice tilts by {tilt:.4f} rad; only a rotation about z will do"
        raise InputError(message)
    return RigidTransform(transform.translation_m, yaw_only(transform.rotation_xyzw))
