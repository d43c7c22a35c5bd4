"""The real environment as one value: what a box may hit, and where it may stand (section 3.1).

The height of the floor under a footprint is a plane, or found among the voxels of M3D.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from are_ros._compiled import compiled
from are_ros.world import lattice_cover
from are_ros.world.boxes import TOUCH_TOLERANCE_M, OrientedBoxes
from are_ros.world.lattice_cover import covered, lattice_row
from are_ros.world.occupancy_grid import CellClasses, OccupancyGrid, distances_in_cells
from are_ros.world.rigid_transform import RigidTransform, in_level_frame
from are_ros.world.voxel_map import VoxelMap


def surface_counts(occupied: npt.NDArray[np.uint8]) -> npt.NDArray[np.int64]:
    """Return how many columns of uint8 (nx, ny, nz) have a surface at k, int64 (nz + 1,)."""
    counts = np.zeros(occupied.shape[2] + 1, dtype=np.int64)
    counts[1:-1] = np.count_nonzero(occupied[..., :-1] > occupied[..., 1:], axis=(0, 1))
    counts[-1] = np.count_nonzero(occupied[..., -1])
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


def filled_from_nearest(tops: npt.NDArray[np.int32], unknown: int) -> npt.NDArray[np.int32]:
    """Return tops (nx, ny) with each unknown one as a nearest known one, in 4-neighbour steps."""
    from scipy.ndimage import distance_transform_cdt

    nearest = distance_transform_cdt(
        tops == unknown, "taxicab", return_distances=False, return_indices=True
    )
    filled: npt.NDArray[np.int32] = tops[tuple(nearest)]
    return filled


_STEP_M: Final = 0.05
_SEARCH_M: Final = 0.5
_WINDOW_M: Final = 0.4
_MAX_SLOPE: Final = 0.3
_UNKNOWN: Final = np.int32(-(2**31))


class Ground(Protocol):
    """What tells the height of the floor, z in the map frame [m]."""

    def lowest_m(self) -> float:
        """Return the least height that there is."""
        ...

    def highest_m(self) -> float:
        """Return the greatest height that there is."""
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

    def highest_m(self) -> float:
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

    1. The main level is the height at which most columns have a surface, within 0.5 m of
       `plane_height_m` (the lower one of equals). Nothing there: the plane is the floor.
    2. Columns with a surface within a step of the main level start; from column to
       4-neighbour, the surface nearest to the neighbour's floor is taken, if it is at most a
       step (0.05 m, at least one voxel) up or down. So ramps are followed, and tables,
       walls, boxes and ceilings are not.
    3. A floor higher than a step plus a slope of 0.3 above the lowest within 0.4 m is none
       (a heap or a ragged wall that was climbed voxel by voxel).
    4. A column without a floor (wall, box, never seen) takes the nearest column's, in steps
       over the lattice; a point beside the lattice takes the nearest border column's, and so does
       one that is not finite.

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
    def from_voxels(cls, voxels: VoxelMap, plane_height_m: float = 0.0) -> "VoxelGround":
        """Return the floor of a voxel map by the rule above; an extruded map has only the plane."""
        size_x, size_y, size_z = voxels.voxel_size_m
        base_m = float(voxels.map_from_lattice.translation_m[2])
        heights_m = np.full(voxels.occupied.shape[:2], float(plane_height_m))
        seen = np.zeros(heights_m.shape, dtype=np.bool_)
        level = None if voxels.is_extruded else _main_level(voxels, plane_height_m)
        if level is not None:
            step = max(1, int(_STEP_M / size_z + 1e-6))
            tops = flood_floor(voxels.occupied, level, step, int(_UNKNOWN))
            seen = _gentle(tops, (size_x, size_y, size_z), step)
            tops[~seen] = _UNKNOWN
            heights_m = base_m + filled_from_nearest(tops, int(_UNKNOWN)) * size_z
        return cls(voxels.map_from_lattice, (size_x, size_y), heights_m, seen)

    def lowest_m(self) -> float:
        """Return the least height of a column."""
        return float(self.heights_m.min())

    def highest_m(self) -> float:
        """Return the greatest height of a column."""
        return float(self.heights_m.max())

    def heights(self, points_m: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        """Return the floor's height (N,) at each of the points (N, 2) of the map frame."""
        with np.errstate(invalid="ignore"):
            x, y = in_level_frame(self.map_from_lattice, points_m)
        nx, ny = self.heights_m.shape
        i = np.fmin(np.fmax(np.floor(x / self.column_size_m[0]), 0), nx - 1)
        j = np.fmin(np.fmax(np.floor(y / self.column_size_m[1]), 0), ny - 1)
        heights: npt.NDArray[np.float64] = self.heights_m[i.astype(np.int64), j.astype(np.int64)]
        return heights


