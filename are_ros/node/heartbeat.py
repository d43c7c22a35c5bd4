"""The heartbeat of the node, by which `are guard` sees that the process runs.

It is a topic on which nothing is ever sent: DDS itself tells whether the process of its publisher
still runs (QoS liveliness, AUTOMATIC). Neither a busy or paused node nor simulated time that stands
still stops this heartbeat, and a publisher that was withdrawn is not a dead one.
"""

from collections.abc import Callable
from typing import Any, Final

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile

from are_ros.node.message_classes import message_class

HEARTBEAT: Final = "_alive"
"""The name of the topic, below the node's own name."""
HEARTBEAT_TYPE: Final = "std_msgs/msg/Empty"
RELIEF: Final = "_relief"
"""The topic, below the node's name, on which the guard says that it stood in, and does no more."""
GUARDED_MAPS: Final = ("augmented_map", "artefact_map")
"""The outputs of the node that the guard publishes in its place."""
_LATCHED: Final = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_OFFERED_S: Final = 0.3
"""DDS repeats that the process runs after two thirds of this."""


def offer_heartbeat(node: Node) -> Any:
    """Publish the heartbeat of this process, for `are guard`; the caller keeps the publisher."""
    profile = heartbeat_qos(_OFFERED_S)
    return node.create_publisher(message_class(HEARTBEAT_TYPE), f"~/{HEARTBEAT}", profile)


def heartbeat_qos(lease_s: float) -> QoSProfile:
    """Return the profile of a heartbeat: DDS reports a process that is silent for the lease."""
    return QoSProfile(
        depth=1,
        liveliness=LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=Duration(seconds=lease_s),
    )


def offer_relief(guard: Node, guarded: str) -> Any:
    """Return the publisher by which the guard tells the node of this name of its relief."""
    return guard.create_publisher(message_class(HEARTBEAT_TYPE), f"{guarded}/{RELIEF}", _LATCHED)


def listen_for_relief(node: Node, relieve: Callable[[], None]) -> None:
    """Call `relieve` when the guard has stood in for this node, which runs."""
    kind, topic = message_class(HEARTBEAT_TYPE), f"~/{RELIEF}"
    node.create_subscription(kind, topic, lambda _: relieve(), _LATCHED)
