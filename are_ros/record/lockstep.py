"""Pacing of the player. Lockstep: /clock advances when the nodes have taken all messages."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from are_ros.bag.clock import CLOCK_TOPIC
from are_ros.bag.reader import BagMessage
from are_ros.conventions import NS_PER_S
from are_ros.errors import NodeError
from are_ros.node.message_classes import service_class
from are_ros.record.publishers import LARGE_BYTES, ClockPublisher, PlayedTopics, is_listening

ShouldStop = Callable[[], bool]


class Pace:
    """Decides when a player sends messages and the time; this one sends all at once."""

    def __init__(self, should_stop: ShouldStop) -> None:
        self._should_stop = should_stop

    def begin(self, now_ns: int) -> None:
        """Begin a pass at this time of the recording."""

    def wait_until(self, now_ns: int) -> bool:  # noqa: ARG002 - others wait for this time
        """Wait for this time of the recording; False if the pass is to end before."""
        return not self._should_stop()

    def wait_a_little(self) -> bool:
        """Wait between messages of the same time; False as above."""
        return not self._should_stop()

    def rest(self) -> None:
        """Wait until subscribers have processed the first map."""

    def send(self, message: BagMessage, topics: PlayedTopics) -> None:
        """Publish a message."""
        topics.publish(message)

    def tell(self, now_ns: int, clock: ClockPublisher) -> None:
        """Publish the time: everything earlier was sent."""
        clock.publish(now_ns)

    def end(self) -> None:
        """Wait until the last messages were taken."""


# A node in lockstep with the player.


ASK_S: Final = 0.05
_REQUESTS: Final = 2


class LockstepPeer:
    """Asks one node, by its parameter service, whether it has taken all earlier messages.

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
        """Return whether the node can be asked."""
        return bool(self._client.service_is_ready())

    def follows_clock(self) -> bool:
        """Return whether the node subscribes to /clock."""
        return is_listening(self._node, self.name, [CLOCK_TOPIC])

    def ask(self) -> None:
        """Send the requests; the node answers when it has taken all earlier messages."""
        client = self._client.handle
        with client:
            self._asked = [client.send_request(self._kind.Request()) for _ in range(_REQUESTS)][-1]

    def await_answer(self, patience_s: float) -> None:
        """Wait for the answer to `ask`, or until `should_stop()`."""
        deadline_s = time.monotonic() + patience_s
        with self._client.handle, self._node.context.handle:
            while not self._should_stop():
                answered = self._next_answer()
                if answered is not None and answered >= self._asked:
                    return
                if answered is None and time.monotonic() > deadline_s:
                    raise NodeError(f"--lockstep {self.name}: no answer for {patience_s:.0f} s")

    def _next_answer(self) -> int | None:
        """Return the number of the next answered request, None if none is answered soon.

        A wait set is used: an executor would take ten times as long.
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


_PATIENCE_S: Final = 60.0
"""The node may be compiling its kernels."""
_CLOCK_PATIENCE_S: Final = 5.0


class Lockstep(Pace):
    """As fast as the slowest of some nodes can take the messages, in the same order each time.

    A barrier is a round trip through a service that every node has, its parameters'. Small
    messages and requests of this process travel in one queue, in the order in which they were
    sent. So when a request is there, all messages from before it are, also those for best-effort
    readers. What an executor does then depends on its kind:

    - rclpy's and rclcpp's single-threaded executors look at what is there, and then take of each
      subscription *one* message, and after the subscriptions one request of each service. Between
      looking at the subscriptions and at the services more may arrive, so that a request can be
      answered before a message that came earlier. A barrier is therefore two requests: the second
      is taken in a later look than the first, at which everything from before the first was
      there. And before a second message goes out on one topic there is a barrier, since one look
      takes one; no queue of a reader overflows then either, however short it is.
    - rclpy's EventsExecutor takes messages and requests in the order of their arrival.

    Timers that the time lets fire are due before what is sent after the barrier, as executors see
    to timers first. A multi-threaded executor with callbacks in several groups keeps no order.

    Packets of a large message may be lost and repeated, after the request. For these the
    publisher waits until reliable readers have acknowledged them. (For every message that would
    cost 6 ms: readers answer so late, and only when asked, which publishers do when their history
    is full: hence its depth of one in lockstep.) Large messages to best-effort readers may be
    lost, as always.

    With a recorder among the nodes nothing is missing in the recording, however slow its process
    is: what a node sends before it answers is with the recorder by the next barrier. NodeError
    where a node does not answer.
    """

    def __init__(
        self,
        node: Node,
        names: Sequence[str],
        should_stop: Callable[[], bool],
    ) -> None:
        super().__init__(should_stop)
        self._peers = [LockstepPeer(node, name, should_stop) for name in names]
        self._under_way: set[str] = set()

    def begin(self, now_ns: int) -> None:
        """Wait until the nodes can be asked, and follow /clock."""
        del now_ns
        why = "it does not follow /clock: start it with use_sim_time"
        for peer in self._peers:
            said = f"{peer.name}: there is no such node"
            self._await(peer.is_there, _PATIENCE_S, said)
            self._await(peer.follows_clock, _CLOCK_PATIENCE_S, f"{peer.name}: {why}")

    def send(self, message: BagMessage, topics: PlayedTopics) -> None:
        """Publish a message when the one before it, on its topic, was taken.

        Wait until a large one has arrived.
        """
        target = topics.target(message.topic)
        if target in self._under_way:
            self._meet()
        topics.publish(message)
        if topics.publishers[message.topic].get_subscription_count():
            self._under_way.add(target)
            if len(message.data) > LARGE_BYTES:
                self._await_arrival(message.topic, topics)

    def tell(self, now_ns: int, clock: ClockPublisher) -> None:
        """Publish the time when the nodes have taken everything; wait until they know it."""
        if self._under_way:
            self._meet()
        clock.publish(now_ns)
        self._meet()

    def end(self) -> None:
        """Wait twice: until the nodes have taken the messages, and then each other's outputs."""
        self._meet()
        self._meet()

    def _await(self, is_so: Callable[[], bool], patience_s: float, why_not: str) -> None:
        deadline_s = time.monotonic() + patience_s
        while not self._should_stop() and not is_so():
            if time.monotonic() > deadline_s:
                raise NodeError(f"--lockstep {why_not}")
            time.sleep(ASK_S)

    def _await_arrival(self, topic: str, topics: PlayedTopics) -> None:
        names = ", ".join(peer.name for peer in self._peers)
        why_not = f"{names}: {topic} was not acknowledged for {_PATIENCE_S:.0f} s"
        arrived = partial(topics.publishers[topic].wait_for_all_acked, Duration(seconds=ASK_S))
        self._await(arrived, _PATIENCE_S, why_not)

    def _meet(self) -> None:
        """Pass the barrier, or return when `should_stop()`."""
        self._under_way.clear()
        for peer in self._peers:
            peer.ask()
        for peer in self._peers:
            peer.await_answer(_PATIENCE_S)
