"""The topics of the node: subscriptions to its inputs, and publishers of its outputs."""

import time
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from struct import error as StructError  # noqa: N812
from time import monotonic_ns
from typing import Any, Final, NamedTuple

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from are_ros.errors import InputError, NodeError, ParameterError
from are_ros.messages.feed import OTHER_CAMERA
from are_ros.messages.sensors import (
    CAMERA_INFO,
    CAMERA_INFO_TYPE,
    SENSORS,
    SensorOutputs,
    lens_topics,
)
from are_ros.messages.tick_encoding import OUTPUTS, OutputTopic
from are_ros.messages.transforms import (
    OdometryNumbers,
    StampedTransform,
    decode_transforms_cdr,
    is_plain_cdr,
    read_odometry_numbers,
    read_transforms,
)
from are_ros.node.heartbeat import GUARDED_MAPS
from are_ros.node.message_classes import message_class
from are_ros.node.qos import INPUTS, InputSubscription, advertise, input_type
from are_ros.node.watches import InputSnapshot, InputWatch
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import INFO_MARK, Parameters, SensorsParameters
from are_ros.parameters.validation import validated
from are_ros.wording import listed

# Messages as DDS delivers them, and their decoding.


class WireMessage(NamedTuple):
    """A message as DDS delivered it: the full name of its topic, its type, its CDR bytes."""

    topic: str
    type_name: str
    data: bytes


class WireDecoding:
    """Decodes the bytes; InputError, naming the topic, where they are malformed."""

    def deserialize(self, message: WireMessage) -> Any:
        """Return the message object of rclpy."""
        try:
            return deserialize_message(message.data, message_class(message.type_name))
        except Exception as cause:  # rclpy raises RCLError, MemoryError, ...
            raise _malformed(message) from cause

    def transforms(self, message: WireMessage) -> list[StampedTransform]:
        """Return the transforms of a TFMessage; as `deserialize`, quicker."""
        if not is_plain_cdr(message.data):
            return read_transforms(self.deserialize(message))
        try:
            return decode_transforms_cdr(message.data)
        except (StructError, UnicodeDecodeError) as cause:
            raise _malformed(message) from cause

    def odometry(self, message: WireMessage) -> OdometryNumbers:
        """Return the numbers of an Odometry."""
        return read_odometry_numbers(self.deserialize(message))


def _malformed(message: WireMessage) -> InputError:
    size = len(message.data)
    return InputError(f"{message.topic}: {size} bytes that are no {message.type_name}")


_CLOUD: Final = "octomap_point_cloud_centers"
_ALWAYS: Final = ("map", _CLOUD, "odom", "camera/camera_info", "tf", "tf_static", "plan")
_REQUIRED: Final = ("map",)
_COME_ONCE: Final = (_CLOUD, "plan", "clicked_point")
"""These come once, or when somebody wants, also from publishers that do not latch."""

Store = Callable[[WireMessage], None]


