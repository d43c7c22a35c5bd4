"""The node under test, and a user of it: two participants of DDS, turned by the test's own thread.

Time is simulated: it is what the user says on /clock, in seconds.
"""

import time
from collections.abc import Callable, Mapping
from typing import Any

import pytest
from rcl_interfaces.msg import Log
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from are_ros.messages.tick_encoding import OUTPUTS
from are_ros.messages.times import make_time
from are_ros.node.ar_builder_node import ArBuilderNode
from are_ros.node.message_classes import message_class, service_class
from are_ros.node.qos import INPUTS, input_qos, output_qos
from tests.node.live_scene import FACTORY, ns
from tests.ros import RosWorld

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ROSOUT = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
MAP_TOPIC = "/ar_builder/augmented_map"
PERIOD_NS = 100_000_000
DELETE, DELETE_ALL = 2, 3


class Bench:
    """What a user does to the node, over topics and services, and what it hears of it.

    `node` is looked into only to know that DDS has done its part.
    """

    def __init__(
        self,
        node_world: RosWorld,
        user_world: RosWorld,
        values: Mapping[str, Any],
        arguments: tuple[str, ...] = (),
    ) -> None:
        self._worlds = (node_world, user_world)
        kind: Any = ArBuilderNode
        self.node: ArBuilderNode = node_world.make_node(
            "ar_builder", kind=kind, parameters=values, arguments=arguments
        )
        self.user = user_world.make_node("user")
        self.name = self.node.get_fully_qualified_name()
        self.publishers: dict[str, Any] = {}
        self.logged: list[Log] = []
        self.user.create_subscription(Log, "/rosout", self.logged.append, ROSOUT)
        self._clients: dict[str, Any] = {}
        self._clock = self.user.create_publisher(Clock, "/clock", 10)

    # ------------------------------------------------------------------------------ turning

    def until(self, is_done: Callable[[], Any], timeout_s: float = 20.0) -> None:
        """Run callbacks until `is_done()`; the test fails when it is not within the time."""
        deadline_s = time.monotonic() + timeout_s
        while not is_done():
            if time.monotonic() > deadline_s:
                pytest.fail(f"what was waited for did not happen within {timeout_s} s")
            self.turn()

    def turn_for(self, duration_s: float) -> None:
        """Run callbacks for a while."""
        deadline_s = time.monotonic() + duration_s
        while time.monotonic() < deadline_s:
            self.turn()

    def turn(self) -> None:
        """Run what is ready on both sides."""
        for world in self._worlds:
            world.executor.spin_once(timeout_sec=0.003)

    # ------------------------------------------------------------------------------ time

    def clock(self, t_s: float) -> None:
        """Say the time, and wait until the node knows it."""
        if self._clock.get_subscription_count() == 0:
            self.until(self._clock.get_subscription_count)
            self.settle()
        self._clock.publish(Clock(clock=make_time(FACTORY, ns(t_s))))
        self.until(lambda: self.node.now_ns() == ns(t_s))

    def tick(self, t_s: float) -> None:
        """Say the time, and wait until the node has nothing to do before a later time."""
        self.clock(t_s)
        self.until(lambda: self._due_ns() > ns(t_s))
        self.settle()

    def settle(self) -> None:
        """Wait for what is on its way: a round trip, and what comes with it."""
        self.call("get_state", "lifecycle_msgs/srv/GetState")
        self.turn_for(0.03)

    def _due_ns(self) -> int:
        due_ns = self.node.live.next_due_ns() if self.node.live else None
        return 2**63 if due_ns is None else due_ns

    # ------------------------------------------------------------------------------ topics

    def publisher(self, role: str, topic: str = "", qos: QoSProfile | None = None) -> Any:
        """Return a publisher of an input, as reliable as the input or as `qos` says."""
        topic = topic or INPUTS[role].topic or f"/{role}"
        if topic not in self.publishers:
            kind = message_class(INPUTS[role].type_name)
            made = self.user.create_publisher(kind, topic, qos or input_qos(role))
            self.publishers[topic] = made
            self.until(made.get_subscription_count)
            subscriptions = self.node._inlets._subscriptions if self.node._inlets else {}
            if topic in subscriptions:
                self.until(subscriptions[topic].get_publisher_count)
        return self.publishers[topic]

    def send(self, role: str, message: Any, topic: str = "", qos: QoSProfile | None = None) -> None:
        """Publish an input, a message or any bytes, and wait until the node has received it."""
        publisher = self.publisher(role, topic, qos)
        assert self.node._inlets is not None
        watch = self.node._inlets.watches[publisher.topic_name]
        before = watch.count
        publisher.publish(message)
        self.until(lambda: watch.count > before)

    def listen(self, name: str, type_name: str = "", qos: QoSProfile | None = None) -> list[Any]:
        """Subscribe to an output, and return the list that messages are appended to."""
        heard: list[Any] = []
        kind = message_class(type_name or OUTPUTS[name].type_name)
        topic = f"{self.name}/{name}"
        listener = self.user.create_subscription(kind, topic, heard.append, qos or output_qos(name))
        self.until(listener.get_publisher_count)
        if self.node._outlets is not None:
            publisher = self.node._outlets._publishers[name]
            self.until(publisher.get_subscription_count)
        return heard

    # ------------------------------------------------------------------------------ services

    def call(self, service: str, type_name: str, **fields: Any) -> Any:
        """Call a service of the node, and return the response."""
        kind = service_class(type_name)
        if service not in self._clients:
            self._clients[service] = self.user.create_client(kind, f"{self.name}/{service}")
            self.until(self._clients[service].service_is_ready)
        future = self._clients[service].call_async(kind.Request(**fields))
        self.until(future.done, timeout_s=60.0)
        return future.result()

    def change_state(self, *labels: str) -> bool:
        """Go through transitions (configure, activate, ...); tell whether the last one was done."""
        response: Any = None
        for label in labels:
            transition = FACTORY.make("lifecycle_msgs/msg/Transition", label=label)
            response = self.call(
                "change_state", "lifecycle_msgs/srv/ChangeState", transition=transition
            )
        return bool(response.success)

    def state(self) -> str:
        """Return the node's lifecycle state, as its service says it."""
        return str(self.call("get_state", "lifecycle_msgs/srv/GetState").current_state.label)

    def set(self, **values: Any) -> str:
        """Set one parameter after the other ("__" is a dot); return the refusals' reasons."""
        request = _parameters(values)
        client = self.call("set_parameters", "rcl_interfaces/srv/SetParameters", parameters=request)
        return "".join(result.reason for result in client.results)

    def set_together(self, **values: Any) -> str:
        """Set all of the parameters or none; return the reason of the refusal."""
        request = _parameters(values)
        return str(
            self.call(
                "set_parameters_atomically",
                "rcl_interfaces/srv/SetParametersAtomically",
                parameters=request,
            ).result.reason
        )

    def spawn(self, pose: Any, **fields: Any) -> Any:
        """Ask for an artefact, of any row unless `fields` say otherwise."""
        asked = {"row": -1, **fields}
        return self.call("spawn", "are_msgs/srv/SpawnArtefact", pose=pose, **asked)

    def pause(self, is_paused: bool) -> Any:
        """Pause or resume."""
        return self.call("pause", "std_srvs/srv/SetBool", data=is_paused)

    # ------------------------------------------------------------------------------ what was said

    def sentences(self) -> list[str]:
        """Return what the node has logged so far."""
        self.settle()
        return [entry.msg for entry in self.logged]

    def diagnostics(self) -> list[Any]:
        """Return the list that the statuses of /diagnostics go to, by name, newest last."""
        heard: list[Any] = []

        def take(message: Any) -> None:
            heard.append({status.name: status for status in message.status})

        kind = message_class("diagnostic_msgs/msg/DiagnosticArray")
        self.user.create_subscription(kind, "/diagnostics", take, 10)
        return heard


def stamp_ns(message: Any) -> int:
    """Return the stamp of a message's header."""
    return int(message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec)


def _parameters(values: Mapping[str, Any]) -> list[Any]:
    return [
        Parameter(name.replace("__", "."), value=value).to_parameter_msg()
        for name, value in values.items()
    ]
