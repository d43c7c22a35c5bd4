"""First hits of rays on the voxels of M3D (equation 2)."""

import math
from dataclasses import dataclass
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from are_ros.builder._distance_field import FAR, chessboard_distance
from are_ros.builder._ray_leaps import trace
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap


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
        lattice_from_map = np.ascontiguousarray(self.map_from_lattice.rotation_matrix().T)
        matrix = lattice_from_map / np.array(self.voxel_size_m)[:, np.newaxis]
        origin = (matrix @ (origin_m - self.map_from_lattice.translation_m)).astype(np.float32)
        return origin, self._occupied_at(origin), matrix.astype(np.float32)

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
        rays = np.ascontiguousarray(matrix @ np.asarray(directions, dtype=np.float32).T)
        limit = np.nextafter(np.float32(max_range_m), np.float32(np.inf))
        limits = np.where(np.any(rays != 0.0, axis=0), limit, np.float32(-1.0))
        hits = np.empty(rays.shape[1], dtype=np.float32)
        trace(self.distances, origin, ignored, rays, np.float32(0.0), limits, hits)
        return hits


_FIELDS: Final = WeakKeyDictionary[VoxelMap, VoxelField]()
"""The fields of the maps that are in use."""
