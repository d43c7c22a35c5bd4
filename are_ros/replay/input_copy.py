"""The inputs of a replay beside its outputs: `--with-inputs`."""

from collections.abc import Mapping
from contextlib import suppress
from struct import error as StructError  # noqa: N812
from typing import Any

from are_ros.errors import AreError
from are_ros.messages.cloud import Points, make_cloud
from are_ros.messages.factory import MessageFactory
from are_ros.messages.grid import make_grid
from are_ros.messages.transform_encoding import encode_transforms_cdr
from are_ros.messages.transforms import StampedTransform, make_transforms
from are_ros.replay.bag_reader import BagMessage, BagReader
from are_ros.replay.bag_writer import BagWriter
from are_ros.replay.message_types import jazzy_typestore
from are_ros.world.occupancy_grid import OccupancyGrid

_LATCHED_ROLES = ("map", "octomap_point_cloud_centers", "tf_static")
_TRANSFORMS = "tf2_msgs/msg/TFMessage"
_TYPES = {"tf/msg/tfMessage": _TRANSFORMS}
_BASE_KIND, _MESSAGE_KIND, _ARRAY_KIND = 1, 2, 3


class InputCopy:
    """Writes the messages that the replay read under their own topics, as ROS 2 messages."""

    def __init__(
        self,
        reader: BagReader,
        writer: BagWriter,
        factory: MessageFactory,
        roles: Mapping[str, str],
    ) -> None:
        """Announce the topics; `roles` maps each topic that is read to its role."""
        self._reader = reader
        self._writer = writer
        self._factory = factory
        self._types: dict[str, str] = {}
        for topic in reader.topics:
            if topic.name in roles and topic.name not in self._types:
                type_name = _TYPES.get(topic.type_name, topic.type_name)
                self._types[topic.name] = type_name
                is_latched = roles[topic.name] in _LATCHED_ROLES
                writer.add_topic(topic.name, type_name, is_latched=is_latched, depth=100)

    def write(self, message: BagMessage, received_ns: int) -> None:
        """Append one input; one that cannot be understood is left out, as the builder did."""
        if message.topic not in self._types:
            return
        if not self._reader.is_ros1:
            self._writer.write_raw(message.topic, received_ns, message.data)
            return
        try:
            data = self._as_ros2(message)
        except AreError:
            return
        self._writer.write_raw(message.topic, received_ns, data)

    def _as_ros2(self, message: BagMessage) -> bytes | memoryview:
        """Return the bytes of a ROS 1 message as ROS 2 has them. Raises InputError, BagError."""
        type_name = self._types[message.topic]
        if type_name == _TRANSFORMS:
            with suppress(StructError):  # a stamp that ROS 2 has not: let the general way complain
                return encode_transforms_cdr(self._reader.transforms(message))
        original = self._reader.deserialize(message)
        data: memoryview = jazzy_typestore().serialize_cdr(
            converted(self._factory, original, type_name), type_name
        )
        return data

    def write_map(self, topic: str, grid: OccupancyGrid, now_ns: int) -> None:
        """Append the map that came from a file, once."""
        if topic not in self._types:
            self._types[topic] = "nav_msgs/msg/OccupancyGrid"
            self._writer.add_topic(topic, self._types[topic], is_latched=True, depth=1)
        self._writer.write(topic, now_ns, make_grid(self._factory, grid))

    def write_cloud(self, centres_m: Points, frame_id: str, now_ns: int) -> None:
        """Append the voxels (N, 3) [m] that came from a file, once."""
        topic = "/octomap_point_cloud_centers"
        self._types[topic] = "sensor_msgs/msg/PointCloud2"
        self._writer.add_topic(topic, self._types[topic], is_latched=True, depth=1)
        self._writer.write(topic, now_ns, make_cloud(self._factory, frame_id, now_ns, centres_m))

    def write_static(self, transforms: list[StampedTransform], now_ns: int) -> None:
        """Append the static transforms that were given as parameters."""
        topic = "/tf_static"
        if topic not in self._types:
            self._types[topic] = _TRANSFORMS
            self._writer.add_topic(topic, self._types[topic], is_latched=True, depth=100)
        self._writer.write(topic, now_ns, make_transforms(self._factory, transforms))


def converted(factory: MessageFactory, original: Any, type_name: str) -> Any:
    """Return a ROS 1 message object as the ROS 2 type of its name, field by field.

    What ROS 2 left out (Header.seq) is dropped, what it added has its default, and the upper case
    of CameraInfo's D, K, R, P is folded.
    """
    fields = {}
    for name, description in jazzy_typestore().fielddefs[type_name][1]:
        source = name if hasattr(original, name) else name.upper()
        if hasattr(original, source):
            fields[name] = _converted_field(factory, getattr(original, source), description)
    return factory.make(type_name, **fields)


def _converted_field(factory: MessageFactory, value: Any, description: Any) -> Any:
    kind, detail = int(description[0]), description[1]
    if kind == _BASE_KIND:
        return value
    if kind == _MESSAGE_KIND:
        return converted(factory, value, detail)
    element = detail[0]
    if int(element[0]) == _MESSAGE_KIND:
        return [converted(factory, one, element[1]) for one in value]
    return value
