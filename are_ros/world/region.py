"""Where artefacts may arrive: the reachable free space, all free space, or weighted zones."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from are_ros.errors import ParameterError
from are_ros.parameters.choices import Region
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.zones import Zones, polygon_mask, zone_weights

SNAP_M: Final = 1.0
"""How far from the robot its component is looked for when it stands in none."""
_ROUNDING: Final = 1e-3
_KEPT_REGIONS: Final = 8

_Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class SpawnRegion:
    """The cells where artefacts may arrive, in the grid that it was made for.

    `mask` is bool (height, width), read-only. `weight` is None (1 everywhere) or float32 (height,
    width), read-only, the relative density, 0 outside the mask. `area_m2` is the effective area
    nu(M2D): the sum of weight * cell area over the mask.
    """

    mask: npt.NDArray[np.bool_]
    weight: npt.NDArray[np.float32] | None
    area_m2: float

    def __post_init__(self) -> None:
        self.mask.flags.writeable = False
        if self.weight is not None:
            self.weight.flags.writeable = False


class RegionFinder(Protocol):
    """Gives the spawn region of one map; the same object again as long as it is the same.

    `last_point_m` is the last point of the robot that decided on a region, None if none did.
    """

    last_point_m: tuple[float, float] | None

    def at(self, robot_point_m: tuple[float, float] | None) -> SpawnRegion:
        """Return the region while the robot is at (x, y) in the map frame (None: unknown)."""


class FixedRegion:
    """A region that does not depend on the robot."""

    def __init__(self, region: SpawnRegion) -> None:
        self.last_point_m: tuple[float, float] | None = None
        self._region = region

    def at(self, robot_point_m: tuple[float, float] | None) -> SpawnRegion:  # noqa: ARG002 - as the others
        """Return the region."""
        return self._region


class ReachableRegion:
    """The free cells that the robot, a disc of its inscribed radius, can cover by driving.

    Free space eroded by the radius falls into 4-connected components, labelled once per map. The
    robot's component is the one that it stands in, else that of the nearest eroded cell within
    `snap_m`; grown back by the radius within free space, it is the region. Where there is none,
    or the pose is unknown, the last region stays; before the first, the region of `last_point_m`
    (of an earlier map) is tried, and else it is empty, area 0.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        free: npt.NDArray[np.bool_],
        clearance_m: npt.NDArray[np.floating],
        robot_radius_m: float,
        *,
        no_spawn: npt.NDArray[np.bool_] | None = None,
        snap_m: float = SNAP_M,
        last_point_m: tuple[float, float] | None = None,
    ) -> None:
        """Label the map: `free` bool, `clearance_m` [m] to the nearest cell that is not free."""
        import cv2

        eroded = free & (clearance_m >= robot_radius_m - _ROUNDING * grid.resolution_m)
        self._grid = grid
        self._free = free
        self._no_spawn = no_spawn
        self._radius_cells = robot_radius_m / grid.resolution_m
        self._snap_cells = snap_m / grid.resolution_m
        self._labels: npt.NDArray[np.int32] = cv2.connectedComponents(
            eroded.view(np.uint8), connectivity=4, ltype=cv2.CV_32S
        )[1]
        # A robot between two components goes to and fro: the regions last used stay as they are.
        self._region_of_label = lru_cache(maxsize=_KEPT_REGIONS)(self._region_made_for)
        self._region = _region_of(np.zeros(free.shape, np.bool_), grid)
        self.last_point_m: tuple[float, float] | None = None
        self.at(last_point_m)

    def at(self, robot_point_m: tuple[float, float] | None) -> SpawnRegion:
        """Return the region of the robot's component, the same object again for the same one."""
        label = 0 if robot_point_m is None else self._label_near(robot_point_m)
        if label:
            self.last_point_m = robot_point_m
            self._region = self._region_of_label(label)
        return self._region

    def _region_made_for(self, label: int) -> SpawnRegion:
        return _region_of(_without(self._grown(label), self._no_spawn), self._grid)

    def _label_near(self, point_m: tuple[float, float]) -> int:
        inside = self._grid.cell_at(*point_m)
        if inside is not None and (label := int(self._labels[inside])):
            return label
        cell = self._grid.points_to_cells(np.array([point_m]))
        row, col = (int(index) for index in cell[0])
        return _nearest_label(self._labels, row, col, self._snap_cells)

    def _grown(self, label: int) -> npt.NDArray[np.bool_]:
        import cv2

        window = _window_of(self._labels == label, math.ceil(self._radius_cells) + 1)
        outside = (self._labels[window] != label).view(np.uint8)
        distance = cv2.distanceTransform(outside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        grown = np.zeros(self._free.shape, np.bool_)
        grown[window] = self._free[window] & (distance <= self._radius_cells + _ROUNDING)
        return grown


def region_finder(
    kind: Region,
    grid: OccupancyGrid,
    free: npt.NDArray[np.bool_],
    clearance_m: npt.NDArray[np.floating],
    robot_radius_m: float,
    *,
    zones: Zones | None = None,
    last_point_m: tuple[float, float] | None = None,
) -> RegionFinder:
    """Return the finder of `kind` for one map; no-spawn polygons act on every kind.

    Raises `ParameterError` if the kind is zones and no zone is given.
    """
    zones = zones or Zones()
    no_spawn = _union(zones.no_spawn, grid)
    if kind is Region.REACHABLE:
        return ReachableRegion(
            grid,
            free,
            clearance_m,
            robot_radius_m,
            no_spawn=no_spawn,
            last_point_m=last_point_m,
        )
    allowed = _without(free, no_spawn)
    if kind is Region.FREE:
        return FixedRegion(_region_of(allowed, grid))
    return FixedRegion(_zones_region(zones, allowed, grid))


def _zones_region(zones: Zones, allowed: _Mask, grid: OccupancyGrid) -> SpawnRegion:
    if not zones.zones:
        raise ParameterError(
            "population.region is zones, but population.zones names no file that lists any zone"
        )
    weight = zone_weights(zones.zones, grid)
    weight[~allowed] = 0.0
    area_m2 = float(weight.sum(dtype=np.float64)) * grid.cell_area_m2
    return SpawnRegion(weight > 0.0, weight, area_m2)


def _region_of(mask: _Mask, grid: OccupancyGrid) -> SpawnRegion:
    return SpawnRegion(mask, None, int(np.count_nonzero(mask)) * grid.cell_area_m2)


def _union(polygons_m: tuple[npt.NDArray[np.float64], ...], grid: OccupancyGrid) -> _Mask | None:
    masks = [polygon_mask(polygon_m, grid) for polygon_m in polygons_m]
    return np.logical_or.reduce(masks) if masks else None


def _without(mask: _Mask, removed: _Mask | None) -> _Mask:
    return mask.copy() if removed is None else mask & ~removed


def _nearest_label(labels: npt.NDArray[np.int32], row: int, col: int, reach_cells: float) -> int:
    """Return the label of the nearest labelled cell within reach (of several the first), or 0."""
    reach = math.floor(reach_cells)
    top, left = max(row - reach, 0), max(col - reach, 0)
    window = labels[top : max(row + reach + 1, 0), left : max(col + reach + 1, 0)]
    rows, cols = np.nonzero(window)
    squared = (rows + (top - row)) ** 2 + (cols + (left - col)) ** 2
    if not squared.size or squared.min() > reach_cells**2:
        return 0
    nearest = int(np.argmin(squared))
    return int(window[rows[nearest], cols[nearest]])


def _window_of(mask: _Mask, margin: int) -> tuple[slice, slice]:
    """Return the smallest window that holds the mask's cells and `margin` more on every side."""
    rows, cols = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return (
        slice(max(int(rows[0]) - margin, 0), int(rows[-1]) + margin + 1),
        slice(max(int(cols[0]) - margin, 0), int(cols[-1]) + margin + 1),
    )
