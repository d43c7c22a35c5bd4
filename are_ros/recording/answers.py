"""The services of a node that nothing spins: their requests, taken and answered at chosen times."""

from typing import Any, Final, NamedTuple

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from are_ros.conventions import NS_PER_S

_MOST_AT_ONCE: Final = 10


class _Request(NamedTuple):
    service: Any
    content: Any
    header: Any


class Answers:
    """Takes the requests to all services of a node, and answers them when it is told to.

    A player in lockstep asks whether everything from before its request was taken. So a request is
    taken first, then what else is there, and then the request is answered.
    """

    def __init__(self, node: Node) -> None:
        self._context = node.context
        self._services = tuple(node.services)
        self._pending: list[_Request] = []

    def wait(self, timeout_s: float) -> None:
        """Sleep until there is a request, but no longer than this."""
        services = self._services
        with self._context.handle:
            wait_set = rclpy_implementation.WaitSet(
                0, 0, 0, 0, len(services), 0, self._context.handle
            )
            wait_set.clear_entities()
            for service in services:
                wait_set.add_service(service.handle)
            wait_set.wait(int(timeout_s * NS_PER_S))

    def take(self) -> bool:
        """Take the requests that are there; tell whether any wait for their answer."""
        for service in self._services:
            self._pending += self._taken(service)
        return bool(self._pending)

    def give(self) -> None:
        """Answer all requests that were taken."""
        pending, self._pending = self._pending, []
        for service, content, header in pending:
            answer = service.callback(content, service.srv_type.Response())
            service.send_response(answer, header)

    def _taken(self, service: Any) -> list[_Request]:
        found = []
        for _ in range(_MOST_AT_ONCE):
            content, header = service.handle.service_take_request(service.srv_type.Request)
            if header is None:
                break
            found.append(_Request(service, content, header))
        return found
