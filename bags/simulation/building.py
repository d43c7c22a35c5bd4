"""A made-up building: what it is made of, and the maps that a robot would have of it."""

import math
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from are_ros.conventions import FREE, OCCUPIED, UNKNOWN
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap
from bags.simulation.frames import MAP_FRAME

# The solid things that a building is made of: upright boxes and cylinders.


class Solid(Protocol):
    """An upright prism over an outline on the floor, from `bottom_m` up to `top_m`."""

    @property
    def bottom_m(self) -> float:
        """Height of the lower face above the floor."""

    @property
    def top_m(self) -> float:
        """Height of the upper face above the floor."""

    def covers(
        self, x_m: npt.NDArray[np.float64], y_m: npt.NDArray[np.float64], depth_m: float = 0.0
    ) -> npt.NDArray[np.bool_]:
        """Tell which points of the floor lie deeper than `depth_m` inside the outline.

        The arrays x and y broadcast.
        """


@dataclass(frozen=True)
class Cuboid:
    """A box about (x_m, y_m), `length_m` along its heading `yaw_rad` and `width_m` across."""

    x_m: float
    y_m: float
    length_m: float
    width_m: float
    top_m: float
    bottom_m: float = 0.0
    yaw_rad: float = 0.0

    @classmethod
    def between(
        cls,
        low_x_m: float,
        low_y_m: float,
        high_x_m: float,
        high_y_m: float,
        top_m: float,
        bottom_m: float = 0.0,
    ) -> "Cuboid":
        """Return the box over an axis-parallel rectangle."""
        centre = 0.5 * (low_x_m + high_x_m), 0.5 * (low_y_m + high_y_m)
        return cls(*centre, high_x_m - low_x_m, high_y_m - low_y_m, top_m, bottom_m)

    def covers(
        self, x_m: npt.NDArray[np.float64], y_m: npt.NDArray[np.float64], depth_m: float = 0.0
    ) -> npt.NDArray[np.bool_]:
        """Tell which points of the floor lie deeper than `depth_m` inside the outline.

        The arrays x and y broadcast.
        """
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        dx, dy = x_m - self.x_m, y_m - self.y_m
        along, across = dx * cosine + dy * sine, dy * cosine - dx * sine
        inside: npt.NDArray[np.bool_]
        inside = abs(along) < 0.5 * self.length_m - depth_m
        inside &= abs(across) < 0.5 * self.width_m - depth_m
        return inside


@dataclass(frozen=True)
class Cylinder:
    """An upright cylinder about (x_m, y_m)."""

    x_m: float
    y_m: float
    radius_m: float
    top_m: float
    bottom_m: float = 0.0

    def covers(
        self, x_m: npt.NDArray[np.float64], y_m: npt.NDArray[np.float64], depth_m: float = 0.0
    ) -> npt.NDArray[np.bool_]:
        """Tell which points of the floor lie deeper than `depth_m` inside the outline.

        The arrays x and y broadcast.
        """
        inside: npt.NDArray[np.bool_]
        inside = np.hypot(x_m - self.x_m, y_m - self.y_m) < self.radius_m - depth_m
        return inside


CELL_M: Final = 0.05
VOXEL_M: Final = 0.1
_CELLS_PER_VOXEL: Final = 2
_MARGIN_M: Final = 0.5
_HEADROOM_M: Final = 1.9
_SKIN_M: Final = 0.1


