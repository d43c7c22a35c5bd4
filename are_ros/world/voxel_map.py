"""M3D: the occupied voxels of the real place (section 3.1), dense, from a cloud or extruded."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import InputError
from are_ros.world._planar import MAX_TILT_RAD, cosine_and_sine, tilt_rad, yaw_only
from are_ros.world._voxel_lattice import fill_voxels, lattice_of, leaf_bounds
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

MAX_VOXELS: Final = 2**30
"""Bound of the dense array: one byte each, so 1 GiB."""

_MAX_REACH: Final = 2**40


@dataclass(frozen=True, eq=False)
class VoxelMap:
    """Voxels on a lattice that may be turned about z in the map frame.

    `map_from_lattice` has its origin at the low corner of voxel (0, 0, 0) and yaw only;
    `voxel_size_m` is the size along the lattice's x, y, z; `occupied` is uint8 (nx, ny, nz) of
    0 and 1, C order, read-only. Raises InputError if the lattice is tilted.
    """

    map_from_lattice: RigidTransform
    voxel_size_m: tuple[float, float, float]
    occupied: npt.NDArray[np.uint8]
    is_extruded: bool = False

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
    ) -> "VoxelMap":
        """Return the map of voxel centres (N, 3) in the cloud's frame, as octomap_server sends.

        Points that are not finite are dropped. Without a size, the size is inferred from the
        centres; the lattice's phase always is. A centre between voxels is a coarser leaf of the
        octree, and is expanded (see `_voxel_lattice`). `source` begins every sentence. Raises
        InputError if no point is left, the size cannot be inferred, the transform tilts, or the
        box around the voxels would hold more than `MAX_VOXELS`.
        """
        points = _finite_points(source, points_m)
        lattice = lattice_of(points, voxel_size_m, source)
        _check_reach(source, points, lattice.size_m)
        low, high = leaf_bounds(points, lattice)
        shape = _checked_shape(source, high - low, lattice.size_m)
        occupied = np.zeros(shape, dtype=np.uint8)
        fill_voxels(points, lattice, low, occupied)
        size = lattice.size_m
        cloud_from_lattice = _shift(lattice.phase_m + low * size)
        return cls(_without_tilt(map_from_cloud) @ cloud_from_lattice, (size, size, size), occupied)

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


def _checked_shape(
    source: str, extent: npt.NDArray[np.int64], size_m: float
) -> tuple[int, int, int]:
    nx, ny, nz = (int(n) for n in extent)
    if nx * ny * nz > MAX_VOXELS:
        message = (
            f"{source}: {nx} x {ny} x {nz} voxels of {size_m:g} m are more than {MAX_VOXELS};"
            f" crop the cloud or set a larger world.voxel_size"
        )
        raise InputError(message)
    return nx, ny, nz


def _shift(translation_m: npt.NDArray[np.float64]) -> RigidTransform:
    return RigidTransform(translation_m, np.array([0.0, 0.0, 0.0, 1.0]))


def _without_tilt(transform: RigidTransform) -> RigidTransform:
    tilt = tilt_rad(transform.rotation_xyzw)
    if tilt > MAX_TILT_RAD:
        message = f"voxels: the lattice tilts by {tilt:.4f} rad; only a rotation about z will do"
        raise InputError(message)
    return RigidTransform(transform.translation_m, yaw_only(transform.rotation_xyzw))
