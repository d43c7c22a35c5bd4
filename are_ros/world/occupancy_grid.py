"""M2D: the occupancy grid of the real place (section 3.1), checked as Nav2 checks it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.conventions import OCCUPIED, UNKNOWN
from are_ros.errors import InputError
from are_ros.world.rigid_transform import (
    MAX_REACH_M,
    MAX_TILT_RAD,
    RigidTransform,
    cosine_and_sine,
    in_level_frame,
    tilt_rad,
    yaw_only,
)

MAX_SIDE: Final = 32767
MAX_CELLS: Final = 2**28
"""What is kept for each cell, several bytes, must fit into memory."""

_MIN_RESOLUTION_M: Final = 1e-6
_NORM_TOLERANCE: Final = 1e-4
_OUTSIDE: Final = -(2**31)


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """A grid of cells in the map frame; cell (row, col) = (0, 0) touches the origin.

    `cells` is int8 (height, width), read-only: -1 unknown, else 0..100 per cent occupied.
    `origin` is map_from_grid: x runs along the columns, y along the rows, yaw only.
    Build one from outside data with `checked`; the bare constructor checks nothing.
    """

    cells: npt.NDArray[np.int8]
    resolution_m: float
    origin: RigidTransform
    frame_id: str
    stamp_ns: int = 0

    def __post_init__(self) -> None:
        cells = self.cells.view()
        cells.flags.writeable = False
        object.__setattr__(self, "cells", cells)

    def is_same_map(self, other: "OccupancyGrid") -> bool:
        """Tell whether the other has the same cells at the same place, whatever its stamp."""
        return self is other or (
            self.is_same_lattice(other) and np.array_equal(self.cells, other.cells)
        )

    def is_same_lattice(self, other: "OccupancyGrid") -> bool:
        """Tell whether the other has as many cells, as large, at the same place."""
        return (
            self.cells.shape == other.cells.shape
            and self.resolution_m == other.resolution_m
            and np.array_equal(self.origin.translation_m, other.origin.translation_m)
            and np.array_equal(self.origin.rotation_xyzw, other.origin.rotation_xyzw)
        )

    @classmethod
    def checked(
        cls,
        data: npt.ArrayLike,
        *,
        width: int,
        height: int,
        resolution_m: float,
        origin_xyz_m: Sequence[float],
        origin_rotation_xyzw: Sequence[float],
        frame_id: str,
        stamp_ns: int = 0,
        source: str = "map",
    ) -> "OccupancyGrid":
        """Return the grid of a message's fields; `data` is row by row, flat or (height, width).

        The checks are Nav2's and two more (values, tilt). `source` (a topic or a file) begins
        every sentence. Raises InputError that names field and reason. The data are copied.
        """
        _check_header(source, frame_id, width, height, resolution_m)
        origin = _checked_origin(source, origin_xyz_m, origin_rotation_xyzw)
        values = np.asarray(data)
        if values.dtype.kind not in "iu":
            raise InputError(f"{source}: data are of type {values.dtype}, not integers")
        if values.size != width * height or (values.ndim == 2 and values.shape != (height, width)):
            message = (
                f"{source}: data has {values.size} cells, but width x height is"
                f" {width} x {height} = {width * height}"
            )
            raise InputError(message)
        low, high = int(values.min()), int(values.max())
        if low < UNKNOWN or high > OCCUPIED:
            wrong = low if low < UNKNOWN else high
            raise InputError(f"{source}: data holds the value {wrong}, outside -1 to 100")
        cells = np.array(values.reshape(height, width), dtype=np.int8, order="C")
        return cls(cells, float(resolution_m), origin, frame_id, int(stamp_ns))

    @property
    def height(self) -> int:
        """Number of rows."""
        return int(self.cells.shape[0])

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.cells.shape[1])

    @property
    def cell_area_m2(self) -> float:
        """Area of one cell."""
        return self.resolution_m * self.resolution_m

    def points_to_cells(self, points: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Return the cells (N, 2) as (row, col) that hold the points (N, 2) of the map frame.

        A cell holds its low edges, not its high ones. Cells may lie outside the grid; a point
        that is not finite, or farther than 2**31 cells, comes out far outside.
        """
        with np.errstate(invalid="ignore", over="ignore"):
            along_x, along_y = in_level_frame(self.origin, points)
            cells = np.floor(np.column_stack((along_y, along_x)) / self.resolution_m)
        bounded: npt.NDArray[np.float64]
        bounded = np.clip(np.nan_to_num(cells, nan=_OUTSIDE), _OUTSIDE, -_OUTSIDE)
        return bounded.astype(np.int64)

    def cell_at(self, x_m: float, y_m: float) -> tuple[int, int] | None:
        """Return the cell (row, col) that holds one point, as `points_to_cells`; None outside."""
        x0_m, y0_m, cosine, sine = self._frame
        dx_m, dy_m = x_m - x0_m, y_m - y0_m
        row = (dy_m * cosine - dx_m * sine) / self.resolution_m
        col = (dx_m * cosine + dy_m * sine) / self.resolution_m
        inside = 0.0 <= row < self.cells.shape[0] and 0.0 <= col < self.cells.shape[1]
        return (int(row), int(col)) if inside else None

    @cached_property
    def _frame(self) -> tuple[float, float, float, float]:
        """The origin x, y [m] and the cosine and sine of its yaw."""
        x_m, y_m, _ = self.origin.translation_m.tolist()
        cosine, sine = cosine_and_sine(self.origin.rotation_xyzw)
        return x_m, y_m, float(cosine), float(sine)

    def cells_to_points(self, cells: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the centres (N, 2) in the map frame of cells (N, 2) given as (row, col)."""
        indices = np.asarray(cells, dtype=np.float64)
        along_y, along_x = (indices.T + 0.5) * self.resolution_m
        cosine, sine = cosine_and_sine(self.origin.rotation_xyzw)
        x = along_x * cosine - along_y * sine
        y = along_x * sine + along_y * cosine
        return np.column_stack((x, y)) + self.origin.translation_m[:2]

    def contains(self, cells: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
        """Return which of the cells (N, 2) lie inside the grid, as bool (N,)."""
        rows, cols = cells[:, 0], cells[:, 1]
        inside: npt.NDArray[np.bool_]
        inside = (rows >= 0) & (rows < self.height) & (cols >= 0) & (cols < self.width)
        return inside


@dataclass(frozen=True, eq=False)
class CellClasses:
    """The cells in our own reading: bool (height, width) each; what is in neither is unknown."""

    occupied: npt.NDArray[np.bool_]
    free: npt.NDArray[np.bool_]

    def __post_init__(self) -> None:
        self.occupied.flags.writeable = False
        self.free.flags.writeable = False

    @cached_property
    def free_count(self) -> int:
        """Number of free cells, counted once."""
        return int(np.count_nonzero(self.free))


def classify(grid: OccupancyGrid, occupied_threshold: int, free_threshold: int) -> CellClasses:
    """Return the classes: occupied at >= occupied_threshold, free at 0..free_threshold.

    Unknown cells (-1) are neither. Raises InputError unless free_threshold is the lower one.
    """
    if not free_threshold < occupied_threshold:
        message = f"free threshold {free_threshold} is not below the occupied, {occupied_threshold}"
        raise InputError(message)
    cells = grid.cells
    return CellClasses(
        occupied=(cells >= occupied_threshold) & (cells > UNKNOWN),
        free=(cells <= free_threshold) & (cells > UNKNOWN),
    )


def _check_header(source: str, frame_id: str, width: int, height: int, resolution_m: float) -> None:
    if not frame_id:
        raise InputError(f"{source}: header.frame_id is empty")
    if not (math.isfinite(resolution_m) and resolution_m > _MIN_RESOLUTION_M):
        message = f"{source}: resolution is {resolution_m:g}, it must be a length above 1e-6 m"
        raise InputError(message)
    for field, size in (("width", width), ("height", height)):
        if not 0 < size <= MAX_SIDE:
            raise InputError(f"{source}: {field} is {size}, it must be 1 to {MAX_SIDE} cells")
    if width * height > MAX_CELLS:
        sides = f"width x height is {width} x {height}"
        raise InputError(f"{source}: {sides}, it must be at most {MAX_CELLS} cells")


def _checked_origin(
    source: str, xyz_m: Sequence[float], rotation_xyzw: Sequence[float]
) -> RigidTransform:
    position = np.array(xyz_m, dtype=np.float64)
    rotation = np.array(rotation_xyzw, dtype=np.float64)
    if position.shape != (3,) or not np.isfinite(position).all():
        raise InputError(f"{source}: info.origin.position {xyz_m} is not three finite numbers")
    if not np.abs(position).max() <= MAX_REACH_M:
        raise InputError(f"{source}: info.origin.position {xyz_m} exceeds {MAX_REACH_M:g} m")
    is_quaternion = rotation.shape == (4,)
    squared_norm = sum(q * q for q in rotation.tolist()) if is_quaternion else math.nan
    if not abs(squared_norm - 1.0) <= _NORM_TOLERANCE:
        message = (
            f"{source}: info.origin.orientation {rotation_xyzw} is no unit quaternion"
            f" (x, y, z, w); no rotation at all is (0, 0, 0, 1)"
        )
        raise InputError(message)
    tilt = tilt_rad(rotation)
    if tilt > MAX_TILT_RAD:
        message = (
            f"{source}: info.origin.orientation tilts the map by {tilt:.4f} rad;"
            f" only a rotation about z is supported"
        )
        raise InputError(message)
    return RigidTransform(translation_m=position, rotation_xyzw=yaw_only(rotation))


def distances_in_cells(is_clear: npt.NDArray[np.bool_], border: int = 0) -> npt.NDArray[np.float32]:
    """Return the distances (height, width), in cells, to the nearest cell that is not clear.

    Up to 4096 they are exact: the float32 nearest to the root of a sum of two squares.

    With a border of 1, what is outside of the grid is not clear. Without any such cell each
    distance is larger than the grid.
    """
    import cv2  # it takes a while to load

    padded = np.pad(is_clear.astype(np.uint8), border)
    if padded.all():
        return np.full(is_clear.shape, np.float32(sum(is_clear.shape)))
    had_ipp = cv2.ipp.useIPP()
    cv2.ipp.setUseIPP(False)  # IPP's are wrong by an ulp, and differ with the array's address
    try:
        field = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    finally:
        cv2.ipp.setUseIPP(had_ipp)
    inner = slice(border, -border or None)
    return np.ascontiguousarray(field[inner, inner], dtype=np.float32)
