"""The messages of a recording as plain, immutable values: the node's outputs, and its inputs.

`value_of` chooses by the type of the message. These conversions share no code with those that wrote
the messages. Every value has `at_ns`, the time at which it counts; see `recording.RecordedMessage`.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields
from functools import cached_property
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from are_ros.messages.common import read_quaternion, read_time, read_vector
from are_ros.messages.transforms import (
    OdometryNumbers,
    StampedTransform,
    read_odometry_numbers,
    read_transforms,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

ARRIVED, DEPARTED, BLOCKED, DISPLACED, PERCEIVED, LOST, ROBOT_CONTACT, CHANGED = range(8)
"""The kinds of are_msgs/ArtefactEvent."""

_ACTIVITY: Final = "activity"


@dataclass(frozen=True, eq=False)
class Scene:
    """The N artefacts alive at a tick, as arrays; from are_msgs/ArtefactArray.

    `ids`, `arrivals_ns`, `departures_ns` (0: unknown), `rows` and `origins` are int64 (N,). The
    boxes, upright and turned by `yaws_rad` (N,), are in the frame of the message: `centres_m` and
    `half_sizes_m` (N, 3) float64. `poses` (of F_A) and `ground_poses` (N, 7) are x, y, z [m] and
    the quaternion x, y, z, w; `box_centres_m` (N, 3) is in F_A; `twists` (N, 6) are linear [m/s]
    and angular [rad/s] in F_A. The texts are N each.
    """

    stamp_ns: int
    at_ns: int
    frame_id: str
    ids: Integers
    centres_m: Floats
    yaws_rad: Floats
    half_sizes_m: Floats
    arrivals_ns: Integers
    departures_ns: Integers
    labels: tuple[str, ...] = ()
    classes: tuple[str, ...] = ()
    behaviours: tuple[str, ...] = ()
    activities: tuple[str, ...] = ()
    rows: Integers = field(default_factory=lambda: np.empty(0, np.int64))
    origins: Integers = field(default_factory=lambda: np.empty(0, np.int64))
    poses: Floats = field(default_factory=lambda: np.empty((0, 7)))
    ground_poses: Floats = field(default_factory=lambda: np.empty((0, 7)))
    box_centres_m: Floats = field(default_factory=lambda: np.empty((0, 3)))
    twists: Floats = field(default_factory=lambda: np.empty((0, 6)))

    @cached_property
    def rates(self) -> Floats:
        """The rates of x, y [m/s] and yaw [rad/s] of F_A in the frame of the message, (N, 3)."""
        cos, sin = np.cos(self.yaws_rad), np.sin(self.yaws_rad)
        along, across, turn = self.twists[:, 0], self.twists[:, 1], self.twists[:, 5]
        return np.column_stack((cos * along - sin * across, sin * along + cos * across, turn))

    def is_like(self, other: "Scene | None") -> bool:
        """Return whether the same boxes stand at the same places."""
        return (
            other is not None
            and np.array_equal(self.ids, other.ids)
            and np.array_equal(self.centres_m, other.centres_m)
            and np.array_equal(self.yaws_rad, other.yaws_rad)
        )


class Sighting(NamedTuple):
    """One perceived artefact. `roi` is x, y, width and height in pixels.

    `pose` are 7 numbers, x, y, z [m] and the quaternion, `size_m` 3, `twist` 6 in the axes of the
    pose, linear [m/s] and angular [rad/s]; covariances are 36 numbers, row by row.
    """

    artefact_id: int
    visible_pixels: int
    unoccluded_pixels: int
    visible_fraction: float
    range_m: float
    existence: float
    classes: tuple[str, ...]
    probabilities: tuple[float, ...]
    roi: tuple[int, int, int, int]
    last_seen_ns: int
    pose: tuple[float, ...] = ()
    pose_covariance: tuple[float, ...] = ()
    size_m: tuple[float, ...] = ()
    twist: tuple[float, ...] = ()
    twist_covariance: tuple[float, ...] = ()
    cameras: tuple[str, ...] = ()
    behaviours: tuple[str, ...] = ()
    behaviour_probabilities: tuple[float, ...] = ()


@dataclass(frozen=True)
class Perceived:
    """The artefacts that the robot perceives at a tick, an are_msgs/PerceivedArtefactArray."""

    stamp_ns: int
    at_ns: int
    frame_id: str
    sightings: tuple[Sighting, ...]

    @cached_property
    def ids(self) -> frozenset[int]:
        """The ids of the perceived."""
        return frozenset(each.artefact_id for each in self.sightings)


@dataclass(frozen=True, eq=False)
class Predicted:
    """The paths of the perceived by id, an are_msgs/PredictedPathArray.

    A path is float64 (K, 43): the pose, 7 numbers, and its covariance, 36.
    """

    stamp_ns: int
    at_ns: int
    frame_id: str
    step_ns: int
    paths: MappingProxyType[int, Floats]


@dataclass(frozen=True)
class Event:
    """An are_msgs/ArtefactEvent; `kind` is one of the constants of this module."""

    stamp_ns: int
    at_ns: int
    kind: int
    artefact_id: int
    label: str
    detail: str
    value: float


@dataclass(frozen=True)
class Metrics:
    """An are_msgs/SceneMetrics: counts at a tick, or since the start; areas in m^2."""

    stamp_ns: int
    at_ns: int
    frame_id: str
    alive: int
    perceived: int
    arrivals: int
    departures: int
    blocked: int
    displaced: int
    robot_contacts: int
    area_m2: float
    clutter_ratio: float
    rho: float


@dataclass(frozen=True, eq=False)
class Grid:
    """A nav_msgs/OccupancyGrid: flat `data` int8, and its corner's pose, 7 numbers, in the frame.

    `data` holds height times width cells, row by row, unless the message is malformed.
    """

    stamp_ns: int
    at_ns: int
    frame_id: str
    width: int
    height: int
    resolution_m: float
    origin: tuple[float, ...]
    data: NDArray[np.int8]

    @property
    def cells(self) -> NDArray[np.int8]:
        """The cells, int8 (height, width); ValueError where the data do not fit the size."""
        return self.data.reshape(self.height, self.width)

    @property
    def corner(self) -> tuple[float, float, float]:
        """The corner's x, y [m] and yaw [rad] in the frame."""
        yaw_rad = 2.0 * float(np.arctan2(self.origin[5], self.origin[6]))
        return self.origin[0], self.origin[1], yaw_rad


