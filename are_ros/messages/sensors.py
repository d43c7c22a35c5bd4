"""The kinds of sensors whose readings are augmented, and their messages <-> the core's readings.

To add a kind takes four places: its reading in `builder/sensors/` (a class with the methods of
`sensor_path.Reading`, and a `miniature`), its message and its entry in `SENSORS` here, the
parameter of its topics in `SensorsParameters`, and its sample in `checks/sensors/samples.py`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from struct import Struct
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from are_ros.builder.sensors.colour_image import ColourImage
from are_ros.builder.sensors.depth_image import DepthImage
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.builder.sensors.point_cloud import CloudField, PointCloud
from are_ros.builder.sensors.range_reading import RangeReading
from are_ros.builder.sensors.sensor_path import MakeReading, Reading, ReleasedReading
from are_ros.errors import ParameterError
from are_ros.messages.cdr import CdrWriter
from are_ros.messages.common import read_array, read_time
from are_ros.messages.images.colour import (
    encode_colour,
    encode_mask,
    encode_truth,
    read_colour,
)
from are_ros.messages.images.depth import encode_depth, read_depth
from are_ros.messages.images.detections import encode_boxes
from are_ros.messages.images.image import camera_info_topic, encode_camera_info, transport_of
from are_ros.parameters.model import SensorsParameters


def read_scan(message: Any, source: str = "scan") -> LaserScan:
    """Return the scan of a message, whose data are viewed; InputError as `LaserScan.checked`."""
    return LaserScan(
        frame_id=str(message.header.frame_id).lstrip("/"),
        stamp_ns=read_time(message.header.stamp),
        angle_min_rad=float(message.angle_min),
        angle_max_rad=float(message.angle_max),
        angle_increment_rad=float(message.angle_increment),
        time_increment_s=float(message.time_increment),
        scan_time_s=float(message.scan_time),
        range_min_m=float(message.range_min),
        range_max_m=float(message.range_max),
        ranges=read_array(message.ranges, np.float32),
        intensities=read_array(message.intensities, np.float32),
    ).checked(source)


_NUMBERS: Final = Struct("<7f")


def encode_scan(scan: LaserScan) -> bytes:
    """Return a sensor_msgs/LaserScan."""
    writer = CdrWriter()
    writer.header(scan.frame_id, scan.stamp_ns)
    writer.pack(
        _NUMBERS,
        4,
        scan.angle_min_rad,
        scan.angle_max_rad,
        scan.angle_increment_rad,
        scan.time_increment_s,
        scan.scan_time_s,
        scan.range_min_m,
        scan.range_max_m,
    )
    writer.numbers(scan.ranges, "<f4")
    writer.numbers(scan.intensities, "<f4")
    return writer.message()


def read_range(message: Any, source: str = "range") -> RangeReading:
    """Return the reading of a sensor_msgs/Range; InputError as `RangeReading.checked`."""
    return RangeReading(
        frame_id=str(message.header.frame_id).lstrip("/"),
        stamp_ns=read_time(message.header.stamp),
        radiation_type=int(message.radiation_type),
        field_of_view_rad=float(message.field_of_view),
        min_range_m=float(message.min_range),
        max_range_m=float(message.max_range),
        range_m=float(message.range),
        variance_m2=float(getattr(message, "variance", 0.0)),  # ROS 1 and Humble have none
    ).checked(source)


_RANGE_NUMBERS: Final = Struct("<5f")


def encode_range(reading: RangeReading) -> bytes:
    """Return a sensor_msgs/Range."""
    writer = CdrWriter()
    writer.header(reading.frame_id, reading.stamp_ns)
    writer.byte(reading.radiation_type)
    writer.pack(
        _RANGE_NUMBERS,
        4,
        reading.field_of_view_rad,
        reading.min_range_m,
        reading.max_range_m,
        reading.range_m,
        reading.variance_m2,
    )
    return writer.message()


def read_cloud(message: Any, source: str = "points") -> PointCloud:
    """Return the cloud of a message, whose data are viewed; InputError as `PointCloud.checked`."""
    fields = [
        CloudField(str(one.name), int(one.offset), int(one.datatype), int(one.count))
        for one in message.fields
    ]
    return PointCloud.checked(
        read_array(message.data, np.uint8),
        frame_id=str(message.header.frame_id).lstrip("/"),
        stamp_ns=read_time(message.header.stamp),
        fields=fields,
        is_bigendian=bool(message.is_bigendian),
        is_dense=bool(message.is_dense),
        shape=(int(message.height), int(message.width)),
        steps=(int(message.row_step), int(message.point_step)),
        source=source,
    )


def encode_cloud(cloud: PointCloud) -> bytes:
    """Return a sensor_msgs/PointCloud2."""
    height, row_step = cloud.data.shape
    writer = CdrWriter()
    writer.header(cloud.frame_id, cloud.stamp_ns)
    writer.count(height)
    writer.count(cloud.width)
    writer.count(len(cloud.fields))
    for name, offset, datatype, numbers in cloud.fields:
        writer.text(name)
        writer.count(offset)
        writer.byte(datatype)
        writer.count(numbers)
    writer.byte(cloud.is_bigendian)
    writer.count(cloud.point_step)
    writer.count(row_step)
    writer.count(cloud.data.size)
    # joined once: a large cloud's bytes are copied once
    data = np.ascontiguousarray(cloud.data).data
    return b"".join((writer.message(), data, bytes((cloud.is_dense,))))


@dataclass(frozen=True)
class SensorKind:
    """A kind of sensor: subscriptions, outputs, replays and recordings follow from its entry.

    `role` names the input of a replay, the default topic and, without an `output`, the output if
    there is one topic. `parameter` is the field of `SensorsParameters` with the topics.
    `read(message, topic)` raises InputError; `encode` returns little-endian XCDR1 with its
    encapsulation. A kind with `compressed_type` is one of images: topics that end with a transport
    of image_transport are of that type, and a CameraInfo comes beside each. Where several kinds
    share a type, one with a `telltale` takes the topics that have it in their name. `noun` is what
    sentences call a reading, without it the role.
    """

    role: str
    type_name: str
    parameter: str
    read: Callable[[Any, str], Reading]
    encode: Callable[[Any], bytes]
    miniature: MakeReading
    compressed_type: str = ""
    output: str = ""
    telltale: str = ""
    noun: str = ""

    @property
    def type_names(self) -> tuple[str, ...]:
        """The types of its messages."""
        return (self.type_name, self.compressed_type) if self.is_image else (self.type_name,)

    @property
    def is_image(self) -> bool:
        """Whether a CameraInfo belongs to each reading."""
        return bool(self.compressed_type)

    def type_of(self, topic: str) -> str:
        """Return the type of the messages of a topic."""
        return self.compressed_type if self.is_image and transport_of(topic) else self.type_name

    def output_of(self, topic: str) -> str:
        """Return the output of the only topic of the kind."""
        transport = transport_of(topic) if self.is_image else ""
        name = self.output or self.role
        return f"{name}/{transport}" if transport else name

    def topics(self, parameters: SensorsParameters) -> tuple[str, ...]:
        """Return the topics that the parameters name."""
        topics: tuple[str, ...] = getattr(parameters, self.parameter)
        return topics

    def is_by_role(self, parameters: SensorsParameters) -> bool:
        """Return whether the topic is the role's own: a replay then finds it by name and type."""
        return self.topics(parameters) == (self.role,)


