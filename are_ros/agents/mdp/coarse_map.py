"""M2D coarsened for decisions: the cells in which a disc fits, and the steps between them."""

import math
from collections import OrderedDict
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.mdp import coarse_kernels as _coarse_kernels
from are_ros.agents.navigation import ground as _ground_kernels
from are_ros.agents.navigation.terrain import Terrain
from are_ros.world.lattice_cover import lattice_row

SEARCH_M: Final = 2.0
"""Largest distance of a point from its cell, along each axis of the grid."""

WALL_COMFORT_M: Final = 0.5
"""With this room to the nearest wall, beside the own radius, the wall has no cost."""

SMALL_M: Final = 0.5
RADIUS_STEPS_M: Final = (0.01, 0.05)
"""Steps to which radii are rounded, up to `SMALL_M` and beyond: some centimetres close a gap for a
person, and small radii are few."""

MAPS_KEPT: Final = 64

Cell = tuple[int, int]


class CoarseMap:
    """A terrain in cells of about half a metre, for a disc of one radius (MDP of section 3.2).

    Plain max-pooling would close doors of 0.8 m, so a coarse cell is open if the disc fits at one
    fine cell in it at least. Of the components of such fine cells within the coarse cell the
    largest counts; its anchor is the fine cell with most clearance (but `WALL_COMFORT_M` of room
    is enough), of equal ones the most central. An edge between neighbours is open if their
    components join within the two cells: no wall leaks, however thin.

    `shape` is (h, w); cells are (row, col) from the grid's origin, rows along its y. `anchors_m`
    float64 (h, w, 2) in the map frame, NaN where closed. `edges` bool (4, h, w): 0 east (x of the
    grid), 1 north (y), 2 west, 3 south. `room_m` float32 (h, w): the room between the disc
    and the nearest wall at the anchor, -1 where closed. `components` int32 (h, w): cells
    with one number are joined by open edges, -1 is closed. `nearness` float32 (h, w) is that to
    walls, as `nearness_to_walls`. `cell_size_m` is the nearest multiple of the grid's resolution to
    the one asked for. All arrays are read-only. `key` distinguishes maps: version of the
    environment, height, radius, cell size. `ground` is for kernels.
    """

    def __init__(self, terrain: Terrain, radius_m: float, cell_size_m: float = 0.5) -> None:
        """Coarsen a terrain; it takes some 10 ns per fine cell."""
        self.grid = terrain.grid
        self.radius_m = radius_m
        resolution_m = self.grid.resolution_m
        self._side = max(1, round(cell_size_m / resolution_m))
        self.cell_size_m = self._side * resolution_m
        self.key = (terrain.environment.version, terrain.height_m, radius_m, self.cell_size_m)
        self._clearance_m = np.ascontiguousarray(terrain.clearance_m, np.float32)[...]
        self._clearance_m.flags.writeable = False
        self._least_m = np.float32(radius_m + 0.5 * resolution_m)
        is_main = self._coarsen()
        is_main.flags.writeable = False
        self.ground = _ground_kernels.Ground(
            is_main,
            self._clearance_m,
            lattice_row(self.grid.origin, resolution_m, resolution_m),
            self.anchors_m,
            float(self._least_m),
            math.ceil(SEARCH_M / resolution_m),
            self._side,
        )

    def _coarsen(self) -> npt.NDArray[np.bool_]:
        """Compute the arrays; return which fine cells belong to a largest component."""
        shape = tuple(-(-size // self._side) for size in self._clearance_m.shape)
        self.shape: Cell = (shape[0], shape[1])
        labels = np.empty(self._clearance_m.shape, np.uint16)
        mains = np.empty(shape, np.uint16)
        fine = np.zeros((*shape, 2), np.int32)
        is_main = np.empty(labels.shape, np.bool_)
        levels_m = (float(self._least_m), float(self._least_m) + WALL_COMFORT_M)
        disc_m = (float(self.radius_m), float(self.grid.resolution_m))
        _coarse_kernels.label_blocks(
            self._clearance_m, disc_m, levels_m, self._side, labels, mains, fine, is_main
        )
        self.edges = np.empty((4, *shape), np.bool_)
        _coarse_kernels.open_edges(labels, mains, self._side, self.edges)
        self.components = _coarse_kernels.label_components(mains, self.edges)
        self._place_anchors(fine)
        return is_main

    def _place_anchors(self, fine: npt.NDArray[np.int32]) -> None:
        is_open = self.components >= 0
        points_m = self.grid.cells_to_points(fine.reshape(-1, 2)).reshape(fine.shape)
        self.anchors_m = np.where(is_open[..., None], points_m, np.nan)
        room_m = self._clearance_m[fine[..., 0], fine[..., 1]] - self._least_m
        self.room_m = np.where(is_open, room_m, np.float32(-1.0))
        self.nearness = nearness_to_walls(self.room_m)
        for array in (self.edges, self.components, self.anchors_m, self.room_m, self.nearness):
            array.flags.writeable = False

    def cell_of(self, x_m: float, y_m: float) -> Cell | None:
        """Return the open cell whose component contains a point of the map frame, or is nearest.

        Nearest is measured over free fine cells, not through walls, up to `SEARCH_M` along each
        axis; from a point in a wall, through that wall. None if there is no such cell, and outside
        the grid.
        """
        cell = _ground_kernels.cell_of(self.ground, x_m, y_m)
        return None if cell[0] < 0 else cell

    def holds(self, x_m: float, y_m: float, radius_m: float | None = None) -> bool:
        """Return whether the disc, or one of another radius, fits at a point.

        Only points in a fine cell of their cell's component count.
        """
        radius_m = self.radius_m if radius_m is None else radius_m
        return bool(_ground_kernels.holds(self.ground, x_m, y_m, radius_m))

    def anchor_of(self, cell: Cell) -> tuple[float, float]:
        """Return the anchor of an open cell in the map frame."""
        x_m, y_m = self.anchors_m[cell].tolist()
        return x_m, y_m


def nearness_to_walls(room_m: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the nearness to walls in [0, 1]: the squared lack of room, as a share."""
    lacks = np.clip(1.0 - room_m / np.float32(WALL_COMFORT_M), 0.0, 1.0)
    return np.asarray(lacks * lacks, np.float32)


def rounded_up_m(radius_m: float) -> float:
    """Return the radius [m] of a disc rounded up: to centimetres, or to 5 cm above 0.5 m."""
    step_m = RADIUS_STEPS_M[radius_m > SMALL_M]
    return step_m * math.ceil(radius_m / step_m - 1e-6)


class CoarseMaps:
    """Coarse maps by terrain and radius, computed on demand; the last 64 used are kept."""

    def __init__(self, cell_size_m: float = 0.5) -> None:
        """Take the size of all cells."""
        self._cell_size_m = cell_size_m
        self._maps: OrderedDict[tuple[int, float, float], CoarseMap] = OrderedDict()

    def clear(self) -> None:
        """Drop all maps, and the grids that they hold: there is a new environment."""
        self._maps.clear()

    def of(self, terrain: Terrain, radius_m: float) -> CoarseMap:
        """Return the map for a disc, its radius rounded up."""
        radius_m = rounded_up_m(radius_m)
        key = (terrain.environment.version, terrain.height_m, radius_m)
        if key not in self._maps:
            self._maps[key] = CoarseMap(terrain, radius_m, self._cell_size_m)
        self._maps.move_to_end(key)
        while len(self._maps) > MAPS_KEPT:
            self._maps.popitem(last=False)
        return self._maps[key]
