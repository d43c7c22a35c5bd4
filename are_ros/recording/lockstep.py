"""Lockstep: the time goes on when a node has taken everything that came before."""

import time
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

    Before the time goes on, one round trip through a service that every node has acknowledges what
    was sent: DDS delivers messages and requests of one process in their order, and an executor runs
    the callbacks of messages before that of the request that came after them. Maps and clouds,
    sent in fragments, are acknowledged by DDS as well (which takes too long to be done for all).
    After the time has been told, another round trip shows that the node knows it. NodeError
    where the node does not answer.
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
        if not self._outlets.wait_for_latched(_PATIENCE_S):
            raise NodeError(f"--lockstep {self._name}: messages were not acknowledged")
        self._meet()

    def told(self) -> None:
        """Wait until the node knows the time."""
        self._meet()

    def _meet(self) -> None:
        if self._should_stop():
            return
        future = self._client.call_async(self._request)
        deadline_s = time.monotonic() + _PATIENCE_S
        # Not spin_until_future_complete: each of its calls leaves tasks behind for the next ones.
        while not future.done() and not self._should_stop():
            self._executor.spin_once(timeout_sec=_ASK_S)
            if time.monotonic() > deadline_s:
                raise NodeError(f"--lockstep {self._name}: no answer for {_PATIENCE_S:.0f} s")
