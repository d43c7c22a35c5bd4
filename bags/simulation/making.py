"""Messages of a robot, made by the factory of either middleware: for recordings and tests."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from are_ros.bag.types import jazzy_typestore
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.conventions import NS_PER_S
from are_ros.messages.common import Header, Vector3
from are_ros.messages.goals import StampedPoints
from are_ros.messages.maps import Points
from are_ros.messages.transforms import StampedTransform
from are_ros.world.cameras import CameraInfo
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

Values = Sequence[float] | npt.NDArray[np.float64]


class MessageFactory(Protocol):
    """Builds message objects of one middleware.

    `type_name` is the full name, as "nav_msgs/msg/OccupancyGrid". A field that is left out has its
    type's default. Arrays of numbers come as one-dimensional numpy arrays of the field's dtype,
    nested messages as what `make` returned, sequences of strings or messages as lists.
    """

    def make(self, type_name: str, /, **fields: Any) -> Any:
        """Return a new message object of the type with the fields given."""


_DEFAULTS: dict[str, Any] = {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}
_BASE, _NAME, _ARRAY = 1, 2, 3
"""The node types of rosbags' field descriptions; the fourth is a sequence."""


class RosbagsFactory:
    """Makes message objects of rosbags; a field left out is zero, empty or unturned."""

    def __init__(self, typestore: Any = None) -> None:
        self._store = jazzy_typestore() if typestore is None else typestore
        self._makers: dict[str, dict[str, Callable[[], Any]]] = {}

    def make(self, type_name: str, /, **fields: Any) -> Any:
        """Return a new message object; KeyError for a type, TypeError for a field of no such name.

        Arrays are kept, not copied: change none before it is serialised.
        """
        makers = self._makers.get(type_name)
        if makers is None:
            makers = self._makers[type_name] = self._makers_of(type_name)
        if len(fields) < len(makers):
            fields = {name: make() for name, make in makers.items() if name not in fields} | fields
        return self._store.types[type_name](**fields)

    def _makers_of(self, type_name: str) -> dict[str, Callable[[], Any]]:
        """Return what makes the default of each field."""
        fields = self._store.fielddefs[type_name][1]
        makers = {name: self._maker_of(description) for name, description in fields}
        if type_name == "geometry_msgs/msg/Quaternion":
            makers["w"] = partial(float, 1.0)
        return makers

    def _maker_of(self, description: tuple[int, Any]) -> Callable[[], Any]:
        kind, detail = int(description[0]), description[1]
        if kind == _BASE:
            return lambda: _DEFAULTS.get(detail[0], 0)
        if kind == _NAME:
            return partial(self.make, detail)
        (element_kind, element), count = detail
        count = count if kind == _ARRAY else 0
        if int(element_kind) == _BASE and element[0] != "string":
            name = {"octet": "uint8", "byte": "uint8", "char": "uint8"}.get(element[0], element[0])
            return partial(np.zeros, count, np.dtype(name))
        element_maker = self._maker_of((int(element_kind), element))
        return lambda: [element_maker() for _ in range(count)]


def make_time(factory: MessageFactory, time_ns: int) -> Any:
    """Return a builtin_interfaces/Time; its nanoseconds lie in [0, 1e9), before the epoch too."""
    seconds, nanoseconds = divmod(time_ns, NS_PER_S)
    return factory.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)


def make_header(factory: MessageFactory, frame_id: str, stamp_ns: int) -> Any:
    """Return a std_msgs/Header."""
    stamp = make_time(factory, stamp_ns)
    return factory.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)


def make_point(factory: MessageFactory, xyz_m: Values) -> Any:
    """Return a geometry_msgs/Point of three metres."""
    x, y, z = xyz_m
    return factory.make("geometry_msgs/msg/Point", x=float(x), y=float(y), z=float(z))