_KINDS: Final = (
    SensorKind(
        "scan",
        "sensor_msgs/msg/LaserScan",
        "scans",
        read_scan,
        encode_scan,
        LaserScan.miniature,
    ),
    SensorKind(
        "range",
        "sensor_msgs/msg/Range",
        "ranges",
        read_range,
        encode_range,
        RangeReading.miniature,
    ),
    SensorKind(
        "points",
        "sensor_msgs/msg/PointCloud2",
        "clouds",
        read_cloud,
        encode_cloud,
        PointCloud.miniature,
        noun="cloud",
    ),
    SensorKind(
        "depth",
        "sensor_msgs/msg/Image",
        "depths",
        read_depth,
        encode_depth,
        DepthImage.miniature,
        compressed_type="sensor_msgs/msg/CompressedImage",
        output="depth/image",
        telltale="depth",
        noun="depth image",
    ),
    SensorKind(
        "image",
        "sensor_msgs/msg/Image",
        "images",
        read_colour,
        encode_colour,
        ColourImage.miniature,
        compressed_type="sensor_msgs/msg/CompressedImage",
        output="camera/image",
    ),
)
SENSORS: Final[Mapping[str, SensorKind]] = MappingProxyType({kind.role: kind for kind in _KINDS})
"""The kinds of sensors by role."""

MINIATURES: Final = tuple(kind.miniature for kind in _KINDS)
"""What `warm_up` needs for every kind."""

CAMERA_INFO: Final = "camera_info"
"""The role of a topic that only has the CameraInfo of images."""
CAMERA_INFO_TYPE: Final = "sensor_msgs/msg/CameraInfo"


