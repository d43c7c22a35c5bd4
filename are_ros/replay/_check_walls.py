"""What hides artefacts from a laser: the walls of the map, or the voxels of a cloud."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from are_ros.replay._check_cells import RealMap

Floats = NDArray[np.float64]
_Integers = NDArray[np.int64]

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
    solid: _Integers

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

    def crossed(self, start_m: Floats, ends_m: Floats) -> Floats:
        """Return where ways from a start (3,) to ends (M, 3) are in a cuboid first, (M, 3), or nan.

        That of the start does not count, nor does the outermost millimetre of any.
        """
        found = np.full(ends_m.shape, np.nan)
        own = np.floor(self._lattice(start_m[None])[0])
        step_m = float(self.size_m[:2].min()) / _SAMPLES
        margins = _MARGIN_M / self.size_m
        for i, end_m in enumerate(ends_m):
            length_m = float(np.linalg.norm(end_m - start_m))
            ways_m = step_m * np.arange(1, max(1, math.ceil(length_m / step_m)))
            points = start_m + ways_m[:, None] / length_m * (end_m - start_m)
            places = self._lattice(points)
            indices = np.floor(places)
            inside = ((places - indices > margins) & (places - indices < 1.0 - margins)).all(axis=1)
            inside &= (indices != own).any(axis=1)
            hit = np.flatnonzero(inside)
            hit = hit[self._are_solid(indices[hit].astype(np.int64))]
            if len(hit):
                found[i] = points[hit[0]]
        return found

    def _lattice(self, points_m: Floats) -> Floats:
        """Return points (K, 3) in edges of a cuboid from the corner of the lattice."""
        apart = points_m - self.corner_m
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        x, y = cos * apart[:, 0] + sin * apart[:, 1], cos * apart[:, 1] - sin * apart[:, 0]
        places: Floats = np.column_stack((x, y, apart[:, 2])) / self.size_m
        return places

    @cached_property
    def _known(self) -> _Integers:
        return np.append(np.sort(_keys(self.solid)), np.iinfo(np.int64).max)

    def _are_solid(self, indices: _Integers) -> NDArray[np.bool_]:
        keys = _keys(indices)
        solid: NDArray[np.bool_] = self._known[np.searchsorted(self._known, keys)] == keys
        return solid


def _keys(indices: _Integers) -> _Integers:
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
        """Tell whether another one says the same."""
        is_same = np.array_equal(self.centres_m, other.centres_m, equal_nan=True)
        return is_same and self.frame_id == other.frame_id
