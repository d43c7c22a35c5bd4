"""The real map as the checks see it, and the cells that a box covers, by separating axes."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from are_ros.bag.decoded import Scene
from are_ros.conventions import OCCUPIED, UNKNOWN
from are_ros.replay._check_geometry import TOUCHING_M
from are_ros.world.occupancy_grid import OccupancyGrid

Floats = NDArray[np.float64]
Cells = NDArray[np.int64]

TOUCHED: Final = 1
SURE: Final = 2


@dataclass(frozen=True, eq=False)
class RealMap:
    """A grid, int8 (h, w), with its corner (x, y, yaw) in the frame, known from `since_ns` on."""

    cells: NDArray[np.int8]
    resolution_m: float
    corner: tuple[float, float, float]
    height_m: float
    frame_id: str
    since_ns: int = 0

    @classmethod
    def of_grid(cls, grid: OccupancyGrid) -> "RealMap":
        """Return the map of a file, known from the beginning."""
        x, y, z = (float(value) for value in grid.origin.translation_m)
        yaw = 2.0 * float(np.arctan2(*grid.origin.rotation_xyzw[2:]))
        return cls(grid.cells, grid.resolution_m, (x, y, yaw), z, grid.frame_id)

    @classmethod
    def of_message(cls, message: Any, log_ns: int) -> "RealMap":
        """Return the map of a nav_msgs/OccupancyGrid; ValueError where its size is wrong."""
        info, place = message.info, message.info.origin
        cells = np.asarray(message.data, np.int8).reshape(info.height, info.width)
        yaw = 2.0 * float(np.arctan2(place.orientation.z, place.orientation.w))
        corner = (place.position.x, place.position.y, yaw)
        frame_id = message.header.frame_id.lstrip("/")
        return cls(cells, info.resolution, corner, place.position.z, frame_id, log_ns)

    def has_geometry_of(self, other: "RealMap") -> bool:
        """Tell whether two maps have one size, resolution and place, to single precision."""
        ours, theirs = (*self.corner, self.height_m), (*other.corner, other.height_m)
        return (
            self.cells.shape == other.cells.shape
            and np.float32(self.resolution_m) == np.float32(other.resolution_m)
            and np.allclose(ours, theirs, rtol=0.0, atol=1e-9)
            and self.frame_id == other.frame_id
        )

    @cached_property
    def blank(self) -> "RealMap":
        """A map of this geometry that is 0 everywhere: what an artefact map is drawn on."""
        return replace(self, cells=np.zeros_like(self.cells))

    def is_usable(self, frame_id: str) -> bool:
        """Tell whether a builder whose world frame is `frame_id` takes this map."""
        low, high = int(self.cells.min(initial=0)), int(self.cells.max(initial=0))
        return self.frame_id == frame_id and low >= UNKNOWN and high <= OCCUPIED


@dataclass(frozen=True, eq=False)
class Cover:
    """Cells int64 (N,), flat indices, of one box: `sure` ones, and those it may only touch."""

    sure: Cells
    touched: Cells


_NOTHING = Cover(np.empty(0, np.int64), np.empty(0, np.int64))


class Covers:
    """The cells of the boxes of scenes on one map; a box that stands still is computed once."""

    def __init__(self, real: RealMap) -> None:
        self.real = real
        self._before: dict[bytes, Cover] = {}
        self._now: dict[bytes, Cover] = {}

    def of(self, scene: Scene) -> list[Cover]:
        """Return the cover of each box."""
        self._before, self._now = self._now, {}
        return [self._of(scene, i) for i in range(len(scene.ids))]

    def _of(self, scene: Scene, index: int) -> Cover:
        key = scene.box_key(index)
        known = self._before.get(key)
        self._now[key] = self._compute(scene, index) if known is None else known
        return self._now[key]

    def _compute(self, scene: Scene, index: int) -> Cover:
        """Return the cells whose open square meets the open footprint."""
        if not np.isfinite(np.frombuffer(scene.box_key(index))).all():
            return _NOTHING
        x0, y0, turn = self.real.corner
        cos, sin = np.cos(turn), np.sin(turn)
        dx, dy = scene.centres_m[index, :2] - (x0, y0)
        centre = np.array((dx * cos + dy * sin, dy * cos - dx * sin))
        yaw, half = scene.yaws_rad[index] - turn, scene.half_sizes_m[index, :2]
        rows, cols = self._candidates(centre, float(np.hypot(*half)))
        if not rows.size:
            return _NOTHING
        flat = rows * self.real.cells.shape[1] + cols
        middles = (np.column_stack((cols, rows)) + 0.5) * self.real.resolution_m
        depths = _depths(middles - centre, yaw, half, 0.5 * self.real.resolution_m)
        return Cover(flat[depths > TOUCHING_M], flat[np.abs(depths) <= TOUCHING_M])

    def _candidates(self, centre: Floats, radius: float) -> tuple[Cells, Cells]:
        height, width = self.real.cells.shape
        low = np.floor((centre - radius) / self.real.resolution_m).astype(np.int64) - 1
        high = np.floor((centre + radius) / self.real.resolution_m).astype(np.int64) + 2
        (col0, row0), (col1, row1) = np.maximum(low, 0), np.minimum(high, (width, height))
        rows, cols = np.mgrid[row0 : max(row1, row0), col0 : max(col1, col0)]
        return rows.ravel(), cols.ravel()


def _depths(apart: Floats, yaw: float, half: Floats, half_cell: float) -> Floats:
    """Return how deep squares at (N, 2) from a rectangle's centre reach into it."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    spread = half_cell * (abs(cos) + abs(sin))
    along = np.abs(apart[:, 0] * cos + apart[:, 1] * sin)
    aside = np.abs(apart[:, 1] * cos - apart[:, 0] * sin)
    reach_x = half[0] * abs(cos) + half[1] * abs(sin)
    reach_y = half[0] * abs(sin) + half[1] * abs(cos)
    depths: Floats = np.min(
        (
            half_cell + reach_x - np.abs(apart[:, 0]),
            half_cell + reach_y - np.abs(apart[:, 1]),
            half[0] + spread - along,
            half[1] + spread - aside,
        ),
        axis=0,
    )
    return depths


def layer(covers: list[Cover], real: RealMap) -> NDArray[np.int8]:
    """Return what boxes do to each cell of a map, flat: SURE, TOUCHED or 0."""
    cells = np.zeros(real.cells.size, np.int8)
    for cover in covers:
        cells[cover.touched] = TOUCHED
    for cover in covers:
        cells[cover.sure] = SURE
    return cells


def are_same(ours: list[Cover], theirs: list[Cover]) -> bool:
    """Tell whether these are the covers of the very boxes of another tick."""
    return len(ours) == len(theirs) and all(a is b for a, b in zip(ours, theirs, strict=True))