def make_vector(factory: MessageFactory, xyz: Values) -> Any:
    """Return a geometry_msgs/Vector3."""
    x, y, z = xyz
    return factory.make("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))


def make_quaternion(factory: MessageFactory, xyzw: Values) -> Any:
    """Return a geometry_msgs/Quaternion."""
    x, y, z, w = xyzw
    return factory.make(
        "geometry_msgs/msg/Quaternion", x=float(x), y=float(y), z=float(z), w=float(w)
    )


def make_pose(factory: MessageFactory, parent_from_pose: RigidTransform) -> Any:
    """Return a geometry_msgs/Pose."""
    return factory.make(
        "geometry_msgs/msg/Pose",
        position=make_point(factory, parent_from_pose.translation_m.tolist()),
        orientation=make_quaternion(factory, parent_from_pose.rotation_xyzw.tolist()),
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


def make_transforms(factory: MessageFactory, transforms: Iterable[StampedTransform]) -> Any:
    """Return a TFMessage."""
    return factory.make(
        "tf2_msgs/msg/TFMessage",
        transforms=[_make_transform(factory, transform) for transform in transforms],
    )


def _make_transform(factory: MessageFactory, transform: StampedTransform) -> Any:
    return factory.make(
        "geometry_msgs/msg/TransformStamped",
        header=make_header(factory, transform.parent, transform.stamp_ns),
        child_frame_id=transform.child,
        transform=factory.make(
            "geometry_msgs/msg/Transform",
            translation=make_vector(factory, transform.translation_m),
            rotation=make_quaternion(factory, transform.rotation_xyzw),
        ),
    )


@dataclass(frozen=True, eq=False)
class OdometryReading:
    """One odometry message; the child frame is "" where the message leaves it out.

    The velocities are those of the child, in the child's frame.
    """

    frame_id: str
    child_frame_id: str
    stamp_ns: int
    frame_from_child: RigidTransform
    linear_velocity_m_s: Vector3
    angular_velocity_rad_s: Vector3


def make_odometry(factory: MessageFactory, reading: OdometryReading) -> Any:
    """Return a nav_msgs/Odometry, its covariances zero."""
    twist = make_twist(factory, reading.linear_velocity_m_s, reading.angular_velocity_rad_s)
    return factory.make(
        "nav_msgs/msg/Odometry",
        header=make_header(factory, reading.frame_id, reading.stamp_ns),
        child_frame_id=reading.child_frame_id,
        pose=factory.make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=make_pose(factory, reading.frame_from_child),
        ),
        twist=factory.make("geometry_msgs/msg/TwistWithCovariance", twist=twist),
    )


def make_camera_info(factory: MessageFactory, header: Header, info: CameraInfo) -> Any:
    """Return a sensor_msgs/CameraInfo of ROS 2."""
    x, y, width, height = info.roi
    return factory.make(
        "sensor_msgs/msg/CameraInfo",
        header=make_header(factory, header.frame_id, header.stamp_ns),
        width=info.width,
        height=info.height,
        distortion_model=info.distortion_model,
        d=np.array(info.d, dtype=np.float64),
        k=np.array(info.k, dtype=np.float64),
        r=np.array(info.r, dtype=np.float64),
        p=np.array(info.p, dtype=np.float64),
        binning_x=info.binning_x,
        binning_y=info.binning_y,
        roi=factory.make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=x, y_offset=y, width=width, height=height
        ),
    )


def make_path(factory: MessageFactory, path: StampedPoints) -> Any:
    """Return a nav_msgs/Path through the points, its poses unturned."""
    header = make_header(factory, path.frame_id, path.stamp_ns)
    unturned = np.array((0.0, 0.0, 0.0, 1.0))
    poses = [
        factory.make(
            "geometry_msgs/msg/PoseStamped",
            header=header,
            pose=make_pose(factory, RigidTransform(point.copy(), unturned)),
        )
        for point in path.points_m
    ]
    return factory.make("nav_msgs/msg/Path", header=header, poses=poses)


def make_clicked_point(factory: MessageFactory, point: StampedPoints) -> Any:
    """Return the geometry_msgs/PointStamped of the first point."""
    return factory.make(
        "geometry_msgs/msg/PointStamped",
        header=make_header(factory, point.frame_id, point.stamp_ns),
        point=make_point(factory, point.points_m[0]),
    )


def make_scan(factory: MessageFactory, scan: LaserScan) -> Any:
    """Return the sensor_msgs/LaserScan of a scan; its arrays are views."""
    return factory.make(
        "sensor_msgs/msg/LaserScan",
        header=make_header(factory, scan.frame_id, scan.stamp_ns),
        angle_min=scan.angle_min_rad,
        angle_max=scan.angle_max_rad,
        angle_increment=scan.angle_increment_rad,
        time_increment=scan.time_increment_s,
        scan_time=scan.scan_time_s,
        range_min=scan.range_min_m,
        range_max=scan.range_max_m,
        ranges=scan.ranges,
        intensities=scan.intensities,
    )


def make_twist(factory: MessageFactory, linear_m_s: Values, angular_rad_s: Values) -> Any:
    """Return a geometry_msgs/Twist."""
    return factory.make(
        "geometry_msgs/msg/Twist",
        linear=make_vector(factory, linear_m_s),
        angular=make_vector(factory, angular_rad_s),
    )
