"""QoS of publishers and subscriptions: one table of the inputs, with overrides by parameters."""

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from rcl_interfaces.msg import SetParametersResult
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions

from are_ros.errors import ParameterError
from are_ros.messages.feed import OTHER_CAMERA
from are_ros.messages.sensors import CAMERA_INFO, CAMERA_INFO_TYPE, SENSORS
from are_ros.messages.tick_encoding import ALL_OUTPUTS, OutputTopic
from are_ros.node.message_classes import message_class


class InputTopic(NamedTuple):
    """The type of an input and its requested QoS; best effort matches every publisher."""

    type_name: str
    is_reliable: bool = False
    is_latched: bool = False
    depth: int = 10
    topic: str = ""
    """Its topic where that is not the role's own name, relative to the node's namespace."""
    follows: bool = False
    """It is latched, and reliable then, where its publishers latch it: for one that is usually
    latched, one of them is enough. Else it is reliable only where all of them are."""
    is_first_latched: bool = False
    """It is latched, too, as long as no publisher is known."""


INPUTS: Final[Mapping[str, InputTopic]] = MappingProxyType(
    {
        "map": InputTopic("nav_msgs/msg/OccupancyGrid", True, True, 1, follows=True),
        "octomap_point_cloud_centers": InputTopic(
            "sensor_msgs/msg/PointCloud2", True, depth=1, follows=True, is_first_latched=True
        ),
        "odom": InputTopic("nav_msgs/msg/Odometry", depth=50),
        **{role: InputTopic(kind.type_name) for role, kind in SENSORS.items()},
        "camera/camera_info": InputTopic(CAMERA_INFO_TYPE, depth=5, follows=True),
        OTHER_CAMERA: InputTopic(CAMERA_INFO_TYPE, depth=5, follows=True),
        CAMERA_INFO: InputTopic(CAMERA_INFO_TYPE, depth=5, follows=True),
        "tf": InputTopic("tf2_msgs/msg/TFMessage", True, depth=100, topic="/tf"),
        "tf_static": InputTopic(
            "tf2_msgs/msg/TFMessage", True, True, 100, "/tf_static", follows=True
        ),
        "clicked_point": InputTopic("geometry_msgs/msg/PointStamped", True),
        "plan": InputTopic("nav_msgs/msg/Path", True, depth=1),
    }
)
"""The inputs by role."""

_OTHER_OUTPUT: Final = OutputTopic("")
"""Augmented sensor data and the diagnostics are offered like this."""

_POLICIES_OF_GIVEN: Final = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH)
_POLICIES: Final = (*_POLICIES_OF_GIVEN, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)


def input_type(role: str, topic: str) -> str:
    """Return the type of the input of a role on a topic; of images, the name tells which."""
    return SENSORS[role].type_of(topic) if role in SENSORS else INPUTS[role].type_name


def input_qos(role: str) -> QoSProfile:
    """Return a new profile for the input of a role; KeyError if there is no such role."""
    entry = INPUTS[role]
    return profile_of(entry.is_reliable, entry.is_latched, entry.depth)


def output_qos(name: str) -> QoSProfile:
    """Return a new profile for an output, by the last part of its topic: always reliable."""
    entry = ALL_OUTPUTS.get(name, _OTHER_OUTPUT)
    return profile_of(True, entry.is_latched, entry.depth)


def subscribe(
    node: Node,
    role: str,
    callback: Callable[..., None],
    topic: str = "",
    qos_profile: QoSProfile | None = None,
    **options: Any,
) -> Any:
    """Subscribe to the input of a role, on its own topic or on another one.

    The parameters qos_overrides.<full topic>.subscription.{history, depth, reliability,
    durability} go before the table; ParameterError if one makes no sense, NodeError if the message
    is not installed. A `qos_profile` goes before the table too, and its durability and reliability
    before any override: rclpy would hold on to those of a topic's first subscription. `options` go
    to rclpy.
    """
    name = topic or INPUTS[role].topic or role
    policies = _POLICIES if qos_profile is None else _POLICIES_OF_GIVEN
    return _created(
        node.create_subscription,
        input_type(role, name),
        name,
        policies=policies,
        qos_profile=qos_profile or input_qos(role),
        callback=callback,
        **options,
    )


def advertise(
    node: Node,
    type_name: str,
    topic: str,
    qos_profile: QoSProfile | None = None,
    **options: Any,
) -> Any:
    """Offer an output, whose profile its topic's last part decides unless one is given.

    The overrides are qos_overrides.<full topic>.publisher.{history, depth, reliability,
    durability}; errors as with `subscribe`.
    """
    profile = qos_profile or output_qos(topic.rpartition("/")[2])
    return _created(node.create_publisher, type_name, topic, qos_profile=profile, **options)


class _Offer(NamedTuple):
    """What a publisher offers.

    A latched subscription gets nothing from a publisher that does not latch, and another one gets
    nothing that was latched before. Nor does one of them get that by best effort; and a reliable
    one gets nothing from a publisher by best effort.
    """

    is_reliable: bool
    is_latched: bool
    """Reliably."""


