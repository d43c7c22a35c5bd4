"""The node under test, and a user of it: two participants of DDS, turned by the test's own thread.

Time is simulated: it is what the user says on /clock, in seconds.
"""

import re
import time
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from are_ros.messages.tick_encoding import OUTPUTS
from are_ros.node.ar_builder_node import ArBuilderNode
from are_ros.node.message_classes import message_class, service_class
from are_ros.node.qos import INPUTS, input_qos, input_type, output_qos
from bags.simulation.making import make_time
from tests.node.live_scene import FACTORY, ns
from tests.ros import WAIT_S, RosWorld, running_s, wait_until

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
MAP_TOPIC = "/ar_builder/augmented_map"
PERIOD_NS = 100_000_000
DELETE, DELETE_ALL = 2, 3
_SERVICES = {
    "spawn": "are_msgs/srv/SpawnArtefact",
    "remove": "are_msgs/srv/RemoveArtefact",
    "reseed": "are_msgs/srv/Reseed",
    "clear": "std_srvs/srv/Trigger",
    "pause": "std_srvs/srv/SetBool",
    "set_parameters": "rcl_interfaces/srv/SetParameters",
    "set_parameters_atomically": "rcl_interfaces/srv/SetParametersAtomically",
    "change_state": "lifecycle_msgs/srv/ChangeState",
    "get_state": "lifecycle_msgs/srv/GetState",
}
_WARNING = re.compile(r"(?m)^\[(?:WARN|ERROR|FATAL)\] \[[\d.]+\] \[[\w.]*ar_builder\]: (.*)$")
_IDLE_S, _STALL_S, _IDLE_TURNS = 0.008, 0.2, 2
_ASK_S = 0.05


class UndiscoveredError(Exception):
    """Node and user did not find each other; the text tells what the user sees of the node."""


