"""The cells where an artefact may be put, in an order that serves every footprint at once."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled

_LEVELS_PER_CELL: Final = 4
_HIGHEST_LEVEL: Final = 2**16 - 1
_SLACK_CELLS: Final = math.sqrt(0.5) - 0.5 + 1e-3
"""A disc about any point of a cell, clear of all squares that are not free, may be wider by this
than the clearance between the cells' centres: half a diagonal less half an edge, and rounding."""


@dataclass(frozen=True, eq=False)
class CandidateCells:
    """Cells in descending order of clearance: those with room for a disc are a prefix.

    `flat` is int32 (N,), row * width + col. `depths` is uint16 (N,), ascending: how many quarters
    of a cell the clearance, rounded down, falls short of the highest that is told apart.
    `cumulative` is None or float64 (N,), the running sum of the cells' weights.
    """

    flat: npt.NDArray[np.int32]
    depths: npt.NDArray[np.uint16]
    cumulative: npt.NDArray[np.float64] | None

    @classmethod
    def ordered(
        cls,
        flat: npt.NDArray[np.int32],
        clearance_cells: npt.NDArray[np.float32],
        weights: npt.NDArray[np.float64] | None,
    ) -> "CandidateCells":
        """Order cells (N,) with their clearance in cells (N,) and their weights (N,)."""
        depths = _depths(clearance_cells)
        order = _order(depths)
        cumulative = None if weights is None else np.cumsum(weights[order])
        return cls(flat[order], depths[order], cumulative)

    def with_room(self, radius_cells: float) -> "CandidateCells":
        """Keep the cells that hold a point about which a disc may be clear (a superset)."""
        level = math.floor(needed_cells(radius_cells) * _LEVELS_PER_CELL)
        depth = np.uint16(min(max(_HIGHEST_LEVEL - level, 0), _HIGHEST_LEVEL))
        count = int(np.searchsorted(self.depths, depth, side="right"))
        cumulative = None if self.cumulative is None else self.cumulative[:count]
        return CandidateCells(self.flat[:count], self.depths[:count], cumulative)

    def draw(self, uniforms: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
        """Return the cells (n,) that uniform numbers (n,) in [0, 1) choose by weight."""
        if self.cumulative is None:
            chosen = (uniforms * len(self.flat)).astype(np.int64)
        else:
            sought = uniforms * self.cumulative[-1]
            chosen = np.searchsorted(self.cumulative, sought, side="right")
        return self.flat[np.minimum(chosen, len(self.flat) - 1)].astype(np.int64)


@compiled
def _depths(clearance_cells: npt.NDArray[np.float32]) -> npt.NDArray[np.uint16]:
    depths = np.empty(len(clearance_cells), np.uint16)
    for index, clearance in enumerate(clearance_cells):
        depths[index] = _HIGHEST_LEVEL - int(min(clearance * _LEVELS_PER_CELL, _HIGHEST_LEVEL))
    return depths


@compiled
def _order(depths: npt.NDArray[np.uint16]) -> npt.NDArray[np.int32]:
    """Return the stable ascending order, by counting."""
    places = np.zeros(_HIGHEST_LEVEL + 2, np.int64)
    for depth in depths:
        places[depth + 1] += 1
    places = np.cumsum(places)
    order = np.empty(len(depths), np.int32)
    for index, depth in enumerate(depths):
        order[places[depth]] = index
        places[depth] += 1
    return order


@compiled
def poses_in_cells(
    flat: npt.NDArray[np.int64],
    width: int,
    uniforms: npt.NDArray[np.float64],
    lattice: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """Return poses (n, 4), x, y, 0, yaw in the map frame, anywhere in the cells (n,), row * width.

    The columns of `uniforms` (n, 4), in [0, 1), after the first say where in a cell, along its
    rows and columns, and the heading; `lattice` is the grid's row of `lattice_cover`.
    """
    x_m, y_m, cos, sin, cell_m, _ = lattice
    poses = np.zeros((len(flat), 4))
    for k in range(len(flat)):
        along_y_m = (flat[k] // width + uniforms[k, 1]) * cell_m
        along_x_m = (flat[k] % width + uniforms[k, 2]) * cell_m
        poses[k, 0] = x_m + along_x_m * cos - along_y_m * sin
        poses[k, 1] = y_m + along_x_m * sin + along_y_m * cos
        poses[k, 3] = (2.0 * uniforms[k, 3] - 1.0) * np.pi
    return poses


@compiled
def spines_are_clear(
    flat: npt.NDArray[np.int32],
    clearance_cells: npt.NDArray[np.float32],
    spine: npt.NDArray[np.float64],
    turns: npt.NDArray[np.float64],
    needed_cells: float,
) -> npt.NDArray[np.int64]:
    """Return the lattice poses where a box may be clear, as cell * headings + heading.

    A box at the centre of a cell, turned by one of `turns` (H, 2) (cos, sin), is filled by discs
    about the points `spine` (K, 2) [cells]; each needs the clearance. A necessary condition.
    """
    height, width = clearance_cells.shape
    headings = len(turns)
    found = np.empty(len(flat) * headings, np.int64)
    count = 0
    for cell in flat.astype(np.int64):
        row, col = cell // width, cell % width
        for heading in range(headings):
            c, s = turns[heading]
            clear = True
            for x, y in spine:
                i = int(np.floor(row + 0.5 + s * x + c * y))
                j = int(np.floor(col + 0.5 + c * x - s * y))
                inside = 0 <= i < height and 0 <= j < width
                clear = (clearance_cells[i, j] if inside else 0.0) >= needed_cells
                if not clear:
                    break
            if clear:
                found[count] = cell * headings + heading
                count += 1
    return found[:count]


def spine_of(
    half_length: float, half_width: float, offset: tuple[float, float]
) -> tuple[npt.NDArray[np.float64], float]:
    """Return points (K, 2) on a box's long axis, the ends first, and the radius of their discs.

    The discs lie in the box; `offset` is its centre, all lengths are in one unit.
    """
    radius = min(half_length, half_width)
    reach = max(half_length, half_width) - radius
    along = reach * np.array([-1.0, 1.0, 0.0, -0.5, 0.5] if reach > 0.0 else [0.0])
    zeros = np.zeros_like(along)
    points = (along, zeros) if half_length >= half_width else (zeros, along)
    return np.column_stack(points) + offset, radius


def needed_cells(radius_cells: float) -> float:
    """Return the least clearance between centres that leaves room for a disc (a lower bound)."""
    return radius_cells - _SLACK_CELLS
