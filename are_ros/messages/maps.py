"""nav_msgs/OccupancyGrid and its updates <-> the core's grid."""

from struct import Struct
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.costmap.augmented_map import GridUpdate
from are_ros.messages.cdr import CdrWriter
from are_ros.messages.common import MessageFactory, make_header, make_pose, read_array, read_time
from are_ros.messages.sensors import read_cloud
from are_ros.world.occupancy_grid import OccupancyGrid


def read_grid(message: Any, source: str = "map") -> OccupancyGrid:
    """Return the grid of a nav_msgs/OccupancyGrid; its cells are copied.

    InputError, whose sentence begins with `source`, for everything Nav2 refuses too.
    """
    info, origin = message.info, message.info.origin
    at, rotation = origin.position, origin.orientation
    return OccupancyGrid.checked(
        read_array(message.data, np.int8),
        width=int(info.width),
        height=int(info.height),
        resolution_m=float(info.resolution),
        origin_xyz_m=(at.x, at.y, at.z),
        origin_rotation_xyzw=(rotation.x, rotation.y, rotation.z, rotation.w),
        frame_id=str(message.header.frame_id).lstrip("/"),
        stamp_ns=read_time(message.header.stamp),
        source=source,
    )


def make_grid(factory: MessageFactory, grid: OccupancyGrid) -> Any:
    """Return the nav_msgs/OccupancyGrid of a grid; `data` is a view of its cells."""
    info = factory.make(
        "nav_msgs/msg/MapMetaData",
        resolution=grid.resolution_m,
        width=grid.width,
        height=grid.height,
        origin=make_pose(factory, grid.origin),
    )
    return factory.make(
        "nav_msgs/msg/OccupancyGrid",
        header=make_header(factory, grid.frame_id, grid.stamp_ns),
        info=info,
        data=grid.cells.reshape(-1),
    )


# Occupancy grids as bytes: a head of a hundred bytes, and the cells as they lie in memory.


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


def read_points(message: Any, source: str = "points") -> Points:
    """Return the points (N, 3) of a PointCloud2 in its own frame [m], NaN where it has NaN.

    N is height * width, row by row. float32, or float64 if any of x, y, z is. The array is new.
    InputError as `PointCloud.checked`.
    """
    return read_cloud(message, source).points_m()


def make_cloud(factory: MessageFactory, frame_id: str, stamp_ns: int, points_m: Points) -> Any:
    """Return an unorganised PointCloud2 of x, y, z float32 from points (N, 3) [m]."""
    points = np.ascontiguousarray(points_m, dtype="<f4")
    fields = [
        factory.make("sensor_msgs/msg/PointField", name=axis, offset=4 * index, datatype=7, count=1)
        for index, axis in enumerate("xyz")
    ]
    return factory.make(
        "sensor_msgs/msg/PointCloud2",
        header=make_header(factory, frame_id, stamp_ns),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=12 * len(points),
        data=points.reshape(-1).view(np.uint8),
        is_dense=bool(np.isfinite(points).all()),
    )
