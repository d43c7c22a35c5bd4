"""Occupancy grids as bytes: a head of a hundred bytes, and the cells as they lie in memory."""

from struct import Struct
from typing import Final

import numpy as np

from are_ros.builder.costmap.augmented_map import GridUpdate
from are_ros.messages.cdr import CdrWriter
from are_ros.world.occupancy_grid import OccupancyGrid

_RESOLUTION_AND_SIZE: Final = Struct("<f2I")
_POSE: Final = Struct("<7d")
_RECTANGLE: Final = Struct("<2i2I")
_NO_TIME_NS: Final = 0


def encode_grid(grid: OccupancyGrid) -> bytes:
    """Return a nav_msgs/OccupancyGrid, whose map has no load time."""
    origin = grid.origin
    writer = CdrWriter()
    writer.header(grid.frame_id, grid.stamp_ns)
    writer.time(_NO_TIME_NS)
    writer.pack(_RESOLUTION_AND_SIZE, 4, grid.resolution_m, grid.width, grid.height)
    writer.pack(_POSE, 8, *origin.translation_m.tolist(), *origin.rotation_xyzw.tolist())
    return _with_cells(writer, grid.cells)


def encode_grid_update(update: GridUpdate) -> bytes:
    """Return a map_msgs/OccupancyGridUpdate; x is the first column, y the first row."""
    rows, columns = update.cells.shape
    writer = CdrWriter()
    writer.header(update.frame_id, update.stamp_ns)
    rectangle = update.rectangle
    writer.pack(_RECTANGLE, 4, int(rectangle.col0), int(rectangle.row0), columns, rows)
    return _with_cells(writer, update.cells)


def _with_cells(
    writer: CdrWriter, cells: "np.ndarray[tuple[int, ...], np.dtype[np.int8]]"
) -> bytes:
    """Return a message that ends with cells int8 (h, w), row by row: they are copied once."""
    writer.count(cells.size)
    return b"".join((writer.message(), np.ascontiguousarray(cells).data))
