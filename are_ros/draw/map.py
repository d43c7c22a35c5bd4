"""The map in a picture: the part that is shown, its greys, and where it lies on a canvas."""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.draw.canvas import Canvas
from are_ros.draw.palette import FLOOR, PAPER, TINT, WALL
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float64]

_LOWEST_M, _HIGHEST_M = 0.1, 1.8
"""What stands between these heights above the lowest voxel is drawn: no floor and no ceiling."""

_FURNITURE: Final = 45
"""Drawn like a cell of this value: darker than free, paler than a wall of the map."""
_MOST_PIXELS: Final = 1400
_THINNEST_WALL_PX: Final = 1.25
_THICK_FROM: Final = 50
_FINE: Final = 3
"""Cells are drawn with so many samples a pixel, per axis, at least."""
_CELLS_AT_ONCE: Final = 250_000
"""Places of so many cells are in memory: all those of a hall at 2 cm would be gigabytes."""


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


@dataclass(frozen=True)
class View:
    """A window on a canvas: pixels per metre, and the pixels of its upper left corner."""

    window: Window
    px_per_m: float
    left_px: float = 0.0
    top_px: float = 0.0

    @property
    def size_px(self) -> tuple[float, float]:
        """Width and height of the window."""
        return self.window.width_m * self.px_per_m, self.window.height_m * self.px_per_m

    @property
    def rectangle(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom of the window [px]."""
        width, height = self.size_px
        return self.left_px, self.top_px, self.left_px + width, self.top_px + height

    def pixels(self, points_m: npt.ArrayLike) -> Floats:
        """Return where points (..., 2) of the map's frame are: x right, y down."""
        corner = np.array((self.window.left, self.window.top))
        offsets = np.asarray(points_m, dtype=np.float64) - corner
        pixels: Floats = offsets * (self.px_per_m, -self.px_per_m) + (self.left_px, self.top_px)
        return pixels


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


def map_from_part(grid: OccupancyGrid, part: KnownPart, points: npt.ArrayLike) -> Floats:
    """Return the points (N, 2) of the map's frame of points given as (col, row) in the part."""
    col_row = np.add(points, (part.col0, part.row0))
    matrix = grid.origin.matrix()
    moved: Floats = col_row * grid.resolution_m @ matrix[:2, :2].T + matrix[:2, 3]
    return moved


def window_of(grid: OccupancyGrid, part: KnownPart, points_m: Floats) -> Window:
    """Return what shows the known part and the points (N, 2), with a margin around."""
    height, width = part.cells.shape
    corners = map_from_part(grid, part, [(0, 0), (width, 0), (0, height), (width, height)])
    everything = np.concatenate((corners, points_m))
    (left, bottom), (right, top) = everything.min(axis=0), everything.max(axis=0)
    margin = 0.02 * max(right - left, top - bottom)
    return Window(left - margin, right + margin, bottom - margin, top + margin)


def draw_map(
    canvas: Canvas,
    view: View,
    grid: OccupancyGrid,
    part: KnownPart,
    tint: Floats | None = None,
) -> None:
    """Draw a part of a map into its window on a canvas; what is unknown is PAPER.

    TINT is laid over the cells with an opacity of `tint` (h, w), from 0 to 1.
    """
    import cv2

    image, factor = shaded(part, view.px_per_m * grid.resolution_m)
    if tint is not None:
        image = _tinted(image, tint[::factor, ::factor])
    samples = _FINE if canvas.fine == 1 else canvas.fine
    left, top, right, bottom = (round(side * canvas.fine) for side in view.rectangle)
    corners = view.pixels(map_from_part(grid, part, [(0, 0), (factor, 0), (0, factor)]))
    corners -= (left / canvas.fine, top / canvas.fine)
    columns = np.column_stack((corners[1] - corners[0], corners[2] - corners[0], corners[0]))
    # Middles of pixels lie at whole numbers for OpenCV, and at halves for us.
    columns[:, 2] += 0.5 * (columns[:, 0] + columns[:, 1])
    columns *= samples
    columns[:, 2] -= 0.5
    per_pixel = samples // canvas.fine
    size = ((right - left) * per_pixel, (bottom - top) * per_pixel)
    fine = cv2.warpAffine(image, columns, size, flags=cv2.INTER_NEAREST)
    laid = np.where(fine[..., 3:] > 0, fine[..., :3], np.array(PAPER, dtype=np.uint8))
    if per_pixel > 1:
        size = (right - left, bottom - top)
        laid = np.asarray(cv2.resize(laid, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    area = canvas.pixels[top:bottom, left:right]
    area[:] = laid[: area.shape[0], : area.shape[1]]


def map_image(
    grid: OccupancyGrid, window: Window, px_per_m: float, tint: Floats | None = None
) -> npt.NDArray[np.uint8]:
    """Return an RGB image of a window of a map; `tint` as in `draw_map`."""
    view = View(window, px_per_m)
    columns, rows = (max(1, round(side)) for side in view.size_px)
    canvas = Canvas((columns, rows))
    draw_map(canvas, view, grid, known_part(grid), tint)
    return canvas.finished()


def shaded(part: KnownPart, cell_px: float) -> tuple[npt.NDArray[np.uint8], int]:
    """Return an RGBA image of the part, and how many cells one of its pixels is wide.

    A pixel shows the highest of its cells, so that no wall gets lost; where a cell is drawn smaller
    than a line (`cell_px`), walls are thickened. Unknown is transparent.
    """
    factor = max(1, math.ceil(max(part.cells.shape) / _MOST_PIXELS))
    reduced = _pooled(part.cells, factor)
    if cell_px * factor < _THINNEST_WALL_PX:
        reduced = _thickened(reduced)
    table = np.zeros((102, 4), dtype=np.uint8)
    fraction = np.linspace(0.0, 1.0, 101)[:, np.newaxis]
    table[1:, :3] = np.rint(FLOOR + fraction * np.subtract(WALL, FLOOR))
    table[1:, 3] = 255
    return table[reduced + 1], factor


def _tinted(image: npt.NDArray[np.uint8], tint: Floats) -> npt.NDArray[np.uint8]:
    """Return an RGBA image with TINT laid over it, as opaque as `tint` (h, w) says."""
    colours = image.astype(np.float64)
    height, width = (min(sides) for sides in zip(tint.shape, image.shape, strict=False))
    part = colours[:height, :width, :3]
    part += tint[:height, :width, np.newaxis] * (np.array(TINT) - part)
    return np.rint(colours).astype(np.uint8)


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


def with_furniture(grid: OccupancyGrid, part: KnownPart, voxels: VoxelMap) -> KnownPart:
    """Return the known part with what the octomap has on its free cells, in a middle grey."""
    stands = _covered(grid, part, voxels)
    cells = np.where(stands & (part.cells >= 0), np.maximum(part.cells, _FURNITURE), part.cells)
    return replace(part, cells=cells.astype(np.int8))


def _covered(grid: OccupancyGrid, part: KnownPart, voxels: VoxelMap) -> npt.NDArray[np.bool_]:
    """Return the cells (h, w) of a part that voxels between the two heights cover.

    A cell is covered if it holds the middle of a voxel, or if its own middle lies in a voxel. So
    fine voxels do not get lost, and coarse voxels have no holes.
    """
    size_m = voxels.voxel_size_m
    middles_m = (np.arange(voxels.occupied.shape[2]) + 0.5) * size_m[2]
    layers = (middles_m > _LOWEST_M) & (middles_m <= _HIGHEST_M)
    columns = np.asarray(voxels.occupied[:, :, layers].any(axis=2))
    covered = np.zeros(part.cells.shape, dtype=np.bool_)
    held = np.argwhere(columns) + 0.5
    points = np.column_stack((held * np.array(size_m[:2]), np.zeros(len(held))))
    cells = grid.points_to_cells(voxels.map_from_lattice.apply(points)[:, :2])
    cells = cells - np.array((part.row0, part.col0))
    inside = ((cells >= 0) & (cells < covered.shape)).all(axis=1)
    covered[cells[inside, 0], cells[inside, 1]] = True
    height, width = part.cells.shape
    step = max(1, _CELLS_AT_ONCE // max(width, 1))
    for row0 in range(0, height, step):
        strip = covered[row0 : row0 + step]
        rows, cols = np.indices(strip.shape).reshape(2, -1)
        own = grid.cells_to_points(np.column_stack((rows + row0 + part.row0, cols + part.col0)))
        found = voxels.points_to_voxels(np.column_stack((own, np.zeros(len(own)))))[:, :2]
        inside = ((found >= 0) & (found < columns.shape)).all(axis=1)
        strip[rows[inside], cols[inside]] |= columns[found[inside, 0], found[inside, 1]]
    return covered
