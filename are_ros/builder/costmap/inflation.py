"""The augmented costmap (section 3.3): Nav2's inflation, on exact distances between cells."""

import math
from collections.abc import Iterable
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder.costmap.registration import CellPatch, MaskKey, PatchChanges, rectangles
from are_ros.conventions import OCCUPIED, UNKNOWN

Costs = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]
Distances = npt.NDArray[np.unsignedinteger]

NARROW_RADIUS_CELLS: Final = 180
"""The widest reach r whose squared distances, at most (r + 1)^2 + r^2, fit in 16 bits."""

BLOCK_CELLS: Final = 4096
"""How much of a narrow patch is swept at a time: what a first-level cache holds with ease."""


def table_size(radius_cells: int) -> int:
    """Return how many squared distances [cells^2] `inflated` can ask a table of costs for."""
    return (radius_cells + 1) ** 2 + radius_cells**2 + 1


def inflated(mask: Mask, cost_of_d2: Costs, radius_cells: int, margin_cells: int) -> Costs:
    """Return the inflated costs of a mask (h, w), uint8 (h + 2 margin, w + 2 margin).

    `cost_of_d2[d2]` is the cost of a cell whose centre lies the square root of d2 cells from the
    nearest centre in the mask; it has `table_size(radius_cells)` entries, and those from
    (radius + 1)^2 on are 0. Exact: integers throughout, no approximation of the distance.
    """
    if mask.size == 0 and margin_cells == 0:
        return np.zeros(mask.shape, np.uint8)
    number = np.uint16 if radius_cells <= NARROW_RADIUS_CELLS else np.uint32
    height, width = mask.shape
    vertical = np.full((height + 2 * margin_cells, width), radius_cells + 1, number)
    vertical[margin_cells : margin_cells + height][mask] = 0
    return _inflate(vertical, cost_of_d2, radius_cells, margin_cells)


