"""Messages of the navigation stack and of rviz: paths, clicked points, stamped poses."""

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.errors import InputError
from are_ros.messages.common import read_header, read_pose, read_vector
from are_ros.world.rigid_transform import RigidTransform

_FARTHEST_M: Final = 1e9


class StampedPoints(NamedTuple):
    """Points (N, 3) float64 [m] in a frame at a stamp: a plan's way (N may be 0), or a click."""

    frame_id: str
    stamp_ns: int
    points_m: npt.NDArray[np.float64]


def read_path(message: Any, source: str = "plan") -> StampedPoints:
    """Return the positions of a nav_msgs/Path; InputError if one is not finite."""
    frame_id, stamp_ns = read_header(message, source)
    points = np.array([read_vector(stamped.pose.position) for stamped in message.poses])
    return _checked(frame_id, stamp_ns, points.reshape(-1, 3), f"{source}: poses")


def read_clicked_point(message: Any, source: str = "clicked_point") -> StampedPoints:
    """Return the one point of a geometry_msgs/PointStamped; InputError if it is not finite."""
    frame_id, stamp_ns = read_header(message, source)
    point = np.array([read_vector(message.point)], dtype=np.float64)
    return _checked(frame_id, stamp_ns, point, f"{source}: point")


def read_stamped_pose(message: Any, source: str) -> tuple[str, int, RigidTransform]:
    """Return frame, stamp [ns] and `frame_from_pose` of a geometry_msgs/PoseStamped."""
    frame_id, stamp_ns = read_header(message, source)
    return frame_id, stamp_ns, read_pose(message.pose, "pose", source)


def _checked(
    frame_id: str, stamp_ns: int, points: npt.NDArray[np.float64], field: str
) -> StampedPoints:
    if not np.isfinite(points).all():
        raise InputError(f"{field} holds a position that is not finite")
    if not (np.abs(points) < _FARTHEST_M).all():
        raise InputError(f"{field} holds a position farther than {_FARTHEST_M:g} m from the origin")
    return StampedPoints(frame_id, stamp_ns, points)