class Subscriptions:
    """Subscribes to all inputs, each by its role; `store` gets each message.

    `cameras` are the topics of `camera.others`. What may be latched (maps, static transforms,
    CameraInfo) follows its publishers. An input whose message package is not installed is left out,
    and `say` gets a sentence. Raises ParameterError where an override of its QoS makes no sense.
    """

    def __init__(
        self,
        node: Node,
        sensors: SensorsParameters,
        cameras: Sequence[str],
        store: Store,
        say: Callable[[str], None],
    ) -> None:
        self.roles: dict[str, str] = {}
        self.watches: dict[str, InputWatch] = {}
        self._node = node
        self._store = store
        self._subscriptions: dict[str, InputSubscription] = {}
        asked = [(role, "") for role in (*_ALWAYS, "clicked_point")]
        asked += [(OTHER_CAMERA, topic) for topic in cameras]
        for kind in SENSORS.values():
            asked += [(kind.role, topic) for topic in kind.topics(sensors)]
        try:
            for role, topic in asked:
                self._open(role, topic, say)
            for topic in lens_topics(self.roles, sensors).values():
                known = self.roles.get(self._resolved(topic))
                if known is None or INPUTS[known].type_name != CAMERA_INFO_TYPE:
                    self._open(CAMERA_INFO, topic, say)
        except BaseException:
            self.close()
            raise

    def is_offered(self, role: str) -> bool:
        """Return whether the input of a role has a publisher."""
        topics = [topic for topic, its_role in self.roles.items() if its_role == role]
        return any(self._node.count_publishers(topic) for topic in topics)

    def follow_publishers(self) -> None:
        """Subscribe anew to what its publishers offer otherwise than was asked for."""
        for subscription in self._subscriptions.values():
            subscription.follow()

    def waiting(self, roles: Container[str]) -> Iterator[WireMessage]:
        """Take and yield the messages that DDS holds of some roles, topic by topic."""
        for topic, role in self.roles.items():
            if role not in roles or topic not in self._subscriptions:
                continue
            subscription = self._subscriptions[topic].subscription
            while True:
                with subscription.handle:
                    taken = subscription.handle.take_message(
                        subscription.msg_type, subscription.raw
                    )
                if taken is None:
                    break
                self.watches[topic].received(monotonic_ns())
                yield WireMessage(topic, input_type(role, topic), taken[0])

    def is_time_simulated(self) -> bool:
        """Return whether the node's time is that of /clock."""
        return bool(self._node.get_clock().ros_time_is_active)

    def snapshots(self, now_ns: int) -> Iterator[InputSnapshot]:
        """Yield a snapshot of each input, by the monotonic clock."""
        players = list(self.roles.values())
        for topic, role in self.roles.items():
            is_one_of_several = players.count(role) > 1
            watch, publishers = self.watches[topic], self._node.count_publishers(topic)
            is_silent = publishers > 0 and not watch.count
            yield watch.snapshot(
                now_ns,
                f"{role}{topic}" if is_one_of_several else role,
                topic,
                is_required=role in _REQUIRED,
                is_latched=INPUTS[role].is_latched
                or self._subscriptions[topic].is_latched
                or role in _COME_ONCE,
                publishers=publishers,
                asked=self._asked_of(topic),
                mistyped=self._mistyped(topic, role) if is_silent else "",
            )

    def _asked_of(self, topic: str) -> str:
        """Return the reliability and durability that the publishers of a topic need."""
        profile = self._subscriptions[topic].subscription.qos_profile
        policies = profile.reliability, profile.durability
        return ", ".join(policy.name.lower().replace("_", " ") for policy in policies)

    def _mistyped(self, topic: str, role: str) -> str:
        """Return what its publishers send, and what it is not; "" where one sends what is meant."""
        known = {one.topic_type for one in self._node.get_publishers_info_by_topic(topic)}
        wanted = input_type(role, topic)
        return "" if not known or wanted in known else f"{listed(sorted(known))}, not {wanted}"

    def close(self) -> None:
        """Unsubscribe from all inputs."""
        for one in self._subscriptions.values():
            self._node.destroy_subscription(one.subscription)
        self._subscriptions.clear()

    def _open(self, role: str, topic: str, say: Callable[[str], None]) -> None:
        asked = topic or INPUTS[role].topic or role
        known = self.roles.get(self._resolved(asked))
        if known is not None:
            raise ParameterError(f"topic '{asked}' is given twice, for {known} and for {role}")
        try:
            one = self._subscribed(role, asked)
        except NodeError as cause:
            say(f"{asked} is not received: {cause}")
            return
        name = one.subscription.topic_name
        self.roles[name] = role
        self.watches[name] = InputWatch()
        self._subscriptions[name] = one

    def _subscribed(self, role: str, topic: str) -> InputSubscription:
        name = self._resolved(topic)
        type_name = input_type(role, topic)

        def take(data: bytes) -> None:
            self.watches[name].received(monotonic_ns())
            self._store(WireMessage(name, type_name, data))

        return InputSubscription(self._node, role, take, topic, raw=True)

    def _resolved(self, topic: str) -> str:
        return full_name(self._node, topic)