def _main_level(voxels: VoxelMap, plane_height_m: float) -> int | None:
    """Return the surface index k (its height is k voxels above the lattice) of the main level."""
    counts = surface_counts(voxels.occupied)
    base_m = float(voxels.map_from_lattice.translation_m[2])
    heights_m = base_m + np.arange(len(counts)) * voxels.voxel_size_m[2]
    counts[np.abs(heights_m - plane_height_m) > _SEARCH_M] = 0
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


_HALF_CELL: Final = 0.5


class Overhangs:
    """The bottom of the lowest voxel in the way over each cell, found once for all heights.

    A voxel is in the way if its top is more than `clearance_m` above the ground of the cell, and
    the cell's square meets it.
    """

    def __init__(
        self, grid: OccupancyGrid, voxels: VoxelMap, ground: Ground, clearance_m: float
    ) -> None:
        self._floors_m = _floors_m(grid, ground)
        self._bottoms_m = np.full(grid.cells.shape, np.inf)
        base_m, layer_m = float(voxels.map_from_lattice.translation_m[2]), voxels.voxel_size_m[2]
        columns = np.ascontiguousarray(np.argwhere(voxels.occupied.any(axis=2)))
        _lower(
            self._bottoms_m,
            _packed_columns(grid, voxels, columns),
            columns,
            voxels.occupied,
            np.broadcast_to(self._floors_m, grid.cells.shape).copy(),
            (base_m, layer_m, clearance_m),
            grid.resolution_m,
        )

    def below(self, height_m: float) -> npt.NDArray[np.bool_]:
        """Return the cells (height, width) over which a voxel is in the way of such a body."""
        tops_m = self._floors_m + height_m - TOUCH_TOLERANCE_M
        found: npt.NDArray[np.bool_] = self._bottoms_m < tops_m
        return found


def _floors_m(grid: OccupancyGrid, ground: Ground) -> npt.NDArray[np.float64]:
    """Return the ground's height over each cell (height, width), one for all () of a plane."""
    if isinstance(ground, PlaneGround):
        return np.array(float(ground.height_m))
    rows, cols = np.indices(grid.cells.shape)
    points_m = grid.cells_to_points(np.column_stack((rows.ravel(), cols.ravel())))
    heights_m = ground.heights(points_m).reshape(grid.cells.shape)
    floors_m: npt.NDArray[np.float64] = np.maximum(heights_m, ground.lowest_m())
    return floors_m


def _packed_columns(
    grid: OccupancyGrid, voxels: VoxelMap, columns: npt.NDArray[np.int64]
) -> npt.NDArray[np.float64]:
    """Return the footprints of columns (M, 2) of voxels in the grid's frame, as packed boxes."""
    local = grid.origin.inverse() @ voxels.map_from_lattice
    width_m, depth_m, _ = voxels.voxel_size_m
    cosine, sine = math.cos(local.yaw_rad()), math.sin(local.yaw_rad())
    x0_m, y0_m, _ = local.translation_m
    packed = np.zeros((len(columns), 8))
    along_m, across_m = (columns + _HALF_CELL).T * np.array([[width_m], [depth_m]])
    packed[:, 0] = x0_m + cosine * along_m - sine * across_m
    packed[:, 1] = y0_m + sine * along_m + cosine * across_m
    packed[:, 3], packed[:, 4] = cosine, sine
    packed[:, 5], packed[:, 6] = _HALF_CELL * width_m, _HALF_CELL * depth_m
    return packed


