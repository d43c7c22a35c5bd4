"""Destinations of artefacts: open points of a map, well spread, and its exits."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.agents.mdp.coarse_map import Cell, CoarseMap
from are_ros.agents.neighbours import Neighbourhood
from are_ros.world.occupancy_grid import OccupancyGrid

AREA_OF_ONE_M2: Final = 25.0
FEWEST: Final = 4
MOST: Final = 400
_BODY_M: Final = 0.35
_BLOCK_M: Final = 1.0
_DRAWN: Final = 40
"""The next destination is the farthest of so many drawn ones."""
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

    def nearest_to(self, points_m: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
        """Return the index of the destination nearest to each point (M, 2), int64 (M,).

        There has to be a destination.
        """
        return self._neighbourhood.nearest_to(points_m)

    @cached_property
    def _neighbourhood(self) -> Neighbourhood:
        return Neighbourhood(self.destinations_m)


def destinations_in(
    grid: OccupancyGrid,
    region: npt.NDArray[np.bool_],
    clearance_m: npt.NDArray[np.floating],
    *,
    exits_m: npt.NDArray[np.float64] | None = None,
) -> Destinations:
    """Return the destinations of a map for bodies that need 0.35 m about them.

    `region` bool and `clearance_m` [m] from what is not free are (height, width). Destinations are
    the cells of most clearance of one block each of about a square metre, spread by
    best-candidate sampling: one per 25 m^2 of where the body fits, at least 4 and at most 400, if
    there are so many blocks. The same map gives the same destinations; another origin only moves
    and turns them. `exits_m` (E, 2) is passed on; None means no exits.
    """
    fits = region & (clearance_m >= _BODY_M - _ROUNDING * grid.resolution_m)
    candidates, room_m = _block_maxima(fits, clearance_m, grid.resolution_m)
    area_m2 = float(np.count_nonzero(fits)) * grid.cell_area_m2
    count = min(max(math.ceil(area_m2 / AREA_OF_ONE_M2), FEWEST), MOST, len(candidates))
    chosen = candidates[_spread(candidates, room_m, count)]
    exits_m = np.empty((0, 2)) if exits_m is None else exits_m
    return Destinations(grid.cells_to_points(chosen), exits_m)


def _block_maxima(
    fits: _Mask, clearance_m: _Field, resolution_m: float
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float32]]:
    """Return the cell (row, col) of most clearance in each block, and its clearance."""
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
    """Return indices of `count` cells: first the roomiest, then each time one far from the others.

    That is the farthest of some drawn ones, with a fixed seed: the farthest of all would give a
    lattice on open ground, and trips along its axes.
    """
    random = np.random.Generator(np.random.PCG64(_SPREAD_SEED))
    chosen = np.zeros(count, np.int64)
    if not count:
        return chosen
    chosen[0] = room_m.argmax()
    nearest = np.full(len(cells), np.iinfo(np.int64).max)
    lower_to_squares(nearest, cells, chosen[0])
    for number in range(1, count):
        drawn = random.integers(len(cells), size=_DRAWN)
        best = drawn[nearest[drawn].argmax()]
        chosen[number] = best if nearest[best] else nearest.argmax()
        lower_to_squares(nearest, cells, chosen[number])
    return chosen


@compiled
def lower_to_squares(
    nearest: npt.NDArray[np.int64], cells: npt.NDArray[np.int64], chosen: int
) -> None:
    """Lower each of the numbers (N,) to the squared distance of its cell to the chosen one."""
    for k in range(cells.shape[0]):
        rows, cols = cells[k, 0] - cells[chosen, 0], cells[k, 1] - cells[chosen, 1]
        nearest[k] = min(nearest[k], rows * rows + cols * cols)


# The destinations that one type can reach from a position, on its coarse map.


APART_M: Final = 1.6
"""Least distance of added destinations from the others, so that a trip is at least a metre."""

_Points = npt.NDArray[np.float64]
_Key = tuple[tuple[int, float, float, float], int, float]


class ReachableDestinations:
    """The destinations of one map by connected part of a coarse map; computed on demand."""

    def __init__(self, places: Destinations) -> None:
        self._places = places
        self._known: dict[_Key, Destinations] = {}

    def places_from(
        self, coarse: CoarseMap, point_m: tuple[float, float], spare_m: float = 0.0
    ) -> Destinations:
        """Return the destinations that can be reached from a point of the map frame.

        Each has `spare_m` of room beside the disc of the coarse map, or is moved to the nearest
        point where the disc fits. If there are fewer than `FEWEST`, others are added in the part
        that can be reached, at least `APART_M` apart, if there is room. Exits are those of the map.
        There are none in a part without room for a trip; from outside the map, all are returned.
        """
        cell = coarse.cell_of(*point_m)
        if cell is None:
            return self._places
        key = (coarse.key, int(coarse.components[cell]), spare_m)
        if key not in self._known:
            part = (coarse.components == key[1]) & (coarse.room_m >= spare_m)
            self._known[key] = self._of_part(coarse, part, spare_m)
        return self._known[key]

    def _of_part(self, coarse: CoarseMap, part: _Mask, spare_m: float) -> Destinations:
        points_m = _end_points(coarse, part, spare_m, self._places.destinations_m)
        if len(points_m) < FEWEST:
            points_m = _with_others(coarse.anchors_m[part], coarse.room_m[part], points_m)
        return Destinations(points_m, self._places.exits_m)


def _end_points(coarse: CoarseMap, part: _Mask, spare_m: float, points_m: _Points) -> _Points:
    """Return the end points (N, 2) of ways to those of points (K, 2) in a part (h, w)."""
    found: dict[Cell, tuple[float, float]] = {}
    for x_m, y_m in points_m.tolist():
        cell = coarse.cell_of(x_m, y_m)
        if cell is not None and part[cell] and cell not in found:
            fits = coarse.holds(x_m, y_m, coarse.radius_m + spare_m)
            found[cell] = (x_m, y_m) if fits else coarse.anchor_of(cell)
    return np.array(list(found.values()), np.float64).reshape(-1, 2)


def _with_others(anchors_m: _Points, room_m: npt.NDArray[np.float32], points_m: _Points) -> _Points:
    """Add to points (K, 2) some of the anchors (N, 2) of a part, each the farthest from the others.

    Without points, the first is the anchor with most room. If one point in the middle of a small
    part leaves no room for a second one, the ends of the part replace it.
    """
    if not len(anchors_m):
        return points_m
    if not len(points_m):
        points_m = anchors_m[int(room_m.argmax())][None]
    found_m = _filled_up(anchors_m, points_m)
    if len(found_m) < 2:
        end_m = anchors_m[int(_nearest_m(anchors_m, found_m).argmax())]
        found_m = _filled_up(anchors_m, end_m[None])
    return found_m if len(found_m) > 1 else np.empty((0, 2))


def _filled_up(anchors_m: _Points, points_m: _Points) -> _Points:
    """Fill points (K, 2), K > 0, up to `FEWEST` with anchors (N, 2) far enough apart."""
    while len(points_m) < FEWEST:
        nearest_m = _nearest_m(anchors_m, points_m)
        farthest = int(nearest_m.argmax())
        if nearest_m[farthest] < APART_M:
            break
        points_m = np.vstack((points_m, anchors_m[farthest]))
    return points_m


def _nearest_m(anchors_m: _Points, points_m: _Points) -> npt.NDArray[np.float64]:
    """Return the distances (N,) of anchors (N, 2) from the nearest of the points (K, 2)."""
    offsets_m = anchors_m[:, None] - points_m
    nearest_m: npt.NDArray[np.float64] = np.hypot(offsets_m[..., 0], offsets_m[..., 1]).min(axis=1)
    return nearest_m
