"""The height of the floor under a footprint: a plane, or found among the voxels of M3D."""

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.world._planar import cosine_and_sine
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap


@compiled
def surface_counts(occupied: npt.NDArray[np.uint8]) -> npt.NDArray[np.int64]:
    """Return how many columns of uint8 (nx, ny, nz) have a surface at k, int64 (nz + 1,)."""
    nx, ny, nz = occupied.shape
    counts = np.zeros(nz + 1, dtype=np.int64)
    for i in range(nx):
        for j in range(ny):
            column = occupied[i, j]
            for k in range(1, nz):
                counts[k] += column[k - 1] & (1 - column[k])
            counts[nz] += column[nz - 1]
    return counts


@compiled
def _nearest_surface(column: npt.NDArray[np.uint8], k: int, step: int) -> int:
    """Return the surface nearest to k within step, the lower of two; -1 if there is none."""
    nz = column.shape[0]
    for distance in range(step + 1):
        for sign in (-1, 1):
            at = k + sign * distance
            if 1 <= at <= nz and column[at - 1] == 1 and (at == nz or column[at] == 0):
                return at
    return -1


@compiled
def flood_floor(
    occupied: npt.NDArray[np.uint8], level: int, step: int, unknown: int
) -> npt.NDArray[np.int32]:
    """Return the floor's surface index of each column, int32 (nx, ny), or `unknown`.

    Breadth first, from all columns with a surface within `step` of `level`, in C order.
    """
    nx, ny, _ = occupied.shape
    tops = np.full((nx, ny), unknown, dtype=np.int32)
    queue = np.empty((nx * ny, 2), dtype=np.int32)
    end = 0
    for i in range(nx):
        for j in range(ny):
            surface = _nearest_surface(occupied[i, j], level, step)
            if surface >= 0:
                tops[i, j] = surface
                queue[end, 0], queue[end, 1] = i, j
                end += 1
    start = 0
    while start < end:
        i, j = queue[start, 0], queue[start, 1]
        start += 1
        for di, dj in ((-1, 0), (0, -1), (0, 1), (1, 0)):
            a, b = i + di, j + dj
            if 0 <= a < nx and 0 <= b < ny and tops[a, b] == unknown:
                surface = _nearest_surface(occupied[a, b], tops[i, j], step)
                if surface >= 0:
                    tops[a, b] = surface
                    queue[end, 0], queue[end, 1] = a, b
                    end += 1
    return tops


@compiled
def fill_from_nearest(tops: npt.NDArray[np.int32], unknown: int) -> None:
    """Give each unknown column the value of a nearest known one (4-neighbour steps), in place.

    Of several equally near, the one that the breadth-first search in C order meets first.
    """
    nx, ny = tops.shape
    queue = np.empty((nx * ny, 2), dtype=np.int32)
    end = 0
    for i in range(nx):
        for j in range(ny):
            if tops[i, j] != unknown:
                queue[end, 0], queue[end, 1] = i, j
                end += 1
    start = 0
    while start < end:
        i, j = queue[start, 0], queue[start, 1]
        start += 1
        for di, dj in ((-1, 0), (0, -1), (0, 1), (1, 0)):
            a, b = i + di, j + dj
            if 0 <= a < nx and 0 <= b < ny and tops[a, b] == unknown:
                tops[a, b] = tops[i, j]
                queue[end, 0], queue[end, 1] = a, b
                end += 1


_WINDOW_M: Final = 0.4
_MAX_SLOPE: Final = 0.3
_UNKNOWN: Final = np.int32(-(2**31))


