"""`are guard`: gives a navigation stack the real map back when the node was killed.

A node that ends in order leaves the real map behind. One that is killed cannot: its last map, with
artefacts in it, would stay in Nav2's costmaps for as long as Nav2 runs.
"""

from collections.abc import Sequence
from typing import Any, Final

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from are_ros.errors import AreError, NodeError
from are_ros.node.heartbeat import (
    GUARDED_MAPS,
    HEARTBEAT,
    HEARTBEAT_TYPE,
    heartbeat_qos,
    offer_relief,
)
from are_ros.node.message_classes import message_class
from are_ros.node.startup import executor_of, fatal, ros_context, stop_on_signals

NAME: Final = "ar_guard"
_GUARDED: Final = "ar_builder"
_MAP_TYPE: Final = "nav_msgs/msg/OccupancyGrid"
_LATCHED: Final = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_AS_IT_COMES: Final = QoSProfile(depth=1)
"""Of maps that nobody latches."""
_BY_BEST_EFFORT: Final = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Of maps that come no other way."""
_LEASE_S: Final = 0.5
"""Silence of this length is noticed, and must last `_GRACE_S` longer: when a whole machine stalls,
the guard may wake up before it hears the node again."""
_GRACE_S: Final = 0.3
_WAIT_S: Final = 0.1


class Guard(Node):  # type: ignore[misc] # rclpy is only partly typed
    """Publishes the real map, and an empty artefact map, when the node was killed.

    Until the node is back, later real maps follow; then the guard's own are withdrawn, so that they
    never reach anybody beside the node's, and the node sends its own again: it may only have been
    stopped for a while. NodeError where the middleware tells no liveliness.
    """

    def __init__(self, node_name: str = NAME, **options: Any) -> None:
        super().__init__(node_name, **options)
        self._map: bytes | None = None
        self._is_standing_in = False
        grid = self._grid = message_class(_MAP_TYPE)
        self._publishers_of_maps = self._advertise()
        self._relief = offer_relief(self, _GUARDED)
        # Without a callback rclpy warns of a map that another subscription gets.
        events = SubscriptionEventCallbacks(incompatible_qos=lambda _: None)
        for profile in (_LATCHED, _AS_IT_COMES, _BY_BEST_EFFORT):
            self.create_subscription(
                grid, "map", self._take_map, profile, raw=True, event_callbacks=events
            )
        self._confirmation = self.create_timer(
            _GRACE_S, self._stand_in, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self._confirmation.cancel()
        try:
            self.create_subscription(
                message_class(HEARTBEAT_TYPE),
                f"{_GUARDED}/{HEARTBEAT}",
                lambda _: None,
                heartbeat_qos(_LEASE_S),
                event_callbacks=SubscriptionEventCallbacks(liveliness=self._take_heartbeat),
            )
        except UnsupportedEventTypeError as cause:
            message = f"this middleware ({rclpy.get_rmw_implementation_identifier()}) does not tell"
            raise NodeError(f"{message} whether a publisher's process runs") from cause
        self.get_logger().info(f"waiting for {self._guarded}, to guard it")

    @property
    def _guarded(self) -> str:
        return str(self.resolve_topic_name(_GUARDED))

    def _advertise(self) -> dict[str, Any]:
        """Advertise the node's maps early, so that subscribers are matched when they are needed."""
        return {
            name: self.create_publisher(self._grid, f"{_GUARDED}/{name}", _LATCHED)
            for name in GUARDED_MAPS
        }

    def _take_heartbeat(self, event: Any) -> None:
        """Start the wait when a publisher falls silent; a withdrawn publisher is not dead."""
        if event.alive_count > 0:
            self._confirmation.cancel()
            self._step_back()
            if event.alive_count_change > 0:
                self.get_logger().info(f"{self._guarded} runs, and is guarded")
        elif event.not_alive_count_change > 0:
            self._confirmation.reset()

    def _take_map(self, message: bytes) -> None:
        if message == self._map:  # it came by another subscription, too
            return
        self._map = message
        if self._is_standing_in:
            self._publish(message)

    def _stand_in(self) -> None:
        """Publish the real map in place of the dead node."""
        self._confirmation.cancel()
        self._is_standing_in = True
        self.get_logger().error(f"{self._guarded} was killed")
        if self._map is not None:
            self._publish(self._map)

    def _publish(self, real: bytes) -> None:
        self._publishers_of_maps["augmented_map"].publish(real)
        empty = deserialize_message(real, self._grid)
        empty.data = type(empty.data)("b", bytes(len(empty.data)))
        self._publishers_of_maps["artefact_map"].publish(empty)
        self.get_logger().info("the real map is published, and an empty artefact map")

    def _step_back(self) -> None:
        """Withdraw the guard's publishers when the node is back, and tell it."""
        if not self._is_standing_in:
            return
        self._is_standing_in = False
        for publisher in self._publishers_of_maps.values():
            self.destroy_publisher(publisher)
        self._publishers_of_maps = self._advertise()
        self._relief.publish(message_class(HEARTBEAT_TYPE)())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the guard until a signal ends it; return the exit status, 1 if it could not run."""
    with stop_on_signals() as stop:
        try:
            with ros_context(arguments) as context:
                guard = Guard(context=context)
                with executor_of(guard) as executor:
                    while not stop.is_set and context.ok():
                        executor.spin_once(timeout_sec=_WAIT_S)
                guard.destroy_node()
        except AreError as cause:
            return fatal(NAME, cause)
    return 0
