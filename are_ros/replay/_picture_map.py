"""The ground of the overview picture: which part of the map it shows, and in which greys."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros.world.occupancy_grid import OccupancyGrid

_MOST_PIXELS = 1400
_THINNEST_WALL_PT = 0.9
_THICK_FROM = 50
_FREE_RGB = np.array((252, 252, 251))
_WALL_RGB = np.array((88, 95, 104))


@dataclass(frozen=True)
class Window:
    """The rectangle of the map's frame that is shown [m]."""

    left: float
    right: float
    bottom: float
    top: float

    @property
    def width_m(self) -> float:
        """Extent along x."""
        return self.right - self.left

    @property
    def height_m(self) -> float:
        """Extent along y."""
        return self.top - self.bottom

    def holds(self, rectangle_m: npt.NDArray[np.float64]) -> bool:
        """Tell whether a rectangle (left, bottom, right, top) (4,) is within it."""
        low_m, high_m = rectangle_m[:2], rectangle_m[2:]
        is_above, is_below = low_m > (self.left, self.bottom), high_m < (self.right, self.top)
        return bool(is_above.all() and is_below.all())


@dataclass(frozen=True, eq=False)
class KnownPart:
    """The cells of a grid without its unknown margins: int8 (h, w), and where its corner lies."""

    cells: npt.NDArray[np.int8]
    row0: int
    col0: int


def known_part(grid: OccupancyGrid) -> KnownPart:
    """Return the smallest rectangle with all known cells; the whole grid if none is known."""
    known = grid.cells >= 0
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return KnownPart(grid.cells, 0, 0)
    part = grid.cells[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    return KnownPart(part, int(rows[0]), int(cols[0]))


def map_from_part(
    grid: OccupancyGrid, part: KnownPart, points: npt.ArrayLike
) -> npt.NDArray[np.float64]:
    """Return the points (N, 2) of the map's frame of points given as (col, row) in the part."""
    col_row = np.add(points, (part.col0, part.row0))
    matrix = grid.origin.matrix()
    moved: npt.NDArray[np.float64]
    moved = col_row * grid.resolution_m @ matrix[:2, :2].T + matrix[:2, 3]
    return moved


def window_of(grid: OccupancyGrid, part: KnownPart, points_m: npt.NDArray[np.float64]) -> Window:
    """Return what shows the known part and the points (N, 2), with a margin around."""
    height, width = part.cells.shape
    corners = map_from_part(grid, part, [(0, 0), (width, 0), (0, height), (width, height)])
    everything = np.concatenate((corners, points_m))
    (left, bottom), (right, top) = everything.min(axis=0), everything.max(axis=0)
    margin = 0.02 * max(right - left, top - bottom)
    return Window(left - margin, right + margin, bottom - margin, top + margin)


def shaded(part: KnownPart, cell_pt: float) -> tuple[npt.NDArray[np.uint8], int]:
    """Return an RGBA image of the part, and how many cells a pixel is wide.

    A pixel shows the highest of its cells, so that no wall gets lost; where a cell is drawn smaller
    than a line (`cell_pt`, in 1/72 inch), walls are thickened. Unknown is transparent.
    """
    factor = max(1, math.ceil(max(part.cells.shape) / _MOST_PIXELS))
    reduced = _pooled(part.cells, factor)
    if cell_pt * factor < _THINNEST_WALL_PT:
        reduced = _thickened(reduced)
    table = np.zeros((102, 4), dtype=np.uint8)
    fraction = np.linspace(0.0, 1.0, 101)[:, np.newaxis]
    table[1:, :3] = np.rint(_FREE_RGB + fraction * (_WALL_RGB - _FREE_RGB))
    table[1:, 3] = 255
    return table[reduced + 1], factor


def _pooled(cells: npt.NDArray[np.int8], factor: int) -> npt.NDArray[np.int8]:
    """Return the maximum of each block of cells; beyond the edge is unknown."""
    if factor == 1:
        return cells
    height, width = (-(-side // factor) for side in cells.shape)
    padded = np.full((height * factor, width * factor), -1, dtype=np.int8)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    by_row: npt.NDArray[np.int8] = padded.reshape(height, factor, -1).max(axis=1)
    pooled: npt.NDArray[np.int8] = by_row.reshape(height, width, factor).max(axis=2)
    return pooled


def _thickened(cells: npt.NDArray[np.int8]) -> npt.NDArray[np.int8]:
    """Return the cells with their walls one cell thicker all around."""
    import cv2

    walls = np.where(cells >= _THICK_FROM, cells, -1).astype(np.int16)
    thick = cv2.dilate(walls, np.ones((3, 3), dtype=np.uint8))
    thickened: npt.NDArray[np.int8] = np.maximum(cells, np.asarray(thick)).astype(np.int8)
    return thickened
