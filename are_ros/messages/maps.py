"""nav_msgs/OccupancyGrid and its updates <-> the core's grid."""

from struct import Struct
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.costmap.augmented_map import GridUpdate
from are_ros.errors import InputError, MapError
from are_ros.messages.cdr import CdrWriter
from are_ros.messages.common import read_array, read_quaternion, read_time, read_vector
from are_ros.messages.sensors import read_cloud
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.voxel_files.octomap import FINEST_M, WIDEST_M, OctreeHeader, read_octree


def read_grid(message: Any, source: str = "map") -> OccupancyGrid:
    """Return the grid of a message, its cells copied; InputError for what Nav2 refuses, too."""
    info, origin = message.info, message.info.origin
    return OccupancyGrid.checked(
        read_array(message.data, np.int8),
        width=int(info.width),
        height=int(info.height),
        resolution_m=float(info.resolution),
        origin_xyz_m=read_vector(origin.position),
        origin_rotation_xyzw=read_quaternion(origin.orientation),
        frame_id=str(message.header.frame_id).lstrip("/"),
        stamp_ns=read_time(message.header.stamp),
        source=source,
    )


# Occupancy grids as bytes: a head of a hundred bytes, and the cells as they lie in memory.


_RESOLUTION_AND_SIZE: Final = Struct("<f2I")
_RECTANGLE: Final = Struct("<2i2I")


def encode_grid(grid: OccupancyGrid) -> bytes:
    """Return a nav_msgs/OccupancyGrid, whose map has no load time."""
    writer = CdrWriter()
    writer.header(grid.frame_id, grid.stamp_ns)
    writer.time(0)
    writer.pack(_RESOLUTION_AND_SIZE, 4, grid.resolution_m, grid.width, grid.height)
    writer.pose(grid.origin)
    writer.count(grid.cells.size)
    return b"".join((writer.message(), np.ascontiguousarray(grid.cells).data))


def encode_grid_update(update: GridUpdate) -> bytes:
    """Return a map_msgs/OccupancyGridUpdate; x is the first column, y the first row."""
    rows, columns = update.cells.shape
    writer = CdrWriter()
    writer.header(update.frame_id, update.stamp_ns)
    rectangle = update.rectangle
    writer.pack(_RECTANGLE, 4, int(rectangle.col0), int(rectangle.row0), columns, rows)
    writer.count(update.cells.size)
    return b"".join((writer.message(), np.ascontiguousarray(update.cells).data))


# sensor_msgs/PointCloud2 <-> arrays of points, whatever the layout of its fields.


Points = npt.NDArray[np.float32] | npt.NDArray[np.float64]


def read_voxels(message: Any, source: str = "octomap") -> tuple[Points, float | None]:
    """Return the centres (N, 3) [m] of occupied voxels in the message's frame, and their size [m].

    Of an octree of octomap_server, binary or full, or of a PointCloud2, which has no size: None.
    InputError where the message is malformed.
    """
    if not hasattr(message, "binary"):
        return read_cloud(message, source).points_m(), None
    resolution_m = float(message.resolution)
    if not FINEST_M < resolution_m <= WIDEST_M:
        raise InputError(f"{source}: the octomap's resolution is {resolution_m}, no voxel's width")
    header = OctreeHeader(str(message.id), not message.binary, resolution_m)
    try:
        centres_m = read_octree(source, read_array(message.data, np.int8).tobytes(), header)
    except MapError as cause:
        raise InputError(str(cause)) from cause
    return centres_m, resolution_m
