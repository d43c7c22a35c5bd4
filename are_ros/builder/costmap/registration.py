"""Registration of the artefacts: the cells of M2D that their footprints cover (section 3.3)."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import compress
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.world.boxes import TOUCH_TOLERANCE_M, OrientedBoxes
from are_ros.world.lattice_cover import covered, lattice_row
from are_ros.world.occupancy_grid import CellClasses, OccupancyGrid

Cell = TypeVar("Cell", bound=np.generic)
Rectangles = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
MaskKey = tuple[tuple[int, ...], bytes]


class CellPatch(NamedTuple):
    """The cells of a grid that one artefact covers, as a comparable value.

    `key` is the shape (r, c) and the bytes of a mask whose cell (0, 0) is the grid's cell
    (row0, col0); all lies inside the grid. An artefact wholly outside has an empty mask.
    """

    row0: int
    col0: int
    key: MaskKey

    @classmethod
    def of(cls, row0: int, col0: int, mask: Mask) -> "CellPatch":
        """Return the patch of a mask; equal masks give equal keys."""
        return cls(row0, col0, (mask.shape, mask.tobytes()))

    @property
    def mask(self) -> Mask:
        """The covered cells, bool (r, c), read-only."""
        shape, cells = self.key
        return np.frombuffer(cells, np.bool_).reshape(shape)

    def part_of(self, cells: npt.NDArray[Cell]) -> npt.NDArray[Cell]:
        """Return the view of a grid (h, w) under the mask."""
        rows, cols = self.key[0]
        return cells[self.row0 : self.row0 + rows, self.col0 : self.col0 + cols]


class CoveredCells(NamedTuple):
    """The cells of a grid that N artefacts cover.

    `windows` int64 (N, 5) are the first row, the first column and the shape of each artefact's
    mask, and where its cells begin in `cells` bool (K,), row by row. `total` is n_A, the number of
    cells in the union of the masks.
    """

    windows: Rectangles
    cells: Mask
    total: int

    def patch(self, k: int) -> CellPatch:
        """Return the cells of artefact k."""
        row0, col0, rows, cols, start = self.windows[k].tolist()
        return CellPatch(
            row0, col0, ((rows, cols), self.cells[start : start + rows * cols].tobytes())
        )


def covered_cells(boxes: OrientedBoxes, grid: OccupancyGrid) -> CoveredCells:
    """Return the cells that the projection of each box covers, clipped to the grid.

    A cell is covered if its open square meets the open footprint: a footprint that ends on a
    cell's edge does not cover the next cell. Against rounding, the footprint is shrunk by
    `TOUCH_TOLERANCE_M` on each side; one without area covers the cell that holds it.
    """
    lattice = lattice_row(grid.origin, grid.resolution_m, grid.resolution_m)
    shape = (grid.height, grid.width)
    return CoveredCells(*_cover(boxes.packed, lattice, shape, TOUCH_TOLERANCE_M))


def clutter_ratio(cells: CoveredCells, classes: CellClasses) -> float:
    """Return nu = n_A / n_free (Eq. 4): all artefacts' cells over the real map's free ones.

    NaN where the map has no free cell.
    """
    return cells.total / classes.free_count if classes.free_count else float("nan")


@compiled
def _cover(
    packed: npt.NDArray[np.float64],
    lattice: npt.NDArray[np.float64],
    shape: tuple[int, int],
    tolerance_m: float,
) -> tuple[Rectangles, Mask, int]:
    """Return windows, masks and the number of cells in their union."""
    windows = np.zeros((packed.shape[0], 5), np.int64)
    masks, size, count = [np.zeros((0, 0), np.bool_)], 0, 0
    for i in range(packed.shape[0]):
        row0, col0, mask = covered(packed, i, lattice, shape, tolerance_m)
        windows[i, 0], windows[i, 1] = row0, col0
        windows[i, 2], windows[i, 3], windows[i, 4] = mask.shape[0], mask.shape[1], size
        masks.append(mask)
        size += mask.size
    cells = np.zeros(size, np.bool_)
    for i in range(packed.shape[0]):
        _copy(masks[i + 1].reshape(-1), cells[windows[i, 4] :])
    is_covered = np.zeros(shape, np.bool_)
    for i in range(packed.shape[0]):
        row0, col0, mask = windows[i, 0], windows[i, 1], masks[i + 1]
        for row in range(mask.shape[0]):
            count += _cover_more(mask[row], is_covered[row0 + row, col0 : col0 + mask.shape[1]])
    return windows, cells, count


# Loops over whole arrays: with an offset to the index the compiler makes no vector instructions.


@compiled
def _copy(cells: Mask, to: Mask) -> None:
    for k in range(cells.size):
        to[k] = cells[k]


@compiled
def _cover_more(cells: Mask, is_covered: Mask) -> int:
    """Mark cells (K,) as covered, and return how many of them were not."""
    number = 0
    for k in range(cells.size):
        number += cells[k] and not is_covered[k]
        is_covered[k] |= cells[k]
    return number


@dataclass(frozen=True)
class PatchChanges:
    """Patches that left their place, that came to one, and that stayed."""

    vacated: tuple[CellPatch, ...]
    arrived: tuple[CellPatch, ...]
    standing: tuple[CellPatch, ...]

    def to_stamp(self, margin_cells: int, shape: tuple[int, int]) -> list[CellPatch]:
        """Return the patches to write once the vacated places are restored.

        Those that arrived, and those that stood by and lost cells, each widened by the margin.
        """
        vacated = rectangles(self.vacated, margin_cells, shape)
        bared = meeting(rectangles(self.standing, margin_cells, shape), vacated)
        return [*self.arrived, *compress(self.standing, bared)]


def patch_changes(before: Mapping[int, CellPatch], now: Mapping[int, CellPatch]) -> PatchChanges:
    """Return how the patches of now, by artefact id, differ from those before."""
    standing = {i for i, patch in now.items() if before.get(i) == patch}
    return PatchChanges(
        vacated=tuple(patch for i, patch in before.items() if i not in standing),
        arrived=tuple(patch for i, patch in now.items() if i not in standing),
        standing=tuple(now[i] for i in now if i in standing),
    )


def rectangles(
    patches: Iterable[CellPatch], margin_cells: int, shape: tuple[int, int]
) -> Rectangles:
    """Return int64 (N, 4): row0, col0, row1, col1 (half-open) of each patch widened by the margin.

    Clipped to a grid of `shape` (h, w); a patch outside of it gives an empty rectangle.
    """
    margin = margin_cells
    widened = [
        (row0 - margin, col0 - margin, row0 + rows + margin, col0 + cols + margin)
        for row0, col0, ((rows, cols), _) in patches
    ]
    corners = np.array(widened, np.int64).reshape(-1, 4)
    return np.minimum(np.maximum(corners, 0), (*shape, *shape))  # np.clip takes twice as long


def meeting(ours: Rectangles, theirs: Rectangles) -> Mask:
    """Return for each of our rectangles (N, 4) whether it shares a cell with one of theirs."""
    low = np.maximum(ours[:, None, :2], theirs[:, :2])
    high = np.minimum(ours[:, None, 2:], theirs[:, 2:])
    shares = np.logical_and.reduce(high > low, axis=2)
    met: Mask = np.logical_or.reduce(shares, axis=1)
    return met