class Ground(Protocol):
    """What tells the height of the floor, z in the map frame [m]."""

    def lowest_m(self) -> float:
        """Return the least height that there is."""
        ...

    def heights(self, points_m: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        """Return the floor's height (N,) at each of the finite points (N, 2) of the map frame."""
        ...


@dataclass(frozen=True)
class PlaneGround:
    """A level floor at `height_m`."""

    height_m: float = 0.0

    def lowest_m(self) -> float:
        """Return the plane's height."""
        return self.height_m

    def heights(self, points_m: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        """Return the plane's height (N,) for points (N, 2)."""
        return np.full(len(points_m), self.height_m)


@dataclass(frozen=True, eq=False)
class VoxelGround:
    """The floor found in each column of a voxel map.

    A surface of a column is the top of a run of occupied voxels: of a floor, a table, a wall, a
    ceiling. The floor is the set of surfaces that can be walked over from the main level:

    1. The main level is the height at which most columns have a surface, within `search_m` of
       `plane_height_m` (the lower one of equals). Nothing there: the plane is the floor.
    2. Columns with a surface within a step of the main level start; from column to
       4-neighbour, the surface nearest to the neighbour's floor is taken, if it is at most a
       step (`step_m`, at least one voxel) up or down. So ramps are followed, and tables,
       walls, boxes and ceilings are not.
    3. A floor higher than a step plus a slope of 0.3 above the lowest within 0.4 m is none
       (a heap or a ragged wall that was climbed voxel by voxel).
    4. A column without a floor (wall, box, never seen) takes the nearest column's, in steps
       over the lattice; a point beside the lattice takes the nearest border column's.

    `heights_m` is float64 (nx, ny) in the map frame, `is_seen` bool (nx, ny) says where a floor
    was found; both read-only, columns as in the voxel map's lattice.
    """

    map_from_lattice: RigidTransform
    column_size_m: tuple[float, float]
    heights_m: npt.NDArray[np.float64]
    is_seen: npt.NDArray[np.bool_]

    def __post_init__(self) -> None:
        self.heights_m.flags.writeable = False
        self.is_seen.flags.writeable = False

    @classmethod
    def from_voxels(
        cls,
        voxels: VoxelMap,
        plane_height_m: float = 0.0,
        step_m: float = 0.05,
        search_m: float = 0.5,
    ) -> "VoxelGround":
        """Return the floor of a voxel map by the rule above; an extruded map has only the plane."""
        size_x, size_y, size_z = voxels.voxel_size_m
        base_m = float(voxels.map_from_lattice.translation_m[2])
        heights_m = np.full(voxels.occupied.shape[:2], float(plane_height_m))
        seen = np.zeros(heights_m.shape, dtype=np.bool_)
        level = None if voxels.is_extruded else _main_level(voxels, plane_height_m, search_m)
        if level is not None:
            step = max(1, int(step_m / size_z + 1e-6))
            tops = flood_floor(voxels.occupied, level, step, int(_UNKNOWN))
            seen = _gentle(tops, (size_x, size_y, size_z), step)
            tops[~seen] = _UNKNOWN
            fill_from_nearest(tops, int(_UNKNOWN))
            heights_m = base_m + tops * size_z
        return cls(voxels.map_from_lattice, (size_x, size_y), heights_m, seen)

    def lowest_m(self) -> float:
        """Return the least height of a column."""
        return float(self.heights_m.min())

    def heights(self, points_m: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        """Return the floor's height (N,) at each of the finite points (N, 2) of the map frame."""
        x, y = (np.asarray(points_m, dtype=np.float64) - self.map_from_lattice.translation_m[:2]).T
        cosine, sine = cosine_and_sine(self.map_from_lattice.rotation_xyzw)
        nx, ny = self.heights_m.shape
        i = np.clip(np.floor((x * cosine + y * sine) / self.column_size_m[0]), 0, nx - 1)
        j = np.clip(np.floor((y * cosine - x * sine) / self.column_size_m[1]), 0, ny - 1)
        heights: npt.NDArray[np.float64] = self.heights_m[i.astype(np.int64), j.astype(np.int64)]
        return heights


def _main_level(voxels: VoxelMap, plane_height_m: float, search_m: float) -> int | None:
    """Return the surface index k (its height is k voxels above the lattice) of the main level."""
    counts = surface_counts(voxels.occupied)
    base_m = float(voxels.map_from_lattice.translation_m[2])
    heights_m = base_m + np.arange(len(counts)) * voxels.voxel_size_m[2]
    counts[np.abs(heights_m - plane_height_m) > search_m] = 0
    level = int(counts.argmax())
    return level if counts[level] > 0 else None


def _gentle(
    tops: npt.NDArray[np.int32], size_m: tuple[float, float, float], step: int
) -> npt.NDArray[np.bool_]:
    """Return which known tops are no higher than step and slope allow above those around."""
    from scipy.ndimage import minimum_filter1d

    known = tops != _UNKNOWN
    lowest = np.where(known, tops, np.iinfo(np.int32).max)
    for axis in range(2):
        width = 2 * round(_WINDOW_M / size_m[axis]) + 1
        lowest = minimum_filter1d(lowest, width, axis=axis, mode="nearest")
    allowed = step + int(_MAX_SLOPE * _WINDOW_M / size_m[2])
    gentle: npt.NDArray[np.bool_] = known & (tops - allowed <= lowest)
    return gentle
