"""nav_msgs/OccupancyGrid <-> the core's grid."""

from typing import Any

import numpy as np

from are_ros.messages.arrays import read_array
from are_ros.messages.factory import MessageFactory
from are_ros.messages.headers import make_header
from are_ros.messages.poses import make_pose
from are_ros.messages.times import read_time
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