@compiled
def _lower(
    bottoms_m: npt.NDArray[np.float64],
    packed: npt.NDArray[np.float64],
    columns: npt.NDArray[np.int64],
    occupied: npt.NDArray[np.uint8],
    floors_m: npt.NDArray[np.float64],
    levels_m: tuple[float, float, float],
    resolution_m: float,
) -> None:
    """Lower the bottoms over the cells that each column of voxels (M,), a box, meets."""
    base, layer, clearance = levels_m
    lattice = np.array([0.0, 0.0, 1.0, 0.0, resolution_m, resolution_m])
    for i in range(columns.shape[0]):
        row0, col0, mask = covered(packed, i, lattice, bottoms_m.shape, TOUCH_TOLERANCE_M)
        voxels = occupied[columns[i, 0], columns[i, 1]]
        for row in range(mask.shape[0]):
            for col in range(mask.shape[1]):
                if not mask[row, col]:
                    continue
                least = floors_m[row0 + row, col0 + col] + clearance + TOUCH_TOLERANCE_M
                known = bottoms_m[row0 + row, col0 + col]
                for k in range(voxels.shape[0]):
                    bottom = base + k * layer
                    if bottom >= known:
                        break
                    if voxels[k] and base + (k + 1) * layer > least:
                        bottoms_m[row0 + row, col0 + col] = bottom
                        break


_SAMPLES = np.array([(x, y) for x in (-2, 0, 2) for y in (-2, 0, 2)]) / 3.0


