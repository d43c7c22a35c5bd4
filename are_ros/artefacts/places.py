"""Destinations of artefacts: open points of a map, well spread, and its exits."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.world.occupancy_grid import OccupancyGrid

AREA_OF_ONE_M2: Final = 25.0
FEWEST: Final = 4
MOST: Final = 400
_BLOCK_M: Final = 1.0
_DRAWN: Final = 40
"""The next place is the farthest of so many."""
_SPREAD_SEED: Final = 0

_ROUNDING: Final = 1e-3

_Mask = npt.NDArray[np.bool_]
_Field = npt.NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Destinations:
    """Points of the map frame [m], read-only: float64 (K, 2) destinations and (E, 2) exits.

    Either may be empty.
    """

    destinations_m: npt.NDArray[np.float64]
    exits_m: npt.NDArray[np.float64]

    def __post_init__(self) -> None:
        self.destinations_m.flags.writeable = False
        self.exits_m.flags.writeable = False


def destinations_in(
    grid: OccupancyGrid,
    region: npt.NDArray[np.bool_],
    clearance_m: npt.NDArray[np.floating],
    *,
    radius_m: float = 0.35,
    exits_m: npt.NDArray[np.float64] | None = None,
) -> Destinations:
    """Return the places of a map for bodies that need `radius_m` about them.

    `region` bool and `clearance_m` [m] from what is not free are (height, width). Destinations are
    the cells of most clearance of one block each of about a square metre, spread by
    best-candidate sampling: one per 25 m^2 of where the body fits, at least 4 and at most 400, as
    far as there are so many blocks. The same map gives the same places; its origin moves and turns
    them only. `exits_m` (E, 2) are taken as they are, None: there are none.
    """
    fits = region & (clearance_m >= radius_m - _ROUNDING * grid.resolution_m)
    candidates, room_m = _block_maxima(fits, clearance_m, grid.resolution_m)
    area_m2 = float(np.count_nonzero(fits)) * grid.cell_area_m2
    count = min(max(math.ceil(area_m2 / AREA_OF_ONE_M2), FEWEST), MOST, len(candidates))
    chosen = candidates[_spread(candidates, room_m, count)]
    exits_m = np.empty((0, 2)) if exits_m is None else exits_m
    return Destinations(grid.cells_to_points(chosen), exits_m)


def _block_maxima(
    fits: _Mask, clearance_m: _Field, resolution_m: float
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float32]]:
    """Return the cell (row, col) of most clearance of each block that has any, and how much."""
    side = max(round(_BLOCK_M / resolution_m), 1)
    height, width = fits.shape
    rows, cols = -(-height // side), -(-width // side)
    field = np.full((rows * side, cols * side), -1.0, np.float32)
    field[:height, :width][fits] = clearance_m[fits]
    blocks = field.reshape(rows, side, cols, side).swapaxes(1, 2).reshape(rows, cols, side * side)
    best = blocks.argmax(axis=2)
    most = np.take_along_axis(blocks, best[:, :, None], axis=2)[:, :, 0]
    row, col = np.nonzero(most >= 0.0)
    within = best[row, col]
    cells = np.column_stack((row * side + within // side, col * side + within % side))
    return cells.astype(np.int64), most[row, col]


def _spread(
    cells: npt.NDArray[np.int64], room_m: npt.NDArray[np.float32], count: int
) -> npt.NDArray[np.int64]:
    """Return indices of `count` cells: the roomiest, then each time one that is far from all.

    It is the farthest of some that are drawn, always alike: the farthest of all would make a
    lattice on open ground, and trips along its axes.
    """
    random = np.random.Generator(np.random.PCG64(_SPREAD_SEED))
    chosen = np.zeros(count, np.int64)
    if not count:
        return chosen
    chosen[0] = room_m.argmax()
    nearest = ((cells - cells[chosen[0]]) ** 2).sum(axis=1)
    for number in range(1, count):
        drawn = random.integers(len(cells), size=_DRAWN)
        best = drawn[nearest[drawn].argmax()]
        chosen[number] = best if nearest[best] else nearest.argmax()
        np.minimum(nearest, ((cells - cells[chosen[number]]) ** 2).sum(axis=1), out=nearest)
    return chosen
