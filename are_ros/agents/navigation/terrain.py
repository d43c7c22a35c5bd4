"""The terrain of bodies of one height: free cells without a voxel in their way."""

import math
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, compiled
from are_ros.world.boxes import TOUCH_TOLERANCE_M
from are_ros.world.environment import Environment
from are_ros.world.lattice_cover import TWO_HALF_DIAGONALS, lattice_row
from are_ros.world.occupancy_grid import OccupancyGrid, distances_in_cells

HEIGHT_STEP_M: Final = 0.25
FIRST_LEAP: Final = 16
"""The first leap along a way [points], in the search for its farthest visible point."""

_CERTAIN_HIT: Final = 0.25
"""A point is at most this much farther [cells] from a closed cell than the centre of its own cell
is from the centre of that one: half a diagonal, less half a side."""

_ANYWHERE: Final = 0.7072
_BESIDE: Final = 0.499


class Terrain:
    """The ground of one environment for bodies up to `height_m`; it never changes.

    A voxel of M3D is in the way if its top is more than the environment's ground clearance above
    the ground of the cell, and its bottom below the body's top there. An extruded M3D adds nothing
    to the grid.
    """

    def __init__(self, environment: Environment, height_m: float) -> None:
        self.environment = environment
        self.height_m = height_m

    @property
    def grid(self) -> OccupancyGrid:
        """The occupancy grid M2D of the environment."""
        return self.environment.grid

    @cached_property
    def clearance_m(self) -> npt.NDArray[np.float32]:
        """Distance (height, width) [m] of each cell from the nearest that is closed, read-only.

        Exact, between cell centres; 0 on closed cells. Closed are cells that are not free or have a
        voxel in the way, and all outside the grid.
        """
        if self.environment.own_voxels is None:
            return self.environment.clearance_m
        field = distances_in_cells(self.environment.classes.free & ~self._overhung, border=1)
        field *= np.float32(self.grid.resolution_m)
        field.flags.writeable = False
        return field

    @cached_property
    def solid(self) -> npt.NDArray[np.bool_]:
        """Cells (height, width) that are occupied, or have a voxel in the way."""
        occupied = self.environment.classes.occupied
        if self.environment.own_voxels is None:
            return occupied
        solid: npt.NDArray[np.bool_] = occupied | self._overhung
        solid.flags.writeable = False  # as above: kernels compile for each kind of array
        return solid

    def sees(self, from_m: tuple[float, float], to_m: tuple[float, float], radius_m: float) -> bool:
        """Return whether a disc can move straight from one point to another of the map frame.

        It meets no closed cell at either end, nor every half a cell between them: exact, and the
        same condition under which the local planner lets an agent turn on the spot.
        """
        return bool(rolls(self.clearance_m, self.lattice, from_m, to_m, radius_m))

    @cached_property
    def lattice(self) -> npt.NDArray[np.float64]:
        """The grid's pose in the map, as `lattice_cover.lattice_row`."""
        resolution_m = self.grid.resolution_m
        return lattice_row(self.grid.origin, resolution_m, resolution_m)

    @cached_property
    def _overhung(self) -> npt.NDArray[np.bool_]:
        overhangs = self.environment.overhangs
        if overhangs is None:
            return np.zeros(self.grid.cells.shape, np.bool_)
        return overhangs.below(self.height_m)


class Terrains:
    """The terrains of the newest environment, one for each height."""

    def __init__(self) -> None:
        self._environment: Environment | None = None
        self._terrains: dict[float, Terrain] = {}

    def of(self, environment: Environment, height_m: float) -> Terrain:
        """Return the terrain of a body `height_m` high; heights are rounded up to 0.25 m.

        If M3D adds nothing to the grid, all heights share one terrain.
        """
        if environment is not self._environment:
            self._environment, self._terrains = environment, {}
        level_m = math.ceil(height_m / HEIGHT_STEP_M) * HEIGHT_STEP_M
        key = 0.0 if environment.own_voxels is None else level_m
        if key not in self._terrains:
            self._terrains[key] = Terrain(environment, level_m)
        return self._terrains[key]


