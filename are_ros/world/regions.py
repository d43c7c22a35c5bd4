"""Where artefacts may arrive: reachable or free space, or the weighted zones of a YAML file."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import ParameterError
from are_ros.parameters.choices import Region
from are_ros.world.occupancy_grid import OccupancyGrid, distances_in_cells
from are_ros.world.rigid_transform import in_level_frame
from are_ros.yaml_text import Fields, read_yaml

_LISTS_OF_ZONES: Final = ("zones", "entrances", "exits")
_FILE_FIELDS: Final = ("entrances", "exits", "no_spawn", "zones")
_ZONE_FIELDS: Final = ("name", "polygon", "weight")
_MOST: Final = 1e9
"""The farthest corner [m], and the largest weight, of which the smallest is the inverse."""


@dataclass(frozen=True, eq=False)
class Zone:
    """A polygon where artefacts arrive `weight` (> 0) times as densely as where the weight is 1.

    `polygon_m` is float64 (K >= 3, 2) in the map frame [m], closed by itself, even-odd inside.
    """

    name: str
    polygon_m: npt.NDArray[np.float64]
    weight: float = 1.0


@dataclass(frozen=True, eq=False)
class Zones:
    """The content of a zones file: where artefacts may arrive, never do, come in and go out.

    Where zones overlap their weights add. `no_spawn` holds polygons as in `Zone`; the weight of
    an exit means nothing.
    """

    zones: tuple[Zone, ...] = ()
    no_spawn: tuple[npt.NDArray[np.float64], ...] = ()
    entrances: tuple[Zone, ...] = ()
    exits: tuple[Zone, ...] = ()

    @property
    def ways_in(self) -> tuple[Zone, ...]:
        """The entrances; where none is marked, the zones."""
        return self.entrances or self.zones

    @property
    def ways_out(self) -> tuple[Zone, ...]:
        """The exits; where none is marked, the entrances."""
        return self.exits or self.entrances

    def allowed(self, free: npt.NDArray[np.bool_], grid: OccupancyGrid) -> npt.NDArray[np.bool_]:
        """Return the free cells, bool (height, width), that no polygon of `no_spawn` holds."""
        allowed: npt.NDArray[np.bool_] = free.copy()
        for polygon_m in self.no_spawn:
            allowed[polygon_mask(polygon_m, grid)] = False
        return allowed


def read_zones_file(path: Path) -> Zones:
    """Read `zones: [{name, polygon: [[x, y], ...], weight}]` and `no_spawn: [[[x, y], ...]]`.

    `entrances` and `exits` are lists as `zones` is. Each list may be left out; `name` defaults to
    "zone N" ("entrance N", "exit N"), `weight` to 1. Raises `ParameterError` that names file,
    field and reason.
    """
    content = read_yaml(path, f"{path}: the zones file", ParameterError)
    if not isinstance(content, dict):
        names = ", ".join(_FILE_FIELDS)
        raise ParameterError(f"{path}: the file must map some of {names} to lists")
    document = Fields(str(path), content, _FILE_FIELDS, ParameterError)
    zones, entrances, exits = (_zones(document, field) for field in _LISTS_OF_ZONES)
    no_spawn = enumerate(_entries(document, "no_spawn"))
    polygons_m = tuple(_polygon(document, f"no_spawn[{k}]", corners) for k, corners in no_spawn)
    return Zones(zones, polygons_m, entrances, exits)


def polygon_mask(polygon_m: npt.NDArray[np.float64], grid: OccupancyGrid) -> npt.NDArray[np.bool_]:
    """Return bool (height, width): the cells whose centres lie in the polygon (map frame).

    Low edges are inside, high edges are not, so polygons that share an edge share no cell.
    """
    corners = _in_cells(polygon_m, grid)
    toggles = np.zeros((grid.height, grid.width + 1), np.bool_)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        _toggle_right_of_edge(toggles, start, end)
    return np.logical_xor.accumulate(toggles, axis=1)[:, :-1]


def _in_cells(polygon_m: npt.NDArray[np.float64], grid: OccupancyGrid) -> npt.NDArray[np.float64]:
    """Return the corners as (x, y) in cells, so that cell (row, col) is centred at (col, row)."""
    x, y = in_level_frame(grid.origin, polygon_m)
    return np.column_stack((x, y)) / grid.resolution_m - 0.5


def _toggle_right_of_edge(
    toggles: npt.NDArray[np.bool_],
    start: npt.NDArray[np.float64],
    end: npt.NDArray[np.float64],
) -> None:
    """Flip, in each row whose centre line the edge crosses, the first cell right of it."""
    height, width = toggles.shape
    low, high = (start, end) if start[1] <= end[1] else (end, start)
    first, last = np.clip(np.ceil((low[1], high[1])), 0, height)
    rows = np.arange(int(first), int(last))
    if rows.size:
        x = low[0] + (rows - low[1]) * (high[0] - low[0]) / (high[1] - low[1])
        toggles[rows, np.clip(np.ceil(x), 0, width - 1).astype(np.int64)] ^= True


def _entries(document: Fields, field: str) -> list[Any]:
    entries = document.raw(field)
    if not isinstance(entries, list | None):
        document.refuse(field, "is no list")
    return entries or []


def _zones(document: Fields, field: str) -> tuple[Zone, ...]:
    """Return the zones of one list; those without a name take the list's, in the singular."""
    zones = []
    for number, entry in enumerate(_entries(document, field)):
        given = document.inner(f"{field}[{number}]", entry, _ZONE_FIELDS)
        name = given.text("name", f"{field.removesuffix('s')} {number}")
        polygon_m = _polygon(given, "polygon", given.raw("polygon"))
        weight = given.number("weight", 1.0, positive=True)
        if not 1.0 / _MOST <= weight <= _MOST:
            given.refuse("weight", f"is {weight:g}, but {1.0 / _MOST:g} to {_MOST:g} is taken")
        zones.append(Zone(name, polygon_m, weight))
    return tuple(zones)


