"""The inflation of a costmap by scipy's distances and Nav2's formula."""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from are_ros.checks.oracle.solids import Cover, RealMap

Published = NDArray[np.int8]
Mask = NDArray[np.bool_]

_SLACK: Final = 3e-7
"""Relative, for resolutions of single precision: 14 cells of 0.05 m may be 0.7 m or more."""


@dataclass(frozen=True)
class Costs:
    """Nav2's cost of a distance: lengths in metres, `scaling` in 1/m."""

    radius_m: float
    scaling: float
    inscribed_m: float

    def at(self, distances_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the costs 0 to 254 at distances from an obstacle; 0 beyond the radius."""
        beyond_m = np.maximum(distances_m - self.inscribed_m, 0.0)
        costs = np.floor(252.0 * np.exp(-self.scaling * beyond_m)).astype(np.int64)
        costs[distances_m <= self.inscribed_m] = 253
        costs[distances_m > self.radius_m] = 0
        costs[distances_m == 0.0] = 254
        return costs


class Inflation:
    """The costmaps, as Nav2 publishes them, that a map with artefacts may have: a low and a high.

    They differ by rounding, and about cells that a box only touches. -1, unknown, is the lowest.
    """

    def __init__(
        self, real: RealMap, costs: Costs, occupied_threshold: int, free_threshold: int
    ) -> None:
        self.real = real
        self._radius = int(np.ceil(costs.radius_m / real.resolution_m * (1.0 + _SLACK)))
        self._radius = min(self._radius, sum(real.cells.shape))
        distances_m = np.sqrt(np.arange((self._radius + 2) ** 2)) * real.resolution_m
        self._low, self._high = (costs.at(distances_m * (1.0 + s)) for s in (_SLACK, -_SLACK))
        self._low[-1] = self._high[-1] = 0  # stands for all that is farther, on a tiny map, too
        occupied = real.cells >= occupied_threshold
        self._unknown = ~occupied & ((real.cells < 0) | (real.cells > free_threshold))
        squares = self._squares(occupied)
        everywhere = (slice(None), slice(None))
        self.static_low = self._published(self._low[squares], everywhere)
        self.static_high = self._published(self._high[squares], everywhere)
        self._patches: dict[Cover, _Patch] = {}

    def bounds(self, covers: list[Cover]) -> tuple[Published, Published]:
        """Return the least and the greatest costmap, int8 (h, w), of the map with these cells."""
        low, high = self.static_low.copy(), self.static_high.copy()
        before, self._patches = self._patches, {}
        for cover in covers:
            patch = before.get(cover) or self._patch(cover)
            self._patches[cover] = patch
            np.maximum(low[patch.window], patch.low, out=low[patch.window])
            np.maximum(high[patch.window], patch.high, out=high[patch.window])
        return low, high

    def _patch(self, cover: Cover) -> "_Patch":
        both = np.concatenate((cover.sure, cover.touched))
        if not both.size:
            nothing = (slice(0, 0), slice(0, 0))
            return _Patch(nothing, self.static_low[nothing], self.static_low[nothing])
        height, width = self.real.cells.shape
        rows, cols = np.divmod(both, width)
        margin = self._radius + 1
        row0, row1 = max(rows.min() - margin, 0), min(rows.max() + margin + 1, height)
        col0, col1 = max(cols.min() - margin, 0), min(cols.max() + margin + 1, width)
        window = (slice(row0, row1), slice(col0, col1))
        mask = np.zeros((row1 - row0, col1 - col0), np.bool_)
        count = len(cover.sure)
        mask[rows[:count] - row0, cols[:count] - col0] = True
        low = self._published(self._low[self._squares(mask)], window)
        mask[rows - row0, cols - col0] = True
        high = self._published(self._high[self._squares(mask)], window)
        return _Patch(window, low, high)

    def _squares(self, mask: Mask) -> NDArray[np.int64]:
        """Return squared distances [cells^2] from the nearest cell of a mask, up to the table."""
        from scipy.ndimage import distance_transform_edt

        last = len(self._low) - 1
        if not mask.any():
            return np.full(mask.shape, last)
        distances = distance_transform_edt(~mask)
        squares: NDArray[np.int64] = np.rint(distances * distances).astype(np.int64)
        return np.minimum(squares, last)

    def _published(self, costs: NDArray[np.int64], window: tuple[slice, slice]) -> Published:
        """Scale as Nav2 does; an unknown cell stays so below the inscribed cost."""
        scaled = np.where(costs > 0, 1 + (97 * (costs - 1)) // 251, 0)
        scaled[costs == 253] = 99
        scaled[costs == 254] = 100
        scaled[self._unknown[window] & (costs < 253)] = -1
        return scaled.astype(np.int8)


class _Patch(NamedTuple):
    """The costs about one box."""

    window: tuple[slice, slice]
    low: Published
    high: Published