def _offers(node: Node, topic: str, type_name: str) -> list[_Offer]:
    """Return what each publisher of a topic offers; those of other types cannot be heard."""
    found = []
    for endpoint in node.get_publishers_info_by_topic(node.resolve_topic_name(topic)):
        if endpoint.topic_type != type_name:
            continue
        profile = endpoint.qos_profile
        is_reliable = profile.reliability == ReliabilityPolicy.RELIABLE
        is_latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        found.append(_Offer(is_reliable, is_reliable and is_latched))
    return found


class InputSubscription:
    """A subscription to the input of a role, made anew by `follow` where its publishers ask for it.

    Who overrides its durability by a parameter has chosen: it follows nobody then. Who overrides
    its reliability has chosen that of one that is not latched. `topic`, `options` and errors are
    those of `subscribe`.
    """

    def __init__(
        self,
        node: Node,
        role: str,
        callback: Callable[..., None],
        topic: str = "",
        **options: Any,
    ) -> None:
        self._node, self._role = node, role
        self.topic = topic or INPUTS[role].topic or role
        self._callback, self._options = callback, options
        is_chosen = self._override("durability") is not None
        self._follows = INPUTS[role].follows and not is_chosen
        self._chosen = self._chosen_reliability() if self._follows else None
        self._is_reliable = INPUTS[role].is_reliable
        self.is_latched = INPUTS[role].is_latched or INPUTS[role].is_first_latched
        """Whether it gets what was latched before."""
        self.subscription = self._subscribed()

    def follow(self) -> None:
        """Subscribe anew if the publishers of an input that follows them offer it otherwise."""
        kind = input_type(self._role, self.topic)
        offers = _offers(self._node, self.topic, kind) if self._follows else []
        if not offers:
            return
        entry, before = INPUTS[self._role], self._profile()
        latching = [offer.is_latched for offer in offers]
        self.is_latched = any(latching) if entry.is_latched else all(latching)
        self._is_reliable = entry.is_reliable and all(offer.is_reliable for offer in offers)
        if self._profile() == before:
            return
        self._node.destroy_subscription(self.subscription)
        self.subscription = self._subscribed()

    def _chosen_reliability(self) -> ReliabilityPolicy | None:
        """Return the reliability that an override asks for, None without one.

        One without sense is refused now: a latched subscription does not look at it.
        """
        value = self._override("reliability")
        if value is None:
            return None
        known = ReliabilityPolicy.__members__
        if str(value).upper() not in known:
            reason = f"Unexpected QoS override for policy `reliability`: `{value}`"
            raise ParameterError(f"topic '{self.topic}' with its qos_overrides: {reason}")
        return known[str(value).upper()]

    def _override(self, policy: str) -> Any:
        """Return the value that a parameter gives a policy, None if there is none."""
        name = f"qos_overrides.{self._node.resolve_topic_name(self.topic)}.subscription.{policy}"
        given = self._node._parameter_overrides.get(name)  # noqa: SLF001 - it has no other name
        return None if given is None else given.value

    def _subscribed(self) -> Any:
        options = self._options
        if self._follows:
            # Without a callback rclpy warns; `follow` adapts the subscription.
            events = SubscriptionEventCallbacks(incompatible_qos=lambda _: None)
            options = {**options, "qos_profile": self._profile(), "event_callbacks": events}
        return subscribe(self._node, self._role, self._callback, self.topic, **options)

    def _profile(self) -> QoSProfile:
        is_latched, depth = self.is_latched, INPUTS[self._role].depth
        profile = profile_of(self._is_reliable or is_latched, is_latched, depth)
        if self._chosen is not None and not is_latched:
            profile.reliability = self._chosen
        return profile


def profile_of(is_reliable: bool, is_latched: bool, depth: int) -> QoSProfile:
    """Return a new profile that keeps the last `depth` messages."""
    reliability, durability = ReliabilityPolicy, DurabilityPolicy
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=reliability.RELIABLE if is_reliable else reliability.BEST_EFFORT,
        durability=durability.TRANSIENT_LOCAL if is_latched else durability.VOLATILE,
    )


def _created(
    create: Callable[..., Any],
    type_name: str,
    topic: str,
    policies: Iterable[QoSPolicyKind] = _POLICIES,
    **options: Any,
) -> Any:
    """Return the publisher or subscription that rclpy creates, its policies open to overrides."""
    overriding = QoSOverridingOptions(policies, callback=_checked)
    try:
        return create(message_class(type_name), topic, qos_overriding_options=overriding, **options)
    except (
        InvalidQosOverridesError,
        InvalidParameterTypeException,
        InvalidParameterValueException,
        RuntimeError,  # an override that names no value of its policy
    ) as cause:
        raise ParameterError(f"topic '{topic}' with its qos_overrides: {cause}") from cause


def _checked(profile: QoSProfile) -> SetParametersResult:
    """Refuse a depth below 1, which rclpy accepts and DDS does not."""
    if profile.history == HistoryPolicy.KEEP_LAST and profile.depth < 1:
        return SetParametersResult(
            successful=False, reason=f"depth {profile.depth} keeps no message"
        )
    return SetParametersResult(successful=True)