@dataclass(frozen=True)
class Building:
    """One storey in the map frame, its floor at height 0.

    `floor` is the outline, outer walls included; it is parallel to the axes and has its corners
    on multiples of `VOXEL_M`. There is no ceiling. Maps reach 0.5 m beyond the outline.
    """

    floor: Cuboid
    solids: tuple[Solid, ...]

    def grid(self, stamp_ns: int = 0) -> OccupancyGrid:
        """Return M2D as map_server gives it after mapping: cells of 0.05 m, unknown outside.

        Occupied is what stands in the way of a robot or a person, not the lintel of a door. What
        lies over 0.1 m deep in a solid was never seen, and is unknown.
        """
        cells = np.where(self._raster(self.floor), FREE, UNKNOWN).astype(np.int8)
        obstacles = [solid for solid in self.solids if solid.bottom_m < _HEADROOM_M]
        for solid in obstacles:
            cells[self._raster(solid, _SKIN_M)] = UNKNOWN
        for solid in obstacles:
            cells[self._raster(solid) & ~self._raster(solid, _SKIN_M)] = OCCUPIED
        return OccupancyGrid(cells, CELL_M, self._origin(), MAP_FRAME, stamp_ns)

    def slice_at(self, height_m: float) -> VoxelMap:
        """Return what meets the plane at a height above the floor, extruded: for a level laser."""
        occupied = np.zeros(self._shape(), dtype=np.bool_)
        for solid in self.solids:
            if solid.bottom_m <= height_m < solid.top_m:
                occupied |= self._raster(solid)
        highest_m = max(solid.top_m for solid in self.solids)
        return VoxelMap.extruded(self.grid(), occupied, highest_m, 0.0)

    def voxels(self) -> VoxelMap:
        """Return M3D: voxels of 0.1 m, the floor one voxel below height 0.

        A voxel is occupied if a solid, drawn in cells of 0.05 m, meets its column.
        """
        highest_m = max(solid.top_m for solid in self.solids)
        columns = _in_columns(self._raster(self.floor))
        occupied = np.zeros((*columns.shape, 1 + round(highest_m / VOXEL_M)), dtype=np.uint8)
        occupied[:, :, 0] = columns
        for solid in self.solids:
            first, end = 1 + round(solid.bottom_m / VOXEL_M), 1 + round(solid.top_m / VOXEL_M)
            occupied[:, :, first:end] |= _in_columns(self._raster(solid))[:, :, np.newaxis]
        x, y, _ = self._origin().translation_m.tolist()
        map_from_lattice = RigidTransform.planar(x, y, 0.0, -VOXEL_M)
        return VoxelMap(map_from_lattice, (VOXEL_M, VOXEL_M, VOXEL_M), occupied)

    def _raster(self, solid: Solid, depth_m: float = 0.0) -> npt.NDArray[np.bool_]:
        """Return the cells (height, width) whose centres lie so deep inside a solid."""
        rows, columns = self._shape()
        x, y, _ = self._origin().translation_m
        x_m = x + (np.arange(columns) + 0.5) * CELL_M
        y_m = y + (np.arange(rows) + 0.5) * CELL_M
        return solid.covers(x_m[np.newaxis, :], y_m[:, np.newaxis], depth_m)

    def _shape(self) -> tuple[int, int]:
        sides_m = self.floor.width_m + 2 * _MARGIN_M, self.floor.length_m + 2 * _MARGIN_M
        return round(sides_m[0] / CELL_M), round(sides_m[1] / CELL_M)

    def _origin(self) -> RigidTransform:
        floor = self.floor
        x_m = floor.x_m - 0.5 * floor.length_m - _MARGIN_M
        y_m = floor.y_m - 0.5 * floor.width_m - _MARGIN_M
        return RigidTransform.planar(x_m, y_m, 0.0)


def surface_centres_m(voxels: VoxelMap) -> npt.NDArray[np.float64]:
    """Return the centres (N, 3), in the map frame, of occupied voxels with a free neighbour.

    A sensor sees no others. Neighbours share a face; beyond the lattice all is free.
    """
    padded = np.pad(voxels.occupied, 1)
    core = (slice(1, -1),) * 3
    buried = voxels.occupied.astype(np.bool_)
    for axis in range(3):
        buried &= np.roll(padded, 1, axis)[core].astype(np.bool_)
        buried &= np.roll(padded, -1, axis)[core].astype(np.bool_)
    shown = np.argwhere(voxels.occupied.astype(np.bool_) & ~buried)
    return voxels.map_from_lattice.apply((shown + 0.5) * np.array(voxels.voxel_size_m))


def _in_columns(cells: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return the columns (nx, ny) of voxels that hold one of the cells (height, width)."""
    rows, columns = (side // _CELLS_PER_VOXEL for side in cells.shape)
    blocks = cells.reshape(rows, _CELLS_PER_VOXEL, columns, _CELLS_PER_VOXEL)
    return np.ascontiguousarray(blocks.any(axis=(1, 3)).T)
