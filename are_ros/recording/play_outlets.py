"""The publishers of a player: topics as recorded, bytes as they are."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from are_ros.errors import AreError, NodeError
from are_ros.node.message_classes import message_class
from are_ros.recording.play_options import PlayOptions
from are_ros.replay.bag_reader import BagMessage, BagReader, BagTopic
from are_ros.replay.input_copy import converted
from are_ros.replay.message_types import RosbagsFactory, jazzy_typestore

CLOCK: Final = "/clock"
LARGE_BYTES: Final = 60_000
"""More does not fit into one packet, and packets may be lost on the way and be sent again."""
_DEPTH: Final = 100
_RENAMED: Final = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}


class PlayOutlets:
    """Publishes recorded messages; topics whose type is not installed are skipped, with a reason.

    Quality of service is as recorded; in lockstep all are reliable, so that nothing is lost.
    """

    def __init__(
        self, node: Node, reader: BagReader, options: PlayOptions, say: Callable[[str], None]
    ) -> None:
        self.skipped: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        self._reader = reader
        self._factory = RosbagsFactory()
        self._types: dict[str, str] = {}
        self._recorded_types: dict[str, str] = {}
        self._publishers: dict[str, Any] = {}
        self._latched: set[str] = set()
        self._unacknowledged: set[str] = set()
        for topic in reader.topics:
            if topic.count and options.is_chosen(topic.name):
                self._open(node, topic, options, say)

    @property
    def topics(self) -> tuple[str, ...]:
        """The recorded names of the topics that are played."""
        return tuple(self._publishers)

    @property
    def publishers(self) -> Mapping[str, Any]:
        """The publishers, by recorded name."""
        return self._publishers

    def publish(self, message: BagMessage) -> None:
        """Send a message; one of ROS 1 that cannot be understood is counted as skipped.

        A topic that was recorded with two types is played with the first.
        """
        topic = message.topic
        if message.connection.msgtype != self._recorded_types[topic]:
            return
        if self._reader.is_ros1:
            try:
                original = self._reader.deserialize(message)
            except AreError as cause:
                self.skipped[topic] = str(cause)
                return
            data = self._as_ros2(topic, original)
        else:
            data = bytes(message.data)
        self._publishers[topic].publish(data)
        self.counts[topic] += 1
        if topic in self._latched and len(data) > LARGE_BYTES:
            self._unacknowledged.add(topic)

    def target(self, topic: str) -> str:
        """Return the name under which a recorded topic is played."""
        return str(self._publishers[topic].topic_name)

    def has_listeners(self, topic: str) -> bool:
        """Tell whether anybody subscribes to a topic, by its recorded name."""
        return bool(self._publishers[topic].get_subscription_count())

    def wait_until_acknowledged(self, topic: str, timeout_s: float) -> bool:
        """Wait until reliable subscribers have all of a topic; tell whether they do."""
        return bool(self._publishers[topic].wait_for_all_acked(Duration(seconds=timeout_s)))

    def wait_for_latched(self, timeout_s: float) -> bool:
        """Wait until reliable subscribers have what is latched; tell whether there was any.

        These are maps and clouds: of many fragments, of which one that is lost comes again only
        with the next heartbeat of DDS, seconds later.
        """
        limit = Duration(seconds=timeout_s)
        waiting, self._unacknowledged = self._unacknowledged, set()
        for topic in waiting:
            self._publishers[topic].wait_for_all_acked(limit)
        return bool(waiting)

    def _as_ros2(self, topic: str, original: Any) -> bytes:
        type_name = self._types[topic]
        message = converted(self._factory, original, type_name)
        return bytes(jazzy_typestore().serialize_cdr(message, type_name))

    def _open(
        self, node: Node, topic: BagTopic, options: PlayOptions, say: Callable[[str], None]
    ) -> None:
        type_name = _RENAMED.get(topic.type_name, topic.type_name)
        try:
            publisher = self._publisher(node, topic, type_name, options)
        except NodeError as cause:
            self.skipped[topic.name] = str(cause)
            say(f"{topic.name} is not played: {cause}")
            return
        self._recorded_types[topic.name] = topic.type_name
        self._types[topic.name] = type_name
        self._publishers[topic.name] = publisher
        self.counts[topic.name] = 0
        if topic.is_latched:
            self._latched.add(topic.name)

    def _publisher(self, node: Node, topic: BagTopic, type_name: str, options: PlayOptions) -> Any:
        """Return a new publisher; NodeError, with the reason, where there can be none."""
        if topic.name == CLOCK and options.clock_hz:
            raise NodeError("the player tells the time itself")
        if topic.name in self._types:
            raise NodeError(f"as {type_name}, since it is played as {self._types[topic.name]}")
        target = options.target(topic.name)
        try:
            return node.create_publisher(message_class(type_name), target, _qos(topic, options))
        except InvalidTopicNameException as cause:
            message = f"{target} is no name of a topic in ROS 2; --remap gives it another"
            raise NodeError(message) from cause


def _qos(topic: BagTopic, options: PlayOptions) -> QoSProfile:
    is_reliable = topic.is_reliable or bool(options.lockstep)
    return QoSProfile(
        depth=1 if options.lockstep and "static" not in topic.name else _DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if is_reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=(
            DurabilityPolicy.TRANSIENT_LOCAL if topic.is_latched else DurabilityPolicy.VOLATILE
        ),
    )
