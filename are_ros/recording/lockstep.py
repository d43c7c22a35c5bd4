"""Lockstep: the time goes on when a node has taken everything that came before."""

from typing import Any, Final

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from are_ros.errors import NodeError
from are_ros.node.message_classes import service_class
from are_ros.recording.play_outlets import PlayOutlets

_PATIENCE_S: Final = 60.0
"""A node may compile its kernels meanwhile."""
_ASK_S: Final = 0.05


class Lockstep:
    """A pace that is set by one node: as fast as it can, and always the same.

    Before the time goes on, the reliable publishers wait for their acknowledgements, and one round
    trip through a service that every node has shows that the node's executor has run the callbacks
    of all that came before: DDS delivers messages and requests of one process in their order, and
    an executor takes messages before the request that came after them. After the time has been
    told, another round trip shows that the node knows it. NodeError where the node does not answer.
    """

    def __init__(self, node: Node, name: str, outlets: PlayOutlets, should_stop: Any) -> None:
        self._name = name if name.startswith("/") else f"/{name}"
        self._outlets = outlets
        self._should_stop = should_stop
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        kind = service_class("rcl_interfaces/srv/GetParameters")
        self._client = node.create_client(kind, f"{self._name}/get_parameters")
        self._request = kind.Request()

    def begin(self, now_ns: int) -> None:
        """Wait until the node can be asked."""
        del now_ns
        waited_s = 0.0
        while not self._client.wait_for_service(_ASK_S) and not self._should_stop():
            waited_s += _ASK_S
            if waited_s > _PATIENCE_S:
                raise NodeError(f"--lockstep {self._name}: there is no such node")

    def wait_until(self, now_ns: int) -> bool:
        """Wait for nothing; tell whether to go on."""
        del now_ns
        return not self._should_stop()

    def about_to_tell(self) -> None:
        """Wait until the node has taken everything."""
        if not self._outlets.wait_until_acknowledged(_PATIENCE_S):
            raise NodeError(f"--lockstep {self._name}: messages were not acknowledged")
        self._meet()

    def told(self) -> None:
        """Wait until the node knows the time."""
        self._meet()

    def _meet(self) -> None:
        if self._should_stop():
            return
        future = self._client.call_async(self._request)
        self._executor.spin_until_future_complete(future, timeout_sec=_PATIENCE_S)
        if not future.done():
            raise NodeError(f"--lockstep {self._name}: no answer for {_PATIENCE_S:.0f} s")