@compiled
def _inflate(vertical: Distances, cost_of_d2: Costs, radius: int, margin: int) -> Costs:
    """Return the costs: distances along columns, down and up, then along rows, block by block.

    `vertical` is 0 in the mask and radius + 1 elsewhere: a distance above the radius counts as
    that, so that squares fit in its integers. It is overwritten. The rows of a block lie in one
    line, with `radius` cells of padding before, between and after them.
    """
    costs = np.zeros((vertical.shape[0], vertical.shape[1] + 2 * margin), np.uint8)
    stride = costs.shape[1] + radius
    rows = min(max(BLOCK_CELLS // max(stride, 1), 1), costs.shape[0])
    line = np.full(rows * stride + radius, (radius + 1) * (radius + 1), vertical.dtype)
    nearest = np.empty(rows * stride, vertical.dtype)
    for r in range(1, vertical.shape[0]):
        _step_along_columns(vertical[r], vertical[r - 1])
    for r in range(vertical.shape[0] - 1, -1, -1):
        if r + 1 < vertical.shape[0]:
            _step_along_columns(vertical[r], vertical[r + 1])
        if r % rows == 0:
            block = vertical[r : r + rows]
            if _square(block, radius, line[radius + margin :], stride):
                _least_in_window(line, radius, nearest)
                for row in range(block.shape[0]):
                    for c in range(costs.shape[1]):
                        costs[r + row, c] = cost_of_d2[nearest[row * stride + c]]
    return costs


@compiled
def _step_along_columns(here: Distances, beside: Distances) -> None:
    """Lower each distance of a row to at most one more than that of the row beside it."""
    for c in range(here.shape[0]):
        here[c] = min(here[c], here.dtype.type(beside[c] + 1))


@compiled
def _square(distances: Distances, radius: int, line: Distances, stride: int) -> bool:
    """Write the squares of a block of rows; return whether any distance is within the radius."""
    least = radius + 1
    for r in range(distances.shape[0]):
        here = distances[r]
        squares = line[r * stride : r * stride + here.shape[0]]
        for c in range(here.shape[0]):
            squares[c] = here[c] * here[c]
            least = min(least, here[c])
    return least <= radius


@compiled
def _least_in_window(line: Distances, radius: int, nearest: Distances) -> None:
    """Fill with the least line[c + k] + k^2 over |k| <= radius; `line` is padded by the radius.

    One offset at a time: each pass is a long minimum in narrow integers, 16 or 32 to a vector
    instruction, which beats the lower envelope of parabolas (fewer steps, none of them in vectors).
    """
    width = nearest.shape[0]
    for c in range(width):
        nearest[c] = line[radius + c]
    for k in range(1, radius + 1):
        left = line[radius - k : radius - k + width]
        right = line[radius + k : radius + k + width]
        k2 = line.dtype.type(k * k)
        for c in range(width):
            nearest[c] = min(nearest[c], line.dtype.type(min(left[c], right[c]) + k2))


Published = npt.NDArray[np.int8]
Rectangles = npt.NDArray[np.int64]

INSCRIBED: Final = 253
NO_INFORMATION: Final = 255


def restore(costs: Costs, static: Costs, places: Rectangles) -> None:
    """Copy the static layer into rectangles (N, 4) of row0, col0, row1, col1 (half-open)."""
    for row0, col0, row1, col1 in places.tolist():
        costs[row0:row1, col0:col1] = static[row0:row1, col0:col1]


@compiled
def stamp(costs: Costs, patch: Costs, row0: int, col0: int) -> None:
    """Raise the costs to an inflated patch whose first cell is (row0, col0), perhaps outside.

    An unknown cell, 255, already is the maximum; only an inscribed or lethal cost replaces it.
    """
    first_row, first_col = max(row0, 0), max(col0, 0)
    last_col = min(col0 + patch.shape[1], costs.shape[1])
    for r in range(first_row, min(row0 + patch.shape[0], costs.shape[0])):
        here = costs[r, first_col:last_col]
        there = patch[r - row0, first_col - col0 :]
        for c in range(here.shape[0]):
            highest = max(here[c], there[c])
            overrides = here[c] == NO_INFORMATION and there[c] >= INSCRIBED
            here[c] = there[c] if overrides else highest


@compiled
def publish(costs: Costs, scaled: Published, published: Published, places: Rectangles) -> bool:
    """Write `scaled[cost]` (256,) into rectangles (N, 4); return whether a byte changed."""
    difference = np.int8(0)
    for i in range(places.shape[0]):
        for r in range(places[i, 0], places[i, 2]):
            before = published[r, places[i, 1] : places[i, 3]]
            now = costs[r, places[i, 1] : places[i, 3]]
            for c in range(now.shape[0]):
                value = scaled[now[c]]
                difference |= value ^ before[c]
                before[c] = value
    return bool(difference != 0)


LETHAL: Final = 254
ROUNDING: Final = 1e-9
"""Relative slack when distances are compared: 14 cells of 0.05 m are within 0.70 m."""


class InflatedCostmap:
    """The real map and the artefacts' cells, inflated as Nav2's InflationLayer would.

    A cell at distance d [m] from the nearest obstacle cell, centre to centre, costs 254 at d = 0,
    253 up to `inscribed_radius_m`, else floor(252 exp(-k (d - inscribed))) up to
    `inflation_radius_m`, k = `cost_scaling_factor` [1/m], and 0 further off. An unknown cell stays
    NO_INFORMATION (255) unless its cost is at least 253 (`inflate_unknown: false`). Nav2 itself
    rounds the radius up to whole cells, and its distances are not always exact.

    The cost falls with distance, so the maximum over the static layer and one patch per artefact is
    the inflation of all obstacles together; an update touches only the patches that moved.
    Before the first map it has no cells.
    """

    def __init__(
        self, inflation_radius_m: float, cost_scaling_factor: float, inscribed_radius_m: float
    ) -> None:
        self._inflation_radius_m = inflation_radius_m
        self._cost_scaling_factor = cost_scaling_factor
        self._inscribed_radius_m = inscribed_radius_m
        self._scaled = published_by_cost()
        self.set_map(np.zeros((0, 0), np.bool_), np.zeros((0, 0), np.bool_), 1.0)

    def set_map(self, occupied: Mask, unknown: Mask, resolution_m: float) -> None:
        """Inflate a new real map: bool (h, w) both, `resolution_m` the side of a cell [m].

        The artefacts are gone until the next update, which reports a change.
        """
        self._radius_cells, self._cost_of_d2 = self._table(resolution_m, sum(occupied.shape))
        self._static = inflated(occupied, self._cost_of_d2, self._radius_cells, 0)
        self._static[unknown & (self._static < INSCRIBED)] = NO_INFORMATION
        self._costs = self._static.copy()
        self._published = self._scaled[self._costs]
        self._inflated: dict[MaskKey, Costs] = {}
        self._is_new = True

    def _table(self, resolution_m: float, widest_cells: int) -> tuple[int, Costs]:
        """Return the reach in cells, and the cost at each squared distance in cells^2."""
        reach_m = self._inflation_radius_m * (1.0 + ROUNDING)
        radius_cells = math.floor(min(reach_m / resolution_m, widest_cells))
        d2 = np.arange(table_size(radius_cells))
        distances_m = np.sqrt(d2) * resolution_m
        is_within = (distances_m <= reach_m) & (d2 < (radius_cells + 1) ** 2)
        costs = inflation_costs(distances_m, self._cost_scaling_factor, self._inscribed_radius_m)
        return radius_cells, np.where(is_within, costs, np.uint8(0))

    def update(self, changes: PatchChanges) -> bool:
        """Take how the artefacts' cells changed; return whether a published byte did.

        Patches may overlap each other, walls and unknown cells. The first update after a map
        returns True.
        """
        margin, shape = self._radius_cells, (self._costs.shape[0], self._costs.shape[1])
        vacated = rectangles(changes.vacated, margin, shape)
        entered = rectangles(changes.arrived, margin, shape)
        self._inflate_masks((*changes.arrived, *changes.standing))
        restore(self._costs, self._static, vacated)
        for each in changes.to_stamp(margin, shape):
            patch = self._inflated[each.key]
            stamp(self._costs, patch, each.row0 - margin, each.col0 - margin)
        places = np.concatenate((vacated, entered))
        changed = publish(self._costs, self._scaled, self._published, places)
        was_new, self._is_new = self._is_new, False
        return changed or was_new

    def _inflate_masks(self, placed: Iterable[CellPatch]) -> None:
        """Inflate each mask that was not there before; keep only those that are in use."""
        before, self._inflated = self._inflated, {}
        for each in placed:
            costs = before.get(each.key)
            if costs is None:
                margin = self._radius_cells
                costs = inflated(each.mask, self._cost_of_d2, margin, margin)
            self._inflated[each.key] = before[each.key] = costs

    @property
    def costs(self) -> Costs:
        """Nav2's costs, uint8 (h, w): a read-only view that the next update changes in place."""
        view: Costs = self._costs.view()
        view.flags.writeable = False
        return view

    def published(self) -> Published:
        """Return what Nav2 would publish, int8 (h, w): -1 unknown, 0 free, 1..98, 99, 100.

        A read-only view that the next update changes in place: copy it to keep it.
        """
        view: Published = self._published.view()
        view.flags.writeable = False
        return view


def inflation_costs(
    distances_m: npt.NDArray[np.float64], cost_scaling_factor: float, inscribed_radius_m: float
) -> Costs:
    """Return Nav2's cost at distances [m] to the nearest obstacle cell, any shape, uint8."""
    beyond_m = np.maximum(distances_m - inscribed_radius_m, 0.0)
    costs = np.floor(252.0 * np.exp(-cost_scaling_factor * beyond_m)).astype(np.uint8)
    costs[distances_m <= inscribed_radius_m * (1.0 + ROUNDING)] = INSCRIBED
    costs[distances_m == 0.0] = LETHAL
    return costs


def published_by_cost() -> Published:
    """Return the occupancy value that Nav2's Costmap2DPublisher gives each cost, int8 (256,)."""
    costs = np.arange(256)
    scaled = (1 + (97 * (costs - 1)) // 251).astype(np.int8)
    scaled[0] = 0
    scaled[INSCRIBED], scaled[LETHAL], scaled[NO_INFORMATION] = OCCUPIED - 1, OCCUPIED, UNKNOWN
    return scaled