@dataclass(frozen=True)
class TruthTopic:
    """A topic beside each painted image, on its name and `suffix`: the truth about it."""

    suffix: str
    type_name: str
    encode: Callable[[Any], bytes | None]


_MASK: Final = TruthTopic("mask", "sensor_msgs/msg/Image", encode_mask)
_TRUTH: Final = TruthTopic("truth", "are_msgs/msg/ImageTruth", encode_truth)
_BOXES: Final = TruthTopic("boxes", "vision_msgs/msg/Detection2DArray", encode_boxes)


OUTPUT_TYPES: Final = frozenset(
    (
        *(name for kind in SENSORS.values() for name in kind.type_names),
        CAMERA_INFO_TYPE,
        *(topic.type_name for topic in (_MASK, _TRUTH, _BOXES)),
    )
)
"""The types of all outputs of sensors."""


def noun_of(role: str) -> str:
    """Return what sentences call a reading of a sensor: "scan", "cloud"."""
    return SENSORS[role].noun or role


def sensor_topics(roles: Mapping[str, str]) -> dict[str, SensorKind]:
    """Return the kind of each topic that is a sensor's, of the roles by topic."""
    return {topic: SENSORS[role] for topic, role in roles.items() if role in SENSORS}


_DEFAULTS: Final = SensorsParameters()


def lens_topics(roles: Mapping[str, str], sensors: SensorsParameters = _DEFAULTS) -> dict[str, str]:
    """Return the topic of the CameraInfo of each topic of images, of the roles by topic.

    It is beside the images unless the parameters name another; ParameterError where they do so for
    what is no topic of images.
    """
    images = [topic for topic, kind in sensor_topics(roles).items() if kind.is_image]
    given = sensors.info_by_image
    for topic in given:
        if topic not in images:
            known = ", ".join(sorted(images)) or "there are none"
            raise ParameterError(
                f"parameter 'sensors.camera_infos': {topic} is no topic of images that are"
                f" augmented: {known}"
            )
    return {topic: given.get(topic) or camera_info_topic(topic) for topic in images}


def sensor_outputs(roles: Mapping[str, str]) -> dict[str, str]:
    """Return the output of each sensor's topic: the role's, or with several of a kind its own name.

    `roles` are the roles by topic; those that are no sensors are left out.
    """
    players = list(roles.values())
    return {
        topic: kind.output_of(topic) if players.count(kind.role) == 1 else topic.lstrip("/")
        for topic, kind in sensor_topics(roles).items()
    }


class SensorOutputs:
    """The outputs of the sensors among the roles, and their messages.

    `names` are the outputs by topic; `types` those of all messages by output. Beside each image
    goes its CameraInfo, with the image's stamp, and the truth about what is painted, as far as the
    parameters ask for it.
    """

    def __init__(self, roles: Mapping[str, str], sensors: SensorsParameters = _DEFAULTS) -> None:
        self.names = sensor_outputs(roles)
        self._kinds = sensor_topics(roles)
        lenses = lens_topics(roles, sensors)
        self._infos = {topic: camera_info_topic(self.names[topic]) for topic in lenses}
        self.types = {name: self._kinds[topic].type_of(topic) for topic, name in self.names.items()}
        self.types |= dict.fromkeys(self._infos.values(), CAMERA_INFO_TYPE)
        asked = [_MASK] if sensors.masks else []
        asked += [_TRUTH, _BOXES] if sensors.boxes else []
        self._truths = {
            topic: [(f"{self.names[topic]}/{one.suffix}", one) for one in asked]
            for topic, kind in self._kinds.items()
            if kind.role == "image"
        }
        for truths in self._truths.values():
            self.types |= {name: truth.type_name for name, truth in truths}
        self._relays: dict[str, list[str]] = {t: [name] for t, name in self.names.items()}
        for topic, info in lenses.items():
            self._relays.setdefault(info, []).append(self._infos[topic])

    def messages(self, released: ReleasedReading) -> list[tuple[str, bytes]]:
        """Return the messages of a reading: the output and the bytes of each."""
        topic, reading = released.topic, released.reading
        found = [(self.names[topic], self._kinds[topic].encode(reading))]
        if topic in self._infos and reading.lens is not None:
            info, frame_id = reading.lens.info, reading.lens.frame_id
            data = encode_camera_info(info, frame_id, reading.stamp_ns)
            found.insert(0, (self._infos[topic], data))
        for name, truth in self._truths.get(topic, ()):
            told = truth.encode(reading)
            if told is not None:
                found.append((name, told))
        return found

    def relays_of(self, topic: str) -> list[str]:
        """Return the outputs that a topic goes out on where nothing is augmented."""
        return self._relays.get(topic, [])
