"""The augmented costmap against an inflation of our own: scipy's distances and Nav2's formula."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from are_ros.checks.oracle import Outline
from are_ros.checks.oracle_solids import Cover, RealMap
from are_ros.parameters.model import Parameters

Published = NDArray[np.int8]
Mask = NDArray[np.bool_]

_SLACK: Final = 3e-7
"""Relative, for resolutions of single precision: 14 cells of 0.05 m may be 0.7 m or more."""


class Inflation:
    """The costs that a costmap may have, as Nav2 publishes them: between a low and a high one.

    They differ by rounding, and about cells that a box only touches. -1, unknown, is the lowest.
    """

    def __init__(self, real: RealMap, parameters: Parameters) -> None:
        settings, robot = parameters.costmap, parameters.robot
        self.real = real
        self._radius = int(np.ceil(settings.inflation_radius / real.resolution_m * (1.0 + _SLACK)))
        self._radius = min(self._radius, sum(real.cells.shape))
        distances_m = np.sqrt(np.arange((self._radius + 2) ** 2)) * real.resolution_m
        inscribed_m = Outline.of(robot.footprint, robot.radius).inscribed_m()
        self._low, self._high = (
            _costs(
                distances_m * slack,
                settings.inflation_radius,
                settings.cost_scaling_factor,
                inscribed_m,
            )
            for slack in (1.0 + _SLACK, 1.0 - _SLACK)
        )
        thresholds = parameters.world
        occupied = real.cells >= thresholds.occupied_threshold
        self._unknown = ~occupied & ((real.cells < 0) | (real.cells > thresholds.free_threshold))
        squares = self._squares(occupied)
        everywhere = (slice(None), slice(None))
        self.static_low = self._published(self._low[squares], everywhere)
        self.static_high = self._published(self._high[squares], everywhere)
        self._patches: dict[int, _Patch] = {}

    def bounds(self, covers: list[Cover]) -> tuple[Published, Published]:
        """Return the least and the greatest costmap, int8 (h, w), of the map with these cells."""
        low, high = self.static_low.copy(), self.static_high.copy()
        before, self._patches = self._patches, {}
        for cover in covers:
            known = before.get(id(cover))
            patch = self._patch(cover) if known is None else known
            self._patches[id(cover)] = patch
            np.maximum(low[patch.window], patch.low, out=low[patch.window])
            np.maximum(high[patch.window], patch.high, out=high[patch.window])
        return low, high

    def _patch(self, cover: Cover) -> "_Patch":
        both = np.concatenate((cover.sure, cover.touched))
        if not both.size:
            nothing = (slice(0, 0), slice(0, 0))
            return _Patch(cover, nothing, self.static_low[nothing], self.static_low[nothing])
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
        return _Patch(cover, window, low, high)

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


class _Patch:
    """The costs about one box; the cover is kept, so that its identity is not given away."""

    def __init__(
        self, cover: Cover, window: tuple[slice, slice], low: Published, high: Published
    ) -> None:
        self.cover = cover
        self.window = window
        self.low = low
        self.high = high


def _costs(
    distances_m: NDArray[np.float64], radius_m: float, factor: float, inscribed_m: float
) -> NDArray[np.int64]:
    """Return Nav2's costs at distances, int64; the last is beyond the radius."""
    beyond_m = np.maximum(distances_m - inscribed_m, 0.0)
    costs = np.floor(252.0 * np.exp(-factor * beyond_m)).astype(np.int64)
    costs[distances_m <= inscribed_m] = 253
    costs[distances_m > radius_m] = 0
    costs[distances_m == 0.0] = 254
    return costs
