"""A node with which a player keeps in step: asked whether it has taken everything earlier."""

import time
from collections.abc import Callable
from typing import Final

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from are_ros.conventions import NS_PER_S
from are_ros.errors import NodeError
from are_ros.node.message_classes import service_class
from are_ros.recording.play_outlets import CLOCK

ASK_S: Final = 0.05
_REQUESTS: Final = 2


class LockstepPeer:
    """Asks one node through a service that every node has, its parameters'.

    NodeError, which names the node, where it does not answer.
    """

    def __init__(self, node: Node, name: str, should_stop: Callable[[], bool]) -> None:
        self.name = name if name.startswith("/") else f"/{name}"
        self._should_stop = should_stop
        self._kind = service_class("rcl_interfaces/srv/GetParameters")
        self._client = node.create_client(self._kind, f"{self.name}/get_parameters")
        self._node = node
        self._asked = 0

    def is_there(self) -> bool:
        """Tell whether the node can be asked."""
        return bool(self._client.service_is_ready())

    def follows_clock(self) -> bool:
        """Tell whether the node subscribes to /clock."""
        space, _, name = self.name.rpartition("/")
        wanted = (name, space or "/")
        infos = self._node.get_subscriptions_info_by_topic(CLOCK)
        return any((info.node_name, info.node_namespace) == wanted for info in infos)

    def ask(self) -> None:
        """Send what the node answers when it has taken everything from before."""
        client = self._client.handle
        with client:
            self._asked = [client.send_request(self._kind.Request()) for _ in range(_REQUESTS)][-1]

    def await_answer(self, patience_s: float) -> None:
        """Wait for the answer to `ask`, or return early where it is to stop."""
        deadline_s = time.monotonic() + patience_s
        with self._client.handle, self._node.context.handle:
            while not self._should_stop():
                answered = self._next_answer()
                if answered is not None and answered >= self._asked:
                    return
                if answered is None and time.monotonic() > deadline_s:
                    raise NodeError(f"--lockstep {self.name}: no answer for {patience_s:.0f} s")

    def _next_answer(self) -> int | None:
        """Return the number of the next request that was answered, None if none is soon.

        By a wait set of its own: an executor would take ten times as long about it.
        """
        client = self._client.handle
        wait_set = rclpy_implementation.WaitSet(0, 0, 0, 1, 0, 0, self._node.context.handle)
        wait_set.clear_entities()
        wait_set.add_client(client)
        wait_set.wait(int(ASK_S * NS_PER_S))
        header, _ = client.take_response(self._kind.Response)
        if header is not None:
            return int(header.request_id.sequence_number)
        if not self._client.service_is_ready():
            raise NodeError(f"--lockstep {self.name}: the node is gone")
        return None