def _polygon(given: Fields, field: str, corners: object) -> npt.NDArray[np.float64]:
    if not isinstance(corners, list) or len(corners) < 3:
        given.refuse(field, "is no list of at least three corners [x, y]")
    polygon_m = np.array(
        [given.vector(f"{field}[{k}]", xy, "x, y") for k, xy in enumerate(corners)]
    )
    farthest_m = np.abs(polygon_m).max()
    if farthest_m > _MOST:
        given.refuse(field, f"has a corner at {farthest_m:g} m, farther than {_MOST:g} m")
    if np.linalg.matrix_rank(polygon_m - polygon_m[0]) < 2:
        given.refuse(field, "encloses nothing: its corners lie on one line")
    polygon_m.flags.writeable = False
    return polygon_m


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


class RegionFinder:
    """Gives the spawn region of one map; the same object again as long as it is the same.

    Here the region does not depend on the robot. `last_point_m` is the last point of the robot that
    decided on a region, None if none did. `idle_zones` names zones without a cell of the region.
    """

    def __init__(self, region: SpawnRegion, idle_zones: Sequence[str] = ()) -> None:
        self.last_point_m: tuple[float, float] | None = None
        self.idle_zones = idle_zones
        self._region = region

    def at(self, robot_point_m: tuple[float, float] | None) -> SpawnRegion:  # noqa: ARG002 - the robot does not matter
        """Return the region while the robot is at (x, y) in the map frame (None: unknown)."""
        return self._region


class ReachableRegion(RegionFinder):
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
        allowed: npt.NDArray[np.bool_] | None = None,
        snap_m: float = SNAP_M,
        last_point_m: tuple[float, float] | None = None,
    ) -> None:
        """Label the map: `free` bool, `clearance_m` [m] to the nearest cell that is not free.

        The region has cells of `allowed` only, by default all free ones.
        """
        import cv2

        super().__init__(_region_of(np.zeros(free.shape, np.bool_), grid))
        eroded = free & (clearance_m >= robot_radius_m - _ROUNDING * grid.resolution_m)
        self._grid = grid
        self._free = free
        self._allowed = free if allowed is None else allowed
        self._radius_cells = robot_radius_m / grid.resolution_m
        self._snap_cells = snap_m / grid.resolution_m
        self._labels: npt.NDArray[np.int32] = cv2.connectedComponents(
            eroded.view(np.uint8), connectivity=4, ltype=cv2.CV_32S
        )[1]
        # A robot between two components goes to and fro: the regions last used stay as they are.
        self._region_of_label = lru_cache(maxsize=_KEPT_REGIONS)(self._region_made_for)
        self.at(last_point_m)

    def at(self, robot_point_m: tuple[float, float] | None) -> SpawnRegion:
        """Return the region of the robot's component, the same object again for the same one."""
        label = 0 if robot_point_m is None else self._label_near(robot_point_m)
        if label:
            self.last_point_m = robot_point_m
            self._region = self._region_of_label(label)
        return self._region

    def _region_made_for(self, label: int) -> SpawnRegion:
        return _region_of(self._grown(label) & self._allowed, self._grid)

    def _label_near(self, point_m: tuple[float, float]) -> int:
        inside = self._grid.cell_at(*point_m)
        if inside is not None and (label := int(self._labels[inside])):
            return label
        cell = self._grid.points_to_cells(np.array([point_m]))
        row, col = (int(index) for index in cell[0])
        return _nearest_label(self._labels, row, col, self._snap_cells)

    def _grown(self, label: int) -> npt.NDArray[np.bool_]:
        window = _window_of(self._labels == label, math.ceil(self._radius_cells) + 1)
        distance = distances_in_cells(self._labels[window] != label)
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
    """Return the finder of `kind` for one map; no-spawn polygons act on every kind."""
    zones = zones or Zones()
    allowed = zones.allowed(free, grid)
    if kind is Region.REACHABLE:
        return ReachableRegion(
            grid,
            free,
            clearance_m,
            robot_radius_m,
            allowed=allowed,
            last_point_m=last_point_m,
        )
    if kind is Region.FREE:
        return RegionFinder(_region_of(allowed, grid))
    idle = [
        zone.name
        for zone in zones.zones
        if not (polygon_mask(zone.polygon_m, grid) & allowed).any()
    ]
    return RegionFinder(region_of_zones(zones.zones, allowed, grid), idle)


def region_of_zones(zones: Sequence[Zone], allowed: _Mask, grid: OccupancyGrid) -> SpawnRegion:
    """Return the allowed cells in the zones; the weight of a cell is the sum of its zones'."""
    weight = np.zeros(allowed.shape, np.float32)
    for zone in zones:
        weight[polygon_mask(zone.polygon_m, grid) & allowed] += zone.weight
    area_m2 = float(weight.sum(dtype=np.float64)) * grid.cell_area_m2
    return SpawnRegion(weight > 0.0, weight, area_m2)


def _region_of(mask: _Mask, grid: OccupancyGrid) -> SpawnRegion:
    return SpawnRegion(mask, None, int(np.count_nonzero(mask)) * grid.cell_area_m2)


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