@dataclass(frozen=True, eq=False)
class GridUpdate:
    """A map_msgs/OccupancyGridUpdate: flat `data` int8 of a window of the grid, in cells."""

    stamp_ns: int
    at_ns: int
    x: int
    y: int
    width: int
    height: int
    data: NDArray[np.int8]


@dataclass(frozen=True)
class Transforms:
    """A tf2_msgs/TFMessage."""

    at_ns: int
    samples: tuple[StampedTransform, ...]


@dataclass(frozen=True)
class Odometry:
    """The pose of a nav_msgs/Odometry; the child frame is empty where the message names none."""

    at_ns: int
    numbers: OdometryNumbers


@dataclass(frozen=True)
class ImageFormat:
    """Of a sensor_msgs/CameraInfo the size in pixels of the image: region and binning applied.

    `message` has all fields, for `messages.images.image`.
    """

    at_ns: int
    width: int
    height: int
    message: Any


def value_of(type_name: str, message: Any, at_ns: int) -> Any:
    """Return the value of a message; one of a type that has none is returned as it is.

    ValueError or OverflowError for numbers that no such message may have.
    """
    make = _MAKERS.get(type_name)
    return message if make is None else make(message, at_ns)


def _scene(message: Any, at_ns: int) -> Scene:
    artefacts = message.artefacts
    poses = _rows((_pose(a.pose) for a in artefacts), 7)
    offsets = _rows((read_vector(a.box_centre) for a in artefacts), 3)
    yaws = 2.0 * np.arctan2(poses[:, 5], poses[:, 6])
    cos, sin = np.cos(yaws), np.sin(yaws)
    turned = np.column_stack(
        (
            cos * offsets[:, 0] - sin * offsets[:, 1],
            sin * offsets[:, 0] + cos * offsets[:, 1],
            offsets[:, 2],
        )
    )
    return Scene(
        stamp_ns=read_time(message.header.stamp),
        at_ns=at_ns,
        frame_id=message.header.frame_id,
        ids=np.array([a.id for a in artefacts], np.int64),
        centres_m=poses[:, :3] + turned,
        yaws_rad=yaws,
        half_sizes_m=0.5 * _rows((read_vector(a.size) for a in artefacts), 3),
        arrivals_ns=np.array([read_time(a.arrival) for a in artefacts], np.int64),
        departures_ns=np.array([read_time(a.departure) for a in artefacts], np.int64),
        labels=tuple(a.label for a in artefacts),
        classes=tuple(a.class_name for a in artefacts),
        behaviours=tuple(a.behaviour for a in artefacts),
        activities=tuple(_activity(a) for a in artefacts),
        rows=np.array([a.row for a in artefacts], np.int64),
        origins=np.array([a.origin for a in artefacts], np.int64),
        poses=poses,
        ground_poses=_rows((_pose(a.ground_pose) for a in artefacts), 7),
        box_centres_m=offsets,
        twists=_rows((_twist(a.twist) for a in artefacts), 6),
    )


