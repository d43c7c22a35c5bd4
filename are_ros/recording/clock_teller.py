"""/clock: the time of a recording, told while it is played."""

from collections.abc import Iterator

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

from are_ros.conventions import NS_PER_S
from are_ros.recording.play_outlets import CLOCK


class ClockTeller:
    """Publishes /clock, reliably, or not at all."""

    def __init__(self, node: Node, clock_hz: float) -> None:
        self._period_ns = round(NS_PER_S / clock_hz) if clock_hz else 0
        qos = QoSProfile(depth=10)
        self.publishers = {CLOCK: node.create_publisher(Clock, CLOCK, qos)} if clock_hz else {}

    def times_after(self, start_ns: int, end_ns: int) -> Iterator[int]:
        """Yield the multiples of the period after the start, and last the end."""
        if not self._period_ns:
            return
        yield from range(
            (start_ns // self._period_ns + 1) * self._period_ns, end_ns, self._period_ns
        )
        yield end_ns

    def tell(self, now_ns: int) -> None:
        """Publish the time."""
        for publisher in self.publishers.values():
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(now_ns, NS_PER_S)
            publisher.publish(message)