@dataclass(frozen=True, eq=False)
class Environment:
    """M2D, M3D and the ground at one time; a new map makes a new environment.

    `classes` are those of `grid`. `voxels` is None or M3D; one that is extruded must come from
    the occupied cells of this grid: then M2D implies M3D, which is not tested again. Voxels whose
    top is at most `ground_clearance_m` above the ground under a box are its floor, no obstacle.
    `version` tells environments apart and increases.

    All sets are open, up to `TOUCH_TOLERANCE_M`: a footprint is shrunk by it on each side, and a
    cell counts if its open square still meets it. What is computed on demand is kept.
    """

    grid: OccupancyGrid
    classes: CellClasses
    voxels: VoxelMap | None
    ground: Ground
    ground_clearance_m: float
    version: int = 0

    @cached_property
    def clearance_m(self) -> NDArray[np.float32]:
        """Distance (height, width) of each cell from the nearest that is not free, read-only.

        Exact, between cell centres; 0 on cells that are not free. All cells outside the grid
        count as not free.
        """
        field = distances_in_cells(self.classes.free, border=1)
        field *= np.float32(self.grid.resolution_m)
        field.flags.writeable = False
        return field

    @property
    def own_voxels(self) -> VoxelMap | None:
        """M3D where it says more than the grid; None where the grid's walls are extruded."""
        return None if self.voxels is None or self.voxels.is_extruded else self.voxels

    @cached_property
    def overhangs(self) -> Overhangs | None:
        """What hangs over the cells, where M3D says more than the grid; else None."""
        if self.own_voxels is None:
            return None
        return Overhangs(self.grid, self.own_voxels, self.ground, self.ground_clearance_m)

    def prepare(self) -> None:
        """Compute now what else the first question would have to wait for."""
        self.is_placeable(OrientedBoxes(np.zeros((1, 3)), np.zeros(1), np.full((1, 3), 1e-3)))
        _ = self.overhangs

    def lookup(self, points_m: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return the clearance (N,) of the cells that hold points (N, 2); 0 outside the grid."""
        cells = self.grid.points_to_cells(points_m)
        inside = self.grid.contains(cells)
        clearance = np.zeros(len(cells), dtype=np.float32)
        clearance[inside] = self.clearance_m[cells[inside, 0], cells[inside, 1]]
        return clearance

    def hits_wall(self, boxes: OrientedBoxes) -> NDArray[np.bool_]:
        """Tell which boxes meet an occupied cell or an occupied voxel above their floor: (N,).

        All that is outside the grid is wall, too: nothing stands where no map tells of the place
        (an artefact may find itself there when the map becomes smaller). Unknown cells are none.
        """
        hits = self._meets_cells(boxes, self.classes.occupied)
        if self._obstacles is not None:
            hits |= self._hits_voxels(boxes, self._obstacles)
        return hits

    def is_placeable(self, boxes: OrientedBoxes) -> NDArray[np.bool_]:
        """Tell which boxes cover free cells inside the grid only, and hit no wall: (N,)."""
        placeable = ~self._meets_cells(boxes, self._not_free)
        if self._obstacles is not None:
            free = np.flatnonzero(placeable)
            placeable[free] = ~self._hits_voxels(boxes.take(free), self._obstacles)
        return placeable

    def ground_heights_m(self, boxes: OrientedBoxes) -> NDArray[np.float64]:
        """Return the ground's height (N,) under boxes: the median over 3 x 3 points of each."""
        if isinstance(self.ground, PlaneGround):
            return np.full(len(boxes), float(self.ground.height_m))
        x, y = np.moveaxis(_SAMPLES * boxes.half_sizes_m[:, None, :2], -1, 0)
        c, s = boxes.packed[:, 3, None], boxes.packed[:, 4, None]
        points_m = np.stack((x * c - y * s, x * s + y * c), axis=-1) + boxes.centres_m[:, None, :2]
        heights_m = self.ground.heights(points_m.reshape(-1, 2)).reshape(len(boxes), len(_SAMPLES))
        return np.partition(heights_m, 4, axis=1)[:, 4]

    def _meets_cells(self, boxes: OrientedBoxes, cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Tell which boxes meet some of the cells that are not free, or reach outside."""
        return lattice_cover.hits_cells(
            boxes.packed,
            self._grid_lattice,
            cells,
            self.clearance_m,
            self.grid.resolution_m,
            TOUCH_TOLERANCE_M,
        )

    @cached_property
    def _not_free(self) -> NDArray[np.bool_]:
        cells = ~self.classes.free
        cells.flags.writeable = False
        return cells

    def _hits_voxels(self, boxes: OrientedBoxes, obstacles: "_Obstacles") -> NDArray[np.bool_]:
        floors_m = np.maximum(self.ground_heights_m(boxes), obstacles.lowest_ground_m)
        return lattice_cover.hits_voxels(
            boxes.packed,
            floors_m + self.ground_clearance_m,
            obstacles.lattice,
            obstacles.layers_m,
            obstacles.occupied,
            obstacles.lowest,
            obstacles.field,
            TOUCH_TOLERANCE_M,
        )

    @cached_property
    def _grid_lattice(self) -> NDArray[np.float64]:
        return lattice_row(self.grid.origin, self.grid.resolution_m, self.grid.resolution_m)

    @cached_property
    def _obstacles(self) -> "_Obstacles | None":
        """What of M3D the grid does not imply."""
        if self.own_voxels is None:
            return None
        lowest_m = self.ground.lowest_m()
        return _obstacles_above(self.own_voxels, lowest_m, self.ground_clearance_m)


@dataclass(frozen=True, eq=False)
class _Obstacles:
    """A voxel map as the kernel takes it; no box's ground is taken to be below the lowest.

    `lowest` (iy, ix): the lowest occupied layer above that ground, the number of layers if none.
    """

    occupied: NDArray[np.uint8]
    lowest: NDArray[np.int32]
    lattice: NDArray[np.float64]
    layers_m: tuple[float, float]
    field: NDArray[np.float32]
    lowest_ground_m: float


def _obstacles_above(voxels: VoxelMap, lowest_m: float, clearance_m: float) -> _Obstacles:
    width_m, depth_m, height_m = voxels.voxel_size_m
    base_m = float(voxels.map_from_lattice.translation_m[2])
    first = int(np.floor((lowest_m + clearance_m + TOUCH_TOLERANCE_M - base_m) / height_m))
    layers = voxels.occupied.shape[2]
    above = voxels.occupied[:, :, min(max(first, 0), layers - 1) :]
    is_clear = ~above.any(axis=2).T if first < layers else np.ones(above.shape[1::-1], np.bool_)
    lowest = np.where(is_clear, layers, layers - above.shape[2] + above.argmax(axis=2).T)
    return _Obstacles(
        voxels.occupied,
        lowest.astype(np.int32),
        lattice_row(voxels.map_from_lattice, width_m, depth_m),
        (base_m, height_m),
        distances_in_cells(is_clear),
        lowest_m,
    )