def _activity(artefact: Any) -> str:
    """Return the activity among the features of an artefact, empty where there is none."""
    return next((str(f.value) for f in artefact.features if f.key == _ACTIVITY), "")


def _perceived(message: Any, at_ns: int) -> Perceived:
    header, sightings = message.header, tuple(_sighting(one) for one in message.artefacts)
    return Perceived(read_time(header.stamp), at_ns, header.frame_id, sightings)


def _sighting(one: Any) -> Sighting:
    roi = one.roi
    return Sighting(
        int(one.id),
        int(one.visible_pixels),
        int(one.unoccluded_pixels),
        float(one.visible_fraction),
        float(one.range),
        float(one.existence),
        tuple(one.classes),
        tuple(float(p) for p in one.probabilities),
        (int(roi.x_offset), int(roi.y_offset), int(roi.width), int(roi.height)),
        read_time(one.last_seen),
        _pose(one.pose.pose),
        tuple(one.pose.covariance.tolist()),
        read_vector(one.size),
        _twist(one.twist.twist),
        tuple(one.twist.covariance.tolist()),
        # Recordings of before have none of these.
        tuple(getattr(one, "cameras", ())),
        tuple(getattr(one, "behaviours", ())),
        tuple(float(p) for p in getattr(one, "behaviour_probabilities", ())),
    )


def _predicted(message: Any, at_ns: int) -> Predicted:
    paths = {
        int(path.id): _rows(((*_pose(p.pose), *p.covariance.tolist()) for p in path.poses), 43)
        for path in message.paths
    }
    stamp_ns, step_ns = read_time(message.header.stamp), read_time(message.step)
    return Predicted(stamp_ns, at_ns, message.header.frame_id, step_ns, MappingProxyType(paths))


def _event(message: Any, at_ns: int) -> Event:
    stamp_ns, number = read_time(message.header.stamp), int(message.id)
    texts = str(message.label), str(message.detail)
    return Event(stamp_ns, at_ns, int(message.kind), number, *texts, float(message.value))


def _metrics(message: Any, at_ns: int) -> Metrics:
    header = message.header
    numbers = {one.name: getattr(message, one.name) for one in fields(Metrics)[3:]}
    return Metrics(read_time(header.stamp), at_ns, header.frame_id, **numbers)


def _grid(message: Any, at_ns: int) -> Grid:
    header, info = message.header, message.info
    return Grid(
        read_time(header.stamp),
        at_ns,
        header.frame_id.lstrip("/"),
        int(info.width),
        int(info.height),
        info.resolution,
        _pose(info.origin),
        np.asarray(message.data, np.int8),
    )


def _grid_update(message: Any, at_ns: int) -> GridUpdate:
    window = (int(message.x), int(message.y), int(message.width), int(message.height))
    data = np.asarray(message.data, np.int8)
    return GridUpdate(read_time(message.header.stamp), at_ns, *window, data)


def _transforms(message: Any, at_ns: int) -> Transforms:
    return Transforms(at_ns, tuple(read_transforms(message)))


def _odometry(message: Any, at_ns: int) -> Odometry:
    return Odometry(at_ns, read_odometry_numbers(message))


def _image_format(message: Any, at_ns: int) -> ImageFormat:
    roi = message.roi
    is_part = roi.width and roi.height
    width, height = (roi.width, roi.height) if is_part else (message.width, message.height)
    size = width // max(message.binning_x, 1), height // max(message.binning_y, 1)
    return ImageFormat(at_ns, *size, message)


_MAKERS: Final[MappingProxyType[str, Callable[[Any, int], Any]]] = MappingProxyType(
    {
        "are_msgs/msg/ArtefactArray": _scene,
        "are_msgs/msg/PerceivedArtefactArray": _perceived,
        "are_msgs/msg/PredictedPathArray": _predicted,
        "are_msgs/msg/ArtefactEvent": _event,
        "are_msgs/msg/SceneMetrics": _metrics,
        "nav_msgs/msg/OccupancyGrid": _grid,
        "map_msgs/msg/OccupancyGridUpdate": _grid_update,
        "tf2_msgs/msg/TFMessage": _transforms,
        "nav_msgs/msg/Odometry": _odometry,
        "sensor_msgs/msg/CameraInfo": _image_format,
    }
)


def _rows(numbers: Iterable[tuple[float, ...]], width: int) -> Floats:
    return np.array(list(numbers), np.float64).reshape(-1, width)


def _pose(pose: Any) -> tuple[float, ...]:
    return (*read_vector(pose.position), *read_quaternion(pose.orientation))


def _twist(twist: Any) -> tuple[float, ...]:
    return (*read_vector(twist.linear), *read_vector(twist.angular))
