"""The oracle's solids: the real map as the checks see it, cells that boxes cover, walls, voxels.

Shares no code with what it judges: numpy, and the oracle's plane geometry.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from are_ros.checks.oracle.plane import TOUCHING_M, Boxes, in_box, rectangle_depths_m, slab

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
    def of_grid(cls, grid: Any) -> "RealMap":
        """Return the map of an occupancy grid, as it was read from a file; known for ever."""
        x, y, z = (float(value) for value in grid.origin.translation_m)
        yaw = 2.0 * float(np.arctan2(*grid.origin.rotation_xyzw[2:]))
        return cls(grid.cells, grid.resolution_m, (x, y, yaw), z, grid.frame_id)

    def has_geometry_of(self, other: "RealMap") -> bool:
        """Tell whether two maps have one size, resolution and place, to single precision."""
        ours, theirs = (*self.corner, self.height_m), (*other.corner, other.height_m)
        return (
            self.cells.shape == other.cells.shape
            and np.float32(self.resolution_m) == np.float32(other.resolution_m)
            and np.allclose(ours, theirs, rtol=0.0, atol=1e-9)
            and self.frame_id == other.frame_id
        )

    def is_like(self, other: "RealMap") -> bool:
        """Tell whether another map is the same, but for the time at which it came."""
        return self is other or (
            self.has_geometry_of(other) and np.array_equal(self.cells, other.cells)
        )

    @cached_property
    def blank(self) -> "RealMap":
        """A map of this geometry that is 0 everywhere: what an artefact map is drawn on."""
        return replace(self, cells=np.zeros_like(self.cells))

    def is_usable(self, frame_id: str) -> bool:
        """Tell whether a builder whose world frame is `frame_id` takes this map."""
        low, high = int(self.cells.min(initial=0)), int(self.cells.max(initial=0))
        return self.frame_id == frame_id and low >= -1 and high <= 100


@dataclass(frozen=True, eq=False)
class Cover:
    """Cells int64 (N,), flat indices, of one box: `sure` ones, and those it may only touch."""

    sure: Cells
    touched: Cells


_NOTHING = Cover(np.empty(0, np.int64), np.empty(0, np.int64))


class Covers:
    """The cells that boxes cover on one map; a box that stands still is computed once."""

    def __init__(self, real: RealMap) -> None:
        self.real = real
        self._before: dict[bytes, Cover] = {}
        self._now: dict[bytes, Cover] = {}

    def of(self, scene: Boxes) -> list[Cover]:
        """Return the cover of each box."""
        self._before, self._now = self._now, {}
        return [self._of(scene, i) for i in range(len(scene.yaws_rad))]

    def _of(self, scene: Boxes, index: int) -> Cover:
        key = _box_key(scene, index)
        known = self._before.get(key)
        self._now[key] = self._compute(scene, index) if known is None else known
        return self._now[key]

    def _compute(self, scene: Boxes, index: int) -> Cover:
        """Return the cells whose open square meets the open footprint."""
        if not np.isfinite(np.frombuffer(_box_key(scene, index))).all():
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
        square = np.full(2, 0.5 * self.real.resolution_m)
        depths = rectangle_depths_m(middles - centre, yaw, half, 0.0, square)
        return Cover(flat[depths > TOUCHING_M], flat[np.abs(depths) <= TOUCHING_M])

    def _candidates(self, centre: Floats, radius: float) -> tuple[Cells, Cells]:
        height, width = self.real.cells.shape
        low = np.floor((centre - radius) / self.real.resolution_m).astype(np.int64) - 1
        high = np.floor((centre + radius) / self.real.resolution_m).astype(np.int64) + 2
        (col0, row0), (col1, row1) = np.maximum(low, 0), np.minimum(high, (width, height))
        rows, cols = np.mgrid[row0 : max(row1, row0), col0 : max(col1, col0)]
        return rows.ravel(), cols.ravel()


def _box_key(boxes: Boxes, index: int) -> bytes:
    """Return a value that equal boxes share."""
    yaw = boxes.yaws_rad[index : index + 1]
    return np.concatenate((boxes.centres_m[index], yaw, boxes.half_sizes_m[index])).tobytes()


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


_MARGIN_M: Final = 1e-3
_OFF_LATTICE: Final = 0.05
_SAMPLES: Final = 8
"""In an edge of a cell: a corner that is cut by less may have been missed by either."""


@dataclass(frozen=True, eq=False)
class Walls:
    """Cuboids on a lattice whose corner (x, y, z) and yaw are in the map's frame, of `size_m` (3,).

    `solid` are their indices in x, y, z, int64 (N, 3).
    """

    corner_m: Floats
    yaw_rad: float
    size_m: Floats
    solid: Cells

    @classmethod
    def of_map(cls, real: RealMap, occupied_from: int, low_m: float, high_m: float) -> "Walls":
        """Return the walls over the occupied cells of a map, between two heights."""
        rows, cols = np.nonzero(real.cells >= occupied_from)
        x_m, y_m, yaw_rad = real.corner
        size_m = np.array((real.resolution_m, real.resolution_m, high_m - low_m))
        solid = np.column_stack((cols, rows, np.zeros_like(cols))).astype(np.int64)
        return cls(np.array((x_m, y_m, low_m)), yaw_rad, size_m, solid)

    @classmethod
    def of_cloud(cls, centres_m: Floats, size_m: float) -> "Walls | None":
        """Return voxels about centres (N, 3), of a size (0: as their spacing says).

        None where these are leaves of several sizes.
        """
        centres_m = centres_m[np.isfinite(centres_m).all(axis=1)]
        if not len(centres_m):
            return None
        gaps = [np.diff(np.unique(np.round(column, 5))) for column in centres_m.T]
        spacing_m = min((float(gap.min()) for gap in gaps if len(gap)), default=0.0)
        size_m = size_m or spacing_m
        if size_m <= 0.0:
            return None
        first = centres_m[0] - 0.5 * size_m
        places = (centres_m - first) / size_m - 0.5
        if np.abs(places - np.rint(places)).max() > _OFF_LATTICE:
            return None
        return cls(first, 0.0, np.full(3, size_m), np.rint(places).astype(np.int64))

    def crossed(self, starts_m: Floats, ends_m: Floats) -> Floats:
        """Return where ways to ends (M, 3) are in a cuboid first, (M, 3), or nan.

        They come from starts (M, 3), or from one for all (3,).

        That of the start does not count, nor does the outermost millimetre of any, nor a corner
        that is cut by less than an eighth of an edge.
        """
        starts_m = np.broadcast_to(starts_m, ends_m.shape)
        lengths_m = np.linalg.norm(ends_m - starts_m, axis=1)
        ways = (ends_m - starts_m) / lengths_m[:, None]
        chord_m = float(self.size_m[:2].min()) / _SAMPLES
        far_m = self.first_solid(starts_m, ways, lengths_m, _MARGIN_M, chord_m)
        known_m = np.where(np.isfinite(far_m), far_m, np.nan)  # infinity times 0 would warn
        found: Floats = starts_m + known_m[:, None] * ways
        return found

    def first_solid(
        self,
        starts_m: Floats,
        ways: Floats,
        reaches_m: Floats,
        margin_m: float = 0.0,
        chord_m: float = 0.0,
    ) -> Floats:
        """Return how far rays (N, 3) go to the first cuboid, inf if not within `reaches_m` (N,).

        That in which a ray starts does not count, nor do those of which, `margin_m` inside their
        faces, it cuts less than `chord_m`. Cell by cell, all rays side by side.
        """
        found = np.full(len(ways), np.inf)
        if not len(self.solid):
            return found
        starts, steps = self._lattice(starts_m), self._lattice(ways + self.corner_m)
        low, high = self.solid.min(axis=0), self.solid.max(axis=0) + 1
        enter, leave = slab(starts, steps, low, high)
        begin = np.maximum(enter.max(axis=1), 0.0)
        end = np.minimum(leave.min(axis=1), reaches_m)
        rays = np.flatnonzero(begin <= end)
        at = begin[rays]
        own = np.floor(starts[rays])
        places = starts[rays] + np.where(np.isfinite(at), at, 0.0)[:, None] * steps[rays]
        cells = np.clip(np.floor(places), low, high - 1)
        while len(rays):
            start, step = starts[rays], steps[rays]
            enter, leave = slab(
                start, step, cells + margin_m / self.size_m, cells + 1.0 - margin_m / self.size_m
            )
            into = np.maximum(enter.max(axis=1), 0.0)
            chords = np.minimum(leave.min(axis=1), reaches_m[rays]) - into
            hit = (chords >= chord_m) & (cells != own).any(axis=1)
            hit[hit] = self._are_solid(cells[hit].astype(np.int64))
            found[rays[hit]] = into[hit]
            with np.errstate(divide="ignore", invalid="ignore"):
                nexts = np.where(step == 0.0, np.inf, (cells + (step > 0.0) - start) / step)
            axis, each = nexts.argmin(axis=1), np.arange(len(rays))
            cells[each, axis] += np.sign(step[each, axis])
            on = ~hit & (nexts[each, axis] <= end[rays])
            on &= ((cells >= low) & (cells < high)).all(axis=1)
            rays, cells, own = rays[on], cells[on], own[on]
        return found

    def _lattice(self, points_m: Floats) -> Floats:
        """Return points (K, 3) in edges of a cuboid from the corner of the lattice."""
        return in_box(points_m - self.corner_m, self.yaw_rad) / self.size_m

    @cached_property
    def _known(self) -> Cells:
        return np.append(np.sort(_keys(self.solid)), np.iinfo(np.int64).max)

    def _are_solid(self, indices: Cells) -> NDArray[np.bool_]:
        keys = _keys(indices)
        solid: NDArray[np.bool_] = self._known[np.searchsorted(self._known, keys)] == keys
        return solid


def _keys(indices: Cells) -> Cells:
    """Return a number for each index of three, which others do not share."""
    offset, keys = np.int64(1 << 20), np.zeros(len(indices), np.int64)
    for column in indices.T:
        keys = (keys << 21) | (np.clip(column, -offset, offset - 1) + offset)
    return keys


@dataclass(frozen=True, eq=False)
class Cloud:
    """The centres (N, 3) of a PointCloud2, in a frame, known from `since_ns` on."""

    centres_m: Floats
    frame_id: str
    since_ns: int

    @classmethod
    def of_message(cls, message: Any, log_ns: int) -> "Cloud":
        """Return the cloud of a message; ValueError where x, y and z are not plain numbers."""
        kinds = {7: "f4", 8: "f8"}
        offsets = {
            field.name: (field.offset, kinds.get(field.datatype)) for field in message.fields
        }
        if any(offsets.get(name, (0, None))[1] is None for name in "xyz"):
            raise ValueError("x, y and z of a cloud are not all there as float32 or float64")
        order = ">" if message.is_bigendian else "<"
        kind = np.dtype(
            {
                "names": ["x", "y", "z"],
                "formats": [f"{order}{offsets[name][1]}" for name in "xyz"],
                "offsets": [offsets[name][0] for name in "xyz"],
                "itemsize": message.point_step,
            }
        )
        rows = np.asarray(message.data, np.uint8).reshape(message.height, message.row_step)
        used = np.ascontiguousarray(rows[:, : message.width * message.point_step])
        points = used.reshape(-1).view(kind)
        centres = np.column_stack([points[name].astype(np.float64) for name in "xyz"])
        return cls(centres, message.header.frame_id.lstrip("/"), log_ns)

    def is_like(self, other: "Cloud") -> bool:
        """Tell whether another cloud has the same points and frame."""
        is_same = np.array_equal(self.centres_m, other.centres_m, equal_nan=True)
        return is_same and self.frame_id == other.frame_id
