"""The publishers of the node's outputs, which take serialised messages."""

import time
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node

from are_ros.errors import AreError, NodeError
from are_ros.messages.sensors import sensor_outputs, sensor_topics
from are_ros.messages.tick_encoding import OUTPUTS
from are_ros.node.qos import advertise


class Publishers:
    """Publishes outputs under the node's own name.

    Outputs without a subscriber are not wanted, unless they are latched. An output whose message
    package is not installed is left out, and `say` gets a sentence. ParameterError where an
    override of its QoS makes no sense.
    """

    def __init__(self, node: Node, roles: Mapping[str, str], say: Callable[[str], None]) -> None:
        """Offer the outputs of ticks, and of the sensors among the roles by input topic."""
        self._node = node
        self._publishers: dict[str, Any] = {}
        self._viewers = 0
        types = {name: output.type_name for name, output in OUTPUTS.items()}
        names = sensor_outputs(roles)
        types |= {names[topic]: kind.type_name for topic, kind in sensor_topics(roles).items()}
        try:
            for name, type_name in types.items():
                self._advertise(name, type_name, say)
        except AreError:
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
        before, self._viewers = self._viewers, self._count("markers")
        return self._viewers > before

    def publish(self, name: str, data: bytes) -> None:
        """Publish a serialised message; an output that was left out is ignored."""
        publisher = self._publishers.get(name)
        if publisher is not None:
            publisher.publish(data)

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

    def _count(self, name: str) -> int:
        publisher = self._publishers.get(name)
        return 0 if publisher is None else int(publisher.get_subscription_count())

    def _advertise(self, name: str, type_name: str, say: Callable[[str], None]) -> None:
        try:
            self._publishers[name] = advertise(self._node, type_name, f"~/{name}")
        except NodeError as cause:
            say(f"~/{name} is not published: {cause}")