class Bench:
    """What a user does to the node, over topics and services, and what it hears of it.

    `node` is looked into only to know that DDS has done its part. UndiscoveredError where it does
    not within `discovery_s`.
    """

    def __init__(
        self,
        node_world: RosWorld,
        user_world: RosWorld,
        values: Mapping[str, Any],
        read_log: Callable[[], str],
        arguments: tuple[str, ...] = (),
        discovery_s: float = WAIT_S,
    ) -> None:
        self._worlds = (node_world, user_world)
        kind: Any = ArBuilderNode
        self.node: ArBuilderNode = node_world.make_node(
            "ar_builder", kind=kind, parameters=values, arguments=arguments
        )
        self.user = user_world.make_node("user")
        self.name = self.node.get_fully_qualified_name()
        self._space = self.node.get_namespace().rstrip("/")
        self.publishers: dict[str, Any] = {}
        self._read_log = read_log
        self.log = ""
        self._clients: dict[str, Any] = {}
        self._reports: list[Any] | None = None
        self._clock = self.user.create_publisher(Clock, "/clock", 10)
        self._connect(discovery_s)

    # ------------------------------------------------------------------------------ turning

    def until(self, is_done: Callable[[], Any], timeout_s: float = WAIT_S) -> None:
        """Run callbacks until `is_done()`; the test fails when it is not within the time."""
        wait_until(is_done, self.turn, timeout_s)

    def turn_for(self, duration_s: float) -> None:
        """Run callbacks for a while."""
        end_s = running_s() + duration_s
        while running_s() < end_s:
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
        """Say the time to an active node, and wait until only what is later is due next."""
        self.clock(t_s)
        self.until(lambda: 0 < self._due_ns() - ns(t_s) <= PERIOD_NS)
        self.settle()

    def settle(self) -> None:
        """Wait for what is on its way: a round trip, then until nothing comes any more."""
        self.call("get_state")
        idle = 0
        while idle < _IDLE_TURNS:
            began_s = time.monotonic()
            self._worlds[1].executor.spin_once(timeout_sec=_IDLE_S)
            taken_s = time.monotonic() - began_s
            idle = idle + 1 if _IDLE_S <= taken_s < _STALL_S else 0  # of a stall nothing is known

    def _due_ns(self) -> int:
        due_ns = self.node.live.next_due_ns() if self.node.live else None
        return 2**63 if due_ns is None else due_ns

    # ------------------------------------------------------------------------------ topics

    def publisher(self, role: str, topic: str = "", qos: QoSProfile | None = None) -> Any:
        """Return a publisher of an input, as reliable as the input or as `qos` says."""
        topic = topic or INPUTS[role].topic or f"{self._space}/{role}"
        if topic not in self.publishers:
            kind = message_class(input_type(role, topic))
            made = self.user.create_publisher(kind, topic, qos or _usual_qos(role))
            self.publishers[topic] = made
            self.until(made.get_subscription_count)
            subscriptions = self.node._inputs._subscriptions if self.node._inputs else {}
            if topic in subscriptions:
                self.until(subscriptions[topic].subscription.get_publisher_count)
        return self.publishers[topic]

    def send(self, role: str, message: Any, topic: str = "", qos: QoSProfile | None = None) -> None:
        """Publish an input, a message or any bytes, and wait until the node has received it."""
        publisher = self.publisher(role, topic, qos)
        assert self.node._inputs is not None
        watch = self.node._inputs.watches[publisher.topic_name]
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
        if self.node._outputs is not None:
            publisher = self.node._outputs._publishers[name]
            self.until(publisher.get_subscription_count)
        return heard

    # ------------------------------------------------------------------------------ services

    def call(self, service: str, **fields: Any) -> Any:
        """Call a service of the node, and return the response."""
        future = self._clients[service].call_async(
            self._clients[service].srv_type.Request(**fields)
        )
        self.until(future.done)
        return future.result()

    def _connect(self, discovery_s: float) -> None:
        """Wait until all services can be called; UndiscoveredError if they cannot in time.

        Between participants of one process Fast DDS loses requests that come before the server has
        seen the client. It sees clients in their order, so one answer of the last one is enough.
        """
        last = self._clients_to_the_node()
        answers: list[Any] = []
        end_s = running_s() + discovery_s
        while not answers:
            if running_s() > end_s:
                raise UndiscoveredError(self._what_the_user_sees(last))
            if last.service_is_ready():
                last.call_async(last.srv_type.Request()).add_done_callback(answers.append)
                self.turn_for(_ASK_S)
            else:
                self.turn()

    def _clients_to_the_node(self) -> Any:
        """Make the clients of all services, and return the last one."""
        for service, type_name in _SERVICES.items():
            kind = service_class(type_name)
            self._clients[service] = self.user.create_client(kind, f"{self.name}/{service}")
        return self._clients[[*_SERVICES][-1]]

    def _what_the_user_sees(self, client: Any) -> str:
        """Return what the user knows of the node and of one of its services."""
        requests, replies = f"rq{client.srv_name}Request", f"rr{client.srv_name}Reply"
        readers = self.user.get_subscriptions_info_by_topic(requests, no_mangle=True)
        writers = self.user.get_publishers_info_by_topic(replies, no_mangle=True)
        found = f"readers of requests: {len(readers)}, writers of replies: {len(writers)}"
        names = f"nodes: {self.user.get_node_names()}"
        return f"{client.srv_name}: {found}, ready: {client.service_is_ready()}, {names}"

    def change_state(self, *labels: str) -> bool:
        """Go through transitions (configure, activate, ...); tell whether the last one was done."""
        response: Any = None
        for label in labels:
            transition = FACTORY.make("lifecycle_msgs/msg/Transition", label=label)
            response = self.call("change_state", transition=transition)
        return bool(response.success)

    def state(self) -> str:
        """Return the node's lifecycle state, as its service says it."""
        return str(self.call("get_state").current_state.label)

    def set(self, **values: Any) -> str:
        """Set one parameter after the other ("__" is a dot); return the refusals' reasons."""
        results = self.call("set_parameters", parameters=_parameters(values)).results
        return "".join(result.reason for result in results)

    def set_together(self, **values: Any) -> str:
        """Set all of the parameters or none; return the reason of the refusal."""
        response = self.call("set_parameters_atomically", parameters=_parameters(values))
        return str(response.result.reason)

    def spawn(self, pose: Any, **fields: Any) -> Any:
        """Ask for an artefact, of any row unless `fields` say otherwise."""
        asked = {"row": -1, **fields}
        return self.call("spawn", pose=pose, **asked)

    def pause(self, is_paused: bool) -> Any:
        """Pause or resume."""
        return self.call("pause", data=is_paused)

    # ------------------------------------------------------------------------------ what was said

    def warnings(self) -> list[str]:
        """Return what the node has warned of so far in its log on stderr, and its errors."""
        self.log += self._read_log()
        return _WARNING.findall(self.log)

    def report(self) -> dict[str, Any]:
        """Let the node say at once how it does, and return the statuses of /diagnostics by name.

        Without the node's own name in front.
        """
        if self._reports is None:
            self._reports = []
            kind = message_class("diagnostic_msgs/msg/DiagnosticArray")
            heard = self.user.create_subscription(kind, "/diagnostics", self._reports.append, 10)
            self.until(heard.get_publisher_count)
            self.until(self.node._reporter._publisher.get_subscription_count)
        self._reports.clear()
        self.node._report()
        self.until(lambda: self._reports)
        return {status.name.partition(": ")[2]: status for status in self._reports[-1].status}


def stamp_ns(message: Any) -> int:
    """Return the stamp of a message's header."""
    return int(message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec)


def _usual_qos(role: str) -> QoSProfile:
    """Return how an input is usually published: a cloud of voxels is latched."""
    return LATCHED if role == "octomap_point_cloud_centers" else input_qos(role)


def _parameters(values: Mapping[str, Any]) -> list[Any]:
    return [
        Parameter(name.replace("__", "."), value=value).to_parameter_msg()
        for name, value in values.items()
    ]
