"""The services of the node: requests are carried out at once, or refused with the reason."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, Final

from rclpy.node import Node
from rclpy.qos import QoSProfile

from are_ros.builder.spawning.requests import SpawnRequest
from are_ros.conventions import NS_PER_S
from are_ros.errors import AreError, InputError, PlacementError
from are_ros.messages.goals import read_stamped_pose
from are_ros.node.diagnostics import WITHOUT_CLOCK
from are_ros.node.live_builder import LiveBuilder
from are_ros.node.message_classes import service_class
from are_ros.wording import counted

_MOST_WAITING: Final = 1000
"""So many requests may wait for a callback to return; of more, DDS would drop the oldest. By the
default of ROS ten may."""
_NOT_ACTIVE: Final = "the node is not active: configure and activate it first"


class Services:
    """Offers the services.

    `live()` returns the running builder, None while the node is inactive; `now_ns()` the time.
    `pause(is_paused)` pauses or resumes the node and returns the answer's message. Each request is
    carried out within `turn("services")`.
    """

    def __init__(
        self,
        node: Node,
        live: Callable[[], LiveBuilder | None],
        now_ns: Callable[[], int],
        pause: Callable[[bool], str],
        turn: Callable[[str], AbstractContextManager[None]],
    ) -> None:
        """Raise NodeError where the packages of the services are not installed."""
        self._live = live
        self._now_ns = now_ns
        self._pause = pause
        self._turn = turn
        for name, type_name, handler in (
            ("spawn", "are_msgs/srv/SpawnArtefact", self._spawn),
            ("remove", "are_msgs/srv/RemoveArtefact", self._remove),
            ("reseed", "are_msgs/srv/Reseed", self._reseed),
            ("clear", "std_srvs/srv/Trigger", self._clear),
            ("pause", "std_srvs/srv/SetBool", self._set_paused),
        ):
            kind, answer = service_class(type_name), self._answering(handler)
            qos = QoSProfile(depth=_MOST_WAITING)
            node.create_service(kind, f"~/{name}", answer, qos_profile=qos)

    def _answering(
        self, handler: Callable[[Any, Any, LiveBuilder, int], str]
    ) -> Callable[[Any, Any], Any]:
        def answer(request: Any, response: Any) -> Any:
            live = self._live()
            response.success = False
            if live is None:
                response.message = _NOT_ACTIVE
                return response
            now_ns = self._now_ns()
            if not now_ns:
                response.message = WITHOUT_CLOCK
                return response
            try:
                with self._turn("services"):
                    # a tick due by now comes before the request
                    live.work(now_ns)
                    response.message = handler(request, response, live, now_ns)
                response.success = True
            except AreError as cause:
                response.message = str(cause)
            return response

        return answer

    def _spawn(self, request: Any, response: Any, live: LiveBuilder, now_ns: int) -> str:
        if not live.is_running:
            raise PlacementError("spawn: it is paused")
        frame_id, _, pose = read_stamped_pose(request.pose, "spawn: pose")
        seconds, nanoseconds = request.life.sec, request.life.nanosec
        life_ns = seconds * NS_PER_S + nanoseconds
        if life_ns < 0:
            raise InputError(f"spawn: life: {life_ns / NS_PER_S} s is negative")
        wanted = SpawnRequest(
            frame_id, pose, request.label, request.row, life_ns or None, request.behaviour
        )
        response.id = live.requests.spawn(wanted, now_ns)
        return f"artefact {response.id} stands"

    def _remove(self, request: Any, response: Any, live: LiveBuilder, now_ns: int) -> str:  # noqa: ARG002 - the handlers' interface
        live.requests.remove(request.id, now_ns)
        return f"artefact {request.id} is gone"

    def _reseed(self, request: Any, response: Any, live: LiveBuilder, now_ns: int) -> str:  # noqa: ARG002 - the handlers' interface
        live.requests.reseed(request.seed, now_ns)
        return f"random numbers begin anew from seed {request.seed}"

    def _clear(self, request: Any, response: Any, live: LiveBuilder, now_ns: int) -> str:  # noqa: ARG002 - the handlers' interface
        count = live.requests.clear(now_ns)
        return f"{counted(count, 'artefact')} {'is' if count == 1 else 'are'} gone"

    def _set_paused(self, request: Any, response: Any, live: LiveBuilder, now_ns: int) -> str:  # noqa: ARG002 - the handlers' interface
        return self._pause(bool(request.data))
