"""The augmented costmap (§3.3): Nav2's inflation, on exact Euclidean distance between cells."""

import math
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder._composition import INSCRIBED, NO_INFORMATION, publish, restore, stamp
from are_ros.builder._inflation import inflated, table_size
from are_ros.builder._patches import MaskKey, PatchLedger, PlacedPatch, rectangles
from are_ros.builder.registration import CellPatch
from are_ros.conventions import OCCUPIED, UNKNOWN
from are_ros.errors import InputError, ParameterError

Costs = npt.NDArray[np.uint8]
Published = npt.NDArray[np.int8]
Mask = npt.NDArray[np.bool_]

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
    ParameterError if a number is negative or not finite. Before the first map it has no cells.
    """

    def __init__(
        self, inflation_radius_m: float, cost_scaling_factor: float, inscribed_radius_m: float
    ) -> None:
        self._inflation_radius_m = _checked("the inflation radius", inflation_radius_m)
        self._cost_scaling_factor = _checked("the cost scaling factor", cost_scaling_factor)
        self._inscribed_radius_m = _checked("the inscribed radius", inscribed_radius_m)
        self._scaled = published_by_cost()
        self.set_map(np.zeros((0, 0), np.bool_), np.zeros((0, 0), np.bool_), 1.0)

    def set_map(self, occupied: Mask, unknown: Mask, resolution_m: float) -> None:
        """Inflate a new real map: bool (h, w) both, `resolution_m` the side of a cell [m].

        The artefacts are gone until the next update, which reports a change. InputError if the
        shapes differ or the resolution is no positive length; the old map stays then.
        """
        if occupied.ndim != 2 or occupied.shape != unknown.shape:
            raise InputError(f"map: masks of shapes {occupied.shape} and {unknown.shape} differ")
        if not 0.0 < resolution_m < math.inf:
            raise InputError(f"map: the resolution {resolution_m} m is no positive length")
        self._radius_cells, self._cost_of_d2 = self._table(resolution_m, sum(occupied.shape))
        self._static = inflated(occupied, self._cost_of_d2, self._radius_cells, 0)
        self._static[unknown & (self._static < INSCRIBED)] = NO_INFORMATION
        self._costs = self._static.copy()
        self._published = self._scaled[self._costs]
        self._ledger, self._inflated = PatchLedger(), dict[MaskKey, Costs]()
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

    def update(self, patches: Mapping[int, CellPatch]) -> bool:
        """Take the artefacts' cells of now, by id; return whether a published byte changed.

        Patches may overlap each other, walls and unknown cells. The first update after a map
        returns True. An artefact that stands still costs one comparison.
        """
        changes, margin = self._ledger.exchange(patches), self._radius_cells
        shape = (self._costs.shape[0], self._costs.shape[1])
        vacated = rectangles(changes.vacated, margin, shape)
        entered = rectangles(changes.arrived, margin, shape)
        self._inflate_masks((*changes.arrived, *changes.standing))
        restore(self._costs, self._static, vacated)
        self._stamp(changes.to_stamp(margin, shape))
        places = np.concatenate((vacated, entered))
        changed = publish(self._costs, self._scaled, self._published, places)
        was_new, self._is_new = self._is_new, False
        return changed or was_new

    def _inflate_masks(self, placed: Iterable[PlacedPatch]) -> None:
        """Inflate each mask that was not there before; keep only those that are in use."""
        before, self._inflated = self._inflated, {}
        for each in placed:
            costs = before.get(each.key)
            if costs is None:
                margin = self._radius_cells
                costs = inflated(each.mask, self._cost_of_d2, margin, margin)
            self._inflated[each.key] = before[each.key] = costs

    def _stamp(self, placed: Iterable[PlacedPatch]) -> None:
        margin = self._radius_cells
        for each in placed:
            patch = self._inflated[each.key]
            stamp(self._costs, patch, each.row0 - margin, each.col0 - margin)

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


def _checked(name: str, value: float) -> float:
    if not 0.0 <= value < math.inf:
        raise ParameterError(f"costmap: {name} {value} is negative or not finite")
    return value
