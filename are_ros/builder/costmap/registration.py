"""Registration of an artefact: the cells of M2D that its footprint covers (section 3.3)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from are_ros.world.boxes import TOUCH_TOLERANCE_M, OrientedBoxes
from are_ros.world.lattice_cover import count_new, covered, lattice_row
from are_ros.world.occupancy_grid import CellClasses, OccupancyGrid


@dataclass(frozen=True, eq=False)
class CellPatch:
    """The cells of a grid that one artefact covers: `mask` bool (r, c), read-only.

    `mask[0, 0]` is the cell (row0, col0); all lies inside the grid. An artefact wholly outside
    has an empty mask.
    """

    row0: int
    col0: int
    mask: NDArray[np.bool_]

    def __post_init__(self) -> None:
        self.mask.flags.writeable = False

    @property
    def window(self) -> tuple[slice, slice]:
        """The slices (rows, columns) of the grid that the mask lies on."""
        rows, columns = self.mask.shape
        return slice(self.row0, self.row0 + rows), slice(self.col0, self.col0 + columns)


def covered_cells(boxes: OrientedBoxes, grid: OccupancyGrid) -> tuple[CellPatch, ...]:
    """Return for each box the cells that the projection of the box covers, clipped to the grid.

    A cell is covered if its open square meets the open footprint: a footprint that ends on a
    cell's edge does not cover the next cell. Against rounding, the footprint is shrunk by
    `TOUCH_TOLERANCE_M` on each side; one without area covers the cell that holds it.
    """
    lattice = lattice_row(grid.origin, grid.resolution_m, grid.resolution_m)
    shape = (grid.height, grid.width)
    return tuple(
        CellPatch(*covered(boxes.packed, i, lattice, shape, TOUCH_TOLERANCE_M))
        for i in range(len(boxes))
    )


def covered_count(patches: Sequence[CellPatch]) -> int:
    """Return n_A, the number of cells in the union of patches of one grid."""
    patches = [patch for patch in patches if patch.mask.size]
    if not patches:
        return 0
    rows = max(patch.window[0].stop for patch in patches)
    columns = max(patch.window[1].stop for patch in patches)
    is_counted = np.zeros((rows, columns), dtype=np.bool_)
    count = 0
    for patch in patches:
        count += count_new(patch.mask, patch.row0, patch.col0, is_counted)
    return count


def clutter_ratio(patches: Sequence[CellPatch], classes: CellClasses) -> float:
    """Return nu = n_A / n_free (Eq. 4): all artefacts' cells over the real map's free ones.

    NaN where the map has no free cell.
    """
    free = classes.free_count
    return covered_count(patches) / free if free else float("nan")