@borrowing
def rolls(
    field: npt.NDArray[np.float32],
    lattice: npt.NDArray[np.float64],
    from_m: tuple[float, float],
    to_m: tuple[float, float],
    radius: float,
) -> bool:
    """Return whether a disc can move along a segment: march in leaps of the room that is left."""
    length = np.hypot(to_m[0] - from_m[0], to_m[1] - from_m[1])
    unit = lattice[4]
    along = 0.0
    while True:
        share = along / length if length > 0.0 else 0.0
        dx = from_m[0] + share * (to_m[0] - from_m[0]) - lattice[0]
        dy = from_m[1] + share * (to_m[1] - from_m[1]) - lattice[1]
        x = (dx * lattice[2] + dy * lattice[3]) / unit
        y = (dy * lattice[2] - dx * lattice[3]) / unit
        if not (0.0 <= x < field.shape[1] and 0.0 <= y < field.shape[0]):
            return False
        here = field[int(y), int(x)]
        if here + _CERTAIN_HIT * unit < radius:
            return False
        room = here - TWO_HALF_DIAGONALS * unit - radius
        if room < 0.0 and not disc_is_free(field, x, y, radius / unit - TOUCH_TOLERANCE_M):
            return False
        if along >= length:
            return True
        along = min(along + max(0.5 * unit, room), length)


@compiled
def cell_centre(lattice: npt.NDArray[np.float64], row: int, col: int) -> tuple[float, float]:
    """Return the centre of a cell in the map frame."""
    x, y, unit = col + 0.5, row + 0.5, lattice[4]
    return (
        lattice[0] + (x * lattice[2] - y * lattice[3]) * unit,
        lattice[1] + (x * lattice[3] + y * lattice[2]) * unit,
    )


@borrowing
def disc_is_free(field: npt.NDArray[np.float32], x: float, y: float, radius: float) -> bool:
    """Tell whether a disc covers open cells only; its centre and radius are given in cells."""
    first_row, last_row = int(np.floor(y - radius)), int(np.floor(y + radius))
    first_col, last_col = int(np.floor(x - radius)), int(np.floor(x + radius))
    if min(first_row, first_col) < 0 or last_row >= field.shape[0] or last_col >= field.shape[1]:
        return False
    for row in range(first_row, last_row + 1):
        v = max(row - y, y - row - 1.0, 0.0)
        for col in range(first_col, last_col + 1):
            u = max(col - x, x - col - 1.0, 0.0)
            if field[row, col] == 0.0 and u * u + v * v < radius * radius:
                return False
    return True


@borrowing
def disc_fits(
    clearance_m: npt.NDArray[np.float32], row: int, col: int, radius_m: float, unit_m: float
) -> bool:
    """Tell whether a disc about the centre of a cell covers open cells only.

    Clearance is to centres: half a cell more than the radius is enough beside a cell, and half a
    diagonal before its corner; between the two the cells around are looked at.
    """
    here_m = clearance_m[row, col]
    if here_m >= radius_m + _ANYWHERE * unit_m:
        return True
    if here_m < radius_m + _BESIDE * unit_m:
        return False
    radius = radius_m / unit_m - TOUCH_TOLERANCE_M
    return disc_is_free(clearance_m, col + 0.5, row + 0.5, radius)


@borrowing
def farthest(
    field: npt.NDArray[np.float32],
    lattice: npt.NDArray[np.float64],
    from_m: tuple[float, float],
    way_m: npt.NDArray[np.float64],
    radius: float,
) -> int:
    """Return the index of a far point of a way that a disc can move straight to.

    The search leaps along the way, each time twice as far, until a point is not visible, and then
    halves the interval; a point that is visible again beyond it is not found. The result is the
    last index if all points are visible, 0 if none is.
    """
    last, seen, unseen = way_m.shape[0] - 1, 0, 0
    leap = min(FIRST_LEAP, last)
    while leap > seen:
        if not rolls(field, lattice, from_m, (way_m[leap, 0], way_m[leap, 1]), radius):
            unseen = leap
            break
        seen, leap = leap, min(2 * leap, last)
    while unseen - seen > 1:
        k = (seen + unseen) // 2
        if rolls(field, lattice, from_m, (way_m[k, 0], way_m[k, 1]), radius):
            seen = k
        else:
            unseen = k
    return seen