def with_full_names(node: Node, parameters: Parameters) -> Parameters:
    """Return parameters whose `sensors.camera_infos` have the full names of topics, as roles have.

    ParameterError where one is no name of a topic, or images are given twice.
    """
    infos = parameters.sensors.info_by_image.items()
    names = [f"{full_name(node, one)}{INFO_MARK}{full_name(node, info)}" for one, info in infos]
    return validated(with_values(parameters, {"sensors.camera_infos": names}))


def full_name(node: Node, topic: str) -> str:
    """Return the full name of a topic; ParameterError if it is none."""
    try:
        return str(node.resolve_topic_name(topic))
    except RuntimeError as cause:  # RCLError
        reason = str(cause).partition(", at /")[0].rpartition("failed to resolve name: ")[2]
        raise ParameterError(f"'{topic}' cannot be a topic: {reason}") from cause


# The outputs.


class Publishers:
    """Publishes outputs under the node's own name.

    Outputs without a subscriber are not wanted, unless they are latched. An output whose message
    package is not installed is left out, and `say` gets a sentence. ParameterError where an
    override of its QoS makes no sense.
    """

    def __init__(
        self,
        node: Node,
        roles: Mapping[str, str],
        outputs: Mapping[str, OutputTopic],
        say: Callable[[str], None],
        sensors: SensorsParameters,
    ) -> None:
        """Offer the outputs of ticks, and of the sensors among the roles by input topic."""
        self._node = node
        self._publishers: dict[str, Any] = {}
        self._viewers = 0
        self._last: dict[str, bytes] = {}
        types = {name: output.type_name for name, output in outputs.items()}
        types |= SensorOutputs(roles, sensors).types
        try:
            for name, type_name in types.items():
                self._advertise(name, type_name, say)
        except BaseException:
            self.close()
            raise

    def wanted(self) -> frozenset[str]:
        """Return the names of the outputs that are latched or have a subscriber."""
        return frozenset(
            name
            for name, publisher in self._publishers.items()
            if (name in OUTPUTS and OUTPUTS[name].is_latched) or publisher.get_subscription_count()
        )

    def has_new_viewer(self) -> bool:
        """Return whether the markers have more subscribers than at the last call."""
        before, publisher = self._viewers, self._publishers.get("markers")
        self._viewers = publisher.get_subscription_count() if publisher else 0
        return self._viewers > before

    def publish(self, name: str, data: bytes) -> None:
        """Publish a serialised message; an output that was left out is ignored."""
        publisher = self._publishers.get(name)
        if publisher is not None:
            publisher.publish(data)
            if name in GUARDED_MAPS:
                self._last[name] = data

    def repeat_maps(self) -> None:
        """Publish the last maps again: the guard has put others in their place."""
        for name, data in self._last.items():
            self._publishers[name].publish(data)

    def flush(self, timeout_s: float) -> list[str]:
        """Wait until reliable subscribers have acknowledged all messages, at most this long.

        Returns the outputs with messages that were not acknowledged.
        """
        deadline_s, late = time.monotonic() + timeout_s, []
        for name, publisher in self._publishers.items():
            rest_s = max(0.0, deadline_s - time.monotonic())
            if not publisher.wait_for_all_acked(Duration(seconds=rest_s)):
                late.append(name)
        return late

    def close(self) -> None:
        """Withdraw all outputs."""
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        self._publishers.clear()
        self._last.clear()

    def _advertise(self, name: str, type_name: str, say: Callable[[str], None]) -> None:
        try:
            self._publishers[name] = advertise(self._node, type_name, f"~/{name}")
        except NodeError as cause:
            say(f"~/{name} is not published: {cause}")
